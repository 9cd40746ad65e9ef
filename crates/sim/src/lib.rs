//! Rapier worlds and analytic plants that produce logs.
//!
//! Recordings with known truth: what a method finds can be held against what is true.

pub mod excitation;
pub mod hexapod;
mod motor;
pub mod parameter_docs;
mod partial_table;
pub mod plant;
mod reading;
pub mod rigid;
mod scenario;
pub mod sensor;
pub mod treadmill;
pub mod wheeled;

pub use excitation::{Excitation, OrnsteinUhlenbeck};
pub use fleetfoot_dynamics::{ParameterError, parameter_error};
pub use hexapod::{Hexapod, HexapodState, HexapodWorld, JointMethod};
pub use motor::{DcMotor, Supply};
pub use reading::{Kind, Reading, Stamps, Topic};
pub use scenario::{End, Regressors, Run, Scenario, Sink, SinkError};
pub use treadmill::HexapodTreadmill;
pub use wheeled::{Wheeled, WheeledWorld};
