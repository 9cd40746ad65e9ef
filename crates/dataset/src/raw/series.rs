//! Measurements along time, and the straight lines between them.

use std::f64::consts::TAU;

/// Seconds by which two stamps of one row may differ: rounding to nanoseconds.
const SAME: f64 = 4e-9;

/// Periods between two measurements beyond which nothing is known: what a join bridges.
const BRIDGED: f64 = 5.0;

/// Measurements without a pause.
#[derive(Debug, Clone, Default)]
pub(super) struct Series {
    times: Vec<f64>,
    values: Vec<f64>,
    angle: bool,
    widest: f64,
}

impl Series {
    /// Measurements at rising seconds; a missing one is NaN.
    pub(super) fn new(times: Vec<f64>, values: Vec<f64>, angle: bool) -> Self {
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let middle = steps.len() / 2;
        let period = if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
        Self { times, values, angle, widest: BRIDGED * period }
    }

    /// Takes out what was measured from one second to another.
    pub(super) fn leave_out(&mut self, spans: &[[f64; 2]]) {
        for [from, to] in spans {
            let first = self.times.partition_point(|time| *time < from - SAME);
            let end = self.times.partition_point(|time| *time <= to + SAME);
            self.values[first..end.max(first)].fill(f64::NAN);
        }
    }

    /// The value at a second, on the line between its neighbours; NaN before the first, behind the last and over gaps.
    pub(super) fn at(&self, second: f64) -> f64 {
        let next = self.times.partition_point(|time| *time < second - SAME);
        match self.times.get(next) {
            None => return f64::NAN,
            Some(time) if (time - second).abs() <= SAME => return self.values[next],
            Some(_) if next == 0 => return f64::NAN,
            Some(_) => {}
        }
        let [from, to] = [self.times[next - 1], self.times[next]];
        if to - from > self.widest {
            return f64::NAN;
        }
        let step = self.values[next] - self.values[next - 1];
        let step = if self.angle { step - TAU * (step / TAU).round() } else { step };
        self.values[next - 1] + step * (second - from) / (to - from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_at_gaps_and_omissions() {
        let times: Vec<f64> = [0.0, 1.0, 2.0, 3.0, 9.5, 10.5, 11.5].into();
        let mut series = Series::new(times.clone(), times.iter().map(|time| 10.0 * time).collect(), false);
        for (second, value) in [(0.0, 0.0), (0.5, 5.0), (3.0, 30.0), (10.0, 100.0)] {
            assert!((series.at(second) - value).abs() < 1e-9, "{second}");
        }
        assert!([-0.1, 4.0, 9.0, 11.6].into_iter().all(|second| series.at(second).is_nan()));
        series.leave_out(&[[1.0, 1.0]]);
        assert!([0.5, 1.0, 1.5].into_iter().all(|second| series.at(second).is_nan()) && series.at(2.5) == 25.0);
        assert!(Series::default().at(0.0).is_nan());
    }

    #[test]
    fn angles_go_the_short_way() {
        let series = Series::new(vec![0.0, 1.0, 2.0], vec![3.0, -3.0, -2.9], true);
        assert!((series.at(0.5) - std::f64::consts::PI).abs() < 1e-12);
    }
}
