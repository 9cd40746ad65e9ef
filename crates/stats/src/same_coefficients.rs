//! Whether the least squares of two sets of rows are the same, from the sufficient statistics of each.
//!
//! The rows of a set obey `y = B'[1 x] + e` with normal errors of one covariance in both sets. The likelihood ratio of two fits against one that serves both is
//! a power of Wilks's statistic `|E_a + E_b| / |E_joint|`, with E the squares and products of the residuals (q x q); `E_joint - E_a - E_b` is the growth of the
//! error by which cells are joined, and of one target this is the test of Chow (*Econometrica* 28, 1960). Its distribution is told by Rao's F approximation (C. R. Rao, *Linear Statistical Inference and its Applications*, section 8c.5), which is exact for one or two
//! targets.

use fleetfoot_data::{packed, packed_row};

use crate::{Gram, PivotedCholesky, Preconditioner, f_tail, square_root::noise_level};

/// What the least squares of some rows leave of the targets.
#[derive(Debug, Clone, PartialEq)]
pub struct Leftover {
    /// Sum of the weights.
    weight: f64,
    /// Numbers that are fitted for every target: the rank of the regressors, and the constant.
    numbers: usize,
    /// Squares and products of the residuals, lower triangle packed by rows, in the preconditioner's units: a ratio of determinants has none.
    residual: Vec<f64>,
    /// What of a target's square is no more than rounding.
    rounding: Vec<f64>,
}

/// What the likelihood says of one fit in the place of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LikelihoodRatio {
    /// Twice the logarithm of the ratio: `n ln(|E_joint| / |E_a + E_b|)`, n the rows that count as independent; infinite where two fits leave nothing and one
    /// does.
    pub statistic: f64,
    /// Numbers that two fits have more than one, of all targets: the degrees of freedom of the statistic, which is a chi-squared number where rows are many.
    pub freedom: usize,
    /// Rao's F, and its degrees of freedom.
    pub f: f64,
    /// Of the numerator and the denominator.
    pub f_freedom: [f64; 2],
    /// The probability of such a ratio or a larger one where both sets have the same coefficients.
    pub p: f64,
}

impl Preconditioner {
    /// What the least squares of the rows of a Gram matrix leave of the targets. Its diagonal is [`Preconditioner::residual`], up to the targets' units.
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
            // What is left of the Gram's own entry, and of the numbers that the entry was made of.
            let (column, own) = (self.column(p + t), gram.get(p + t, p + t));
            let size = column[p + t];
            let predicted: f64 = column[..p].iter().enumerate().map(|(k, b)| b * b * gram.get(k, k)).sum();
            let square = predicted / (size * size) + own + gram.weight * (self.centre()[p + t] / size).powi(2);
            (8.0 * (p + 1) as f64 * f64::EPSILON * own).max(noise * noise * square)
        });
        let rounding = rounding.collect();
        Leftover { weight: gram.weight, numbers: rank + 1, residual, rounding }
    }
}

