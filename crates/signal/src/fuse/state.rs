//! The state of a body at an instant, the constants that all instants share, and how both move along their errors.

use nalgebra::{SMatrix, SVector};

use super::rotation::{Rotation, Vector, exp, normalised};

/// Numbers of a state's error: attitude (in the body frame), position, velocity, bias of the gyroscope, bias of the accelerometer.
pub(super) const STATE: usize = 15;
/// Numbers of the constants' errors: lever (3), mounting (3), offset (1), direction of gravity (2).
pub(super) const BORDER: usize = 9;

/// First indices of the parts of a state's error.
pub(super) mod part {
    pub(in crate::fuse) const ATTITUDE: usize = 0;
    pub(in crate::fuse) const POSITION: usize = 3;
    pub(in crate::fuse) const VELOCITY: usize = 6;
    pub(in crate::fuse) const GYRO: usize = 9;
    pub(in crate::fuse) const ACCELEROMETER: usize = 12;
    pub(in crate::fuse) const LEVER: usize = 0;
    pub(in crate::fuse) const MOUNTING: usize = 3;
    pub(in crate::fuse) const OFFSET: usize = 6;
    pub(in crate::fuse) const GRAVITY: usize = 7;
}

/// The error of a state.
pub(super) type StateError = SVector<f64, STATE>;
/// The error of the constants.
pub(super) type BorderError = SVector<f64, BORDER>;

/// The state of a body.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct State {
    /// Body to world.
    pub(super) attitude: Rotation,
    /// m, in the world.
    pub(super) position: Vector,
    /// m/s, in the world.
    pub(super) velocity: Vector,
    /// rad/s, in the body.
    pub(super) gyro: Vector,
    /// m/s^2, in the body; without an accelerometer the acceleration in the world.
    pub(super) accelerometer: Vector,
}

impl State {
    /// The state whose error this was.
    pub(super) fn moved(&self, error: &StateError) -> Self {
        let of = |from: usize| error.fixed_rows::<3>(from).into_owned();
        Self {
            attitude: normalised(&(self.attitude * exp(&of(part::ATTITUDE)))),
            position: self.position + of(part::POSITION),
            velocity: self.velocity + of(part::VELOCITY),
            gyro: self.gyro + of(part::GYRO),
            accelerometer: self.accelerometer + of(part::ACCELEROMETER),
        }
    }
}

/// The constants.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Border {
    /// The origin of the markers' frame in the body frame, m.
    pub(super) lever: Vector,
    /// The markers' frame to the body frame.
    pub(super) mounting: Rotation,
    /// Lateness of the poses behind the nodes, s.
    pub(super) late: f64,
    /// In the world, m/s^2.
    pub(super) gravity: Vector,
}

impl Border {
    /// The constants whose error this was.
    pub(super) fn moved(&self, error: &BorderError) -> Self {
        let tilted = self.gravity + self.gravity_slope() * error.fixed_rows::<2>(part::GRAVITY);
        Self {
            lever: self.lever + error.fixed_rows::<3>(part::LEVER),
            mounting: normalised(&(self.mounting * exp(&error.fixed_rows::<3>(part::MOUNTING).into_owned()))),
            late: self.late + error[part::OFFSET],
            gravity: tilted * (self.gravity.norm() / tilted.norm()),
        }
    }

    /// Derivative of gravity with respect to the two angles of its direction.
    pub(super) fn gravity_slope(&self) -> SMatrix<f64, 3, 2> {
        let size = self.gravity.norm();
        let down = self.gravity / size;
        // The axis that gravity points along least: the first of equals.
        let across = Vector::ith(down.iamin(), 1.0);
        let first = down.cross(&across).normalize();
        SMatrix::from_columns(&[first * size, down.cross(&first) * size])
    }
}
