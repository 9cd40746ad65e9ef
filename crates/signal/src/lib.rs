//! From raw channels to clean states and derivatives.
//!
//! [`smooth`] is the smoothing spline: values, derivatives and their standard deviations at every stamp, however irregular, its penalty given or chosen; [`better`] tells the cubic from the quintic one.
//! [`trend_filter`] is the curve of few pieces, [`Interpolant`] goes through every measurement. [`reject`] finds what no smooth curve explains, [`savitzky_golay`], [`Sections`] and [`decimate`] are the filters that published analyses name, [`dejitter`],
//! [`align`] and [`align_edges`] are for clocks. [`fuse`] makes one motion of an inertial sensor and measured poses, [`joint`] one of encoders and sensors of rate.
//!
//! ```
//! use fleetfoot_signal::{Lambda, Spline, smooth};
//!
//! let times: Vec<f64> = (0..100).map(|row| 0.1 * f64::from(row)).collect();
//! let fall: Vec<f64> = times.iter().map(|t| 1.0 - 4.9 * t * t).collect();
//! let smoothed = smooth(&times, &fall, None, Spline::Quintic, Lambda::Given(1e-6))?;
//! assert!((smoothed.derivatives[2][50] + 9.8).abs() < 1e-6);
//! # Ok::<(), fleetfoot_signal::SignalError>(())
//! ```

mod align;
mod clock;
mod clock_line;
mod edges;
mod error;
mod estimate;
pub mod fuse;
mod interpolate;
pub mod joint;
mod least;
mod loss;
mod means;
mod outliers;
mod savitzky_golay;
mod sections;
mod spline;
mod trend;

pub use align::{Alignment, PartLag, Record, Within, align};
pub use clock::{Dejittered, dejitter};
pub use clock_line::ClockLine;
pub use edges::{EdgeAlignment, WaveOptions, align_edges};
pub use error::SignalError;
pub use estimate::Estimate;
pub use interpolate::{Interpolant, Interpolation, resampled};
pub use loss::Loss;
pub use outliers::{Rejected, hampel, hangs, noise_of_differences, reject, saturated, stuck};
pub use savitzky_golay::savitzky_golay;
pub use sections::{Section, Sections, anti_alias, decimate};
pub use spline::{Lambda, Smoothed, Spline, better, smooth};
pub use trend::{Trend, trend_filter};
