//! Free runs: a model simulated through whole episodes from their first complete rows, and how far it stays from the recording.
//!
//! Free runs test a model of dynamics, not a one-step predictor. Only the starting outputs come from the recording. All
//! later outputs, and the columns computed from them, are simulated; inputs stay recorded.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Progress, Source, parallel_fold};
use fleetfoot_model::{Equation, Model, Prediction};

use crate::{
    End, Error, Method, RolloutOptions, Simulator, Start, Step, Trajectory, free_run::sums::OutputSum,
    trajectories::GROUP, window::Window,
};

mod sums;
#[cfg(test)]
mod tests;

pub use sums::{FreeRunScore, OutputErrors};

/// Options of free runs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FreeRunOptions {
    /// Steps of a run at most; the next one starts from the recording where it ends. `None`: to the end of the episode.
    pub horizon: Option<usize>,
    /// Rows of an episode before the first start at least. With the same number, models of few lags and of many are
    /// scored on the same rows.
    pub first: usize,
    /// Integration method of derivatives.
    pub method: Method,
    /// Length of a step.
    pub step: Step,
    /// A state this many training standard deviations away from its start has diverged; infinite: only values that are
    /// not finite have.
    pub divergence: f64,
    /// True to keep the trajectories.
    pub keep: bool,
}

impl Default for FreeRunOptions {
    /// Whole episodes, Runge-Kutta steps of the episode's median period, divergence at 1,000 standard deviations, trajectories not kept.
    fn default() -> Self {
        let RolloutOptions { method, step, divergence, keep, .. } = RolloutOptions::new(1);
        Self { horizon: None, first: 0, method, step, divergence, keep }
    }
}

/// Scores of free runs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FreeRun {
    /// One score an advanced state, over all runs.
    pub outputs: Vec<FreeRunScore>,
    /// Columns whose values after the start of a run come from the recording.
    pub replayed: Vec<String>,
    /// The runs, by episode and row.
    pub runs: Vec<FreeRunOutcome>,
    /// Episodes without a row to start from: too short, or something missing everywhere.
    pub skipped: usize,
    /// The runs' trajectories, if they were to be kept; their states stand in the order of [`FreeRun::outputs`].
    pub trajectories: Vec<Trajectory>,
}

/// One free run.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FreeRunOutcome {
    /// Its first row, taken from the recording.
    pub start: Start,
    /// Steps that there were to make.
    pub steps: usize,
    /// End of the run.
    pub end: End,
    /// Row of the episode that was not reached, where the run ended early.
    pub lost_at: Option<usize>,
    /// First row of the episode at which a regressor was outside the training range of its region.
    pub left_domain: Option<usize>,
    /// Errors of every output in this run.
    pub outputs: Vec<OutputErrors>,
}

impl FreeRun {
    /// Runs that diverged.
    pub fn diverged(&self) -> usize {
        self.runs.iter().filter(|run| run.end == End::Diverged).count()
    }
}

/// Simulates every episode of a source, whose columns are the model's, from its first complete row.
///
/// A row is complete when all states (and their lags) and all recorded columns that the model needs are there. A run
/// goes on to the end of the episode or to the first missing input, after which the next one starts. Measurements of
/// the outputs may be missing on the way. The row of the start is not scored. Same bits on any number of threads.
///
/// # Errors
/// Those of [`Simulator::new`] and of reading, [`Error::NoHorizon`], [`Error::BadStep`], and [`Error::NoCompleteRow`] when no episode can be started.
pub fn free_run(
    model: &Model,
    source: &dyn Source,
    options: &FreeRunOptions,
    progress: &dyn Progress,
) -> Result<FreeRun, Error> {
    let simulator = Simulator::for_source(model, source, options.step)?;
    let mut rollout = RolloutOptions::new(options.horizon.unwrap_or(1));
    (rollout.method, rollout.step, rollout.divergence) = (options.method, options.step, options.divergence);
    rollout.validate()?;
    let runner = Runner {
        map: simulator.column_map(source)?,
        outputs: simulator.shown().iter().map(|state| Output::new(model, state.column)).collect(),
        simulator: &simulator,
        source,
        rollout,
        limit: options.horizon.unwrap_or(usize::MAX),
        first: options.first,
    };
    let names = simulator.states().to_vec();
    let mut total = vec![OutputSum::default(); names.len()];
    let mut free_run = FreeRun {
        outputs: Vec::new(),
        replayed: simulator.replayed(),
        runs: Vec::new(),
        skipped: 0,
        trajectories: Vec::new(),
    };
    parallel_fold(
        source.episodes().len(),
        progress,
        |episode| runner.episode(episode),
        |parts| -> Result<(), Error> {
            free_run.skipped += usize::from(parts.is_empty());
            for Part { outcome, sums, trajectory } in parts {
                free_run.runs.push(outcome);
                total.iter_mut().zip(&sums).for_each(|(total, sum)| total.merge(sum));
                if options.keep {
                    free_run.trajectories.push(trajectory);
                }
            }
            Ok(())
        },
    )?;
    if free_run.runs.is_empty() {
        let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
        return Err(Error::NoCompleteRow { episodes: free_run.skipped, needed: simulator.history() + 2, longest });
    }
    free_run.outputs =
        names.into_iter().zip(&total).map(|(name, sum)| FreeRunScore { name, errors: sum.errors() }).collect();
    Ok(free_run)
}

