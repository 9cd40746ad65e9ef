//! Feed-forward and recurrent networks whose output layer is a least-squares problem.
//!
//! A network is `y = c + A x + B h(x)`: the features h are the units of the last hidden layer, or the last state of a recurrent cell
//! over a window of past rows ([`Window`]). The linear map A is always inside. For given hidden layers the output
//! layer (c, A, B) is solved exactly from sums over rows ([`Statistic`]); the hidden layers descend on what is left (variable projection: Golub and Pereyra, SIAM
//! Journal on Numerical Analysis 10, 1973), by Adam over mini-batches and then by L-BFGS over all rows.
//!
//! Rows lie in tiles of [`TILE`] that stay in cache. Sums go over tiles in their order, so that any number of threads computes the same bits.
//!
//! ```
//! use fleetfoot_data::Silent;
//! use fleetfoot_learn::{Activation, Shape, Table, Training, Units, train};
//!
//! let rows: Vec<f64> = (0..2_000).map(|i| f64::from(i) * 0.005 - 5.0).flat_map(|x| [x, x.sin()]).collect();
//! let table = Table::new(1, 1, rows)?;
//! let (fitted, held): (Vec<usize>, Vec<usize>) = (0..2_000).partition(|row| row % 10 != 0);
//! let units = Units::of(&table, &fitted)?;
//! let shape = Shape { inputs: 1, hidden: vec![8], activation: Activation::Tanh, window: None };
//! let samples = [&fitted, &held].map(|rows| table.samples(rows, &units));
//! let trained = train(&shape, &samples[0], &samples[1], &Training::default(), &Silent)?;
//! assert!(trained.loss < 0.01 * trained.linear, "{trained:?}");
//! # Ok::<(), fleetfoot_learn::Error>(())
//! ```

mod activation;
mod adam;
mod cell;
mod descent;
mod error;
mod layers;
mod output;
mod pass;
mod recurrence;
mod samples;
mod shape;
mod train;
mod window;

pub use activation::Activation;
pub use cell::Cell;
pub use error::Error;
pub use output::{Output, Statistic};
pub use pass::{Slope, slope, statistic};
pub use samples::{Samples, TILE, Table, Units};
pub use shape::Shape;
pub use train::{Trained, Training, train};
pub use window::Window;
