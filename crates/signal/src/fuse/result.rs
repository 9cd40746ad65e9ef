//! Results of a fusion.

use nalgebra::SMatrix;

use super::{
    BodyNoise, ImuNoise,
    chain::{Joint, Undetermined},
    options::{ImuRecord, Prior},
    preintegration::Preintegrated,
    problem::{Covariance, Problem},
    rotation::{Rotation, Vector, exp, log, rotation},
    state::{BORDER, STATE, State, StateError, part},
    track::Track,
};
use crate::Estimate;

/// The state of a body at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyState {
    /// The instant by the clock of the inertial sensor, s.
    pub time: f64,
    /// Body to world: a quaternion x, y, z, w.
    pub attitude: [f64; 4],
    /// In the world, m.
    pub position: [f64; 3],
    /// In the world, m/s.
    pub velocity: [f64; 3],
    /// rad/s.
    pub gyro_bias: [f64; 3],
    /// m/s^2; 0 without an accelerometer.
    pub accelerometer_bias: [f64; 3],
    /// The reading less the bias: of the body against the world in the body frame, rad/s.
    pub rate: [f64; 3],
    /// In the world, m/s^2.
    pub acceleration: [f64; 3],
    /// Standard deviations: of the attitude about the axes of the body (rad), position, velocity, bias of the gyroscope, bias of the accelerometer (without one: acceleration).
    pub deviations: [f64; 15],
    /// Standard deviations of the rate about the axes of the body, rad/s: of the bias, of the reading, and of where between two readings a jump was.
    pub rate_deviations: [f64; 3],
    /// Standard deviations of the acceleration in the world, m/s^2: of the attitude, the bias and gravity, and of the reading, of whose window it is the mean.
    pub acceleration_deviations: [f64; 3],
    /// The part of the acceleration's variances that the reading does not make.
    pulled: [f64; 3],
}

/// An uninterrupted stretch of states, one a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyTrack {
    /// The run that it is of.
    pub run: usize,
    /// The first of its poses there.
    pub first: usize,
    /// One a pose.
    pub states: Vec<BodyState>,
    /// Measurements from which they are estimated.
    pub estimate: Estimate,
    /// Rows of the run whose position was left out.
    pub positions_rejected: Vec<usize>,
    /// Rows of the run whose attitude was left out.
    pub attitudes_rejected: Vec<usize>,
}

/// The constants, as estimated. Deviations are those after the fusion; 0 for a given constant.
#[derive(Debug, Clone, PartialEq)]
pub struct StaticEstimates {
    /// The origin of the markers' frame in the body frame, m, an axis each.
    pub lever: [Prior<f64>; 3],
    /// The markers' frame to the body frame: x, y, z, w.
    pub mounting: [f64; 4],
    /// Its deviations about the axes of the markers' frame, rad.
    pub mounting_deviations: [f64; 3],
    /// Offset to add to the stamps of the poses for the times of the inertial sensor, s.
    pub offset: Prior<f64>,
    /// In the world, m/s^2.
    pub gravity: [f64; 3],
    /// The deviations of its direction about two axes across it, rad.
    pub gravity_deviations: [f64; 2],
}

/// Result of a fusion.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Fused {
    /// In the order of the runs.
    pub tracks: Vec<BodyTrack>,
    /// The constants.
    pub constants: StaticEstimates,
    /// The noise: as given, or as estimated.
    pub noise: BodyNoise,
    /// The standard deviations of its estimates, each in the same unit as the estimate: 0 for a given value, infinite
    /// for one that no reading determines. Those of `scatter` are finite if the readings determine their noise, and
    /// infinite if the value is a bound.
    pub noise_deviations: BodyNoise,
    /// Poses that are in no track, as there are no readings about them.
    pub outside: usize,
    /// Poses that are in no track, as fewer than two positions or no attitude of theirs lay within the gate.
    pub contradicted: usize,
    /// Objective: loss of the residuals, in squares of deviations.
    pub cost: f64,
    /// Steps of Gauss and Newton in all.
    pub steps: usize,
    /// True if steps, nodes, choice and noise all converged.
    pub converged: bool,
}

/// x, y, z, w, the last not negative.
fn quaternion(rotation: &Rotation) -> [f64; 4] {
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    [rotation.i, rotation.j, rotation.k, rotation.w].map(|part| sign * part)
}

