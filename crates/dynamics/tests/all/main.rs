//! Tests of models: simulated, scored, closed.

mod common;
mod controllers;
mod horizons;
mod latents;
mod network;
mod plane;
mod radial;
mod replayed;
mod rollouts;
mod rotations;
mod scores;
mod sensitivities;
mod simulations;
mod steppers;
mod stiff;
