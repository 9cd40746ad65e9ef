//! Residuals of a model: their correlation over time, and with columns.

use fleetfoot_report::{Axis, Chart, Figure, Light, Lines, Panels, Scale, Sentence, Series, words::series};

use crate::{coverage::Coverage, leftover::LAGS, sentence::sentence, target::Target};

const DRAWN: usize = 6;
/// Pairs, and rows a bin, below which a share is uncertain.
const PAIRS: u64 = 30;
/// Share of the errors' variance from which on a column is named in the verdict.
const TELLING: f64 = 0.1;
/// The same of the target's variance: below it the model is good enough whatever its errors go with.
const WORTH: f64 = 0.01;

/// The autocorrelation of the errors of all targets.
pub(crate) fn in_time(targets: &[Target], step: f64) -> Option<Figure> {
    let (unit, scale) = if step > 0.0 { ("s", step) } else { ("rows", 1.0) };
    let line = |target: &Target| {
        let (coefficients, pairs) = (target.left.time.coefficients(), target.left.time.pairs());
        let known = LAGS.iter().zip(coefficients.iter().zip(&pairs)).filter(|(_, (_, pairs))| **pairs >= PAIRS);
        let (x, y): (Vec<f64>, Vec<f64>) = known.map(|(&lag, (&value, _))| (lag as f64 * scale, value)).unzip();
        Series::line(target.name.clone(), x, y)
    };
    let lines: Vec<Series> =
        targets.iter().map(line).filter(|line| line.y.iter().any(|value| value.is_finite())).collect();
    if lines.is_empty() {
        return None;
    }
    let mut x = Axis::of("between the rows", unit);
    x.scale = Scale::Logarithmic;
    let chart = Lines::new(x, Axis::of("autocorrelation of the error", "").between(-1.05, 1.05), lines).level(0.0, "");
    let caption = "Share of an error that is there again later in the log. Near zero everywhere: the residual is noise. Near one for long: the model misses something that changes slowly. About \u{2212}0.5 after one row: the target is a difference of noisy values.";
    Some(Figure::new("error-autocorrelation", "Autocorrelation of the errors", caption, Chart::Lines(chart)))
}

/// Errors of a target over the columns that they go with most.
pub(crate) fn over_columns(place: usize, target: &Target, columns: &[Coverage]) -> Option<Figure> {
    let order = target.left.by_share();
    let column = |place: usize| &columns[target.left.over[place].0];
    let panel = |&(at, _): &(usize, f64)| {
        let (bins, column) = (&target.left.over[at].1, column(at));
        let (mean, spread) = (bins.means(), bins.deviations());
        let ends = |sign: f64| mean.iter().zip(&spread).map(|(mean, spread)| mean + sign * spread).collect();
        let line = Series::line("mean error", bins.places(), mean.clone()).banded(ends(-1.0), ends(1.0));
        let axis = Axis::of(column.name.clone(), column.unit.clone().unwrap_or_default());
        Lines::new(axis, Axis::of("error over the target\u{2019}s standard deviation", ""), vec![line]).level(0.0, "")
    };
    let panels: Vec<Lines> = order.iter().take(DRAWN).map(panel).collect();
    if panels.is_empty() {
        return None;
    }
    let shares: Vec<String> = order
        .iter()
        .take(3)
        .map(|&(column, share)| format!("{} {:.0} %", columns[column].name, 100.0 * share.max(0.0)))
        .collect();
    let caption = format!(
        "Mean one-step error, in standard deviations of the target, over each column; bands are one standard deviation of the errors to both sides. A line that leaves zero shows an effect that the model lacks. Share of the errors\u{2019} variance that goes with a column: {}.",
        series(&shares, 3)
    );
    let title = format!("Errors of {} over the columns", target.name);
    Some(Figure::new(
        format!("error-over-columns-{}", place + 1),
        title,
        caption,
        Chart::Panels(Panels::new(panels).on_one_scale()),
    ))
}

/// Sentence about the column with which errors correlate most, if that is notable: share of the errors, beside the
/// share of the target's variance.
pub(crate) fn finding(targets: &[Target], columns: &[Coverage]) -> Option<Sentence> {
    let most = |target: &Target| {
        let (at, share) = *target.left.by_share().first()?;
        let (column, bins) = &target.left.over[at];
        let of_target = share * bins.deviation().powi(2);
        (share > TELLING && of_target > WORTH)
            .then(|| (target.name.clone(), columns[*column].name.clone(), share, of_target))
    };
    let (target, name, share, of_target) = targets.iter().filter_map(most).max_by(|a, b| a.3.total_cmp(&b.3))?;
    let text = format!(
        "The mean error at each value of {name} makes {:.0} % of the variance of the error of {target}, {:.1} % of that of {target} itself. A function of {name} that the model \
         lacks, or more regions along it, may remove it.",
        100.0 * share,
        100.0 * of_target
    );
    Some(sentence(Light::Doubtful, &format!("Its errors go with {name}."), &text))
}