/// Reads the answer from a problem that came to rest.
pub(super) fn fused(
    problem: &mut Problem<'_>,
    [outside, contradicted]: [usize; 2],
    steps: usize,
    converged: bool,
) -> Result<Fused, Undetermined> {
    let whole = problem.whole()?;
    let cost = problem.cost_now()?;
    let estimate = problem.options.estimate;
    let states: Vec<(usize, Vec<BodyState>)> = match estimate {
        Estimate::Smoother => {
            let state_of = |track: usize, node: usize, joint: &Joint| {
                let state = problem.tracks[track].states[node];
                body_state(problem, (track, node), &state, joint, &whole.covariance)
            };
            problem.spread(&whole, state_of)?.into_iter().map(|states| (0, states)).collect()
        }
        // A filter takes the constants for what all measurements say that they are, to their deviations.
        Estimate::Filter => problem.filtered(&whole, |track, node, state, joint| {
            body_state(problem, (track, node), state, joint, &whole.covariance)
        })?,
    };
    let tracks = problem.tracks.iter().zip(states);
    let tracks = tracks.map(|(track, states)| body_track(track, states, estimate)).collect();
    let given = problem.given();
    let deviation = |at: usize| if given[at] { 0.0 } else { whole.covariance[(at, at)].sqrt() };
    let (border, offset) = (&problem.border, problem.setting.anchor + problem.border.late);
    let constants = StaticEstimates {
        lever: [0, 1, 2].map(|axis| Prior { value: border.lever[axis], deviation: deviation(part::LEVER + axis) }),
        mounting: quaternion(&border.mounting),
        mounting_deviations: [0, 1, 2].map(|axis| deviation(part::MOUNTING + axis)),
        offset: Prior { value: offset, deviation: deviation(part::OFFSET) },
        gravity: border.gravity.into(),
        gravity_deviations: [0, 1].map(|axis| deviation(part::GRAVITY + axis)),
    };
    let (noise, noise_deviations) = (problem.setting.noise, problem.noise_deviations()?);
    Ok(Fused { tracks, constants, noise, noise_deviations, outside, contradicted, cost, steps, converged })
}

fn body_state(
    problem: &Problem<'_>,
    (track, node): (usize, usize),
    state: &State,
    joint: &Joint,
    theta: &Covariance,
) -> BodyState {
    let track = &problem.tracks[track];
    let time = track.time(node, &problem.setting);
    let (reading, has_forces) = (track.imu.at(time), track.imu.has_forces());
    let force = reading.force - state.accelerometer;
    let (acceleration, bias) = match has_forces {
        true => (state.attitude * force + problem.border.gravity, state.accelerometer),
        false => (state.accelerometer, Vector::zeros()),
    };
    let deviations: [f64; STATE] = std::array::from_fn(|i| joint.node[(i, i)].sqrt());
    let pulled = match has_forces {
        true => pulled(state, &force, joint, theta, problem),
        false => Vector::from_fn(|axis, _| joint.node[(part::ACCELEROMETER + axis, part::ACCELEROMETER + axis)]),
    };
    let mut body = BodyState {
        time,
        attitude: quaternion(&state.attitude),
        position: state.position.into(),
        velocity: state.velocity.into(),
        gyro_bias: state.gyro.into(),
        accelerometer_bias: bias.into(),
        rate: (reading.rate - state.gyro).into(),
        acceleration: acceleration.into(),
        deviations,
        rate_deviations: [0.0; 3],
        acceleration_deviations: [0.0; 3],
        pulled: pulled.into(),
    };
    body.read_by(&track.imu, &problem.setting.noise.imu);
    body
}

/// The variances of the acceleration in the world that errors of attitude, bias and gravity make.
fn pulled(state: &State, force: &Vector, joint: &Joint, theta: &Covariance, problem: &Problem<'_>) -> Vector {
    let turn = state.attitude.to_rotation_matrix().into_inner();
    let mut slopes = SMatrix::<f64, 3, STATE>::zeros();
    slopes.fixed_view_mut::<3, 3>(0, part::ATTITUDE).copy_from(&(-turn * force.cross_matrix()));
    slopes.fixed_view_mut::<3, 3>(0, part::ACCELEROMETER).copy_from(&-turn);
    let mut border = SMatrix::<f64, 3, BORDER>::zeros();
    if !problem.given()[part::GRAVITY] {
        border.fixed_view_mut::<3, 2>(0, part::GRAVITY).copy_from(&problem.border.gravity_slope());
    }
    let crossed = slopes * joint.with_border * border.transpose();
    let sum =
        slopes * joint.node * slopes.transpose() + border * theta * border.transpose() + crossed + crossed.transpose();
    sum.diagonal()
}

