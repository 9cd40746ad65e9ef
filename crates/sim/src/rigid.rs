//! Rigid-body worlds at the scale of small robots: centimetres and grams, z up.

mod belt;
mod contact;
mod world;

#[cfg(test)]
mod tests;

pub use belt::Belt;
pub use contact::Contact;
pub use world::{add_ground, physics_world, robot_groups};
