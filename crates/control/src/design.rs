//! Regulators of a model: set points that it can rest at, the linear-quadratic law that keeps it there, region by
//! region, and the predictive controller that ends its plans by the cost of this law.
//!
//! ```
//! use fleetfoot_control::design::{LqrOptions, lqr};
//! use fleetfoot_library::{Expr, Scope};
//! use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};
//!
//! // A mass: x' = v, v' = u.
//! let column = |name: &str, role| Column::new(name, role);
//! let columns = vec![column("x", Role::State), column("v", Role::State), column("u", Role::Input)];
//! let training = Training { state_covariance: vec![1.0, 0.0, 1.0], ..Training::default() };
//! let mut mass = Model::new("given", columns, 0.01, training);
//! for (subject, right) in [("x", "v"), ("v", "u")] {
//!     let right = Expr::parse(right, &Scope::new(["x", "v", "u"]))?;
//!     let prediction = Prediction::Derivative;
//!     mass.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
//! }
//! let options = LqrOptions { setpoint: vec![("x".into(), 2.0)], ..LqrOptions::default() };
//! let designed = lqr(&mass, &options)?;
//! assert_eq!(designed.setpoint.states[1], ("v".to_owned(), 0.0));
//! assert!(designed.regions[0].radius < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assembled;
mod coordinates;
mod gains;
mod lqr;
mod mpc;
mod options;
mod requested;
mod setpoint;

pub use lqr::{Lqr, LqrRegion, SetPoint, lqr};
pub use mpc::mpc;
pub use options::{LqrOptions, MpcOptions, Named, Schedule};