impl BodyState {
    /// The deviations of what the reading at its instant is a part of.
    fn read_by(&mut self, imu: &ImuRecord<'_>, noise: &ImuNoise) {
        let [rate, force] = imu.variances(noise, self.time);
        let bias = |axis: usize| self.deviations[part::GYRO + axis].powi(2);
        self.rate_deviations = std::array::from_fn(|axis| (bias(axis) + rate[axis]).sqrt());
        let turn = rotation(&self.attitude).to_rotation_matrix().into_inner();
        let read = turn.component_mul(&turn) * force;
        self.acceleration_deviations = std::array::from_fn(|axis| (self.pulled[axis].max(0.0) + read[axis]).sqrt());
    }
}

fn body_track(track: &Track<'_>, (begun, states): (usize, Vec<BodyState>), estimate: Estimate) -> BodyTrack {
    let rejected = |which: usize| {
        (0..track.nodes()).filter(|&node| !track.used[node][which]).map(|node| track.first + node).collect()
    };
    BodyTrack {
        run: track.run,
        first: track.first + begun,
        states,
        estimate,
        positions_rejected: rejected(0),
        attitudes_rejected: rejected(1),
    }
}

impl BodyTrack {
    /// The state at an instant between the first and the last, `None` outside and where there are fewer than two: the readings carry the state before on, and what they miss of the state after is spread over the time between;
    /// a filter knows nothing of the state after.
    ///
    /// `imu` is the record of the run, `gravity` and `noise` as estimated. Deviations are those of the states about it, of which none is greater when all is known of both, and what the readings since leave open.
    pub fn at(&self, imu: &ImuRecord<'_>, gravity: [f64; 3], noise: &BodyNoise, time: f64) -> Option<BodyState> {
        if self.states.len() < 2 {
            return None;
        }
        let next = self.states.partition_point(|state| state.time <= time);
        let last = self.states.len() - 1;
        if next == 0 || (next > last && self.states[last].time < time) {
            return None;
        }
        let (from, to) = (&self.states[next.min(last) - 1], &self.states[next.min(last)]);
        let share = (time - from.time) / (to.time - from.time);
        let start = Carried::of(from);
        if self.estimate == Estimate::Filter {
            let here = start.carried(imu, gravity.into(), noise, time);
            return Some(here.alone(from, imu, gravity.into(), noise));
        }
        let [here, there] = [time, to.time].map(|until| start.carried(imu, gravity.into(), noise, until));
        let missed = Carried::of(to);
        let between = |a: &[f64], b: &[f64], i: usize| a[i] + share * (b[i] - a[i]);
        // The error at the end is spread in proportion to the variance that has grown until then.
        let turned = here.parts(&there, part::ATTITUDE);
        let pushed = if imu.has_forces() { here.parts(&there, part::VELOCITY).mean() } else { share };
        let left = log(&(there.attitude.inverse() * missed.attitude)).component_mul(&turned);
        let attitude = here.attitude * exp(&left);
        let position = here.position + (missed.position - there.position) * share;
        let velocity = here.velocity + (missed.velocity - there.velocity) * pushed;
        let gyro = Vector::from_fn(|i, _| between(&from.gyro_bias, &to.gyro_bias, i));
        let accelerometer = Vector::from_fn(|i, _| between(&from.accelerometer_bias, &to.accelerometer_bias, i));
        let reading = imu.at(time);
        let acceleration = match imu.has_forces() {
            true => attitude * (reading.force - accelerometer) + Vector::from(gravity),
            false => Vector::from_fn(|i, _| between(&from.acceleration, &to.acceleration, i)),
        };
        // Of both ends no more than this can be wrong at once; between them the readings leave a bridge open.
        let open = here.bridge(&there, imu.has_forces(), share);
        let deviations = std::array::from_fn(|i| between(&from.deviations, &to.deviations, i).hypot(open[i].sqrt()));
        let mut body = BodyState {
            time,
            attitude: quaternion(&attitude),
            position: position.into(),
            velocity: velocity.into(),
            gyro_bias: gyro.into(),
            accelerometer_bias: accelerometer.into(),
            rate: (reading.rate - gyro).into(),
            acceleration: acceleration.into(),
            deviations,
            rate_deviations: [0.0; 3],
            acceleration_deviations: [0.0; 3],
            pulled: std::array::from_fn(|i| between(&from.pulled, &to.pulled, i)),
        };
        body.read_by(imu, &noise.imu);
        Some(body)
    }
}

/// A state that readings carry on.
struct Carried {
    time: f64,
    attitude: Rotation,
    position: Vector,
    velocity: Vector,
    /// In the world, where no force is measured.
    acceleration: Vector,
    biases: [Vector; 2],
    /// The variances that have grown since: of the attitude about the axes of the body, of position, velocity and, where no force is measured, acceleration, in the world.
    grown: StateError,
}

