//! One-step scores of a model on a recording: one pass over the rows.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Progress, Source, packed};
use fleetfoot_model::Model;
use fleetfoot_stats::{Chunk, ErrorSum, Gram, Grid, TILE_ROWS, reduce};

use crate::{
    Baseline, BaselineScore, Basis, CalibrationBin, Domain, EpisodeScore, Error, Estimate, Mahalanobis, Predicted,
    Predictor, PredictorWorkspace, RawError, RowStatus, Scores, Skipped, TargetScore,
    angle::wrap,
    baseline::{BaselineWorkspace, ONE_STEP, OneStepBaselines},
    raw::{RawTargets, RawWorkspace},
};

/// Rows whose errors are kept for a second use.
const SAMPLE_ROWS: usize = 262_144;
/// Spans that a single episode is cut into for intervals.
const SPANS: usize = 10;

/// Options of scores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ScoreOptions {
    /// Bins of [`Scores::calibration`].
    pub bins: usize,
}

impl Default for ScoreOptions {
    fn default() -> Self {
        Self { bins: 20 }
    }
}

/// Scores the one-step predictions of a model on every row of a source whose columns are the model's.
///
/// # Errors
/// Those of [`Predictor::new`] and of reading. A source without a row that can be scored gives no error: all counts are
/// 0, the scores NaN.
pub fn score(
    model: &Model,
    source: &dyn Source,
    options: &ScoreOptions,
    progress: &dyn Progress,
) -> Result<Scores, Error> {
    score_beside_raw(model, source, None, options, progress)
}

/// [`score`] with errors against raw measurements beside those on the rows. `raw` has the same episodes and rows, and
/// the measurements in its columns (NaN for none).
///
/// # Errors
/// Those of [`score`].
pub fn score_beside_raw(
    model: &Model,
    source: &dyn Source,
    raw: Option<&dyn Source>,
    options: &ScoreOptions,
    progress: &dyn Progress,
) -> Result<Scores, Error> {
    let columns: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let scorer = Scorer {
        predictor: Predictor::new(model, &columns)?,
        baselines: OneStepBaselines::new(model, &columns)?,
        metric: Mahalanobis::of_covariance(&model.training.target_covariance, model.training.target_mean.len()),
        mean: model.training.target_mean.clone(),
        stride: source.rows().div_ceil(SAMPLE_ROWS).max(1),
        raw: raw.map(|raw| RawTargets::new(model, &columns, raw)).transpose()?,
    };
    let chunks = Grid { chunk_rows: chunk_rows(source) }.chunks(source.episodes());
    let mut parts: Vec<(Chunk, Sums)> = Vec::with_capacity(chunks.len());
    reduce(
        source,
        &chunks,
        scorer.halo(),
        progress,
        || (Sums::new(scorer.mean.len()), Tile::default()),
        |(sums, tile), chunk, block, rows| -> Result<(), Error> {
            let first = block.first + rows.start;
            debug_assert!(chunk.rows.contains(&first) && rows.len() <= TILE_ROWS);
            scorer.add(chunk.episode, block, rows, tile, sums)
        },
        |chunk, (sums, _)| {
            parts.push((chunk.clone(), sums));
            Ok(())
        },
    )?;
    Ok(summarise(model, source, &scorer, &parts, options))
}

/// Rows of a chunk: enough chunks for the threads and for the spans of an interval, none so large that its result waits.
fn chunk_rows(source: &dyn Source) -> usize {
    let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    longest.div_ceil(SPANS).clamp(1, 65_536)
}

struct Scorer<'a> {
    predictor: Predictor,
    baselines: OneStepBaselines,
    metric: Mahalanobis,
    mean: Vec<f64>,
    stride: usize,
    raw: Option<RawTargets<'a>>,
}

/// Memory of a tile.
#[derive(Default)]
struct Tile {
    workspace: PredictorWorkspace,
    predicted: Predicted,
    baseline_workspace: BaselineWorkspace,
    baselines: Vec<f64>,
    raw_workspace: RawWorkspace,
    /// Raw measurements minus smoothed values (targets x rows).
    shifts: Vec<f64>,
}

/// Sums of a chunk.
#[derive(Clone)]
struct Sums {
    rows: u64,
    skipped: Skipped,
    outside_region: u64,
    outside_training: u64,
    targets: Vec<ErrorSum>,
    /// Per target and baseline: the baseline's errors, and the model's on the same rows.
    baselines: Vec<[(ErrorSum, ErrorSum); 2]>,
    /// Per target the errors against raw measurements.
    raw: Vec<ErrorSum>,
    mahalanobis: f64,
    /// Sampled rows: input score, output score, errors, measured targets.
    sample: Vec<f64>,
}

