//! Simulations: their error against the horizon, for all models (Fig. 8 of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise
//! Affine Models for a Running Robot").

use fleetfoot_dynamics::{Estimate, Horizon, reigns};
use fleetfoot_fit::{interval_in_words, spans_in_words};
use fleetfoot_report::{
    Axis, Cell, Chart, Figure, Light, Lines, Part, Section, Sentence, Series, Stroke, Table,
    words::{self, count, number, seconds},
};

use crate::{
    Judged,
    compared::{Compared, is_scored},
    drawn_stretch,
    sentence::{sentence, sentence_of},
};

/// Steps that are drawn: errors grow smoothly, and a page has no room for more.
const POINTS: usize = 60;
/// Models that a figure shows, and states that have a separate figure.
const MODELS: usize = 6;
const STATES: usize = 6;

pub(crate) fn section(judged: &[Judged<'_>]) -> Option<Section> {
    let curves: Vec<(&str, &Horizon)> =
        judged.iter().filter_map(|one| Some((one.name, one.horizon()?))).filter(|(_, h)| is_scored(h)).collect();
    let (_, first) = *curves.first()?;
    let mut parts: Vec<Part> =
        Compared::of(judged).and_then(Result::ok).map(|compared| Part::Figure(scores(&compared))).into_iter().collect();
    parts.push(Part::Table(useful(&curves)));
    parts.push(Part::Table(paths(&curves)));
    let states: Vec<Part> = (0..first.states.len())
        .filter(|&state| curves.iter().any(|(_, horizon)| rmse(horizon, state).iter().any(|value| value.is_finite())))
        .take(STATES)
        .map(|state| Part::Figure(by_state(judged, &curves, first, state)))
        .collect();
    parts.extend(drawn_stretch::parts(judged));
    if !states.is_empty() {
        parts.push(Part::Fold("Error of each state against the horizon".into(), states));
    }
    Some(Section::new("simulation", "Simulated", parts))
}

/// Steps that are drawn, evenly spread, the first and the last among them.
fn drawn_steps(steps: usize) -> Vec<usize> {
    let points = steps.min(POINTS);
    (0..points).map(|point| if points < 2 { 0 } else { point * (steps - 1) / (points - 1) }).collect()
}

fn line(name: &str, horizon: &Horizon, scores: &[Estimate], steps: &[usize]) -> Series {
    let values = |of: fn(&Estimate) -> f64| steps.iter().map(|&step| of(&scores[step])).collect::<Vec<f64>>();
    let time = steps.iter().map(|&step| horizon.time[step]).collect();
    Series::line(name, time, values(|score| score.value)).banded(values(|score| score.low), values(|score| score.high))
}

/// The models' errors by horizon, and the baselines', which are the same for all.
fn scores(compared: &Compared<'_>) -> Figure {
    let (_, first) = compared.models[0];
    let errors = compared.errors();
    let curves = compared.models.iter().zip(&errors).take(MODELS);
    let mut series: Vec<Series> =
        curves.map(|((name, h), errors)| line(name, h, errors, &drawn_steps(h.time.len()))).collect();
    let steps = drawn_steps(first.time.len());
    series.extend(compared.baselines().iter().map(|(baseline, errors)| {
        let mut line = line(baseline.name(), first, errors, &steps).looks(Stroke::Reference);
        line.band = None;
        line
    }));
    let values = series.iter().flat_map(|series| series.y.iter().copied()).collect::<Vec<_>>().into_iter();
    let chart = Lines::new(
        Axis::of("time since the start of the simulation", "s"),
        Axis::of(compared.axis(), "").with_zero().spread(values),
        series,
    );
    let caption = match compared.shared.as_slice() {
        [] => caption_of_scores(first),
        names => format!(
            "Root of the mean squared difference between simulated and recorded {}, in standard deviations of the training rows: lower is better. Other states are not those \
             of all models. Simulations that end early count with their last state.",
            words::series(names, STATES)
        ),
    };
    Figure::new("score-by-horizon", "Error against the horizon", caption, Chart::Lines(chart))
}

fn caption_of_scores(first: &Horizon) -> String {
    format!(
        "Distance between simulated and recorded states under the covariance of the training states, mean over the simulations: lower is better. Bands: {}. \
         Simulations that end early count with their last state.",
        interval_in_words(&first.basis)
    )
}

/// When each model is better than the baselines.
fn useful(curves: &[(&str, &Horizon)]) -> Table {
    let mut table =
        Table::new("Horizons at which a simulation is better than every baseline.", ["model", "better than", "when"]);
    for (name, horizon) in curves {
        let steps = horizon.time.len();
        let when = |spans: &[_]| if spans.is_empty() { "at no step".to_owned() } else { spans_in_words(spans, steps) };
        let rows = std::iter::once(("every baseline".to_owned(), when(&horizon.useful.spans)));
        let rows = rows.chain(horizon.better.iter().map(|(baseline, spans)| (baseline.name().to_owned(), when(spans))));
        for (baseline, when) in rows {
            table = table.row([(*name).to_owned(), baseline, when].map(Cell::Text));
        }
    }
    table
}

/// Explained variance, direction and distance of whole simulations, of each model and of its baselines.
fn paths(curves: &[(&str, &Horizon)]) -> Table {
    let mut table = Table::new(
        "Whole simulations: explained variance (1 less the share of the measured variance that is left in the error), mean cosine of the errors of angles, \
         and of a path (with a position) the mean distance, the mean cosine between its increments and the recorded ones, the relative growth of the distance \
         and the distance of dynamic time warping.",
        ["simulated", "score", "value", "95 % interval"],
    );
    for (name, horizon) in curves.iter().take(MODELS) {
        let model = std::iter::once(((*name).to_owned(), &horizon.model));
        let baselines = horizon.baselines.iter().map(|(which, score)| (format!("{name}: {}", which.name()), score));
        for (who, score) in model.chain(baselines) {
            let variances = horizon.states.iter().zip(&score.explained_variance);
            let mut scores: Vec<(String, Estimate)> = variances
                .filter(|_| who == *name)
                .map(|(state, estimate)| (format!("explained variance of {state}"), *estimate))
                .collect();
            scores.extend(
                score.average_orientation.map(|estimate| ("cosine of the errors of angles".to_owned(), estimate)),
            );
            if let (Some(distance), Some(path)) = (&score.displacement_summary, &score.path) {
                scores.push(("displacement".to_owned(), distance.average));
                scores.push(("alignment".to_owned(), path.average_alignment));
                scores.push(("propagated error".to_owned(), path.propagated_error));
                scores.push(("time warping".to_owned(), path.warping_distance));
            }
            for (what, estimate) in scores.into_iter().filter(|(_, estimate)| estimate.value.is_finite()) {
                let interval = match estimate.low.is_finite() {
                    true => format!("{} to {}", number(estimate.low), number(estimate.high)),
                    false => "-".to_owned(),
                };
                table = table.row([who.clone(), what, number(estimate.value), interval].map(Cell::Text));
            }
        }
    }
    table
}

fn rmse(horizon: &Horizon, state: usize) -> Vec<f64> {
    horizon.model.rmse.iter().skip(state).step_by(horizon.states.len().max(1)).copied().collect()
}

/// The error of one state, in its unit.
fn by_state(judged: &[Judged<'_>], curves: &[(&str, &Horizon)], first: &Horizon, state: usize) -> Figure {
    let name = &first.states[state];
    let unit = judged.iter().find_map(|one| one.model.unit_of(name)).unwrap_or_default().to_owned();
    let bands = curves.iter().take(MODELS).filter_map(|(model, horizon)| {
        let place = horizon.states.iter().position(|other| other == name)?;
        let (steps, errors) = (drawn_steps(horizon.time.len()), rmse(horizon, place));
        let time = steps.iter().map(|&step| horizon.time[step]).collect();
        Some(Series::line(*model, time, steps.iter().map(|&step| errors[step]).collect()))
    });
    let series: Vec<Series> = bands.collect();
    let values = series.iter().flat_map(|series| series.y.iter().copied()).collect::<Vec<_>>().into_iter();
    let axis = Axis::of(format!("RMSE of {name}"), unit).with_zero().spread(values);
    let chart = Lines::new(Axis::of("time since the start of the simulation", "s"), axis, series);
    let caption = format!("Root of the mean squared difference between simulated and recorded {name}.");
    Figure::new(format!("rmse-by-horizon-{}", state + 1), format!("Error of {name}"), caption, Chart::Lines(chart))
}

/// The model whose simulations err least at their end, where they are compared.
pub(crate) fn best_at_the_end<'a>(judged: &'a [Judged<'_>]) -> Option<&'a str> {
    let compared = Compared::of(judged)?.ok()?;
    let errors = compared.errors();
    let last = reigns(&errors.iter().map(Vec::as_slice).collect::<Vec<_>>()).pop()?;
    Some(compared.models[last.model].0)
}

/// Sentence about the best of several models in simulation, by horizon.
pub(crate) fn best(judged: &[Judged<'_>]) -> Option<Sentence> {
    let compared = match Compared::of(judged)? {
        Ok(compared) => compared,
        Err(reason) => {
            let text = format!("{}.", sentence_of(&reason).trim_end_matches('.'));
            return Some(sentence(Light::Plain, "Simulated, the models are not compared.", &text));
        }
    };
    let curves = &compared.models;
    let (_, first) = *curves.first()?;
    let errors = compared.errors();
    let lists: Vec<&[Estimate]> = errors.iter().map(Vec::as_slice).collect();
    let reigns = reigns(&lists);
    let sentences = reigns.iter().map(|reign| {
        let (from, to) = (seconds(first.time[reign.first - 1]), seconds(first.time[reign.last - 1]));
        let when = if reign.first == reign.last { format!("at {from}") } else { format!("from {from} to {to}") };
        format!("{} {when}", curves[reign.model].0)
    });
    let sentences: Vec<String> = sentences.collect();
    let last = reigns.last()?;
    let text = format!(
        "{}. {} at the end: {}; {} each.",
        sentences.join(", "),
        compared.quantity(),
        curves
            .iter()
            .zip(&lists)
            .map(|((name, _), list)| format!("{name} {}", number(list.last().map_or(f64::NAN, |e| e.value))))
            .collect::<Vec<_>>()
            .join(", "),
        count(
            judged.iter().filter_map(Judged::rolled).map(|rolled| rolled.rollouts.outcomes.len()).max().unwrap_or(0),
            "simulation"
        ),
    );
    let head = if reigns.len() == 1 {
        format!("Simulated, {} is best at every step.", curves[last.model].0)
    } else {
        format!("Simulated, the best model depends on the horizon; {} is best at its end.", curves[last.model].0)
    };
    Some(sentence(Light::Plain, &head, &text))
}
