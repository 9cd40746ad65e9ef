//! Deviations of columns, from a recording and the model: the noise of inputs and states with the greatest likelihood.
//!
//! Along the recording the constraints are linear in its errors: e = x - y of the states, and w = u - v of the inputs,
//! held over an interval,
//!
//! ```text
//! e_k+1 = Phi_k e_k + Gamma_k w_k - b_k,    0 = e_k + noise
//! ```
//!
//! An error of the model that lasts for many rows counts in both, as it explains the recording better.

// Matrices are capitals.
#![allow(non_snake_case)]

use fleetfoot_data::checkpoint;

use crate::{recorded::Recorded, transcription::Transcription};

/// Steps of expectation and maximisation, at most.
const STEPS: usize = 300;
/// Convergence limit: the largest change of the logarithm of a variance.
const SETTLED: f64 = 1e-3;
/// By how much steps are lengthened from one to the next, and at most.
const LONGER: [f64; 2] = [1.5, 100.0];
/// Starting deviations as shares of the spread: states and inputs. From free inputs there is no plateau.
const BEGIN: [f64; 2] = [0.03, 1.0];
/// No column is known better than this share of its spread.
const LEAST: f64 = 1e-3;
/// Rows of a recording from which its noise is estimated, at most.
const MOST_ROWS: usize = 2_000;

/// A recording as a linear system, in units of the spreads.
struct System {
    n: usize,
    m: usize,
    /// Phi (n x n), Gamma (n x m) and b (n) of every interval.
    steps: Vec<[Vec<f64>; 3]>,
    /// Of every row and state.
    measured: Vec<bool>,
}

/// Update of the belief by a scalar measurement: the gain (n), and the innovation with its variance.
struct Update {
    state: usize,
    gain: Vec<f64>,
    innovation: f64,
    variance: f64,
}

/// The belief before the measurements of a row, and these.
struct Belief {
    mean: Vec<f64>,
    covariance: Vec<f64>,
    updates: Vec<Update>,
}

/// Variances of states and inputs over the squares of their spreads; `None` where the model has no value along the recording.
pub(super) fn variances(transcription: &Transcription, recorded: &Recorded, spreads: &[f64]) -> Option<Vec<f64>> {
    let system = System::new(transcription, recorded, spreads)?;
    let begin = |column: usize| BEGIN[usize::from(column >= system.n)].powi(2);
    let mut variances: Vec<f64> = (0..spreads.len()).map(begin).collect();
    // The likelihood where a step came from and where it led by itself.
    let (mut before, mut short) = (f64::NEG_INFINITY, variances.clone());
    let mut length = 1.0;
    for _ in 0..STEPS {
        let (likelihood, maximum) = system.maximised(&variances);
        // Too long: what one step leads to cannot be worse than where it came from.
        if length > 1.0 && (likelihood < before || likelihood.is_nan()) {
            (length, variances) = (1.0, short.clone());
            continue;
        }
        before = likelihood;
        short = maximum.into_iter().map(held).collect();
        let change = |(new, old): (&f64, &f64)| (new / old).ln().abs();
        if short.iter().zip(&variances).map(change).fold(0.0, f64::max) < SETTLED {
            break;
        }
        let longer = |(old, new): (&f64, &f64)| held(old * (new / old).powf(length));
        variances = variances.iter().zip(&short).map(longer).collect();
        length = (LONGER[0] * length).min(LONGER[1]);
    }
    Some(variances)
}

/// Limits a share of the spread to its allowed range.
fn held(variance: f64) -> f64 {
    variance.clamp(LEAST * LEAST, 1.0)
}

