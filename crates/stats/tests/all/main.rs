//! Statistics and solves, against higher precision and laws.

mod accuracy;
mod degenerate;
mod properties;
mod reduction;
mod well_conditioned;
