//! The join against its definition, on random series.

use std::{path::Path, sync::Arc};

use fleetfoot_data::{Silent, with_threads};
use proptest::prelude::*;

use super::{
    joiner::{JoinReport, join_blocks},
    oracle::{self, Runs, Sample},
    *,
};
use crate::{Error, MaxGap, store::Budget};

/// Nanoseconds of a microsecond.
const MICRO: i64 = 1000;

fn build(name: &str, runs: &Runs, budget: usize) -> Series {
    let mut builder = SeriesBuilder::new(Path::new("x.mcap"), name, 5, 0, Arc::new(Budget::new(budget)));
    for sample in runs.iter().flatten() {
        builder.push(sample.stamp, sample.log_time, &sample.values).unwrap();
    }
    let series = builder.finish().unwrap();
    let lengths: Vec<usize> = series.runs.iter().map(|run| run.rows.len()).collect();
    assert_eq!(lengths, runs.iter().map(Vec::len).collect::<Vec<_>>());
    series
}

fn values() -> impl Strategy<Value = [f64; 5]> {
    let number = prop_oneof![9 => -10.0..10.0f64, 1 => Just(f64::NAN)];
    let component = || prop_oneof![12 => -1.0..1.0f64, 1 => Just(0.0)];
    let quaternion = prop_oneof![
        15 => (component(), component(), component(), component()).prop_map(|(x, y, z, w)| [x, y, z, w]),
        // Hardly a turn at all, and none at all.
        4 => (-1e-9..1e-9f64).prop_map(|x| [x, 0.0, 0.0, -1.0]),
        1 => Just([0.0; 4]),
    ];
    (number, quaternion).prop_map(|(n, [x, y, z, w])| [n, x, y, z, w])
}

/// Runs of at least three samples. Each begins before all of the run before it, and is recorded long after.
fn runs() -> impl Strategy<Value = Runs> {
    let step = prop_oneof![6 => 1..300i64, 1 => 1000..5000i64];
    // Whole microseconds at times, so that stamps of two series meet.
    let fine = prop_oneof![Just(0i64), 0..MICRO];
    let run = (1..5000i64, prop::collection::vec((step, fine, values()), 3..24));
    prop::collection::vec(prop::option::weighted(0.8, run), 1..4).prop_map(|drawn| {
        let mut runs = Vec::new();
        for (place, (start, steps)) in (1i64..).zip(drawn).filter_map(|(place, run)| Some((place, run?))) {
            let mut stamp = -place * 1_000_000 * MICRO + start * MICRO;
            let samples = steps.into_iter().map(|(step, fine, values)| {
                stamp = (stamp / MICRO + step) * MICRO + fine;
                Sample { stamp, log_time: stamp + place * 10_000_000 * MICRO, values }
            });
            runs.push(samples.collect());
        }
        runs
    })
}

fn gap() -> impl Strategy<Value = MaxGap> {
    prop_oneof![Just(MaxGap::Auto), (0.0..3e-3f64).prop_map(MaxGap::Seconds), Just(MaxGap::Unlimited)]
}

#[derive(Debug, Clone)]
struct Case {
    series: Vec<(Runs, [MaxGap; 4])>,
    base: Base,
    block_rows: usize,
}

fn case() -> impl Strategy<Value = Case> {
    let some = runs().prop_filter("a series has samples", |runs| !runs.is_empty());
    let series = prop::collection::vec((some, [gap(), gap(), gap(), gap()]), 1..4);
    (series, prop::option::of(0..3usize), 100..20_000u32, 2..40usize).prop_map(|(series, base, hz, block_rows)| {
        let base = base.map_or(Base::Rate(f64::from(hz)), |base| Base::Series(base % series.len()));
        Case { series, base, block_rows }
    })
}

const KINDS: [JoinKind; 4] = [JoinKind::Linear, JoinKind::Hold, JoinKind::Angle, JoinKind::Slerp];

/// For each series x by each kind, then the four components of the quaternion in a row.
fn columns(case: &Case) -> Vec<JoinColumn> {
    let mut columns = Vec::new();
    for (series, (_, gaps)) in case.series.iter().enumerate() {
        let of = |place: usize, quaternion, component| JoinColumn {
            series,
            column: 0,
            kind: KINDS[place],
            gap: gaps[place],
            quaternion,
            component,
        };
        columns.extend((0..3).map(|place| of(place, None, 0)));
        columns.extend((0..4).map(|component| of(3, Some([1, 2, 3, 4]), component)));
    }
    columns
}

type Table = (Vec<i64>, Vec<Vec<f64>>, JoinReport);

