//! First values of the iteration: tracks, states from the poses alone, and constants without prior knowledge.

use super::{
    BodyRun, FuseOptions, Prior,
    preintegration::Preintegrated,
    rotation::{Matrix, Rotation, Vector, log, rotation},
    state::{Border, State},
    track::{Setting, Track},
};
use crate::{Lambda, Spline, smooth};
use fleetfoot_data::{Cancelled, Silent, parallel_map};

/// Median periods of the inertial sensor that make a gap.
const GAP: f64 = 5.0;

/// Seconds by which the offset may move at most before a pose at the end of a record has no readings about it.
const MARGIN: f64 = 0.1;

/// Radians by which an attitude differs from the gyroscope's that is a gross error.
const FAR: f64 = 0.3;

/// Such poses one after the other that are right.
const DOUBTED: usize = 10;

/// Seconds by which the offset may move, either way.
pub(crate) fn slack(offset: &Prior<f64>) -> f64 {
    (3.0 * offset.deviation).min(MARGIN)
}

/// The tracks of a run, and how many of its poses are in none.
pub(super) fn tracks<'a>(at: usize, run: &BodyRun<'a>, options: &FuseOptions) -> (Vec<Track<'a>>, usize) {
    let (imu, poses) = (run.imu, run.poses);
    let slack = slack(&options.offset);
    let [begin, end] = [imu.times[0] + slack, imu.times[imu.times.len() - 1] - slack];
    let gaps: Vec<[f64; 2]> = gaps(imu.times).iter().map(|[from, to]| [from - slack, to + slack]).collect();
    let mut tracks: Vec<Track<'a>> = Vec::new();
    let (mut first, mut outside) = (0, 0);
    while first < poses.times.len() {
        let instant = |pose: usize| poses.times[pose] + options.offset.value;
        if instant(first) < begin || instant(first) > end {
            (first, outside) = (first + 1, outside + 1);
            continue;
        }
        let mut last = first + 1;
        while last < poses.times.len() && instant(last) <= end && !holds(&gaps, instant(last - 1), instant(last)) {
            last += 1;
        }
        // Poses within a gap stand alone.
        if last - first > 1 {
            tracks.push(track(at, run, first..last));
        } else {
            outside += 1;
        }
        first = last;
    }
    (tracks, outside)
}

/// The gaps between increasing stamps, of which there are two or more: steps of more than five median ones, from when to when.
pub fn gaps(times: &[f64]) -> Vec<[f64; 2]> {
    if times.len() < 2 {
        return Vec::new();
    }
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = steps.len() / 2;
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    let longest = GAP * *median;
    times.windows(2).filter(|pair| pair[1] - pair[0] > longest).map(|pair| [pair[0], pair[1]]).collect()
}

/// Returns true if one of these gaps lies in part between two instants.
fn holds(gaps: &[[f64; 2]], from: f64, to: f64) -> bool {
    let next = gaps.partition_point(|gap| gap[1] <= from);
    gaps.get(next).is_some_and(|gap| gap[0] < to)
}

fn track<'a>(at: usize, run: &BodyRun<'a>, rows: std::ops::Range<usize>) -> Track<'a> {
    Track {
        imu: run.imu,
        run: at,
        first: rows.start,
        used: vec![[true; 2]; rows.len()],
        stamps: &run.poses.times[rows],
        poses: run.poses,
        states: Vec::new(),
        reference: [Vector::zeros(); 2],
        sums: Vec::new(),
    }
}

