//! One-step errors: by target beside the baselines, by distance from the training rows, by log.

use fleetfoot_dynamics::{Baseline, EpisodeScore, TargetScore};
use fleetfoot_fit::interval_in_words;
use fleetfoot_report::{
    Axis, Bars, Cell, Chart, Figure, Light, Lines, Mark, Part, Section, Sentence, Series, Table,
    words::{ratio, series, thousands, unit},
};
use fleetfoot_run::Scored;

use crate::{Judged, judged::interval, sentence::sentence};

/// Targets and models that a figure shows; the tables have all.
const TARGETS: usize = 24;
const MODELS: usize = 6;
/// Logs that stand unfolded, the worst first, and targets that have a column there.
const LOGS: usize = 12;
const COLUMNS: usize = 8;

pub(crate) fn section(judged: &[Judged<'_>]) -> Option<Section> {
    let first = judged.iter().find(|judged| judged.scored().is_some())?;
    let scored = first.scored()?;
    let mut parts = vec![Part::Figure(bars(judged, scored))];
    parts.extend(judged.iter().filter_map(|one| {
        let table = Part::Table(by_target(one.scored()?));
        Some(if judged.len() == 1 { table } else { Part::Fold(format!("{}: errors by target", one.name), vec![table]) })
    }));
    parts.extend(calibration(judged).map(Part::Figure));
    let best = super::best(judged);
    if let Some(scored) = best.scored() {
        let title = if judged.len() > 1 { format!("By log: {}", best.name) } else { "By log".to_owned() };
        parts.push(Part::Heading(title));
        parts.extend(by_log(scored));
    }
    Some(Section::new("one-step", "One step ahead", parts))
}

/// The episode with the largest score.
pub(crate) fn worst(scored: &Scored) -> Option<&EpisodeScore> {
    let known = scored.scores.episodes.iter().filter(|episode| episode.mahalanobis.is_finite());
    known.max_by(|a, b| a.mahalanobis.total_cmp(&b.mahalanobis).then(b.episode.cmp(&a.episode)))
}

/// The targets that all scored models predict: the errors of others say nothing of each other.
pub(crate) fn shared<'a>(judged: &'a [Judged<'_>]) -> Vec<&'a str> {
    let mut scored = judged.iter().filter_map(Judged::scored);
    let names = |scored: &'a Scored| scored.scores.targets.iter().map(|target| target.name.as_str());
    let Some(first) = scored.next() else { return Vec::new() };
    let others: Vec<&Scored> = scored.collect();
    names(first).filter(|name| others.iter().all(|other| names(other).any(|other_name| other_name == *name))).collect()
}

/// Sentence about the model with the least error in the outputs that all models predict.
pub(crate) fn best(judged: &[Judged<'_>]) -> Option<Sentence> {
    let shared = shared(judged);
    let scored: Vec<&Judged<'_>> = judged.iter().filter(|one| one.scored().is_some()).collect();
    if shared.is_empty() && scored.len() > 1 {
        let outputs = scored.iter().map(|one| format!("{} predicts {}", one.name, series(&one.model.outputs(), 4)));
        let text = format!("{}: their errors cannot be compared.", outputs.collect::<Vec<_>>().join(", "));
        return Some(sentence(
            Light::Plain,
            "One step ahead the models are not compared: they have no target in common.",
            &text,
        ));
    }
    let mut order: Vec<(&str, f64)> =
        judged.iter().filter_map(|one| Some((one.name, one.mean_over_null(&shared)?))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (name, least) = *order.first()?;
    let all = scored.iter().all(|one| one.scored().is_some_and(|other| other.scores.targets.len() == shared.len()));
    let what =
        if all { "the targets".to_owned() } else { format!("the targets that all predict ({})", listed(&shared)) };
    let others: Vec<String> = order[1..].iter().map(|(name, mean)| format!("{name} {}", ratio(*mean))).collect();
    let text = format!(
        "Mean over {what} of its mean absolute error over the null model\u{2019}s: {}{}{}.",
        ratio(least),
        if others.is_empty() { "" } else { "; " },
        others.join(", ")
    );
    let light = if least < 1.0 { Light::Good } else { Light::Bad };
    Some(sentence(light, &format!("One step ahead {name} is best."), &text))
}

fn listed(names: &[&str]) -> String {
    series(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>(), 4)
}

/// A baseline's error over the null model's, on the rows on which it is known.
fn over_null(target: &TargetScore, which: Baseline) -> f64 {
    let baseline = target.baselines.iter().find(|score| score.baseline == which);
    baseline.map_or(f64::NAN, |score| score.mae / score.model_mae * target.mae_over_null.value)
}

/// Every target that a model predicts, once.
fn targets<'a>(models: &[&'a Judged<'_>]) -> Vec<&'a TargetScore> {
    let mut all: Vec<&TargetScore> = Vec::new();
    for target in models.iter().filter_map(|one| one.scored()).flat_map(|scored| &scored.scores.targets) {
        if !all.iter().any(|known| known.name == target.name) {
            all.push(target);
        }
    }
    all
}

/// The targets that are drawn: those with the largest errors, in their order.
fn drawn<'a>(targets: &[&'a TargetScore]) -> Vec<&'a TargetScore> {
    let mut order: Vec<usize> = (0..targets.len()).collect();
    order.sort_by(|&a, &b| targets[b].mae_over_null.value.total_cmp(&targets[a].mae_over_null.value).then(a.cmp(&b)));
    order.truncate(TARGETS);
    order.sort_unstable();
    order.into_iter().map(|at| targets[at]).collect()
}

/// Table I of Buchan, Haldane, Fearing, drawn: by target the error over the null model's.
fn bars(judged: &[Judged<'_>], scored: &Scored) -> Figure {
    let models: Vec<&Judged<'_>> = judged.iter().filter(|one| one.scored().is_some()).collect();
    let targets = targets(&models);
    let drawn = drawn(&targets);
    let groups: Vec<String> = drawn.iter().map(|target| target.name.clone()).collect();
    let of = |one: &&Judged<'_>| {
        let targets = one.scored().map_or(&[][..], |scored| &scored.scores.targets);
        // Models of other targets have no bar there.
        let bar = |name: &String| {
            let none = fleetfoot_report::Interval { value: f64::NAN, low: f64::NAN, high: f64::NAN };
            targets.iter().find(|target| target.name == *name).map_or(none, |target| interval(&target.mae_over_null))
        };
        (one.name.to_owned(), groups.iter().map(bar).collect::<Vec<_>>())
    };
    let series: Vec<_> = models.iter().take(MODELS).map(of).collect();
    let mut chart = Bars::new(Axis::of("mean absolute error over the null model\u{2019}s", ""), groups, series);
    for baseline in [Baseline::Persistence, Baseline::ConstantVelocity] {
        let values: Vec<f64> = drawn.iter().map(|target| over_null(target, baseline)).collect();
        if values.iter().any(|value| value.is_finite()) {
            chart.marks.push(Mark { name: baseline.name().to_owned(), values });
        }
    }
    chart.level = Some((1.0, "null model".to_owned()));
    let mut caption = format!(
        "Mean absolute error of one-step predictions over that of the null model, the mean of the training rows: below 1 is better than no model. Whiskers: {}. \
         Marks are baselines; an arrow is beyond the axis.",
        interval_in_words(&scored.scores.basis)
    );
    if drawn.len() < targets.len() {
        caption.push_str(&format!(" Shown are the {} largest errors of {} targets.", drawn.len(), targets.len()));
    }
    if models.len() > MODELS {
        caption.push_str(&format!(" Shown are the first {MODELS} of {} models.", models.len()));
    }
    Figure::new("errors-by-target", "Error by target", caption, Chart::Bars(chart))
}

fn by_target(scored: &Scored) -> Table {
    let head = ["target", "unit", "sigma", "MAE", "RMSE", "bias", "largest", "R\u{b2}", "MAE / null"];
    let caption = "Errors are measured minus predicted, in the target\u{2019}s unit; sigma is its standard deviation over these rows.";
    let mut table = Table::new(caption, head);
    for target in &scored.scores.targets {
        let numbers = [target.deviation, target.mae.value, target.rmse, target.bias, target.max].map(Cell::of);
        let ratios = [target.r2, target.mae_over_null.value].map(|value| Cell::Number(ratio(value)));
        let name = [target.name.clone(), unit(target.unit.as_deref().unwrap_or_default())].map(Cell::Text);
        table = table.row(name.into_iter().chain(numbers).chain(ratios));
    }
    table
}

/// Fig. 6 of Buchan, Haldane, Fearing: errors over the distance from the training rows.
fn calibration(judged: &[Judged<'_>]) -> Option<Figure> {
    let line = |one: &Judged<'_>| {
        let bins = &one.scored()?.scores.calibration;
        if bins.len() < 2 {
            return None;
        }
        let (input, output) = bins.iter().map(|bin| (bin.input, bin.output)).unzip();
        Some(Series::line(one.name, input, output))
    };
    let series: Vec<Series> = judged.iter().filter_map(line).take(MODELS).collect();
    if series.is_empty() {
        return None;
    }
    let chart = Lines::new(
        Axis::of("distance from the middle of the region", "sd"),
        Axis::of("Mahalanobis score of the prediction", "").with_zero(),
        series,
    );
    let caption = "Mean score of bins of equally many rows, over the mean distance of their regressors from the middle of their region, in standard deviations of the training rows. A rising line means that the model is worse far from its training rows, so the distance is a warning.";
    Some(Figure::new("error-by-distance", "Error by distance from the training rows", caption, Chart::Lines(chart)))
}

/// The logs, the worst first.
fn by_log(scored: &Scored) -> Vec<Part> {
    let scores = &scored.scores;
    let mut order: Vec<&EpisodeScore> = scores.episodes.iter().collect();
    order.sort_by(|a, b| b.mahalanobis.total_cmp(&a.mahalanobis).then(a.episode.cmp(&b.episode)));
    let targets = scores.targets.len().min(COLUMNS);
    let table = |episodes: &[&EpisodeScore]| {
        let mut head = vec!["log".to_owned(), "rows".into(), "in training".into(), "Mahalanobis".into()];
        head.extend(scores.targets.iter().take(targets).map(|target| target.name.clone()));
        let mut table = Table::new(
            "By log, the worst first: Mahalanobis score, and mean absolute error over the null model\u{2019}s by target.",
            head,
        );
        for episode in episodes {
            let seen = if episode.in_training { "yes" } else { "no" };
            let name =
                [Cell::Text(episode.name.clone()), Cell::Number(thousands(episode.rows)), Cell::Text(seen.into())];
            let errors =
                std::iter::once(episode.mahalanobis).chain(episode.mae_over_null.iter().take(targets).copied());
            table = table.row(name.into_iter().chain(errors.map(|value| Cell::Number(ratio(value)))));
        }
        Part::Table(table)
    };
    let mut parts = vec![table(&order[..order.len().min(LOGS)])];
    if order.len() > LOGS {
        parts.push(Part::Fold(format!("{} better logs", order.len() - LOGS), vec![table(&order[LOGS..])]));
    }
    parts
}
