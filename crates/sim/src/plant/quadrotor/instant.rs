//! True values of a flight at one time.

use glam::{DVec3, DVec4};

use super::airframe::{Loads, QuadrotorState};

/// One instant of a flight.
pub(super) struct Instant {
    pub(super) state: QuadrotorState,
    pub(super) command: DVec4,
    pub(super) wind: DVec3,
    pub(super) loads: Loads,
}
