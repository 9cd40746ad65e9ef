//! Values that are no measurements: gross errors, stuck and saturated stretches.

use std::{collections::BTreeSet, ops::Range};

use crate::{Lambda, SignalError, Smoothed, Spline, error::check, smooth};

/// The standard deviation of a normal distribution, of its median absolute deviation.
const DEVIATIONS: f64 = 1.482_602_218_505_602;

/// The noise falls below this share of what it was when the penalty was chosen: it is chosen anew.
const CHOOSE_ANEW: f64 = 0.9;

/// Rows to either side, at most, of which only the worst is left out at a time.
const FARTHEST: usize = 100;

/// A share of the measurements that is no longer a few gross errors.
const MOST: f64 = 0.2;

/// Robust deviations beyond which a value is a gross error, of its neighbours and of the whole record.
const GROSS: f64 = 6.0;

/// Rows to either side that tell what is usual around a row.
const NEIGHBOURS: usize = 5;

/// The share of the measurements that the curve must leave free, so that there is a noise to measure by.
const LEAST: f64 = 0.02;

/// Rows in a row, left out, from which on it is asked whether those beside them are the errors.
const RUN: usize = 3;

/// Noises of a difference of neighbours beyond which a step is a jump.
const JUMP: f64 = 6.0;

/// Largest ratio of the heights of two jumps that count as there and back.
const BACK: f64 = 2.0;

/// By how much the noise may grow when a burst is left out in place of what surrounds it.
const NO_WORSE: f64 = 1.05;

/// A channel smoothed without its gross errors.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejected {
    /// The spline through the remaining rows.
    pub smoothed: Smoothed,
    /// Rows that are left out, in order.
    pub rows: Vec<usize>,
    /// Splines that were fitted to find them.
    pub passes: usize,
    /// True if the search was given up and no row is left out, for one of three reasons. It would leave out a fifth of
    /// the measurements. The noise without them would be larger than with them. The curve goes through nearly every
    /// measurement. The outliers are then motion, with jumps, and no errors of the sensor.
    pub gave_up: bool,
}

/// Smooths a channel, leaves out the measurements that lie more than `sigmas` standard deviations off the curve, and goes on until there are none.
///
/// The residual of a row is measured against its own deviation, noise * sqrt((1 - h) / w), h its share in the hat matrix: an error that drags the curve along is
/// not hidden by it. Of neighbours within two bandwidths only the worst is left out at a time, as it is what bends the curve away from the others. The penalty
/// is chosen anew whenever the noise has fallen by a tenth, and at the end. Then rows that the last curve expects after all are taken back, once.
///
/// A burst of errors that are alike, as of a marker that was taken for another, bends the curve to itself, and the good rows about it stand out. So where runs are left out, the search is made once more without what lies between a jump
/// and the jump back beside them, and that is what is left out if it is no more rows and the noise without them is no greater.
///
/// # Errors
/// Those of [`smooth`]; `sigmas` that is not positive.
pub fn reject(
    times: &[f64],
    values: &[f64],
    weights: Option<&[f64]>,
    spline: Spline,
    lambda: Lambda,
    sigmas: f64,
) -> Result<Rejected, SignalError> {
    check(sigmas > 0.0, "sigmas", sigmas, "a number of standard deviations must be positive")?;
    let channel = Channel { times, values, weights, spline, lambda, sigmas };
    let mut search = Search::default();
    let with_all = smooth(times, values, weights, spline, lambda)?;
    let most = (MOST * with_all.measured as f64) as usize;
    let mut smoothed = search.run(&channel, values.to_vec(), with_all.clone(), most)?;
    let bursts = bursts(values, &search.rows);
    if !bursts.is_empty() && search.rows.len() <= most {
        let mut without = values.to_vec();
        bursts.iter().for_each(|&row| without[row] = f64::NAN);
        let mut again = Search { rows: bursts.into_iter().collect(), ..Search::default() };
        // Too few rows may be left, where the record is short.
        if let Ok(start) = smooth(times, &without, weights, spline, lambda) {
            let other = again.run(&channel, without, start, most)?;
            search.passes += again.passes;
            if again.rows.len() <= search.rows.len() && other.noise <= NO_WORSE * smoothed.noise {
                (search.rows, smoothed) = (again.rows, other);
            }
        }
    }
    // A curve through nearly every measurement knows no noise that anything could stand out of.
    let rest = smoothed.measured as f64 - smoothed.freedom;
    if search.rows.len() > most || smoothed.noise > with_all.noise || rest < LEAST * smoothed.measured as f64 {
        return Ok(Rejected { smoothed: with_all, rows: Vec::new(), passes: search.passes + 1, gave_up: true });
    }
    Ok(Rejected { smoothed, rows: search.rows.into_iter().collect(), passes: search.passes + 1, gave_up: false })
}

