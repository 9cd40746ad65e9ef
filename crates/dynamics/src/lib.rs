//! Simulation of models: integration, rollouts, scores.
//!
//! - [`Predictor`]: one step, row by row: measured target, prediction, region, distance from the training domain.
//! - [`score`]: one-step errors of a model on a recording, beside the null model, persistence and constant velocity.
//! - [`Simulator`] and [`rollout`]: free runs from many starts, and their errors by horizon beside the same baselines.
//! - [`Stepper`] and [`Tangent`]: values at hand instead of a recording: steps, regions, exact derivatives.
//! - [`free_run`]: whole episodes simulated from their first complete rows.
//! - [`path`]: direction, growth of the distance and time warping of two paths.
//! - [`controller`]: interface of a law that drives a model's inputs in a rollout.
//! - [`geometry`]: difference of two states, of which some are angles or rotations.
//!
//! A source given to this crate has the model's columns (aliases) as its columns, in any order.
//!
//! ```
//! use fleetfoot_dynamics::{Method, Stepper, StepperWorkspace};
//! use fleetfoot_library::{Expr, Scope};
//! use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};
//!
//! // x' = -x, from 1, by one step of 0.1 s of the classical Runge-Kutta method: within 1e-7 of exp(-0.1).
//! let column = Column::new("x", Role::State);
//! let training = Training { state_covariance: vec![1.0], ..Training::default() };
//! let mut decay = Model::new("given", vec![column], 0.1, training);
//! let right = Expr::parse("-x", &Scope::new(["x"]))?;
//! let prediction = Prediction::Derivative;
//! decay.equations.push(Equation { subject: "x".into(), prediction, right, target: None, unit: None });
//! let stepper = Stepper::new(&decay)?;
//! let mut points = stepper.points(1);
//! points.column_mut(0, 0)[0] = 1.0;
//! let mut workspace = StepperWorkspace::default();
//! let next = stepper.next(&mut points, 0.1, Method::Rk4, &mut workspace)[0];
//! assert!((next - (-0.1f64).exp()).abs() < 1e-7);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod adaptive;
mod affine;
mod affine_kernel;
mod aligned;
mod angle;
mod assembly;
mod baseline;
mod binding;
mod cell;
mod compiled;
pub mod controller;
mod domain;
mod error;
mod free_run;
mod general;
pub mod geometry;
mod horizon;
mod ideal;
mod integrate;
mod kernel;
mod layout;
mod lean;
mod metrics;
pub mod parameter_error;
pub mod path;
mod plane;
mod points;
mod predict;
mod products;
mod ranges;
mod raw;
mod recursion;
mod reference;
mod reign;
mod rollout;
mod rollout_options;
mod rosenbrock;
mod run;
mod score;
mod screen;
mod sensitivity;
mod shooting;
mod simulation;
mod simulator;
mod slopes;
mod starts;
mod state;
mod step_control;
mod stepper;
mod stretch;
mod tangent;
mod time_grid;
mod trajectories;
mod trajectory;
mod window;

pub use angle::wrap;
pub use baseline::Baseline;
pub use domain::Domain;
pub use error::Error;
pub use free_run::{FreeRun, FreeRunOptions, FreeRunOutcome, FreeRunScore, OutputErrors, free_run};
pub use horizon::{Horizon, HorizonScore, ReferencePair, RolloutSummary, StepSpan, UsefulHorizon};
pub use integrate::{Method, Step, typical_period};
pub use metrics::{BaselineScore, CalibrationBin, EpisodeScore, Scores, Skipped, TargetScore};
pub use parameter_error::ParameterError;
pub use path::PathScores;
pub use plane::{Axis, MAX_BINS, Plane, PlaneCell, plane};
pub use points::Points;
pub use predict::{Predicted, Predictor, PredictorWorkspace, RowStatus};
pub use products::{NormalBlocks, Products};
pub use raw::{RawError, RawHorizon};
pub use reference::Reference;
pub use reign::{Reign, reigns};
pub use rollout::{Outcome, Recorded, Rollouts, rollout, rollout_beside_raw, rollout_closed_loop};
pub use rollout_options::{Outside, PathOptions, RolloutOptions};
pub use score::{ScoreOptions, score, score_beside_raw};
pub use sensitivity::Coefficient;
pub use shooting::{Segment, Shooting, ShootingOptions};
pub use simulation::{Course, InputSequence, Integration};
pub use simulator::Simulator;
pub use starts::{Start, Starts};
pub use state::nothing_to_advance;
pub use step_control::Tolerance;
pub use stepper::{Stepper, StepperWorkspace};
pub use stretch::{Stretch, StretchPath, Stretches};
pub use tangent::{Linearized, Tangent};
pub use time_grid::TimeGrid;
pub use trajectory::{End, Trajectory};

pub use fleetfoot_stats::{Basis, Estimate, Mahalanobis, nonuniformity, student_t_95};
