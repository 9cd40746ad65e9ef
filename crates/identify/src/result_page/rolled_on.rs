//! Simulations over a stretch of a recording, each begun at a recorded state, and where they part from it (Fig. 7 of Buchan, Haldane, Fearing, "Automatic
//! Identification of Dynamic Piecewise Affine Models for a Running Robot").

use std::ops::Range;

use fleetfoot_data::{EpisodeId, Halo, Source};
use fleetfoot_dynamics::{End, Predicted, Predictor, PredictorWorkspace, RolloutOptions, Start, Starts, Trajectory};
use fleetfoot_library::Unary;
use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Chart, Figure, Lines, Part, Series, Stroke,
    words::{self, count, seconds},
};

use super::Judged;
use crate::{Dataset, Error, RolledOut};

/// Simulations that are drawn one behind the other, and steps of each that are: of one model, and of each of several.
const SIMULATIONS: usize = 4;
const DRAWN: [usize; 2] = [60, 25];
/// Models that a figure shows, states that have one, and figures that stand unfolded.
const MODELS: usize = 4;
const STATES: usize = 3;
const SHOWN: usize = 2;

/// What simulations are asked for.
pub(super) struct Wanted<'a> {
    /// That of the models before this one.
    pub(super) stretch: Option<&'a Stretch>,
    /// Whether there are several models on the page.
    pub(super) several: bool,
}

/// Where simulations are begun, in the rows of an episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Stretch {
    episode: EpisodeId,
    /// Steps of each, and the rows between those that are drawn.
    horizon: usize,
    stride: usize,
    /// Ascending, and as far apart as is said by [`every`].
    starts: Vec<usize>,
}

/// A model's simulations on a stretch, at the rows that are drawn.
pub(super) struct RolledOn {
    pub(super) stretch: Stretch,
    /// The episode's name, and whether the model was trained on it.
    name: String,
    trained: bool,
    /// Seconds since the start of the episode.
    time: Vec<f64>,
    states: Vec<State>,
    /// Where simulations left the range of the training rows, and where they ended early: places among the drawn ones.
    left: Vec<usize>,
    ended: Vec<usize>,
    /// Regions of the first partition, as they were recorded and as they were simulated, where there are several.
    regions: Option<[Vec<f64>; 2]>,
}

/// A state over the stretch.
struct State {
    name: String,
    unit: String,
    recorded: Vec<f64>,
    simulated: Vec<f64>,
}

/// From one start to the next: the drawn rows of a simulation, and one between it and the next.
fn every(horizon: usize, stride: usize) -> usize {
    (horizon / stride + 2) * stride
}

