//! The studies at a small scale: what their papers and their peers say, they say.

#[path = "../../../../tests/outside.rs"]
mod outside;

mod aircraft_study;
mod export;
mod filters;
mod goldens;
mod regulators;
mod sindy_study;
