//! A body's motion from an inertial sensor and measured poses: the posterior over all states at once, on SO(3) x R^3.
//!
//! The state of every node, one a pose, is the attitude R (body to world), the position p and the velocity v in the world, and the biases b_g and b_a of gyroscope and accelerometer.
//! The least of
//!
//! ```text
//! sum_i |preintegrated readings between i and i+1, less the motion|^2 + |walk of the biases|^2
//!   + sum_i huber(|(p_m - p(tau) - R(tau) l) / sigma_p|) + huber(|Log((R(tau) M)^T R_m) / sigma_R|)
//!   + what is known beforehand of biases and constants
//! ```
//!
//! is found by Gauss and Newton's steps with Levenberg's damping: an iterated extended Kalman smoother (Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3),
//! 1994). A step costs O(n): square-root elimination along the chain, and back. The constants of all runs, lever l and mounting M of the markers' frame, time offset tau and the direction of
//! gravity, are a dense border; what the runs say of them is stacked. Readings between nodes are summed once an iteration (Forster et al., 2017).

mod chain;
mod factors;
mod options;
mod preintegration;
mod problem;
mod result;
mod rotation;
mod start;
mod state;
#[cfg(test)]
mod tests;
mod track;

pub use options::{BodyNoise, BodyRun, FuseOptions, ImuNoise, ImuRecord, PoseRecord, Prior};
pub use result::{BodyState, BodyTrack, Fused, StaticEstimates};

use problem::Problem;
use track::{BiasPrior, Setting, Track};

use crate::SignalError;

/// Rounds of moving the nodes, choosing what counts and telling the noise, at most.
const ROUNDS: usize = 40;

/// Seconds by which nodes move that are where they should be.
const STILL: f64 = 1e-7;

/// Rounds in which nodes are moved in any case, as states are on their way.
const FREE: usize = 3;

/// The ratio of variances that is no change any more.
const SAME: f64 = 1.002;

