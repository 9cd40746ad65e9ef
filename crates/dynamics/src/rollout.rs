//! Rollouts of a model against a recording: simulated, scored by horizon, beside the baselines.

use std::sync::Arc;

use fleetfoot_data::{Progress, Source, parallel_fold};
use fleetfoot_library::Expr;
use fleetfoot_model::Model;

use crate::{
    End, Error, Horizon, Outside, RolloutOptions, Simulator, Start, Starts, Trajectory,
    controller::Controller,
    horizon::{HorizonScorer, HorizonSums},
    ideal::References,
    trajectories::GROUP,
    window::{Window, read_windows},
};

/// Results of a set of rollouts.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Rollouts {
    /// States that were advanced, in the order of [`Trajectory::states`].
    pub states: Vec<String>,
    /// Columns whose values after a start come from the recording ([`Simulator::replayed`]).
    pub replayed: Vec<String>,
    /// Inputs that a controller drove, in the order of [`Trajectory::inputs`].
    pub driven_inputs: Vec<String>,
    /// One entry a start that was simulated, in the order of the starts.
    pub outcomes: Vec<Outcome>,
    /// Starts left out because a value that they need is missing.
    pub missing: usize,
    /// Treatment of rollouts that left the training range.
    pub outside: Outside,
    /// Errors by horizon.
    pub horizon: Horizon,
    /// The trajectories, if they were to be kept.
    pub trajectories: Vec<Trajectory>,
}

/// Result of one rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Start of the rollout.
    pub start: Start,
    /// End of the rollout.
    pub end: End,
    /// Seconds until its last good state.
    pub seconds: f64,
    /// Seconds until a regressor was first outside the range that its region saw in training.
    pub left_domain: Option<f64>,
}

impl Rollouts {
    /// Rollouts that diverged.
    pub fn diverged(&self) -> usize {
        self.outcomes.iter().filter(|outcome| outcome.end == End::Diverged).count()
    }

    /// Rollouts that met a label not seen in training.
    pub fn without_region(&self) -> usize {
        self.outcomes.iter().filter(|outcome| outcome.end == End::NoRegion).count()
    }

    /// Rollouts that ended where they left the training domain.
    pub fn ended_outside(&self) -> usize {
        self.outcomes.iter().filter(|outcome| outcome.end == End::LeftDomain).count()
    }

    /// Rollouts that left the training domain.
    pub fn left_domain(&self) -> usize {
        self.outcomes.iter().filter(|outcome| outcome.left_domain.is_some()).count()
    }
}

impl Outcome {
    fn new(trajectory: &Trajectory) -> Self {
        Self {
            start: trajectory.start,
            end: trajectory.end,
            seconds: trajectory.time[trajectory.steps()],
            left_domain: trajectory.left_domain.map(|step| trajectory.time[step]),
        }
    }
}

/// Rolls a model out from many starts and scores it against the recording by horizon.
///
/// Columns that depend on simulated states are computed from them. Inputs and the remaining columns
/// ([`Rollouts::replayed`]) come from the recording, held from row to row. Lagged columns start from the recording and
/// go on with simulated values. A trajectory that ends early is scored with its last good state, so that it stays in
/// the mean. Baselines: the null model's rollout, persistence, and constant velocity
/// `x0 + t (x0 - x_previous) / (t0 - t_previous)`.
///
/// # Errors
/// Those of [`Simulator::new`], [`Starts::choose`], of reading, and [`Error::MissingValues`] when no start is usable.
pub fn rollout(
    model: &Model,
    source: &dyn Source,
    starts: &Starts,
    options: &RolloutOptions,
    progress: &dyn Progress,
) -> Result<Rollouts, Error> {
    rollout_beside_raw(model, None, Recorded { source, raw: None }, starts, options, progress)
}

/// [`rollout`] with inputs from a controller that sees the simulated states (II-F of Buchan, Haldane, Fearing); so does the null model's.
///
/// # Errors
/// Those of [`rollout`] and of [`Simulator::driven_by`].
pub fn rollout_closed_loop(
    model: &Model,
    controller: &Arc<dyn Controller>,
    source: &dyn Source,
    starts: &Starts,
    options: &RolloutOptions,
    progress: &dyn Progress,
) -> Result<Rollouts, Error> {
    rollout_beside_raw(model, Some(controller), Recorded { source, raw: None }, starts, options, progress)
}

/// Rows that a model is rolled out on, and their measurements.
#[derive(Clone, Copy)]
pub struct Recorded<'a> {
    /// The rows.
    pub source: &'a dyn Source,
    /// The raw measurements, where the rows are smoothed: the same episodes and rows, NaN where nothing was measured.
    pub raw: Option<&'a dyn Source>,
}

