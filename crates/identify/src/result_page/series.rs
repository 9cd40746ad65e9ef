//! Measured and predicted over time, and how errors are spread, from one pass over the rows.

use fleetfoot_data::Progress;
use fleetfoot_dynamics::{EpisodeScore, Predicted};
use fleetfoot_model::Model;
use fleetfoot_report::{Axis, Bins, Chart, Figure, Lines, Part, Section, Series, Stroke};

use super::logs::Seen;
use crate::{Error, Logs, PredictedRows, Recipe, predict_rows};

/// Targets that are drawn.
const TARGETS: usize = 6;
/// Of these, targets that stand unfolded.
const SHOWN: usize = 2;
/// Bins along the time of a log, and along the errors.
const TIMES: usize = 180;
const ERRORS: usize = 64;
/// Errors are drawn up to so many standard deviations of the target.
const REACH: f64 = 2.0;

/// One target.
struct Target {
    name: String,
    unit: Option<String>,
    /// Standard deviation over the training rows.
    sigma: f64,
    measured: Bins,
    predicted: Bins,
    errors: Bins,
}

/// The rows of the worst log as they were measured and predicted, and the errors of all.
pub(super) fn section(
    model: &Model,
    changes: &Recipe,
    logs: &Logs,
    worst: Option<&EpisodeScore>,
    seen: &Seen,
    progress: &dyn Progress,
) -> Result<Option<Section>, Error> {
    let Some(worst) = worst else { return Ok(None) };
    let Some(episode) = seen.episodes.iter().find(|episode| episode.id == worst.id) else { return Ok(None) };
    let mut targets = targets(model, episode.duration(), episode.rows);
    predict_rows(model, changes, logs, progress, |_, rows| {
        let time = (rows.episode.id == episode.id).then(|| seconds(rows));
        targets.iter_mut().enumerate().for_each(|(place, target)| target.take(place, rows.predicted, time.as_deref()));
        Ok(())
    })?;
    let series = targets.iter().enumerate().map(|(place, target)| Part::Figure(target.in_time(place, &episode.name)));
    let mut parts: Vec<Part> = series.collect();
    if seen.episodes.len() > 1 {
        let worst =
            format!("{} is the log with the largest error; of the others, errors alone are drawn.", episode.name);
        parts.insert(0, Part::Paragraph(worst));
    }
    let shown = parts.len() - targets.len() + SHOWN;
    if parts.len() > shown {
        let rest = parts.split_off(shown);
        parts.push(Part::Fold(format!("{} more targets", rest.len()), rest));
    }
    parts.push(Part::Figure(spread(&targets)));
    Ok(Some(Section::new("rows", "Measured and predicted", parts)))
}

/// Seconds since the start of the episode.
fn seconds(rows: &PredictedRows<'_>) -> Vec<f64> {
    rows.stamps.iter().map(|&stamp| (stamp - rows.episode.start) as f64 * 1e-9).collect()
}

fn targets(model: &Model, duration: f64, rows: usize) -> Vec<Target> {
    let fitted = model.fitted().take(TARGETS).enumerate();
    let one = |(place, equation): (usize, &fleetfoot_model::Equation)| {
        let variance = model.training.target_covariance.get(fleetfoot_data::packed(place, place));
        let time = || Bins::new(0.0, duration, TIMES.min(rows));
        Target {
            name: equation.label(),
            unit: equation.unit.clone(),
            sigma: variance.map_or(f64::NAN, |variance| variance.sqrt()),
            measured: time(),
            predicted: time(),
            errors: Bins::new(-REACH, REACH, ERRORS),
        }
    };
    fitted.map(one).collect()
}

impl Target {
    fn take(&mut self, place: usize, rows: &Predicted, time: Option<&[f64]>) {
        let values = |values| Predicted::equation(values, rows.rows, place);
        for &error in values(&rows.residual) {
            let share = error / self.sigma;
            if share.abs() < REACH {
                self.errors.add(share, 1.0);
            }
        }
        let Some(time) = time else { return };
        for ((&time, &measured), &predicted) in time.iter().zip(values(&rows.measured)).zip(values(&rows.predicted)) {
            self.measured.add(time, measured);
            self.predicted.add(time, predicted);
        }
    }

    fn in_time(&self, place: usize, log: &str) -> Figure {
        let line =
            |name: &str, bins: &Bins| Series::line(name, bins.places(), bins.means()).banded(bins.lows(), bins.highs());
        let series = vec![line("measured", &self.measured).looks(Stroke::Measured), line("predicted", &self.predicted)];
        let value = Axis::of(self.name.clone(), self.unit.clone().unwrap_or_default());
        let chart = Lines::new(Axis::of("time since the start of the log", "s"), value, series);
        let caption = format!(
            "Measured and predicted one step ahead in {log}. Lines are means of {} spans of equal length, bands reach from their \
             least to their largest value.",
            self.measured.counts().len()
        );
        Figure::new(
            format!("target-in-time-{}", place + 1),
            format!("{} in time", self.name),
            caption,
            Chart::Lines(chart),
        )
    }
}

/// Fig. 3 of Buchan, Haldane, Fearing: how errors are spread.
fn spread(targets: &[Target]) -> Figure {
    let line = |target: &Target| {
        let counts = target.errors.counts();
        let total = counts.iter().sum::<u64>().max(1) as f64;
        let share = counts.iter().map(|&count| 100.0 * count as f64 / total).collect();
        Series::line(target.name.clone(), target.errors.places(), share).looks(Stroke::Steps)
    };
    let chart = Lines::new(
        Axis::of("error over the target\u{2019}s standard deviation", "").between(-REACH, REACH),
        Axis::of("share of rows", "%").with_zero(),
        targets.iter().map(line).collect(),
    );
    let caption = format!(
        "How one-step errors, measured minus predicted, are spread over all rows, in standard deviations of the training rows\u{2019} target and in {ERRORS} bins; errors beyond {REACH} standard deviations are not drawn. A peak that is narrow and at zero is \
         good; one beside it is a bias."
    );
    Figure::new("error-spread", "Spread of the errors", caption, Chart::Lines(chart))
}
