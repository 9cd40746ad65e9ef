//! Sums behind the errors of rollouts by horizon, mergeable in the order of the starts.

use super::{ROLLOUT_BASELINES, RolloutSummary};
use crate::{Estimate, PathScores, student_t_95};

/// Scores of a summary, behind those of the steps.
pub(super) const SUMMARY: usize = 3;
/// Predictors: the model, the baselines, and the model beside the reference.
pub(super) const PREDICTORS: usize = 2 + ROLLOUT_BASELINES.len();
pub(super) const REFERENCE: usize = ROLLOUT_BASELINES.len();
pub(super) const PAIR: usize = PREDICTORS - 1;
/// Places of whole rollouts in the scores of the direction, behind its steps.
pub(super) const AVERAGE: usize = 0;
pub(super) const GROWTH: usize = 1;
pub(super) const WARPING: usize = 2;

/// Errors of one predictor: per step and state.
#[derive(Clone, Default)]
pub(super) struct ErrorTable {
    pub(super) square: Vec<f64>,
    pub(super) absolute: Vec<f64>,
    pub(super) rows: Vec<f64>,
    pub(super) spread: Vec<Spread>,
}

/// An explained variance without the digits that differences of sums do not have.
pub(super) fn rounded(explained: f64) -> f64 {
    if explained.abs() < 1e-12 { 0.0 } else { explained }
}

/// Sums behind the explained variance of a state.
#[derive(Clone, Copy, Default)]
pub(super) struct Spread {
    pub(super) rows: f64,
    pub(super) error: f64,
    pub(super) error_square: f64,
    pub(super) measured: f64,
    pub(super) measured_square: f64,
}

impl Spread {
    pub(super) fn add(&mut self, error: f64, measured: f64) {
        let one =
            Self { rows: 1.0, error, error_square: error * error, measured, measured_square: measured * measured };
        self.merge(&one);
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.rows += other.rows;
        self.error += other.error;
        self.error_square += other.error_square;
        self.measured += other.measured;
        self.measured_square += other.measured_square;
    }

    /// Sums of the squared deviations of error and measurement from the means of `all`.
    pub(super) fn about(&self, all: &Self) -> (f64, f64) {
        let (error, measured) = (all.error / all.rows, all.measured / all.rows);
        let about = |square: f64, sum: f64, mean: f64| self.rows.mul_add(mean * mean, square - 2.0 * mean * sum);
        (about(self.error_square, self.error, error), about(self.measured_square, self.measured, measured))
    }

    pub(super) fn explained(&self) -> f64 {
        let (error, measured) = self.about(self);
        if measured > 0.0 { rounded(1.0 - error / measured) } else { f64::NAN }
    }
}

/// Sums over starts, mergeable in order. Predictors: the model, then the baselines.
#[derive(Clone, Default)]
pub(crate) struct HorizonSums {
    pub(super) starts: u64,
    pub(super) time: Vec<f64>,
    pub(super) ended: Vec<u64>,
    pub(super) tables: Vec<ErrorTable>,
    /// The model's errors against raw measurements.
    pub(super) raw: ErrorTable,
    /// Per predictor (of the Mahalanobis score, then of the displacement) and step, the sums behind the summary: sum
    /// and sum of squares of the scores, and their number.
    pub(super) scores: Vec<Vec<[f64; 3]>>,
    /// Per episode, predictor and step: sum of the scores and their number.
    pub(super) episodes: Vec<(usize, Vec<Vec<[f64; 2]>>)>,
    /// Per episode, in the same order, and predictor and state: sums over all steps.
    pub(super) spreads: Vec<Vec<Spread>>,
    pub(super) states: usize,
}

impl ErrorTable {
    /// Adds the errors of a step that are known, from a cell on.
    pub(super) fn add(&mut self, cell: usize, size: &[f64]) {
        for s in (0..size.len()).filter(|&s| size[s].is_finite()) {
            self.square[cell + s] += size[s] * size[s];
            self.absolute[cell + s] += size[s].abs();
            self.rows[cell + s] += 1.0;
        }
    }

    pub(super) fn means<'a>(&'a self, sum: impl Fn(&'a Self) -> &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        sum(self).iter().zip(&self.rows).map(|(sum, rows)| sum / rows)
    }

