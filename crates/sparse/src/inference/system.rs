//! Standard errors of a system of equations, from the statistics of its chunks.

use faer::{Mat, MatRef};
use fleetfoot_stats::{BatchMeans, Compressed};

use super::{Clusters, InferenceError, covariance::groups};
use crate::SparseError;
use fleetfoot_sums::system::SystemScan;

/// Clusters whose statistics are in memory at once.
const BATCH: usize = 16;

/// Standard errors (p x q; NaN outside the supports, and on a support whose columns the rows do not tell apart) of least-squares coefficients (p x q, raw units) of the q targets in a region, each on its support
/// (ascending): `c H^-1 (sum_g u_g u_g') H^-1`, H = X'X of the support and u_g the score `X_g'(y_g - X_g b)` of cluster g, less the mean score (Liang and Zeger 1986), with
/// `c = G/(G-1) (N-1)/(N-k)` (Cameron and Miller 2015, equation (11)).
///
/// With `constant` the first of the p columns is the function 1, else all are those of the scan. No row is read. The errors are conditional on the supports: that
/// they were chosen on the same rows is not in them.
///
/// # Errors
/// When the shapes disagree, a coefficient is not finite, or fewer than two clusters have rows.
pub fn system_errors(
    scan: &SystemScan,
    region: usize,
    constant: bool,
    coefficients: MatRef<'_, f64>,
    supports: &[Vec<usize>],
    clusters: Clusters,
) -> Result<Mat<f64>, InferenceError> {
    let total = scan.root(region).compressed(constant);
    let (p, q) = (total.columns(), total.targets());
    for (what, length, expected) in [
        ("the rows of the coefficients", coefficients.nrows(), p),
        ("the columns of the coefficients", coefficients.ncols(), q),
        ("the list of supports", supports.len(), q),
    ] {
        if length != expected {
            return Err(SparseError::Length { what, actual: length, expected }.into());
        }
    }
    if let Some(column) = (0..p).find(|&j| (0..q).any(|t| !coefficients[(j, t)].is_finite())) {
        return Err(InferenceError::NotFinite { column });
    }
    let scores = scores(scan, region, constant, coefficients, clusters);
    let count = scores.len();
    if count < 2 {
        return Err(InferenceError::TooFewClusters { clusters: count });
    }
    let mut errors = Mat::from_fn(p, q, |_, _| f64::NAN);
    for (t, support) in supports.iter().enumerate() {
        if let Some(&column) = support.iter().find(|&&column| column >= p) {
            return Err(InferenceError::NoSuchCoefficient { column, columns: p });
        }
        let selected = total.select(support);
        if !identified(&selected) {
            continue;
        }
        let mean: Vec<f64> =
            support.iter().map(|&j| scores.iter().map(|score| score[(j, t)]).sum::<f64>() / count as f64).collect();
        let mut squares = vec![0.0; support.len()];
        for score in &scores {
            let mut moved: Vec<f64> = support.iter().zip(&mean).map(|(&j, mean)| score[(j, t)] - mean).collect();
            inverse_times(selected.r.as_ref(), &mut moved);
            squares.iter_mut().zip(&moved).for_each(|(sum, value)| *sum += value * value);
        }
        let c = small_sample(count, total.rows, support.len());
        support.iter().zip(&squares).for_each(|(&j, square)| errors[(j, t)] = (c * square).sqrt());
    }
    Ok(errors)
}

/// The score `X'(y - X b)` (p x q) of every cluster that has rows, in order.
fn scores(
    scan: &SystemScan,
    region: usize,
    constant: bool,
    coefficients: MatRef<'_, f64>,
    clusters: Clusters,
) -> Vec<Mat<f64>> {
    let units = scan.units();
    let groups = groups(units.iter().map(|unit| (unit.episode, unit.rows)), clusters);
    let count = groups.last().map_or(0, |last| last + 1);
    let mut scores = Vec::with_capacity(count);
    for first in (0..count).step_by(BATCH) {
        let width = BATCH.min(count - first);
        let weights = Mat::from_fn(units.len(), width, |unit, b| f64::from(u8::from(groups[unit] == first + b)));
        for root in scan.roots(region, weights.as_ref()) {
            if root.rows > 0 {
                scores.push(score(&root.compressed(constant), coefficients));
            }
        }
    }
    scores
}

