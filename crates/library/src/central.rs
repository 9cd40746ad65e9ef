//! Central differences of order 2, 4 and 6, with estimates of their errors.
//!
//! Let `s_j = (x[k+j] - x[k]) / (t[k+j] - t[k])` be the slopes to the m neighbours on either side. The derivative at
//! row k is the value at `t[k]` of the polynomial through them, `sum_j l_j s_j`, of order 2m for any stamps. `l_j` are
//! the values there of Lagrange's polynomials of the neighbours (Fornberg, Mathematics of Computation 51 (1988), has
//! the same weights by recursion). If the stamps are even, `l_j` are numbers, and slopes to both sides join in one
//! quotient.
//!
//! Two sizes measure the error of a difference. Its truncation is the difference from the formula of two orders more.
//! The noise of the samples is the remainder of a row after the polynomial through its ten neighbours. A smooth signal
//! has almost no remainder; all of white noise remains, up to a known factor.

use crate::{Expr, Node, difference::rise};

/// Spacing of a log's stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Spacing {
    /// Evenly: the weights are numbers.
    Even,
    /// In any way: the weights are computed from the stamps.
    Stamps,
}

/// A central difference.
#[derive(Debug, Clone, PartialEq)]
pub struct CentralDifference {
    /// Expression to differentiate.
    pub of: Expr,
    /// True for an angle: its steps are wrapped.
    pub angle: bool,
    /// Rows to either side that it takes, 1 to 3; its order is twice that.
    pub reach: usize,
    /// Spacing of the stamps.
    pub spacing: Spacing,
}

/// The reaches of [`CentralDifference::reach`]: orders 2, 4 and 6.
pub const REACHES: [usize; 3] = [1, 2, 3];

/// `2 l_k` of even stamps for reach m, k = 1 to m: what multiplies the slope from k rows before to k rows behind.
const EVEN: [&[f64]; 4] = [&[1.0], &[4.0 / 3.0, -1.0 / 3.0], &[1.5, -0.6, 0.1], &[1.6, -0.8, 8.0 / 35.0, -1.0 / 35.0]];

/// Neighbours on either side that [`CentralDifference::noise`] takes.
const NOISE_REACH: usize = 5;

/// `(x[k+1] - x[k-1]) / (t[k+1] - t[k-1])`, of order 2 where the stamps are even; `angle` wraps the two steps and adds them.
pub fn central_difference(x: &Expr, angle: bool) -> Expr {
    symmetric_slope(x, 1, angle)
}

/// Unevenness of the stamps: half the difference of two neighbouring steps over their mean; 0 where the stamps are
/// even.
pub fn unevenness() -> Expr {
    let time = Expr::time();
    let (before, after) = (time.shifted(1), time.shifted(-1));
    (&after + &before - Expr::number(2.0) * time) / (after - before)
}

impl CentralDifference {
    /// The order of its error in the sampling period.
    pub fn order(&self) -> usize {
        2 * self.reach
    }

    /// The same difference with another reach.
    #[must_use]
    pub fn with_reach(&self, reach: usize) -> Self {
        Self { reach, ..self.clone() }
    }

    /// The difference as an expression. Order 2 over even stamps is [`central_difference`].
    pub fn expression(&self) -> Expr {
        if (self.reach, self.spacing) == (1, Spacing::Even) {
            return central_difference(&self.of, self.angle);
        }
        let slope = |(ahead, weight): (i32, Expr)| match self.spacing {
            Spacing::Even => weight * symmetric_slope(&self.of, ahead, self.angle),
            Spacing::Stamps => weight * self.slope(ahead),
        };
        let weights: Vec<(i32, Expr)> = match self.spacing {
            Spacing::Even => {
                let even = EVEN[(self.reach - 1).min(EVEN.len() - 1)];
                (1..).zip(even.iter().map(|&weight| Expr::number(weight))).collect()
            }
            Spacing::Stamps => weights(self.reach),
        };
        sum(weights.into_iter().map(slope))
    }

    /// Truncation error of the difference (the error without noise): this difference less the one that is two orders
    /// better.
    pub fn truncation(&self) -> Expr {
        self.expression() - self.with_reach(self.reach + 1).expression()
    }

