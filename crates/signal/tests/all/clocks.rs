//! Stamps and the time between channels.

use fleetfoot_signal::{ClockLine, Record, SignalError, WaveOptions, Within, align, align_edges, dejitter};

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

/// Stamps as computers make them. The jitter is a third of a period, delays only add, and one stamp in a hundred is
/// late by up to three periods. A missing sample and a long gap come with them. An earlier method counted every late
/// stamp as missing samples. Its period was off by a hundredth, and its jitter at hundreds of milliseconds.
#[test]
fn late_stamps_are_no_missing_samples() {
    let (rows, period) = (4000_u64, 0.01);
    let count = |row: u64| row + u64::from(row >= 1000) + 137 * u64::from(row >= 3000);
    type Late = fn(u64) -> f64;
    let late: [(&str, Late); 4] = [
        ("normal", |row| 0.3 * normal(31, row).clamp(-3.5, 3.5)),
        ("half normal", |row| 0.2 * normal(32, row).abs()),
        ("uniform", |row| 0.9 * uniform(33, row)),
        ("spikes", |row| 0.02 * normal(34, row) + if uniform(35, row) < 0.01 { 3.0 * uniform(36, row) } else { 0.0 }),
    ];
    for (name, late) in late {
        // A stamp is never before the one that was written before it.
        let mut last = f64::NEG_INFINITY;
        let stamp = |row: u64| {
            last = (last + 1e-6).max(period * (count(row) as f64 + late(row)));
            last
        };
        let times: Vec<f64> = (0..rows).map(stamp).collect();
        let even = dejitter(&times).unwrap();
        let counted: u64 = even.gaps.iter().map(|(_, missing)| missing).sum();
        assert_eq!(counted, 138, "{name}: {:?}", even.gaps);
        assert!((even.period / period - 1.0).abs() < 2e-5, "{name}: {}", even.period);
        // Instants are known but for the mean of the delays.
        let off: Vec<f64> = (0..rows).map(|row| even.times[row as usize] - period * count(row) as f64).collect();
        let mean = off.iter().sum::<f64>() / rows as f64;
        let wrong = off.iter().filter(|off| (*off - mean).abs() > 0.05 * period).count();
        assert!(wrong <= 20, "{name}: {wrong} instants are off");
    }
}

/// Two clocks that drift against each other leave residuals that go together.
#[test]
fn drift_correlates_the_residuals() {
    let times: Vec<f64> = (0..5000).map(|row| 0.01 * f64::from(row) + 1e-7 * f64::from(row).powf(1.5)).collect();
    assert!(dejitter(&times).unwrap().correlation > 0.9);
    assert!(matches!(dejitter(&[0.0, 1.0]), Err(SignalError::TooFew { .. })));
    assert!(matches!(dejitter(&[0.0, 1.0, 0.5]), Err(SignalError::Stamp { row: 2, .. })));
}

/// A lag of up to `reach` either way between clocks that run alike.
fn within(reach: f64) -> Within {
    Within { about: 0.0, reach, skew: 0.0 }
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
fn lags_below_a_period_are_estimated() {
    let lag = 0.1234;
    let mut inside = 0;
    for seed in 0..20 {
        let a = channel(4000, 0.01, 0.0, 1.0, 100 + 10 * seed);
        let b = channel(8000, 0.005, lag, -2.5, 500 + 10 * seed);
        let alignment =
            align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, within(0.5)).unwrap();
        assert!(!alignment.at_end && alignment.unexplained < 0.01 && alignment.deviation < 4e-4, "{alignment:?}");
        // Interpolation between jittered stamps costs less than the deviation.
        inside += usize::from((alignment.line.offset - lag).abs() < 2.0 * alignment.deviation + 2e-5);
        assert!(
            (alignment.line.offset - lag).abs() < 5.0 * alignment.deviation + 2e-5,
            "{} {}",
            alignment.line.offset,
            alignment.deviation
        );
    }
    assert!(inside >= 16, "{inside} of 20 within two deviations");
}