/// `R'(z - R b)`, which is `X'(y - X b)` of the rows behind.
fn score(problem: &Compressed, coefficients: MatRef<'_, f64>) -> Mat<f64> {
    let (p, q) = (problem.columns(), problem.targets());
    let mut score = Mat::zeros(p, q);
    for t in 0..q {
        let mut left = problem.z.col_as_slice(t).to_vec();
        for j in (0..p).filter(|&j| coefficients[(j, t)] != 0.0) {
            let column = &problem.r.col_as_slice(j)[..=j];
            left.iter_mut().zip(column).for_each(|(left, r)| *left -= coefficients[(j, t)] * r);
        }
        for j in 0..p {
            let column = &problem.r.col_as_slice(j)[..=j];
            score[(j, t)] = column.iter().zip(&left).map(|(r, left)| r * left).sum();
        }
    }
    score
}

/// Returns true if no column is a linear combination of others, up to rounding.
fn identified(compressed: &Compressed) -> bool {
    (0..compressed.columns()).all(|k| compressed.r[(k, k)].abs() > compressed.noise[k])
}

/// Rows that count as independent, the fewest of the targets, by the batch means of the residuals of coefficients (p x q) over the chunks of a region
/// ([`BatchMeans`]), whatever the scale of the weights; at least 1.
///
/// # Panics
/// When the shapes disagree.
pub fn system_effective_rows(scan: &SystemScan, region: usize, constant: bool, coefficients: MatRef<'_, f64>) -> f64 {
    let first = usize::from(constant);
    let total = scan.root(region).compressed(constant);
    let (p, q) = (total.columns(), total.targets());
    assert_eq!((coefficients.nrows(), coefficients.ncols()), (p, q), "p x q coefficients");
    let constants: Vec<f64> = (0..q).map(|t| if constant { coefficients[(0, t)] } else { 0.0 }).collect();
    // Weights of mean 1: their scale says nothing of the number of rows.
    let unit_weight = total.weight / total.rows as f64;
    let mut means = BatchMeans::new(q);
    for (unit, weight, errors) in scan.mean_errors(region, coefficients.subrows(first, p - first), &constants) {
        means.add(scan.units()[unit].episode, weight / unit_weight, &errors);
    }
    let errors: Vec<f64> = total.error(coefficients).iter().map(|error| error / unit_weight).collect();
    means.effective_weight(total.rows as f64, &errors).max(1.0)
}

/// `(R'R)^-1 x` in place.
fn inverse_times(r: MatRef<'_, f64>, x: &mut [f64]) {
    for k in 0..x.len() {
        let known: f64 = (0..k).map(|i| r[(i, k)] * x[i]).sum();
        x[k] = (x[k] - known) / r[(k, k)];
    }
    for k in (0..x.len()).rev() {
        let known: f64 = (k + 1..x.len()).map(|j| r[(k, j)] * x[j]).sum();
        x[k] = (x[k] - known) / r[(k, k)];
    }
}

