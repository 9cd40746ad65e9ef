//! Simulations over a stretch of a recording, each begun at a recorded state, and where they part from it (Fig. 7 of Buchan, Haldane, Fearing, "Automatic
//! Identification of Dynamic Piecewise Affine Models for a Running Robot").

use std::ops::Range;

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_dynamics::{End, Predicted, Predictor, PredictorWorkspace, RolloutOptions, Start, Starts, Trajectory};
use fleetfoot_fit::Error;
use fleetfoot_library::Unary;
use fleetfoot_model::Model;
use fleetfoot_run::RolledOut;

use crate::starts::{Place, Recorded};

/// Simulations that are drawn one behind the other, and steps of each that are: of one model, and of each of several.
const SIMULATIONS: usize = 4;
const DRAWN: [usize; 2] = [60, 25];

/// Requested simulations.
pub(crate) struct Wanted<'a> {
    /// That of the models before this one.
    pub(crate) stretch: Option<&'a Stretch>,
    /// True if there are several models on the page.
    pub(crate) several: bool,
    /// Rows that the simulations of the models on the page read beside a start.
    pub(crate) reach: Halo,
    /// Starts of the simulations of the models before this one.
    pub(crate) starts: Option<&'a [Place]>,
}

/// Starts of the simulations, in the rows of an episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Stretch {
    pub(crate) episode: Recorded,
    /// Steps of each, and the rows between those that are drawn.
    pub(crate) horizon: usize,
    pub(crate) stride: usize,
    /// Ascending, at distances by [`every`].
    pub(crate) starts: Vec<usize>,
}

/// A model's simulations on a stretch, at the rows that are drawn.
pub(crate) struct RolledOn {
    pub(crate) stretch: Stretch,
    /// The episode's name, and whether the model was trained on it.
    pub(crate) name: String,
    pub(crate) trained: bool,
    /// Seconds since the start of the episode.
    pub(crate) time: Vec<f64>,
    pub(crate) states: Vec<State>,
    /// Places, among the drawn ones, of simulations that left the training range, and of those that ended early.
    pub(crate) left: Vec<usize>,
    pub(crate) ended: Vec<usize>,
    /// Regions of the first partition, as they were recorded and as they were simulated, where there are several.
    pub(crate) regions: Option<[Vec<f64>; 2]>,
}

/// A state over the stretch.
pub(crate) struct State {
    pub(crate) name: String,
    pub(crate) unit: String,
    pub(crate) recorded: Vec<f64>,
    pub(crate) simulated: Vec<f64>,
}

/// From one start to the next: the drawn rows of a simulation, and one between it and the next.
fn every(horizon: usize, stride: usize) -> usize {
    (horizon / stride + 2) * stride
}

impl Stretch {
    /// The stretch about the middle one of the starts that were simulated on held-out logs, or on any if all logs
    /// trained. It is chosen without regard to its errors.
    fn of(model: &Model, rows: &Dataset, rolled: &RolledOut, horizon: usize, several: bool) -> Option<Self> {
        let outcomes = || rolled.rollouts.outcomes.iter().map(|outcome| outcome.start);
        let trained = rows.trained(model);
        let held: Vec<Start> = outcomes().filter(|start| !trained.contains(&start.episode)).collect();
        let starts: Vec<Start> = if held.is_empty() { outcomes().collect() } else { held };
        let middle = starts.get(starts.len() / 2)?;
        // Between two starts that could be simulated there is room for others.
        let here = || starts.iter().filter(|start| start.episode == middle.episode).map(|start| start.row);
        let stride = horizon.div_ceil(DRAWN[usize::from(several)]);
        let apart = every(horizon, stride);
        let before = (middle.row - here().min()?) / apart;
        let after = (here().max()? - middle.row) / apart;
        let behind = after.min(SIMULATIONS - 1 - before.min(SIMULATIONS / 2));
        let first = middle.row - apart * before.min(SIMULATIONS - 1 - behind);
        let last = middle.row + apart * behind;
        let starts = (first..=last).step_by(apart).collect();
        Some(Self { episode: Recorded::of(&rows.episodes()[middle.episode]), horizon, stride, starts })
    }

    fn rows(&self) -> Range<usize> {
        let last = self.starts.last().copied().unwrap_or_default();
        self.starts.first().copied().unwrap_or_default()..last + self.horizon + 1
    }

    /// The place of a step among the drawn ones.
    fn place(&self, start: usize, step: usize) -> usize {
        (start - self.rows().start + step) / self.stride
    }
}

