//! Indices of the topics, in the order in which the scenario names them.

pub(super) const ODOMETRY: usize = 0;
pub(super) const IMU: usize = 1;
pub(super) const JOINTS: usize = 2;
pub(super) const COMMAND: usize = 3;
pub(super) const VOLTAGE: usize = 4;
pub(super) const BUMPER: usize = 5;
pub(super) const TRUE_ODOMETRY: usize = 6;
pub(super) const TRUE_WHEELS: usize = 7;
pub(super) const TRUE_COMMAND: usize = 8;
pub(super) const TRUE_VOLTAGE: usize = 9;
