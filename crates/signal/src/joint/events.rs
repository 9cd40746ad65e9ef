//! The readings of all sensors of a run in the order of their instants, in units in which numbers are near one.

use super::{JointRun, JointSensor, Quantity, scale::Scale};
use crate::spline::{
    chain::Matrix,
    filter::{Belief, Innovation},
    head::Information,
    smoother::Sequence,
};

/// Position, rate, acceleration.
pub(super) const STATES: usize = 3;

/// The sensor of an event that is an instant at which the state is wanted.
pub(super) const WANTED: u8 = u8::MAX;

/// A reading of a sensor, or an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Event {
    pub(super) sensor: u8,
    pub(super) row: u32,
}

/// Present constants of a sensor, in units of the scale.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) quantity: Quantity,
    /// The variance of its noise, steps and windows aside.
    pub(super) variance: f64,
    /// Variance of a step, a twelfth of its square.
    pub(super) step: f64,
    /// Variance of the curve within the window beyond its curvature.
    pub(super) beyond: f64,
    /// Coefficients of the state in the mean over the window.
    pub(super) slopes: [f64; STATES],
    pub(super) bias: f64,
    /// Seconds from the middle of the averaging window to the stamp of the reading.
    pub(super) late: f64,
}

impl Known {
    /// Constants of a sensor: `variance` and `density` (of the jerk) in units of the scale, `late` in s, `bias` in
    /// units of the sensor.
    ///
    /// The mean of a curve over a window w about a moment has three parts. They are its value there, a 24th of w^2 of
    /// its second derivative, and a term of the jerk. The variance of that term is q w^5 / 16128 for a position and q
    /// w^3 / 320 for a rate. It comes from the chain's increments to either side, integrated over the window.
    pub(super) fn new(sensor: &JointSensor, scale: &Scale, variance: f64, density: f64, delay: f64, bias: f64) -> Self {
        let width = sensor.average / scale.unit;
        let (slopes, beyond) = match sensor.quantity {
            Quantity::Position => ([1.0, 0.0, width * width / 24.0], density * width.powi(5) / 16128.0),
            Quantity::Rate => ([0.0, 1.0, 0.0], density * width.powi(3) / 320.0),
        };
        let step = scale.scaled(sensor.quantity, sensor.resolution);
        Self {
            quantity: sensor.quantity,
            variance,
            step: step * step / 12.0,
            beyond,
            slopes,
            bias: scale.scaled(sensor.quantity, bias),
            late: delay + 0.5 * sensor.average,
        }
    }

    /// The slope of what is measured with respect to time.
    pub(super) fn rate(&self, state: &[f64; STATES]) -> f64 {
        self.slopes[0] * state[1] + self.slopes[1] * state[2]
    }
}

/// For each reading, the number of equal readings in a row, itself included: they share the error of a step.
pub(super) fn shared(values: &[f64]) -> Vec<u32> {
    let mut counts = Vec::with_capacity(values.len());
    for run in values.chunk_by(|a, b| a == b) {
        counts.extend(std::iter::repeat_n(run.len() as u32, run.len()));
    }
    counts
}

/// The events of a run in order.
pub(super) struct Events {
    pub(super) order: Vec<Event>,
    /// The weight of every reading, sensor by sensor; 0 of those that are left out.
    pub(super) weights: Vec<Vec<f64>>,
    /// [`shared`], of sensors that have steps.
    pub(super) shared: Vec<Vec<u32>>,
}

impl Events {
    pub(super) fn new(run: &JointRun<'_>, sensors: &[JointSensor]) -> Self {
        let shared = |(record, sensor): (&super::JointRecord<'_>, &JointSensor)| match sensor.resolution > 0.0 {
            true => shared(record.values),
            false => Vec::new(),
        };
        Self {
            order: Vec::new(),
            weights: run.records.iter().map(|record| vec![1.0; record.values.len()]).collect(),
            shared: run.records.iter().zip(sensors).map(shared).collect(),
        }
    }

    /// Puts the readings in order, those of earlier sensors first where instants are the same, and, where they are `wanted`, the instants of the run after them.
    pub(super) fn sort(&mut self, run: &JointRun<'_>, known: &[Known], wanted: bool) {
        let at: &[f64] = if wanted { run.at } else { &[] };
        let lists: Vec<(u8, &[f64], f64)> = (0_u8..)
            .zip(&run.records)
            .zip(known)
            .map(|((sensor, record), known)| (sensor, record.times, known.late))
            .chain([(WANTED, at, 0.0)])
            .collect();
        let mut next = vec![0_usize; lists.len()];
        // Past its end a list waits for ever.
        let instant = |list: usize, at: usize| lists[list].1.get(at).map_or(f64::INFINITY, |time| time - lists[list].2);
        let mut first: Vec<f64> = (0..lists.len()).map(|list| instant(list, 0)).collect();
        self.order.clear();
        self.order.reserve_exact(lists.iter().map(|(_, times, _)| times.len()).sum());
        loop {
            let earlier = |best: usize, stream: usize| if first[stream] < first[best] { stream } else { best };
            let Some(list) = (0..lists.len()).reduce(earlier) else { return };
            if first[list].is_infinite() {
                return;
            }
            self.order.push(Event { sensor: lists[list].0, row: next[list] as u32 });
            next[list] += 1;
            first[list] = instant(list, next[list]);
        }
    }
}

