//! What a model does: integrate, roll out; scores.
//!
//! - [`Predictor`]: one step, row by row: measured target, prediction, region, distance from the training domain.
//! - [`score`]: one-step errors of a model on a recording, beside the null model, persistence and constant velocity.
//! - [`Simulator`] and [`rollout`]: free runs from many starts, and their errors by horizon beside the same baselines.
//! - [`Stepper`] and [`Tangent`]: values at hand instead of a recording: steps, regions, exact derivatives.
//! - [`free_run`]: whole episodes simulated from their first complete rows.
//! - [`controller`]: laws that drive a model's inputs in a rollout, or a robot.
//!
//! A source given to this crate has the model's columns (aliases) as its columns, in any order.

mod adaptive;
mod affine;
mod aligned;
mod angle;
mod baseline;
mod cell;
mod compiled;
pub mod controller;
mod domain;
mod error;
mod free_run;
mod general;
mod horizon;
mod integrate;
mod kernel;
mod layout;
mod metrics;
pub mod parameter_error;
mod plane;
mod points;
mod predict;
mod rollout;
mod score;
mod simulator;
mod starts;
mod stepper;
mod tangent;
mod time_grid;
mod trajectory;
mod window;

pub use adaptive::Tolerance;
pub use baseline::Baseline;
pub use domain::Domain;
pub use error::Error;
pub use free_run::{FreeRun, FreeRunOptions, FreeRunOutcome, FreeRunScore, OutputErrors, free_run};
pub use horizon::{Horizon, HorizonScore, StepSpan, UsefulHorizon};
pub use integrate::{Method, Step, typical_period};
pub use metrics::{BaselineScore, CalibrationBin, EpisodeScore, Scores, Skipped, TargetScore};
pub use parameter_error::ParameterError;
pub use plane::{Axis, MAX_BINS, Plane, PlaneCell, plane};
pub use points::Points;
pub use predict::{Predicted, Predictor, PredictorWorkspace, RowStatus};
pub use rollout::{Outcome, Rollouts, rollout, rollout_closed_loop};
pub use score::{ScoreOptions, score};
pub use simulator::{RolloutOptions, Simulator};
pub use starts::{Start, Starts};
pub use stepper::{InputSequence, Integration, Stepper, StepperWorkspace};
pub use tangent::{Linearized, Tangent};
pub use time_grid::TimeGrid;
pub use trajectory::{End, Trajectory};

pub use fleetfoot_stats::{Basis, Estimate, Mahalanobis, student_t_95};