/// [`rollout`], or with a controller [`rollout_closed_loop`], with errors against raw measurements beside those on the rows, where they are given. Starts are those of the rows.
///
/// # Errors
/// Those of [`rollout`] and [`rollout_closed_loop`].
pub fn rollout_beside_raw(
    model: &Model,
    controller: Option<&Arc<dyn Controller>>,
    recorded: Recorded<'_>,
    starts: &Starts,
    options: &RolloutOptions,
    progress: &dyn Progress,
) -> Result<Rollouts, Error> {
    options.validate()?;
    let compiled = |model: &Model| Simulator::for_source(model, recorded.source, options.step);
    let driven = |simulator: Simulator| match controller {
        Some(controller) => simulator.driven_by(Arc::clone(controller)),
        None => Ok(simulator),
    };
    let simulator = driven(compiled(model)?)?;
    // The null model of equations that share latents has no meaning; then there is no such baseline.
    let null = null_model(model).and_then(|model| compiled(&model).ok());
    let null = null.map(driven).transpose()?;
    roll_out(model, &simulator, null.as_ref(), recorded, starts, options, progress)
}

fn roll_out(
    model: &Model,
    simulator: &Simulator,
    null: Option<&Simulator>,
    Recorded { source, raw }: Recorded<'_>,
    starts: &Starts,
    options: &RolloutOptions,
    progress: &dyn Progress,
) -> Result<Rollouts, Error> {
    let needed = simulator.needed_rows(options.horizon);
    let starts = starts.choose(source, options.horizon, needed.before, needed.after)?;
    let map = simulator.column_map(source)?;
    let raw = raw.map(|raw| Ok::<_, Error>((raw, simulator.column_map(raw)?))).transpose()?;
    let references = References::compile(model, simulator, &options.references, source)?;
    let scorer = HorizonScorer::new(model, simulator, options, references)?;
    let mut sums = scorer.empty();
    let (mut outcomes, mut trajectories, mut missing) = (Vec::with_capacity(starts.len()), Vec::new(), 0);
    parallel_fold(
        starts.len().div_ceil(GROUP),
        progress,
        |group| {
            let starts = &starts[group * GROUP..((group + 1) * GROUP).min(starts.len())];
            let blocks = read_windows(source, starts, needed)?;
            let windows = blocks.windows(starts, &map);
            let raw_blocks = raw.as_ref().map(|(raw, _)| read_windows(*raw, starts, needed)).transpose()?;
            let raw_windows =
                raw_blocks.as_ref().zip(raw.as_ref()).map(|(blocks, (_, map))| blocks.windows(starts, map));
            let windows = (windows.as_slice(), raw_windows.as_deref());
            Ok(simulate_and_score(source, simulator, null, &scorer, windows, options))
        },
        |(lost, done, part)| -> Result<(), Error> {
            missing += lost;
            outcomes.extend(done.iter().map(Outcome::new));
            sums.merge(&part);
            if options.keep {
                trajectories.extend(done);
            }
            Ok(())
        },
    )?;
    if outcomes.is_empty() {
        return Err(Error::MissingValues { starts: missing, needed: needed.before + needed.after + 1 });
    }
    Ok(Rollouts {
        states: simulator.states().to_vec(),
        replayed: simulator.replayed(),
        driven_inputs: simulator.driven_inputs().to_vec(),
        horizon: scorer.finish(simulator.states(), &sums),
        outcomes,
        missing,
        outside: options.outside,
        trajectories,
    })
}

/// Simulates the usable ones of these windows. Gives the number of the others, the trajectories and their sums.
fn simulate_and_score(
    source: &dyn Source,
    simulator: &Simulator,
    null: Option<&Simulator>,
    scorer: &HorizonScorer,
    (windows, raw): (&[Window<'_>], Option<&[Window<'_>]>),
    options: &RolloutOptions,
) -> (usize, Vec<Trajectory>, HorizonSums) {
    let chosen: Vec<usize> =
        (0..windows.len()).filter(|&at| simulator.is_complete(&windows[at], options.horizon)).collect();
    let usable: Vec<&Window<'_>> = chosen.iter().map(|&at| &windows[at]).collect();
    let done = simulator.simulate(source, &usable, options);
    let nulls = null.map(|null| null.simulate(source, &usable, options));
    let mut sums = scorer.empty();
    for (i, (window, trajectory)) in usable.iter().zip(&done).enumerate() {
        let time = simulator.times(source, window, options);
        scorer.add(window, &time, trajectory, nulls.as_ref().map(|nulls| &nulls[i]), &mut sums);
        if let Some(raw) = raw {
            scorer.add_raw(&raw[chosen[i]], trajectory, &mut sums);
        }
    }
    (windows.len() - usable.len(), done, sums)
}

/// The model whose fitted right sides are their training means. `None` if a given equation reads a latent, and without
/// fitted equations: that model would be its baseline.
fn null_model(model: &Model) -> Option<Model> {
    model.fitted().next()?;
    let mut null = model.clone();
    let mut means = model.training.target_mean.iter();
    for equation in &mut null.equations {
        if equation.target.is_some() {
            equation.right = Expr::number(*means.next()?);
        } else if equation.right.columns().iter().any(|name| model.latents.iter().any(|latent| latent.name == **name)) {
            return None;
        }
    }
    null.latents.clear();
    null.partitions.clear();
    null.summaries.clear();
    null.libraries.clear();
    Some(null)
}
