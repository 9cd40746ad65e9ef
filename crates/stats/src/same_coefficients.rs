//! Test that two sets of rows have the same least-squares coefficients, from the sufficient statistics of each.
//!
//! The rows of a set obey `y = B'[1 x] + e` with normal errors, of one covariance in both sets up to a factor. The
//! likelihood ratio of two fits against one joint fit is a power of Wilks's statistic `|E_a + E_b| / |E_joint|`. E are
//! the squares and products of the residuals (q x q). `E_joint - E_a - E_b` is the growth of the error by which cells
//! are joined. For one target this is the test of Chow (*Econometrica* 28, 1960). The distribution is Rao's F
//! approximation (C. R. Rao, *Linear Statistical Inference and its Applications*, section 8c.5), which is exact for one
//! or two targets.

use fleetfoot_data::{packed, packed_row};

use crate::{Gram, PivotedCholesky, Preconditioner, f_tail, square_root::noise_level};

/// Residuals of the targets after the least squares of a set of rows, as sums of squares and products.
#[derive(Debug, Clone, PartialEq)]
pub struct Leftover {
    /// Sum of the weights.
    weight: f64,
    /// Numbers that are fitted for every target: the rank of the regressors, and the constant.
    numbers: usize,
    /// Squares and products of the residuals, lower triangle packed by rows, in the preconditioner's units: a ratio of determinants has none.
    residual: Vec<f64>,
    /// Part of each target's sum of squares that is indistinguishable from rounding (q).
    rounding: Vec<f64>,
}

/// Likelihood-ratio test of two fits against one joint fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LikelihoodRatio {
    /// Twice the logarithm of the ratio: `n ln(|E_joint| / |E_a + E_b|)`, n the rows that count as independent; infinite where two fits leave nothing and one
    /// does.
    pub statistic: f64,
    /// Degrees of freedom of the statistic, which is a chi-squared number for many rows. It is the number of
    /// coefficients of two fits less those of one, over all targets.
    pub freedom: usize,
    /// Rao's F, and its degrees of freedom.
    pub f: f64,
    /// Of the numerator and the denominator.
    pub f_freedom: [f64; 2],
    /// The probability of such a ratio or a larger one where both sets have the same coefficients.
    pub p: f64,
}

impl Preconditioner {
    /// Residual squares and products of the targets after the least squares of a Gram matrix. Their diagonal is
    /// [`Preconditioner::residual`], up to the targets' units.
    ///
    /// # Panics
    /// When `gram` has another dimension.
    pub fn leftover(&self, gram: &Gram) -> Leftover {
        let (p, q) = (self.regressors(), self.targets());
        let (cholesky, _) = self.pivoted(gram);
        let rank = cholesky.rank();
        let explained = |t: usize| &cholesky.factor.column(p + t)[..rank];
        let mut residual = Vec::with_capacity(packed_row(q));
        for t in 0..q {
            for s in 0..t {
                let both: f64 = explained(t).iter().zip(explained(s)).map(|(a, b)| a * b).sum();
                residual.push(gram.get(p + t, p + s) - both);
            }
            residual.push(cholesky.left[p + t].max(0.0));
        }
        let noise = noise_level(p);
        let rounding = (0..q).map(|t| {
            // Remainder of the Gram's entry, and of the numbers that the entry was made of.
            let (column, diagonal) = (self.column(p + t), gram.get(p + t, p + t));
            let size = column[p + t];
            let predicted: f64 = column[..p].iter().enumerate().map(|(k, b)| b * b * gram.get(k, k)).sum();
            let square = predicted / (size * size) + diagonal + gram.weight * (self.centre()[p + t] / size).powi(2);
            (8.0 * (p + 1) as f64 * f64::EPSILON * diagonal).max(noise * noise * square)
        });
        let rounding = rounding.collect();
        Leftover { weight: gram.weight, numbers: rank + 1, residual, rounding }
    }
}

