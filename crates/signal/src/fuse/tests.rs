//! Fusion against dense algebra, and against the truth of a simulated body.

mod alone;
mod checkpoints;
mod dense;
mod refusals;
mod simulation;

use nalgebra::Cholesky;

use super::{
    BodyNoise, BodyRun, FuseOptions, Fused, ImuNoise, Prior, fuse,
    problem::{Problem, STEPS},
    rotation::rotation,
    rotation::{Vector, exp, log},
    start,
    state::StateError,
    track::{BiasPrior, Setting},
};
use simulation::{GRAVITY, LEVER, MOUNTING, NOISE, OFFSET, Recording};

/// Nothing is known of the constants, but for the offset, to some 50 ms.
fn options() -> FuseOptions {
    FuseOptions {
        noise: NOISE,
        gravity: Prior { value: [0.0, 0.0, -Vector::from(GRAVITY).norm()], deviation: f64::INFINITY },
        lever: Prior { value: [0.0; 3], deviation: f64::INFINITY },
        mounting: Prior { value: [0.0, 0.0, 0.0, 1.0], deviation: f64::INFINITY },
        offset: Prior { value: OFFSET + 0.03, deviation: 0.05 },
        gyro_bias: Prior { value: [0.0; 3], deviation: 0.05 },
        accelerometer_bias: Prior { value: [0.0; 3], deviation: 0.2 },
        ..FuseOptions::default()
    }
}

/// Mounting and gravity are given, lever and offset unknown.
fn known() -> FuseOptions {
    let mounting = exp(&Vector::from(MOUNTING));
    FuseOptions {
        mounting: [mounting.i, mounting.j, mounting.k, mounting.w].into(),
        gravity: GRAVITY.into(),
        offset: Prior { value: OFFSET + 0.003, deviation: 0.005 },
        ..options()
    }
}

/// A problem before its first step.
fn problem<'a>(runs: &[BodyRun<'a>], options: &FuseOptions) -> Problem<'a> {
    let mut tracks: Vec<_> = runs.iter().enumerate().flat_map(|(at, run)| start::tracks(at, run, options).0).collect();
    let bias = |prior: &Prior<[f64; 3]>| BiasPrior { value: prior.value.into(), deviation: prior.deviation };
    let setting = Setting {
        noise: options.noise,
        loss: options.loss,
        biases: [bias(&options.gyro_bias), bias(&options.accelerometer_bias)],
        anchor: options.offset.value,
    };
    let border = start::begin(&mut tracks, options, &setting);
    Problem { tracks, border, setting, options: options.clone(), at_rest: None, readings: [[None; 3]; 2] }
}

/// The deviations of the constants from the truth, in their own deviations.
fn scores(fused: &Fused) -> Vec<f64> {
    let constants = &fused.constants;
    let turned = log(&(rotation(&constants.mounting).inverse() * exp(&Vector::from(MOUNTING))));
    let mut scores: Vec<f64> =
        (0..3).map(|axis| (constants.lever[axis].value - LEVER[axis]) / constants.lever[axis].deviation).collect();
    scores.extend((0..3).map(|axis| turned[axis] / constants.mounting_deviations[axis]));
    scores.push((constants.offset.value - OFFSET) / constants.offset.deviation);
    scores
}

/// Lever, mounting, offset, gravity and biases are found from nothing, and lie within their deviations; every state is near the truth.
#[test]
fn constants_and_states_of_a_simulated_body() {
    let recording = Recording::new(15.0, 1);
    let fused = fuse(&[recording.run()], &options()).unwrap();
    assert!(fused.converged && fused.steps < 60, "{}", fused.steps);
    let scores = scores(&fused);
    assert!(scores.iter().all(|score| score.abs() < 3.5), "{scores:?}");
    let constants = &fused.constants;
    assert!(
        constants.offset.deviation < 2e-4 && constants.lever.iter().all(|axis| axis.deviation < 2e-3),
        "{constants:?}"
    );
    let tilt =
        Vector::from(constants.gravity).cross(&Vector::from(GRAVITY)).norm() / Vector::from(GRAVITY).norm_squared();
    assert!(tilt < 3.5 * constants.gravity_deviations[0].hypot(constants.gravity_deviations[1]), "{tilt}");
    // Of some 1,500 poses those within 50 ms either way of the ends are without readings: 3 deviations of the offset are kept clear, and no more than 0.1 s.
    let states = &fused.tracks[0].states;
    assert_eq!(states.len() + fused.outside, recording.stamps.len());
    assert!(fused.outside < 25, "{}", fused.outside);
    // Errors that last, as that of the lever, are one draw each.
    let mut squares = StateError::zeros();
    for state in states {
        let score = recording.error(state).component_div(&StateError::from(state.deviations));
        squares += score.component_mul(&score);
    }
    let rms = (squares / states.len() as f64).map(f64::sqrt);
    assert!(rms.max() < 2.5 && rms.min() > 0.2, "{rms}");
    let middle = &states[states.len() / 2].deviations;
    assert!(
        middle[3..6].iter().all(|&deviation| deviation < 2e-3)
            && middle[6..9].iter().all(|&deviation| deviation < 5e-3),
        "{middle:?}"
    );
}

