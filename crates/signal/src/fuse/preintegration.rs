//! What an inertial sensor measures between two instants, summed once for all states that may stand there.
//!
//! Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration for real-time visual-inertial odometry", IEEE Transactions on Robotics 33(1), 2017, sections V and VI.
//! Between its stamps the sensor is interpolated linearly, and the middle of a step stands for it: of second order in the step. The noise is white in continuous time, so that its covariance is
//! positive however short the interval is.

use nalgebra::SMatrix;

use super::rotation::{Matrix, Rotation, Vector, exp, normalised, right_jacobian};
use super::{ImuNoise, ImuRecord};

/// Covariance of rotation, velocity and position.
pub(super) type Covariance = SMatrix<f64, 9, 9>;

/// The motion between two instants in the frame of the first, without gravity, and how it depends on the biases.
#[derive(Debug, Clone)]
pub(super) struct Preintegrated {
    /// Seconds.
    pub(super) dt: f64,
    /// The turn.
    pub(super) rotation: Rotation,
    /// The change of velocity, m/s.
    pub(super) velocity: Vector,
    /// What the specific force displaced, m.
    pub(super) position: Vector,
    /// Slopes with respect to the biases of gyroscope (g) and accelerometer (a).
    pub(super) rotation_g: Matrix,
    pub(super) velocity_g: Matrix,
    pub(super) velocity_a: Matrix,
    pub(super) position_g: Matrix,
    pub(super) position_a: Matrix,
    /// Covariance of the noise of rotation (in the last frame), velocity, position.
    pub(super) covariance: Covariance,
}

/// Angular rate and specific force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub(super) rate: Vector,
    pub(super) force: Vector,
}

impl ImuRecord<'_> {
    /// The sample whose step to the next one holds `t`; the first and the last step go on beyond the ends.
    fn step_at(&self, t: f64) -> usize {
        self.times.partition_point(|&time| time <= t).clamp(1, self.times.len() - 1) - 1
    }

    /// Whether there is an accelerometer.
    pub(super) fn has_forces(&self) -> bool {
        !self.forces.is_empty()
    }

    /// The reading at `t`, within the step after sample `k`: interpolated, and held beyond the ends of the record.
    fn interpolated(&self, k: usize, t: f64) -> Reading {
        let share = ((t - self.times[k]) / (self.times[k + 1] - self.times[k])).clamp(0.0, 1.0);
        let between = |values: &[[f64; 3]]| {
            let (a, b) = (Vector::from(values[k]), Vector::from(values[k + 1]));
            a + share * (b - a)
        };
        let force = if self.has_forces() { between(self.forces) } else { Vector::zeros() };
        Reading { rate: between(self.rates), force }
    }

    /// The reading at `t`.
    pub(super) fn at(&self, t: f64) -> Reading {
        self.interpolated(self.step_at(t), t)
    }

    /// Steps from `from` to `to`, cut at the stamps: their lengths, and the readings in their middles.
    fn steps(&self, from: f64, to: f64) -> impl Iterator<Item = (f64, Reading)> {
        let (mut k, mut t) = (self.step_at(from), from);
        std::iter::from_fn(move || {
            if t >= to {
                return None;
            }
            let end = if k + 2 < self.times.len() { self.times[k + 1].min(to) } else { to };
            let step = (end - t, self.interpolated(k, 0.5 * (t + end)));
            (k, t) = (k + 1, end);
            Some(step)
        })
    }
}

impl Preintegrated {
    /// Nothing yet.
    fn none() -> Self {
        Self {
            dt: 0.0,
            rotation: Rotation::identity(),
            velocity: Vector::zeros(),
            position: Vector::zeros(),
            rotation_g: Matrix::zeros(),
            velocity_g: Matrix::zeros(),
            velocity_a: Matrix::zeros(),
            position_g: Matrix::zeros(),
            position_a: Matrix::zeros(),
            covariance: Covariance::zeros(),
        }
    }