impl Leftover {
    /// The covariance of the residuals (divisor: the weight), packed lower triangle by rows, in raw units; `None` where one of them is no more than rounding, or there are not more rows than numbers.
    pub fn covariance(&self, preconditioner: &Preconditioner) -> Option<Vec<f64>> {
        let (p, q) = (preconditioner.regressors(), self.rounding.len());
        let large = |t: usize| self.residual[packed(t, t)] > self.rounding[t].max(f64::MIN_POSITIVE);
        if self.weight <= self.numbers as f64 || !(0..q).all(large) {
            return None;
        }
        let size = |t: usize| preconditioner.column(p + t)[p + t];
        let entry = |(s, t): (usize, usize)| self.residual[packed(s, t)] * size(s) * size(t) / self.weight;
        Some((0..q).flat_map(|s| (0..=s).map(move |t| (s, t))).map(entry).collect())
    }

    /// Ratio of these errors' variances to those of others: the geometric mean over the targets with residuals in both.
    /// 1 if no target has.
    fn noise_over(&self, other: &Self) -> f64 {
        let free = |group: &Self| group.weight - group.numbers as f64;
        if free(self) <= 0.0 || free(other) <= 0.0 {
            return 1.0;
        }
        let known = (0..self.rounding.len()).filter_map(|t| {
            let left = |group: &Self| {
                Some(group.residual[packed(t, t)]).filter(|left| *left > group.rounding[t].max(f64::MIN_POSITIVE))
            };
            Some(left(self)?.ln() - left(other)?.ln())
        });
        let logarithms: Vec<f64> = known.collect();
        if logarithms.is_empty() {
            return 1.0;
        }
        (logarithms.iter().sum::<f64>() / logarithms.len() as f64).exp() * free(other) / free(self)
    }

    /// As if rows had other weights, all by one factor.
    fn scaled(&self, factor: f64) -> Self {
        let of = |values: &[f64]| values.iter().map(|value| factor * value).collect();
        Self { residual: of(&self.residual), rounding: of(&self.rounding), ..self.clone() }
    }
}

/// Tests two sets of rows for equal coefficients, from their Gram matrices and residuals. `independent` is the share of
/// their rows that counts as independent ([`crate::BatchMeans`]; 1: all of them).
///
/// The errors of one set may be larger than those of the other: its rows then weigh less, as in weighted least squares.
/// With equal weights the test at a level of 5 would reject 30 of 100 cases, for a set of a quarter of the rows and
/// twice the noise.
///
/// `None` if there is nothing to tell apart: fewer rows than coefficients of the fits, or as many coefficients in one
/// fit as in two.
pub fn same_coefficients(
    preconditioner: &Preconditioner,
    grams: [&Gram; 2],
    parts: [&Leftover; 2],
    independent: f64,
) -> Option<LikelihoodRatio> {
    let factor = parts[0].noise_over(parts[1]);
    let mut second = grams[1].clone();
    second.weight *= factor;
    second.scatter.iter_mut().for_each(|entry| *entry *= factor);
    let mut joint = grams[0].clone();
    joint.merge(&second);
    let rows = independent * (parts[0].weight + parts[1].weight);
    ratio([parts[0], &parts[1].scaled(factor)], &preconditioner.leftover(&joint), rows)
}

