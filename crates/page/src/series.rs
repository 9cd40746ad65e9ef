//! Measured and predicted over time, and how errors are spread.

use fleetfoot_model::Model;
use fleetfoot_report::{Axis, Bins, Chart, Figure, Lines, Part, Section, Series, Stroke, words::count};

use crate::{
    logs::Seen,
    passed::Passed,
    residuals,
    target::{ERRORS, REACH, SHOWN, Target},
    transitions,
};

/// The section's address.
pub(crate) const ID: &str = "rows";
/// Targets whose errors are drawn over the columns.
const OVER: usize = 4;

/// The rows of one log as they were measured and predicted, and the errors of all.
pub(crate) fn section(model: &Model, passed: &Passed, seen: &Seen) -> Section {
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
        let described = (&model.partitions[latent.partition], &model.summaries[latent.partition]);
        transitions::figure(described, counted, passed.episode.period, "logs", "these logs")
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

impl Target {
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