#[test]
fn curve_is_least_at_the_lag_and_ends_are_flagged() {
    let (a, b) = (channel(1000, 0.01, 0.0, 1.0, 1), channel(1000, 0.01, 0.3, 1.0, 7));
    let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
    let alignment = align(a, b, within(0.5)).unwrap();
    let least = alignment.curve.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    assert!(
        (least.0 - 0.3).abs() < 0.011 && (alignment.line.offset - 0.3).abs() < 2e-3,
        "{least:?} {}",
        alignment.line.offset
    );
    assert!(alignment.unexplained <= least.1);
    assert!(align(a, b, within(0.2)).unwrap().at_end);
    let backwards = align(b, a, within(0.5)).unwrap();
    assert!(
        (backwards.line.offset + alignment.line.offset).abs()
            < 3.0 * alignment.deviation.hypot(backwards.deviation) + 2e-5
    );
}

#[test]
fn records_that_cannot_be_aligned_are_refused() {
    let (times, values) = channel(1000, 0.01, 0.0, 1.0, 1);
    let good = Record { times: &times, values: &values };
    let still = vec![1.0; times.len()];
    let later: Vec<f64> = times.iter().map(|t| t + 100.0).collect();
    let refused = |other: Record<'_>| matches!(align(good, other, within(1.0)), Err(SignalError::NotAligned { .. }));
    assert!(refused(Record { times: &times, values: &still }));
    assert!(refused(Record { times: &later, values: &values }));
    let holes: Vec<f64> = values.iter().enumerate().map(|(row, y)| if row % 3 == 0 { f64::NAN } else { *y }).collect();
    assert!(align(good, Record { times: &times, values: &holes }, within(1.0)).unwrap().line.offset.abs() < 1e-3);
    assert!(refused(Record { times: &times[..100], values: &values[..100] }));
    assert!(align(good, good, within(0.0)).is_err());
    assert!(align(good, Record { times: &times, values: &values[1..] }, within(1.0)).is_err());
}

/// Channels of which hardly anything is common: the line stays within what was searched, where refining it had gone on to the few rows that were alike by accident.
#[test]
fn clock_line_stays_within_the_search_range() {
    let within = Within { about: 0.02, reach: 0.3, skew: 5e-4 };
    let times: Vec<f64> = (0..1500).map(|row| 0.01 * f64::from(row)).collect();
    for seed in 0..20 {
        let noise = |seed: u64| -> Vec<f64> { (0..1500).map(|row| normal(seed, row)).collect() };
        let (a, b) = (noise(900 + seed), noise(950 + seed));
        let alignment =
            align(Record { times: &times, values: &a }, Record { times: &times, values: &b }, within).unwrap();
        let off = (alignment.line.offset - within.about).abs();
        assert!(off <= within.reach && alignment.line.skew.abs() <= within.skew, "{:?}", alignment.line);
        assert!(alignment.at_end || off < within.reach, "{:?}", alignment.line);
    }
}

/// Channels that wander, and a reach of nearly their whole length: where only their ends overlap, a few rows go up or down together as if they were of one motion.
#[test]
fn few_alike_rows_do_not_decide_the_lag() {
    let (rows, late) = (600_usize, 25_usize);
    let times: Vec<f64> = (0..rows).map(|row| 0.01 * row as f64).collect();
    for seed in 0..10 {
        let walk = |seed: u64| -> Vec<f64> {
            let step = |sum: &mut f64, row| {
                *sum += normal(seed, row);
                Some(*sum)
            };
            (0..(rows + late) as u64).scan(0.0, step).collect()
        };
        let (common, [one, other]) = (walk(600 + seed), [700, 800].map(|offset| walk(offset + seed)));
        let a: Vec<f64> = (0..rows).map(|row| common[row + late] + 0.2 * one[row]).collect();
        let b: Vec<f64> = (0..rows).map(|row| common[row] + 0.2 * other[row]).collect();
        let alignment =
            align(Record { times: &times, values: &a }, Record { times: &times, values: &b }, within(4.7)).unwrap();
        assert!((alignment.line.offset - 0.25).abs() < 0.1, "{seed}: {:?}", alignment.line);
    }
}

