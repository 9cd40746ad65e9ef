//! Angles.

use fleetfoot_library::Unary;

/// The same angle within (-pi, pi].
#[inline(always)]
pub fn wrap(angle: f64) -> f64 {
    Unary::Wrap.apply(angle)
}
