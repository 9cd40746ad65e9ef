//! Data that are refused, left out, or stopped.

use fleetfoot_data::{Cancelled, Stop, stoppable};

use super::{
    Recording, known, options, problem,
    simulation::{NOISE, OFFSET},
};
use crate::{
    SignalError,
    fuse::{
        BodyNoise, BodyRun, BodyTrack, FuseOptions, Fused, ImuRecord, PoseRecord, Prior,
        chain::{Chain, Row, Undetermined, WIDTH},
        fuse,
    },
};

#[test]
fn inputs_that_cannot_be_fused_are_refused() {
    let recording = Recording::new(3.0, 7);
    let run = recording.run();
    let refused = |run: BodyRun<'_>, options: &FuseOptions| fuse(&[run], options).map(|_| ()).unwrap_err();
    let far = FuseOptions { offset: 100.0.into(), ..options() };
    assert!(matches!(refused(run, &far), SignalError::NotFused { .. }));
    let noise = BodyNoise { position: 0.0, ..NOISE };
    assert!(refused(run, &FuseOptions { noise, ..options() }).to_string().contains("deviation of positions"));
    let certain = Prior { value: [0.0; 3], deviation: 0.0 };
    assert!(refused(run, &FuseOptions { gyro_bias: certain, ..options() }).to_string().contains("positive"));
    let mut zero = recording.attitudes.clone();
    zero[9] = [0.0; 4];
    let poses = PoseRecord { attitudes: &zero, ..run.poses };
    assert_eq!(refused(BodyRun { poses, ..run }, &options()), SignalError::Attitude { row: 9 });
    // Positions of something that stands still, while the body flies.
    let poses = PoseRecord { positions: &vec![[0.0; 3]; zero.len()], ..run.poses };
    let noise = BodyNoise { position: 1e-5, ..NOISE };
    let error = refused(BodyRun { poses, ..run }, &FuseOptions { noise, ..known() });
    assert!(error.to_string().contains("more than half"), "{error}");
    // A body that stands still tells nothing of a lever.
    let still = vec![[0.0; 3]; recording.times.len()];
    let up = vec![[0.0, 0.0, 9.8]; recording.times.len()];
    let imu = ImuRecord { rates: &still, forces: &up, ..run.imu };
    let (positions, attitudes) = (vec![[0.0; 3]; zero.len()], vec![[0.0, 0.0, 0.0, 1.0]; zero.len()]);
    let poses = PoseRecord { times: run.poses.times, positions: &positions, attitudes: &attitudes };
    let error = fuse(&[BodyRun { imu, poses }], &FuseOptions { mounting: [0.0, 0.0, 0.0, 1.0].into(), ..options() })
        .map(|_| ())
        .unwrap_err();
    assert!(error.to_string().contains("does not determine"), "{error}");
}

/// Positions of a short stretch all contradict the readings between them: the stretch is left out and counted, and the others are what they are without it.
#[test]
fn undetermined_stretches_are_dropped() {
    let mut recording = Recording::new(6.0, 8);
    // Two gaps: from 1.0 to 1.2 s and from 1.3 to 1.5 s by the readings.
    let keep: Vec<usize> =
        (0..recording.times.len()).filter(|row| !(201..240).contains(row) && !(261..300).contains(row)).collect();
    let short: Vec<usize> =
        (0..recording.stamps.len()).filter(|&row| (1.21..1.29).contains(&(recording.stamps[row] + OFFSET))).collect();
    for &row in &short {
        let angle = 7.0 * row as f64;
        recording.positions[row] = [angle.sin(), angle.cos(), (1.7 * angle).sin()].map(|part| 5.0 * part);
    }
    let run = recording.run();
    let of = |rows: &[[f64; 3]]| keep.iter().map(|&row| rows[row]).collect::<Vec<_>>();
    let times: Vec<f64> = keep.iter().map(|&row| recording.times[row]).collect();
    let (rates, forces) = (of(run.imu.rates), of(run.imu.forces));
    let imu = ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0; 2] };
    let given = FuseOptions { offset: OFFSET.into(), ..known() };
    let fused = fuse(&[BodyRun { imu, ..run }], &given).unwrap();
    assert!(fused.converged);
    assert_eq!((fused.tracks.len(), fused.contradicted), (2, 10), "{}", fused.outside);
    let states: usize = fused.tracks.iter().map(|track| track.states.len()).sum();
    assert_eq!(states + fused.contradicted + fused.outside, recording.stamps.len());
    // As if these poses had not been measured.
    let seen: Vec<usize> = (0..recording.stamps.len()).filter(|row| !short.contains(row)).collect();
    let stamps: Vec<f64> = seen.iter().map(|&row| recording.stamps[row]).collect();
    let positions: Vec<[f64; 3]> = seen.iter().map(|&row| recording.positions[row]).collect();
    let attitudes: Vec<[f64; 4]> = seen.iter().map(|&row| recording.attitudes[row]).collect();
    let poses = PoseRecord { times: &stamps, positions: &positions, attitudes: &attitudes };
    let without = fuse(&[BodyRun { imu, poses }], &given).unwrap();
    for axis in 0..3 {
        let [a, b] = [&fused, &without].map(|fused: &Fused| fused.constants.lever[axis]);
        assert!((a.value - b.value).abs() < 1e-3 * b.deviation, "{a:?} {b:?}");
    }
}