/// A channel of a body that turns ever differently, `line` between its clock and true time.
fn wandering(rows: u64, period: f64, line: ClockLine, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let turn = |t: f64| (0.9 * t + 0.3 * (0.37 * t).sin()).sin() + 0.6 * (2.3 * t + 2.0 * (0.11 * t).cos()).cos();
    let instants: Vec<f64> = (0..rows).map(|row| period * (row as f64 + 0.2 * uniform(seed, row))).collect();
    let values = instants.iter().zip(0..).map(|(&t, row)| turn(t) + 0.05 * normal(seed + 1, row)).collect();
    (instants.iter().map(|&t| line.second(t)).collect(), values)
}

/// Offset and skew of clocks that are seconds and thousands of parts in a million apart, with no first guess: within their deviations, over six seeds.
#[test]
fn offset_and_skew_are_found_together() {
    let truth = ClockLine { at: 100.0, offset: -5.123, skew: 6e-3 };
    let (mut offsets, mut skews) = (0, 0);
    for seed in 0..6 {
        let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
        let a = wandering(10_000, 0.02, same, 1000 + 10 * seed);
        let b = wandering(6000, 1.0 / 30.0, truth, 5000 + 10 * seed);
        let search = Within { about: 0.0, reach: 8.0, skew: 8e-3 };
        let alignment =
            align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, search).unwrap();
        let offset = truth.second(alignment.line.at) - alignment.line.at;
        let errors = [(alignment.line.offset - offset).abs(), (alignment.line.skew - truth.skew).abs()];
        assert!(
            !alignment.at_end && alignment.deviation < 1.5e-3 && alignment.skew_deviation < 3e-5,
            "{:?}",
            alignment.line
        );
        assert!(
            errors[0] < 4.5 * alignment.deviation && errors[1] < 4.5 * alignment.skew_deviation,
            "{errors:?} {:?}",
            alignment.line
        );
        offsets += usize::from(errors[0] < 2.0 * alignment.deviation);
        skews += usize::from(errors[1] < 2.0 * alignment.skew_deviation);
        // A straight line holds: no quarter is off it.
        assert!(alignment.parts.iter().all(|part| part.off.abs() < 6.0 * part.deviation), "{:?}", alignment.parts);
    }
    assert!(offsets >= 4 && skews >= 4, "{offsets} and {skews} of 6 within two deviations");
}

/// A motion capture that sees another body now and then: one value of a hundred deviations, as each of the two rows about it has after differencing, weighs more than all of the motion. They are
/// left out, all of them and few others, and the line is where it is without them.
#[test]
fn gross_errors_do_not_move_the_line() {
    let truth = ClockLine { at: 60.0, offset: -0.165, skew: -35e-6 };
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let search = Within { about: 0.0, reach: 0.5, skew: 5e-4 };
    for seed in 0..3 {
        let (a, mut b) = (wandering(30_000, 0.004, same, 100 + seed), wandering(12_000, 0.01, truth, 200 + seed));
        let clean = align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, search).unwrap();
        let wrong: Vec<usize> = [977, 979, 4_100, 4_102, 8_888, 11_001].into_iter().collect();
        wrong.iter().for_each(|&row| b.1[row] = 150.0 + row as f64 * 1e-3);
        let alignment =
            align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, search).unwrap();
        assert!(wrong.iter().all(|row| alignment.left_out[1].contains(row)), "{:?}", alignment.left_out);
        assert!(
            alignment.left_out[0].len() < 30 && alignment.left_out[1].len() < 12 + wrong.len(),
            "{:?}",
            alignment.left_out
        );
        assert!(
            !alignment.at_end && (alignment.unexplained - clean.unexplained).abs() < 0.01,
            "{}",
            alignment.unexplained
        );
        // Six rows of twelve thousand: a small part of the deviation.
        assert!((alignment.line.offset - clean.line.offset).abs() < 0.5 * clean.deviation, "{:?}", alignment.line);
        let error = alignment.line.offset - (truth.second(alignment.line.at) - alignment.line.at);
        assert!(error.abs() < 4.5 * alignment.deviation, "{error} {}", alignment.deviation);
    }
}