    /// The noise of a sample, over the sampling period: its mean square is that of the noise, where it is white.
    pub fn noise(&self) -> Expr {
        let time = Expr::time();
        let far = NOISE_REACH as i32;
        let period = (time.shifted(-far) - time.shifted(far)) / Expr::number(f64::from(2 * far));
        let (left, amplified) = self.left_by_polynomial();
        left / ((Expr::number(1.0) + amplified).sqrt() * period)
    }

    /// The noise of a sample: its mean square is that of the noise, where it is white.
    pub fn noise_of_a_sample(&self) -> Expr {
        let (left, amplified) = self.left_by_polynomial();
        left / (Expr::number(1.0) + amplified).sqrt()
    }

    /// Remainder of a row after the polynomial through its ten neighbours, and the sum of the squares of the
    /// neighbours' weights.
    fn left_by_polynomial(&self) -> (Expr, Expr) {
        let weights = weights(NOISE_REACH);
        let left = sum(weights.iter().map(|(ahead, weight)| weight * &rise(&self.of, 0, *ahead, self.angle)));
        (left, sum(weights.iter().map(|(_, weight)| weight.powi(2))))
    }

    /// The mean squared error that white noise of a unit variance makes in the difference, over even stamps of a unit period.
    pub fn amplification(reach: usize) -> f64 {
        per_sample(reach).iter().map(|weight| 2.0 * weight * weight).sum()
    }

    /// That which it makes in [`CentralDifference::truncation`].
    pub fn amplification_of_truncation(reach: usize) -> f64 {
        let (weights, better) = (per_sample(reach), per_sample(reach + 1));
        let weights = weights.into_iter().chain(std::iter::repeat(0.0));
        weights.zip(better).map(|(a, b)| 2.0 * (a - b) * (a - b)).sum()
    }

    /// The central difference that an expression is, whoever wrote it.
    pub fn recognised(expression: &Expr) -> Option<Self> {
        let mut node = expression.clone();
        loop {
            let form = [-1, 1].into_iter().flat_map(|sign| (0..=3).map(move |lag| sign * lag)).find_map(|lag| {
                let of = node.shifted(lag);
                let forms = REACHES.into_iter().flat_map(|reach| {
                    let with = |spacing, angle| Self { of: of.clone(), angle, reach, spacing };
                    [Spacing::Even, Spacing::Stamps].map(|spacing| [with(spacing, false), with(spacing, true)])
                });
                forms.flatten().find(|form| form.expression() == *expression)
            });
            if form.is_some() {
                return form;
            }
            // The differentiated expression is the first argument of the difference that is no weight.
            node = match node.node() {
                Node::Binary(_, a, b) => {
                    if speaks_of_columns(a) {
                        a.clone()
                    } else {
                        b.clone()
                    }
                }
                Node::Unary(_, a) | Node::Power(a, _) => a.clone(),
                Node::Number(_) | Node::Column { .. } | Node::Time { .. } => return None,
            };
        }
    }

    /// The slope to the row `ahead`.
    fn slope(&self, ahead: i32) -> Expr {
        let time = Expr::time();
        rise(&self.of, 0, ahead, self.angle) / (time.shifted(-ahead) - time)
    }
}

/// Weights of `x[k+j]`, j = 1 to m, over even stamps of a unit period; those of `x[k-j]` are the negatives.
fn per_sample(reach: usize) -> Vec<f64> {
    let even = EVEN[(reach - 1).min(EVEN.len() - 1)];
    (1..).zip(even).map(|(ahead, weight)| weight / f64::from(2 * ahead)).collect()
}

/// `(x[k+j] - x[k-j]) / (t[k+j] - t[k-j])`.
fn symmetric_slope(x: &Expr, ahead: i32, angle: bool) -> Expr {
    let time = Expr::time();
    rise(x, -ahead, ahead, angle) / (time.shifted(-ahead) - time.shifted(ahead))
}

/// `l_j` of the neighbours j = -m to m but 0: what they weigh in the value at row k of the polynomial through them.
fn weights(reach: usize) -> Vec<(i32, Expr)> {
    let (time, far) = (Expr::time(), reach as i32);
    let at = |ahead: i32| time.shifted(-ahead);
    let neighbours = || (-far..=far).filter(|&ahead| ahead != 0);
    let weight = |j: i32| {
        let others = neighbours().filter(|&i| i != j);
        let factors = others.map(|i| (at(i) - &time) / (at(i) - at(j)));
        factors.reduce(|product, factor| product * factor).unwrap_or(Expr::number(1.0))
    };
    neighbours().map(|j| (j, weight(j))).collect()
}

