//! A body's motion from an inertial sensor and measured poses: the posterior over all states at once, on SO(3) x R^3.
//!
//! The state of every node, one a pose, is the attitude R (body to world), the position p and the velocity v in the world, and the biases b_g and b_a of gyroscope and accelerometer.
//! The least of
//!
//! ```text
//! sum_i |preintegrated readings between i and i+1, less the motion|^2 + |walk of the biases|^2
//!   + sum_i loss(|(p_m - p(tau) - R(tau) l) / sigma_p|) + loss(|Log((R(tau) M)^T R_m) / sigma_R|)
//!   + what is known beforehand of biases and constants
//! ```
//!
//! is found by Gauss and Newton's steps with Levenberg's damping: an iterated extended Kalman smoother (Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3),
//! 1994). A step costs O(n): square-root elimination along the chain, and back. The constants of all runs, lever l and mounting M of the markers' frame, time offset tau and the direction of
//! gravity, are a dense border; what the runs say of them is stacked. Readings between nodes are summed once a round (Forster et al., 2017).
//!
//! Without an accelerometer position, velocity and acceleration are a chain of integrators an axis, whose jerk is white noise: the acceleration takes the place of the accelerometer's bias in the state.

mod chain;
mod checkpoint;
mod factors;
mod information;
mod noise;
mod options;
mod preintegration;
mod problem;
mod readings;
mod result;
mod rotation;
mod start;
mod state;
#[cfg(test)]
mod tests;
mod track;

pub use checkpoint::Checkpoint;
pub use options::{BodyNoise, BodyRun, FuseOptions, ImuNoise, ImuRecord, PoseRecord, Prior};
pub use result::{BodyState, BodyTrack, Fused, StaticEstimates};

pub use start::gaps;
pub(crate) use start::slack;

use checkpoint::Progress;
use fleetfoot_data::{Cancelled, Silent, parallel_map};
use problem::{Problem, Readings, STEPS};
use track::{BiasPrior, Setting, Track};

use crate::SignalError;

/// Rounds of moving the nodes, choosing what counts and telling the noise, at most.
const ROUNDS: usize = 40;

/// Seconds by which nodes move that are where they should be.
const STILL: f64 = 1e-7;

/// Rounds in which nodes are moved in any case, as states are on their way.
const FREE: usize = 3;

/// The change of noise, in those that are none any more, from which on what is far off is known.
const NEARLY: f64 = 300.0;

/// Fuses the runs of one body: the same constants in all, states and biases of their own in each.
///
/// Times of a run are seconds from any moment, the same for both of its records. Poses outside of what the inertial sensor heard, and poses alone between two of its gaps, are left out and counted,
/// as are stretches whose positions or attitudes all contradict the readings. The answer does not depend on the number of threads. Memory beside records and answer is some 260 bytes a pose, and, up to 16,384 poses, 7 KB each.
///
/// ```
/// use fleetfoot_signal::fuse::{BodyRun, FuseOptions, ImuRecord, PoseRecord, fuse};
///
/// // A body turns about the vertical at 0.5 rad/s, and stands still otherwise.
/// let times: Vec<f64> = (0..401).map(|row| 0.005 * f64::from(row)).collect();
/// let (rates, forces) = (vec![[0.0, 0.0, 0.5]; 401], vec![[0.0, 0.0, 9.81]; 401]);
/// let stamps: Vec<f64> = (1..200).map(|row| 0.01 * f64::from(row)).collect();
/// let attitudes: Vec<[f64; 4]> = stamps.iter().map(|t| [0.0, 0.0, (0.25 * t).sin(), (0.25 * t).cos()]).collect();
/// let imu = ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0; 2] };
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
    fuse_from(runs, options, &mut ())
}