/// The ratio of two fits and one, of errors that are equally large; `rows` count as independent.
fn ratio(parts: [&Leftover; 2], joint: &Leftover, rows: f64) -> Option<LikelihoodRatio> {
    let more = (parts[0].numbers + parts[1].numbers).checked_sub(joint.numbers).filter(|&more| more > 0)?;
    let targets = joint.rounding.len();
    let floor = |t: usize| joint.rounding[t].max(f64::MIN_POSITIVE);
    let one = PivotedCholesky::new(targets, targets, |i, j| joint.residual[packed(i, j)], &floors(targets, floor));
    // Targets that one fit leaves nothing of, or that follow from the others, tell nothing.
    let columns = &one.order;
    let (q, h) = (columns.len() as f64, more as f64);
    let errors = rows - (parts[0].numbers + parts[1].numbers) as f64;
    let middle = errors - 0.5 * (q - h + 1.0);
    let root = if q * q + h * h > 5.0 { ((q * q * h * h - 4.0) / (q * q + h * h - 5.0)).sqrt() } else { 1.0 };
    let f_freedom = [q * h, middle * root - 0.5 * (q * h - 2.0)];
    let freedom = columns.len() * more;
    if columns.is_empty() {
        return (errors > 0.0).then_some(LikelihoodRatio { statistic: 0.0, freedom, f: 0.0, f_freedom, p: 1.0 });
    }
    if errors < q || f_freedom[1] <= 0.0 {
        return None;
    }
    let both = |i: usize, j: usize| {
        let at = packed(columns[i], columns[j]);
        parts[0].residual[at] + parts[1].residual[at]
    };
    let two = PivotedCholesky::new(columns.len(), columns.len(), both, &floors(columns.len(), |t| floor(columns[t])));
    // Natural logarithm of |E_joint| / |E_a + E_b|; what rounding leaves below 1 is 1.
    let growth = if two.rank() < columns.len() {
        f64::INFINITY
    } else {
        (log_determinant(&one) - log_determinant(&two)).max(0.0)
    };
    // (1 - L^(1/t)) / L^(1/t) with L = exp(-growth).
    let f = (growth / root).exp_m1() * f_freedom[1] / f_freedom[0];
    Some(LikelihoodRatio { statistic: rows * growth, freedom, f, f_freedom, p: f_tail(f, f_freedom) })
}

fn floors(count: usize, of: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..count).map(of).collect()
}

