//! Rapier worlds and analytic plants that produce logs.
//!
//! Recordings with known truth: what a method finds can be held against what is true.
//!
//! ```
//! use fleetfoot_sim::{DcMotor, Supply};
//!
//! // A free motor on one volt, in steps of 1 ms: it ends where its drag and its friction balance the current.
//! let motor = DcMotor { coulomb_friction: 0.0, ..DcMotor::default() };
//! let mut rate = 0.0;
//! for _ in 0..200 {
//!     rate = motor.advance(Supply::Voltage(1.0), rate, 0.0, 1e-3);
//! }
//! let balance = motor.torque(Supply::Voltage(1.0), rate) - motor.viscous_friction * rate;
//! assert!(rate > 40.0 && balance.abs() < 1e-9);
//! ```

pub mod excitation;
pub mod hexapod;
mod motor;
pub mod parameter_docs;
mod partial_table;
pub mod plant;
mod reading;
mod regulated;
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