/// Consistency of the deviations over twenty recordings. The mean of the squared errors, in units of their covariances,
/// lies within the 95 % band of its law for nine tenths of the time (Bar-Shalom, Li, Kirubarajan, "Estimation with
/// Applications to Tracking and Navigation", 2001, section 5.4). This holds for all 15 numbers together and for each
/// part.
#[test]
fn errors_are_as_large_as_stated() {
    const RUNS: usize = 20;
    let mut sums: Vec<[f64; 6]> = Vec::new();
    for seed in 0..RUNS as u64 {
        let recording = Recording::new(5.0, 50 + seed);
        let options = known();
        let fused = fuse(&[recording.run()], &options).unwrap();
        // The same problem at its solution, for the full covariances.
        let mut solved = problem(
            &[recording.run()],
            &FuseOptions { offset: Prior { value: fused.constants.offset.value, ..options.offset }, ..options },
        );
        solved.options.offset = options.offset;
        solved.descend(STEPS).unwrap();
        let whole = solved.whole().unwrap();
        let states = &fused.tracks[0].states;
        sums.resize(states.len().min(if sums.is_empty() { usize::MAX } else { sums.len() }), [0.0; 6]);
        solved
            .visit(0, &whole, &mut |node, _, joint| {
                let Some(sum) = sums.get_mut(node) else { return };
                let (error, covariance) = (recording.error(&states[node]), joint.unwrap().node);
                sum[0] += error.dot(&Cholesky::new(covariance).unwrap().solve(&error));
                for part in 0..5 {
                    let part_error = error.fixed_rows::<3>(3 * part).into_owned();
                    let block = covariance.fixed_view::<3, 3>(3 * part, 3 * part).into_owned();
                    sum[1 + part] += part_error.dot(&Cholesky::new(block).unwrap().solve(&part_error));
                }
            })
            .unwrap();
    }
    // 2.5 % and 97.5 % of chi squared with 300 and with 60 degrees of freedom.
    let bands = [[253.912, 349.874], [40.482, 83.298]];
    for part in 0..6 {
        let [low, high] = bands[part.min(1)];
        let inside = sums.iter().filter(|sum| low < sum[part] && sum[part] < high).count();
        let share = inside as f64 / sums.len() as f64;
        assert!(share >= 0.9, "part {part}: {share}");
    }
}

/// Rates and accelerations are as wrong as stated, at the stamps of readings and between them.
#[test]
fn rates_and_accelerations_are_as_wrong_as_stated() {
    let recording = Recording::new(8.0, 40);
    let fused = fuse(&[recording.run()], &known()).unwrap();
    let (track, imu) = (&fused.tracks[0], recording.imu());
    let (first, last) = (track.states[0].time, track.states[track.states.len() - 1].time);
    for late in [0.0, 0.0011] {
        let times = recording.times.iter().map(|t| t + late).filter(|&t| first <= t && t <= last);
        let (mut squares, mut count) = ([Vector::zeros(); 2], 0.0);
        for time in times {
            let state = track.at(&imu, fused.constants.gravity, &fused.noise, time).unwrap();
            let stated = [state.rate_deviations, state.acceleration_deviations].map(Vector::from);
            for ((sum, error), stated) in squares.iter_mut().zip(recording.read_error(&state)).zip(&stated) {
                let score = error.component_div(stated);
                *sum += score.component_mul(&score);
            }
            count += 1.0;
        }
        // Some 1,500 readings, each with noise of its node: the root of a mean square is known to 2 %, biases aside.
        let rms = squares.map(|sum| (sum / count).map(f64::sqrt));
        assert!(rms.iter().flatten().all(|rms| (0.9..1.15).contains(rms)), "{late} {rms:?}");
    }
}

