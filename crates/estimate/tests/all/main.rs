//! Nonlinear parameters, against published answers and known truth.

mod aircraft;
mod least_squares;
mod nist;