/// Whether two sets of rows have the same coefficients, from what is left of each and of both together; `independent` is the share of their rows that counts as
/// independent ([`crate::BatchMeans`]; 1: all of them).
///
/// `None` where there is nothing to tell apart: fewer rows than the fits have numbers, or regressors that one fit and two have the same numbers of.
pub fn same_coefficients(parts: [&Leftover; 2], joint: &Leftover, independent: f64) -> Option<LikelihoodRatio> {
    let more = (parts[0].numbers + parts[1].numbers).checked_sub(joint.numbers).filter(|&more| more > 0)?;
    let targets = joint.rounding.len();
    let floor = |t: usize| joint.rounding[t].max(f64::MIN_POSITIVE);
    let one = PivotedCholesky::new(targets, targets, |i, j| joint.residual[packed(i, j)], &floors(targets, floor));
    // Targets that one fit leaves nothing of, or that follow from the others, tell nothing.
    let told = &one.order;
    let (q, h) = (told.len() as f64, more as f64);
    let rows = independent * joint.weight;
    let errors = rows - (parts[0].numbers + parts[1].numbers) as f64;
    let middle = errors - 0.5 * (q - h + 1.0);
    let root = if q * q + h * h > 5.0 { ((q * q * h * h - 4.0) / (q * q + h * h - 5.0)).sqrt() } else { 1.0 };
    let f_freedom = [q * h, middle * root - 0.5 * (q * h - 2.0)];
    let freedom = told.len() * more;
    if told.is_empty() {
        return (errors > 0.0).then_some(LikelihoodRatio { statistic: 0.0, freedom, f: 0.0, f_freedom, p: 1.0 });
    }
    if errors < q || f_freedom[1] <= 0.0 {
        return None;
    }
    let both = |i: usize, j: usize| {
        let at = packed(told[i], told[j]);
        parts[0].residual[at] + parts[1].residual[at]
    };
    let two = PivotedCholesky::new(told.len(), told.len(), both, &floors(told.len(), |t| floor(told[t])));
    // Natural logarithm of |E_joint| / |E_a + E_b|; what rounding leaves below 1 is 1.
    let growth =
        if two.rank() < told.len() { f64::INFINITY } else { (log_determinant(&one) - log_determinant(&two)).max(0.0) };
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
        let mut joint = grams[0].clone();
        joint.merge(&grams[1]);
        let [a, b] = grams.map(|gram| preconditioner.leftover(&gram));
        same_coefficients([&a, &b], &preconditioner.leftover(&joint), independent)
    }

    /// Determinant of the residuals' squares by Gauss and Jordan on the rows' normal equations, about the rows' means.
    fn dense(sets: &[&[[f64; 4]]]) -> f64 {
        let mut e = [[0.0; 2]; 2];
        for rows in sets {
            let n = rows.len() as f64;
            let mean = [0, 1, 2, 3].map(|j| rows.iter().map(|row| row[j]).sum::<f64>() / n);
            let s = |i: usize, j: usize| rows.iter().map(|row| (row[i] - mean[i]) * (row[j] - mean[j])).sum::<f64>();
            let size = s(0, 0) * s(1, 1) - s(0, 1) * s(0, 1);
            let slopes = |t: usize| {
                [(s(1, 1) * s(0, t) - s(0, 1) * s(1, t)) / size, (s(0, 0) * s(1, t) - s(0, 1) * s(0, t)) / size]
            };
            let of = [slopes(2), slopes(3)];
            let left = |row: &[f64; 4], t: usize| {
                row[2 + t] - mean[2 + t] - of[t][0] * (row[0] - mean[0]) - of[t][1] * (row[1] - mean[1])
            };
            for row in *rows {
                (0..2).for_each(|i| (0..2).for_each(|j| e[i][j] += left(row, i) * left(row, j)));
            }
        }
        e[0][0] * e[1][1] - e[0][1] * e[1][0]
    }

    #[test]
    fn the_ratio_is_that_of_dense_fits() {
        for (seed, differs) in [(1, 0.0), (2, 0.05), (3, 2.0)] {
            let (a, b) = (rows(seed, 80, 0.0), rows(seed + 100, 50, differs));
            let found = tested(&a, &b, 1.0).unwrap();
            let both: Vec<[f64; 4]> = a.iter().chain(&b).copied().collect();
            let exact = 130.0 * (dense(&[&both]) / dense(&[&a, &b])).ln();
            // Centred sums of a hundred rows keep ten digits and more.
            assert!((found.statistic - exact).abs() < 1e-8 * exact.max(1.0), "{seed}: {found:?} {exact}");
            assert_eq!((found.freedom, found.f_freedom[0]), (6, 6.0));
            // Of two targets the F is exact (Rao): (1 - sqrt(L)) / sqrt(L) (errors - 1) / 3.
            let f = ((exact / 260.0).exp() - 1.0) * (124.0 - 1.0) / 3.0;
            assert!(
                (found.f - f).abs() < 1e-7 * f.max(1.0) && (found.f_freedom[1] - 246.0).abs() < 1e-9,
                "{found:?} {f}"
            );
            assert!((found.p - f_tail(f, [6.0, 246.0])).abs() < 1e-7);
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
        // The F is exact here: Kolmogorov's distance exceeds 1.95 / sqrt(n) once in a thousand, and these seeds are fixed.
        let distance = distance.fold(0.0, f64::max);
        assert!(distance < 1.95 / n.sqrt(), "{distance}");
    }

    #[test]
    fn other_coefficients_are_found() {
        let found = |seed: u64| tested(&rows(seed, 200, 0.0), &rows(seed + 1_000_000, 200, 0.3), 1.0).unwrap().p;
        // A coefficient that is off by 0.3 where its error is about 0.03.
        assert!((0..100).all(|seed| found(seed) < 1e-6));
    }

    #[test]
    fn fewer_independent_rows_say_less_and_too_few_nothing() {
        let (a, b) = (rows(5, 200, 0.0), rows(6, 200, 0.1));
        let p = |independent: f64| tested(&a, &b, independent).map(|found| found.p);
        assert!(p(1.0).unwrap() < p(0.2).unwrap() && p(0.2).unwrap() < p(0.05).unwrap());
        assert_eq!(p(0.015), None, "six rows for six numbers");
    }

    #[test]
    fn what_fits_exactly_is_the_same_or_it_is_not() {
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
        let found = tested(&still, &rows(2, 60, 0.0), 1.0).unwrap();
        assert_eq!(found.freedom, 4);
        assert_eq!(tested(&still[..1], &rows(2, 60, 0.0), 1.0).map(|found| found.freedom), Some(2));
    }
}
