//! Model predictive control: the program that a controller solves at every sample, and its solver.
//!
//! ```
//! use fleetfoot_control::predictive::{Instance, Program, ProgramStep, Solver, Status};
//!
//! // An integrator, x+ = x + v with |v| <= 0.4, from x = 1: the first commands are at the limit.
//! let program = Program {
//!     horizon: 3,
//!     steps: vec![ProgramStep { a: vec![1.0], b: vec![1.0] }],
//!     weights: vec![1.0],
//!     input_weights: vec![0.1],
//!     terminal: vec![1.0],
//!     bounds: Vec::new(),
//!     curvature: vec![1.1],
//! };
//! let instance = Instance {
//!     start: &[1.0],
//!     sequence: &[0, 0, 0],
//!     constants: &[0.0],
//!     limits: &[[-0.4, 0.4]],
//!     target: &[0.0],
//!     input_target: &[0.0],
//! };
//! let mut solver = Solver::new(&program);
//! let certificate = solver.solve(&program, &instance);
//! assert_eq!((certificate.status, solver.plan()[0]), (Status::Solved, -0.4));
//! assert!(certificate.residual < 1e-12);
//! ```

mod program;
mod solver;

pub use program::{Instance, Program, ProgramBound, ProgramStep};
pub(crate) use solver::project;
pub use solver::{
    CENTRED, Certificate, DECREASE, FIRST_STEPS, INSIDE, LAST_STEPS, MOST_HALVINGS, MOST_ITERATIONS, NEAR, SOLVED,
    Solver, Status, UNLIMITED,
};