/// `G/(G-1) (N-1)/(N-k)`; the second share is 1 where there are not more rows than coefficients.
fn small_sample(clusters: usize, rows: u64, k: usize) -> f64 {
    let (g, n) = (clusters as f64, rows as f64);
    let share = if rows > k as u64 { (n - 1.0) / (n - k as f64) } else { 1.0 };
    g / (g - 1.0) * share
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource, Silent};
    use fleetfoot_library::Expr;

    use super::*;
    use fleetfoot_sums::system::{System, SystemPlan};

    /// Two episodes of a noisy line, in chunks of 50 rows.
    fn scan() -> (SystemScan, Vec<Vec<[f64; 3]>>) {
        let noise = |k: u64| (fleetfoot_data::mix(k) >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        let rows: Vec<Vec<[f64; 3]>> = (0..2)
            .map(|e: u64| {
                (0..170)
                    .map(|i: u64| {
                        let x = (0.1 * i as f64 + e as f64).sin();
                        [x, 1.0 + 2.0 * x + noise(1000 * e + i), x * x - 3.0 * x + 0.3 * noise(7777 + 1000 * e + i)]
                    })
                    .collect()
            })
            .collect();
        let columns = ["x", "y", "z"].map(Column::float).to_vec();
        let mut source = MemorySource::new(columns);
        for (e, rows) in rows.iter().enumerate() {
            let values = (0..3).map(|c| rows.iter().map(|row| row[c]).collect()).collect();
            source.push_uniform(format!("e{e}"), 0.01, values);
        }
        let x = Expr::column("x");
        let system = System::new(vec![x.clone(), x.powi(2)], vec![Expr::column("y"), Expr::column("z")]);
        (SystemPlan::new(system, Some(50), &source).unwrap().scan(&source, &Silent).unwrap(), rows)
    }

    #[test]
    fn errors_match_rows() {
        let (scan, rows) = scan();
        let problem = scan.root(0).compressed(true);
        let supports = vec![vec![0, 1], vec![1, 2]];
        let mut coefficients = Mat::zeros(3, 2);
        for (t, support) in supports.iter().enumerate() {
            let selected = problem.select(support);
            let mut b: Vec<f64> = selected.z.col_as_slice(t).to_vec();
            for k in (0..2).rev() {
                let known: f64 = (k + 1..2).map(|j| selected.r[(k, j)] * b[j]).sum();
                b[k] = (b[k] - known) / selected.r[(k, k)];
            }
            support.iter().zip(&b).for_each(|(&j, &b)| coefficients[(j, t)] = b);
        }
        let errors = system_errors(&scan, 0, true, coefficients.as_ref(), &supports, Clusters::Chunks).unwrap();
        for (t, support) in supports.iter().enumerate() {
            let x = |row: &[f64; 3], j: usize| [1.0, row[0], row[0] * row[0]][support[j]];
            let (mut h, mut meat) = ([[0.0; 2]; 2], [[0.0; 2]; 2]);
            for chunk in rows.iter().flat_map(|rows| rows.chunks(50)) {
                let mut u = [0.0; 2];
                for row in chunk {
                    let e = row[1 + t] - (0..2).map(|j| x(row, j) * coefficients[(support[j], t)]).sum::<f64>();
                    for i in 0..2 {
                        u[i] += x(row, i) * e;
                        (0..2).for_each(|j| h[i][j] += x(row, i) * x(row, j));
                    }
                }
                (0..2).for_each(|i| (0..2).for_each(|j| meat[i][j] += u[i] * u[j]));
            }
            let det = h[0][0] * h[1][1] - h[0][1] * h[1][0];
            let inverse = [[h[1][1] / det, -h[0][1] / det], [-h[1][0] / det, h[0][0] / det]];
            let c = 8.0 / 7.0 * 339.0 / 338.0;
            for k in 0..2 {
                let variance: f64 = (0..2)
                    .flat_map(|i| (0..2).map(move |j| (i, j)))
                    .map(|(i, j)| inverse[k][i] * meat[i][j] * inverse[j][k])
                    .sum();
                let expected = (c * variance).sqrt();
                let error = errors[(support[k], t)];
                assert!((error / expected - 1.0).abs() < 1e-9, "{error} {expected}");
            }
        }
        assert!(errors[(2, 0)].is_nan() && errors[(0, 1)].is_nan());
        // Noise that is new at every row, with chunk means to match: about every row counts.
        let independent = system_effective_rows(&scan, 0, true, coefficients.as_ref());
        assert!((50.0..=340.0).contains(&independent), "{independent}");
        let episodes = system_errors(&scan, 0, true, coefficients.as_ref(), &supports, Clusters::Episodes).unwrap();
        assert!(episodes[(0, 0)] > 0.0 && episodes[(0, 0)] != errors[(0, 0)]);
    }

    #[test]
    fn wrong_supports_are_refused() {
        let (scan, _) = scan();
        let b = Mat::<f64>::zeros(3, 2);
        let wrong = system_errors(&scan, 0, true, b.as_ref(), &[vec![0]], Clusters::Chunks).unwrap_err();
        assert!(matches!(wrong, InferenceError::Problem(_)), "{wrong}");
        let beyond = system_errors(&scan, 0, true, b.as_ref(), &[vec![9], vec![]], Clusters::Chunks).unwrap_err();
        assert!(matches!(beyond, InferenceError::NoSuchCoefficient { column: 9, .. }), "{beyond}");
        let twice = system_errors(&scan, 0, true, b.as_ref(), &[vec![0, 0], vec![1]], Clusters::Chunks).unwrap();
        assert!(twice[(0, 0)].is_nan() && twice[(1, 1)] > 0.0);
    }
}