    /// What the sensor measures from `from` to `to`, with these biases of gyroscope and accelerometer taken off.
    pub(super) fn new(imu: &ImuRecord<'_>, from: f64, to: f64, biases: &[Vector; 2], noise: &ImuNoise) -> Self {
        let mut sum = Self::none();
        for (dt, reading) in imu.steps(from, to) {
            sum.step(dt, &(reading.rate - biases[0]), &(reading.force - biases[1]), noise);
        }
        sum.rotation = normalised(&sum.rotation);
        sum
    }

    fn step(&mut self, dt: f64, rate: &Vector, force: &Vector, noise: &ImuNoise) {
        let turn = rate * dt;
        let half = 0.5 * turn;
        let (whole_turn, half_turn) = (exp(&turn), exp(&half));
        let back = whole_turn.inverse().to_rotation_matrix().into_inner();
        // The middle of the step, and its slope with respect to the gyroscope's bias.
        let middle = (self.rotation * half_turn).to_rotation_matrix().into_inner();
        let middle_g = half_turn.inverse().to_rotation_matrix() * self.rotation_g - right_jacobian(&half) * (0.5 * dt);
        let (push, turned) = (middle * force, middle * force.cross_matrix());
        self.propagate(dt, &back, &turned, noise);
        let by_rate = turned * middle_g;
        self.position += self.velocity * dt + push * (0.5 * dt * dt);
        self.position_g += self.velocity_g * dt - by_rate * (0.5 * dt * dt);
        self.position_a += self.velocity_a * dt - middle * (0.5 * dt * dt);
        self.velocity += push * dt;
        self.velocity_g -= by_rate * dt;
        self.velocity_a -= middle * dt;
        self.rotation_g = back * self.rotation_g - right_jacobian(&turn) * dt;
        self.rotation *= whole_turn;
        self.dt += dt;
    }

    /// A P A' + Q over a step: white noise of the rate turns, that of the force is integrated once and twice.
    fn propagate(&mut self, dt: f64, back: &Matrix, turned: &Matrix, noise: &ImuNoise) {
        let (v, p) = (turned * -dt, turned * (-0.5 * dt * dt));
        // A changes three rows at a time: the whole product would be four times the work.
        let advance = |half: &Covariance| {
            let rows = |from: usize| half.fixed_view::<3, 9>(from, 0).into_owned();
            let (turn, velocity, position) = (rows(0), rows(3), rows(6));
            let mut next = Covariance::zeros();
            next.fixed_view_mut::<3, 9>(0, 0).copy_from(&(back * turn));
            next.fixed_view_mut::<3, 9>(3, 0).copy_from(&(velocity + v * turn));
            next.fixed_view_mut::<3, 9>(6, 0).copy_from(&(position + velocity * dt + p * turn));
            next
        };
        let mut moved = advance(&advance(&self.covariance).transpose());
        let (gyro, force) = (noise.gyro * noise.gyro * dt, noise.accelerometer * noise.accelerometer * dt);
        for axis in 0..3 {
            let (v, p) = (3 + axis, 6 + axis);
            moved[(axis, axis)] += gyro;
            moved[(v, v)] += force;
            moved[(v, p)] += force * dt / 2.0;
            moved[(p, v)] += force * dt / 2.0;
            moved[(p, p)] += force * dt * dt / 3.0;
        }
        self.covariance = moved;
    }

    /// Turn, change of velocity and displacement when the biases are these much greater.
    pub(super) fn corrected(&self, gyro: &Vector, accelerometer: &Vector) -> (Rotation, Vector, Vector) {
        let rotation = self.rotation * exp(&(self.rotation_g * gyro));
        let velocity = self.velocity + self.velocity_g * gyro + self.velocity_a * accelerometer;
        let position = self.position + self.position_g * gyro + self.position_a * accelerometer;
        (rotation, velocity, position)
    }
}