/// Fuses the runs of one body: the same constants in all, states and biases of their own in each.
///
/// Times of a run are seconds from any moment, the same for both of its records. Poses outside of what the inertial sensor heard, and poses alone between two of its gaps, are left out and counted,
/// as are stretches whose positions or attitudes all contradict the readings. The answer does not depend on the number of threads. Memory beside records and answer is some 600 bytes a pose.
///
/// ```
/// use fleetfoot_signal::fuse::{BodyRun, FuseOptions, ImuRecord, PoseRecord, fuse};
///
/// // A body turns about the vertical at 0.5 rad/s, and stands still otherwise.
/// let times: Vec<f64> = (0..401).map(|row| 0.005 * f64::from(row)).collect();
/// let (rates, forces) = (vec![[0.0, 0.0, 0.5]; 401], vec![[0.0, 0.0, 9.81]; 401]);
/// let stamps: Vec<f64> = (1..200).map(|row| 0.01 * f64::from(row)).collect();
/// let attitudes: Vec<[f64; 4]> = stamps.iter().map(|t| [0.0, 0.0, (0.25 * t).sin(), (0.25 * t).cos()]).collect();
/// let imu = ImuRecord { times: &times, rates: &rates, forces: &forces };
/// let poses = PoseRecord { times: &stamps, positions: &vec![[1.0, 2.0, 3.0]; 199], attitudes: &attitudes };
/// let options = FuseOptions { gravity: [0.0, 0.0, -9.81].into(), ..FuseOptions::default() };
/// let fused = fuse(&[BodyRun { imu, poses }], &options)?;
/// let middle = &fused.tracks[0].states[100];
/// assert!((middle.position[2] - 3.0).abs() < 1e-9 && middle.velocity[0].abs() < 1e-9);
/// # Ok::<(), fleetfoot_signal::SignalError>(())
/// ```
///
/// # Errors
/// Records of different lengths, stamps that do not increase, values that are not finite or whose squares are not, options that are none, no two neighbouring poses that the inertial sensor heard,
/// motion that does not determine what is asked for, poses that most readings contradict, an offset further off than three of its deviations or 0.1 s.
pub fn fuse(runs: &[BodyRun<'_>], options: &FuseOptions) -> Result<Fused, SignalError> {
    options.check()?;
    let (mut tracks, mut outside) = (Vec::new(), 0);
    for (at, run) in runs.iter().enumerate() {
        run.check()?;
        let (found, left) = start::tracks(at, run, options);
        tracks.extend(found);
        outside += left;
    }
    if tracks.is_empty() {
        return Err(SignalError::NotFused {
            problem: "no two neighbouring poses have inertial readings about them: correct the clocks first, or give longer records",
        });
    }
    let bias = |prior: &Prior<[f64; 3]>| BiasPrior { value: prior.value.into(), deviation: prior.deviation };
    let setting = Setting {
        noise: options.noise,
        huber: options.huber,
        biases: [bias(&options.gyro_bias), bias(&options.accelerometer_bias)],
        anchor: options.offset.value,
    };
    let border = start::begin(&mut tracks, options, &setting);
    let mut problem = Problem { tracks, border, setting, options: options.clone() };
    solve(&mut problem, outside)
}

impl From<chain::Undetermined> for SignalError {
    fn from(_: chain::Undetermined) -> Self {
        Self::NotFused {
            problem: "the motion does not determine what is asked for: give lever, mounting, offset or gravity, or a record with more turns about several axes",
        }
    }
}

/// Goes down, moves the nodes, chooses what counts and tells the noise, until none of it changes.
fn solve(problem: &mut Problem<'_>, outside: usize) -> Result<Fused, SignalError> {
    let (mut steps, mut converged, mut moving, mut last, mut contradicted) = (0, false, true, f64::INFINITY, 0);
    for round in 0..ROUNDS {
        let descent = problem.descend()?;
        steps += descent.steps;
        // Readings between noisy stamps are averages, so that the least depends a little on where between them nodes stand: nodes that do not come to rest are left where they are.
        let late = problem.border.late.abs();
        moving = moving && late > STILL && (round < FREE || late < 0.5 * last);
        last = late;
        if moving {
            problem.move_nodes();
        }
        let mut change = 1.0;
        if problem.options.fit_noise {
            let whole = problem.whole()?;
            let spreads = problem.spread(&whole, true)?;
            change = problem.take_noise(&spreads);
        }
        // What is far off is known once the noise nearly is.
        let mut chosen = false;
        if problem.options.gate > 0.0 && change < 2.0 {
            chosen = choose(problem, &mut contradicted)?;
        }
        if descent.converged && !moving && !chosen && change < SAME && round > 0 {
            converged = true;
            break;
        }
    }
    if !problem.is_within_slack() {
        return Err(SignalError::NotFused {
            problem: "poses and readings are further apart in time than three deviations of the offset, or 0.1 s: correct the clocks first ([clocks.NAME] of a recipe), or give an offset nearer to what it is",
        });
    }
    Ok(result::fused(problem, [outside, contradicted], steps, converged)?)
}

/// Chooses which poses count. A track that these do not determine any more is dropped, and its poses are added to `contradicted`. Whether the choice changed.
fn choose(problem: &mut Problem<'_>, contradicted: &mut usize) -> Result<bool, SignalError> {
    let (gate, border, setting) = (problem.options.gate, problem.border, problem.setting);
    let mut chosen = false;
    for track in &mut problem.tracks {
        chosen |= track.choose(gate, &border, &setting);
    }
    // What most poses contradict is no motion of this body.
    let used = || problem.tracks.iter().flat_map(|track| &track.used);
    let all = used().count() + *contradicted;
    let is_rare = |which: usize| 2 * used().filter(|used| used[which]).count() < all;
    if (0..2).any(is_rare) || !problem.tracks.iter().any(Track::is_determined) {
        return Err(SignalError::NotFused {
            problem: "more than half of the poses lie beyond the gate of what the readings tell: check clocks, frames and units, the mounting and the lever, or state greater noise",
        });
    }
    problem.tracks.retain(|track| {
        let stays = track.is_determined();
        *contradicted += if stays { 0 } else { track.nodes() };
        stays
    });
    Ok(chosen)
}
