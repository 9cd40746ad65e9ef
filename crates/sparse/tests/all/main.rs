//! Sparse regression, against certificates, peers and laws.

mod bolasso;
mod bounded;
mod clarabel;
mod common;
mod constrained;
mod coordinate;
mod degenerate;
mod groups;
mod inference;
mod lars;
mod laws;
mod limits;
mod problem;
mod pysindy;
mod select;
mod sklearn;
mod structured;
mod thresholds;
