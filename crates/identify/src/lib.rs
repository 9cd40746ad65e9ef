//! From recipe to model: the problem that a recipe and its logs are, and the pipelines of every method. No numerics.
//!
//! A [`Recipe`] says which fields of a log are what; a [`Dataset`] is a set of files seen through it. Every method has a request (what is asked), a
//! plan (what it would cost), a fit and a report: [`fit_pwa`], [`fit_sparse`], [`fit_sindy`], [`fit_narx`], [`fit_parameters`]. [`statistic`] scans logs to the file from
//! which fits need no logs; [`prepare`] cleans raw channels; [`control_lqr`] makes a controller of a model; [`score`], [`predict`] and [`rollout`] run a model on files, and [`report()`] draws
//! what it is worth.
//!
//! Modules have layers: settings (`recipe`), what they mean for a recording (`problem`), what is read (`stats_file`, `logs`, `dataset`, `open`), the methods, sums in place
//! of logs (`statistic`), what models do, and what is told of all of them (`json`, `result_page`).
//!
//! ```
//! use fleetfoot_identify::Recipe;
//!
//! let recipe = Recipe::parse("[states]\nT = {}\n[library]\nfunctions = [\"poly(2)\"]\n", "example")?;
//! assert_eq!(recipe.states.len(), 1);
//! // What a section does not know is an error that tells the place and the nearest name.
//! let wrong = Recipe::parse("[states]\nT = {}\n[sindy]\ntreshold = 0.1\n", "example").unwrap_err();
//! assert!(wrong.to_string().contains("threshold"), "{wrong}");
//! # Ok::<(), fleetfoot_identify::Error>(())
//! ```

// The fuzz targets' bodies, which the tests share, call the Rust API by its name.
#[cfg(test)]
extern crate self as fleetfoot;

mod bounded_maps;
mod concentrated;
mod constant;
mod control;
mod controller;
mod error;
mod export;
mod filter;
mod fit;
mod folds;
mod in_words;
mod json;
mod known;
mod left_out;
mod limit_report;
mod narx;
mod not_finite;
mod objective;
mod output;
mod parameters;
mod project;
mod regions;
mod resimulate;
mod result_page;
mod rollout_choice;
mod rows;
mod run;
mod sindy;
mod spans;
mod sparse_fit;
pub mod statistic;
mod subset;
mod told;
mod told_table;

pub use bounded_maps::{BoundedCandidate, BoundedMaps, PassiveMaps, PassivePort};
pub use control::{ControllerFile, ControllerRecord, LqrRecord, SetPointRecord, control_lqr};
pub use controller::{controller, controller_file, made_controller};
pub use error::Error;
pub use export::{Exported, engine_vectors, export, export_filter};
pub use filter::{
    DeviationFrom, Filtered, FilteredRows, SensorReport, SquareReport, TruthReport, filter, filter_of, filter_rows,
};
pub use fit::{FitPlan, Fitted, PWA_PASSES, PwaOptions, PwaRequest, fit_pwa, plan_pwa, rival};
pub use fleetfoot_dataset::{
    ColumnRecord, ContentHash, Dataset, EpisodeRecord, EquationGroup, EquationStatistic, FileRecord, Logs, NoRotation,
    ReadPlan, Settled, Sizes, StatisticError, StatisticFile, clocks, folder, is_statistic,
};
pub use fleetfoot_recipe::*;
pub use fleetfoot_task::{
    CoefficientLimit, Difference, DifferenceErrors, EquationTask, FittedEquation, Moments, Parameter, Provenance,
    SettledDifference, StructuredTask, Task, Windows,
};
pub use folds::FoldRule;
pub use in_words::{interval_in_words, replayed_in_words, spans_in_words, useful_in_words};
pub use json::Interval;
pub use known::{KnownModel, is_known, known_model};
pub use limit_report::{FreeErrors, LimitReport, LimitSide};
pub use narx::{
    FileRun, FileRuns, GivenOrder, MeanRun, NarxCandidate, NarxEquation, NarxFitted, NarxOptions, NarxRegion,
    NarxReport, NarxRequest, NarxScores, NarxSearch, NarxStage, NarxTerm, OrderRule, TermRule, fit_narx,
};
pub use objective::{Bounded, HeldOutErrors, RefinedFold, Refinement, WeightErrors, simulation_cost};
pub use output::{layout_files, write_model};
pub use parameters::{
    ConfoundedPair, GainInterval, ParameterInterval, ParametersFitted, ParametersHeldOut, ParametersReport,
    fit_parameters,
};
pub use project::{Projected, project};
pub use resimulate::{Followed, Spread, resimulate};
pub use result_page::{FigureFormat, Report, ReportOptions, report};
pub use rollout_choice::{HORIZON, RolloutCandidate, RolloutChoice, RolloutRule};
pub use rows::{ModelRows, Rows, model_rows, read_rows};
pub use run::{PredictedRows, RolledOut, Scored, Written, predict, predict_rows, rollout, score};
pub use sindy::{
    Ensemble, EquationReport, Evidence, FrontPoint, ParameterReport, RegionReport, SindyFitted, SindyOptions,
    SindyPlan, SindyReport, SindyRequest, StateNoise, StateSmoothing, TermReport, fit_sindy, plan_sindy,
};
pub use sparse_fit::{
    CandidateReport, EpisodeInfluence, LambdaChoice, LambdaRule, LatentReport, LeaveOneOutReport, PathReport,
    Resampled, SolveMethod, Solved, SparseFitted, SparseOptions, SparseReport, SparseRequest, TaskReport,
    file_by_value, fit_sparse, solve_statistic, write_frequencies,
};
pub use told_table::ToldTable;