/// A body whose rate and velocity jump between readings: means are held over their windows, what rates miss is told by the residuals, and errors of all states are as large as stated, in between and when noise began far off.
#[test]
fn errors_of_a_kicked_body_are_as_large_as_stated() {
    let mut squares = StateError::zeros();
    let mut count = 0.0;
    for seed in 0..6 {
        let recording = Recording::kicked(12.0, 80 + seed);
        let begin = BodyNoise { imu: ImuNoise { gyro_walk: 5e-4, ..BodyNoise::default().imu }, ..BodyNoise::default() };
        // Constants would be one draw a run.
        let (lever, offset) = (LEVER.into(), OFFSET.into());
        let options = FuseOptions { noise: begin, fit_noise: true, fit_walks: [true; 2], lever, offset, ..known() };
        let fused = fuse(&[recording.run()], &options).unwrap();
        let imu = fused.noise.imu;
        assert!(fused.converged, "{}", fused.steps);
        // A jump at any moment of a step is told by the differences of three steps, whose squares sum to 3/2 of its own.
        assert!((0.6..1.1).contains(&imu.missed[0]) && imu.missed[1] == 0.0, "{:?}", imu.missed);
        let force = imu.accelerometer.iter().sum::<f64>() / 3.0 / NOISE.imu.accelerometer[0];
        assert!((force - 1.0).abs() < 0.1, "{force}");
        let (track, record) = (&fused.tracks[0], recording.imu());
        let (first, last) = (track.states[0].time, track.states[track.states.len() - 1].time);
        for &time in recording.times.iter().filter(|&&t| first <= t && t <= last) {
            let state = track.at(&record, fused.constants.gravity, &fused.noise, time).unwrap();
            let score = recording.error(&state).component_div(&StateError::from(state.deviations));
            squares += score.component_mul(&score);
            count += 1.0;
        }
    }
    let rms = (squares / count).map(f64::sqrt);
    // Those of biases last over most of a run, of which six are six draws of three axes, and their walks are told by few of them.
    for (part, least, most) in [(0, 0.85, 1.2), (1, 0.85, 1.2), (2, 0.85, 1.2), (3, 0.6, 1.5), (4, 0.6, 1.5)] {
        let part_rms = (rms.fixed_rows::<3>(3 * part).norm_squared() / 3.0).sqrt();
        assert!(least < part_rms && part_rms < most, "{part} {part_rms} {rms}");
    }
}

/// Runs share the constants: ten of them say more than one.
#[test]
fn runs_share_the_constants() {
    let recordings: Vec<Recording> = (0..4).map(|seed| Recording::new(5.0, 20 + seed)).collect();
    let one = fuse(&[recordings[0].run()], &options()).unwrap();
    let runs: Vec<BodyRun<'_>> = recordings.iter().map(Recording::run).collect();
    let all = fuse(&runs, &options()).unwrap();
    assert_eq!(all.tracks.iter().map(|track| track.run).collect::<Vec<_>>(), [0, 1, 2, 3]);
    let ratio = one.constants.offset.deviation / all.constants.offset.deviation;
    // The motion of all is the same, so that four say twice as much as one.
    assert!((ratio - 2.0).abs() < 0.2, "{ratio}");
    let scores = scores(&all);
    assert!(scores.iter().all(|score| score.abs() < 3.5), "{scores:?}");
    assert_eq!(fuse(&runs, &options()).unwrap(), all);
}

/// Gross errors are found, all of them and nothing else, and leave no trace.
#[test]
fn gross_errors_are_left_out() {
    let mut recording = Recording::new(6.0, 3);
    let clean = fuse(&[recording.run()], &options()).unwrap();
    let wrong: Vec<usize> = (40..500).step_by(37).collect();
    for &row in &wrong {
        recording.positions[row][row % 3] += 0.05 * if row % 2 == 0 { 1.0 } else { -1.0 };
    }
    let turned: Vec<usize> = (53..500).step_by(101).collect();
    for &row in &turned {
        // Marker labels swapped: half a turn.
        let [x, y, z, w] = recording.attitudes[row];
        recording.attitudes[row] = [w, z, -y, -x];
    }
    let fused = fuse(&[recording.run()], &options()).unwrap();
    assert_eq!(fused.tracks[0].positions_rejected, wrong);
    assert_eq!(fused.tracks[0].attitudes_rejected, turned);
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let pairs = clean.tracks[0].states.iter().zip(&fused.tracks[0].states);
    let worst = pairs.map(|(a, b)| apart(&a.position, &b.position)).fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst}");
}

