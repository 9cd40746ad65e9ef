//! Measured and predicted over time, and how errors are spread.

use fleetfoot_data::Episode;
use fleetfoot_dynamics::Predicted;
use fleetfoot_model::Model;
use fleetfoot_report::{Axis, Bins, Chart, Figure, Lines, Part, Section, Series, Stroke, words::count};

use super::{
    coverage::Coverage,
    logs::Seen,
    passed::Passed,
    residuals::{self, Leftover},
    transitions,
};

/// The section's address.
pub(super) const ID: &str = "rows";
/// Targets that are drawn.
const TARGETS: usize = 6;
/// Of these, targets that stand unfolded.
const SHOWN: usize = 2;
/// Targets whose errors are drawn over the columns.
const OVER: usize = 4;
/// Bins along the time of a log, for targets that stand unfolded and for the others, and along the errors.
const TIMES: [usize; 2] = [160, 80];
const ERRORS: usize = 64;
/// Errors are drawn up to so many standard deviations of the target.
const REACH: f64 = 2.0;

/// One target.
#[derive(Clone)]
pub(super) struct Target {
    pub(super) name: String,
    unit: Option<String>,
    /// Standard deviation over the training rows.
    pub(super) sigma: f64,
    /// Bins a second.
    spans: f64,
    measured: Bins,
    predicted: Bins,
    errors: Bins,
    pub(super) left: Leftover,
}

/// The rows of one log as they were measured and predicted, and the errors of all.
pub(super) fn section(model: &Model, passed: &Passed, seen: &Seen) -> Section {
    let mut parts = Vec::new();
    if seen.episodes.len() > 1 {
        let worst = format!(
            "{} is the log with the largest error; of the others, errors alone are drawn.",
            passed.episode.name
        );
        parts.push(Part::Paragraph(worst));
    }
    let in_time = |(place, target): (usize, &Target)| Part::Figure(target.in_time(place, &passed.episode.name));
    parts.extend(unfolded(passed.targets.iter().enumerate().map(in_time).collect(), "Measured and predicted values"));
    parts.push(Part::Figure(spread(&passed.targets)));
    parts.extend(residuals::in_time(&passed.targets, passed.episode.period).map(Part::Figure));
    let over =
        |(place, target): (usize, &Target)| residuals::over_columns(place, target, &passed.columns).map(Part::Figure);
    parts.extend(unfolded(
        passed.targets.iter().enumerate().take(OVER).filter_map(over).collect(),
        "Errors over the columns",
    ));
    let walked = passed.transitions.as_ref().zip(model.latents.first());
    let walked = walked.and_then(|(counted, latent)| {
        transitions::figure(&model.partitions[latent.partition], counted, passed.episode.period, "logs", "these logs")
    });
    parts.extend(walked.map(Part::Figure));
    Section::new(ID, "Measured and predicted", parts)
}

/// The first parts; the others a click away.
fn unfolded(mut parts: Vec<Part>, what: &str) -> Vec<Part> {
    if parts.len() > SHOWN {
        let rest = parts.split_off(SHOWN);
        parts.push(Part::Fold(format!("{what} of {}", count(rest.len(), "more target")), rest));
    }
    parts
}

/// The targets of a model, before any row, and the log that is drawn over time.
pub(super) fn targets(model: &Model, drawn: &Episode, columns: &[Coverage]) -> Vec<Target> {
    let fitted = model.fitted().take(TARGETS).enumerate();
    let one = |(place, equation): (usize, &fleetfoot_model::Equation)| {
        let variance = model.training.target_covariance.get(fleetfoot_data::packed(place, place));
        // Bins narrower than the rows are apart would be empty here and there.
        let most = TIMES[usize::from(place >= SHOWN)].min(drawn.rows.div_ceil(2)).max(4);
        let time = || Bins::new(most);
        // As many bins whatever the length: the last row is just before the end of the last one.
        let spans = (1.0 - 1e-9) * most as f64 / drawn.duration();
        Target {
            name: equation.label(),
            unit: equation.unit.clone(),
            sigma: variance.map_or(f64::NAN, |variance| variance.sqrt()),
            spans: if spans.is_finite() { spans } else { 1.0 },
            measured: time(),
            predicted: time(),
            errors: Bins::new(ERRORS),
            left: Leftover::new(columns),
        }
    };
    fitted.map(one).collect()
}

impl Target {
    pub(super) fn take(&mut self, place: usize, rows: &Predicted, time: Option<&[f64]>) {
        let values = |values| Predicted::equation(values, rows.rows, place);
        for &error in values(&rows.residual) {
            let share = error / self.sigma;
            if share.abs() < REACH {
                self.errors.add(share, 1.0);
            }
        }
        let Some(time) = time else { return };
        for ((&time, &measured), &predicted) in time.iter().zip(values(&rows.measured)).zip(values(&rows.predicted)) {
            self.measured.add(time * self.spans, measured);
            self.predicted.add(time * self.spans, predicted);
        }
    }

    /// Takes the rows behind these; `goes_on` says whether they follow in the same episode.
    pub(super) fn append(&mut self, other: &Self, goes_on: bool) {
        self.measured.merge(&other.measured);
        self.predicted.merge(&other.predicted);
        self.errors.merge(&other.errors);
        self.left.append(&other.left, goes_on);
    }

    fn in_time(&self, place: usize, log: &str) -> Figure {
        let line = |name: &str, bins: &Bins| {
            let seconds = bins.places().iter().map(|place| place / self.spans).collect();
            Series::line(name, seconds, bins.means()).banded(bins.lows(), bins.highs())
        };
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
    // In bins of one width the heights of the lines can be compared.
    let width = targets.iter().map(|target| target.errors.width()).fold(0.0, f64::max);
    let line = |target: &Target| {
        let errors = target.errors.clone().coarser(width);
        let counts = errors.counts();
        let total = counts.iter().sum::<u64>().max(1) as f64;
        let share = counts.iter().map(|&count| 100.0 * count as f64 / total).collect();
        Series::line(target.name.clone(), errors.places(), share).looks(Stroke::Steps)
    };
    let chart = Lines::new(
        Axis::of("error over the target\u{2019}s standard deviation", ""),
        Axis::of("share of rows", "%").with_zero(),
        targets.iter().map(line).collect(),
    );
    let caption = format!(
        "How one-step errors, measured minus predicted, are spread over all rows, in standard deviations of the training rows\u{2019} target and in at most {ERRORS} bins; errors beyond {REACH} standard deviations are not drawn. A peak that is narrow and at zero is \
         good; one beside it is a bias."
    );
    Figure::new("error-spread", "Spread of the errors", caption, Chart::Lines(chart))
}
