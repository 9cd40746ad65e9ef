//! Nonlinear parameters and coefficients by simulation, against published answers, known truth and scipy.

#[path = "../../../../tests/outside.rs"]
mod outside;

mod aircraft;
mod filter_error;
mod least_squares;
mod many_coefficients;
mod matrix_limits;
mod nist;
mod output_error;
mod resimulation;
mod search;
mod simulation;
mod smoothing;
