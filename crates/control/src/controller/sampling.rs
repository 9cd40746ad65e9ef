//! A controller's clock: evaluation at samples, from delayed measurements.

use std::collections::VecDeque;

/// Stamps closer than this count as equal, s.
const SAME: f64 = 1e-9;

/// Periodic samples of N values that arrive late.
#[derive(Debug, Clone)]
pub struct Sampling<const N: usize> {
    period: f64,
    latency: f64,
    next: f64,
    seen: VecDeque<(f64, [f64; N])>,
}

impl<const N: usize> Sampling<N> {
    /// Samples every `period` seconds from 0 on, each the value of `latency` seconds before.
    pub fn new(period: f64, latency: f64) -> Self {
        Self { period, latency, next: 0.0, seen: VecDeque::new() }
    }

    /// Notes the values at a time that never decreases. When a sample is due, gives the values that it shows: `None` between samples, and
    /// while the latency reaches back before the first values.
    pub fn observe(&mut self, seconds: f64, values: [f64; N]) -> Option<[f64; N]> {
        self.seen.push_back((seconds, values));
        let tick = ((seconds + SAME) / self.period).floor();
        if tick < self.next {
            return None;
        }
        self.next = tick + 1.0;
        let wanted = tick * self.period - self.latency + SAME;
        while self.seen.get(1).is_some_and(|(time, _)| *time <= wanted) {
            self.seen.pop_front();
        }
        self.seen.front().filter(|(time, _)| *time <= wanted).map(|(_, values)| *values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_at_the_period_and_show_the_past() {
        let mut sampling = Sampling::new(0.010, 0.013);
        for k in 0..1000 {
            let shown = sampling.observe(f64::from(k) * 0.001, [f64::from(k)]);
            let due = k % 10 == 0 && k >= 20;
            assert_eq!(shown, due.then(|| [f64::from(k) - 13.0]), "{k}");
        }
    }

    #[test]
    fn steps_longer_than_the_period_sample_at_every_step() {
        let mut sampling = Sampling::new(0.010, 0.0);
        for k in 0..100 {
            assert_eq!(sampling.observe(f64::from(k) * 0.03, [f64::from(k)]), Some([f64::from(k)]));
        }
    }
}