fn table(case: &Case, budget: usize, block_rows: usize, threads: usize) -> Result<Table, Error> {
    let names = ["/a", "/b", "/c"];
    let series: Vec<Series> =
        case.series.iter().zip(names).map(|((runs, _), name)| build(name, runs, budget)).collect();
    let wanted = columns(case);
    let (mut stamps, mut rows) = (Vec::new(), vec![Vec::new(); wanted.len()]);
    let report = with_threads(threads, || {
        join_blocks(&series, &wanted, case.base, block_rows, &Silent, |time, block| {
            assert!(!time.is_empty() && time.len() <= block_rows);
            stamps.extend_from_slice(time);
            rows.iter_mut().zip(block).for_each(|(all, part)| all.extend_from_slice(part));
            Ok(())
        })
    })?;
    Ok((stamps, rows, report))
}

fn bits(table: &Table) -> (Vec<i64>, Vec<Vec<u64>>, JoinReport) {
    let columns = table.1.iter().map(|column| column.iter().map(|value| value.to_bits()).collect()).collect();
    (table.0.clone(), columns, table.2.clone())
}

/// For each stretch of the base its stamps, and for each series and kind the run that belongs to it.
type Expected<'a> = Vec<(Vec<i64>, Vec<[Option<&'a Vec<Sample>>; 4]>)>;

/// `None` when some series has no moment in common with the base.
fn expected(case: &Case) -> Option<Expected<'_>> {
    let lead = match case.base {
        Base::Series(base) => base,
        Base::Rate(_) => {
            let most = case.series.iter().map(|(runs, _)| runs.len()).max()?;
            case.series.iter().position(|(runs, _)| runs.len() == most)?
        }
    };
    let latched = |gaps: &[MaxGap; 4], kind: usize| kind == 1 && gaps[1] == MaxGap::Unlimited;
    let base = &case.series[lead].0;
    let mut all: Expected = Vec::new();
    for run in base {
        let matched = case.series.iter().enumerate().map(|(place, (runs, gaps))| {
            std::array::from_fn(|kind| {
                let lead_run = (place == lead).then_some(run);
                lead_run.or_else(|| oracle::matching(runs, run, base.len(), latched(gaps, kind)))
            })
        });
        let matched: Vec<[Option<&Vec<Sample>>; 4]> = matched.collect();
        let stamps = match case.base {
            Base::Series(_) => run.iter().map(|sample| sample.stamp).collect(),
            Base::Rate(hz) => {
                let start = matched.iter().flatten().flatten().map(|run| run[0].stamp).max()?;
                let ends = matched.iter().zip(&case.series).flat_map(|(runs, (_, gaps))| {
                    runs.iter().enumerate().filter(|(kind, _)| !latched(gaps, *kind)).filter_map(|(_, run)| *run)
                });
                let end = ends.map(|run| run.last().unwrap().stamp).min()?;
                let (mut k, mut stamps) = (0, Vec::new());
                loop {
                    let stamp = start + (2 * k * 1_000_000_000 + hz as i64) / (2 * hz as i64);
                    if stamp > end {
                        break stamps;
                    }
                    stamps.push(stamp);
                    k += 1;
                }
            }
        };
        all.push((stamps, matched));
    }
    let meets = |place: usize, kind: usize| {
        all.iter().zip(base).any(|((_, matched), base_run)| {
            let Some(other) = matched[place][kind] else {
                return false;
            };
            let (first, last) = (other[0].stamp, other.last().unwrap().stamp);
            let ends = latched(&case.series[place].1, kind) || base_run[0].stamp <= last;
            ends && first <= base_run.last().unwrap().stamp
        })
    };
    let sound = match case.base {
        Base::Series(_) => (0..case.series.len()).all(|place| (0..4).all(|kind| meets(place, kind))),
        Base::Rate(_) => all.iter().any(|(stamps, _)| !stamps.is_empty()),
    };
    all.retain(|(stamps, _)| !stamps.is_empty());
    sound.then_some(all)
}

