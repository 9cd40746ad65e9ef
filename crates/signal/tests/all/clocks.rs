//! Stamps and the time between channels.

use fleetfoot_signal::{Record, SignalError, align, dejitter};

use crate::common::{normal, uniform};

/// Jittered stamps of an even clock with a gap: the line finds the instants, the period within its deviation, and the gap.
#[test]
fn jitter_is_removed_and_gaps_are_kept() {
    let (rows, period, jitter) = (20_000_u64, 0.002, 2e-4);
    let count = |row: u64| if row < 9000 { row } else { row + 137 };
    let instant = |row: u64| 1.7e9 + period * count(row) as f64;
    let times: Vec<f64> = (0..rows).map(|row| instant(row) + jitter * normal(4, row).clamp(-4.0, 4.0)).collect();
    let even = dejitter(&times).unwrap();
    assert_eq!(even.gaps, [(9000, 137)]);
    assert!((even.period - period).abs() < 4.0 * even.period_deviation, "{}", even.period);
    assert!((even.jitter / jitter - 1.0).abs() < 0.02, "{}", even.jitter);
    assert!(even.correlation.abs() < 0.05, "{}", even.correlation);
    let worst = (0..rows).map(|row| (even.times[row as usize] - instant(row)).abs()).fold(0.0, f64::max);
    // Four deviations of a line through 20,000 rows at its ends, 2 jitter / sqrt(n) each, and the rounding of stamps of 1.7e9 s.
    assert!(worst < 4.0 * 2.0 * jitter / (rows as f64).sqrt() + 3e-7, "{worst:e}");
}

/// Two clocks that drift against each other leave residuals that go together.
#[test]
fn a_drift_is_told_by_its_correlation() {
    let times: Vec<f64> = (0..5000).map(|row| 0.01 * f64::from(row) + 1e-7 * f64::from(row).powf(1.5)).collect();
    assert!(dejitter(&times).unwrap().correlation > 0.9);
    assert!(matches!(dejitter(&[0.0, 1.0]), Err(SignalError::TooFew { .. })));
    assert!(matches!(dejitter(&[0.0, 1.0, 0.5]), Err(SignalError::Stamp { row: 2, .. })));
}

fn motion(t: f64) -> f64 {
    (1.3 * t).sin() + 0.7 * (3.1 * t + 0.4).cos() + 0.3 * (7.7 * t).sin()
}

/// A channel with its own rate, noise, gain and offset, `lag` seconds late.
fn channel(rows: u64, period: f64, lag: f64, gain: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..rows).map(|row| period * (row as f64 + 0.3 * uniform(seed, row))).collect();
    let value = |(t, row): (&f64, u64)| 4.0 + gain * motion(t - lag) + 0.02 * gain.abs() * normal(seed + 1, row);
    let values = times.iter().zip(0..).map(value).collect();
    (times, values)
}

/// The lag lies within its interval in nearly all of twenty runs, and is known to far less than a period.
#[test]
fn lags_are_found_below_a_period_with_honest_deviations() {
    let lag = 0.1234;
    let mut inside = 0;
    for seed in 0..20 {
        let a = channel(4000, 0.01, 0.0, 1.0, 100 + 10 * seed);
        let b = channel(8000, 0.005, lag, -2.5, 500 + 10 * seed);
        let found = align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, 0.5).unwrap();
        assert!(!found.at_end && found.unexplained < 0.01 && found.deviation < 4e-4, "{found:?}");
        // Interpolation between jittered stamps costs less than the deviation.
        inside += usize::from((found.lag - lag).abs() < 2.0 * found.deviation + 2e-5);
        assert!((found.lag - lag).abs() < 5.0 * found.deviation + 2e-5, "{} {}", found.lag, found.deviation);
    }
    assert!(inside >= 16, "{inside} of 20 within two deviations");
}

#[test]
fn the_curve_has_its_least_at_the_lag_and_an_end_is_told() {
    let (a, b) = (channel(1000, 0.01, 0.0, 1.0, 1), channel(1000, 0.01, 0.3, 1.0, 7));
    let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
    let found = align(a, b, 0.5).unwrap();
    let least = found.curve.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    assert!((least.0 - 0.3).abs() < 0.011 && (found.lag - 0.3).abs() < 2e-3, "{least:?} {}", found.lag);
    assert!(found.unexplained <= least.1);
    assert!(align(a, b, 0.2).unwrap().at_end);
    let backwards = align(b, a, 0.5).unwrap();
    assert!((backwards.lag + found.lag).abs() < 3.0 * found.deviation.hypot(backwards.deviation) + 2e-5);
}

#[test]
fn what_cannot_be_aligned_is_told() {
    let (times, values) = channel(1000, 0.01, 0.0, 1.0, 1);
    let good = Record { times: &times, values: &values };
    let still = vec![1.0; times.len()];
    let later: Vec<f64> = times.iter().map(|t| t + 100.0).collect();
    let refused = |other: Record<'_>| matches!(align(good, other, 1.0), Err(SignalError::NotAligned { .. }));
    assert!(refused(Record { times: &times, values: &still }));
    assert!(refused(Record { times: &later, values: &values }));
    let holes: Vec<f64> = values.iter().enumerate().map(|(row, y)| if row % 3 == 0 { f64::NAN } else { *y }).collect();
    assert!(align(good, Record { times: &times, values: &holes }, 1.0).unwrap().lag.abs() < 1e-3);
    assert!(refused(Record { times: &times[..100], values: &values[..100] }));
    assert!(align(good, good, 0.0).is_err());
    assert!(align(good, Record { times: &times, values: &values[1..] }, 1.0).is_err());
}