impl System {
    fn new(transcription: &Transcription, recorded: &Recorded, spreads: &[f64]) -> Option<Self> {
        let (n, c) = (transcription.states(), spreads.len());
        let defects = transcription.defects(recorded, &recorded.values)?.scaled(n, spreads);
        let rows = recorded.rows.len().min(MOST_ROWS);
        let mut steps = Vec::with_capacity(rows - 1);
        for k in 0..rows - 1 {
            let of = |blocks: &[f64], s: usize, j: usize| blocks[(k * n + s) * c + j];
            let mut behind: Vec<f64> = (0..n * n).map(|at| of(&defects.behind, at / n, at % n)).collect();
            let mut right: Vec<f64> = Vec::with_capacity(n * (c + 1));
            for s in 0..n {
                right.extend((0..n).map(|j| -of(&defects.before, s, j)));
                right.extend((n..c).map(|j| -of(&defects.before, s, j) - of(&defects.behind, s, j)));
                right.push(defects.values[k * n + s]);
            }
            solve(&mut behind, &mut right, n, c + 1)?;
            let take = |from: usize, to: usize| -> Vec<f64> {
                (0..n).flat_map(|s| right[s * (c + 1) + from..s * (c + 1) + to].to_vec()).collect()
            };
            steps.push([take(0, n), take(n, c), take(c, c + 1)]);
        }
        let measured = (0..rows * n).map(|at| recorded.there[at / n * c + at % n]).collect();
        Some(Self { n, m: c - n, steps, measured })
    }

    /// The logarithm of the likelihood of variances, but for a constant, and one step from them: the likeliest
    /// variances for the expected errors under them.
    fn maximised(&self, variances: &[f64]) -> (f64, Vec<f64>) {
        let (n, m) = (self.n, self.m);
        let beliefs = self.forward(variances);
        let unlikely = |update: &Update| update.innovation * update.innovation / update.variance + update.variance.ln();
        let likelihood = -0.5 * beliefs.iter().flat_map(|belief| &belief.updates).map(unlikely).sum::<f64>();
        let (mut sums, mut counts) = (vec![0.0; n + m], vec![0.0_f64; n + m]);
        let (mut lambda, mut Lambda) = (vec![0.0; n], vec![0.0; n * n]);
        for (k, belief) in beliefs.iter().enumerate().rev() {
            checkpoint();
            if let Some([phi, gamma, _]) = self.steps.get(k) {
                for i in 0..m {
                    let q = variances[n + i];
                    let column: Vec<f64> = (0..n).map(|s| gamma[s * m + i]).collect();
                    let mean = -q * dot(&column, &lambda);
                    let variance = q - q * q * dot(&column, &times(&Lambda, &column, n));
                    sums[n + i] += mean * mean + variance;
                    counts[n + i] += 1.0;
                }
                lambda = (0..n).map(|j| (0..n).map(|s| phi[s * n + j] * lambda[s]).sum()).collect();
                Lambda = congruent(&Lambda, phi, n);
            }
            for update in belief.updates.iter().rev() {
                update.back(&mut lambda, &mut Lambda, n);
            }
            let moved = times(&belief.covariance, &lambda, n);
            for j in (0..n).filter(|&j| self.measured[k * n + j]) {
                let row = &belief.covariance[j * n..(j + 1) * n];
                let mean = belief.mean[j] - moved[j];
                let variance = row[j] - dot(row, &times(&Lambda, row, n));
                sums[j] += mean * mean + variance.max(0.0);
                counts[j] += 1.0;
            }
        }
        (likelihood, sums.iter().zip(&counts).map(|(sum, count)| sum / count.max(1.0)).collect())
    }