impl RolledOn {
    /// Simulates a model on a stretch: that of the models before it, if its rows exist, else a separate one. `rolled`:
    /// its earlier simulations.
    pub(crate) fn of(
        model: &Model,
        rows: &Dataset,
        rolled: &RolledOut,
        wanted: &Wanted<'_>,
        long: &RolloutOptions,
        roll: impl Fn(&Starts, &RolloutOptions) -> Result<Result<RolledOut, String>, Error>,
    ) -> Result<Option<Self>, Error> {
        let there =
            |stretch: &&Stretch| stretch.horizon == long.horizon && stretch.episode.among(rows.episodes()).is_some();
        let stretch = || Stretch::of(model, rows, rolled, long.horizon, wanted.several);
        let Some(stretch) = wanted.stretch.filter(there).cloned().or_else(stretch) else { return Ok(None) };
        let Some(episode) = stretch.episode.among(rows.episodes()) else { return Ok(None) };
        let starts = stretch.starts.iter().map(|&row| Start { episode, row }).collect();
        let mut kept = long.clone();
        kept.keep = true;
        let Ok(rollouts) = roll(&Starts::At(starts), &kept)? else { return Ok(None) };
        let mut on = Self::recorded(model, rows, episode, stretch, &rollouts.rollouts.states)?;
        rollouts.rollouts.trajectories.iter().for_each(|trajectory| on.take(model, trajectory));
        Ok(Some(on))
    }

    /// Recorded values on the stretch.
    fn recorded(
        model: &Model,
        rows: &Dataset,
        episode: usize,
        stretch: Stretch,
        states: &[String],
    ) -> Result<Self, Error> {
        let view = rows.view()?;
        let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
        let several = model.latents.first().is_some_and(|latent| model.partitions[latent.partition].rule.count() > 1);
        let predictor = if several { Some(Predictor::new(model, &names)?) } else { None };
        let halo = predictor.as_ref().map_or_else(Halo::default, Predictor::halo);
        let block = view.read(episode, stretch.rows(), halo)?;
        let start = view.episodes()[episode].start;
        let drawn = || (0..block.rows).step_by(stretch.stride);
        let time: Vec<f64> = drawn().map(|row| (block.stamps()[row] - start) as f64 * 1e-9).collect();
        let nothing = vec![f64::NAN; time.len()];
        let state = |name: &String| {
            let (column, place) = (model.column(name)?, names.iter().position(|column| column == name)?);
            let values = block.core(place);
            let values = if model.columns[column].angle { unwrapped(values) } else { values.to_vec() };
            Some(State {
                name: name.clone(),
                unit: model.columns[column].unit.clone().unwrap_or_default(),
                recorded: drawn().map(|row| values[row]).collect(),
                simulated: nothing.clone(),
            })
        };
        let mut states: Vec<State> = states.iter().filter_map(state).collect();
        for (kind, places) in model.rotations_among(&names_of(&states)) {
            let mut parts: Vec<Vec<f64>> = places.iter().map(|&at| std::mem::take(&mut states[at].recorded)).collect();
            kind.turn_on(&mut parts);
            places.iter().zip(parts).for_each(|(&at, part)| states[at].recorded = part);
        }
        let regions = predictor.map(|predictor| {
            let mut predictions = Predicted::default();
            predictor.predict(&block, 0..block.rows, &mut PredictorWorkspace::default(), &mut predictions);
            [drawn().map(|row| region(predictions.region[row])).collect(), nothing.clone()]
        });
        let trained = rows.trained(model).contains(&episode);
        let name = view.episodes()[episode].name.clone();
        Ok(Self { stretch, name, trained, time, states, left: Vec::new(), ended: Vec::new(), regions })
    }

    /// Takes the simulation from one of the starts.
    fn take(&mut self, model: &Model, trajectory: &Trajectory) {
        let (start, stride) = (trajectory.start.row, self.stretch.stride);
        let rotations = model.rotations_among(&names_of(&self.states));
        for step in (0..=trajectory.steps()).step_by(stride) {
            let place = self.stretch.place(start, step);
            for (state, &value) in self.states.iter_mut().zip(trajectory.state(step)) {
                let angle = model.column(&state.name).is_some_and(|column| model.columns[column].angle);
                let recorded = state.recorded[place];
                state.simulated[place] = if angle { recorded + Unary::Wrap.apply(value - recorded) } else { value };
            }
            for (kind, places) in &rotations {
                let mut parts: Vec<f64> = places.iter().map(|&at| self.states[at].simulated[place]).collect();
                kind.nearest(&mut parts, &places.iter().map(|&at| self.states[at].recorded[place]).collect::<Vec<_>>());
                places.iter().zip(parts).for_each(|(&at, part)| self.states[at].simulated[place] = part);
            }
            if let (Some([_, simulated]), Some(&recorded)) = (&mut self.regions, trajectory.regions.get(step)) {
                simulated[place] = region(recorded);
            }
        }
        let drawn = |step: usize| self.stretch.place(start, step.min(trajectory.steps()));
        self.left.extend(trajectory.left_domain.map(drawn));
        self.ended.extend((trajectory.end != End::Horizon).then(|| drawn(trajectory.steps())));
    }
}

fn names_of(states: &[State]) -> Vec<&str> {
    states.iter().map(|state| state.name.as_str()).collect()
}

fn region(label: u32) -> f64 {
    if label == u32::MAX { f64::NAN } else { f64::from(label) }
}

/// Angles without the jumps of a full turn.
fn unwrapped(values: &[f64]) -> Vec<f64> {
    let mut last: Option<f64> = None;
    let next = |&value: &f64| {
        let value = last.map_or(value, |last| last + Unary::Wrap.apply(value - last));
        last = if value.is_finite() { Some(value) } else { last };
        value
    };
    values.iter().map(next).collect()
}
