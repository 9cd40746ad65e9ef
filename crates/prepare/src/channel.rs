//! One channel of one piece: its outliers, its curve and its derivatives.

use std::f64::consts::{PI, TAU};

use fleetfoot_signal::{
    Interpolant, Interpolation, Lambda, Sections, SignalError, Smoothed, Spline, anti_alias, better, hampel, hangs,
    noise_of_differences, reject, resampled, saturated, savitzky_golay, smooth, stuck, trend_filter,
};

use crate::{
    grid::{empty_rows, merged},
    options::{ChannelOptions, Method},
    places::Places,
    report::ChannelReport,
};

/// Robust deviations of Hampel's rule.
const HAMPEL: f64 = 6.0;

/// The share of a period by which steps may differ where a filter counts rows.
const UNEVEN: f64 = 0.01;

/// Longest gap of an interpolation, in periods of samples: the gap that a join bridges.
const BRIDGED: f64 = 5.0;

/// Periods between two samples none of which is missing.
const BETWEEN: f64 = 1.5;

/// A prepared channel: every list has a value a row.
pub(crate) struct Curve {
    /// Value, rate, acceleration: as many as the method has.
    pub(crate) derivatives: Vec<Vec<f64>>,
    /// Their standard deviations, where the method knows them.
    pub(crate) deviations: Vec<Vec<f64>>,
    pub(crate) report: ChannelReport,
}

/// A value and its derivatives, each at every row.
type Lists = Vec<Vec<f64>>;

/// A channel of a piece.
pub(crate) struct Channel<'a> {
    pub(crate) name: &'a str,
    pub(crate) angle: bool,
    pub(crate) options: ChannelOptions,
    /// Seconds of the episode at which the channel was sampled, and its samples.
    pub(crate) times: &'a [f64],
    pub(crate) values: &'a [f64],
    /// Seconds of the rows, where these are others.
    pub(crate) rows: Option<&'a [f64]>,
    /// Every n-th row is written.
    pub(crate) decimate: usize,
}