impl Sums {
    fn new(targets: usize) -> Self {
        Self {
            rows: 0,
            skipped: Skipped::default(),
            outside_region: 0,
            outside_training: 0,
            targets: vec![ErrorSum::default(); targets],
            baselines: vec![Default::default(); targets],
            raw: vec![ErrorSum::default(); targets],
            mahalanobis: 0.0,
            sample: Vec::new(),
        }
    }

    /// Adds the counts and sums (not the sample) of `other`.
    fn merge(&mut self, other: &Sums) {
        self.rows += other.rows;
        self.skipped.border += other.skipped.border;
        self.skipped.missing += other.skipped.missing;
        self.skipped.no_region += other.skipped.no_region;
        self.skipped.non_finite += other.skipped.non_finite;
        self.outside_region += other.outside_region;
        self.outside_training += other.outside_training;
        self.targets.iter_mut().zip(&other.targets).for_each(|(a, b)| a.merge(b));
        for (a, b) in self.baselines.iter_mut().flatten().zip(other.baselines.iter().flatten()) {
            a.0.merge(&b.0);
            a.1.merge(&b.1);
        }
        self.raw.iter_mut().zip(&other.raw).for_each(|(a, b)| a.merge(b));
        self.mahalanobis += other.mahalanobis;
    }
}

impl Scorer<'_> {
    fn halo(&self) -> Halo {
        let raw = self.raw.as_ref().map_or_else(Halo::default, RawTargets::halo);
        let all = [self.predictor.halo(), self.baselines.halo(), raw];
        all.iter().fold(Halo::default(), |a, b| Halo { before: a.before.max(b.before), after: a.after.max(b.after) })
    }

    fn add(
        &self,
        episode: usize,
        block: &Block,
        rows: Range<usize>,
        tile: &mut Tile,
        sums: &mut Sums,
    ) -> Result<(), Error> {
        let first = block.first + rows.start;
        let Tile { workspace, predicted, baseline_workspace, baselines, raw_workspace, shifts } = tile;
        shifts.clear();
        if let Some(raw) = &self.raw {
            raw.shifts(episode, block, &rows, raw_workspace, shifts)?;
        }
        self.predictor.predict(block, rows.clone(), workspace, predicted);
        self.baselines.predict(block, rows, baseline_workspace, baselines);
        let mut error = vec![0.0; self.mean.len()];
        let mut part = Sums { sample: std::mem::take(&mut sums.sample), ..Sums::new(self.mean.len()) };
        let mut scratch = vec![0.0; self.metric.width()];
        for row in 0..predicted.rows {
            if !count(predicted, row, &mut part) {
                continue;
            }
            for target in 0..error.len() {
                error[target] = self.add_target(predicted, baselines, target, row, &mut part);
                if let Some(shift) = shifts.get(target * predicted.rows + row).filter(|shift| shift.is_finite()) {
                    let angle = self.predictor.wrapped(target);
                    let error = error[target] + shift;
                    part.raw[target].push(if angle { wrap(error) } else { error }, 0.0, 0.0, 1.0);
                }
            }
            let output = self.metric.score_with(&error, &mut scratch);
            part.mahalanobis += output;
            if (first + row).is_multiple_of(self.stride) {
                part.sample.extend([predicted.centre_distance[row], output]);
                part.sample.extend_from_slice(&error);
                part.sample.extend((0..error.len()).map(|target| predicted.measured[target * predicted.rows + row]));
            }
        }
        sums.sample = std::mem::take(&mut part.sample);
        sums.merge(&part);
        Ok(())
    }

    /// Adds the errors of one target at one row; gives the model's error.
    fn add_target(&self, predicted: &Predicted, baselines: &[f64], target: usize, row: usize, sums: &mut Sums) -> f64 {
        let rows = predicted.rows;
        let angle = self.predictor.wrapped(target);
        let y = predicted.measured[target * rows + row];
        let error = predicted.residual[target * rows + row];
        // The sums take differences themselves: a difference that is already taken (and wrapped) is handed on exactly.
        let deviation = if angle { wrap(y - self.mean[target]) } else { y - self.mean[target] };
        let push = |sum: &mut ErrorSum, error: f64| sum.push(error, 0.0, error - deviation, 1.0);
        push(&mut sums.targets[target], error);
        for (which, (baseline, model)) in sums.baselines[target].iter_mut().enumerate() {
            let other = y - baselines[(2 * target + which) * rows + row];
            if other.is_finite() {
                push(baseline, if angle { wrap(other) } else { other });
                push(model, error);
            }
        }
        error
    }
}

