//! Simulations over a stretch of a recording, drawn (Fig. 7 of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise Affine Models for a Running
//! Robot").

use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Chart, Figure, Lines, Part, Series, Stroke,
    words::{self, count, seconds},
};

use crate::{
    Judged,
    rolled_on::{RolledOn, State},
};

/// Models that a figure shows, states that have one, and figures that stand unfolded.
const MODELS: usize = 4;
const STATES: usize = 3;
const SHOWN: usize = 2;

/// The states over the stretch, and the regions of the best model.
pub(crate) fn parts(judged: &[Judged<'_>]) -> Vec<Part> {
    let all: Vec<(&str, &RolledOn)> =
        judged.iter().filter_map(|one| Some((one.name, one.on_stretch.as_ref()?))).collect();
    let Some((_, first)) = all.first() else { return Vec::new() };
    // On other rows there is nothing to compare.
    let same: Vec<(&str, &RolledOn)> =
        all.iter().filter(|(_, rolled)| rolled.stretch == first.stretch).take(MODELS).copied().collect();
    let best = super::best(judged);
    let shown = shown(best.model, &first.states);
    let mut figures: Vec<Part> =
        shown.into_iter().enumerate().map(|(place, state)| Part::Figure(in_time(&same, place, state))).collect();
    figures.extend(
        best.on_stretch.as_ref().and_then(|stretch| stretch.visited(best.name, judged.len() > 1)).map(Part::Figure),
    );
    if figures.len() > SHOWN {
        let rest = figures.split_off(SHOWN);
        figures.push(Part::Fold(format!("{} over the same stretch", count(rest.len(), "more figure")), rest));
    }
    figures
}

/// The states that have a figure: alternately one that a fitted equation advances and one that a given equation does,
/// as in the paper a velocity and an angle.
fn shown<'a>(model: &Model, states: &'a [State]) -> Vec<&'a State> {
    let is_fitted = |state: &&State| model.fitted().any(|equation| equation.subject == state.name);
    let (fitted, given): (Vec<&State>, Vec<&State>) = states.iter().partition(is_fitted);
    let most = fitted.len().max(given.len());
    let turns = (0..most).flat_map(|turn| [fitted.get(turn), given.get(turn)]);
    turns.flatten().copied().take(STATES).collect()
}

/// A state as it was recorded, and as the models go on from it.
fn in_time(models: &[(&str, &RolledOn)], place: usize, state: &State) -> Figure {
    let (_, first) = models[0];
    let mut series = vec![Series::line("recorded", first.time.clone(), state.recorded.clone()).looks(Stroke::Measured)];
    let several = models.len() > 1;
    for (name, model) in models {
        let Some(state) = model.states.iter().find(|other| other.name == state.name) else { continue };
        let name = if several { (*name).to_owned() } else { "simulated".to_owned() };
        series.push(Series::line(name.clone(), model.time.clone(), state.simulated.clone()));
        series.extend(model.marks(state, &name, several));
    }
    let mut axis = Axis::of(state.name.clone(), state.unit.clone());
    axis.range = near(&state.recorded, series.iter().flat_map(|series| &series.y));
    let chart = Lines::new(Axis::of("time since the start of the log", "s"), axis, series);
    let steps = first.stretch.horizon;
    let long = first.time.get(steps / first.stretch.stride).map_or(f64::NAN, |end| end - first.time[0]);
    let trained: Vec<String> =
        models.iter().filter(|(_, rolled)| rolled.trained).map(|(name, _)| (*name).to_owned()).collect();
    let held = match trained.len() {
        0 if several => "which trained none of these models".to_owned(),
        0 => "which did not train the model".to_owned(),
        _ if several => format!("which trained {}", words::series(&trained, 4)),
        _ => "which trained the model".to_owned(),
    };
    let caption = format!(
        "{} of {steps} steps ({}), each begun at the recorded state, over the recording of {}, {held}. Filled marks: there it left the training range; hollow \
         ones: it ended early. The stretch is about the middle of all simulations, whatever their errors; a simulation is cut where its distance to the recording exceeds the variation of the recording.",
        count(first.stretch.starts.len(), "simulation"),
        seconds(long),
        first.name
    );
    Figure::new(
        format!("simulated-in-time-{}", place + 1),
        format!("{} recorded and simulated", state.name),
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
    /// Marks on the model's simulations of a state: left the training range, ended early.
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
