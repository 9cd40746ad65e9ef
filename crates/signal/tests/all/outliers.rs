//! Gross errors, stuck and saturated stretches.

use std::collections::BTreeSet;

use fleetfoot_signal::{Lambda, Spline, hampel, hangs, noise_of_differences, reject, saturated, smooth, stuck};

use crate::common::{normal, uniform};

const ROWS: usize = 4000;

/// A smooth motion with noise of 0.01, every fiftieth row or so wrong by 0.5 to 5; the wrong rows.
fn spoiled(seed: u64) -> (Vec<f64>, Vec<f64>, BTreeSet<usize>) {
    let times: Vec<f64> = (0..ROWS).map(|row| 0.005 * row as f64).collect();
    let wrong: BTreeSet<usize> = (0..ROWS).filter(|&row| uniform(seed, row as u64) < 0.02).collect();
    let value = |row: usize| {
        let motion = (2.0 * times[row]).sin() + 0.3 * (7.0 * times[row]).cos();
        let error = (0.5 + 4.5 * uniform(seed + 1, row as u64)) * if row.is_multiple_of(2) { 1.0 } else { -1.0 };
        motion + 0.01 * normal(seed + 2, row as u64) + if wrong.contains(&row) { error } else { 0.0 }
    };
    let values = (0..ROWS).map(value).collect();
    (times, values, wrong)
}

/// Every gross error is found, and of the good rows no more than a normal distribution has beyond four deviations, four in a hundred thousand, leaves out by chance.
#[test]
fn gross_errors_are_rejected_and_good_rows_kept() {
    for seed in [1, 10, 20] {
        let (times, values, wrong) = spoiled(seed);
        for spline in [Spline::Cubic, Spline::Quintic] {
            let rejected = reject(&times, &values, None, spline, Lambda::Likelihood, 4.0).unwrap();
            let rows: BTreeSet<usize> = rejected.rows.iter().copied().collect();
            assert!(wrong.is_subset(&rows), "{spline:?}: missed {:?}", wrong.difference(&rows));
            let lost = rows.difference(&wrong).count();
            assert!(lost <= 3 && !rejected.gave_up, "{spline:?}: {lost} good rows of {ROWS}");
            assert!((rejected.smoothed.noise / 0.01 - 1.0).abs() < 0.05, "{}", rejected.smoothed.noise);
            // The remaining samples are smoothed as if the others had never been measured.
            let mut left = values.clone();
            rejected.rows.iter().for_each(|&row| left[row] = f64::NAN);
            let again = smooth(&times, &left, None, spline, Lambda::Given(rejected.smoothed.lambda)).unwrap();
            let apart = again.derivatives[1].iter().zip(&rejected.smoothed.derivatives[1]).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) < 1e-9);
        }
    }
}

/// Errors in a row that are alike, as of a marker that was taken for another: they are left out, and not the good rows about them, which stand out of a curve that was bent to the errors.
#[test]
fn burst_is_rejected_without_neighbours() {
    for (seed, length, size) in [(1, 30, 0.5), (2, 12, -0.3), (3, 40, 2.0)] {
        let times: Vec<f64> = (0..ROWS).map(|row| 0.01 * row as f64).collect();
        let motion = |t: &f64| (0.7 * t).sin() + 0.5 * (2.3 * t).cos();
        let wrong = 2000..2000 + length;
        let error = |row: usize| if wrong.contains(&row) { size } else { 0.0 };
        let value = |(t, row): (&f64, usize)| motion(t) + 0.01 * normal(seed, row as u64) + error(row);
        let values: Vec<f64> = times.iter().zip(0..).map(value).collect();
        for spline in [Spline::Cubic, Spline::Quintic] {
            let rejected = reject(&times, &values, None, spline, Lambda::Likelihood, 4.0).unwrap();
            let missed = wrong.clone().filter(|row| !rejected.rows.contains(row)).count();
            let lost = rejected.rows.iter().filter(|row| !wrong.contains(row)).count();
            assert!(missed == 0 && lost <= 2, "{spline:?}, {length} rows: {missed} missed, {lost} lost");
            let off = |row: usize| (rejected.smoothed.derivatives[0][row] - motion(&times[row])).abs();
            let worst = wrong.clone().map(|row| off(row) / rejected.smoothed.deviations[0][row]).fold(0.0, f64::max);
            assert!(worst < 5.0, "{spline:?}, {length} rows: {worst} deviations off");
        }
    }
}

/// Noise alone loses nothing, or what chance leaves out.
#[test]
fn a_clean_channel_stays_whole() {
    let times: Vec<f64> = (0..ROWS).map(|row| 0.005 * row as f64).collect();
    let values: Vec<f64> = times.iter().zip(0..).map(|(t, row)| t.sin() + 0.01 * normal(5, row)).collect();
    let rejected = reject(&times, &values, None, Spline::Cubic, Lambda::Likelihood, 4.0).unwrap();
    assert!(rejected.rows.len() <= 2, "{:?}", rejected.rows);
    assert!(reject(&times, &values, None, Spline::Cubic, Lambda::Likelihood, 0.0).is_err());
}