/// A clock that does not run evenly is told by the quarters of the record.
#[test]
fn bent_clock_is_detected_by_quarters() {
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let (a, mut b) = (wandering(10_000, 0.02, same, 1), wandering(10_000, 0.02, same, 7));
    b.0.iter_mut().for_each(|t| *t += 0.05 * (*t / 100.0 - 1.0).powi(2));
    let search = Within { about: 0.0, reach: 1.0, skew: 5e-4 };
    let alignment = align(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, search).unwrap();
    let sizes: Vec<f64> = alignment.parts.iter().map(|part| part.off / part.deviation).collect();
    assert!(sizes[0] > 2.0 && sizes[1] < -5.0 && sizes[2] < -5.0 && sizes[3] > 2.0, "{:?}", alignment.parts);
}

#[test]
fn clock_line_has_an_inverse() {
    let line = ClockLine { at: 12.0, offset: 3.5, skew: 1e-3 };
    for t in [-5.0, 0.0, 12.0, 1e5] {
        assert!((line.first(line.second(t)) - t).abs() < 1e-10);
    }
    assert_eq!(line.second(12.0), 15.5);
}

const BARE: WaveOptions = WaveOptions { margin: 0.0, even: false };

/// A lamp that blinks with this period, half of which it is lit, seen every `step` seconds by a clock, whose stamps are `jitter` off at most.
fn blinks(seconds: f64, period: f64, step: f64, line: ClockLine, jitter: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    lamp(seconds, (period, 0.5), step, line, jitter, seed)
}

/// The same, lit for a share of its period.
fn lamp(
    seconds: f64,
    (period, share): (f64, f64),
    step: f64,
    line: ClockLine,
    jitter: f64,
    seed: u64,
) -> (Vec<f64>, Vec<f64>) {
    let first = step * uniform(seed, 0);
    let instants: Vec<f64> = (0..(seconds / step) as u64).map(|row| first + step * row as f64).collect();
    let lit = |t: &f64| f64::from(u8::from((t / period).rem_euclid(1.0) < share));
    let stamp = |(row, &t): (usize, &f64)| line.second(t) + jitter * (2.0 * uniform(seed + 1, row as u64) - 1.0);
    (instants.iter().enumerate().map(stamp).collect(), instants.iter().map(lit).collect())
}

/// The truth lies inside the interval in every seed, whether the wave's period is a multiple of the sampling or not; where it is none, the interval is well below a sample.
#[test]
fn edges_bracket_the_truth() {
    for (period, widest) in [(1.0, 0.0111), (0.977_37, 4e-3)] {
        for seed in 0..10 {
            let line = ClockLine { at: 0.0, offset: 0.3 - 0.06 * seed as f64, skew: 1e-5 * (seed as f64 - 5.0) };
            let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
            let a = blinks(120.0, period, 0.001, same, 0.0, 20 + seed);
            let b = blinks(120.0, period, 0.01, line, 0.0, 40 + seed);
            let search = Within { about: 0.0, reach: 0.45, skew: 5e-4 };
            let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
            let alignment = align_edges(a, b, search, BARE).unwrap();
            let offset = line.second(alignment.line.at) - alignment.line.at;
            let inside = |[low, high]: [f64; 2], truth: f64| low <= truth && truth <= high;
            assert!(
                inside(alignment.offset, offset) && inside(alignment.skew, line.skew),
                "{period} {seed} {alignment:?}"
            );
            assert!(
                inside(alignment.offset, alignment.line.offset) && inside(alignment.skew, alignment.line.skew),
                "{alignment:?}"
            );
            assert!(alignment.offset[1] - alignment.offset[0] < widest, "{period} {seed} {alignment:?}");
            assert!(
                alignment.contradiction == 0.0 && alignment.edges > 230 && alignment.others.is_empty(),
                "{alignment:?}"
            );
        }
    }
}

