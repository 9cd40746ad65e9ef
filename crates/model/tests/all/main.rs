//! Models in files, and models as code.

#[path = "../../../../tests/outside.rs"]
mod outside;

mod export;
mod file;
mod models;
mod transitions;
