//! Statistics and solves, against higher precision and their own laws.

mod accuracy;
mod degenerate;
mod properties;
mod reduction;
mod well_conditioned;