/// A wave that a timer switches, lit for any share of its period: the truth still lies inside, and the interval is a small part of that of edges which know nothing of one another.
#[test]
fn even_wave_edges_bound_each_other() {
    let (same, even) = (ClockLine { at: 0.0, offset: 0.0, skew: 0.0 }, WaveOptions { even: true, ..BARE });
    let mut errors = [0.0_f64; 2];
    for seed in 0..10 {
        let lit = 0.2 + 0.06 * seed as f64;
        let line = ClockLine { at: 0.0, offset: 0.2 - 0.04 * seed as f64, skew: 1e-5 * (seed as f64 - 5.0) };
        let a = lamp(120.0, (1.007_236, lit), 0.001, same, 0.0, 120 + seed);
        let b = lamp(120.0, (1.007_236, lit), 0.01, line, 0.0, 140 + seed);
        let search = Within { about: 0.0, reach: 0.45, skew: 5e-4 };
        let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
        let (bare, evened) = (align_edges(a, b, search, BARE).unwrap(), align_edges(a, b, search, even).unwrap());
        let offset = line.second(evened.line.at) - evened.line.at;
        let inside = |[low, high]: [f64; 2], truth: f64| low <= truth && truth <= high;
        assert!(inside(evened.offset, offset) && inside(evened.skew, line.skew), "{seed} {evened:?}");
        assert!(inside(bare.offset, evened.offset[0]) && inside(bare.offset, evened.offset[1]), "{bare:?} {evened:?}");
        for (sum, alignment) in errors.iter_mut().zip([&bare, &evened]) {
            *sum += (alignment.offset[1] - alignment.offset[0]).powi(2);
        }
    }
    let [bare, even] = errors.map(|sum| (sum / 10.0).sqrt());
    assert!(even < 0.5 * bare && even < 3e-4, "{even} of {bare}");
}

/// A wave that is switched by hand is not even. The alignment reports that and does not accept it as even.
#[test]
fn uneven_waves_are_refused() {
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let bent = |t: f64| t + 0.004 * (0.3 * t).sin();
    let seen = |step: f64, seed: u64| {
        let (times, _) = blinks(120.0, 1.007_236, step, same, 0.0, seed);
        let values =
            times.iter().map(|&t| f64::from(u8::from(bent(t).rem_euclid(1.007_236) < 0.5))).collect::<Vec<_>>();
        (times, values)
    };
    let (a, b) = (seen(0.001, 1), seen(0.002, 2));
    let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
    let search = Within { about: 0.0, reach: 0.3, skew: 5e-4 };
    assert!(align_edges(a, b, search, BARE).unwrap().offset[1].abs() < 2e-3);
    let even = WaveOptions { even: true, ..BARE };
    assert_eq!(align_edges(a, b, search, even), Err(SignalError::UnevenWave));
}

/// The ends of the interval are those of all vertices of the feasible set, which are found by brute force.
#[test]
fn interval_matches_all_vertices() {
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let line = ClockLine { at: 0.0, offset: 0.05, skew: 4e-5 };
    let (a, b) = (blinks(40.0, 0.773, 0.02, same, 0.0, 3), blinks(40.0, 0.773, 0.013, line, 0.0, 4));
    let search = Within { about: 0.0, reach: 0.3, skew: 0.05 };
    let alignment =
        align_edges(Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 }, search, BARE);
    let alignment = alignment.unwrap();
    let brackets = |(times, values): &(Vec<f64>, Vec<f64>)| -> Vec<[f64; 2]> {
        (1..times.len()).filter(|&row| values[row] != values[row - 1]).map(|row| [times[row - 1], times[row]]).collect()
    };
    // An upper bound (x, c, 1) says offset + x skew <= c, a lower one (x, c, -1) that it is no less.
    let (a, b) = (brackets(&a), brackets(&b));
    let pair = |first: &[f64; 2]| {
        let near = |second: &&[f64; 2]| (second[0] - first[0] - 0.05).abs() < 0.2;
        let second = b.iter().find(near)?;
        Some([(first[0], second[1] - first[0], 1.0), (first[1], second[0] - first[1], -1.0)])
    };
    let bounds: Vec<(f64, f64, f64)> = a.iter().filter_map(pair).flatten().collect();
    let at = alignment.line.at;
    let holds =
        |offset: f64, skew: f64| bounds.iter().all(|(x, c, sign)| sign * (offset + skew * (x - at) - c) < 1e-12);
    let (mut offsets, mut skews) = ([f64::INFINITY, f64::NEG_INFINITY], [f64::INFINITY, f64::NEG_INFINITY]);
    for (i, (x, c, _)) in bounds.iter().enumerate() {
        for (y, d, _) in &bounds[..i] {
            let skew = (c - d) / (x - y);
            let offset = c - skew * (x - at);
            if x != y && holds(offset, skew) {
                offsets = [offsets[0].min(offset), offsets[1].max(offset)];
                skews = [skews[0].min(skew), skews[1].max(skew)];
            }
        }
    }
    for end in 0..2 {
        assert!((alignment.offset[end] - offsets[end]).abs() < 1e-11, "{alignment:?} {offsets:?}");
        assert!((alignment.skew[end] - skews[end]).abs() < 1e-11, "{alignment:?} {skews:?}");
    }
}