/// Noise that was stated three times too great or too small is found again to a tenth.
#[test]
fn noise_is_estimated_from_residuals() {
    let recording = Recording::new(15.0, 4);
    let BodyNoise { imu, position, attitude, jerk } = NOISE;
    let [gyro, accelerometer] = [imu.gyro.map(|density| 3.0 * density), imu.accelerometer.map(|density| density / 3.0)];
    let imu = ImuNoise { gyro, accelerometer, ..imu };
    let noise = BodyNoise { imu, position: 3.0 * position, attitude: attitude / 3.0, jerk };
    let fused = fuse(&[recording.run()], &FuseOptions { noise, fit_noise: true, ..known() }).unwrap();
    let noise = fused.noise;
    // Of noise that is the same about all axes.
    let mean = |a: &[f64; 3], b: &[f64; 3]| Vector::from(*a).norm() / Vector::from(*b).norm();
    let ratios = [
        mean(&noise.imu.gyro, &NOISE.imu.gyro),
        mean(&noise.imu.accelerometer, &NOISE.imu.accelerometer),
        noise.position / NOISE.position,
        noise.attitude / NOISE.attitude,
    ];
    assert!(fused.converged && ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.1), "{} {ratios:?}", fused.steps);
    // Some 1,500 poses of three axes: each residual tells less than one of the variance.
    let stated = fused.noise_deviations;
    for (value, deviation) in [(noise.position, stated.position), (noise.attitude, stated.attitude)] {
        assert!(((1.0 / 9000.0_f64).sqrt()..0.03).contains(&(deviation / value)), "{}", deviation / value);
    }
    assert_eq!((stated.imu.gyro_walk, stated.jerk), (0.0, 0.0));
}

/// Consistency of the estimated walks and densities: over 24 recordings the logarithms of the estimates scatter as
/// their stated deviations.
#[test]
fn noise_is_as_wrong_as_stated() {
    const RUNS: u64 = 24;
    let mut scores = vec![Vec::new(); 4];
    for seed in 0..RUNS {
        let recording = Recording::new(12.0, 300 + seed);
        let (lever, offset) = (LEVER.into(), OFFSET.into());
        let options = FuseOptions { fit_noise: true, fit_walks: [true; 2], lever, offset, ..known() };
        let fused = fuse(&[recording.run()], &options).unwrap();
        let (estimated, stated) = (fused.noise, fused.noise_deviations);
        for (at, (value, deviation, truth)) in [
            (estimated.imu.gyro_walk, stated.imu.gyro_walk, NOISE.imu.gyro_walk),
            (estimated.imu.accelerometer_walk, stated.imu.accelerometer_walk, NOISE.imu.accelerometer_walk),
            (estimated.imu.accelerometer[1], stated.imu.accelerometer[1], NOISE.imu.accelerometer[1]),
            (estimated.position, stated.position, NOISE.position),
        ]
        .into_iter()
        .enumerate()
        {
            scores[at].push((value / truth).ln() * value / deviation);
        }
    }
    for (at, row) in scores.iter().enumerate() {
        let square = row.iter().map(|score| score * score).sum::<f64>() / row.len() as f64;
        // A walk is expected to be what it is begun with, here the truth, as if one more residual said so: it scatters less than what the record alone tells of it. 24 squares have a mean within 0.5 and 1.7 in 99 % of all cases.
        let [least, most] = if at < 2 { [0.1, 1.7] } else { [0.5, 1.7] };
        assert!(least < square && square < most, "{at}: {square}");
    }
}

/// Between the nodes readings carry the state on.
#[test]
fn states_between_nodes() {
    let recording = Recording::new(5.0, 5);
    let fused = fuse(&[recording.run()], &options()).unwrap();
    let (track, imu) = (&fused.tracks[0], recording.imu());
    let worst = |states: &[super::BodyState]| {
        states.iter().map(|state| recording.error(state).fixed_rows::<3>(3).norm()).fold(0.0, f64::max)
    };
    let (first, last) = (track.states[0].time, track.states[track.states.len() - 1].time);
    let times: Vec<f64> = recording.times.iter().copied().filter(|&t| first <= t && t <= last).collect();
    let between: Vec<_> =
        times.iter().map(|&t| track.at(&imu, fused.constants.gravity, &fused.noise, t).unwrap()).collect();
    assert!(worst(&between) < 1.1 * worst(&track.states), "{} {}", worst(&between), worst(&track.states));
    let node = track.at(&imu, fused.constants.gravity, &fused.noise, track.states[7].time).unwrap();
    assert!(node.position.iter().zip(track.states[7].position).all(|(a, b)| (a - b).abs() < 1e-14));
    assert!(track.at(&imu, fused.constants.gravity, &fused.noise, last).is_some());
    assert!(track.at(&imu, fused.constants.gravity, &fused.noise, last + 1e-6).is_none());
    assert!(track.at(&imu, fused.constants.gravity, &fused.noise, first - 1e-6).is_none());
}

