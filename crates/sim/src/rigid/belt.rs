//! A surface that moves under the bodies on it.

use glam::DVec3;
use rapier3d_f64::prelude::*;

/// A collider whose surface moves while it stays where it is: a treadmill's belt.
///
/// Hand it to the engine's step as the hooks. Its collider needs `ActiveHooks::MODIFY_SOLVER_CONTACTS`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belt {
    /// Body of the surface.
    pub collider: ColliderHandle,
    /// Of the surface, in the world, m/s.
    pub velocity: DVec3,
}

impl PhysicsHooks for Belt {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext<'_>) {
        // The engine's tangent velocity is extra motion of the first collider's surface, and either may be first.
        let velocity = if context.collider1 == self.collider {
            self.velocity
        } else if context.collider2 == self.collider {
            -self.velocity
        } else {
            return;
        };
        if let Some(rigid) = context.rigid_mut() {
            for contact in rigid.solver_contacts.iter_mut() {
                contact.tangent_velocity = velocity;
            }
        }
    }
}