/// An advanced state, with the units of its errors.
struct Output {
    column: usize,
    /// The null model's prediction: the mean in training, where the model knows it.
    mean: Option<f64>,
}

impl Output {
    fn new(model: &Model, column: usize) -> Self {
        let name = &model.columns[column].name;
        // The mean of a next value is that of the state; of a derivative or difference it is not.
        let next = |e: &Equation| e.prediction == Prediction::Next;
        let mean = model.fitted().position(|e| e.subject == *name && next(e));
        Self { column, mean: mean.and_then(|target| model.training.target_mean.get(target).copied()) }
    }
}

struct Part {
    outcome: FreeRunOutcome,
    sums: Vec<OutputSum>,
    trajectory: Trajectory,
}

struct Runner<'a> {
    simulator: &'a Simulator,
    source: &'a dyn Source,
    map: Vec<usize>,
    outputs: Vec<Output>,
    rollout: RolloutOptions,
    limit: usize,
    first: usize,
}

impl Runner<'_> {
    /// All runs of an episode, read once.
    fn episode(&self, episode: usize) -> Result<Vec<Part>, Error> {
        let rows = self.source.episodes()[episode].rows;
        let block = self.source.read(episode, 0..rows, Halo::default())?;
        let runs = self.runs(&block);
        let mut parts = Vec::with_capacity(runs.len());
        // Runs of one length go through the simulator together.
        for group in runs.chunk_by(|a, b| a.len() == b.len()).flat_map(|same| same.chunks(GROUP)) {
            let mut options = self.rollout.clone();
            options.horizon = group[0].len();
            let windows: Vec<Window<'_>> =
                group.iter().map(|run| Window::new(&block, Start { episode, row: run.start }, &self.map)).collect();
            let done = self.simulator.simulate(self.source, &windows.iter().collect::<Vec<_>>(), &options);
            parts.extend(group.iter().zip(done).map(|(run, trajectory)| self.part(&block, run, trajectory)));
        }
        Ok(parts)
    }

    /// The runs of an episode as `start..last row reached`.
    fn runs(&self, block: &Block) -> Vec<Range<usize>> {
        let history = self.simulator.history();
        let gaps = |column: usize| -> Vec<usize> {
            let values = block.column(self.map[column]);
            (0..values.len()).filter(|&row| !values[row].is_finite()).collect()
        };
        let states: Vec<Vec<usize>> = self.simulator.states.iter().map(|state| gaps(state.column)).collect();
        let recorded: Vec<(Vec<usize>, i64, i64)> = self
            .simulator
            .recorded
            .iter()
            .map(|&(column, most, least)| (gaps(column), i64::from(most), i64::from(least)))
            .collect();
        let rows = block.rows;
        let mut runs = Vec::new();
        let mut at = history.max(self.first);
        while at + 1 < rows {
            // The first gap at or behind a row ends what looks at that row.
            let next_gap = |gaps: &[usize], row: usize| gaps.get(gaps.partition_point(|&g| g < row)).copied();
            let started = states.iter().all(|gaps| next_gap(gaps, at - history).is_none_or(|gap| gap > at));
            let last = recorded.iter().fold(rows as i64 - 1, |last, (gaps, most, least)| {
                let first = (at as i64 - most).max(0) as usize;
                let end = next_gap(gaps, first).unwrap_or(rows) as i64;
                // Step k looks at rows start + k - most ..= start + k - least.
                last.min(end + least)
            });
            let last = usize::try_from(last).unwrap_or(0).min(at.saturating_add(self.limit));
            if started && last > at {
                runs.push(at..last);
                at = last;
            } else {
                at += 1;
            }
        }
        runs
    }

    fn part(&self, block: &Block, run: &Range<usize>, trajectory: Trajectory) -> Part {
        let width = self.outputs.len();
        let mut sums = vec![OutputSum::default(); width];
        for (state, (output, sum)) in self.outputs.iter().zip(&mut sums).enumerate() {
            let geometry = &self.simulator.geometry;
            let recorded = |s: usize| &block.column(self.map[self.outputs[s].column])[run.start..=run.end];
            let measured = recorded(state);
            let difference =
                |step: usize, b: &dyn Fn(usize) -> f64| geometry.difference(state, |s| recorded(s)[step], b);
            for (step, &y) in measured.iter().enumerate().skip(1).filter(|(_, y)| y.is_finite()) {
                let predicted =
                    |s: usize| if step <= trajectory.steps() { trajectory.state(step)[s] } else { f64::NAN };
                sum.push(
                    y,
                    difference(step, &predicted),
                    difference(step, &|s| recorded(s)[0]),
                    output.mean.map(|mean| difference(step, &|_| mean)),
                );
            }
        }
        let outcome = FreeRunOutcome {
            start: trajectory.start,
            steps: run.len(),
            end: trajectory.end,
            lost_at: (trajectory.end != End::Horizon).then(|| run.start + trajectory.steps() + 1),
            left_domain: trajectory.left_domain.map(|step| run.start + step),
            outputs: sums.iter().map(OutputSum::errors).collect(),
        };
        Part { outcome, sums, trajectory }
    }
}