    fn forward(&self, variances: &[f64]) -> Vec<Belief> {
        let (n, m) = (self.n, self.m);
        let (mut mean, mut covariance) = (vec![0.0; n], vec![0.0; n * n]);
        (0..n).for_each(|j| covariance[j * n + j] = 1.0);
        let mut beliefs = Vec::with_capacity(self.steps.len() + 1);
        for k in 0..=self.steps.len() {
            checkpoint();
            let mut belief = Belief { mean: mean.clone(), covariance: covariance.clone(), updates: Vec::new() };
            for state in (0..n).filter(|&state| self.measured[k * n + state]) {
                let column: Vec<f64> = (0..n).map(|s| covariance[s * n + state]).collect();
                let variance = column[state] + variances[state];
                let gain: Vec<f64> = column.iter().map(|value| value / variance).collect();
                let innovation = -mean[state];
                mean.iter_mut().zip(&gain).for_each(|(mean, gain)| *mean += gain * innovation);
                for a in 0..n {
                    (0..n).for_each(|b| covariance[a * n + b] -= gain[a] * column[b]);
                }
                belief.updates.push(Update { state, gain, innovation, variance });
            }
            beliefs.push(belief);
            let Some([phi, gamma, b]) = self.steps.get(k) else { break };
            mean = times(phi, &mean, n).iter().zip(b).map(|(mean, b)| mean - b).collect();
            let transposed: Vec<f64> = (0..n * n).map(|at| phi[at % n * n + at / n]).collect();
            covariance = congruent(&covariance, &transposed, n);
            for at in 0..n * n {
                let (a, b) = (at / n, at % n);
                covariance[at] += (0..m).map(|i| gamma[a * m + i] * variances[n + i] * gamma[b * m + i]).sum::<f64>();
            }
        }
        beliefs
    }
}

impl Update {
    /// The adjoint before the measurement from that behind it: `(I - K H)' lambda - H' v/s`, and its variance.
    fn back(&self, lambda: &mut [f64], Lambda: &mut [f64], n: usize) {
        let along = dot(&self.gain, lambda);
        lambda[self.state] -= along + self.innovation / self.variance;
        let spread = times(Lambda, &self.gain, n);
        let square = dot(&self.gain, &spread);
        for j in 0..n {
            Lambda[j * n + self.state] -= spread[j];
            Lambda[self.state * n + j] -= spread[j];
        }
        Lambda[self.state * n + self.state] += square + 1.0 / self.variance;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A x, A by rows.
fn times(a: &[f64], x: &[f64], n: usize) -> Vec<f64> {
    a.chunks_exact(n).map(|row| dot(row, x)).collect()
}

/// B' A B of symmetric A, by rows.
fn congruent(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut right = vec![0.0; n * n];
    for (row, out) in a.chunks_exact(n).zip(right.chunks_exact_mut(n)) {
        for (value, from) in row.iter().zip(b.chunks_exact(n)) {
            out.iter_mut().zip(from).for_each(|(out, from)| *out += value * from);
        }
    }
    let mut product = vec![0.0; n * n];
    for (from, row) in b.chunks_exact(n).zip(right.chunks_exact(n)) {
        for (i, factor) in from.iter().enumerate() {
            product[i * n..(i + 1) * n].iter_mut().zip(row).for_each(|(out, value)| *out += factor * value);
        }
    }
    (0..n * n).map(|at| 0.5 * (product[at] + product[at % n * n + at / n])).collect()
}

/// A^-1 B in place of B (n x width), by elimination with the largest pivot; `None` where A is singular.
fn solve(a: &mut [f64], b: &mut [f64], n: usize, width: usize) -> Option<()> {
    for step in 0..n {
        let size = |row: usize| a[row * n + step].abs();
        let pivot = (step..n).max_by(|&i, &j| size(i).total_cmp(&size(j)))?;
        if size(pivot) <= 0.0 || size(pivot).is_nan() {
            return None;
        }
        (0..n).for_each(|j| a.swap(step * n + j, pivot * n + j));
        (0..width).for_each(|j| b.swap(step * width + j, pivot * width + j));
        for row in (0..n).filter(|&row| row != step) {
            let factor = a[row * n + step] / a[step * n + step];
            (step..n).for_each(|j| a[row * n + j] -= factor * a[step * n + j]);
            (0..width).for_each(|j| b[row * width + j] -= factor * b[step * width + j]);
        }
    }
    for row in 0..n {
        (0..width).for_each(|j| b[row * width + j] /= a[row * n + row]);
    }
    Some(())
}
