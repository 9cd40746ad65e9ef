//! Integration with adaptive steps: the embedded pair 5(4) of Dormand and Prince.
//!
//! Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980), table 2. Hairer and
//! Wanner detect stiff equations by the slopes of the last two stages ("Solving ordinary differential equations II",
//! section IV.2). At a stiff point integration goes on by [`Rosenbrock`], and comes back when steps are short beside
//! the time constants.

use fleetfoot_data::checkpoint;

use crate::{
    Points, Stepper, StepperWorkspace,
    angle::wrap,
    rosenbrock::{self, Rosenbrock, right_sides},
    step_control::{StepControl, Tolerance, Verdict},
};

/// Nodes: the share of the step at which each stage stands.
const NODES: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// Coefficients of the earlier slopes in each stage. The last row is the solution of order 5, whose slope is the first of the next step.
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

/// The order of the error that is estimated, in the step.
const ERROR_ORDER: f64 = 5.0;
/// The border of stability on the negative axis: step times rate.
const STABLE: f64 = 3.25;
/// Steps at the border of stability, but for fewer than [`SOUND`] others in between, that make a point stiff.
const STIFF: u32 = 15;
const SOUND: u32 = 6;
/// Implicit steps in a row, each shorter than the fastest time constant, after which a point is not stiff any longer.
const SLOW: u32 = 30;
/// The shortest implicit step, as a share of the fastest time constant: a shorter one indicates a jump, not a
/// transient.
const SHORTEST_OF_CONSTANT: f64 = 1e-3;
/// The shortest implicit step, as a share of the shortest explicit one: below it a simulation would hardly get on.
const SHORTEST_OF_EXPLICIT: f64 = 1e-6;

/// Integration method of a point, explicit or implicit, and the count of steps that favour the other method.
#[derive(Debug, Clone, Copy, Default)]
struct Stiffness {
    implicit: bool,
    /// Explicit: steps at the border of stability. Implicit: short steps in a row.
    against: u32,
    /// Explicit: steps within the border in a row.
    within: u32,
}

impl Stiffness {
    fn switch(&mut self) {
        *self = Self { implicit: !self.implicit, ..Self::default() };
    }
}

/// Memory of a simulation: the steps of every point.
pub(crate) struct Adaptive {
    control: StepControl,
    stiffness: Vec<Stiffness>,
    /// Made where the first point is stiff; nothing where the equations have no derivatives.
    implicit: Option<Option<Rosenbrock>>,
    /// Slopes of the stages, each states x points.
    slopes: [Vec<f64>; 7],
    /// States of the stage before the last one: states x points.
    before_last: Vec<f64>,
}

impl Adaptive {
    /// For a simulation whose shortest interval is of so many seconds.
    pub(crate) fn new(stepper: &Stepper, tolerance: &Tolerance, count: usize, interval: f64) -> Self {
        let values = stepper.states.len() * count;
        Self {
            control: StepControl::new(stepper, tolerance, count, interval),
            stiffness: vec![Stiffness::default(); count],
            implicit: None,
            slopes: std::array::from_fn(|_| vec![0.0; values]),
            before_last: vec![0.0; values],
        }
    }

    /// The largest sum of errors of steps that could not be made short enough, over the size of the state; 0 if the
    /// tolerance was met.
    pub(crate) fn shortfall(&self) -> f64 {
        self.control.shortfall()
    }

    /// The states after `seconds`. The points stay as they are; their columns of the outside are held, or move along their ramps.
    pub(crate) fn advance(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        seconds: f64,
        workspace: &mut StepperWorkspace,
        states: &mut Vec<f64>,
    ) {
        let (row, count) = (points.clone(), points.count());
        self.control.begin(stepper, points, seconds);
        stepper.evaluate(points, workspace);
        self.slopes[0] = right_sides(stepper, count, workspace);
        // States without a derivative advance by a row, whatever happens within the interval.
        let held = self.slopes[0].clone();
        loop {
            checkpoint();
            let explicit = self.control.choose(seconds, |b| !self.stiffness[b].implicit);
            if explicit {
                self.step_explicitly(stepper, points, row.seconds(0), seconds, workspace);
            }
            let implicit = self.control.choose(seconds, |b| self.stiffness[b].implicit);
            if implicit {
                self.step_implicitly(stepper, points, row.seconds(0), seconds, workspace);
            }
            if !explicit && !implicit {
                break;
            }
        }
        states.clear();
        for (s, state) in stepper.states.iter().enumerate() {
            let place = s * count..(s + 1) * count;
            if state.advance.continuous {
                states.extend_from_slice(&self.control.present[place]);
            } else {
                let x = row.column(state.column, 0);
                states.extend(x.iter().zip(&held[place]).map(|(&x, &f)| state.advance.next(x, f, seconds)));
            }
        }
        // At the end alone: on the way a rotation that is written another way would have other slopes, and errors are estimated by slopes.
        (0..count).for_each(|b| stepper.geometry.retract(states, |s| s * count + b));
        *points = row;
    }