/// Rows between a jump and the jump back, where rows are left out in runs beside one another: what a search may have taken for motion. The rows are few, as many as the search compares.
fn bursts(values: &[f64], left_out: &BTreeSet<usize>) -> Vec<usize> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for &row in left_out {
        match runs.last_mut() {
            Some(run) if run.end == row => run.end += 1,
            _ => runs.push(row..row + 1),
        }
    }
    let limit = JUMP * std::f64::consts::SQRT_2 * noise_of_differences(values);
    // The highest step from the row before a run to the one behind it, and the row that it leads to.
    let jump = |run: &Range<usize>| {
        let steps = run.start.max(1)..(run.end + 1).min(values.len());
        let steps = steps.map(|row| (row, values[row] - values[row - 1])).filter(|(_, step)| !step.is_nan());
        steps.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).filter(|(_, step)| step.abs() > limit)
    };
    let jumps: Vec<(usize, f64)> = runs.iter().filter(|run| run.len() >= RUN).filter_map(jump).collect();
    let mut rows = Vec::new();
    let mut from = 0;
    for pair in jumps.windows(2) {
        let [(first, there), (end, back)] = [pair[0], pair[1]];
        let are_opposite = there * back < 0.0 && there.abs() < BACK * back.abs() && back.abs() < BACK * there.abs();
        if first >= from && are_opposite && end - first <= FARTHEST {
            rows.extend(first..end);
            from = end;
        }
    }
    rows
}

/// Channel to search, with its settings.
#[derive(Clone, Copy)]
struct Channel<'a> {
    times: &'a [f64],
    values: &'a [f64],
    weights: Option<&'a [f64]>,
    spline: Spline,
    lambda: Lambda,
    sigmas: f64,
}

/// Progress of the search.
#[derive(Default)]
struct Search {
    /// The values, NaN where they are left out.
    kept: Vec<f64>,
    rows: BTreeSet<usize>,
    passes: usize,
}

impl Search {
    /// Searches from values of which some may be left out already, and the curve through them.
    fn run(
        &mut self,
        channel: &Channel<'_>,
        kept: Vec<f64>,
        mut smoothed: Smoothed,
        most: usize,
    ) -> Result<Smoothed, SignalError> {
        self.kept = kept;
        self.leave_out(channel, &mut smoothed, most)?;
        if self.take_back(channel, &smoothed) {
            smoothed = self.smooth(channel, channel.lambda)?;
            self.leave_out(channel, &mut smoothed, most)?;
        }
        Ok(smoothed)
    }

    fn smooth(&mut self, channel: &Channel<'_>, lambda: Lambda) -> Result<Smoothed, SignalError> {
        self.passes += 1;
        smooth(channel.times, &self.kept, channel.weights, channel.spline, lambda)
    }