impl Carried {
    fn of(state: &BodyState) -> Self {
        Self {
            time: state.time,
            attitude: rotation(&state.attitude),
            position: state.position.into(),
            velocity: state.velocity.into(),
            acceleration: state.acceleration.into(),
            biases: [state.gyro_bias.into(), state.accelerometer_bias.into()],
            grown: StateError::zeros(),
        }
    }

    fn carried(&self, imu: &ImuRecord<'_>, gravity: Vector, noise: &BodyNoise, until: f64) -> Self {
        let sum = Preintegrated::new(imu, self.time, until, &self.biases, &noise.imu);
        let (dt, mut grown) = (sum.dt, StateError::zeros());
        let mut grow = |part: usize, variances: Vector| grown.fixed_rows_mut::<3>(part).copy_from(&variances);
        let variances = |part: usize| sum.covariance.diagonal().fixed_rows::<3>(part).into_owned();
        grow(part::ATTITUDE, variances(0));
        // Without forces the readings say how the body turns, and its acceleration stays.
        let (pushed, gained, constant) = match imu.has_forces() {
            true => (self.attitude * sum.position, self.attitude * sum.velocity, gravity),
            false => (Vector::zeros(), Vector::zeros(), self.acceleration),
        };
        if imu.has_forces() {
            let turn = self.attitude.to_rotation_matrix().into_inner();
            let squares = turn.component_mul(&turn);
            grow(part::POSITION, squares * variances(6));
            grow(part::VELOCITY, squares * variances(3));
        } else {
            let jerk = Vector::repeat(noise.jerk * noise.jerk * dt);
            grow(part::ACCELEROMETER, jerk);
            grow(part::VELOCITY, jerk * (dt * dt / 3.0));
        }
        Self {
            time: until,
            attitude: self.attitude * sum.rotation,
            position: self.position + self.velocity * dt + constant * (0.5 * dt * dt) + pushed,
            velocity: self.velocity + constant * dt + gained,
            grown,
            ..*self
        }
    }

    /// The state, given what was known of it `from` where it was carried: errors of rates and velocities add up to no more than their deviations times the time since.
    fn alone(&self, from: &BodyState, imu: &ImuRecord<'_>, gravity: Vector, noise: &BodyNoise) -> BodyState {
        let (reading, dt) = (imu.at(self.time), self.time - from.time);
        let [gyro, accelerometer] = self.biases;
        let acceleration = match imu.has_forces() {
            true => self.attitude * (reading.force - accelerometer) + gravity,
            false => self.acceleration,
        };
        // The axes of the body turn meanwhile.
        let turning = from.deviations[part::GYRO..part::ACCELEROMETER].iter().copied().fold(0.0, f64::max);
        let of = |i: usize| {
            let drift = match i / 3 * 3 {
                part::ATTITUDE => turning,
                part::POSITION => from.deviations[i - part::POSITION + part::VELOCITY],
                part::VELOCITY => from.pulled[i - part::VELOCITY].max(0.0).sqrt(),
                _ => 0.0,
            };
            (from.deviations[i] + drift * dt).hypot(self.grown[i].max(0.0).sqrt())
        };
        let mut body = BodyState {
            time: self.time,
            attitude: quaternion(&self.attitude),
            position: self.position.into(),
            velocity: self.velocity.into(),
            gyro_bias: gyro.into(),
            accelerometer_bias: accelerometer.into(),
            rate: (reading.rate - gyro).into(),
            acceleration: acceleration.into(),
            deviations: std::array::from_fn(of),
            rate_deviations: [0.0; 3],
            acceleration_deviations: [0.0; 3],
            pulled: from.pulled,
        };
        body.read_by(imu, &noise.imu);
        body
    }

    /// Fraction of the growth until the end that has happened here.
    fn parts(&self, end: &Self, part: usize) -> Vector {
        let of = |i: usize| if end.grown[i] > 0.0 { (self.grown[i] / end.grown[i]).min(1.0) } else { 0.0 };
        Vector::from_fn(|axis, _| of(part + axis))
    }

    /// Variance here when this state and that at the end are known. For independent increments it is that of a bridge.
    /// For their integrals it is that after this share of the time, with the end's error spread evenly.
    fn bridge(&self, end: &Self, has_forces: bool, share: f64) -> StateError {
        let integrated = (share * (1.0 - share)).powi(2);
        StateError::from_fn(|i, _| match i / 3 * 3 {
            part::POSITION => integrated * end.grown[i],
            part::VELOCITY if !has_forces => integrated * end.grown[i],
            _ if end.grown[i] > self.grown[i] => self.grown[i] * (1.0 - self.grown[i] / end.grown[i]),
            _ => 0.0,
        })
    }
}