fn check(case: &Case, (stamps, columns, report): &Table, expected: &Expected) -> Result<(), TestCaseError> {
    let all: Vec<i64> = expected.iter().flat_map(|(stamps, _)| stamps.clone()).collect();
    prop_assert_eq!(stamps, &all);
    prop_assert_eq!(report.rows, all.len());
    for (missing, column) in report.missing.iter().zip(columns) {
        prop_assert_eq!(*missing, column.iter().filter(|value| value.is_nan()).count());
    }
    let mut row = 0;
    for ((expected_run, matched), run) in expected.iter().zip(&report.runs) {
        prop_assert_eq!(run.clone(), row..row + expected_run.len());
        for (place, (runs, gaps)) in case.series.iter().enumerate() {
            let mut last: Option<[f64; 4]> = None;
            for (&stamp, row) in expected_run.iter().zip(run.clone()) {
                for (place_of_kind, kind) in KINDS.into_iter().enumerate() {
                    let values_read: Vec<f64> = match kind {
                        JoinKind::Slerp => (3..7).map(|c| columns[7 * place + c][row]).collect(),
                        _ => vec![columns[7 * place + place_of_kind][row]],
                    };
                    let limit = oracle::limit(runs, gaps[place_of_kind]);
                    let from = matched[place][place_of_kind];
                    let wanted = from.and_then(|run| oracle::value(run, stamp, kind, limit));
                    compare(
                        kind,
                        &values_read,
                        wanted.as_deref(),
                        from.is_some_and(|run| oracle::ambiguous(run, stamp, kind)),
                    )?;
                    let exact = from.and_then(|run| run.iter().find(|sample| sample.stamp == stamp));
                    if let (Some(sample), true) = (exact, wanted.is_some()) {
                        check_exact(kind, &values_read, sample)?;
                    }
                    if kind == JoinKind::Slerp && wanted.is_some() {
                        let q = [values_read[0], values_read[1], values_read[2], values_read[3]];
                        let same_side = last.map_or(q[3], |last| last.iter().zip(q).map(|(a, b)| a * b).sum());
                        prop_assert!(same_side >= 0.0, "the sign jumps at row {}", row);
                        last = Some(q);
                    }
                }
            }
        }
        row = run.end;
    }
    Ok(())
}

fn compare(kind: JoinKind, values_read: &[f64], wanted: Option<&[f64]>, ambiguous: bool) -> Result<(), TestCaseError> {
    let Some(wanted) = wanted else {
        prop_assert!(
            values_read.iter().all(|value| value.is_nan()),
            "{:?} {:?} where there is no value",
            kind,
            values_read
        );
        return Ok(());
    };
    prop_assert!(values_read.iter().all(|value| value.is_finite()), "{:?} {:?} for {:?}", kind, values_read, wanted);
    if ambiguous {
        return Ok(());
    }
    let error = match kind {
        JoinKind::Linear | JoinKind::Hold => (values_read[0] - wanted[0]).abs(),
        JoinKind::Angle => {
            prop_assert!(values_read[0] > -std::f64::consts::PI && values_read[0] <= std::f64::consts::PI);
            ((values_read[0] - wanted[0]) / 2.0).sin().abs()
        }
        JoinKind::Slerp => {
            let turned = oracle::matrix(values_read).unwrap().concat();
            turned.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        }
    };
    prop_assert!(error < 1e-9, "{:?}: {:?} for {:?}", kind, values_read, wanted);
    Ok(())
}