/// The density of the jerk to begin with, where no force is measured: what a smoothing spline says of the positions of the longest track.
pub(super) fn jerk(tracks: &[Track<'_>], otherwise: f64) -> f64 {
    const ROWS: usize = 20_000;
    let Some(longest) = tracks.iter().reduce(|most, track| if track.nodes() > most.nodes() { track } else { most })
    else {
        return otherwise;
    };
    let rows = longest.nodes().min(ROWS);
    let of_axis = |axis: usize| {
        let values: Vec<f64> = (0..rows).map(|node| longest.measured(node).position[axis]).collect();
        let smoothed = smooth(&longest.stamps[..rows], &values, None, Spline::Quintic, Lambda::Likelihood).ok()?;
        Some(smoothed.noise / smoothed.lambda.sqrt()).filter(|jerk| *jerk > 0.0 && jerk.is_finite())
    };
    (0..3).filter_map(of_axis).reduce(f64::max).unwrap_or(otherwise)
}

/// Poses of all tracks up to which what was measured between them is kept, and what an elimination leaves of them: some 7 KB each.
pub(super) const SHORT: usize = 16_384;

/// Nodes whose readings are summed at a time.
const PIECE: usize = 256;

/// Sums the readings between nodes, where there are not too many of these to keep the sums.
pub(super) fn sum(tracks: &mut [Track<'_>], setting: &Setting) {
    tracks.iter_mut().for_each(|track| track.sums.clear());
    if tracks.iter().map(Track::nodes).sum::<usize>() > SHORT {
        return;
    }
    let piece = |(at, track): (usize, &Track<'_>)| (0..track.nodes() - 1).step_by(PIECE).map(move |first| (at, first));
    let pieces: Vec<(usize, usize)> = tracks.iter().enumerate().flat_map(piece).collect();
    let sums = parallel_map(pieces.len(), &Silent, |piece| {
        let (at, first) = pieces[piece];
        let track = &tracks[at];
        let nodes = first..(first + PIECE).min(track.nodes() - 1);
        Ok::<_, Cancelled>(nodes.map(|node| track.summed(node, setting)).collect::<Vec<_>>())
    });
    // With a stop, sums are made when they are needed.
    for ((at, _), sums) in pieces.iter().zip(sums.into_iter().flatten()) {
        tracks[*at].sums.extend(sums);
    }
}

/// Gives every track states that follow from its poses, and hands back the constants to begin with.
pub(super) fn begin(tracks: &mut [Track<'_>], options: &FuseOptions, setting: &Setting) -> Border {
    let mounting = match options.mounting.deviation.is_finite() {
        true => rotation(&options.mounting.value),
        false => mounting(tracks, setting),
    };
    let mut border =
        Border { lever: options.lever.value.into(), mounting, late: 0.0, gravity: options.gravity.value.into() };
    for track in tracks.iter_mut() {
        track.reference = setting.biases.map(|prior| prior.value);
    }
    sum(tracks, setting);
    for track in tracks.iter_mut() {
        track.states = states(track, &border, setting);
    }
    if options.gravity.deviation.is_infinite() {
        border.gravity = gravity(tracks, &border, setting);
    }
    border
}

/// Attitudes and positions of the poses, velocities by differences, and the biases that are expected.
fn states(track: &Track<'_>, border: &Border, setting: &Setting) -> Vec<State> {
    let attitudes = attitudes(track, border, setting);
    let position = |node: usize| track.measured(node).position - attitudes[node] * border.lever;
    let last = track.nodes() - 1;
    let velocity = |node: usize| {
        let (a, b) = (node.saturating_sub(1), (node + 1).min(last));
        (position(b) - position(a)) / (track.stamps[b] - track.stamps[a])
    };
    let state = |node: usize| State {
        attitude: attitudes[node],
        position: position(node),
        velocity: velocity(node),
        gyro: setting.biases[0].value,
        accelerometer: setting.biases[1].value,
    };
    (0..track.nodes()).map(state).collect()
}

/// The attitudes of the poses, but for those that differ from what the gyroscope says since the last: half a turn off, the iteration would not find back. Where poses differ again and again, they are right.
fn attitudes(track: &Track<'_>, border: &Border, setting: &Setting) -> Vec<Rotation> {
    let back = border.mounting.inverse();
    let seen = |node: usize| track.measured(node).attitude * back;
    let (mut attitudes, mut doubted) = (vec![seen(0)], 0);
    for node in 1..track.nodes() {
        let turn = track.between(node - 1, setting).rotation;
        let carried = attitudes[node - 1] * turn;
        let differs = carried.angle_to(&seen(node)) > FAR;
        doubted = if differs { doubted + 1 } else { 0 };
        attitudes.push(if differs && doubted < DOUBTED { carried } else { seen(node) });
    }
    attitudes
}

/// The rotation that takes the turns of the markers' frame to those of the gyroscope, a constant bias aside (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976).
fn mounting(tracks: &[Track<'_>], setting: &Setting) -> Rotation {
    let (mut sum, mut mean, mut seconds) = (Matrix::zeros(), [Vector::zeros(); 2], 0.0);
    let turns = || {
        tracks.iter().flat_map(|track| {
            (1..track.nodes()).map(move |node| {
                let (from, to) = (track.time(node - 1, setting), track.time(node, setting));
                let zero = [Vector::zeros(); 2];
                let body = log(&Preintegrated::new(&track.imu, from, to, &zero, &setting.noise.imu).rotation);
                let seen = log(&(track.measured(node - 1).attitude.inverse() * track.measured(node).attitude));
                (to - from, body, seen)
            })
        })
    };
    // A turn of another size is a gross error: mounting turns its axis alone.
    let turns = || turns().filter(|(_, body, seen)| (body.norm() - seen.norm()).abs() < FAR);
    for (dt, body, seen) in turns() {
        (mean[0], mean[1], seconds) = (mean[0] + body, mean[1] + seen, seconds + dt);
    }
    for (dt, body, seen) in turns() {
        let pair = [body - mean[0] * (dt / seconds), seen - mean[1] * (dt / seconds)];
        sum += pair[0] * pair[1].transpose() / dt;
    }
    let factors = sum.svd(true, true);
    let (Some(u), Some(v)) = (factors.u, factors.v_t) else { return Rotation::identity() };
    let sign = (u * v).determinant().signum();
    let matrix = u * Matrix::from_diagonal(&Vector::new(1.0, 1.0, sign)) * v;
    Rotation::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(matrix))
}

/// Gravity of the given size against the mean of the force in the world: a body that stays in a room is not accelerated for long.
fn gravity(tracks: &[Track<'_>], border: &Border, setting: &Setting) -> Vector {
    let mut sum = Vector::zeros();
    for track in tracks {
        for (node, state) in track.states.iter().enumerate() {
            sum += state.attitude * (track.imu.at(track.time(node, setting)).force - state.accelerometer);
        }
    }
    if sum.norm() > 0.0 { sum * (-border.gravity.norm() / sum.norm()) } else { border.gravity }
}
