//! The scan of every method: sums of a log's rows, in a frozen plan, and their queries.
//!
//! A plan has regressors and targets, their coordinates and the chunks of rows. One pass makes keyed sums of it, which
//! merge with those of other rows, and need no row any more. Folds, replicates and sub-libraries are weighted sums in
//! the square-root form that solvers take.
//!
//! - [`system`]: a system of equations, one library for all targets, in one region or in those of a partition;
//! - [`structured`]: tasks that share latent functions, one Gram matrix a task.
//!
//! ```
//! use fleetfoot_data::{Column, MemorySource, Silent};
//! use fleetfoot_library::Expr;
//! use fleetfoot_stats::least_squares;
//! use fleetfoot_sums::system::{System, SystemPlan};
//!
//! // y = 3 x - 1, on a hundred rows.
//! let mut source = MemorySource::new(vec![Column::float("x"), Column::float("y")]);
//! let x: Vec<f64> = (0..100).map(|k| (f64::from(k) * 0.7).sin()).collect();
//! let y: Vec<f64> = x.iter().map(|x| 3.0 * x - 1.0).collect();
//! source.push_uniform("one", 0.1, vec![x, y]);
//! let system = System::new(vec![Expr::column("x")], vec![Expr::column("y")]);
//! let scan = SystemPlan::new(system, None, &source)?.scan(&source, &Silent)?;
//! let line = least_squares(&scan.root(0), &[1.0]);
//! assert!((line.coefficients[(0, 0)] - 3.0).abs() < 1e-12 && (line.intercept[0] + 1.0).abs() < 1e-12);
//! # Ok::<(), fleetfoot_sums::system::SystemError>(())
//! ```

pub mod structured;
pub mod system;
