//! Controllers around models, regulators and filters made of models.

#[path = "../../../dynamics/tests/all/common.rs"]
mod common;
mod controllers;
mod filters;
mod found_noise;
mod regulated_rotations;
mod regulators;
