//! One fit of every method: from a recipe and its logs, or their statistic, to a model and a report of what it is worth.
//!
//! Every method has a request (what is asked), a plan (what it would cost), a fit and a report: [`fit_pwa`], [`fit_sparse`], [`fit_sindy`], [`fit_narx`],
//! [`fit_parameters`]. [`statistic`] scans logs to the file from which fits need no logs.

// The fuzz targets' bodies, which the tests share, call the Rust API by its name.
#[cfg(test)]
extern crate self as fleetfoot;

mod bounded_maps;
mod concentration;
mod constant;
mod error;
mod folds;
mod incomplete;
mod json;
mod known;
mod limit_report;
mod model_file;
mod narx;
mod not_finite;
mod objective;
mod parameters;
mod pwa;
mod radial;
mod regions;
mod rollout_choice;
mod serialize;
mod sindy;
mod spans;
mod sparse;
pub mod statistic;
mod subset;
mod text_table;
mod words;

pub use bounded_maps::{BoundedCandidate, BoundedMaps, PassiveMaps, PassivePort, unexplained};
pub use error::Error;
pub use folds::FoldRule;
pub use json::Interval;
pub use known::{KnownModel, is_known, known_model};
pub use limit_report::{FreeErrors, LimitReport, LimitSide};
pub use model_file::write_model;
pub use narx::{
    FileRun, FileRuns, GivenOrder, MeanRun, NarxCandidate, NarxEquation, NarxFitted, NarxOptions, NarxRegion,
    NarxReport, NarxRequest, NarxScores, NarxSearch, NarxStage, NarxTerm, OrderRule, TermRule, fit_narx,
    free_runs_by_file,
};
pub use objective::{Bounded, HeldOutErrors, RefinedFold, Refinement, WeightErrors, simulation_cost};
pub use parameters::{
    ConfoundedPair, GainInterval, ParameterInterval, ParametersFitted, ParametersHeldOut, ParametersReport,
    fit_parameters,
};
pub use pwa::{FitPlan, Fitted, PWA_PASSES, PwaOptions, PwaRequest, fit_pwa, plan_pwa, rival};
pub use rollout_choice::{HORIZON, RolloutCandidate, RolloutChoice, RolloutRule};
pub use sindy::{
    Ensemble, EquationReport, Evidence, FrontPoint, ParameterReport, RegionReport, SindyFitted, SindyOptions,
    SindyPlan, SindyReport, SindyRequest, StateNoise, StateSmoothing, TermReport, fit_sindy, plan_sindy,
};
pub use sparse::{
    CandidateReport, EpisodeInfluence, LambdaChoice, LambdaRule, LatentReport, LeaveOneOutReport, PathReport,
    Resampled, SolveMethod, Solved, SparseFitted, SparseOptions, SparseReport, SparseRequest, TaskReport,
    file_by_value, fit_sparse, solve_statistic, write_frequencies,
};
pub use text_table::TextTable;
pub use words::{interval_in_words, replayed_in_words, spans_in_words, useful_in_words};