/// [`fuse`] that keeps where it stands after every round (some 140 bytes a pose), and goes on from what was kept of the same problem: the answer is that of a fusion that was never stopped, to the last bit.
///
/// # Errors
/// Those of [`fuse`]. What was kept of another problem, by another version, or is damaged, does not count.
pub fn fuse_from(
    runs: &[BodyRun<'_>],
    options: &FuseOptions,
    checkpoint: &mut dyn Checkpoint,
) -> Result<Fused, SignalError> {
    options.check()?;
    let options = &known_by(runs, options)?;
    let (mut tracks, mut outside) = (Vec::new(), 0);
    for (at, run) in runs.iter().enumerate() {
        run.check()?;
        let (started, left) = start::tracks(at, run, options);
        tracks.extend(started);
        outside += left;
    }
    if tracks.is_empty() {
        return Err(SignalError::NotFused {
            problem: "no two neighbouring poses have inertial readings around them: correct the clocks first, or give longer records",
        });
    }
    let bias = |prior: &Prior<[f64; 3]>| BiasPrior { value: prior.value.into(), deviation: prior.deviation };
    let (mut noise, mut readings) = (options.noise, [[None; 3]; 2]);
    if options.fit_noise && !has_forces(runs) {
        noise.jerk = start::jerk(&tracks, noise.jerk);
    }
    if options.fit_noise {
        readings = priors_from_readings(runs);
        begin_noise(&mut noise.imu, runs, &readings);
    }
    let setting = Setting {
        noise,
        loss: options.loss,
        biases: [bias(&options.gyro_bias), bias(&options.accelerometer_bias)],
        anchor: options.offset.value,
    };
    let border = start::begin(&mut tracks, options, &setting);
    let mut problem = Problem { tracks, border, setting, options: options.clone(), at_rest: None, readings };
    let digest = checkpoint::digest(runs, options);
    solve(&mut problem, outside, checkpoint, digest)
}

/// The deviations of single readings of rate and force, an axis, as far as the readings themselves tell them.
fn priors_from_readings(runs: &[BodyRun<'_>]) -> Readings {
    let records: Vec<ImuRecord<'_>> = runs.iter().map(|run| run.imu).collect();
    let noises = parallel_map(6, &Silent, |at| Ok::<_, Cancelled>(readings::noise(&records, at / 3, at % 3)));
    let mut priors = [[None; 3]; 2];
    priors.as_flattened_mut().iter_mut().zip(noises.into_iter().flatten()).for_each(|(prior, noise)| *prior = noise);
    priors
}

/// First values of the inertial sensor's noise beside its densities. Single readings get their estimated deviation, or
/// an upper bound if there is no estimate. Jumps between readings may have been at any moment.
fn begin_noise(noise: &mut ImuNoise, runs: &[BodyRun<'_>], readings: &Readings) {
    noise.scatter = [[0.0; 3]; 2];
    for run in runs {
        for (deviation, scatter) in noise.scatter.as_flattened_mut().iter_mut().zip(run.imu.scatter().as_flattened()) {
            *deviation = deviation.max(*scatter);
        }
    }
    for (deviation, prior) in noise.scatter.as_flattened_mut().iter_mut().zip(readings.as_flattened()) {
        *deviation = prior.map_or(*deviation, |prior| prior.value);
    }
    for which in 0..2 {
        let misses = runs.iter().any(|run| run.imu.misses()[which]) && (which == 0 || has_forces(runs));
        if misses && noise.missed[which] == 0.0 {
            noise.missed[which] = 1.0;
        }
    }
}

/// Returns true if every run has an accelerometer.
fn has_forces(runs: &[BodyRun<'_>]) -> bool {
    runs.iter().all(|run| run.imu.has_forces())
}

/// The options as far as the sensors can tell what they ask for: without an accelerometer gravity is not felt, and nothing else tells how far off the markers are.
fn known_by(runs: &[BodyRun<'_>], options: &FuseOptions) -> Result<FuseOptions, SignalError> {
    if has_forces(runs) {
        return Ok(options.clone());
    }
    if runs.iter().any(|run| run.imu.has_forces()) {
        return Err(SignalError::NotFused {
            problem: "some runs have an accelerometer, and some have none: fuse the two kinds separately",
        });
    }
    if options.lever.deviation.is_infinite() {
        return Err(SignalError::NotFused {
            problem: "without an accelerometer the lever cannot be estimated: give it, or name a sensor of the specific force",
        });
    }
    let gravity = Prior { deviation: 0.0, ..options.gravity };
    let accelerometer_bias = Prior { value: [0.0; 3], deviation: f64::INFINITY };
    Ok(FuseOptions { gravity, accelerometer_bias, ..options.clone() })
}

impl From<chain::Undetermined> for SignalError {
    fn from(_: chain::Undetermined) -> Self {
        Self::NotFused {
            problem: "the motion does not determine all unknowns: give lever, mounting, offset or gravity, or a record with more turns about several axes",
        }
    }
}

/// Goes down, moves the nodes, chooses what counts and tells the noise, until none of it changes.
fn solve(
    problem: &mut Problem<'_>,
    outside: usize,
    checkpoint: &mut dyn Checkpoint,
    digest: u64,
) -> Result<Fused, SignalError> {
    let saved = checkpoint.load().and_then(|bytes| checkpoint::restore(problem, &bytes, digest));
    let (mut progress, mut converged) = (saved.unwrap_or(Progress::BEGIN), false);
    while progress.round < ROUNDS && !converged {
        converged = round(problem, &mut progress)?;
        progress.round += 1;
        if !converged {
            checkpoint.save(&checkpoint::write(problem, &progress, digest));
        }
    }
    let Progress { steps, contradicted, .. } = progress;
    if !problem.is_within_slack() {
        return Err(SignalError::NotFused {
            problem: "poses and readings are further apart in time than three deviations of the offset, or 0.1 s: correct the clocks first ([clocks.NAME] of a recipe), or give a better offset",
        });
    }
    Ok(result::fused(problem, [outside, contradicted], steps, converged)?)
}

/// A round. Whether all came to rest.
fn round(problem: &mut Problem<'_>, progress: &mut Progress) -> Result<bool, SignalError> {
    // While noise is on its way one step is enough: the next round takes another.
    let settles = problem.options.fit_noise && !progress.rested;
    let descent = problem.descend(if settles && progress.round > 0 { 1 } else { STEPS })?;
    progress.steps += descent.steps;
    // Readings between noisy stamps are averages, so that the least depends a little on where between them nodes stand: nodes that do not come to rest are left where they are.
    let late = problem.border.late.abs();
    progress.moving = progress.moving && late > STILL && (progress.round < FREE || late < 0.5 * progress.last);
    progress.last = late;
    if progress.moving {
        problem.move_nodes();
    }
    let mut change = 0.0;
    if settles {
        let whole = problem.whole()?;
        let shares = problem.shares(&whole)?;
        change = problem.take_noise(&shares, &mut progress.changes);
        // The following iterations come to rest at constant noise.
        progress.rested = change < 1.0 && !progress.moving;
    }
    // Outliers are known once the noise nearly is.
    let mut chosen = false;
    if problem.options.gate > 0.0 && change < NEARLY {
        chosen = choose(problem, &mut progress.contradicted)?;
    }
    progress.rested &= !chosen;
    Ok(descent.converged && !progress.moving && !chosen && !settles && progress.round > 0)
}

/// Chooses which poses count. A track that these do not determine any more is dropped, and its poses are added to `contradicted`. Whether the choice changed.
fn choose(problem: &mut Problem<'_>, contradicted: &mut usize) -> Result<bool, SignalError> {
    let (gate, border, setting) = (problem.options.gate, problem.border, problem.setting);
    let mut chosen = false;
    for track in &mut problem.tracks {
        chosen |= track.choose(gate, &border, &setting);
    }
    if chosen {
        problem.at_rest = None;
    }
    // Readings that most poses contradict are no motion of this body.
    let used = || problem.tracks.iter().flat_map(|track| &track.used);
    let all = used().count() + *contradicted;
    let is_rare = |which: usize| 2 * used().filter(|used| used[which]).count() < all;
    if (0..2).any(is_rare) || !problem.tracks.iter().any(Track::is_determined) {
        return Err(SignalError::NotFused {
            problem: "more than half of the poses lie beyond the gate around the motion of the readings: check clocks, frames and units, the mounting and the lever, or state greater noise",
        });
    }
    problem.tracks.retain(|track| {
        let stays = track.is_determined();
        *contradicted += if stays { 0 } else { track.nodes() };
        stays
    });
    Ok(chosen)
}
