//! What models do: simulated, scored, closed.

mod common;
mod controllers;
mod filters;
mod horizons;
mod latents;
mod plane;
mod regulated_rotations;
mod regulators;
mod replayed;
mod rollouts;
mod rotations;
mod scores;
mod sensitivities;
mod simulations;
mod steppers;
mod stiff;
