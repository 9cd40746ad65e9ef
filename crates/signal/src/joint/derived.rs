//! Detection of sensors whose errors are correlated, such as a rate that was computed from the same encoder.

use std::collections::VecDeque;

use super::{
    Correlation,
    events::{Seen, between},
};
use crate::spline::filter::Posterior;

/// The share of a period by which stamps of one instant may differ, and that of neighbouring instants.
const SAME: [f64; 2] = [0.25, 1e-3];

/// Readings of a sensor that are remembered: delays part what has one stamp by that many events.
const RECENT: usize = 6;

/// Pairs of readings below which nothing is said.
const FEWEST: usize = 50;

/// A reading that was emitted already.
#[derive(Debug, Clone, Copy)]
struct Recent {
    stamp: f64,
    left: f64,
    variance: f64,
}

/// Expected products of the errors of two sensors, at one lag.
#[derive(Debug, Clone, Copy, Default)]
struct Products {
    crossed: f64,
    first: f64,
    second: f64,
    count: usize,
}

impl Products {
    fn correlation(&self) -> f64 {
        self.crossed / (self.first * self.second).sqrt()
    }
}

/// Products of all pairs of sensors at lags of a period of the second: before, none, after.
#[derive(Debug, Clone)]
pub(super) struct Pairs {
    recent: Vec<VecDeque<Recent>>,
    products: Vec<[Products; 3]>,
    /// Of the sensors, s.
    periods: Vec<f64>,
}

impl Pairs {
    pub(super) fn new(periods: Vec<f64>) -> Self {
        let count = periods.len();
        Self { recent: vec![VecDeque::new(); count], products: vec![[Products::default(); 3]; count * count], periods }
    }

    /// Compares a reading with those of other sensors about its stamp. Given all readings, the errors of two are what the state leaves of them plus, in the mean of their product, what is not known of the state.
    pub(super) fn add(&mut self, seen: &Seen<'_>, [sensor, row]: [usize; 2], left: f64, state: &Posterior<3>) {
        let (stamp, slopes) = (seen.run.records[sensor].times[row], &seen.known[sensor].slopes);
        let newest = Recent { stamp, left, variance: between(slopes, &state.covariance, slopes) };
        let count = self.periods.len();
        for other in (0..count).filter(|&other| other != sensor) {
            let shared = between(slopes, &state.covariance, &seen.known[other].slopes);
            for theirs in &self.recent[other] {
                let pair =
                    if sensor < other { (sensor, other, newest, *theirs) } else { (other, sensor, *theirs, newest) };
                let (first, second, a, b) = pair;
                let Some(lag) = lag(b.stamp - a.stamp, self.periods[second]) else { continue };
                let sum = &mut self.products[first * count + second][lag];
                sum.crossed += a.left * b.left + shared;
                sum.first += a.left * a.left + a.variance;
                sum.second += b.left * b.left + b.variance;
                sum.count += 1;
            }
        }
        let recent = &mut self.recent[sensor];
        recent.truncate(RECENT - 1);
        recent.push_front(newest);
    }

    /// Adds what another run says.
    pub(super) fn merge(&mut self, other: &Self) {
        for (product, other) in self.products.iter_mut().flatten().zip(other.products.iter().flatten()) {
            product.crossed += other.crossed;
            product.first += other.first;
            product.second += other.second;
            product.count += other.count;
        }
    }

    /// The greatest correlation of every pair of sensors that share stamps.
    pub(super) fn correlations(&self) -> Vec<Correlation> {
        let count = self.periods.len();
        let of = |at: usize| {
            let lags = self.products[at].iter().filter(|lag| lag.count >= FEWEST);
            let size = |lag: &Products| lag.correlation().abs();
            let most = lags.reduce(|most, lag| if size(lag) > size(most) { lag } else { most })?;
            Some(Correlation {
                first: at / count,
                second: at % count,
                correlation: most.correlation(),
                readings: most.count,
            })
        };
        (0..count * count).filter_map(of).collect()
    }
}

/// 0, 1 or 2 where the second reading is a period before the first, at its instant, or a period after.
fn lag(apart: f64, period: f64) -> Option<usize> {
    let lag = (apart / period).round();
    let off = (apart / period - lag).abs();
    match lag.abs() {
        0.0 => (off < SAME[1]).then_some(1),
        1.0 => (off < SAME[0]).then_some(if lag < 0.0 { 0 } else { 2 }),
        _ => None,
    }
}
