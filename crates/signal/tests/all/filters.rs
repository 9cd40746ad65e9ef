//! Savitzky-Golay, Butterworth, Chebyshev, decimation.

use std::f64::consts::{PI, TAU};

use fleetfoot_signal::{Sections, SignalError, decimate, savitzky_golay};

use crate::common::{distance, normal};

/// The weights that Savitzky and Golay printed (Analytical Chemistry 36, 1964, tables I and IV).
#[test]
fn weights_are_the_published_ones() {
    let impulse: Vec<f64> = (0..31).map(|row| f64::from(row == 15)).collect();
    let check = |window, degree, derivative, weights: &[f64], norm: f64| {
        let filtered = savitzky_golay(&impulse, 1.0, window, degree, derivative).unwrap();
        let half = window / 2;
        let expected: Vec<f64> = weights.iter().rev().map(|weight| weight / norm).collect();
        assert!(distance(&filtered[15 - half..=15 + half], &expected) < 1e-14, "{window} {degree} {derivative}");
    };
    check(5, 2, 0, &[-3.0, 12.0, 17.0, 12.0, -3.0], 35.0);
    check(7, 2, 0, &[-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0], 21.0);
    check(5, 2, 1, &[-2.0, -1.0, 0.0, 1.0, 2.0], 10.0);
    check(7, 3, 1, &[22.0, -67.0, -58.0, 0.0, 58.0, 67.0, -22.0], 252.0);
}

/// A polynomial of the degree of the windows has its own derivatives everywhere, the edges among them.
#[test]
fn polynomials_have_their_derivatives_up_to_the_edges() {
    let dt = 0.1;
    let t = |row: usize| dt * row as f64;
    let cubic: Vec<f64> = (0..50).map(|row| 1.0 - t(row) + 0.5 * t(row).powi(3)).collect();
    let exact: [&dyn Fn(usize) -> f64; 3] =
        [&|row| 1.0 - t(row) + 0.5 * t(row).powi(3), &|row| -1.0 + 1.5 * t(row).powi(2), &|row| 3.0 * t(row)];
    for (derivative, exact) in exact.iter().enumerate() {
        let expected: Vec<f64> = (0..50).map(exact).collect();
        let filtered = savitzky_golay(&cubic, dt, 9, 3, derivative).unwrap();
        assert!(distance(&filtered, &expected) < 1e-12, "{derivative}");
    }
}

/// The gain of a sine in the middle of a long record, both ways run.
fn gain(filter: &Sections, frequency: f64) -> f64 {
    let sine: Vec<f64> = (0..20_000).map(|row| (TAU * frequency * f64::from(row)).cos()).collect();
    let filtered = filter.zero_phase(&sine).unwrap();
    let middle = 5_000..15_000;
    let dot = |a: &[f64], b: &[f64]| middle.clone().map(|row| a[row] * b[row]).sum::<f64>();
    dot(&filtered, &sine) / dot(&sine, &sine)
}

/// Squared gains in closed form: 1 / (1 + x^2n) and 1 / (1 + e^2 T_n(x)^2), x = tan(pi f) / tan(pi fc).
#[test]
fn gains_match_closed_form() {
    let x = |frequency: f64, cutoff: f64| (PI * frequency).tan() / (PI * cutoff).tan();
    for order in 1..=8 {
        let filter = Sections::butterworth(order, 0.05, 1.0).unwrap();
        for frequency in [0.01, 0.05, 0.08, 0.2] {
            let expected = 1.0 / (1.0 + x(frequency, 0.05).powi(2 * order as i32));
            let response = gain(&filter, frequency);
            assert!((response - expected).abs() < 1e-6, "{order} {frequency}: {response} {expected}");
        }
        let filter = Sections::chebyshev(order, 1.0, 0.05, 1.0).unwrap();
        let epsilon_squared = 10.0_f64.powf(0.1) - 1.0;
        for frequency in [0.01, 0.02, 0.05, 0.1_f64] {
            let x = x(frequency, 0.05);
            let n = order as f64;
            let polynomial = if x <= 1.0 { (n * x.acos()).cos() } else { (n * x.acosh()).cosh() };
            let expected = 1.0 / (1.0 + epsilon_squared * polynomial * polynomial);
            let response = gain(&filter, frequency);
            assert!((response - expected).abs() < 1e-5, "{order} {frequency}: {response} {expected}");
        }
    }
}

/// A straight line passes unchanged, its ends too: that is what the mirrored ends are for.
#[test]
fn a_straight_line_passes_butterworth() {
    let line: Vec<f64> = (0..100).map(|row| 3.0 - 0.1 * f64::from(row)).collect();
    for order in 1..=6 {
        let filtered = Sections::butterworth(order, 5.0, 100.0).unwrap().zero_phase(&line).unwrap();
        // The start at rest on the first value forgets itself within the padding, but for what a filter of this order still rings.
        assert!(distance(&filtered[40..60], &line[40..60]) < 1e-2, "{order}");
    }
}

/// Frequencies above the new Nyquist frequency are gone; those well below it stay.
#[test]
fn decimation_keeps_frequencies_below_nyquist() {
    let mixed = |row: u32| (TAU * 0.005 * f64::from(row)).sin() + (TAU * 0.24 * f64::from(row)).sin();
    let values: Vec<f64> = (0..5000).map(mixed).collect();
    let kept = decimate(&values, 10).unwrap();
    assert_eq!(kept.len(), 500);
    let expected: Vec<f64> = (0..500).map(|row| (TAU * 0.05 * f64::from(row)).sin()).collect();
    // Ripples of 0.05 dB both ways are 1.2 %; the stop band is 1e-4.
    assert!(distance(&kept[50..450], &expected[50..450]) < 0.015);
    assert_eq!(decimate(&values, 1).unwrap(), values);
}

#[test]
fn signals_that_cannot_be_filtered_are_refused() {
    let values: Vec<f64> = (0..20).map(|row| normal(1, row)).collect();
    let parameter = |result: Result<Vec<f64>, SignalError>| matches!(result, Err(SignalError::Parameter { .. }));
    assert!(parameter(savitzky_golay(&values, 1.0, 4, 2, 0)) && parameter(savitzky_golay(&values, 1.0, 5, 5, 0)));
    assert!(parameter(savitzky_golay(&values, 1.0, 5, 2, 3)) && parameter(savitzky_golay(&values, 0.0, 5, 2, 0)));
    let short = savitzky_golay(&values, 1.0, 21, 2, 0);
    assert_eq!(short, Err(SignalError::TooShort { what: "the window", rows: 20, needed: 20 }));
    assert!(parameter(decimate(&values, 0)));
    assert!(Sections::butterworth(0, 1.0, 10.0).is_err() && Sections::butterworth(2, 5.0, 10.0).is_err());
    let filter = Sections::butterworth(6, 1.0, 10.0).unwrap();
    assert_eq!(filter.zero_phase(&values), Err(SignalError::TooShort { what: "the filter", rows: 20, needed: 21 }));
    let holes = [vec![1.0; 30], vec![f64::NAN]].concat();
    assert!(matches!(filter.zero_phase(&holes), Err(SignalError::NotFinite { row: 30, .. })));
}
