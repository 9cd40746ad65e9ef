//! Integration with steps of its own choice: the embedded pair 5(4) of Dormand and Prince.
//!
//! Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980), table 2; the step control is that of Hairer, Norsett
//! and Wanner, "Solving ordinary differential equations I", section II.4. Every point has steps of its own, so that its numbers do not depend on those
//! beside it.

use crate::{Points, Stepper, StepperWorkspace, angle::wrap};

/// How exactly a simulation follows the equations.
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

/// Nodes: the share of the step at which each stage stands.
const NODES: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// What each stage takes of the slopes before it; the last row is the solution of order 5, whose slope is the first of the next step.
const STAGES: [[f64; 6]; 7] = [
    [0.0; 6],
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// Solution of order 5 less that of order 4.
const ERROR: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

/// The longest step, in sampling periods: what is shorter (a pulse of `time()`, a thin region) would not be seen by longer ones.
const LONGEST: f64 = 10.0;
/// The shortest step, as a share of the sampling period: where the right side jumps, no step meets the tolerance.
const SHORTEST: f64 = 1.0 / 256.0;
/// A step is this share of the one whose error would be just allowed, and changes by these factors at most.
const SAFETY: f64 = 0.9;
const LEAST_FACTOR: f64 = 0.2;
const MOST_FACTOR: f64 = 5.0;

/// Memory of a simulation: the steps of every point.
pub(crate) struct Adaptive {
    /// Allowed error of every state: relative, absolute.
    relative: f64,
    absolute: Vec<f64>,
    shortest: f64,
    longest: f64,
    /// Next step of each point, seconds.
    step: Vec<f64>,
    /// Length of the step that is tried; 0 for a point that has arrived.
    tried: Vec<f64>,
    /// Seconds of the interval that each point has behind it.
    elapsed: Vec<f64>,
    /// Slopes of the stages, each states x points.
    slopes: [Vec<f64>; 7],
    /// States x points: where the step begins, and where it ends.
    present: Vec<f64>,
    trial: Vec<f64>,
    /// Errors of steps that could not be made short enough, over the sizes of the states, summed over the simulation: states x points.
    forced: Vec<f64>,
}

impl Adaptive {
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
            step: vec![first; count],
            tried: vec![0.0; count],
            elapsed: vec![0.0; count],
            slopes: std::array::from_fn(|_| vec![0.0; values]),
            present: vec![0.0; values],
            trial: vec![0.0; values],
            forced: vec![0.0; values],
        }
    }

    /// The largest sum of errors that steps could not be made short enough for, over the size of the state; 0 where the tolerance was met.
    pub(crate) fn shortfall(&self) -> f64 {
        self.forced.iter().copied().fold(0.0, f64::max)
    }

    /// The states after `seconds`. The points stay as they are; their columns of the outside are held.
    pub(crate) fn advance(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        seconds: f64,
        workspace: &mut StepperWorkspace,
        states: &mut Vec<f64>,
    ) {
        let (row, count) = (points.clone(), points.count());
        self.begin(stepper, points, seconds, workspace);
        // What is no derivative advances by a row, whatever happens within the interval.
        let held = self.slopes[0].clone();
        while self.choose(seconds) {
            for stage in 1..NODES.len() {
                self.stage(stepper, points, row.seconds(0), stage, workspace);
            }
            self.judge(stepper, seconds);
        }
        states.clear();
        for (s, state) in stepper.states.iter().enumerate() {
            let place = s * count..(s + 1) * count;
            if state.advance.continuous {
                states.extend_from_slice(&self.present[place]);
            } else {
                let x = row.column(state.column, 0);
                states.extend(x.iter().zip(&held[place]).map(|(&x, &f)| state.advance.next(x, f, seconds)));
            }
        }
        // At the end alone: on the way a rotation that is written another way would have other slopes, and errors are estimated by slopes.
        (0..count).for_each(|b| stepper.geometry.retract(states, |s| s * count + b));
        *points = row;
    }

    /// The states and slopes at the begin of an interval.
    fn begin(&mut self, stepper: &Stepper, points: &Points, seconds: f64, workspace: &mut StepperWorkspace) {
        let count = points.count();
        self.elapsed.fill(0.0);
        for (s, state) in stepper.states.iter().enumerate() {
            let x = points.column(state.column, 0);
            self.present[s * count..(s + 1) * count].copy_from_slice(x);
            // What is no number stays none.
            x.iter().zip(&mut self.elapsed).filter(|(x, _)| !x.is_finite()).for_each(|(_, elapsed)| *elapsed = seconds);
        }
        stepper.evaluate(points, workspace);
        self.take_slopes(stepper, count, 0, workspace);
    }

    fn take_slopes(&mut self, stepper: &Stepper, count: usize, stage: usize, workspace: &StepperWorkspace) {
        for state in 0..stepper.states.len() {
            let found = stepper.right_side(state, count, workspace);
            self.slopes[stage][state * count..(state + 1) * count].copy_from_slice(found);
        }
    }

    /// The next step of every point; whether there is any to make.
    fn choose(&mut self, seconds: f64) -> bool {
        let mut any = false;
        for (b, tried) in self.tried.iter_mut().enumerate() {
            let (rest, step) = (seconds - self.elapsed[b], self.step[b]);
            *tried = match rest {
                rest if rest <= 0.0 => 0.0,
                rest if step >= rest * (1.0 - 1e-9) => rest,
                // Two equal steps instead of one and a remainder.
                rest if 2.0 * step > rest => 0.5 * rest,
                _ => step,
            };
            any |= *tried > 0.0;
        }
        any
    }

    /// Slopes at a stage of the step of every point.
    fn stage(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        stage: usize,
        workspace: &mut StepperWorkspace,
    ) {
        let count = points.count();
        for (b, time) in points.seconds_mut(0).iter_mut().enumerate() {
            *time = begin[b] + (self.elapsed[b] + NODES[stage] * self.tried[b]);
        }
        let last = stage + 1 == NODES.len();
        for (s, state) in stepper.states.iter().enumerate().filter(|(_, state)| state.advance.continuous) {
            let column = points.column_mut(state.column, 0);
            for (b, value) in column.iter_mut().enumerate() {
                let i = s * count + b;
                let slope: f64 = (0..stage).map(|k| STAGES[stage][k] * self.slopes[k][i]).sum();
                *value = self.tried[b].mul_add(slope, self.present[i]);
                if last {
                    *value = if state.advance.angle { wrap(*value) } else { *value };
                    self.trial[i] = *value;
                }
            }
        }
        stepper.evaluate(points, workspace);
        self.take_slopes(stepper, count, stage, workspace);
    }

    /// Takes the steps whose error is allowed, and those that are as short as can be; says how long the next ones are.
    fn judge(&mut self, stepper: &Stepper, seconds: f64) {
        let count = self.tried.len();
        let continuous: Vec<usize> =
            (0..stepper.states.len()).filter(|&s| stepper.states[s].advance.continuous).collect();
        for b in (0..count).filter(|&b| self.tried[b] > 0.0) {
            let (mut ratio, mut finite) = (0.0_f64, true);
            for i in continuous.iter().map(|s| s * count + b) {
                let part = self.error(i, b) / self.allowed(i, i / count);
                // `max` would lose what is not a number.
                ratio = if part.is_nan() { f64::INFINITY } else { ratio.max(part) };
                finite &= self.trial[i].is_finite();
                if !finite {
                    ratio = f64::INFINITY;
                    break;
                }
            }
            let accepted = ratio <= 1.0 || self.tried[b] <= self.shortest * (1.0 + 1e-9);
            let factor = (SAFETY * ratio.powf(-0.2)).clamp(LEAST_FACTOR, MOST_FACTOR);
            let next = (self.tried[b] * factor).clamp(self.shortest, self.longest);
            if !accepted {
                self.step[b] = next;
                continue;
            }
            // A step that the end of the interval cut short does not shorten the next.
            self.step[b] = if self.tried[b] < self.step[b] && ratio <= 1.0 { next.max(self.step[b]) } else { next };
            for i in continuous.iter().map(|s| s * count + b) {
                if ratio > 1.0 {
                    let size = stepper.states[i / count].size().max(self.present[i].abs());
                    let error = self.error(i, b) / size;
                    self.forced[i] += if error.is_finite() { error } else { 0.0 };
                }
                self.present[i] = self.trial[i];
                self.slopes[0][i] = self.slopes[6][i];
            }
            let arrived = !finite || self.tried[b] >= seconds - self.elapsed[b];
            self.elapsed[b] = if arrived { seconds } else { self.elapsed[b] + self.tried[b] };
        }
    }

    /// Estimated error of the step of point b, at entry i of states x points.
    fn error(&self, i: usize, b: usize) -> f64 {
        let slope: f64 = ERROR.iter().zip(&self.slopes).map(|(weight, slopes)| weight * slopes[i]).sum();
        (self.tried[b] * slope).abs()
    }

    fn allowed(&self, i: usize, state: usize) -> f64 {
        self.relative.mul_add(self.present[i].abs().max(self.trial[i].abs()), self.absolute[state])
    }
}
