//! Smoothing, filters and clocks, against closed forms, dense solutions and scipy.

#[path = "../../../../tests/outside.rs"]
mod outside;

mod clocks;
mod common;
mod dense;
mod filters;
mod interpolate;
mod joint;
mod outliers;
mod peer;
mod spline;
mod trend;
