//! A body with a motion in closed form, and the readings of its sensors.

use fleetfoot_data::mix;

use crate::fuse::{
    BodyNoise, BodyRun, BodyState, ImuNoise, ImuRecord, PoseRecord,
    rotation::rotation,
    rotation::{Rotation, Vector, exp, log},
    state::StateError,
};

pub(super) const GRAVITY: [f64; 3] = [0.1, -0.2, -9.8];
pub(super) const LEVER: [f64; 3] = [0.07, -0.03, -0.12];
/// Far from the identity.
pub(super) const MOUNTING: [f64; 3] = [2.0, -1.5, 0.7];
pub(super) const OFFSET: f64 = 0.193;
pub(super) const NOISE: BodyNoise =
    BodyNoise { imu: ImuNoise::even(1e-3, 1e-2, 1e-3, 5e-3), position: 1e-3, attitude: 3e-3, jerk: 10.0 };

fn uniform(seed: u64, at: u64) -> f64 {
    (mix(mix(seed).wrapping_add(at)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A standard normal number with this address (Box and Muller).
fn normal(seed: u64, at: u64) -> f64 {
    let (a, b) = (uniform(seed, 2 * at), uniform(seed, 2 * at + 1));
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

fn normals(seed: u64, at: u64) -> Vector {
    Vector::from_fn(|axis, _| normal(seed, 3 * at + axis as u64))
}

fn attitude(t: f64) -> Rotation {
    exp(&Vector::new(0.9 * (1.3 * t).sin(), 0.7 * (0.9 * t + 1.0).sin(), 1.5 * (0.5 * t).sin()))
        * exp(&Vector::new(0.2 * (2.9 * t).cos(), 0.0, 0.3 * (2.1 * t + 0.3).sin()))
}

const AXES: [[f64; 3]; 3] = [[1.0, 1.1, 0.2], [0.7, 1.7, 1.4], [0.4, 2.3, 0.9]];

fn position(t: f64) -> Vector {
    Vector::from(AXES.map(|[size, rate, phase]| size * (rate * t + phase).sin()))
}

fn velocity(t: f64) -> Vector {
    Vector::from(AXES.map(|[size, rate, phase]| size * rate * (rate * t + phase).cos()))
}

fn acceleration(t: f64) -> Vector {
    Vector::from(AXES.map(|[size, rate, phase]| -size * rate * rate * (rate * t + phase).sin()))
}

/// By a central difference, whose error is 1e-10.
fn rate(t: f64) -> Vector {
    let h = 1e-5;
    log(&(attitude(t - h).inverse() * attitude(t + h))) / (2.0 * h)
}

/// A recording, and the biases that nobody measures.
pub(super) struct Recording {
    pub(super) times: Vec<f64>,
    rates: Vec<[f64; 3]>,
    forces: Vec<[f64; 3]>,
    pub(super) stamps: Vec<f64>,
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) attitudes: Vec<[f64; 4]>,
    biases: Vec<[Vector; 2]>,
    averages: [f64; 2],
    kicks: Vec<Kick>,
}

/// A jump of rate and velocity.
struct Kick {
    at: f64,
    /// rad/s about the first axis of the body.
    turn: f64,
    /// m/s in the world.
    push: Vector,
}

impl Recording {
    /// Readings at 200 Hz, poses at 100 Hz; biases begin as a prior of deviations 0.05 and 0.2 has them.
    pub(super) fn new(seconds: f64, seed: u64) -> Self {
        let (dt, seed) = (0.005, 100 * seed);
        let times: Vec<f64> = (0..=(seconds / dt) as usize).map(|row| dt * row as f64).collect();
        let imu = NOISE.imu;
        let mut walk = [normals(seed, 0) * 0.05, normals(seed + 1, 0) * 0.2];
        let (mut biases, mut rates, mut forces) = (Vec::new(), Vec::new(), Vec::new());
        for (&t, row) in times.iter().zip(0..) {
            biases.push(walk);
            let white = (normals(seed + 2, row), normals(seed + 3, row));
            let force = attitude(t).inverse() * (acceleration(t) - Vector::from(GRAVITY));
            rates.push((rate(t) + walk[0] + white.0 * (imu.gyro[0] / dt.sqrt())).into());
            forces.push((force + walk[1] + white.1 * (imu.accelerometer[0] / dt.sqrt())).into());
            walk[0] += normals(seed + 4, row) * (imu.gyro_walk * dt.sqrt());
            walk[1] += normals(seed + 5, row) * (imu.accelerometer_walk * dt.sqrt());
        }
        let (averages, kicks) = ([0.0; 2], vec![]);
        let empty = (vec![], vec![], vec![]);
        let (stamps, positions, attitudes) = empty;
        let mut recording = Self { times, rates, forces, stamps, positions, attitudes, biases, averages, kicks };
        let mounting = exp(&Vector::from(MOUNTING));
        for row in 0..(seconds / 0.01) as u64 - 2 {
            let t = 0.01 * row as f64 + 0.0083;
            let seen = attitude(t) * mounting * exp(&(normals(seed + 6, row) * NOISE.attitude));
            let marker = position(t) + attitude(t) * Vector::from(LEVER) + normals(seed + 7, row) * NOISE.position;
            recording.stamps.push(t - OFFSET);
            recording.positions.push(marker.into());
            recording.attitudes.push([seen.i, seen.j, seen.k, seen.w]);
        }
        recording
    }

    /// The same body kicked again and again: it turns about an axis of its own at a rate that jumps at any moment, and its velocity jumps. Rates are of their stamps; forces are means over the time since the last.
    pub(super) fn kicked(seconds: f64, seed: u64) -> Self {
        let mut body = Self { averages: [0.0, 0.005], ..Self::new(seconds, seed) };
        let mut at = 0.0;
        for number in 0.. {
            at += 0.02 + 0.1 * uniform(1000 + seed, number);
            if at > seconds {
                break;
            }
            let size = normals(2000 + seed, number);
            body.kicks.push(Kick { at, turn: 1.5 * size.x, push: Vector::new(0.0, 0.02 * size.y, 0.05 * size.z) });
        }
        let seed = 100 * seed;
        for (row, &t) in body.times.iter().enumerate() {
            let (white, [gyro, bias]) =
                ((normals(seed + 2, row as u64), normals(seed + 3, row as u64)), body.biases[row]);
            body.rates[row] = (body.rate(t) + gyro + white.0 * (NOISE.imu.gyro[0] / 0.005_f64.sqrt())).into();
            // The axes of the middle of the window are those of its mean.
            let (from, middle) = (t - 0.005, body.attitude(t - 0.0025));
            let steps = (0..50).map(|step| acceleration(from + 1e-4 * (f64::from(step) + 0.5)) / 50.0);
            let pushes = body.kicks.iter().filter(|kick| from < kick.at && kick.at <= t).map(|kick| kick.push / 0.005);
            let mean: Vector = steps.chain(pushes).sum();
            let force = middle.inverse() * (mean - Vector::from(GRAVITY));
            body.forces[row] = (force + bias + white.1 * (NOISE.imu.accelerometer[0] / 0.005_f64.sqrt())).into();
        }
        let mounting = exp(&Vector::from(MOUNTING));
        for row in 0..body.stamps.len() {
            let t = body.stamps[row] + OFFSET;
            let seen = body.attitude(t) * mounting * exp(&(normals(seed + 6, row as u64) * NOISE.attitude));
            let marker = body.position(t) + body.attitude(t) * Vector::from(LEVER);
            body.positions[row] = (marker + normals(seed + 7, row as u64) * NOISE.position).into();
            body.attitudes[row] = [seen.i, seen.j, seen.k, seen.w];
        }
        body
    }

    /// Sum of the kicks until now: the angle and its rate, the displacement and its rate.
    fn kicked_by(&self, t: f64) -> (f64, f64, Vector, Vector) {
        let before = self.kicks.iter().filter(|kick| kick.at <= t);
        before.fold((0.0, 0.0, Vector::zeros(), Vector::zeros()), |(angle, rate, place, speed), kick| {
            let since = t - kick.at;
            (angle + kick.turn * since, rate + kick.turn, place + kick.push * since, speed + kick.push)
        })
    }

    fn attitude(&self, t: f64) -> Rotation {
        attitude(t) * exp(&Vector::new(self.kicked_by(t).0, 0.0, 0.0))
    }

    /// In the body.
    pub(super) fn rate(&self, t: f64) -> Vector {
        let (angle, kicked, ..) = self.kicked_by(t);
        exp(&Vector::new(-angle, 0.0, 0.0)) * rate(t) + Vector::new(kicked, 0.0, 0.0)
    }

    fn position(&self, t: f64) -> Vector {
        position(t) + self.kicked_by(t).2
    }

    fn velocity(&self, t: f64) -> Vector {
        velocity(t) + self.kicked_by(t).3
    }

    /// The errors of rate and acceleration; the acceleration is that of a body that nobody kicks.
    pub(super) fn read_error(&self, state: &BodyState) -> [Vector; 2] {
        let t = state.time;
        [self.rate(t) - Vector::from(state.rate), acceleration(t) - Vector::from(state.acceleration)]
    }

    pub(super) fn imu(&self) -> ImuRecord<'_> {
        ImuRecord { times: &self.times, rates: &self.rates, forces: &self.forces, averages: self.averages }
    }

    pub(super) fn run(&self) -> BodyRun<'_> {
        let poses = PoseRecord { times: &self.stamps, positions: &self.positions, attitudes: &self.attitudes };
        BodyRun { imu: self.imu(), poses }
    }

    /// The same without an accelerometer: the last three numbers are of the acceleration.
    pub(super) fn alone_error(&self, state: &BodyState) -> StateError {
        let mut error = self.error(state);
        let last = acceleration(state.time) - Vector::from(state.acceleration);
        error.fixed_rows_mut::<3>(12).copy_from(&last);
        error
    }

    /// The error of a state as it would be added to it.
    pub(super) fn error(&self, state: &BodyState) -> StateError {
        let t = state.time;
        let at = t / 0.005;
        let row = (at as usize).min(self.biases.len() - 2);
        let bias = |which: usize| {
            let (a, b) = (self.biases[row][which], self.biases[row + 1][which]);
            a + (b - a) * (at - row as f64)
        };
        let parts = [
            log(&(rotation(&state.attitude).inverse() * self.attitude(t))),
            self.position(t) - Vector::from(state.position),
            self.velocity(t) - Vector::from(state.velocity),
            bias(0) - Vector::from(state.gyro_bias),
            bias(1) - Vector::from(state.accelerometer_bias),
        ];
        StateError::from_fn(|i, _| parts[i / 3][i % 3])
    }
}
