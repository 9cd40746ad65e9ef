//! One pipeline for the fits of all methods: from a recipe and its logs, or their statistic, to a model and a report of
//! its errors.
//!
//! [`fit`] is the pipeline, [`plan`] gives its cost. The parts that differ between methods are a [`Method`]: [`Pwa`],
//! [`Sindy`], [`Sparse`], [`Narx`], [`Parameters`]. [`statistic`] scans logs to the file from which fits need no logs.

// The fuzz targets' bodies, which the tests share, call the Rust API by its name.
#[cfg(test)]
extern crate self as fleetfoot;

mod baselines;
mod beneath;
mod bounded_maps;
mod by_time;
mod concentration;
mod constant;
mod error;
mod folds;
mod held_inputs;
mod imported;
mod incomplete;
mod interval;
mod json;
mod known;
mod label_key;
mod last_rows;
mod limit_report;
mod method;
mod model_file;
mod narx;
mod network;
mod not_finite;
mod objective;
mod parameters;
mod pipeline;
mod plan;
mod pwa;
mod radial;
mod regions;
mod rollout_choice;
mod serialize;
mod simulated_folds;
mod sindy;
mod spans;
mod sparse;
pub mod statistic;
mod subset;
mod summary;
mod text_table;
mod words;
mod worth;

pub use baselines::TargetBaselines;
pub use bounded_maps::{BoundedCandidate, BoundedMaps, PassiveMaps, PassivePort, unexplained};
pub use by_time::{ByTime, TargetByTime};
pub use error::Error;
pub use folds::FoldRule;
pub use imported::{ImportedModel, import_network};
pub use interval::Interval;
pub use known::{KnownModel, is_known, known_model};
pub use limit_report::{FreeErrors, LimitReport, LimitSide};
pub use method::{FitReport, FitRequest, Fitted, Method, Rival, rival_file};
pub use model_file::write_model;
pub use narx::{
    FileRun, FileRuns, GivenOrder, MeanRun, Narx, NarxCandidate, NarxEquation, NarxOptions, NarxRegion, NarxReport,
    NarxScores, NarxSearch, NarxStage, NarxTerm, OrderRule, PastRows, TermRule, free_runs_by_file, late_inputs,
};
pub use network::{LagChoice, Network, NetworkCandidate, NetworkErrors, NetworkReport, NetworkSolution};
pub use objective::{Bounded, HeldOutErrors, RefinedFold, Refinement, WeightErrors, simulation_cost};
pub use parameters::{
    ConfoundedPair, GainInterval, ParameterInterval, Parameters, ParametersHeldOut, ParametersReport,
};
pub use pipeline::{fit, fit_all, fit_and_simulate, plan};
pub use plan::FitPlan;
pub use pwa::{Pwa, PwaOptions, PwaReport};
pub use rollout_choice::{RolloutCandidate, RolloutChoice, RolloutRule, USUAL_HORIZON};
pub use simulated_folds::{
    FoldSimulations, SimulatedFold, Simulations, against_persistence, fold_room, over_steps, simulation_options,
};
pub use sindy::{
    Ensemble, EquationReport, Evidence, FrontPoint, ParameterReport, RegionReport, Sindy, SindyOptions, SindyReport,
    StateNoise, StateSmoothing, TermReport,
};
pub use sparse::{
    CandidateReport, EpisodeInfluence, LambdaChoice, LambdaRule, LatentReport, LeaveOneOutReport, PathReport,
    Resampled, SolveMethod, Solved, Sparse, SparseOptions, SparseReport, TaskReport, solve_statistic,
    write_frequencies,
};
pub use summary::FitSummary;
pub use text_table::TextTable;
pub use words::{interval_in_words, replayed_in_words, spans_in_words, useful_in_words};
