//! Controllers around models, regulators and filters made of models.

#[path = "../../../dynamics/tests/all/common.rs"]
mod common;
mod controllers;
mod estimated_noise;
mod filters;
mod regulated_rotations;
mod regulators;