/// A run as the smoother sees it: its readings, or, of a constant that is sought, how readings depend on it.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) run: &'a JointRun<'a>,
    pub(super) events: &'a Events,
    pub(super) known: &'a [Known],
    pub(super) scale: &'a Scale,
    /// In place of the readings: a column, sensor by sensor; an empty one is of zeros.
    pub(super) column: Option<&'a [Vec<f64>]>,
}

impl Seen<'_> {
    /// Seconds of the run's clock.
    #[inline]
    fn instant(&self, at: usize) -> f64 {
        let Event { sensor, row } = self.events.order[at];
        let (time, late) = match sensor {
            WANTED => (self.run.at[row as usize], 0.0),
            sensor => (self.run.records[sensor as usize].times[row as usize], self.known[sensor as usize].late),
        };
        time - late
    }

    /// The sensor of a reading that counts, its row, and the variance of its error.
    #[inline]
    pub(super) fn reading(&self, at: usize) -> Option<(usize, usize, f64)> {
        let Event { sensor, row } = self.events.order[at];
        if sensor == WANTED {
            return None;
        }
        let (sensor, row) = (sensor as usize, row as usize);
        let weight = self.events.weights[sensor][row];
        (weight > 0.0).then(|| (sensor, row, self.variance(sensor, row) / weight))
    }

    /// The variance of a reading whose weight is one.
    #[inline]
    pub(super) fn variance(&self, sensor: usize, row: usize) -> f64 {
        let known = &self.known[sensor];
        let shared = self.events.shared[sensor].get(row).map_or(0.0, |&count| f64::from(count));
        known.variance + shared * known.step + known.beyond
    }

    /// Right-hand side of a reading: its value, or its column for a constant that is sought.
    #[inline]
    pub(super) fn value(&self, sensor: usize, row: usize) -> f64 {
        match self.column {
            None => {
                let value = self.run.records[sensor].values[row];
                self.scale.of(self.known[sensor].quantity, value) - self.known[sensor].bias
            }
            Some(column) => column[sensor].get(row).copied().unwrap_or(0.0),
        }
    }

    /// Residual of a reading for this mean state.
    #[inline]
    pub(super) fn left(&self, sensor: usize, row: usize, mean: &[f64; STATES]) -> f64 {
        let slopes = &self.known[sensor].slopes;
        self.value(sensor, row) - slopes.iter().zip(mean).map(|(slope, state)| slope * state).sum::<f64>()
    }
}

impl Sequence<STATES> for Seen<'_> {
    fn rows(&self) -> usize {
        self.events.order.len()
    }

    #[inline]
    fn step_to(&self, at: usize) -> f64 {
        (self.instant(at) - self.instant(at - 1)).max(0.0) / self.scale.unit
    }

    #[inline]
    fn learn(&self, at: usize, belief: &mut Belief<STATES>) -> Option<Innovation> {
        let (sensor, row, variance) = self.reading(at)?;
        let (value, known) = (self.value(sensor, row), &self.known[sensor]);
        Some(match known.slopes {
            [1.0, 0.0, 0.0] => belief.measure(value, variance),
            slopes => belief.measure_along(&slopes, value, variance),
        })
    }

    fn begin(&self, at: usize, known: &mut Information<STATES>) -> bool {
        let Some((sensor, row, variance)) = self.reading(at) else { return false };
        known.measure(&self.known[sensor].slopes, self.value(sensor, row), 1.0 / variance);
        true
    }

    fn is_begun(&self, measured: usize, known: &Information<STATES>) -> bool {
        measured >= STATES && known.is_determined()
    }
}

/// h' P k.
pub(super) fn between(h: &[f64; STATES], p: &Matrix<STATES>, k: &[f64; STATES]) -> f64 {
    h.iter().zip(p).map(|(h, row)| h * row.iter().zip(k).map(|(p, k)| p * k).sum::<f64>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_readings_in_a_row_are_counted() {
        assert_eq!(shared(&[1.0, 1.0, 2.0, 1.0, 1.0, 1.0]), [2, 2, 1, 3, 3, 3]);
        assert!(shared(&[]).is_empty());
    }
}