impl Channel<'_> {
    /// Prepares it.
    pub(crate) fn curve(&self) -> Result<Curve, SignalError> {
        let mut report = self.nothing_done();
        let mut values = if self.angle { unwrapped(self.values) } else { self.values.to_vec() };
        self.leave_out(&mut values, &mut report)?;
        let (mut derivatives, mut deviations) = match self.options.method {
            Method::Auto(lambda) => {
                let (spline, smoothed) = self.better(&mut values, lambda, &mut report)?;
                let (mut derivatives, mut deviations) = self.at_rows(&values, smoothed, spline)?;
                derivatives.truncate(1 + self.options.method.rates());
                deviations.truncate(1 + self.options.method.rates());
                (derivatives, deviations)
            }
            Method::Spline(spline, lambda) => {
                let smoothed = self.smoothed(&mut values, spline, lambda, &mut report)?;
                self.at_rows(&values, smoothed, spline)?
            }
            Method::None => (vec![values.clone()], Vec::new()),
            Method::Interpolate(kind) => (self.interpolated(&mut values, kind, &mut report)?, Vec::new()),
            Method::Trend { degree, lambda } => (self.trend(&mut values, degree, lambda, &mut report)?, Vec::new()),
            Method::SavitzkyGolay { .. } | Method::Butterworth { .. } => {
                (self.filtered(values.clone(), &mut report)?, Vec::new())
            }
        };
        self.leave_gaps_empty(&values, derivatives.iter_mut().chain(&mut deviations), &mut report);
        if self.angle {
            derivatives[0].iter_mut().for_each(|angle| *angle = wrapped(*angle));
        }
        for list in derivatives.iter_mut().chain(&mut deviations) {
            *list = list.iter().copied().step_by(self.decimate).collect();
        }
        Ok(Curve { derivatives, deviations, report })
    }

    fn nothing_done(&self) -> ChannelReport {
        ChannelReport {
            channel: self.name.to_owned(),
            method: self.options.method.word().to_owned(),
            topic: None,
            clock: None,
            samples: self.values.len(),
            missing: self.values.iter().filter(|value| value.is_nan()).count(),
            saturated: Places::default(),
            stuck: Places::default(),
            hangs: Places::default(),
            hampel: Places::default(),
            rejected: Places::default(),
            gave_up: false,
            left_empty: Places::default(),
            lambda: None,
            lambda_at_end: false,
            through_all: false,
            noise: None,
            smoothed: 0.0,
        }
    }

    /// Leaves out values that are no measurements, before there is a curve.
    fn leave_out(&self, values: &mut [f64], report: &mut ChannelReport) -> Result<(), SignalError> {
        let leave = |values: &mut [f64], rows: &[usize]| {
            rows.iter().for_each(|&row| values[row] = f64::NAN);
            Places::of(rows, self.times)
        };
        if let Some([low, high]) = self.options.range {
            report.saturated = leave(values, &saturated(self.values, low, high));
        }
        if self.options.stuck > 0 {
            // The first of equal values was measured.
            let rows: Vec<usize> =
                stuck(self.values, self.options.stuck).into_iter().flat_map(|run| run.skip(1)).collect();
            report.stuck = leave(values, &rows);
        } else if self.options.method != Method::None {
            let rows: Vec<usize> = hangs(self.values).into_iter().flat_map(|run| run.skip(1)).collect();
            report.hangs = Places::of(&rows, self.times);
        }
        if self.options.hampel > 0 {
            let floor = noise_of_differences(values);
            report.hampel = leave(values, &hampel(values, self.options.hampel, HAMPEL, floor)?);
        }
        Ok(())
    }

    /// The spline; values that it rejects are taken out.
    fn smoothed(
        &self,
        values: &mut [f64],
        spline: Spline,
        lambda: Lambda,
        report: &mut ChannelReport,
    ) -> Result<Smoothed, SignalError> {
        let smoothed = match self.options.reject {
            None => smooth(self.times, values, None, spline, lambda)?,
            Some(sigmas) => {
                let rejected = reject(self.times, values, None, spline, lambda, sigmas)?;
                rejected.rows.iter().for_each(|&row| values[row] = f64::NAN);
                (report.rejected, report.gave_up) = (Places::of(&rejected.rows, self.times), rejected.gave_up);
                rejected.smoothed
            }
        };
        (report.lambda, report.lambda_at_end) = (Some(smoothed.lambda), smoothed.at_end);
        report.noise = Some(smoothed.noise);
        // The least penalty has a bandwidth of a tenth of a row. What rests has no noise under any.
        let spends_all = smoothed.freedom > 0.5 * smoothed.measured as f64;
        report.through_all = smoothed.at_end && spends_all && smoothed.noise > 0.0;
        report.smoothed = spline.correlation_rows(smoothed.lambda, self.period(), 1.0) * self.period();
        Ok(smoothed)
    }

    /// The better of the two smoothing splines, each with its best penalty and without the values that it rejects, by
    /// their errors on the values that both keep.
    fn better(
        &self,
        values: &mut Vec<f64>,
        lambda: Lambda,
        report: &mut ChannelReport,
    ) -> Result<(Spline, Smoothed), SignalError> {
        let (mut by_quintic, mut of_quintic) = (values.clone(), report.clone());
        let cubic = self.smoothed(values, Spline::Cubic, lambda, report)?;
        let quintic = match self.smoothed(&mut by_quintic, Spline::Quintic, lambda, &mut of_quintic) {
            // Three measurements make a cubic spline.
            Err(SignalError::TooFew { .. }) => None,
            other => Some(other?),
        };
        let keep = |(cubic, quintic): (&f64, &f64)| if quintic.is_nan() { f64::NAN } else { *cubic };
        let both: Vec<f64> = values.iter().zip(&by_quintic).map(keep).collect();
        let chosen = |quintic: &Smoothed| better(self.times, &both, [cubic.lambda, quintic.lambda], lambda);
        let spline = match quintic.as_ref().map(chosen) {
            None | Some(Err(SignalError::TooFew { .. })) => Spline::Cubic,
            Some(spline) => spline?,
        };
        let choice = match (spline, quintic) {
            (Spline::Quintic, Some(quintic)) => {
                (*values, *report) = (by_quintic, of_quintic);
                (Spline::Quintic, quintic)
            }
            _ => (Spline::Cubic, cubic),
        };
        report.method = Method::Spline(choice.0, lambda).word().to_owned();
        Ok(choice)
    }

    /// Leaves out values that a spline rejects, on request.
    fn reject(&self, values: &mut [f64], report: &mut ChannelReport) -> Result<(), SignalError> {
        if self.options.reject.is_some() {
            self.smoothed(values, Spline::Cubic, Lambda::Likelihood, report)?;
            (report.lambda, report.lambda_at_end, report.noise, report.smoothed) = (None, false, None, 0.0);
            report.through_all = false;
        }
        Ok(())
    }

    /// Values and deviations of a spline at the rows: where these are not the samples, they are rows without a measurement for the same spline.
    fn at_rows(&self, values: &[f64], smoothed: Smoothed, spline: Spline) -> Result<(Lists, Lists), SignalError> {
        let Some(rows) = self.rows else { return Ok((smoothed.derivatives, smoothed.deviations)) };
        let all = merged(self.times, values, rows);
        let smoothed_again = smooth(&all.times, &all.values, None, spline, Lambda::Given(smoothed.lambda))?;
        let pick = |list: &Vec<f64>| all.rows.iter().map(|&at| list[at]).collect();
        Ok((
            smoothed_again.derivatives.iter().map(pick).collect(),
            smoothed_again.deviations.iter().map(pick).collect(),
        ))
    }

    /// The curve through every measurement.
    fn interpolated(
        &self,
        values: &mut [f64],
        kind: Interpolation,
        report: &mut ChannelReport,
    ) -> Result<Vec<Vec<f64>>, SignalError> {
        self.reject(values, report)?;
        let mut lists = Vec::from(Interpolant::new(self.times, values, kind)?.all(self.rows.unwrap_or(self.times)));
        lists.truncate(1 + self.options.method.rates());
        // A hundredth of a measurement reaches three steps to either side: the weights of a cubic spline fall by 2 + sqrt(3) a step.
        report.smoothed = 7.0 * self.period();
        Ok(lists)
    }

    /// The curve of few polynomials.
    fn trend(
        &self,
        values: &mut [f64],
        degree: usize,
        lambda: Lambda,
        report: &mut ChannelReport,
    ) -> Result<Vec<Vec<f64>>, SignalError> {
        self.reject(values, report)?;
        let trend = trend_filter(self.times, values, None, degree, lambda)?;
        (report.lambda, report.lambda_at_end, report.noise) = (Some(trend.lambda), trend.at_end, Some(trend.noise));
        let ends = [0].into_iter().chain(trend.borders.iter().copied()).chain([self.times.len() - 1]);
        let ends: Vec<f64> = ends.map(|row| self.times[row]).collect();
        report.smoothed = ends.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        Ok(match self.rows {
            None => trend.derivatives,
            Some(rows) => resampled(self.times, &trend.derivatives, rows, degree == 1),
        })
    }

    /// Rows stay empty where nothing was measured over longer than the curve reaches.
    fn leave_gaps_empty<'b>(
        &self,
        values: &[f64],
        lists: impl Iterator<Item = &'b mut Vec<f64>>,
        report: &mut ChannelReport,
    ) {
        let bridged = match self.options.method {
            Method::None => return,
            // A spline has already filled missing values among the rows.
            Method::SavitzkyGolay { .. } | Method::Butterworth { .. } if self.rows.is_none() => return,
            Method::Interpolate(_) => BRIDGED * self.period(),
            _ if self.rows.is_none() => report.smoothed,
            // Between two samples there is always a curve.
            _ => report.smoothed.max(BETWEEN * self.period()),
        };
        let empty = empty_rows(self.times, values, self.rows.unwrap_or(self.times), bridged);
        for list in lists {
            empty.iter().for_each(|&row| list[row] = f64::NAN);
        }
        report.left_empty = Places::of(&empty, self.rows.unwrap_or(self.times));
    }

    /// Seconds a sample.
    fn period(&self) -> f64 {
        period(self.times)
    }

    /// A filter on even samples; a spline fills missing values, with or without a stamp.
    fn filtered(&self, values: Vec<f64>, report: &mut ChannelReport) -> Result<Vec<Vec<f64>>, SignalError> {
        let counts = self.counts()?;
        let last = counts[counts.len() - 1];
        let period = (self.times[self.times.len() - 1] - self.times[0]) / last.max(1) as f64;
        if last + 1 == values.len() {
            return self.filtered_even(values, period, report);
        }
        let mut grid = vec![f64::NAN; last + 1];
        counts.iter().zip(&values).for_each(|(&count, value)| grid[count] = *value);
        let times: Vec<f64> = (0..=last).map(|count| self.times[0] + period * count as f64).collect();
        let rows = self.rows.unwrap_or(self.times);
        let whole = Channel { times: &times, values: &grid, rows: Some(rows), ..*self };
        whole.filtered_even(grid.clone(), period, report)
    }

    fn filtered_even(
        &self,
        mut values: Vec<f64>,
        period: f64,
        report: &mut ChannelReport,
    ) -> Result<Vec<Vec<f64>>, SignalError> {
        if self.options.reject.is_some() || values.iter().any(|value| value.is_nan()) {
            let curve = self.smoothed(&mut values, Spline::Cubic, Lambda::Likelihood, report)?;
            for (value, smooth) in values.iter_mut().zip(&curve.derivatives[0]) {
                *value = if value.is_nan() { *smooth } else { *value };
            }
        }
        let lists = match self.options.method {
            Method::SavitzkyGolay { window, degree } => {
                report.smoothed = report.smoothed.max(window as f64 * period);
                let derivative = |k| savitzky_golay(&values, period, window, degree, k);
                (0..=2).map(derivative).collect::<Result<Vec<_>, _>>()?
            }
            Method::Butterworth { order, cutoff } => {
                // The slowest pole's ringing, down to one in a hundred.
                let slowest = TAU * cutoff * (PI / (2 * order) as f64).sin();
                report.smoothed = report.smoothed.max(100.0_f64.ln() / slowest);
                let value = Sections::butterworth(order, cutoff, 1.0 / period)?.zero_phase(&values)?;
                let rate = central(&value, period);
                let acceleration = central(&rate, period);
                vec![value, rate, acceleration]
            }
            _ => vec![values],
        };
        let lists: Vec<Vec<f64>> =
            lists.into_iter().map(|list| self.without_aliases(list, period)).collect::<Result<_, _>>()?;
        Ok(match self.rows {
            None => lists,
            Some(rows) => resampled(self.times, &lists, rows, false),
        })
    }

    /// Takes out frequencies above the Nyquist frequency of the rows that will be written.
    fn without_aliases(&self, list: Vec<f64>, period: f64) -> Result<Vec<f64>, SignalError> {
        let rows = self.rows.map_or(period, median_step);
        let ratio = self.decimate as f64 * rows / period;
        // Periods that are equal but for what stamps are rounded to are no reason to filter.
        if ratio < 1.0 + UNEVEN { Ok(list) } else { anti_alias(&list, ratio) }
    }

    /// The number of every sample where all are whole periods apart.
    fn counts(&self) -> Result<Vec<usize>, SignalError> {
        let period = median_step(self.times);
        let mut counts = vec![0];
        for (row, pair) in self.times.windows(2).enumerate() {
            let step = pair[1] - pair[0];
            let periods = (step / period).round();
            // The error of a period adds up over a gap.
            if periods < 1.0 || (step - periods * period).abs() > UNEVEN * period * periods {
                return Err(SignalError::Parameter {
                    what: "a step between samples, s,",
                    value: step,
                    expected: "a filter counts samples, which must be whole periods apart; smooth by a spline, or even the stamps out with dejitter = true",
                });
            }
            counts.push(counts[row] + periods as usize);
        }
        Ok(counts)
    }
}

/// Seconds a stamp; stamps are not empty.
fn period(times: &[f64]) -> f64 {
    (times[times.len() - 1] - times[0]) / times.len().saturating_sub(1).max(1) as f64
}

/// The median step between stamps.
pub(crate) fn median_step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 1.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Central differences, to one side at the ends.
fn central(values: &[f64], period: f64) -> Vec<f64> {
    let last = values.len() - 1;
    let slope = |row: usize| {
        let (before, after) = (row.saturating_sub(1), (row + 1).min(last));
        (values[after] - values[before]) / ((after - before) as f64 * period)
    };
    (0..=last).map(slope).collect()
}

/// An angle without its jumps of a turn.
pub(crate) fn unwrapped(values: &[f64]) -> Vec<f64> {
    let (mut last, mut turns) = (f64::NAN, 0.0);
    let next = |&value: &f64| {
        if !value.is_nan() {
            if !last.is_nan() {
                turns -= ((value - last) / TAU).round();
            }
            last = value;
        }
        value + TAU * turns
    };
    values.iter().map(next).collect()
}

/// The angle from -pi to pi.
pub(crate) fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
