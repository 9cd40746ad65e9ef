//! Clustered covariance of coefficients ("sandwich"), from the moments of chunks.

use faer::Mat;
use fleetfoot_data::EpisodeId;
use fleetfoot_stats::{Gram, blocks, student_t_95};

use super::{InferenceError, least_squares::SupportFactor};
use crate::{
    SparseError,
    structured::{Assembly, assemble},
};
use fleetfoot_sums::structured::{Banks, Structure};

/// Choice of the rows that may be correlated with each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clusters {
    /// Rows of one episode.
    #[default]
    Episodes,
    /// Rows of one chunk, short ones joined ([`blocks`]): for a few long episodes, where a block is longer than the correlation time.
    Chunks,
}

/// Uncertainty of the coefficients of a support.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// The coefficients (k, ascending).
    pub support: Vec<usize>,
    /// Their values.
    pub estimate: Vec<f64>,
    /// Covariance (k x k), raw units.
    pub matrix: Mat<f64>,
    /// Standard errors (k).
    pub errors: Vec<f64>,
    /// 95 % intervals (k) by Student's t with `clusters - 1` degrees of freedom.
    pub intervals: Vec<[f64; 2]>,
    /// Number of clusters, G.
    pub clusters: usize,
    /// The small-sample factor that the matrix contains: `G/(G-1) (N-1)/(N-k)`, N the measured equations at all rows.
    pub factor: f64,
}

/// The covariance of coefficients theta (p) of a structured regression, given its support: `c H^-1 (sum_g u_g u_g') H^-1` with H = B'B of weights and priors and
/// u_g the score of cluster g, `sum_t s_t B_tg' (y_tg - B_tg theta)` over measured and prior tasks, less the mean score (Liang and Zeger 1986; the factor c is that
/// of Cameron and Miller 2015, equation (11)).
///
/// No row is read: scores are linear in the moments of the chunks. For least squares ([`super::least_squares_on`]) the mean score is the share of the Tikhonov
/// term, 0 without one. For a penalised theta it is that of the penalty, so the matrix is that of the penalised estimate with its support and signs held: the
/// bias of the shrinkage and the uncertainty of the choice are not in it.
///
/// # Errors
/// As [`assemble()`](crate::structured::assemble()); when theta has not p finite entries, there are fewer than two clusters, or the support is not identified.
pub fn clustered_covariance(
    banks: &Banks,
    structure: &Structure,
    assembly: &Assembly,
    theta: &[f64],
    clusters: Clusters,
) -> Result<Covariance, InferenceError> {
    let p = structure.coefficients();
    if theta.len() != p {
        return Err(SparseError::Length { what: "theta", actual: theta.len(), expected: p }.into());
    }
    if let Some(column) = theta.iter().position(|value| !value.is_finite()) {
        return Err(InferenceError::NotFinite { column });
    }
    let support: Vec<usize> = (0..p).filter(|&j| theta[j] != 0.0).collect();
    let assembled = assemble(structure, &banks.total(), assembly)?;
    let factor = SupportFactor::new(&assembled, &support)?.identified(&support)?;
    let (groups, count) = clusters_of(banks, clusters);
    if count < 2 {
        return Err(InferenceError::TooFewClusters { clusters: count });
    }
    let scores = scores(banks, structure, assembly, theta, &groups, count);
    // Every column: how far one cluster moves the coefficients.
    let mean: Vec<f64> =
        support.iter().map(|&j| scores.iter().map(|score| score[j]).sum::<f64>() / count as f64).collect();
    let moves = scores.iter().map(|score| {
        let centred: Vec<f64> = support.iter().zip(&mean).map(|(&j, mean)| score[j] - mean).collect();
        factor.inverse_times(&centred)
    });
    let moves: Vec<Vec<f64>> = moves.collect();
    let k = support.len();
    let c = small_sample(count, equations(banks, structure), k);
    let matrix = Mat::from_fn(k, k, |i, j| c * moves.iter().map(|m| m[i] * m[j]).sum::<f64>());
    let errors: Vec<f64> = (0..k).map(|i| matrix[(i, i)].sqrt()).collect();
    let estimate: Vec<f64> = support.iter().map(|&j| theta[j]).collect();
    let t = student_t_95(count - 1);
    let intervals = estimate.iter().zip(&errors).map(|(value, error)| [value - t * error, value + t * error]).collect();
    Ok(Covariance { support, estimate, matrix, errors, intervals, clusters: count, factor: c })
}

/// `G/(G-1) (N-1)/(N-k)`; the second share is 1 where there are not more equations than coefficients.
fn small_sample(clusters: usize, equations: u64, k: usize) -> f64 {
    let (g, n) = (clusters as f64, equations as f64);
    let share = if equations > k as u64 { (n - 1.0) / (n - k as f64) } else { 1.0 };
    g / (g - 1.0) * share
}

/// Rows of positive weight times measured tasks.
fn equations(banks: &Banks, structure: &Structure) -> u64 {
    let measured = structure.tasks.iter().zip(banks.tasks()).filter(|(shape, _)| !shape.prior);
    measured.map(|(_, (_, bank))| bank.rows().iter().sum::<u64>()).sum()
}

/// The cluster of every chunk (episode and rows, in key order). Chunks without rows still belong to one.
pub(super) fn groups(chunks: impl Iterator<Item = (EpisodeId, u64)>, clusters: Clusters) -> Vec<usize> {
    match clusters {
        Clusters::Chunks => blocks(chunks),
        Clusters::Episodes => {
            let (mut groups, mut last) = (Vec::<usize>::new(), None);
            for (episode, _) in chunks {
                // Keys are in order, so episodes are runs.
                let new = usize::from(last.is_some_and(|last| last != episode));
                groups.push(groups.last().map_or(0, |group| group + new));
                last = Some(episode);
            }
            groups
        }
    }
}

/// The cluster of every member of a bank, and their number.
pub(super) fn clusters_of(banks: &Banks, clusters: Clusters) -> (Vec<usize>, usize) {
    let members = banks.keys().iter().zip(banks.rows());
    let groups = groups(members.map(|(key, rows)| (key.episode, *rows)), clusters);
    let count = groups.last().map_or(0, |last| last + 1);
    (groups, count)
}

/// The score of every cluster (count of p), over measured and prior tasks with their weights.
fn scores(
    banks: &Banks,
    structure: &Structure,
    assembly: &Assembly,
    theta: &[f64],
    groups: &[usize],
    count: usize,
) -> Vec<Vec<f64>> {
    let mut scores = vec![vec![0.0; theta.len()]; count];
    for (task, (preconditioner, bank)) in banks.tasks().iter().enumerate() {
        let columns = structure.columns(task);
        let beta: Vec<f64> = columns.iter().map(|&j| theta[j]).collect();
        let weight = assembly.weights[task];
        for (member, &group) in groups.iter().enumerate() {
            let gram: Gram = bank.member(member);
            if gram.weight > 0.0 && weight > 0.0 {
                let score = preconditioner.score(&gram, 0, &beta);
                columns.iter().zip(&score.gradient).for_each(|(&j, value)| scores[group][j] += weight * value);
            }
        }
    }
    scores
}
