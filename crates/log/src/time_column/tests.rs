use super::*;
use CandidateKind::{Float, Integer, Other, Time};

type Given<'a> = (&'a str, CandidateKind, &'a [f64]);

fn chosen(given: &[Given<'_>], spec: &TimeSpec) -> Option<Clock> {
    let candidates: Vec<Candidate> =
        given.iter().map(|(name, kind, _)| Candidate { name: (*name).into(), unit: None, kind: *kind }).collect();
    choose(&candidates, &|column| given[column].2.to_vec(), spec)
}

fn column(given: &[Given<'_>]) -> Option<usize> {
    chosen(given, &TimeSpec::Auto).map(|clock| clock.column)
}

const RISING: [f64; 4] = [1.0, 2.5, 4.0, 5.5];
const FALLING: [f64; 4] = [3.0, 1.0, 2.0, 0.0];

#[test]
fn optional_clock_follows_name_or_order() {
    let rising = ("level", Float, &RISING[..]);
    let named = ("t", Float, &RISING[..]);
    let other = ("x", Float, &FALLING[..]);
    let taken = |given: &[Given<'_>], ordered: bool| {
        chosen(given, &TimeSpec::Dispensable { ordered }).map(|clock| clock.column)
    };
    for ordered in [false, true] {
        assert_eq!(taken(&[other, rising, named], ordered), Some(2));
        assert_eq!(taken(&[other], ordered), None);
    }
    assert_eq!(taken(&[other, rising], false), None, "a sorted column is no clock");
    assert_eq!(taken(&[other, rising], true), Some(1));
}

#[test]
fn a_name_goes_before_values() {
    let clock = chosen(&[("x", Float, &RISING), ("Time_ns", Integer, &RISING), ("label", Other, &[])], &TimeSpec::Auto);
    let clock = clock.unwrap();
    assert_eq!((clock.column, clock.unit, clock.chosen), (1, ClockUnit::Given(TimeUnit::Nanoseconds), Chosen::Name));
    let all = [("count", Integer, &[0.0, 1.0, 2.0][..]), ("x", Float, &FALLING), ("when", Time, &RISING)];
    let clock = chosen(&all, &TimeSpec::Auto).unwrap();
    assert_eq!((clock.column, clock.chosen), (2, Chosen::Values));
    assert_eq!(column(&all[..2]), None);
    assert_eq!(column(&[("/odom.header.stamp", Float, &[])]), Some(0));
}

#[test]
fn dates_need_no_unit_and_go_before_numbers() {
    let level = ("dist", Float, &RISING[..]);
    let in_utc = |stamps: &[f64]| {
        let given = [("Time (UTC)", Time, stamps), level];
        let candidates: Vec<Candidate> = given
            .iter()
            .map(|(name, kind, _)| {
                let unit = split_unit(name).1.map(str::to_owned);
                Candidate { name: (*name).into(), unit, kind: *kind }
            })
            .collect();
        choose(&candidates, &|column| given[column].2.to_vec(), &TimeSpec::Auto)
    };
    // Two rows a second, whole seconds.
    let clock = in_utc(&[1.7e9, 1.7e9 + 1.0, 1.7e9 + 1.0, 1.7e9 + 2.0, 1.7e9 + 2.0]).unwrap();
    assert_eq!((clock.column, clock.chosen), (0, Chosen::Name));
    // Fewer steps than half rise: no clock, but no reason to take the distance either.
    assert_eq!(in_utc(&[1.7e9, 1.7e9, 1.7e9 + 1.0, 1.7e9 + 1.0]), None);
    assert_eq!(column(&[("when", Time, &[5.0, 5.0, 5.0, 6.0, 6.0]), level]), None);
    assert_eq!(column(&[("day", Time, &[5.0; 5]), level]), Some(1));
    // A duration whose name its unit makes a clock.
    let tid = Candidate { name: "Tid".into(), unit: Some("s".into()), kind: Time };
    assert_eq!(choose(&[tid], &|_| RISING.to_vec(), &TimeSpec::Auto).unwrap().chosen, Chosen::Name);
}

#[test]
fn ambiguous_columns_are_no_clock() {
    // A temperature, by its capital letter or by its values.
    assert_eq!(column(&[("T", Float, &[20.0, 21.5, 21.0, 22.0])]), None);
    assert_eq!(column(&[("T", Float, &[20.0, 23.0, 24.0, 24.2]), ("u", Float, &FALLING)]), None, "uneven");
    assert_eq!(column(&[("t", Float, &[20.0, 21.5, 21.0, 22.0, 21.0])]), None);
    // A position that rises unevenly, and two columns of which neither is named.
    assert_eq!(column(&[("x", Float, &[0.0, 0.5, 1.4, 2.9, 4.0]), ("y", Float, &FALLING)]), None);
    assert_eq!(column(&[("a", Float, &RISING), ("b", Float, &RISING)]), None);
    assert_eq!(column(&[("a", Float, &RISING), ("b", Float, &FALLING)]), Some(0));
    // Sessions one after another, and a row that came twice.
    let sessions: Vec<f64> = (0..30).map(|row| f64::from(row % 10)).chain([9.0]).collect();
    assert_eq!(column(&[("x", Float, &FALLING), ("time", Float, &sessions)]), Some(1));
    // The date of every row alone is no clock, nor is the whole second of a stamp in two columns.
    let (date, of_day) = ([1.728e8; 4], [43_200.0, 43_200.5, 43_201.0, 43_201.5]);
    assert_eq!(column(&[("Date", Time, &date)]), None);
    let both = chosen(&[("Date", Time, &date), ("Time", Time, &of_day)], &TimeSpec::Auto).unwrap();
    assert_eq!((both.column, both.beside), (0, Some((1, TimeUnit::Nanoseconds))));
    let parts: [Given<'_>; 2] =
        [("stamp.sec", Integer, &[5.0, 5.0, 6.0]), ("stamp.nanosec", Integer, &[0.0, 5e8, 0.0])];
    let both = chosen(&parts, &TimeSpec::Auto).unwrap();
    assert_eq!(
        (both.column, both.beside, both.given_unit()),
        (0, Some((1, TimeUnit::Nanoseconds)), Some(TimeUnit::Seconds))
    );
    // A column of its own goes before.
    assert_eq!(column(&[("Date", Time, &date), ("Time", Time, &of_day), ("t", Float, &RISING)]), Some(2));
}

#[test]
fn refusals_tell_what_named_clocks_do() {
    let refusal = |given: &[Given<'_>]| {
        let candidates: Vec<Candidate> =
            given.iter().map(|(name, kind, _)| Candidate { name: (*name).into(), unit: None, kind: *kind }).collect();
        let sampler = |column: usize| given[column].2.to_vec();
        assert_eq!(choose(&candidates, &sampler, &TimeSpec::Auto), None);
        no_clock(Path::new("a.csv"), &candidates, &sampler).to_string()
    };
    let x = ("x", Float, &FALLING[..]);
    let head = "a.csv: no time column found among `x`, `t`";
    let end = ". Name the clock (--time; [time] column in a recipe), or give the sampling period (--dt)";
    for (kind, sample, problem) in [
        (Float, &[3.0, 2.0, 1.0][..], "falls in 2 of its first 2 steps, rises in 0"),
        (Integer, &[5.0, 5.0, 5.0], "has the same value in its first 3 stamps"),
        (Float, &[1.0, 1.0, 1.0, 2.0], "rises in only 1 of its first 3 steps"),
        (Other, &[], "holds text: look for decimal commas, and words among numbers"),
    ] {
        assert_eq!(refusal(&[x, ("t", kind, sample)]), format!("{head}; `t` {problem}{end}"));
    }
    assert_eq!(refusal(&[x]), format!("a.csv: no time column found among `x`{end}"));
}

/// The units that a clock of these numbers leaves.
fn left(kind: CandidateKind, sample: &[f64]) -> Vec<TimeUnit> {
    let clock = chosen(&[("t", kind, sample)], &TimeSpec::Auto).unwrap();
    clock.readings().iter().map(|reading| reading.unit).collect()
}

fn every(step: f64) -> Vec<f64> {
    (0..20).map(|row| f64::from(row) * step).collect()
}

#[test]
fn size_and_step_leave_units() {
    use TimeUnit::{Microseconds as Us, Milliseconds as Ms, Nanoseconds as Ns, Seconds as S};
    for (sample, units) in [
        (vec![1.7e18], vec![Ns]),
        (vec![1.7e15], vec![Us]),
        (vec![1.7e12, 1.7e12 + 10.0], vec![Ms]),
        (vec![1.7e9, 1.7e9 + 1.0], vec![S]),
        // 28 minutes since a start.
        (vec![1.7e9, 1.7e9 + 1e4, 1.7e9 + 2e4], vec![Us]),
        // A simulation of 26 hours.
        (vec![9.4e13, 9.4e13 + 1e8], vec![Ns]),
        (every(1e7), vec![Ns]),
        (every(1e4), vec![Us]),
        (every(10.0), vec![Ms]),
        (every(1.0), vec![S, Ms]),
        (every(1000.0), vec![Ms, Us]),
        (every(1e6), vec![Us, Ns]),
        (every(4000.0), vec![Ms, Us]),
        // A row a minute.
        (every(60.0), vec![S, Ms]),
        (vec![2e7], vec![Ms, Us, Ns]),
    ] {
        assert_eq!(left(Integer, &sample), units, "{sample:?}");
    }
    for (sample, units) in [
        (every(0.01), vec![S]),
        (every(1e-5), vec![S]),
        (every(1.003), vec![S]),
        (every(4.1667), vec![S, Ms]),
        (every(10.0), vec![Ms]),
        (vec![1.7e9, 1.7e9 + 0.25], vec![S]),
        (vec![1.7e12, 1.7e12 + 0.25], vec![Ms]),
        (Vec::new(), vec![S]),
        (vec![f64::NAN; 3], vec![S, Ms, Us, Ns]),
    ] {
        assert_eq!(left(Float, &sample), units, "{sample:?}");
    }
}

#[test]
fn ambiguous_unit_error_shows_both_readings() {
    let settle = |sample: &[f64], selection: &Selection, agreed: &Agreed| {
        chosen(&[("t", Integer, sample)], &selection.time).unwrap().settle(Path::new("a.csv"), agreed, selection)
    };
    let auto = Selection::default();
    let message = settle(&every(1000.0), &auto, &Agreed::default()).unwrap_err().to_string();
    for part in ["a.csv", "`t`", "ms (1 Hz, from 0 s on)", "us (1000 Hz, from 0 s on)", "--time t --time-unit us"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let agreed = Agreed { units: [("t".to_owned(), TimeUnit::Milliseconds)].into(), ..Agreed::default() };
    let clock = settle(&every(1000.0), &auto, &agreed).unwrap();
    assert_eq!(clock.unit, TimeUnit::Milliseconds);
    assert!(clock.assumed.unwrap().contains("all files"));
    let clock = settle(&every(10.0), &auto, &Agreed::default()).unwrap();
    // Seconds are possible too, at a rate that is unusual.
    let note = clock.assumed.unwrap();
    assert!(note.contains("taken as ms: 100 rows a second; in s it would be one row in 10 s: name the unit"), "{note}");
    assert!(note.contains("--time t --time-unit s"), "{note}");
    let sizes = [vec![1.7e12, 1.7e12 + 10.0], every(1e7).iter().map(|stamp| stamp + 9.4e13).collect()];
    for (sample, unit) in sizes.iter().zip(["ms", "ns"]) {
        let note = settle(sample, &auto, &Agreed::default()).unwrap().assumed.unwrap();
        assert!(note.contains(&format!("taken as {unit}: no other unit fits; name the unit")), "{note}");
    }
    let empty = settle(&[f64::NAN; 3], &auto, &Agreed::default()).unwrap_err().to_string();
    assert!(empty.contains("`t` has no values in the first rows: name another time column (--time)"), "{empty}");
    // If only the order of the rows counts, the unit does not.
    let ordered = Selection { time: TimeSpec::Dispensable { ordered: true }, ..Selection::default() };
    assert!(settle(&every(1.0), &ordered, &Agreed::default()).unwrap().assumed.unwrap().contains("order"));
    // Seconds with decimals need no words.
    let clock = chosen(&[("t", Float, &every(0.01))], &TimeSpec::Auto).unwrap();
    let clock = clock.settle(Path::new("a.csv"), &Agreed::default(), &auto).unwrap();
    assert_eq!((clock.unit, clock.assumed), (TimeUnit::Seconds, None));
    // At 1 Hz they could be 1 kHz in milliseconds.
    let noted = |step: f64, start: f64| {
        let sample: Vec<f64> = every(step).iter().map(|value| start + value).collect();
        let clock = chosen(&[("t", Float, &sample)], &TimeSpec::Auto).unwrap();
        let clock = clock.settle(Path::new("a.csv"), &Agreed::default(), &auto).unwrap();
        assert_eq!(clock.unit, TimeUnit::Seconds);
        clock.assumed
    };
    for step in [1.003, 0.2, 0.125, 1.9] {
        let note = noted(step, 0.0).unwrap();
        assert!(
            note.contains("taken as s") && note.contains("could be ms") && note.contains("name the unit"),
            "{note}"
        );
    }
    assert_eq!((noted(0.1, 0.0), noted(0.02, 0.0), noted(1.003, 1.7e9)), (None, None, None));
}