    /// Leaves rows out until none stands out under the penalty that is chosen without them, or more than `most` are out.
    fn leave_out(&mut self, channel: &Channel<'_>, smoothed: &mut Smoothed, most: usize) -> Result<(), SignalError> {
        let mut chosen_at = smoothed.noise;
        let mut is_chosen = true;
        while self.rows.len() <= most {
            let worst = channel.worst(smoothed, &self.kept);
            if worst.is_empty() && is_chosen {
                break;
            }
            is_chosen = worst.is_empty() || smoothed.noise < CHOOSE_ANEW * chosen_at;
            worst.iter().for_each(|&row| self.kept[row] = f64::NAN);
            self.rows.extend(worst);
            let lambda = if is_chosen { channel.lambda } else { Lambda::Given(smoothed.lambda) };
            *smoothed = self.smooth(channel, lambda)?;
            if is_chosen {
                chosen_at = smoothed.noise;
            }
        }
        Ok(())
    }

    /// Takes rows back that are where the curve expects them; whether there were any.
    fn take_back(&mut self, channel: &Channel<'_>, smoothed: &Smoothed) -> bool {
        let expected = |&row: &usize| {
            let deviation = channel.noise(smoothed, row).hypot(smoothed.deviations[0][row]);
            (channel.values[row] - smoothed.derivatives[0][row]).abs() <= channel.sigmas * deviation
        };
        let back: Vec<usize> = self.rows.iter().copied().filter(expected).collect();
        for row in &back {
            self.rows.remove(row);
            self.kept[*row] = channel.values[*row];
        }
        !back.is_empty()
    }
}

impl Channel<'_> {
    /// The deviation of a row's error of measurement.
    fn noise(&self, smoothed: &Smoothed, row: usize) -> f64 {
        smoothed.noise / self.weights.map_or(1.0, |weights| weights[row]).sqrt()
    }

    /// Size of a row's residual in its deviations; 0 where nothing was measured.
    fn score(&self, smoothed: &Smoothed, values: &[f64], row: usize) -> f64 {
        let noise = self.noise(smoothed, row);
        let share = (smoothed.deviations[0][row] / noise).powi(2);
        let deviation = noise * (1.0 - share).max(f64::EPSILON).sqrt();
        let score = ((values[row] - smoothed.derivatives[0][row]) / deviation).abs();
        if score.is_finite() { score } else { 0.0 }
    }

    /// Rows that stand out, and more than their neighbours.
    fn worst(&self, smoothed: &Smoothed, values: &[f64]) -> Vec<usize> {
        // A curve through all points has no noise to measure against.
        if smoothed.measured as f64 - smoothed.freedom < 1.0 {
            return Vec::new();
        }
        let scores: Vec<f64> = (0..values.len()).map(|row| self.score(smoothed, values, row)).collect();
        let times = self.times;
        let period = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let bandwidth = (smoothed.lambda * period).powf(0.5 / self.spline.states() as f64) / period;
        let reach = ((2.0 * bandwidth).ceil() as usize).clamp(1, FARTHEST);
        let stands_out = |&row: &usize| {
            let around = row.saturating_sub(reach)..(row + reach + 1).min(scores.len());
            // The first of equals.
            let is_less = |other| scores[other] < scores[row] || (scores[other] == scores[row] && other >= row);
            scores[row] > self.sigmas && around.clone().all(is_less)
        };
        (0..scores.len()).filter(stands_out).collect()
    }
}

/// Rows that lie more than `sigmas` robust deviations (1.4826 median absolute deviations) off the median of the `2 reach + 1` rows around them (Hampel, 1974), and more than `floor`
/// times `sigmas`, which keeps the steps of a quantised channel at rest. NaN are no values.
///
/// # Errors
/// `sigmas` or `reach` that are not positive.
pub fn hampel(values: &[f64], reach: usize, sigmas: f64, floor: f64) -> Result<Vec<usize>, SignalError> {
    check(sigmas > 0.0, "sigmas", sigmas, "a number of standard deviations must be positive")?;
    check(reach > 0, "reach", 0.0, "a window must reach one row or more to either side")?;
    // A window that reaches farther holds all values.
    let reach = reach.min(values.len());
    let mut window = Vec::with_capacity((2 * reach + 1).min(values.len()));
    let mut stands_out = |row: usize| {
        let around = row.saturating_sub(reach)..(row + reach + 1).min(values.len());
        window.clear();
        window.extend(values[around].iter().filter(|value| !value.is_nan()));
        let Some(middle) = median(&mut window) else { return false };
        window.iter_mut().for_each(|value| *value = (*value - middle).abs());
        let scale = DEVIATIONS * median(&mut window).unwrap_or(0.0);
        (values[row] - middle).abs() > sigmas * scale.max(floor)
    };
    Ok((0..values.len()).filter(|&row| stands_out(row)).collect())
}

