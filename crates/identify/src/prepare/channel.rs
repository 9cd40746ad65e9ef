//! One channel of one piece: what is left out, the curve, its derivatives.

use std::f64::consts::{PI, TAU};

use fleetfoot_signal::{
    Lambda, Sections, SignalError, Smoothed, Spline, decimate, hampel, noise_of_differences, reject, saturated,
    savitzky_golay, smooth, stuck,
};

use super::{
    options::{ChannelOptions, Method},
    report::{ChannelReport, Places},
};

/// Robust deviations of Hampel's rule.
const HAMPEL: f64 = 6.0;

/// The share of a period by which steps may differ where a filter counts rows.
const UNEVEN: f64 = 0.01;

/// A prepared channel: every list has a value a row.
pub(super) struct Curve {
    /// Value, rate, acceleration: as many as the method has.
    pub(super) derivatives: Vec<Vec<f64>>,
    /// Their standard deviations, where the method knows them.
    pub(super) deviations: Vec<Vec<f64>>,
    pub(super) report: ChannelReport,
}

/// A channel of a piece.
pub(super) struct Channel<'a> {
    pub(super) name: &'a str,
    pub(super) angle: bool,
    pub(super) options: ChannelOptions,
    /// Seconds of the episode.
    pub(super) times: &'a [f64],
    pub(super) values: &'a [f64],
    /// Every n-th row is written.
    pub(super) decimate: usize,
}

impl Channel<'_> {
    /// Prepares it.
    pub(super) fn curve(&self) -> Result<Curve, SignalError> {
        let mut report = self.nothing_done();
        let mut values = if self.angle { unwrapped(self.values) } else { self.values.to_vec() };
        self.leave_out(&mut values, &mut report)?;
        let (mut derivatives, mut deviations) = match self.options.method {
            Method::Spline(spline, lambda) => {
                let smoothed = self.smoothed(&mut values, spline, lambda, &mut report)?;
                self.leave_gaps_empty(&values, smoothed, &mut report)
            }
            Method::None => (vec![values], Vec::new()),
            filter => (self.filtered(filter, values, &mut report)?, Vec::new()),
        };
        if self.angle {
            derivatives[0].iter_mut().for_each(|angle| *angle = wrapped(*angle));
        }
        for list in derivatives.iter_mut().chain(&mut deviations) {
            *list = list.iter().copied().step_by(self.decimate).collect();
        }
        Ok(Curve { derivatives, deviations, report })
    }

    fn nothing_done(&self) -> ChannelReport {
        let method = match self.options.method {
            Method::Spline(Spline::Quintic, _) => "quintic",
            Method::Spline(..) => "cubic",
            Method::SavitzkyGolay { .. } => "savitzky-golay",
            Method::Butterworth { .. } => "butterworth",
            Method::None => "none",
        };
        ChannelReport {
            channel: self.name.to_owned(),
            method: method.to_owned(),
            missing: self.values.iter().filter(|value| value.is_nan()).count(),
            saturated: Places::default(),
            stuck: Places::default(),
            hampel: Places::default(),
            rejected: Places::default(),
            gave_up: false,
            left_empty: Places::default(),
            lambda: None,
            lambda_at_end: false,
            noise: None,
            smoothed: 0.0,
        }
    }

    /// Leaves out what no sensor measured, before there is a curve.
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
        }
        if self.options.hampel > 0 {
            let floor = noise_of_differences(values);
            report.hampel = leave(values, &hampel(values, self.options.hampel, HAMPEL, floor)?);
        }
        Ok(())
    }

    /// The spline, and what it rejects taken out of the values.
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
                let found = reject(self.times, values, None, spline, lambda, sigmas)?;
                found.rows.iter().for_each(|&row| values[row] = f64::NAN);
                (report.rejected, report.gave_up) = (Places::of(&found.rows, self.times), found.gave_up);
                found.smoothed
            }
        };
        (report.lambda, report.lambda_at_end) = (Some(smoothed.lambda), smoothed.at_end);
        report.noise = Some(smoothed.noise);
        report.smoothed = spline.correlation_rows(smoothed.lambda, self.period(), 1.0) * self.period();
        Ok(smoothed)
    }

    /// Values and deviations of a spline; rows stay empty where nothing was measured over longer than it smooths.
    fn leave_gaps_empty(
        &self,
        values: &[f64],
        smoothed: Smoothed,
        report: &mut ChannelReport,
    ) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let is_long = |run: &std::ops::Range<usize>| {
            let (first, last) = (run.start.saturating_sub(1), run.end.min(self.times.len() - 1));
            self.times[last] - self.times[first] > report.smoothed
        };
        let rows: Vec<usize> = missing_runs(values).into_iter().filter(is_long).flatten().collect();
        let Smoothed { mut derivatives, mut deviations, .. } = smoothed;
        for list in derivatives.iter_mut().chain(&mut deviations) {
            rows.iter().for_each(|&row| list[row] = f64::NAN);
        }
        report.left_empty = Places::of(&rows, self.times);
        (derivatives, deviations)
    }

    fn period(&self) -> f64 {
        (self.times[self.times.len() - 1] - self.times[0]) / (self.times.len() - 1) as f64
    }

    /// A filter on even rows; what is missing comes from a spline.
    fn filtered(
        &self,
        method: Method,
        mut values: Vec<f64>,
        report: &mut ChannelReport,
    ) -> Result<Vec<Vec<f64>>, SignalError> {
        let period = self.even()?;
        if self.options.reject.is_some() || values.iter().any(|value| value.is_nan()) {
            let curve = self.smoothed(&mut values, Spline::Cubic, Lambda::Likelihood, report)?;
            for (value, smooth) in values.iter_mut().zip(&curve.derivatives[0]) {
                *value = if value.is_nan() { *smooth } else { *value };
            }
        }
        let lists = match method {
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
            Method::Spline(..) | Method::None => vec![values],
        };
        lists.into_iter().map(|list| self.without_aliases(list)).collect()
    }

    /// What is above the Nyquist frequency of the rows that will be written is taken out of all rows.
    fn without_aliases(&self, list: Vec<f64>) -> Result<Vec<f64>, SignalError> {
        if self.decimate == 1 {
            return Ok(list);
        }
        let kept = decimate(&list, self.decimate)?;
        let mut rows = vec![f64::NAN; list.len()];
        rows.iter_mut().step_by(self.decimate).zip(kept).for_each(|(row, value)| *row = value);
        Ok(rows)
    }

    /// The period of even rows.
    fn even(&self) -> Result<f64, SignalError> {
        let period = self.period();
        let step = |row: usize| self.times[row] - self.times[row - 1];
        match (1..self.times.len()).find(|&row| (step(row) - period).abs() > UNEVEN * period) {
            None => Ok(period),
            Some(row) => Err(SignalError::Parameter {
                what: "a step between rows, s,",
                value: step(row),
                expected: "a filter counts rows, which must be evenly spaced; smooth by a spline, or even the stamps out with dejitter = true",
            }),
        }
    }
}

/// Runs of rows without a value.
fn missing_runs(values: &[f64]) -> Vec<std::ops::Range<usize>> {
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for row in (0..values.len()).filter(|&row| values[row].is_nan()) {
        match runs.last_mut() {
            Some(last) if last.end == row => last.end += 1,
            _ => runs.push(row..row + 1),
        }
    }
    runs
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
fn unwrapped(values: &[f64]) -> Vec<f64> {
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
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
