//! Controllers around models, regulators and filters made of models.

#[path = "../../../dynamics/tests/all/common.rs"]
mod common;
mod controllers;
mod estimated_noise;
mod filters;
mod interior;
mod planned;
mod predictive;
mod regulated_rotations;
mod regulators;
