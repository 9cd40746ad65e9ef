//! Covariance of parameters under residuals that are correlated over several rows (Morelli and Klein, Accuracy of
//! aerodynamic model parameters estimated from flight test data, 1997).
//!
//! With the reduced derivatives S of all rows, in units of the noise, the estimate errs by `(S'S)^-1 S' v`, whatever
//! the noise v is. So its covariance is
//!
//! ```text
//! (S'S)^-1 (sum_i sum_j S_i' R(i - j) S_j) (S'S)^-1
//! ```
//!
//! with R(k) the covariance of residuals k rows apart, which is estimated from the residuals themselves.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::Mat;

use super::beginning::Residuals;

/// Residuals and reduced derivatives of a segment.
pub(super) struct Series {
    pub(super) outputs: usize,
    pub(super) residuals: Residuals,
}

/// Lags at most.
const MOST_LAGS: usize = 5_000;
/// Lags that must look white behind the last one that does not.
const WHITE_LAGS: usize = 20;

/// Correlation of the residuals.
pub(super) struct Coloured {
    /// The middle of the covariance (p x p).
    pub(super) middle: Mat<f64>,
    /// Rows over which residuals are correlated.
    pub(super) memory: usize,
    /// True if they are correlated up to the longest lag that is tried, or nearly.
    pub(super) lasting: bool,
    /// Mean products of the residuals of a row, in units of the noise (outputs x outputs).
    pub(super) of_a_row: Mat<f64>,
}

pub(super) fn coloured(series: &[Series], parameters: usize) -> Coloured {
    let m = series[0].outputs;
    let longest = series.iter().map(|segment| segment.residuals.values.len() / m).max().unwrap_or(1);
    let most = (longest / 5).clamp(1, MOST_LAGS).min(longest - 1);
    let covariances = covariances(series, m, most);
    let rows = series.iter().map(|segment| segment.residuals.values.len() / m).sum::<usize>();
    let memory = memory(&covariances, m, rows.saturating_sub(parameters).max(1));
    let p = series[0].residuals.by_parameters.ncols();
    let mut sum = Mat::<f64>::zeros(p, p);
    series.iter().for_each(|segment| add(&mut sum, segment, &covariances[..=memory]));
    Coloured {
        middle: Mat::from_fn(p, p, |a, b| 0.5 * (sum[(a, b)] + sum[(b, a)])),
        memory,
        lasting: memory > 0 && memory + WHITE_LAGS.min(most / 2) > most,
        of_a_row: Mat::from_fn(m, m, |a, b| covariances[0][a.min(b) * m + a.max(b)]),
    }
}

/// Mean products of residuals up to `most` rows apart: by lag, then the earlier output, then the later one.
fn covariances(series: &[Series], m: usize, most: usize) -> Vec<Vec<f64>> {
    let of_lag = |lag: usize| {
        let (mut sums, mut counts) = (vec![0.0; m * m], vec![0.0_f64; m * m]);
        for Series { residuals, .. } in series {
            let rows = residuals.values.len() / m;
            for row in lag..rows {
                for (a, b) in (0..m * m).map(|at| (at / m, at % m)) {
                    let (early, late) = ((row - lag) * m + a, row * m + b);
                    sums[a * m + b] += residuals.values[early] * residuals.values[late];
                    counts[a * m + b] += f64::from(u8::from(residuals.there[early] && residuals.there[late]));
                }
            }
        }
        sums.iter().zip(&counts).map(|(sum, count)| sum / count.max(1.0)).collect()
    };
    (0..=most).map(of_lag).collect()
}

/// The last lag at which some output's residuals are correlated by more than three times the deviation of white ones.
/// As many lags in which they look white must follow.
fn memory(covariances: &[Vec<f64>], m: usize, rows: usize) -> usize {
    let level = 3.0 / (rows as f64).sqrt();
    let coloured = |lag: usize| (0..m).any(|a| (covariances[lag][a * m + a] / covariances[0][a * m + a]).abs() > level);
    let mut last = 0;
    for lag in 1..covariances.len() {
        if coloured(lag) {
            last = lag;
        } else if lag >= last + WHITE_LAGS {
            break;
        }
    }
    last
}

/// Adds `sum_i sum_j S_i' R(i - j) S_j` of a segment.
fn add(sum: &mut Mat<f64>, series: &Series, covariances: &[Vec<f64>]) {
    let (m, S) = (series.outputs, &series.residuals.by_parameters);
    let rows = S.nrows() / m;
    for j in 0..S.ncols() {
        let column = S.col_as_slice(j);
        let mut spread = vec![0.0; column.len()];
        for (lag, covariance) in covariances.iter().enumerate() {
            for (a, b) in (0..m * m).map(|at| (at / m, at % m)) {
                let r = covariance[a * m + b];
                for row in lag..rows {
                    let (early, late) = ((row - lag) * m + a, row * m + b);
                    spread[early] += r * column[late];
                    if lag > 0 {
                        spread[late] += r * column[early];
                    }
                }
            }
        }
        for i in 0..S.ncols() {
            sum[(i, j)] += S.col_as_slice(i).iter().zip(&spread).map(|(a, b)| a * b).sum::<f64>();
        }
    }
}