/// Counts a row; whether it is scored.
fn count(predicted: &Predicted, row: usize, sums: &mut Sums) -> bool {
    match predicted.status[row] {
        RowStatus::Complete => {
            sums.rows += 1;
            sums.outside_region += u64::from(predicted.domain[row] != Domain::Inside);
            sums.outside_training += u64::from(predicted.domain[row] == Domain::OutsideTraining);
            return true;
        }
        RowStatus::Border => sums.skipped.border += 1,
        RowStatus::Missing => sums.skipped.missing += 1,
        RowStatus::NoRegion => sums.skipped.no_region += 1,
        RowStatus::NonFinite => sums.skipped.non_finite += 1,
    }
    false
}

fn summarise(
    model: &Model,
    source: &dyn Source,
    scorer: &Scorer<'_>,
    parts: &[(Chunk, Sums)],
    options: &ScoreOptions,
) -> Scores {
    let targets = scorer.mean.len();
    let mut total = Sums::new(targets);
    let mut by_episode: Vec<Sums> = vec![Sums::new(targets); source.episodes().len()];
    for (chunk, sums) in parts {
        total.merge(sums);
        by_episode[chunk.episode].merge(sums);
    }
    let scored: Vec<usize> = (0..by_episode.len()).filter(|&episode| by_episode[episode].rows > 0).collect();
    let (basis, groups) = if scored.len() >= 2 {
        (Basis::Episodes(scored.len()), scored.iter().map(|&episode| by_episode[episode].clone()).collect())
    } else {
        let spans = spans(parts, targets);
        (Basis::Spans(spans.len()), spans)
    };
    let (mahalanobis_measured, sampled_rows, calibration) = from_sample(parts, targets, options.bins);
    Scores {
        rows: total.rows,
        skipped: total.skipped,
        outside_region: total.outside_region,
        outside_training: total.outside_training,
        targets: target_scores(model, &total, &groups),
        mahalanobis: Estimate::of_errors(groups.iter().map(|sums| (sums.mahalanobis, sums.rows as f64))),
        mahalanobis_measured,
        sampled_rows,
        calibration,
        episodes: scored.iter().map(|&episode| episode_score(model, source, episode, &by_episode[episode])).collect(),
        basis,
    }
}

/// About ten contiguous spans of the scored chunks.
fn spans(parts: &[(Chunk, Sums)], targets: usize) -> Vec<Sums> {
    let scored: Vec<&Sums> = parts.iter().map(|(_, sums)| sums).filter(|sums| sums.rows > 0).collect();
    let mut spans: Vec<Sums> = Vec::new();
    let mut last = usize::MAX;
    for (i, sums) in scored.iter().enumerate() {
        let span = i * SPANS.min(scored.len()) / scored.len();
        if span != last {
            spans.push(Sums::new(targets));
            last = span;
        }
        if let Some(open) = spans.last_mut() {
            open.merge(sums);
        }
    }
    spans
}

fn target_scores(model: &Model, total: &Sums, groups: &[Sums]) -> Vec<TargetScore> {
    model
        .fitted()
        .enumerate()
        .map(|(t, equation)| {
            let sum = &total.targets[t];
            let sigma = model.training.target_covariance[packed(t, t)].sqrt();
            let parts = |weight: fn(&ErrorSum) -> f64| {
                groups.iter().map(move |g| (g.targets[t].absolute, weight(&g.targets[t])))
            };
            let mut baselines = vec![BaselineScore {
                baseline: Baseline::Null,
                rows: sum.rows,
                mae: sum.absolute_deviation / sum.weight,
                rmse: (sum.square_deviation / sum.weight).sqrt(),
                model_mae: sum.mean_absolute(),
                model_rmse: sum.root_mean_square(),
            }];
            for (&baseline, (score, same)) in ONE_STEP.iter().zip(&total.baselines[t]) {
                baselines.push(BaselineScore {
                    baseline,
                    rows: score.rows,
                    mae: score.mean_absolute(),
                    rmse: score.root_mean_square(),
                    model_mae: same.mean_absolute(),
                    model_rmse: same.root_mean_square(),
                });
            }
            TargetScore {
                name: equation.label(),
                unit: equation.unit.clone(),
                mae: Estimate::of_errors(parts(|sum| sum.weight)),
                mae_over_null: over_null(sum, parts(|sum| sum.absolute_deviation), resolution(model, t)),
                mae_over_sigma: sum.mean_absolute() / sigma,
                rmse: sum.root_mean_square(),
                r2: sum.r_squared(resolution(model, t)),
                explained_variance: explained_variance(sum, resolution(model, t)),
                bias: sum.bias(),
                max: if sum.rows > 0 { sum.largest } else { f64::NAN },
                deviation: sum.deviation_of_target(),
                baselines,
                raw: (total.raw[t].rows > 0).then(|| RawError {
                    rows: total.raw[t].rows,
                    mae: total.raw[t].mean_absolute(),
                    rmse: total.raw[t].root_mean_square(),
                }),
            }
        })
        .collect()
}

