//! The motion of a joint from its sensors: encoders, and sensors of its rate, each at its own stamps.
//!
//! The state is position, rate and acceleration, a chain of integrators whose jerk is white noise of density q: the prior of the quintic smoothing spline, whose filter and smoother serve here. The least of
//!
//! ```text
//! integral of (jerk)^2 / q dt  +  sum over readings of loss((y - h x(t - delay) - bias) / sigma)
//! ```
//!
//! is found by reweighted least squares, and with it delays and biases, which all runs share: the smoother is linear in what it is given, so that what it leaves of a column of slopes says how much of a constant the states do not explain (the
//! border's Schur complement; de Jong, "The diffuse Kalman filter", Annals of Statistics 19, 1991). Noise and q are where squares equal their redundancy, the greatest restricted likelihood (Foerstner, 1979).

mod derived;
mod events;
mod options;
mod problem;
mod result;
mod scale;
mod start;

pub use options::{JointOptions, JointRecord, JointRun, JointSensor, Quantity};
pub use result::{Correlation, FusedJoint, JointSensorEstimate, JointStates};

use problem::Problem;

use crate::SignalError;

/// Rounds of telling noise, constants and what counts, at most.
const ROUNDS: usize = 100;

/// The ratio of variances that is no change any more.
const SAME: f64 = 1.002;

/// The share of its deviation by which a constant moves that is at rest.
const STILL: f64 = 1e-3;

/// Fuses the runs of one joint: noise, delays and biases are the same in all, states each run's own.
///
/// Times of a run are seconds from any moment. A run in which nothing tells the state (fewer than three readings, no position) has none. The answer does not depend on the number of threads. Memory beside records and
/// answer is some 24 bytes a reading, and as much again for every constant that is sought.
///
/// ```
/// use fleetfoot_signal::joint::{JointOptions, JointRecord, JointRun, JointSensor, Quantity, fuse_joint};
///
/// // An encoder at 100 Hz, and a tachometer at 250 Hz.
/// let noise = |x: f64| 1e-3 * ((61.8 * x).fract() - 0.5);
/// let times: Vec<f64> = (0..300).map(|row| 0.01 * f64::from(row)).collect();
/// let positions: Vec<f64> = times.iter().map(|t| (3.0 * t).sin() + noise(*t)).collect();
/// let stamps: Vec<f64> = (0..750).map(|row| 0.004 * f64::from(row)).collect();
/// let rates: Vec<f64> = stamps.iter().map(|t| 3.0 * (3.0 * t).cos() + 5.0 * noise(*t)).collect();
/// let records =
///     vec![JointRecord { times: &times, values: &positions }, JointRecord { times: &stamps, values: &rates }];
/// let sensors = [Quantity::Position, Quantity::Rate].map(JointSensor::new);
/// let fused = fuse_joint(&[JointRun { records, at: &times }], &JointOptions::new(sensors.to_vec()))?;
/// let [_, rate, acceleration] = &fused.runs[0].derivatives;
/// assert!((rate[150] - 3.0 * 4.5_f64.cos()).abs() < 2e-3 && (acceleration[150] + 9.0 * 4.5_f64.sin()).abs() < 0.2);
/// # Ok::<(), fleetfoot_signal::SignalError>(())
/// ```
///
/// # Errors
/// Records of different lengths, stamps that do not increase, values that are not finite, options that are none, a sensor of fewer than five readings, delays or biases that the motion does not determine, delays of 0.1 s or more.
pub fn fuse_joint(runs: &[JointRun<'_>], options: &JointOptions) -> Result<FusedJoint, SignalError> {
    options.check()?;
    runs.iter().try_for_each(|run| run.check(options.sensors.len()))?;
    let mut problem = Problem::new(runs, options)?;
    let (mut rounds, mut converged, mut last) = (0, false, None);
    while !converged && rounds < ROUNDS {
        rounds += 1;
        let passes = problem.passes()?;
        let moved = problem.move_constants(&passes)?;
        // Outliers are known once the noise nearly is.
        let change = problem.take_noise(&passes);
        let chosen = problem.weigh(&passes, change < 2.0);
        // Without any change, another pass over the readings gives the same.
        let rests = moved == 0.0 && change == 1.0 && !chosen;
        converged = rests || (rounds > 1 && moved < STILL && change < SAME && !chosen);
        last = rests.then_some(passes);
    }
    problem.fused(rounds, converged, last)
}
