//! The Rust API: re-exports, and the pipelines that join the crates. No numerics.
//!
//! A [`Recipe`] says which fields of a log are what; a [`Dataset`] is a set of files seen through it. [`fit_pwa`] and [`fit_sparse`] make a [`Model`];
//! [`score`], [`predict`] and [`rollout`] run one on files.
//!
//! ```
//! use fleetfoot::{Recipe, Silent, SindyRequest, fit_sindy};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("log.csv");
//! // A cooling body: T' = -0.5 (T - 20), written in steps of 0.1 s.
//! let row = |k: i32| format!("{},{}\n", 0.1 * f64::from(k), 20.0 + 60.0 * (-0.05 * f64::from(k)).exp());
//! std::fs::write(&log, format!("t,T\n{}", (0..200).map(row).collect::<String>()))?;
//! let recipe = Recipe::parse("[states]\nT = {}\n[library]\nfunctions = [\"poly(2)\"]\n", "example")?;
//! let fitted = fit_sindy(&recipe, SindyRequest::default(), &[log][..], &Silent)?;
//! let equations = fleetfoot::describe(&fitted.model, 1);
//! assert!(equations.contains("f_T = 10 - 0.5*T"), "{equations}");
//! # Ok(())
//! # }
//! ```

// The fuzz targets' bodies, which the tests share, call this crate by its name.
#[cfg(test)]
extern crate self as fleetfoot;

mod controller;
mod dataset;
pub mod demo;
mod error;
mod export;
mod fit;
mod fit_statistic;
mod folder;
mod folds;
pub mod generate;
mod groups;
mod in_words;
mod init;
mod json;
mod known;
mod labels;
mod leak;
mod left_out;
mod list;
mod logs;
mod narx;
mod not_finite;
mod objective;
mod output;
mod period;
pub mod prepare;
mod project;
mod recipe;
mod request;
mod result_page;
mod rollout_choice;
mod rows;
mod run;
mod sindy;
mod sparse_fit;
pub mod statistic;
mod structure;
mod task;
mod wildcard;

/// The page of the Rust API, whose examples are run with these.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/reference/rust.md")]
pub struct RustPage;

pub use controller::controller;
pub use dataset::Dataset;
pub use error::Error;
pub use export::{Exported, engine_vectors, export};
pub use fit::{FitPlan, Fitted, PWA_PASSES, PwaOptions, PwaRequest, fit_pwa, plan_pwa, rival};
pub use folds::FoldRule;
pub use groups::{GroupRule, GroupWords};
pub use in_words::{spans_in_words, useful_in_words};
pub use init::starter_recipe;
pub use json::{interval_in_words, replayed_in_words};
pub use known::{KnownModel, is_known, known_model};
pub use list::items;
pub use logs::Logs;
pub use narx::{
    Effort, FileRun, FileRuns, GivenAs, GivenOrder, MeanRun, NarxCandidate, NarxEquation, NarxFitted, NarxOptions,
    NarxRegion, NarxReport, NarxRequest, NarxScores, NarxSearch, NarxSelection, NarxStage, NarxTerm, OrderRule,
    TermRule, fit_narx,
};
pub use objective::{HeldOutErrors, Objective, RefinedFold, Refinement};
pub use output::write_model;
pub use project::{Projected, project};
pub use recipe::{
    Derivative, EpisodeRule, Gap, Input, InputTable, Join, JoinTable, Kind, LatentSection, LibrarySection, Limits,
    ModelSection, NarxSection, NarxTerms, Normalize, Over, ParameterSection, PartitionChoice, PrepareMethod,
    PrepareSection, PwaSection, Recipe, Settings, SindySection, SpanDerivative, SparseSection, State, TaskSection,
    Time, Tunable, UnseenLabels,
};
pub use request::{Cause, RequestError};
pub use result_page::{Report, ReportOptions, report};
pub use rollout_choice::{HORIZON, RolloutCandidate, RolloutChoice, RolloutRule};
pub use rows::{ModelRows, Rows, model_rows, read_rows};
pub use run::{PredictedRows, RolledOut, Scored, Written, predict, predict_rows, rollout, score};
pub use sindy::{
    Difference, DifferenceErrors, Ensemble, EquationReport, EquationTask, Evidence, FittedEquation, FrontPoint,
    Parameter, ParameterReport, Provenance, RegionReport, SettledDifference, SindyFitted, SindyOptimizer, SindyOptions,
    SindyPlan, SindyReport, SindyRequest, TermReport, Windows, fit_sindy, plan_sindy,
};
pub use sparse_fit::{
    CandidateReport, Criterion, EpisodeInfluence, LambdaChoice, LambdaRule, LatentReport, LeaveOneOutReport, Resampled,
    SolveMethod, Solved, SparseFitted, SparseOptions, SparseReport, SparseRequest, TaskReport, file_by_value,
    fit_sparse, is_statistic, solve_statistic, write_frequencies,
};
pub use structure::{Moments, StructuredTask};
pub use task::Task;

pub use fleetfoot_data as data;
pub use fleetfoot_data::{
    Column, ColumnKind, Episode, EpisodeId, Halo, Progress, Silent, Source, Threads, thread_count, with_threads,
};
pub use fleetfoot_dynamics as dynamics;
pub use fleetfoot_estimate as estimate;
pub use fleetfoot_library as library;
pub use fleetfoot_log as log;
pub use fleetfoot_message as message;
pub use fleetfoot_model::{self as model, Model, describe, describe_transitions};
pub use fleetfoot_pwa as pwa;
pub use fleetfoot_report as report;
pub use fleetfoot_signal as signal;
pub use fleetfoot_sim as sim;
pub use fleetfoot_sparse as sparse;
pub use fleetfoot_stats as stats;
