//! Interpolating splines.

use fleetfoot_signal::{Interpolant, Interpolation, SignalError};
use proptest::prelude::*;

use crate::common::{distance, uniform};

const BOTH: [Interpolation; 2] = [Interpolation::NotAKnot, Interpolation::ShapePreserving];

/// Stamps whose steps differ by up to `ratio` times.
fn stamps(rows: u64, ratio: f64, seed: u64) -> Vec<f64> {
    let mut time = 0.0;
    let next = |row| {
        time += 0.01 * ratio.powf(uniform(seed, row));
        time
    };
    (0..rows).map(next).collect()
}

fn between(times: &[f64]) -> Vec<f64> {
    times.windows(2).flat_map(|pair| [0.1, 0.5, 0.8].map(|share| pair[0] + share * (pair[1] - pair[0]))).collect()
}

/// A cubic has one spline: itself, with its derivatives, from four points on.
#[test]
fn cubics_are_reproduced() {
    for rows in [4, 5, 40, 5000] {
        let times = stamps(rows, 30.0, rows);
        let cubic = |t: f64| [2.0 - t + 0.3 * t * t - 0.02 * t * t * t, -1.0 + 0.6 * t - 0.06 * t * t, 0.6 - 0.12 * t];
        let values: Vec<f64> = times.iter().map(|&t| cubic(t)[0]).collect();
        let curve = Interpolant::new(&times, &values, Interpolation::NotAKnot).unwrap();
        let at = between(&times);
        for (k, interpolated) in curve.all(&at).iter().enumerate() {
            let expected: Vec<f64> = at.iter().map(|&t| cubic(t)[k]).collect();
            // Rounding of values of 2e6 over steps of 0.01 s and their squares, beside slopes of 1e4 and second derivatives of 50.
            let tolerance = [1e-13, 1e-10, 1e-6][k];
            let apart = distance(interpolated, &expected);
            assert!(apart < tolerance, "{rows} rows, derivative {k}: {apart:e}");
        }
    }
}

/// Two points are joined by a line, three by a parabola.
#[test]
fn few_points_determine_the_curve() {
    for kind in BOTH {
        let line = Interpolant::new(&[1.0, 3.0], &[5.0, 1.0], kind).unwrap();
        assert_eq!(line.at(2.0), [3.0, -2.0, 0.0]);
    }
    let parabola = Interpolant::new(&[0.0, 1.0, 3.0], &[0.0, 1.0, 9.0], Interpolation::NotAKnot).unwrap();
    let [value, slope, second] = parabola.at(2.0);
    assert!((value - 4.0).abs() < 1e-14 && (slope - 4.0).abs() < 1e-14 && (second - 2.0).abs() < 1e-14);
}

/// At the measurements the curve is what was measured, bit by bit; those that are missing are not there.
#[test]
fn measurements_are_met_and_missing_ones_bridged() {
    let times = stamps(300, 10.0, 1);
    let values: Vec<f64> = (0..300).map(|row| if row % 7 == 3 { f64::NAN } else { uniform(2, row) }).collect();
    let kept: Vec<usize> = (0..300).filter(|row| row % 7 != 3).collect();
    let pick = |of: &[f64]| kept.iter().map(|&row| of[row]).collect::<Vec<f64>>();
    for kind in BOTH {
        let curve = Interpolant::new(&times, &values, kind).unwrap();
        assert!(kept.iter().all(|&row| curve.at(times[row])[0] == values[row]));
        assert_eq!(curve, Interpolant::new(&pick(&times), &pick(&values), kind).unwrap());
        let all = curve.all(&times);
        assert!((0..300).all(|row| curve.at(times[row])[1].to_bits() == all[1][row].to_bits()));
    }
}

#[test]
fn bad_points_are_refused() {
    let kind = Interpolation::NotAKnot;
    let try_it = |times: &[f64], values: &[f64]| Interpolant::new(times, values, kind).unwrap_err();
    assert_eq!(try_it(&[0.0, 1.0], &[1.0, f64::NAN]), SignalError::TooFew { count: 1, needed: 2 });
    assert!(matches!(try_it(&[0.0, 0.0], &[1.0, 2.0]), SignalError::Stamp { row: 1, .. }));
    assert!(matches!(try_it(&[0.0, 1.0], &[1.0]), SignalError::Length { .. }));
    assert!(matches!(try_it(&[0.0, 1.0], &[1.0, f64::INFINITY]), SignalError::NotFinite { row: 1, .. }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Points that rise have a rising curve in between, and level points a level one.
    #[test]
    fn monotone_points_have_a_monotone_curve(seed in 0u64..10_000, rows in 2u64..60, ratio in 1.0..1000.0_f64) {
        let times = stamps(rows, ratio, seed);
        let mut level = 0.0;
        let rise = |row| { level += (uniform(seed + 1, row) - 0.3).max(0.0).powi(3); level };
        let values: Vec<f64> = (0..rows).map(rise).collect();
        let curve = Interpolant::new(&times, &values, Interpolation::ShapePreserving).unwrap();
        let [value, slope, _] = curve.all(&between(&times));
        // Slopes that cancel leave their rounding.
        let steepest = slope.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
        prop_assert!(slope.iter().all(|s| *s >= -1e-14 * steepest), "{slope:?}");
        let size = values[values.len() - 1];
        prop_assert!(value.windows(2).all(|pair| pair[1] >= pair[0] - 1e-15 * size));
    }

    /// Both curves are no more than their points: units, origins and the direction of time do not matter.
    #[test]
    fn units_and_direction_do_not_matter(seed in 0u64..10_000, rows in 4u64..40, unit in -4.0..4.0_f64) {
        let (times, unit) = (stamps(rows, 20.0, seed), 10.0_f64.powf(unit));
        let values: Vec<f64> = (0..rows).map(|row| uniform(seed + 1, row)).collect();
        let end = times[times.len() - 1];
        let at = between(&times);
        for kind in BOTH {
            let curve = Interpolant::new(&times, &values, kind).unwrap().all(&at);
            let mirrored: Vec<f64> = times.iter().rev().map(|t| unit * (end - t)).collect();
            let backwards: Vec<f64> = values.iter().rev().map(|y| 3.0 - 2.0 * y).collect();
            let other = Interpolant::new(&mirrored, &backwards, kind).unwrap();
            let points: Vec<[f64; 3]> = at.iter().map(|t| other.at(unit * (end - t))).collect();
            let back = |k: usize, factor: f64, shift: f64| points.iter().map(|point| shift + factor * point[k]).collect::<Vec<f64>>();
            prop_assert!(distance(&back(0, -0.5, 1.5), &curve[0]) < 1e-9);
            prop_assert!(distance(&back(1, 0.5 * unit, 0.0), &curve[1]) < 1e-9);
        }
    }
}