/// A channel that is no smooth curve is given up and told.
#[test]
fn rejection_gives_up_without_a_smooth_curve() {
    let times: Vec<f64> = (0..400).map(f64::from).collect();
    let values: Vec<f64> =
        (0..400).map(|row| if row % 4 == 0 { 100.0 * uniform(1, row) } else { 0.01 * normal(2, row) }).collect();
    let rejected = reject(&times, &values, None, Spline::Cubic, Lambda::Given(1e4), 1.5).unwrap();
    assert!(rejected.gave_up && rejected.rows.is_empty());
}

/// A wheel whose motor is switched on and off jumps in its acceleration, and hardly in anything else: that is motion. Leaving the jumps out would leave a smoother channel with
/// more noise, step by step.
#[test]
fn jumps_of_the_motion_are_no_gross_errors() {
    let times: Vec<f64> = (0..ROWS).map(|row| 0.01 * row as f64).collect();
    let mut rate = 0.0;
    let value = |row: usize| {
        let voltage = if uniform(8, row as u64 / 25) < 0.5 { -1.0 } else { 1.0 };
        rate += 0.3 * (10.0 * voltage - rate);
        rate + 0.005 * normal(9, row as u64)
    };
    let values: Vec<f64> = (0..ROWS).map(value).collect();
    let rejected = reject(&times, &values, None, Spline::Cubic, Lambda::Likelihood, 4.0).unwrap();
    assert!(rejected.rows.len() < ROWS / 1000, "{} of {ROWS}", rejected.rows.len());
}

#[test]
fn hampel_finds_spikes_and_leaves_steps_ramps_and_rest() {
    let mut values: Vec<f64> = (0..200).map(|row| f64::from(row) * 0.1 + 0.01 * normal(1, row as u64)).collect();
    values[100] += 5.0;
    values[37] = f64::NAN;
    assert_eq!(hampel(&values, 3, 6.0, 0.0).unwrap(), [100]);
    // A quantised channel at rest: one step up and down again is a step of the converter, and its floor.
    let mut rest = vec![1.0; 50];
    rest[20] = 1.001;
    assert_eq!(hampel(&rest, 3, 4.0, 0.0).unwrap(), [20]);
    assert!(hampel(&rest, 3, 4.0, 0.001).unwrap().is_empty());
    let step: Vec<f64> = (0..50).map(|row| f64::from(row >= 25)).collect();
    assert!(hampel(&step, 3, 4.0, 1e-3).unwrap().is_empty());
    assert!(hampel(&rest, 0, 4.0, 0.0).is_err() && hampel(&rest, 3, -1.0, 0.0).is_err());
}

#[test]
fn noise_from_differences_tolerates_gross_errors() {
    let (_, values, _) = spoiled(3);
    let noise = noise_of_differences(&values);
    // One row in sixteen has a gross error among its differences: the median moves by less than a tenth.
    assert!((noise / 0.01 - 1.0).abs() < 0.1, "{noise}");
    assert_eq!(noise_of_differences(&[1.0; 9]), 0.0);
}

#[test]
fn stuck_and_saturated_stretches_have_their_places() {
    let values = [0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, f64::NAN, f64::NAN, f64::NAN, 5.0, 5.0, 5.0];
    assert_eq!(stuck(&values, 2), [1..5, 10..13]);
    assert_eq!(stuck(&values, 3).first(), Some(&(1..5)));
    assert!(stuck(&[], 1).is_empty());
    assert_eq!(saturated(&values, 0.0, 5.0), [0, 10, 11, 12]);
}

/// A sensor that hangs while the machine moves on is told from one that is at rest, from the steps of a coarse one, and from a channel that is held between its samples.
#[test]
fn hanging_values_differ_from_rest() {
    let motion = |row: usize| (0.01 * row as f64).sin();
    let noisy: Vec<f64> = (0..1000).map(|row| motion(row) + 1e-3 * normal(8, row as u64)).collect();
    assert!(hangs(&noisy).is_empty());
    let mut hung = noisy.clone();
    hung[300..400].fill(noisy[300]);
    assert!(matches!(&hangs(&hung)[..], [run] if *run == (300..400)));
    let coarse: Vec<f64> = (0..1000).map(|row| (50.0 * motion(row)).round() / 50.0).collect();
    assert!(hangs(&coarse).is_empty());
    let held: Vec<f64> = (0..1000).map(|row| noisy[row / 10 * 10]).collect();
    assert!(hangs(&held).is_empty(), "{:?}", hangs(&held));
    let rests: Vec<f64> = (0..1000).map(|row| if row < 500 { 0.0 } else { motion(row - 500) }).collect();
    assert!(hangs(&rests).is_empty() && hangs(&[1.0; 50]).is_empty() && hangs(&[]).is_empty());
}