/// Stamps that are wrong contradict each other: that is told, and a margin as large as their error holds the truth again.
#[test]
fn wrong_stamps_contradict_each_other() {
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let line = ClockLine { at: 0.0, offset: -0.2, skew: -2e-5 };
    let search = Within { about: 0.0, reach: 0.45, skew: 5e-4 };
    let mut contradictions = 0;
    for seed in 0..10 {
        let (a, b) = (
            blinks(120.0, 0.977_37, 0.001, same, 4e-4, 60 + seed),
            blinks(120.0, 0.977_37, 0.01, line, 4e-4, 80 + seed),
        );
        let (a, b) = (Record { times: &a.0, values: &a.1 }, Record { times: &b.0, values: &b.1 });
        let bare = align_edges(a, b, search, BARE).unwrap();
        contradictions += usize::from(bare.contradiction > 0.0);
        assert!(bare.contradiction < 1e-3, "{bare:?}");
        let alignment = align_edges(a, b, search, WaveOptions { margin: 4e-4, ..BARE }).unwrap();
        let offset = line.second(alignment.line.at) - alignment.line.at;
        assert!(
            alignment.contradiction == 0.0 && alignment.offset[0] <= offset && offset <= alignment.offset[1],
            "{alignment:?}"
        );
        assert!(alignment.skew[0] <= line.skew && line.skew <= alignment.skew[1], "{alignment:?}");
    }
    assert!(contradictions >= 6, "{contradictions} of 10 contradict each other");
}

#[test]
fn waves_that_cannot_be_aligned_are_refused() {
    let same = ClockLine { at: 0.0, offset: 0.0, skew: 0.0 };
    let search = Within { about: 0.0, reach: 0.45, skew: 5e-4 };
    let (times, values) = blinks(20.0, 1.0, 0.01, same, 0.0, 1);
    let wave = Record { times: &times, values: &values };
    let refused =
        |other: Record<'_>| matches!(align_edges(wave, other, search, BARE), Err(SignalError::NotAligned { .. }));
    assert!(refused(Record { times: &times, values: &vec![1.0; times.len()] }));
    assert!(refused(Record { times: &times, values: &vec![f64::NAN; times.len()] }));
    assert!(refused(Record { times: &times[..60], values: &values[..60] }), "one edge");
    assert!(refused(Record { times: &times[..1], values: &values[..1] }));
    let later: Vec<f64> = times.iter().map(|t| t + 100.0).collect();
    assert!(refused(Record { times: &later, values: &values }));
    let backwards: Vec<f64> = times.iter().rev().copied().collect();
    let other = Record { times: &backwards, values: &values };
    assert!(matches!(align_edges(wave, other, search, BARE), Err(SignalError::Stamp { .. })));
    // Two periods are within reach: the nearest counts, and the others are told.
    let far = align_edges(wave, wave, Within { reach: 2.2, ..search }, BARE).unwrap();
    assert!(far.line.offset.abs() < 0.01 && far.others.len() == 4, "{far:?}");
}