/// At the stamp of a sample its bits come back: an angle's when it needs no wrapping, a quaternion's but for the sign.
fn check_exact(kind: JoinKind, values_read: &[f64], sample: &Sample) -> Result<(), TestCaseError> {
    let x = sample.values[0];
    match kind {
        JoinKind::Angle if x.abs() >= std::f64::consts::PI => {}
        JoinKind::Slerp => {
            let q = &sample.values[1..];
            let turned: Vec<f64> = q.iter().map(|c| -c).collect();
            prop_assert!(values_read == q || values_read == turned, "{:?} for {:?}", values_read, q);
        }
        _ => prop_assert_eq!(values_read[0].to_bits(), x.to_bits()),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn joined_rows_match_their_definition(case in case()) {
        let whole = table(&case, usize::MAX, 1 << 16, 1);
        match expected(&case) {
            None => prop_assert!(matches!(whole, Err(Error::NoOverlap { .. })), "{:?}", whole.map(|table| table.2)),
            Some(expected) => {
                let whole = whole.unwrap();
                check(&case, &whole, &expected)?;
                for (budget, block_rows, threads) in [(0, case.block_rows, 1), (0, 3, 2), (usize::MAX, case.block_rows, 7)] {
                    let split = table(&case, budget, block_rows, threads).unwrap();
                    prop_assert_eq!(bits(&split), bits(&whole));
                }
            }
        }
    }
}

/// A series of one column, with the log time a second after the stamp and `log_shift` more.
fn ramp(name: &str, stamps: impl Iterator<Item = i64>, log_shift: i64, value: impl Fn(i64) -> f64) -> Series {
    ramps(name, [(stamps.collect::<Vec<_>>(), log_shift)].as_slice(), value)
}

fn ramps(name: &str, runs: &[(Vec<i64>, i64)], value: impl Fn(i64) -> f64) -> Series {
    let mut builder = SeriesBuilder::new(Path::new("run.mcap"), name, 1, 0, Arc::new(Budget::new(0)));
    for (stamps, log_shift) in runs {
        for &stamp in stamps {
            builder.push(stamp, stamp + log_shift, &[value(stamp)]).unwrap();
        }
    }
    builder.finish().unwrap()
}

fn scalar(series: usize, kind: JoinKind, gap: MaxGap) -> JoinColumn {
    JoinColumn { series, column: 0, kind, gap, quaternion: None, component: 0 }
}

fn joined(series: &[Series], columns: &[JoinColumn], base: Base) -> Result<Table, Error> {
    let (mut stamps, mut rows) = (Vec::new(), vec![Vec::new(); columns.len()]);
    let report = join(series, columns, base, &Silent, |time, block| {
        stamps.extend_from_slice(time);
        rows.iter_mut().zip(block).for_each(|(all, part)| all.extend_from_slice(part));
        Ok(())
    })?;
    Ok((stamps, rows, report))
}

#[test]
fn restarted_simulation_joins_its_run() {
    // Both clocks run from 10 to 500 twice; the second time the values are others.
    let runs = |step: usize| -> Vec<i64> { (10..=500).step_by(step).collect() };
    let base = ramps("/odom", &[(runs(10), 0), (runs(10), 10_000)], |stamp| stamp as f64);
    let mut builder = SeriesBuilder::new(Path::new("run.mcap"), "/imu", 1, 0, Arc::new(Budget::new(0)));
    for (run, sign) in [(0, 1.0), (1, -1.0)] {
        for stamp in runs(7) {
            builder.push(stamp, stamp + run * 10_000, &[sign * stamp as f64]).unwrap();
        }
    }
    let series = [base, builder.finish().unwrap()];
    let columns = [scalar(1, JoinKind::Linear, MaxGap::Auto)];
    let (stamps, rows, report) = joined(&series, &columns, Base::Series(0)).unwrap();
    assert_eq!(report.runs, [0..50, 50..100]);
    for (row, (&stamp, &value)) in stamps.iter().zip(&rows[0]).enumerate() {
        let sign = if row < 50 { 1.0 } else { -1.0 };
        // The last sample of /imu is at 500.
        assert!((value - sign * stamp as f64).abs() < 1e-9, "{row} {value}");
    }
}

#[test]
fn a_latched_value_outlives_its_run() {
    let base = ramps("/odom", &[((100..200).collect(), 0), ((50..150).collect(), 1000)], |stamp| stamp as f64);
    let map = ramp("/map", std::iter::once(120), 0, |_| 7.0);
    let (_, rows, report) = joined(
        &[base, map],
        &[scalar(1, JoinKind::Hold, MaxGap::Unlimited), scalar(1, JoinKind::Hold, MaxGap::Auto)],
        Base::Series(0),
    )
    .unwrap();
    // From its stamp on in both runs; without a latch only at its stamp, as far as it was recorded.
    assert_eq!(rows[0].iter().filter(|value| **value == 7.0).count(), 80 + 30);
    assert_eq!(report.missing, [90, 199]);
}

#[test]
fn slow_rows_beside_a_fast_series_stream_through_all_segments() {
    let fast = ramp("/imu", (1..=300_000).map(|i| i * 1000), 0, |stamp| stamp as f64 * 0.5);
    let slow = ramp("/gps", (0..300).map(|i| 500 + i * 999_999), 0, |stamp| stamp as f64);
    let columns = [scalar(0, JoinKind::Linear, MaxGap::Auto), scalar(0, JoinKind::Hold, MaxGap::Auto)];
    let (stamps, rows, report) = joined(&[fast, slow], &columns, Base::Series(1)).unwrap();
    assert_eq!(report.missing, [1, 1]);
    for (row, &stamp) in stamps.iter().enumerate().skip(1) {
        assert!((rows[0][row] - stamp as f64 * 0.5).abs() < 1e-6);
        assert_eq!(rows[1][row], (stamp / 1000 * 1000) as f64 * 0.5);
    }
}

#[test]
fn clocks_without_overlap_are_refused_with_their_ranges() {
    let simulated = ramp("/odom", (1..100).map(|i| i * 500_000_000), 0, |_| 0.0);
    let epoch = 1_700_000_000_000_000_000;
    let measured = ramp("/imu", (0..100).map(|i| epoch + i * 500_000_000), -epoch, |_| 0.0);
    let columns = [scalar(0, JoinKind::Linear, MaxGap::Auto), scalar(1, JoinKind::Linear, MaxGap::Auto)];
    let series = [simulated, measured];
    let text = joined(&series, &columns, Base::Series(0)).unwrap_err().to_string();
    assert_eq!(
        text,
        "run.mcap: the stamps of /odom, 0.5 to 49.5 s, and of /imu, 1700000000 to 1700000049.5 s \
         (2023-11-14 22:13:20 to 2023-11-14 22:14:09 UTC), do not overlap: take the same clock for all \
         (stamp = \"log\", \"publish\" or \"header\"), another channel, or, for values that hold until the next message, max_gap = \"none\" in [join]"
    );
    assert!(matches!(joined(&series, &columns, Base::Rate(10.0)), Err(Error::NoOverlap { .. })));
}

#[test]
fn rates_that_make_no_sense_are_refused() {
    let series = [ramp("/odom", [1, 1 << 61].into_iter(), 0, |_| 0.0)];
    let columns = [scalar(0, JoinKind::Linear, MaxGap::Unlimited)];
    for hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e7] {
        assert!(matches!(joined(&series, &columns, Base::Rate(hz)), Err(Error::BadRate { .. })), "{hz}");
    }
    let text = joined(&series, &columns, Base::Rate(100.0)).unwrap_err().to_string();
    assert!(text.contains("230584300922 rows for at most 2 samples"), "{text}");
}

