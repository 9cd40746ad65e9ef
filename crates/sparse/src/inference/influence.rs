//! Influence of every log on the fit: the exact answer without it.

use fleetfoot_data::{EpisodeId, Progress, parallel_map};
use fleetfoot_stats::{Gram, SquareRoot};

use super::{
    InferenceError,
    covariance::{Clusters, clusters_of},
    least_squares::SupportFactor,
};
use crate::structured::{Assembly, assemble};
use fleetfoot_sums::structured::{Banks, Structure};

/// The fit without one episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Influence {
    /// The episode that was left out.
    pub episode: EpisodeId,
    /// Its share of the weight of all rows.
    pub share: f64,
    /// Coefficients of the support without it (k); empty when the others do not identify them.
    pub coefficients: Vec<f64>,
    /// Cook's distance of the episode: `|B (theta_without - theta)|^2 / (k s^2)` over all rows, s^2 the residual variance of the full fit (Cook 1977). Infinite
    /// when the others do not identify the support.
    pub distance: f64,
    /// Weighted mean square of the errors of the fit without it, on the other episodes.
    pub training: f64,
    /// The same errors on the episode itself: what it would have been predicted with. NaN when the others do not identify the support.
    pub held_out: f64,
    /// Errors of the full fit on the episode.
    pub in_sample: f64,
}

/// Influence of every episode on a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct InfluenceReport {
    /// Coefficients of the support on all rows (k).
    pub coefficients: Vec<f64>,
    /// Weighted mean square of the errors on all rows: `sum_t s_t |y_t - B_t theta|^2 / n` over measured tasks.
    pub mean_square: f64,
    /// Mean over all rows of the held-out mean squares: leave-one-episode-out cross-validation of this support.
    pub held_out: f64,
    /// Episodes by descending Cook's distance, then by identity.
    pub episodes: Vec<Influence>,
}

/// The least-squares fit of a support with each episode left out in turn, from the moments of the chunks: exact solves, not first-order ones, and no pass.
///
/// # Errors
/// As [`assemble()`](crate::structured::assemble()); when the support is not identified by all rows, there are fewer than two episodes, or the user stops it.
pub fn influence(
    banks: &Banks,
    structure: &Structure,
    assembly: &Assembly,
    support: &[usize],
    progress: &dyn Progress,
) -> Result<InfluenceReport, InferenceError> {
    let (members, count) = clusters_of(banks, Clusters::Episodes);
    if count < 2 {
        return Err(InferenceError::TooFewClusters { clusters: count });
    }
    let roots = banks.total();
    let full = SupportFactor::new(&assemble(structure, &roots, assembly)?, support)?.identified(support)?;
    let fit = Fit { structure, assembly, support };
    let coefficients = full.coefficients();
    let squares = fit.squares(&roots, &coefficients);
    let n = weight(&roots);
    let equations: f64 = structure.tasks.iter().filter(|shape| !shape.prior).count() as f64 * n;
    let variance = squares / (equations - support.len() as f64).max(1.0);
    let rest: Vec<Vec<Gram>> = banks.tasks().iter().map(|(_, bank)| bank.without(&members, count)).collect();
    let scores = episode_moments(banks, &fit, &members, count);
    let mut episodes = parallel_map(count, progress, |episode| {
        let roots: Vec<SquareRoot> =
            banks.tasks().iter().zip(&rest).map(|((change, _), rest)| change.square_root(&rest[episode])).collect();
        let left = weight(&roots);
        let part = (n - left).max(f64::MIN_POSITIVE);
        let in_sample = scores.squares(episode, &fit, banks, &coefficients) / part;
        let factor = match assemble(structure, &roots, assembly) {
            Ok(assembled) => SupportFactor::new(&assembled, support)?.identified(support),
            Err(error) => Err(error.into()),
        };
        let mut influence = Influence {
            episode: scores.identity[episode],
            share: part / n,
            coefficients: Vec::new(),
            distance: f64::INFINITY,
            training: f64::NAN,
            held_out: f64::NAN,
            in_sample,
        };
        if let Ok(factor) = factor {
            let without = factor.coefficients();
            let change: Vec<f64> = without.iter().zip(&coefficients).map(|(a, b)| a - b).collect();
            influence.distance =
                full.squared_effect(&change) / (support.len().max(1) as f64 * variance.max(f64::MIN_POSITIVE));
            influence.training = fit.squares(&roots, &without) / left;
            influence.held_out = scores.squares(episode, &fit, banks, &without) / part;
            influence.coefficients = without;
        }
        Ok::<_, InferenceError>(influence)
    })?;
    let held_out = episodes.iter().map(|episode| episode.share * episode.held_out).sum();
    episodes.sort_by(|a, b| b.distance.total_cmp(&a.distance).then(a.episode.cmp(&b.episode)));
    Ok(InfluenceReport { coefficients, mean_square: squares / n, held_out, episodes })
}

fn weight(roots: &[SquareRoot]) -> f64 {
    roots.iter().map(|root| root.weight).fold(0.0, f64::max)
}

struct Fit<'a> {
    structure: &'a Structure,
    assembly: &'a Assembly,
    support: &'a [usize],
}

impl Fit<'_> {
    /// Coefficients of a task's columns.
    fn beta(&self, task: usize, coefficients: &[f64]) -> Vec<f64> {
        let value = |j: usize| self.support.iter().position(|&i| i == j).map_or(0.0, |place| coefficients[place]);
        self.structure.columns(task).into_iter().map(value).collect()
    }

    fn measured(&self) -> impl Iterator<Item = usize> {
        (0..self.structure.tasks.len()).filter(|&task| !self.structure.tasks[task].prior)
    }

    /// `sum_t s_t |y_t - B_t theta|^2` over measured tasks.
    fn squares(&self, roots: &[SquareRoot], coefficients: &[f64]) -> f64 {
        let square = |task: usize| {
            let beta = self.beta(task, coefficients);
            let column = faer::MatRef::from_column_major_slice(&beta, beta.len(), 1);
            self.assembly.weights[task] * roots[task].error(column, &[0.0])[0]
        };
        self.measured().map(square).sum()
    }
}

/// The moments of every episode: by task, by episode.
struct EpisodeMoments {
    identity: Vec<EpisodeId>,
    grams: Vec<Vec<Gram>>,
}

fn episode_moments(banks: &Banks, fit: &Fit<'_>, members: &[usize], count: usize) -> EpisodeMoments {
    let mut identity = Vec::with_capacity(count);
    for (key, &group) in banks.keys().iter().zip(members) {
        if group == identity.len() {
            identity.push(key.episode);
        }
    }
    let mut grams: Vec<Vec<Gram>> = vec![Vec::new(); banks.tasks().len()];
    for task in fit.measured() {
        let bank = &banks.tasks()[task].1;
        let mut sums = vec![Gram::new(bank.dimension()); count];
        members.iter().enumerate().for_each(|(member, &group)| sums[group].merge(&bank.member(member)));
        grams[task] = sums;
    }
    EpisodeMoments { identity, grams }
}

impl EpisodeMoments {
    /// Weighted squares of the errors on one episode, measured tasks.
    fn squares(&self, episode: usize, fit: &Fit<'_>, banks: &Banks, coefficients: &[f64]) -> f64 {
        let square = |task: usize| {
            let score = banks.tasks()[task].0.score(&self.grams[task][episode], 0, &fit.beta(task, coefficients));
            fit.assembly.weights[task] * score.squares
        };
        fit.measured().map(square).sum()
    }
}