    /// A step of every point that is not stiff.
    fn step_explicitly(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        seconds: f64,
        workspace: &mut StepperWorkspace,
    ) {
        for stage in 1..NODES.len() {
            self.stage(stepper, points, begin, stage, workspace);
        }
        let count = points.count();
        for b in self.control.active() {
            for i in self.control.continuous.iter().map(|s| s * count + b) {
                let slope: f64 = ERROR.iter().zip(&self.slopes).map(|(weight, slopes)| weight * slopes[i]).sum();
                self.control.error[i] = (self.control.tried[b] * slope).abs();
            }
            let (ratio, border) = (self.control.ratio(b), self.stability(b));
            let shortest = self.control.shortest;
            let stuck = ratio > 1.0 && self.control.tried[b] <= shortest * (1.0 + 1e-9);
            if stuck && border > STABLE && self.can_be_implicit(stepper) {
                self.stiffness[b].switch();
                continue;
            }
            if self.control.judge(stepper, b, seconds, ratio, ERROR_ORDER, shortest) == Verdict::Rejected {
                continue;
            }
            for i in self.control.continuous.iter().map(|s| s * count + b) {
                self.slopes[0][i] = self.slopes[6][i];
            }
            if self.is_stiff(b, border) && self.can_be_implicit(stepper) {
                self.stiffness[b].switch();
            }
        }
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
        let (count, control) = (points.count(), &mut self.control);
        for b in 0..count {
            points.set_elapsed(b, begin[b], control.elapsed[b] + NODES[stage] * control.tried[b]);
        }
        let last = stage + 1 == NODES.len();
        for &s in &control.continuous {
            let state = &stepper.states[s];
            let column = points.column_mut(state.column, 0);
            for (b, value) in column.iter_mut().enumerate() {
                let i = s * count + b;
                let slope: f64 = (0..stage).map(|k| STAGES[stage][k] * self.slopes[k][i]).sum();
                *value = control.tried[b].mul_add(slope, control.present[i]);
                if stage + 2 == NODES.len() {
                    self.before_last[i] = *value;
                }
                if last {
                    *value = if state.advance.angle { wrap(*value) } else { *value };
                    control.trial[i] = *value;
                }
            }
        }
        stepper.evaluate(points, workspace);
        self.slopes[stage] = right_sides(stepper, count, workspace);
    }

    /// The step of point b times the rate of its fastest part, by the two stages that stand at its end.
    fn stability(&self, b: usize) -> f64 {
        let (count, control) = (self.control.tried.len(), &self.control);
        let (mut slopes, mut states) = (0.0, 0.0);
        for i in control.continuous.iter().map(|s| s * count + b) {
            let allowed = control.allowed(i);
            slopes += ((self.slopes[6][i] - self.slopes[5][i]) / allowed).powi(2);
            states += ((control.trial[i] - self.before_last[i]) / allowed).powi(2);
        }
        if states > 0.0 { control.tried[b] * (slopes / states).sqrt() } else { 0.0 }
    }

    /// Counts an accepted step; whether the point is stiff.
    fn is_stiff(&mut self, b: usize, border: f64) -> bool {
        let stiffness = &mut self.stiffness[b];
        if border > STABLE {
            (stiffness.against, stiffness.within) = (stiffness.against + 1, 0);
        } else {
            stiffness.within += 1;
            stiffness.against = if stiffness.within >= SOUND { 0 } else { stiffness.against };
        }
        stiffness.against >= STIFF
    }

    fn can_be_implicit(&mut self, stepper: &Stepper) -> bool {
        let count = self.control.tried.len();
        self.implicit.get_or_insert_with(|| Rosenbrock::new(stepper, count)).is_some()
    }

    /// A step of every stiff point.
    fn step_implicitly(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        seconds: f64,
        workspace: &mut StepperWorkspace,
    ) {
        let Some(Some(implicit)) = &mut self.implicit else { return };
        let control = &mut self.control;
        implicit.attempt(stepper, points, begin, control, workspace);
        let mut back = Vec::new();
        for b in control.active() {
            let (ratio, rate) = (control.ratio(b), implicit.rate[b]);
            // `max` takes a rate that is no number for none.
            let shortest =
                (SHORTEST_OF_CONSTANT / rate).max(SHORTEST_OF_EXPLICIT * control.shortest).min(control.shortest);
            let tried = control.tried[b];
            if control.judge(stepper, b, seconds, ratio, rosenbrock::ERROR_ORDER, shortest) == Verdict::Rejected {
                continue;
            }
            let stiffness = &mut self.stiffness[b];
            stiffness.against = if tried * rate < 1.0 && tried > control.shortest { stiffness.against + 1 } else { 0 };
            if stiffness.against >= SLOW {
                stiffness.switch();
                back.push(b);
            }
        }
        if !back.is_empty() {
            self.refresh(stepper, points, begin, &back, workspace);
        }
    }

    /// The first slopes of points that come back to explicit steps.
    fn refresh(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        back: &[usize],
        workspace: &mut StepperWorkspace,
    ) {
        let (count, control) = (points.count(), &self.control);
        for &b in back {
            points.set_elapsed(b, begin[b], control.elapsed[b]);
            for &s in &control.continuous {
                points.column_mut(stepper.states[s].column, 0)[b] = control.present[s * count + b];
            }
        }
        stepper.evaluate(points, workspace);
        let slopes = right_sides(stepper, count, workspace);
        for &b in back {
            for i in control.continuous.iter().map(|s| s * count + b) {
                self.slopes[0][i] = slopes[i];
            }
        }
    }
}