/// Rows that no motion explains: off their neighbours by Hampel's rule, as [`hampel`] with five rows to either side and the noise of the differences for a floor, and off the whole record by as
/// many of its own robust deviations. A peak of the motion is one of both at most: its neighbours rise with it, or the record has others like it. NaN are no values.
///
/// # Errors
/// None: those of [`hampel`] are of its settings, which are given here.
pub(crate) fn gross_errors(values: &[f64]) -> Result<Vec<usize>, SignalError> {
    let mut measured: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    let Some(middle) = median(&mut measured) else { return Ok(Vec::new()) };
    measured.iter_mut().for_each(|value| *value = (*value - middle).abs());
    let far = GROSS * DEVIATIONS * median(&mut measured).unwrap_or(0.0);
    let mut rows = hampel(values, NEIGHBOURS, GROSS, noise_of_differences(values))?;
    rows.retain(|&row| (values[row] - middle).abs() > far);
    Ok(rows)
}

/// The standard deviation of the noise of a channel, from its second differences: those of motion are small beside those of noise at the rates of sensors. By their median, so that gross
/// errors do not count; 0 for a channel at rest.
pub fn noise_of_differences(values: &[f64]) -> f64 {
    let mut second: Vec<f64> = values
        .windows(3)
        .map(|rows| (rows[0] - 2.0 * rows[1] + rows[2]).abs())
        .filter(|difference| !difference.is_nan())
        .collect();
    DEVIATIONS * median(&mut second).unwrap_or(0.0) / 6.0_f64.sqrt()
}

/// The middle value, or the mean of the two middle ones; the values change their order.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let n = values.len();
    if n == 0 {
        return None;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 {
        return Some(upper);
    }
    below.iter().copied().max_by(f64::total_cmp).map(|lower| 0.5 * (lower + upper))
}

/// Runs of one value, over more than `longest` rows: a sensor that no longer measures repeats its last value.
pub fn stuck(values: &[f64], longest: usize) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut first = 0;
    for row in 1..=values.len() {
        if row == values.len() || values[row] != values[first] {
            if row - first > longest.max(1) {
                runs.push(first..row);
            }
            first = row;
        }
    }
    runs
}

/// Rows at or beyond the ends of a sensor's range.
pub fn saturated(values: &[f64], low: f64, high: f64) -> Vec<usize> {
    (0..values.len()).filter(|&row| values[row] <= low || values[row] >= high).collect()
}

/// Equal values in a row from which on a jump behind them is looked at.
const HANG: usize = 6;

/// Typical steps beyond which a step is no motion of a moment.
const FAR: f64 = 8.0;

/// Runs of six equal values and more behind which comes a step of more than eight typical ones (the median of those that are not zero): what a sensor looks like that hangs while the machine moves on. At rest a
/// sensor goes on by a usual step, and a channel that is held between samples has jumps that are usual.
pub fn hangs(values: &[f64]) -> Vec<Range<usize>> {
    let mut steps: Vec<f64> =
        values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0).collect();
    let Some(typical) = median(&mut steps) else { return Vec::new() };
    let goes_on =
        |run: &Range<usize>| run.end < values.len() && (values[run.end] - values[run.start]).abs() > FAR * typical;
    stuck(values, HANG - 1).into_iter().filter(goes_on).collect()
}