/// One less the share of the target's variance that is left in the error.
fn explained_variance(sum: &ErrorSum, resolution: f64) -> f64 {
    let deviation = sum.deviation_of_target();
    if deviation.is_nan() || deviation <= resolution {
        return sum.r_squared(resolution);
    }
    let (error, bias) = (sum.root_mean_square(), sum.bias());
    1.0 - (error * error - bias * bias).max(0.0) / (deviation * deviation)
}

/// Resolution of a target: smaller values are rounding.
fn resolution(model: &Model, target: usize) -> f64 {
    1e-13 * model.training.target_mean[target].abs()
}

/// The ratio of a model's error to the null model's over groups of rows; where the null model has none, that of [`ErrorSum::relative_absolute`].
fn over_null(sum: &ErrorSum, groups: impl Iterator<Item = (f64, f64)>, resolution: f64) -> Estimate {
    if sum.absolute_deviation > sum.weight * resolution || sum.rows == 0 {
        return Estimate::of_errors(groups);
    }
    let value = sum.relative_absolute(resolution);
    Estimate { value, low: value, high: value }
}

fn episode_score(model: &Model, source: &dyn Source, episode: usize, sums: &Sums) -> EpisodeScore {
    let info = &source.episodes()[episode];
    let id = info.id.to_string();
    EpisodeScore {
        episode,
        id: info.id,
        name: info.name.clone(),
        in_training: model.training.episodes.iter().any(|known| known.id == id),
        rows: sums.rows,
        mae: sums.targets.iter().map(ErrorSum::mean_absolute).collect(),
        mae_over_null: (sums.targets.iter().enumerate())
            .map(|(t, sum)| sum.relative_absolute(resolution(model, t)))
            .collect(),
        rmse: sums.targets.iter().map(ErrorSum::root_mean_square).collect(),
        mahalanobis: sums.mahalanobis / sums.rows as f64,
    }
}

/// Mean score under the covariance of the measured targets, sampled rows, and the bins of input against output score.
fn from_sample(parts: &[(Chunk, Sums)], targets: usize, bins: usize) -> (f64, u64, Vec<CalibrationBin>) {
    let width = 2 + 2 * targets;
    let rows: Vec<&[f64]> = parts.iter().flat_map(|(_, sums)| sums.sample.chunks_exact(width)).collect();
    if rows.is_empty() {
        return (f64::NAN, 0, Vec::new());
    }
    let measured = faer::Mat::from_fn(rows.len(), targets, |i, j| rows[i][2 + targets + j]);
    let gram = Gram::of_rows(measured.as_ref(), None);
    let covariance: Vec<f64> = gram.scatter.iter().map(|value| value / rows.len() as f64).collect();
    let metric = Mahalanobis::of_covariance(&covariance, targets);
    let mut scratch = vec![0.0; metric.width()];
    let sum: f64 = rows.iter().map(|row| metric.score_with(&row[2..2 + targets], &mut scratch)).sum();
    let mut pairs: Vec<(f64, f64)> =
        rows.iter().map(|row| (row[0], row[1])).filter(|pair| pair.0.is_finite()).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let bins = bins.min(pairs.len());
    let calibration = (0..bins)
        .map(|bin| {
            let part = &pairs[bin * pairs.len() / bins..(bin + 1) * pairs.len() / bins];
            let (input, output) = part.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0, b + pair.1));
            let count = part.len() as f64;
            CalibrationBin { rows: part.len() as u64, input: input / count, output: output / count }
        })
        .collect();
    (sum / rows.len() as f64, rows.len() as u64, calibration)
}
