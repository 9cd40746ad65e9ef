//! What fusion found.

use super::{
    BodyNoise,
    chain::Undetermined,
    options::{ImuRecord, Prior},
    preintegration::Preintegrated,
    problem::Problem,
    rotation::{Rotation, Vector, exp, log},
    start::rotation,
    state::{STATE, part},
    track::Track,
};

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
    /// Rows of the run whose position was left out.
    pub positions_rejected: Vec<usize>,
    /// Rows of the run whose attitude was left out.
    pub attitudes_rejected: Vec<usize>,
}

/// The constants, as estimated: deviations are those that are left; 0 of what was given.
#[derive(Debug, Clone, PartialEq)]
pub struct StaticEstimates {
    /// The origin of the markers' frame in the body frame, m, an axis each.
    pub lever: [Prior<f64>; 3],
    /// The markers' frame to the body frame: x, y, z, w.
    pub mounting: [f64; 4],
    /// Its deviations about the axes of the markers' frame, rad.
    pub mounting_deviations: [f64; 3],
    /// What is added to the stamps of the poses to get times of the inertial sensor, s.
    pub offset: Prior<f64>,
    /// In the world, m/s^2.
    pub gravity: [f64; 3],
    /// The deviations of its direction about two axes across it, rad.
    pub gravity_deviations: [f64; 2],
}

/// What fusion found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Fused {
    /// In the order of the runs.
    pub tracks: Vec<BodyTrack>,
    /// The constants.
    pub constants: StaticEstimates,
    /// The noise: as given, or as estimated.
    pub noise: BodyNoise,
    /// Poses that are in no track, as there are no readings about them.
    pub outside: usize,
    /// Poses that are in no track, as fewer than two positions or no attitude of theirs lay within the gate.
    pub contradicted: usize,
    /// What the residuals cost, in squares of deviations.
    pub cost: f64,
    /// Steps of Gauss and Newton in all.
    pub steps: usize,
    /// Whether steps, nodes, choice and noise all came to rest.
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
    let states = problem.spread(&whole, |track, node, variances| body_state(problem, track, node, variances))?;
    let tracks = problem.tracks.iter().zip(states).map(|(track, states)| body_track(track, states)).collect();
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
    Ok(Fused { tracks, constants, noise: problem.setting.noise, outside, contradicted, cost, steps, converged })
}

fn body_state(problem: &Problem<'_>, track: usize, node: usize, variances: &[f64; STATE]) -> BodyState {
    let track = &problem.tracks[track];
    let (state, time) = (&track.states[node], track.time(node, &problem.setting));
    let reading = track.imu.at(time);
    let (acceleration, bias) = match track.imu.has_forces() {
        true => {
            let force = state.attitude * (reading.force - state.accelerometer);
            (force + problem.border.gravity, state.accelerometer)
        }
        false => (state.accelerometer, Vector::zeros()),
    };
    BodyState {
        time,
        attitude: quaternion(&state.attitude),
        position: state.position.into(),
        velocity: state.velocity.into(),
        gyro_bias: state.gyro.into(),
        accelerometer_bias: bias.into(),
        rate: (reading.rate - state.gyro).into(),
        acceleration: acceleration.into(),
        deviations: variances.map(f64::sqrt),
    }
}

fn body_track(track: &Track<'_>, states: Vec<BodyState>) -> BodyTrack {
    let rejected = |which: usize| {
        (0..track.nodes()).filter(|&node| !track.used[node][which]).map(|node| track.first + node).collect()
    };
    BodyTrack {
        run: track.run,
        first: track.first,
        states,
        positions_rejected: rejected(0),
        attitudes_rejected: rejected(1),
    }
}

impl BodyTrack {
    /// The state at an instant between the first and the last, `None` outside and where there are fewer than two: the readings carry the state before on, and what they miss of the state after is spread over the time between.
    ///
    /// `imu` is the record of the run, `gravity` as estimated.
    pub fn at(&self, imu: &ImuRecord<'_>, gravity: [f64; 3], time: f64) -> Option<BodyState> {
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
        let [here, there] = [time, to.time].map(|until| start.carried(imu, gravity.into(), until));
        let missed = Carried::of(to);
        let between = |a: &[f64], b: &[f64], i: usize| a[i] + share * (b[i] - a[i]);
        let attitude = here.attitude * exp(&(log(&(there.attitude.inverse() * missed.attitude)) * share));
        let position = here.position + (missed.position - there.position) * share;
        let velocity = here.velocity + (missed.velocity - there.velocity) * share;
        let gyro = Vector::from_fn(|i, _| between(&from.gyro_bias, &to.gyro_bias, i));
        let accelerometer = Vector::from_fn(|i, _| between(&from.accelerometer_bias, &to.accelerometer_bias, i));
        let reading = imu.at(time);
        let acceleration = match imu.has_forces() {
            true => attitude * (reading.force - accelerometer) + Vector::from(gravity),
            false => Vector::from_fn(|i, _| between(&from.acceleration, &to.acceleration, i)),
        };
        Some(BodyState {
            time,
            attitude: quaternion(&attitude),
            position: position.into(),
            velocity: velocity.into(),
            gyro_bias: gyro.into(),
            accelerometer_bias: accelerometer.into(),
            rate: (reading.rate - gyro).into(),
            acceleration: acceleration.into(),
            deviations: std::array::from_fn(|i| between(&from.deviations, &to.deviations, i)),
        })
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
        }
    }

    fn carried(&self, imu: &ImuRecord<'_>, gravity: Vector, until: f64) -> Self {
        let noise = BodyNoise::default().imu;
        let sum = Preintegrated::new(imu, self.time, until, &self.biases, &noise);
        // Without forces the readings say how the body turns, and its acceleration stays.
        let (pushed, gained, constant) = match imu.has_forces() {
            true => (self.attitude * sum.position, self.attitude * sum.velocity, gravity),
            false => (Vector::zeros(), Vector::zeros(), self.acceleration),
        };
        Self {
            time: until,
            attitude: self.attitude * sum.rotation,
            position: self.position + self.velocity * sum.dt + constant * (0.5 * sum.dt * sum.dt) + pushed,
            velocity: self.velocity + constant * sum.dt + gained,
            ..*self
        }
    }
}