fn log_determinant(cholesky: &PivotedCholesky) -> f64 {
    cholesky.order.iter().enumerate().map(|(row, &column)| 2.0 * cholesky.factor.column(column)[row].ln()).sum()
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use fleetfoot_data::mix;

    use super::*;

    /// A normal number (Box and Muller).
    fn normal(seed: u64, at: u64) -> f64 {
        let uniform = |key: u64| ((mix(mix(seed).wrapping_add(key)) >> 11) as f64 + 0.5) * 2f64.powi(-53);
        (-2.0 * uniform(2 * at).ln()).sqrt() * (2.0 * std::f64::consts::PI * uniform(2 * at + 1)).cos()
    }

    /// Rows of two regressors far from the origin and two targets with correlated noise; `differs` is added to a coefficient of the second target.
    fn rows(seed: u64, count: usize, differs: f64) -> Vec<[f64; 4]> {
        (0..count as u64)
            .map(|i| {
                let (x, z) =
                    (30.0 + normal(seed, 10 * i), -7.0 + 0.8 * normal(seed, 10 * i + 1) + 0.3 * normal(seed, 10 * i));
                let (a, b) = (normal(seed, 10 * i + 2), normal(seed, 10 * i + 3));
                [x, z, 2.0 - x + 0.5 * z + 0.4 * a, 1.0 + 0.3 * x + (0.1 + differs) * (z + 7.0) + 0.3 * a + 0.2 * b]
            })
            .collect()
    }

    fn gram(preconditioner: &Preconditioner, rows: &[[f64; 4]]) -> Gram {
        let mut z = Mat::from_fn(rows.len(), 4, |i, j| rows[i][j]);
        preconditioner.apply(z.as_mut());
        Gram::of_rows(z.as_ref(), None)
    }

    fn tested(a: &[[f64; 4]], b: &[[f64; 4]], independent: f64) -> Option<LikelihoodRatio> {
        let all: Vec<[f64; 4]> = a.iter().chain(b).copied().collect();
        let pilot = Mat::from_fn(all.len(), 4, |i, j| all[i][j]);
        let preconditioner = Preconditioner::from_pilot(pilot.as_ref(), 2);
        let grams = [a, b].map(|rows| gram(&preconditioner, rows));
        let groups = [0, 1].map(|at| preconditioner.leftover(&grams[at]));
        same_coefficients(&preconditioner, [&grams[0], &grams[1]], [&groups[0], &groups[1]], independent)
    }

    /// Squares and products of the residuals of weighted rows, by Gauss and Jordan on the normal equations about the rows' means.
    fn squares(rows: &[(f64, [f64; 4])]) -> [[f64; 2]; 2] {
        let n: f64 = rows.iter().map(|(w, _)| w).sum();
        let mean = [0, 1, 2, 3].map(|j| rows.iter().map(|(w, row)| w * row[j]).sum::<f64>() / n);
        let s =
            |i: usize, j: usize| rows.iter().map(|(w, row)| w * (row[i] - mean[i]) * (row[j] - mean[j])).sum::<f64>();
        let size = s(0, 0) * s(1, 1) - s(0, 1) * s(0, 1);
        let slopes =
            |t: usize| [(s(1, 1) * s(0, t) - s(0, 1) * s(1, t)) / size, (s(0, 0) * s(1, t) - s(0, 1) * s(0, t)) / size];
        let of = [slopes(2), slopes(3)];
        let left = |row: &[f64; 4], t: usize| {
            row[2 + t] - mean[2 + t] - of[t][0] * (row[0] - mean[0]) - of[t][1] * (row[1] - mean[1])
        };
        [0, 1].map(|i| [0, 1].map(|j| rows.iter().map(|(w, row)| w * left(row, i) * left(row, j)).sum()))
    }

    /// The logarithm of the determinants' ratio: the second set weighs as much less as it is noisier.
    fn dense(a: &[[f64; 4]], b: &[[f64; 4]]) -> f64 {
        let weighted = |rows: &[[f64; 4]], w: f64| rows.iter().map(|&row| (w, row)).collect::<Vec<_>>();
        let [one, two] = [a, b].map(|rows| squares(&weighted(rows, 1.0)));
        let variance = |e: [[f64; 2]; 2], n: usize| (e[0][0] * e[1][1]).sqrt() / (n as f64 - 3.0);
        let factor = variance(one, a.len()) / variance(two, b.len());
        let both = [weighted(a, 1.0), weighted(b, factor)];
        let joint = squares(&both.concat());
        let sum = [0, 1].map(|i| [0, 1].map(|j| one[i][j] + factor * two[i][j]));
        let determinant = |e: [[f64; 2]; 2]| e[0][0] * e[1][1] - e[0][1] * e[1][0];
        (determinant(joint) / determinant(sum)).ln()
    }

    #[test]
    fn ratio_matches_dense_fits() {
        for (seed, differs) in [(1, 0.0), (2, 0.05), (3, 2.0)] {
            let (a, b) = (rows(seed, 80, 0.0), rows(seed + 100, 50, differs));
            let test = tested(&a, &b, 1.0).unwrap();
            let exact = 130.0 * dense(&a, &b);
            // Centred sums of a hundred rows keep ten digits and more.
            assert!((test.statistic - exact).abs() < 1e-8 * exact.max(1.0), "{seed}: {test:?} {exact}");
            assert_eq!((test.freedom, test.f_freedom[0]), (6, 6.0));
            // Of two targets the F is exact (Rao): (1 - sqrt(L)) / sqrt(L) (errors - 1) / 3.
            let f = ((exact / 260.0).exp() - 1.0) * (124.0 - 1.0) / 3.0;
            assert!((test.f - f).abs() < 1e-7 * f.max(1.0) && (test.f_freedom[1] - 246.0).abs() < 1e-9, "{test:?} {f}");
            assert!((test.p - f_tail(f, [6.0, 246.0])).abs() < 1e-7);
        }
    }

    #[test]
    fn under_equal_coefficients_p_is_uniform() {
        let count = 1000;
        let mut p: Vec<f64> = (0..count)
            .map(|seed| tested(&rows(seed, 25, 0.0), &rows(seed + 1_000_000, 60, 0.0), 1.0).unwrap().p)
            .collect();
        p.sort_by(f64::total_cmp);
        let n = count as f64;
        let distance = p.iter().enumerate().map(|(i, p)| (p - i as f64 / n).abs().max(((i + 1) as f64 / n - p).abs()));
        // The F is exact but for the weights, which 25 rows tell to a quarter: Kolmogorov's distance exceeds 1.95 / sqrt(n) once in a thousand, and these seeds are fixed.
        let distance = distance.fold(0.0, f64::max);
        assert!(distance < 1.95 / n.sqrt(), "{distance}");
    }

    #[test]
    fn unequal_noise_does_not_reject_equal_coefficients() {
        // A quarter of the rows with three times the noise.
        let louder = |seed: u64| -> Vec<[f64; 4]> {
            let mean = |[x, z, ..]: [f64; 4]| [2.0 - x + 0.5 * z, 1.0 + 0.3 * x + 0.1 * (z + 7.0)];
            let of = |row: [f64; 4]| {
                let [y, w] = mean(row);
                [row[0], row[1], y + 3.0 * (row[2] - y), w + 3.0 * (row[3] - w)]
            };
            rows(seed, 60, 0.0).into_iter().map(of).collect()
        };
        for order in [false, true] {
            let p = |seed: u64| {
                let (loud, quiet) = (louder(seed), rows(seed + 1_000_000, 240, 0.0));
                let test = if order { tested(&loud, &quiet, 1.0) } else { tested(&quiet, &loud, 1.0) };
                test.unwrap().p
            };
            let below = (0..1000).filter(|&seed| p(seed) < 0.05).count();
            // Of 1000 tests 50 by chance, give or take 7; the weights are found from the rows, which costs a few.
            assert!((25..90).contains(&below), "{below}");
        }
    }

    #[test]
    fn different_coefficients_are_detected() {
        let p_of = |seed: u64| tested(&rows(seed, 200, 0.0), &rows(seed + 1_000_000, 200, 0.3), 1.0).unwrap().p;
        // A coefficient that is off by 0.3 where its error is about 0.03.
        assert!((0..100).all(|seed| p_of(seed) < 1e-6));
    }

    #[test]
    fn p_grows_with_fewer_independent_rows() {
        let (a, b) = (rows(5, 200, 0.0), rows(6, 200, 0.1));
        let p = |independent: f64| tested(&a, &b, independent).map(|test| test.p);
        assert!(p(1.0).unwrap() < p(0.2).unwrap() && p(0.2).unwrap() < p(0.05).unwrap());
        assert_eq!(p(0.015), None, "six rows for six numbers");
    }

    #[test]
    fn exact_fits_are_equal_or_different() {
        let exact = |seed: u64, count: usize, more: f64| -> Vec<[f64; 4]> {
            rows(seed, count, 0.0)
                .into_iter()
                .map(|[x, z, ..]| [x, z, 2.0 - x + 0.5 * z, 1.0 + (0.3 + more) * x])
                .collect()
        };
        assert_eq!(tested(&exact(1, 60, 0.0), &exact(2, 60, 0.0), 1.0).unwrap().p, 1.0);
        let other = tested(&exact(1, 60, 0.0), &exact(2, 60, 0.5), 1.0).unwrap();
        assert_eq!((other.statistic, other.p), (f64::INFINITY, 0.0));
    }

    #[test]
    fn rows_that_see_less_have_fewer_numbers() {
        // The second regressor does not move in one of the sets: it tells of one slope only.
        let still: Vec<[f64; 4]> = rows(1, 60, 0.0).into_iter().map(|[x, _, y, w]| [x, -7.0, y, w]).collect();
        let test = tested(&still, &rows(2, 60, 0.0), 1.0).unwrap();
        assert_eq!(test.freedom, 4);
        assert_eq!(tested(&still[..1], &rows(2, 60, 0.0), 1.0).map(|test| test.freedom), Some(2));
    }
}
