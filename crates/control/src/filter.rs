//! Filters of a model: posterior of its states from noisy measurements of some of them, with a Kalman filter for every
//! region.
//!
//! ```
//! use fleetfoot_control::filter::{FilterOptions, Measured, SwitchedFilter};
//! use fleetfoot_library::{Expr, Scope};
//! use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};
//!
//! // A mass that moves on as it does: x' = v, v' = 0. Its place is measured to within 0.1.
//! let column = |name: &str| Column::new(name, Role::State);
//! let training = Training { state_covariance: vec![1.0, 0.0, 1.0], ..Training::default() };
//! let mut mass = Model::new("given", vec![column("x"), column("v")], 0.1, training);
//! for (subject, right) in [("x", "v"), ("v", "0*v")] {
//!     let right = Expr::parse(right, &Scope::new(["x", "v"]))?;
//!     let prediction = Prediction::Derivative;
//!     mass.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
//! }
//! let measured = vec![Measured { state: "x".into(), deviation: Some(0.1) }];
//! let filter = SwitchedFilter::new(&mass, &FilterOptions { measured, ..FilterOptions::default() })?;
//! let mut track = filter.start(&[0.0], &[f64::NAN]);
//! for k in 1..=100 {
//!     filter.step(&mut track, &[], 0.1, &[0.1 * f64::from(k)], &[f64::NAN]);
//! }
//! // The speed, which nobody measured, is 1.
//! assert!((track.estimate().mean[1] - 1.0).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod coloured;
mod consistency;
mod gaussian;
mod noise;
mod points;
mod step_noise;
mod steps;
mod switched;
mod tables;
mod track;

pub use consistency::{Consistency, MeanBand, chi_square_band};
pub use gaussian::Gaussian;
pub use steps::StepMap;
pub use switched::{FilterOptions, Measured, NoiseColour, ProcessFactor, SwitchedFilter, Switching};
pub use tables::{FilterColour, FilterTables};
pub use track::Track;

pub use crate::filter_error::FilterError;
