//! Regulators and filters of models, and the controllers that close a loop around a model or a robot.
//!
//! - [`design`]: linear-quadratic regulators of a model, region by region, and the set points that they hold; [`linear`] has their algebra.
//! - [`filter`]: a Kalman filter for every region of a model.
//! - [`controller`]: laws that drive a model's inputs in a rollout, or a robot.
//!
//! ```
//! use fleetfoot_control::controller::{Controller, Treadmill, TreadmillLoop};
//!
//! // A treadmill that follows the robot on it, as a controller of rollouts.
//! let controller = TreadmillLoop { law: Treadmill { k_x: 2.0, ..Treadmill::default() }, ..TreadmillLoop::default() };
//! assert_eq!(controller.drives(), ["u_v", "u_w"]);
//! controller.validate()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod control_error;
pub mod controller;
pub mod design;
mod error;
pub mod filter;
mod filter_error;
pub mod linear;
mod named;
mod pieces;
pub mod predictive;

pub use control_error::ControlError;
pub use error::Error;