    pub(super) fn merge(&mut self, other: &Self) {
        for (sum, other) in
            [(&mut self.square, &other.square), (&mut self.absolute, &other.absolute), (&mut self.rows, &other.rows)]
        {
            sum.iter_mut().zip(other).for_each(|(a, b)| *a += b);
        }
        self.spread.iter_mut().zip(&other.spread).for_each(|(a, b)| a.merge(b));
    }
}

impl HorizonSums {
    /// Adds a score of a start.
    pub(super) fn push(&mut self, episode: usize, predictor: usize, at: usize, score: f64) {
        let sum = &mut self.scores[predictor][at];
        *sum = [sum[0] + score, score.mul_add(score, sum[1]), sum[2] + 1.0];
        let part = &mut self.episodes[episode].1[predictor][at];
        *part = [part[0] + score, part[1] + 1.0];
    }

    pub(super) fn summary(&self, predictor: usize, horizon: usize) -> RolloutSummary {
        let [average, last, drift] = [0, 1, 2].map(|at| self.estimate(predictor, horizon + at));
        RolloutSummary { average, last, drift }
    }

    /// Scores of the paths whose direction stands in `row`.
    pub(super) fn path(&self, row: usize, horizon: usize) -> PathScores {
        PathScores {
            alignment: (0..horizon).map(|k| self.estimate(row, k)).collect(),
            average_alignment: self.estimate(row, horizon + AVERAGE),
            propagated_error: self.estimate(row, horizon + GROWTH),
            warping_distance: self.estimate(row, horizon + WARPING),
        }
    }

    /// Explained variance of a state over all steps. Its derivatives by the means are 0, so that the interval is that
    /// of a ratio of sums.
    pub(super) fn explained(&self, predictor: usize, state: usize) -> Estimate {
        let by_episode = || self.spreads.iter().map(|spreads| &spreads[predictor * self.states + state]);
        let mut all = Spread::default();
        by_episode().for_each(|spread| all.merge(spread));
        let value = all.explained();
        if self.episodes.len() < 2 || value.is_nan() {
            return Estimate { value, low: f64::NAN, high: f64::NAN };
        }
        let share = Estimate::of_ratio(by_episode().map(|spread| spread.about(&all)));
        let [low, high] = [1.0 - share.high, 1.0 - share.low].map(rounded);
        Estimate { value, low, high }
    }

    /// The place of an episode's sums.
    pub(super) fn episode(&mut self, episode: usize) -> usize {
        match self.episodes.iter().rposition(|(known, _)| *known == episode) {
            Some(place) => place,
            None => {
                let length = self.time.len() + SUMMARY;
                self.episodes.push((episode, vec![vec![[0.0; 2]; length]; self.scores.len()]));
                self.spreads.push(vec![Spread::default(); PREDICTORS * self.states]);
                self.episodes.len() - 1
            }
        }
    }

    /// Adds the starts behind `other`.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.starts += other.starts;
        self.time.iter_mut().zip(&other.time).for_each(|(a, b)| *a += b);
        self.ended.iter_mut().zip(&other.ended).for_each(|(a, b)| *a += b);
        self.tables.iter_mut().zip(&other.tables).for_each(|(a, b)| a.merge(b));
        self.raw.merge(&other.raw);
        for (a, b) in self.scores.iter_mut().flatten().zip(other.scores.iter().flatten()) {
            (0..3).for_each(|i| a[i] += b[i]);
        }
        for ((episode, parts), spreads) in other.episodes.iter().zip(&other.spreads) {
            let place = self.episode(*episode);
            self.spreads[place].iter_mut().zip(spreads).for_each(|(a, b)| a.merge(b));
            for (a, b) in self.episodes[place].1.iter_mut().flatten().zip(parts.iter().flatten()) {
                (0..2).for_each(|i| a[i] += b[i]);
            }
        }
    }

    pub(super) fn estimate(&self, predictor: usize, k: usize) -> Estimate {
        if self.episodes.len() >= 2 {
            return Estimate::of_ratio(self.episodes.iter().map(|(_, parts)| {
                let part = parts[predictor][k];
                (part[0], part[1])
            }));
        }
        let [sum, square, count] = self.scores[predictor][k];
        let value = sum / count;
        if count < 2.0 {
            return Estimate { value, low: f64::NAN, high: f64::NAN };
        }
        let variance = ((square - sum * value) / (count - 1.0)).max(0.0);
        let half = student_t_95(count as usize - 1) * (variance / count).sqrt();
        Estimate { value, low: value - half, high: value + half }
    }
}
