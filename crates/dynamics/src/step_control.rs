//! Lengths of steps, point by point: trial steps, accepted steps, and the next length.
//!
//! Hairer, Norsett and Wanner, "Solving ordinary differential equations I", section II.4. Every point has separate
//! steps, so that its numbers do not depend on its neighbours.

use crate::{Points, Stepper};

/// Tolerance of a simulation's steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Tolerance {
    /// Error of a step over the size of a state.
    pub relative: f64,
    /// Error of a step in the units of each state, beside the relative one. `None`: the relative one times the state's standard deviation in training.
    pub absolute: Option<Vec<f64>>,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { relative: 1e-8, absolute: None }
    }
}

/// The longest step, in sampling periods: longer ones would miss a short event (a pulse of `time()`, a thin region).
const LONGEST: f64 = 10.0;
/// The shortest step, as a share of the sampling period: where the right side jumps, no step meets the tolerance.
const SHORTEST: f64 = 1.0 / 256.0;
/// A step is this share of the one whose error would be just allowed, and changes by these factors at most.
const SAFETY: f64 = 0.9;
const LEAST_FACTOR: f64 = 0.2;
const MOST_FACTOR: f64 = 5.0;

/// The steps of every point.
pub(crate) struct StepControl {
    /// Allowed error of every state: relative, absolute.
    relative: f64,
    absolute: Vec<f64>,
    pub(crate) shortest: f64,
    longest: f64,
    /// States that are integrated.
    pub(crate) continuous: Vec<usize>,
    /// Next step of each point, seconds.
    step: Vec<f64>,
    /// Length of the step that is tried; 0 for a point that tries none.
    pub(crate) tried: Vec<f64>,
    /// Seconds of the interval that each point has behind it.
    pub(crate) elapsed: Vec<f64>,
    /// States x points: where the step begins, where it ends, and the estimated error there.
    pub(crate) present: Vec<f64>,
    pub(crate) trial: Vec<f64>,
    pub(crate) error: Vec<f64>,
    /// Errors of steps that could not be made short enough, over the sizes of the states, summed over the simulation: states x points.
    forced: Vec<f64>,
}

/// Verdict on a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It is tried again, shorter.
    Rejected,
    /// Its error is allowed.
    Accepted,
    /// Its error is not allowed, and it is as short as can be.
    Forced,
}

impl StepControl {
    /// For a simulation whose shortest interval is of so many seconds.
    pub(crate) fn new(stepper: &Stepper, tolerance: &Tolerance, count: usize, interval: f64) -> Self {
        let values = stepper.states.len() * count;
        let period = if stepper.step() > 0.0 { stepper.step() } else { interval };
        let first = period.min(interval);
        let absolute = match &tolerance.absolute {
            Some(absolute) => absolute.clone(),
            None => stepper.states.iter().map(|state| tolerance.relative * state.size()).collect(),
        };
        Self {
            relative: tolerance.relative,
            absolute,
            shortest: SHORTEST * first,
            longest: LONGEST * period,
            continuous: (0..stepper.states.len()).filter(|&s| stepper.states[s].advance.continuous).collect(),
            step: vec![first; count],
            tried: vec![0.0; count],
            elapsed: vec![0.0; count],
            present: vec![0.0; values],
            trial: vec![0.0; values],
            error: vec![0.0; values],
            forced: vec![0.0; values],
        }
    }

    /// The largest sum of errors of steps that could not be made short enough, over the size of the state; 0 if the
    /// tolerance was met.
    pub(crate) fn shortfall(&self) -> f64 {
        self.forced.iter().copied().fold(0.0, f64::max)
    }

    /// The states at the begin of an interval.
    pub(crate) fn begin(&mut self, stepper: &Stepper, points: &Points, seconds: f64) {
        let count = points.count();
        self.elapsed.fill(0.0);
        for (s, state) in stepper.states.iter().enumerate() {
            let x = points.column(state.column, 0);
            self.present[s * count..(s + 1) * count].copy_from_slice(x);
            // A value that is not a number stays so.
            x.iter().zip(&mut self.elapsed).filter(|(x, _)| !x.is_finite()).for_each(|(_, elapsed)| *elapsed = seconds);
        }
    }

    /// Chooses the next step of every point in `asked`. Returns true if there is one to make.
    pub(crate) fn choose(&mut self, seconds: f64, asked: impl Fn(usize) -> bool) -> bool {
        let mut any = false;
        for (b, tried) in self.tried.iter_mut().enumerate() {
            let (rest, step) = (seconds - self.elapsed[b], self.step[b]);
            *tried = match rest {
                rest if rest <= 0.0 || !asked(b) => 0.0,
                rest if step >= rest * (1.0 - 1e-9) => rest,
                // Two equal steps instead of one and a remainder.
                rest if 2.0 * step > rest => 0.5 * rest,
                _ => step,
            };
            any |= *tried > 0.0;
        }
        any
    }

    /// The points that try a step.
    pub(crate) fn active(&self) -> Vec<usize> {
        (0..self.tried.len()).filter(|&b| self.tried[b] > 0.0).collect()
    }

    /// The error of the step of point b over the allowed one; infinite where the step leaves the numbers.
    pub(crate) fn ratio(&self, b: usize) -> f64 {
        let count = self.tried.len();
        self.continuous.iter().map(|s| s * count + b).fold(0.0_f64, |ratio, i| {
            let part = self.error[i] / self.allowed(i);
            // `max` would lose what is not a number.
            if part.is_nan() || !self.trial[i].is_finite() { f64::INFINITY } else { ratio.max(part) }
        })
    }

    /// Takes the step of point b if its error, `ratio` of the allowed one, is allowed, or if the step is no longer than
    /// `shortest`. The next one is as long as an error of this order allows.
    pub(crate) fn judge(
        &mut self,
        stepper: &Stepper,
        b: usize,
        seconds: f64,
        ratio: f64,
        order: f64,
        shortest: f64,
    ) -> Verdict {
        let accepted = ratio <= 1.0 || self.tried[b] <= shortest * (1.0 + 1e-9);
        let factor = (SAFETY * ratio.powf(-1.0 / order)).clamp(LEAST_FACTOR, MOST_FACTOR);
        let next = (self.tried[b] * factor).clamp(shortest, self.longest.max(shortest));
        if !accepted {
            self.step[b] = next;
            return Verdict::Rejected;
        }
        // A step that the end of the interval cut short does not shorten the next.
        self.step[b] = if self.tried[b] < self.step[b] && ratio <= 1.0 { next.max(self.step[b]) } else { next };
        let (count, mut finite) = (self.tried.len(), true);
        for i in self.continuous.iter().map(|s| s * count + b) {
            if ratio > 1.0 {
                let size = stepper.states[i / count].size().max(self.present[i].abs());
                let error = self.error[i] / size;
                self.forced[i] += if error.is_finite() { error } else { 0.0 };
            }
            finite &= self.trial[i].is_finite();
            self.present[i] = self.trial[i];
        }
        let arrived = !finite || self.tried[b] >= seconds - self.elapsed[b];
        self.elapsed[b] = if arrived { seconds } else { self.elapsed[b] + self.tried[b] };
        if ratio <= 1.0 { Verdict::Accepted } else { Verdict::Forced }
    }

    /// The allowed error at entry i of states x points.
    pub(crate) fn allowed(&self, i: usize) -> f64 {
        let size = self.present[i].abs().max(self.trial[i].abs());
        self.relative.mul_add(size, self.absolute[i / self.tried.len()])
    }
}