/// Without positions a track lies anywhere: what rounding leaves of them is no knowledge.
#[test]
fn a_track_without_positions_is_undetermined() {
    for seed in 0..4 {
        let recording = Recording::new(0.6, 30 + seed);
        let mut problem = problem(&[recording.run()], &FuseOptions { lever: [0.05; 3].into(), ..known() });
        assert!(problem.step(0.0).is_ok());
        problem.tracks[0].used.iter_mut().for_each(|used| used[0] = false);
        assert_eq!(problem.step(0.0).map(|_| ()), Err(Undetermined));
    }
}

/// An offset that is further off than its deviation allows leaves nodes without readings at the ends: it is told.
#[test]
fn offset_beyond_its_deviation_is_refused() {
    let recording = Recording::new(5.0, 9);
    let with = |deviation: f64| FuseOptions { offset: Prior { value: OFFSET - 0.03, deviation }, ..known() };
    assert!(fuse(&[recording.run()], &with(0.015)).is_ok());
    let error = fuse(&[recording.run()], &with(0.005)).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("further apart in time"), "{error}");
}

/// Finite numbers whose squares are not: no state is made of them.
#[test]
fn overflow_is_an_error() {
    let recording = Recording::new(3.0, 10);
    let run = recording.run();
    for row in [100, 200] {
        let mut forces = run.imu.forces.to_vec();
        forces[row] = [1e200; 3];
        let mut rates = run.imu.rates.to_vec();
        rates[row] = [1e200; 3];
        let mut positions = run.poses.positions.to_vec();
        positions[row] = [1e200; 3];
        let pushed = BodyRun { imu: ImuRecord { forces: &forces, ..run.imu }, ..run };
        let turned = BodyRun { imu: ImuRecord { rates: &rates, ..run.imu }, ..run };
        let moved = BodyRun { poses: PoseRecord { positions: &positions, ..run.poses }, ..run };
        for (run, what) in [(pushed, "force"), (turned, "rate"), (moved, "position")] {
            let error = fuse(&[run], &options()).map(|_| ()).map_err(|error| error.to_string());
            assert!(error.as_ref().is_err_and(|error| error.contains("overflow")), "{row} {what} {error:?}");
        }
    }
}

/// Numbers that are none are no solution of a chain.
#[test]
fn a_chain_of_nan_is_undetermined() {
    let recording = Recording::new(0.35, 11);
    let problem = problem(&[recording.run()], &options());
    let track = &problem.tracks[0];
    let rows = |node: usize, rows: &mut Vec<Row>| {
        track.push(node, &problem.border, &problem.setting, rows);
        rows.iter_mut().filter(|_| node == 5).for_each(|row| row[3] = f64::NAN);
    };
    assert!(
        Chain { nodes: track.nodes(), rows: &rows, damping: 0.0, width: WIDTH, keeps_all: false }.eliminated().is_err()
    );
}

/// A stop ends the fusion, and a chain by itself: neither answers with what was not computed.
#[test]
fn a_stop_ends_fusion() {
    let recording = Recording::new(3.0, 12);
    let stop = Stop::default();
    assert!(stoppable(&stop, || fuse(&[recording.run()], &options())).is_ok());
    stop.set();
    assert_eq!(stoppable(&stop, || fuse(&[recording.run()], &options())), Err(Cancelled));
    let problem = problem(&[recording.run()], &options());
    let track = &problem.tracks[0];
    let rows = |node: usize, rows: &mut Vec<Row>| track.push(node, &problem.border, &problem.setting, rows);
    let chain = Chain { nodes: track.nodes(), rows: &rows, damping: 0.0, width: WIDTH, keeps_all: false };
    assert_eq!(stoppable(&stop, || chain.eliminated().is_ok()), Err(Cancelled));
    let cost = || track.cost(&track.states, &problem.border, &problem.setting);
    assert_eq!(stoppable(&stop, cost), Err(Cancelled));
}

#[test]
fn a_track_without_states_has_none_anywhere() {
    let recording = Recording::new(1.0, 13);
    let (fused, imu) = (fuse(&[recording.run()], &known()).unwrap(), recording.imu());
    let first = fused.tracks[0].states[0];
    for states in [vec![], vec![first]] {
        let track = BodyTrack { states, ..fused.tracks[0].clone() };
        assert_eq!(track.at(&imu, fused.constants.gravity, &fused.noise, first.time), None);
    }
}
