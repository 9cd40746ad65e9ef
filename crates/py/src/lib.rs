//! The Python package: conversion, exceptions, estimators.
//!
//! This crate is the module `fleetfoot._core`: thin functions and classes that turn Python objects into what the engine reads and its answers into
//! Python objects. What Python users see is the package in `python/fleetfoot`, which is written in Python on top of it.

mod array;
mod data;
mod error;
mod run;

// -- lars
mod design;
mod lars;

// -- lasso

// -- clusters and thresholds
mod clusters;
mod pwa;
mod thresholds;

// -- identification

// -- statistics

// -- tables

use pyo3::prelude::*;

/// The engine of fleetfoot.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::data::Data;
    #[pymodule_export]
    use crate::run::{set_threads, thread_count};

    // -- lars
    #[pymodule_export]
    use crate::design::Design;
    #[pymodule_export]
    use crate::lars::{LarsPath, lars_path_of_products, lars_paths};

    // -- lasso

    // -- clusters and thresholds
    #[pymodule_export]
    use crate::clusters::{KMeansPoints, kmeans_assign, kmeans_distances, kmeans_draws};
    #[pymodule_export]
    use crate::pwa::{PwaFit, pwa_regions};
    #[pymodule_export]
    use crate::thresholds::{SparseModels, frols, sr3, stlsq};

    // -- identification

    // -- statistics

    // -- tables

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