fn sum(terms: impl Iterator<Item = Expr>) -> Expr {
    terms.reduce(|sum, term| sum + term).unwrap_or(Expr::number(0.0))
}

fn speaks_of_columns(expression: &Expr) -> bool {
    !expression.columns().is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of an expression at row 10 of `f` over stamps.
    fn value(expression: &Expr, stamps: &[f64], f: impl Fn(f64) -> f64) -> f64 {
        let row = |lag: i32| (10 - lag) as usize;
        expression.value(|_, lag| f(stamps[row(lag)]), |lag| stamps[row(lag)])
    }

    fn stamps(jitter: f64) -> Vec<f64> {
        (0..21).map(|k| 0.1 * f64::from(k) + jitter * (f64::from(k * k) * 1.7).sin()).collect()
    }

    fn difference(reach: usize, spacing: Spacing) -> CentralDifference {
        CentralDifference { of: Expr::column("x"), angle: false, reach, spacing }
    }

    #[test]
    fn orders_are_exact_for_polynomials_of_their_degree() {
        for reach in REACHES {
            for (jitter, spacing) in [(0.0, Spacing::Even), (0.0, Spacing::Stamps), (0.03, Spacing::Stamps)] {
                let (stamps, form) = (stamps(jitter), difference(reach, spacing).expression());
                for degree in 1..=form_degree(reach) {
                    let slope = f64::from(degree) * stamps[10].powi(degree - 1);
                    let derivative = value(&form, &stamps, |t| t.powi(degree));
                    assert!(
                        (derivative / slope - 1.0).abs() < 1e-11,
                        "{reach} {spacing:?} {degree}: {derivative} {slope}"
                    );
                }
                let degree = form_degree(reach) + 1;
                let slope = f64::from(degree) * stamps[10].powi(degree - 1);
                assert!((value(&form, &stamps, |t| t.powi(degree)) / slope - 1.0).abs() > 1e-9);
            }
        }
    }

    fn form_degree(reach: usize) -> i32 {
        2 * reach as i32
    }

    #[test]
    fn truncation_and_noise_are_separated() {
        for (jitter, spacing) in [(0.0, Spacing::Even), (0.02, Spacing::Stamps)] {
            let stamps = stamps(jitter);
            for reach in REACHES {
                let form = difference(reach, spacing);
                let error = value(&form.expression(), &stamps, f64::sin) - stamps[10].cos();
                let estimate = value(&form.truncation(), &stamps, f64::sin);
                assert!((estimate / error - 1.0).abs() < 0.05, "{reach} {spacing:?}: {estimate} {error}");
            }
            // Of a smooth signal next to nothing is taken for noise; of a blip at the row itself, what the weights say.
            let form = difference(1, spacing);
            assert!(value(&form.noise(), &stamps, f64::sin).abs() < 1e-9);
            let blip = |t: f64| if t == stamps[10] { 1.0 } else { 0.0 };
            let noise = value(&form.noise(), &stamps, blip).abs() * 0.1 * 1.7057;
            assert!((noise - 1.0).abs() < 0.2, "{noise}");
        }
    }

    #[test]
    fn amplifications_are_sums_of_squared_weights() {
        let amplifications = REACHES.map(CentralDifference::amplification);
        let expected = [0.5, 130.0 / 144.0, 4214.0 / 3600.0];
        amplifications
            .iter()
            .zip(expected)
            .for_each(|(amplification, expected)| assert!((amplification - expected).abs() < 1e-12));
        assert!((CentralDifference::amplification_of_truncation(2) - 0.0233333).abs() < 1e-6);
    }

    #[test]
    fn differences_are_recognised_in_any_form() {
        let y = Expr::column("y").sin() * Expr::number(2.0) + Expr::column("x");
        for of in [Expr::column("x"), y] {
            for reach in REACHES {
                for spacing in [Spacing::Even, Spacing::Stamps] {
                    for angle in [false, true] {
                        let form = CentralDifference { of: of.clone(), angle, reach, spacing };
                        assert_eq!(CentralDifference::recognised(&form.expression()), Some(form));
                    }
                }
            }
        }
        let other = Expr::column("x") - Expr::column("x").shifted(1);
        assert_eq!(CentralDifference::recognised(&other), None);
    }
}
