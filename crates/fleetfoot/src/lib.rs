//! The Rust API: one name for what the crates of the house are. It re-exports, and has no code of its own.
//!
//! A [`Recipe`] says which fields of a log are what; a [`Dataset`] is a set of files seen through it. [`fit()`] makes a [`Model`] by a [`Method`];
//! [`score`], [`predict`] and [`rollout`] run one on files.
//!
//! ```
//! use fleetfoot::{FitRequest, Recipe, Silent, Sindy, fit};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("log.csv");
//! // A cooling body: T' = -0.5 (T - 20), written in steps of 0.1 s.
//! let row = |k: i32| format!("{},{}\n", 0.1 * f64::from(k), 20.0 + 60.0 * (-0.05 * f64::from(k)).exp());
//! std::fs::write(&log, format!("t,T\n{}", (0..200).map(row).collect::<String>()))?;
//! let recipe = Recipe::parse("[states]\nT = {}\n[library]\nfunctions = [\"poly(2)\"]\n", "example")?;
//! let fitted = fit::<Sindy>(&recipe, &FitRequest::default(), &[log][..], &Silent)?;
//! let equations = fleetfoot::describe(&fitted.model, 1);
//! assert!(equations.contains("f_T = 10 - 0.5*T"), "{equations}");
//! # Ok(())
//! # }
//! ```

/// The page of the Rust API, whose examples are run with these.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/reference/rust.md")]
pub struct RustPage;

#[doc(inline)]
pub use fleetfoot_auto::{Auto, AutoOutput, Candidate, HorizonChoice, TestedState, auto};
#[doc(inline)]
pub use fleetfoot_check::{
    ChannelSummary, Checked, Correlations, Fault, Finding, LagCurve, Shift, check, correlations, lag_curve,
};
#[doc(inline)]
pub use fleetfoot_dataset::{
    ColumnRecord, ContentHash, Dataset, EpisodeRecord, EquationGroup, EquationStatistic, FileRecord, Logs, NoRotation,
    ReadPlan, Sizes, StatisticError, StatisticFile, UnitRotations, clocks, folder, is_statistic,
};
#[doc(inline)]
pub use fleetfoot_fit::{Error, *};
#[doc(inline)]
pub use fleetfoot_page::*;
#[doc(inline)]
pub use fleetfoot_recipe::*;
#[doc(inline)]
pub use fleetfoot_run::*;
#[doc(inline)]
pub use fleetfoot_synth::{self as generate, demo};
#[doc(inline)]
pub use fleetfoot_task::{
    CoefficientLimit, Difference, DifferenceErrors, EquationTask, FittedEquation, Moments, Parameter, Provenance,
    SettledDifference, StructuredTask, Task, Windows,
};

pub use fleetfoot_codegen as codegen;
pub use fleetfoot_control as control;
pub use fleetfoot_data as data;
pub use fleetfoot_data::{
    Column, ColumnKind, Episode, EpisodeId, Halo, Progress, Silent, Source, Threads, Work, thread_count, with_threads,
};
pub use fleetfoot_dataset as dataset;
pub use fleetfoot_dynamics as dynamics;
pub use fleetfoot_estimate as estimate;
pub use fleetfoot_fit as fit;
pub use fleetfoot_learn as learn;
pub use fleetfoot_library as library;
pub use fleetfoot_log as log;
pub use fleetfoot_message as message;
pub use fleetfoot_model::{self as model, Model, describe, describe_transitions};
pub use fleetfoot_output as output;
pub use fleetfoot_page as page;
pub use fleetfoot_prepare as prepare;
pub use fleetfoot_pwa as pwa;
pub use fleetfoot_recipe as recipe;
pub use fleetfoot_report as report;
pub use fleetfoot_run as run;
pub use fleetfoot_signal as signal;
pub use fleetfoot_sim as sim;
pub use fleetfoot_sparse as sparse;
pub use fleetfoot_stats as stats;
pub use fleetfoot_sums as sums;
pub use fleetfoot_task as task;