/// A gap of the inertial sensor parts a run in two tracks.
#[test]
fn a_gap_parts_a_run() {
    let recording = Recording::new(6.0, 6);
    let run = recording.run();
    let keep: Vec<usize> = (0..recording.times.len()).filter(|row| !(600..640).contains(row)).collect();
    let times: Vec<f64> = keep.iter().map(|&row| recording.times[row]).collect();
    let rates: Vec<[f64; 3]> = keep.iter().map(|&row| run.imu.rates[row]).collect();
    let forces: Vec<[f64; 3]> = keep.iter().map(|&row| run.imu.forces[row]).collect();
    let imu = super::ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0; 2] };
    let fused = fuse(&[BodyRun { imu, ..run }], &options()).unwrap();
    assert_eq!(fused.tracks.len(), 2);
    let (end, begin) = (fused.tracks[0].states.last().unwrap().time, fused.tracks[1].states[0].time);
    assert!(end < 3.0 && begin > 3.19, "{end} {begin}");
}

/// A filter's state at a pose equals that of a smoother without later measurements. Both linearise at their solution,
/// so that they differ by the curvature within a deviation. Between poses only readings propagate the state, and its
/// errors agree with the stated deviations.
#[test]
fn filter_equals_smoother_at_the_last_reading() {
    let recording = Recording::new(8.0, 12);
    let options =
        FuseOptions { lever: LEVER.into(), offset: OFFSET.into(), gate: 0.0, loss: crate::Loss::Huber(1e9), ..known() };
    let filter = FuseOptions { estimate: crate::Estimate::Filter, ..options.clone() };
    let run = recording.run();
    let fused = fuse(&[run], &filter).unwrap();
    let (track, imu) = (&fused.tracks[0], recording.imu());
    for at in [20, 90, 300, track.states.len() - 1] {
        let state = &track.states[at];
        let count = track.first + at + 1;
        let poses = super::PoseRecord {
            times: &run.poses.times[..count],
            positions: &run.poses.positions[..count],
            attitudes: &run.poses.attitudes[..count],
        };
        let until = fuse(&[BodyRun { poses, ..run }], &options).unwrap();
        let last = until.tracks[0].states.last().unwrap();
        assert_eq!(state.time, last.time);
        for i in 0..15 {
            let (a, b) = (state.deviations[i], last.deviations[i]);
            assert!((a / b - 1.0).abs() < 1e-2, "deviation {i} at {at}: {a} {b}");
        }
        let pairs = state.position.iter().zip(last.position).chain(state.velocity.iter().zip(last.velocity));
        let pairs = pairs.chain(state.gyro_bias.iter().zip(last.gyro_bias)).zip(&last.deviations[3..]);
        for ((a, b), deviation) in pairs {
            assert!((a - b).abs() < 2e-2 * deviation, "at {at}: {a} {b} +- {deviation}");
        }
    }
    let smoothed = fuse(&[run], &options).unwrap();
    let wider = |i: usize| {
        track.states[200].deviations[i]
            / smoothed.tracks[0].states[200 + track.first - smoothed.tracks[0].first].deviations[i]
    };
    assert!((0..9).all(|i| wider(i) > 1.2), "{:?}", (0..9).map(wider).collect::<Vec<_>>());
    // Rows between the poses, from the second second on.
    let times = recording
        .times
        .iter()
        .copied()
        .filter(|&t| track.states[100].time < t && t < track.states.last().unwrap().time);
    let states: Vec<_> = times.map(|t| track.at(&imu, fused.constants.gravity, &fused.noise, t).unwrap()).collect();
    for part in 0..3 {
        let square = |state: &super::BodyState| {
            let error = recording.error(state);
            (3 * part..3 * part + 3).map(|i| (error[i] / state.deviations[i]).powi(2)).sum::<f64>() / 3.0
        };
        let mean = states.iter().map(square).sum::<f64>() / states.len() as f64;
        // Errors of neighbouring rows go together.
        assert!((0.5..1.6).contains(&mean), "part {part}: {mean}");
    }
}
