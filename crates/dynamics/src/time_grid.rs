//! The times of a simulation, checked once: the model knows how long its rows are apart.

use crate::{Error, Stepper};

/// The mean interval may differ from the sampling period by this share: clocks are not exact.
const CLOCK: f64 = 0.01;

/// Times of a refined grid, at most.
const MOST_TIMES: usize = 1 << 28;

/// Times at which a model is simulated ([`Stepper::grid`]).
#[derive(Debug, Clone, PartialEq)]
pub struct TimeGrid {
    times: Vec<f64>,
    /// Sampling periods in each interval, rounded up.
    periods: Vec<usize>,
}

impl TimeGrid {
    /// Seconds, rising; at least one.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.periods.len()
    }

    /// Sampling periods in an interval, rounded up: 1 where the model does not know its period, and for a model that goes by rows.
    pub fn periods(&self, interval: usize) -> usize {
        self.periods[interval]
    }

    /// The shortest interval, seconds; infinite without one.
    pub(crate) fn shortest(&self) -> f64 {
        self.times.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min)
    }

    /// A grid of one interval.
    pub fn interval(&self, interval: usize) -> Self {
        Self { times: self.times[interval..interval + 2].to_vec(), periods: vec![self.periods[interval]] }
    }

    /// The same with no interval longer than a sampling period, and where the times stand in it.
    ///
    /// # Errors
    /// [`Error::Times`] when there would be more times than memory should hold.
    pub fn refined(&self) -> Result<(Self, Vec<usize>), Error> {
        let total = self.periods.iter().fold(0_usize, |sum, periods| sum.saturating_add(*periods));
        if total > MOST_TIMES {
            let problem = format!(
                "it lies {total} sampling periods of the model after the first time; at most {MOST_TIMES} are allowed"
            );
            return Err(Error::Times { place: self.periods.len(), problem });
        }
        let (mut times, mut places) = (vec![self.times[0]], vec![0]);
        for (pair, &parts) in self.times.windows(2).zip(&self.periods) {
            let part = (pair[1] - pair[0]) / parts as f64;
            times.extend((1..parts).map(|k| (k as f64).mul_add(part, pair[0])));
            times.push(pair[1]);
            places.push(times.len() - 1);
        }
        let periods = vec![1; times.len() - 1];
        Ok((Self { times, periods }, places))
    }
}

impl Stepper {
    /// Checks the times of a simulation: finite, rising, and for a model that goes by rows (next values, differences, lags) a row apart.
    ///
    /// # Errors
    /// [`Error::Times`], [`Error::OtherPeriod`].
    pub fn grid(&self, times: Vec<f64>) -> Result<TimeGrid, Error> {
        if times.is_empty() {
            return Err(Error::Times { place: 0, problem: "there is none".into() });
        }
        if let Some(place) = times.iter().position(|time| !time.is_finite()) {
            return Err(Error::Times { place, problem: format!("{} is not a finite number", times[place]) });
        }
        if let Some(place) = (1..times.len()).find(|&place| times[place] <= times[place - 1]) {
            let problem = format!("{} s does not come after {} s", times[place], times[place - 1]);
            return Err(Error::Times { place, problem });
        }
        let period = self.step();
        let known = period > 0.0;
        if let (true, Some(reason)) = (known, self.goes_by_rows()) {
            self.check_rows(&times, reason)?;
            let periods = vec![1; times.len() - 1];
            return Ok(TimeGrid { times, periods });
        }
        // An interval that is a period but for rounding is one.
        let parts = |seconds: f64| if known { (seconds / period - 1e-6).ceil().max(1.0) as usize } else { 1 };
        let periods = times.windows(2).map(|pair| parts(pair[1] - pair[0])).collect();
        Ok(TimeGrid { times, periods })
    }

    /// Why an interval must be a row, where it must.
    fn goes_by_rows(&self) -> Option<&'static str> {
        let mut by_rows = self.states.iter().filter(|state| !state.advance.continuous);
        if let Some(state) = by_rows.next() {
            // Filters stand behind what equations advance.
            let filter = state.advance.lag.is_some();
            return Some(if filter { "its filters go from row to row" } else { "its equations give the next row" });
        }
        (self.history() + self.ahead() > 0).then_some("its equations look back or ahead by rows")
    }

    fn check_rows(&self, times: &[f64], reason: &'static str) -> Result<(), Error> {
        let period = self.step();
        let refused = |place: usize, interval: f64| Err(Error::OtherPeriod { place, interval, period, reason });
        // Stamps jitter; that a row is left out is no jitter.
        for (place, pair) in times.windows(2).enumerate() {
            let interval = pair[1] - pair[0];
            if !(0.5..1.5).contains(&(interval / period)) {
                return refused(place + 1, interval);
            }
        }
        let (first, last) = (times[0], times[times.len() - 1]);
        let mean = (last - first) / (times.len() - 1) as f64;
        // NaN of a single time is no other period.
        if (mean / period - 1.0).abs() > CLOCK { refused(1, mean) } else { Ok(()) }
    }
}