impl Stretch {
    /// About the middle one of the starts that were simulated on logs which did not train the model, or on any where all did: chosen before anybody has seen how good they are.
    fn of(model: &Model, rows: &Dataset, rolled: &RolledOut, horizon: usize, several: bool) -> Option<Self> {
        let outcomes = || rolled.rollouts.outcomes.iter().map(|outcome| outcome.start);
        let trained = rows.trained(model);
        let held: Vec<Start> = outcomes().filter(|start| !trained.contains(&start.episode)).collect();
        let own: Vec<Start> = if held.is_empty() { outcomes().collect() } else { held };
        let middle = own.get(own.len() / 2)?;
        // Between two starts that could be simulated there is room for others.
        let here = || own.iter().filter(|start| start.episode == middle.episode).map(|start| start.row);
        let stride = horizon.div_ceil(DRAWN[usize::from(several)]);
        let apart = every(horizon, stride);
        let before = (middle.row - here().min()?) / apart;
        let after = (here().max()? - middle.row) / apart;
        let behind = after.min(SIMULATIONS - 1 - before.min(SIMULATIONS / 2));
        let first = middle.row - apart * before.min(SIMULATIONS - 1 - behind);
        let last = middle.row + apart * behind;
        let starts = (first..=last).step_by(apart).collect();
        Some(Self { episode: rows.episodes()[middle.episode].id, horizon, stride, starts })
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
    /// Simulates a model on a stretch: that of the models before it, where it is there, else one of its own. `rolled` is what was simulated of it before.
    pub(super) fn of(
        model: &Model,
        rows: &Dataset,
        rolled: &RolledOut,
        wanted: &Wanted<'_>,
        long: &RolloutOptions,
        roll: impl Fn(&Starts, &RolloutOptions) -> Result<Result<RolledOut, String>, Error>,
    ) -> Result<Option<Self>, Error> {
        let there = |stretch: &&Stretch| {
            stretch.horizon == long.horizon && rows.episodes().iter().any(|episode| episode.id == stretch.episode)
        };
        let own = || Stretch::of(model, rows, rolled, long.horizon, wanted.several);
        let Some(stretch) = wanted.stretch.filter(there).cloned().or_else(own) else { return Ok(None) };
        let Some(episode) = rows.episodes().iter().position(|episode| episode.id == stretch.episode) else {
            return Ok(None);
        };
        let starts = stretch.starts.iter().map(|&row| Start { episode, row }).collect();
        let mut kept = long.clone();
        kept.keep = true;
        let Ok(found) = roll(&Starts::At(starts), &kept)? else { return Ok(None) };
        let mut on = Self::recorded(model, rows, episode, stretch, &found.rollouts.states)?;
        found.rollouts.trajectories.iter().for_each(|trajectory| on.take(model, trajectory));
        Ok(Some(on))
    }

    /// What was recorded on the stretch.
    fn recorded(
        model: &Model,
        rows: &Dataset,
        episode: usize,
        stretch: Stretch,
        states: &[String],
    ) -> Result<Self, Error> {
        let view = rows.view()?;
        let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
        let several = model.latents.first().is_some_and(|own| model.partitions[own.partition].rule.count() > 1);
        let predictor = if several { Some(Predictor::new(model, &names)?) } else { None };
        let halo = predictor.as_ref().map_or_else(Halo::default, Predictor::halo);
        let block = view.read(episode, stretch.rows(), halo)?;
        let start = view.episodes()[episode].start;
        let drawn = || (0..block.rows).step_by(stretch.stride);
        let time: Vec<f64> = drawn().map(|row| (block.stamps()[row] - start) as f64 * 1e-9).collect();
        let nothing = vec![f64::NAN; time.len()];
        let state = |name: &String| {
            let (own, place) = (model.column(name)?, names.iter().position(|column| column == name)?);
            let values = block.core(place);
            let values = if model.columns[own].angle { unwrapped(values) } else { values.to_vec() };
            Some(State {
                name: name.clone(),
                unit: model.columns[own].unit.clone().unwrap_or_default(),
                recorded: drawn().map(|row| values[row]).collect(),
                simulated: nothing.clone(),
            })
        };
        let states = states.iter().filter_map(state).collect();
        let regions = predictor.map(|predictor| {
            let mut found = Predicted::default();
            predictor.predict(&block, 0..block.rows, &mut PredictorWorkspace::default(), &mut found);
            [drawn().map(|row| region(found.region[row])).collect(), nothing.clone()]
        });
        let trained = rows.trained(model).contains(&episode);
        let name = view.episodes()[episode].name.clone();
        Ok(Self { stretch, name, trained, time, states, left: Vec::new(), ended: Vec::new(), regions })
    }

    /// Takes what was simulated from one of the starts.
    fn take(&mut self, model: &Model, trajectory: &Trajectory) {
        let (start, stride) = (trajectory.start.row, self.stretch.stride);
        for step in (0..=trajectory.steps()).step_by(stride) {
            let place = self.stretch.place(start, step);
            for (state, &value) in self.states.iter_mut().zip(trajectory.state(step)) {
                let angle = model.column(&state.name).is_some_and(|own| model.columns[own].angle);
                let recorded = state.recorded[place];
                state.simulated[place] = if angle { recorded + Unary::Wrap.apply(value - recorded) } else { value };
            }
            if let (Some([_, simulated]), Some(&own)) = (&mut self.regions, trajectory.regions.get(step)) {
                simulated[place] = region(own);
            }
        }
        let drawn = |step: usize| self.stretch.place(start, step.min(trajectory.steps()));
        self.left.extend(trajectory.left_domain.map(drawn));
        self.ended.extend((trajectory.end != End::Horizon).then(|| drawn(trajectory.steps())));
    }

    /// Where the model's simulations of a state are marked.
    fn marks(&self, state: &State, name: &str, several: bool) -> Vec<Series> {
        let of = |what: &str| if several { format!("{name} {what}") } else { what.to_owned() };
        let marked = |what: &str, places: &[usize], stroke| {
            let mut values = vec![f64::NAN; self.time.len()];
            places.iter().for_each(|&place| values[place] = state.simulated[place]);
            let any = values.iter().any(|value| value.is_finite());
            any.then(|| Series::line(of(what), self.time.clone(), values).looks(stroke))
        };
        let left = marked("left its range", &self.left, Stroke::Marks);
        let ended = marked("ended early", &self.ended, Stroke::HollowMarks);
        left.into_iter().chain(ended).collect()
    }
}

fn region(own: u32) -> f64 {
    if own == u32::MAX { f64::NAN } else { f64::from(own) }
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

/// The states over the stretch, and the regions of the best model.
pub(super) fn parts(judged: &[Judged<'_>]) -> Vec<Part> {
    let all: Vec<(&str, &RolledOn)> =
        judged.iter().filter_map(|one| Some((one.name, one.on_stretch.as_ref()?))).collect();
    let Some((_, first)) = all.first() else { return Vec::new() };
    // On other rows there is nothing to compare.
    let same: Vec<(&str, &RolledOn)> =
        all.iter().filter(|(_, own)| own.stretch == first.stretch).take(MODELS).copied().collect();
    let best = super::best(judged);
    let shown = shown(best.model, &first.states);
    let mut figures: Vec<Part> =
        shown.into_iter().enumerate().map(|(place, state)| Part::Figure(in_time(&same, place, state))).collect();
    figures.extend(best.on_stretch.as_ref().and_then(|own| own.visited(best.name, judged.len() > 1)).map(Part::Figure));
    if figures.len() > SHOWN {
        let rest = figures.split_off(SHOWN);
        figures.push(Part::Fold(format!("{} over the same stretch", count(rest.len(), "more figure")), rest));
    }
    figures
}

/// The states that have a figure: one that a fitted equation advances and one that a given equation does, as in the paper a velocity and an angle, and so on in turn.
fn shown<'a>(model: &Model, states: &'a [State]) -> Vec<&'a State> {
    let is_fitted = |state: &&State| model.fitted().any(|equation| equation.subject == state.name);
    let (fitted, given): (Vec<&State>, Vec<&State>) = states.iter().partition(is_fitted);
    let most = fitted.len().max(given.len());
    let turns = (0..most).flat_map(|turn| [fitted.get(turn), given.get(turn)]);
    turns.flatten().copied().take(STATES).collect()
}

/// A state as it was recorded, and as the models go on from it.
fn in_time(models: &[(&str, &RolledOn)], place: usize, own: &State) -> Figure {
    let (_, first) = models[0];
    let mut series = vec![Series::line("recorded", first.time.clone(), own.recorded.clone()).looks(Stroke::Measured)];
    let several = models.len() > 1;
    for (name, model) in models {
        let Some(state) = model.states.iter().find(|other| other.name == own.name) else { continue };
        let name = if several { (*name).to_owned() } else { "simulated".to_owned() };
        series.push(Series::line(name.clone(), model.time.clone(), state.simulated.clone()));
        series.extend(model.marks(state, &name, several));
    }
    let mut axis = Axis::of(own.name.clone(), own.unit.clone());
    axis.range = near(&own.recorded, series.iter().flat_map(|series| &series.y));
    let chart = Lines::new(Axis::of("time since the start of the log", "s"), axis, series);
    let steps = first.stretch.horizon;
    let long = first.time.get(steps / first.stretch.stride).map_or(f64::NAN, |end| end - first.time[0]);
    let trained: Vec<String> =
        models.iter().filter(|(_, own)| own.trained).map(|(name, _)| (*name).to_owned()).collect();
    let held = match trained.len() {
        0 if several => "which trained none of these models".to_owned(),
        0 => "which did not train the model".to_owned(),
        _ if several => format!("which trained {}", words::series(&trained, 4)),
        _ => "which trained the model".to_owned(),
    };
    let caption = format!(
        "{} of {steps} steps ({}), each begun at the recorded state, over the recording of {}, {held}. Filled marks: there it left the range of the training rows; hollow \
         ones: it ended early. The stretch is about the middle of all simulations, whatever their errors; what goes farther from the recording than it varies is cut.",
        count(first.stretch.starts.len(), "simulation"),
        seconds(long),
        first.name
    );
    Figure::new(
        format!("simulated-in-time-{}", place + 1),
        format!("{} recorded and simulated", own.name),
        caption,
        Chart::Lines(chart),
    )
}

/// The range of an axis on which a recording can be seen: simulations that go far beyond it are cut.
fn near<'a>(recorded: &[f64], all: impl Iterator<Item = &'a f64>) -> Option<[f64; 2]> {
    let extent = |values: &mut dyn Iterator<Item = &'a f64>| {
        let finite = values.filter(|value| value.is_finite());
        finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &v| [low.min(v), high.max(v)])
    };
    let finite = recorded.iter().copied().filter(|value| value.is_finite());
    let [low, high] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    let room = high - low;
    let [least, most] = extent(&mut { all });
    (room > 0.0).then(|| {
        let ends = [least.max(low - room), most.min(high + room)];
        let margin = 0.04 * (ends[1] - ends[0]);
        [ends[0] - margin, ends[1] + margin]
    })
}

impl RolledOn {
    /// Regions that the recording and the simulations were in.
    fn visited(&self, name: &str, several: bool) -> Option<Figure> {
        let [recorded, simulated] = self.regions.as_ref()?;
        let line = |name: &str, values: &[f64]| Series::line(name, self.time.clone(), values.to_vec());
        let series =
            vec![line("recorded", recorded).looks(Stroke::Measured), line("simulated", simulated).looks(Stroke::Steps)];
        let chart = Lines::new(
            Axis::of("time since the start of the log", "s"),
            Axis::of("region, in the order of the model", ""),
            series,
        );
        let of = if several { format!(" of {name}") } else { String::new() };
        let caption = format!(
            "Regions{of} in which the recorded states of {} lie, and those in which the simulated states do: where they differ the simulation takes other equations than the \
             recording asks for.",
            self.name
        );
        Some(Figure::new("simulated-regions", "Regions recorded and simulated", caption, Chart::Lines(chart)))
    }
}