#[test]
fn error_of_the_receiver_ends_the_join() {
    let series = [ramp("/odom", 1..1000, 0, |_| 0.0)];
    let columns = [scalar(0, JoinKind::Linear, MaxGap::Auto)];
    let result = join(&series, &columns, Base::Series(0), &Silent, |_, _| Err(Error::NoFiles));
    assert!(matches!(result, Err(Error::NoFiles)));
    let empty = ramp("/none", std::iter::empty(), 0, |_| 0.0);
    assert_eq!(joined(&[empty], &columns, Base::Series(0)).unwrap().2.rows, 0);
}

#[test]
fn latched_value_holds_from_first_row() {
    let base = ramp("/odom", 1000..1010, 0, |stamp| stamp as f64);
    let transform = ramp("/tf_static", std::iter::once(3), 0, |_| 7.0);
    let series = [base, transform];
    let latched = [scalar(1, JoinKind::Hold, MaxGap::Unlimited), scalar(0, JoinKind::Linear, MaxGap::Auto)];
    let (_, rows, _) = joined(&series, &latched[..1], Base::Series(0)).unwrap();
    assert_eq!(rows[0], [7.0; 10]);
    // Nor does it end a grid, be it as old as it may.
    let (stamps, rows, _) = joined(&series, &latched, Base::Rate(1e6)).unwrap();
    assert_eq!((stamps, rows[0].clone()), (vec![1000], vec![7.0]));
    let unlatched = [scalar(1, JoinKind::Hold, MaxGap::Seconds(1.0))];
    assert!(matches!(joined(&series, &unlatched, Base::Series(0)), Err(Error::NoOverlap { .. })));
}

#[test]
fn a_gap_of_just_the_limit_is_bridged() {
    let base = ramp("/odom", 100..=230, 0, |stamp| stamp as f64);
    let other = ramp("/imu", [100, 150, 201].into_iter(), 0, |stamp| stamp as f64);
    let gap = MaxGap::Seconds(50e-9);
    let columns = [scalar(1, JoinKind::Linear, gap), scalar(1, JoinKind::Hold, gap)];
    let (stamps, rows, _) = joined(&[base, other], &columns, Base::Series(0)).unwrap();
    for (row, stamp) in stamps.into_iter().enumerate() {
        assert_eq!(rows[0][row].is_nan(), stamp > 150 && stamp != 201, "{stamp}");
        assert_eq!(rows[1][row].is_nan(), stamp > 201, "{stamp}");
    }
}

#[test]
fn first_of_equally_long_runs_counts() {
    // The base is recorded from 100 to 299 at a stretch, but its clock is set back once at the end: it has two runs.
    let base = ramps("/odom", &[((100..300).collect(), 0), ((10..20).collect(), 1000)], |stamp| stamp as f64);
    let other = ramps("/imu", &[((150..200).collect(), 0), ((100..150).collect(), 100)], |stamp| stamp as f64);
    let columns = [scalar(1, JoinKind::Linear, MaxGap::Auto)];
    let (stamps, rows, _) = joined(&[base, other], &columns, Base::Series(0)).unwrap();
    for (row, stamp) in stamps.into_iter().enumerate() {
        assert_eq!(rows[0][row].is_nan(), !(150..200).contains(&stamp), "{stamp}");
    }
}
