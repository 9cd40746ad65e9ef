//! The Python package: conversion, exceptions, estimators.
//!
//! This crate is the module `fleetfoot._core`: thin functions and classes that turn Python objects into the engine's
//! inputs and its answers into Python objects. The public package is `python/fleetfoot`, which is written in Python on
//! top of it. The command of the same name is in it, too.

mod array;
mod command;
mod data;
mod error;
mod run;
mod words;

// -- lars
mod design;
mod lars;
mod matrix;

// -- lasso
mod array_source;
mod bolasso;
mod coordinate;
mod estimator;

// -- clusters and thresholds
mod clusters;
mod pwa;
mod thresholds;

// -- identification
mod fit;
mod model;
mod object;
mod on_data;
mod points;
mod simulate;
mod sparse_array;

// -- statistics
mod statistic;

// -- tables
mod arrow;
mod arrow_column;
mod auto;
mod capsule;
mod check;
mod frequency;
mod generate;
mod prepare;
mod read;
mod recipe;
mod table;
mod table_rows;

use pyo3::prelude::*;

/// The engine of fleetfoot.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::command::command;
    #[pymodule_export]
    use crate::data::Data;
    #[pymodule_export]
    use crate::run::{set_threads, thread_count};

    // -- lars
    #[pymodule_export]
    use crate::design::Design;
    #[pymodule_export]
    use crate::lars::{LarsPath, lars_fold_errors, lars_path_of_products, lars_paths};

    // -- lasso
    #[pymodule_export]
    use crate::bolasso::{bolasso, row_counts, unit_counts};
    #[pymodule_export]
    use crate::coordinate::{Problems, fold_errors};
    #[pymodule_export]
    use crate::estimator::Estimator;

    // -- clusters and thresholds
    #[pymodule_export]
    use crate::clusters::{KMeansPoints, kmeans_assign, kmeans_distances, kmeans_draws};
    #[pymodule_export]
    use crate::pwa::{PwaFit, pwa_regions};
    #[pymodule_export]
    use crate::thresholds::{SparseModels, frols, sr3, stlsq};

    // -- identification
    #[pymodule_export]
    use crate::fit::{fit, override_settings, recipe_json, settings};
    #[pymodule_export]
    use crate::model::{Model, check_controller, export_controller, export_filter, write_controller};
    #[pymodule_export]
    use crate::on_data::{filter, predict_rows, report, resimulate, rollout, score};
    #[pymodule_export]
    use crate::simulate::{TimeGrid, simulate, time_grid};

    // -- statistics
    #[pymodule_export]
    use crate::statistic::Statistic;

    // -- tables
    #[pymodule_export]
    use crate::auto::auto;
    #[pymodule_export]
    use crate::check::{check, correlations, lag_curve};
    #[pymodule_export]
    use crate::frequency::frequency;
    #[pymodule_export]
    use crate::generate::{generate, project, robots, world};
    #[pymodule_export]
    use crate::prepare::prepare;
    #[pymodule_export]
    use crate::read::{info, read_messages, read_model_rows, read_table, student_t_95, topics};
    #[pymodule_export]
    use crate::recipe::recipe;
    #[pymodule_export]
    use crate::table::Table;

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    /// Gives messages the words of Python, and refuses an unknown instruction set of the environment, when the package is imported.
    #[pymodule_init]
    fn begin(_module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        fleetfoot::data::setting::word_as(&crate::words::Arguments);
        fleetfoot::data::check_instruction_set()
            .map_err(|error| pyo3::exceptions::PyImportError::new_err(error.to_string()))
    }
}
