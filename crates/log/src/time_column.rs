//! Which column is the clock, and in which unit.

use crate::{TimeUnit, selection::TimeSpec};

/// Base names of clocks, the most telling first; a unit suffix (`_ns`) or bracket (`[ms]`) may follow.
const NAMES: [&str; 16] = [
    "t",
    "time",
    "timestamp",
    "stamp",
    "header.stamp",
    "ts",
    "time_stamp",
    "datetime",
    "date_time",
    "utc",
    "epoch",
    "unix_time",
    "seconds",
    "secs",
    "sec",
    "date",
];

/// A column that might be the clock.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Its name.
    pub name: String,
    /// Its unit, when the file tells it.
    pub unit: Option<String>,
    /// What its cells look like.
    pub kind: CandidateKind,
    /// Its first values: numbers as they are, dates and times in seconds.
    pub sample: Vec<f64>,
}

/// What the cells of a candidate look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CandidateKind {
    /// Real numbers.
    Float,
    /// Whole numbers.
    Integer,
    /// Dates or a time type: the unit is known.
    Time,
    /// No clock.
    Other,
}

/// The chosen clock.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clock {
    /// The column's index among the candidates.
    pub column: usize,
    /// The unit of numbers.
    pub unit: TimeUnit,
    /// What was assumed and why, when something was.
    pub assumed: Option<String>,
}

/// The index of the named column or the guessed one; `None` when there is none (or the rows are equally spaced).
pub(crate) fn choose(candidates: &[Candidate], spec: &TimeSpec) -> Option<Clock> {
    match spec {
        TimeSpec::Uniform { .. } => None,
        TimeSpec::Column { name, unit } => {
            let column = candidates.iter().position(|candidate| candidate.name == *name)?;
            Some(with_unit(candidates, column, *unit, None))
        }
        TimeSpec::Dispensable { ordered: false } => {
            by_name(candidates).map(|column| with_unit(candidates, column, None, None))
        }
        TimeSpec::Auto | TimeSpec::Dispensable { ordered: true } => {
            if let Some(column) = by_name(candidates) {
                return Some(with_unit(candidates, column, None, None));
            }
            let column = candidates.iter().position(increases)?;
            let why = format!(
                "`{}` is taken as the time: it is the first column that always increases",
                candidates[column].name
            );
            Some(with_unit(candidates, column, None, Some(why)))
        }
    }
}

fn with_unit(candidates: &[Candidate], column: usize, unit: Option<TimeUnit>, why: Option<String>) -> Clock {
    let candidate = &candidates[column];
    let (unit, guess) = match unit {
        Some(unit) => (unit, None),
        None => guess_unit(candidate),
    };
    let assumed = match (why, guess) {
        (Some(why), Some(guess)) => Some(format!("{why}; {guess}")),
        (why, guess) => why.or(guess),
    };
    Clock { column, unit, assumed }
}

/// The unit of a candidate's numbers, and what was assumed when neither its name nor its unit says it.
fn guess_unit(candidate: &Candidate) -> (TimeUnit, Option<String>) {
    let told = candidate.unit.as_deref().and_then(TimeUnit::parse).or_else(|| suffix(&candidate.name).1);
    if let Some(unit) = told {
        return (unit, None);
    }
    let largest = candidate.sample.iter().copied().filter(|value| value.is_finite()).map(f64::abs).fold(0.0, f64::max);
    let by_size = match largest {
        1e17.. => Some(TimeUnit::Nanoseconds),
        1e14.. => Some(TimeUnit::Microseconds),
        1e11.. => Some(TimeUnit::Milliseconds),
        1e8.. => Some(TimeUnit::Seconds),
        _ => None,
    };
    let say = |unit: TimeUnit, why: &str| {
        (
            unit,
            Some(format!(
                "the whole numbers of `{}` are taken as {} ({why}); give the unit if that is wrong",
                candidate.name,
                unit.symbol()
            )),
        )
    };
    match (candidate.kind, by_size) {
        (CandidateKind::Time | CandidateKind::Other, _) => (TimeUnit::Nanoseconds, None),
        (CandidateKind::Float, None | Some(TimeUnit::Seconds)) => (TimeUnit::Seconds, None),
        (_, Some(unit)) => say(unit, "their size fits a date since 1970 in that unit"),
        (CandidateKind::Integer, None) => {
            let mut steps: Vec<f64> =
                candidate.sample.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > 0.0).collect();
            steps.sort_by(f64::total_cmp);
            // Robot logs run between about 1 Hz and 2 kHz.
            match steps.get(steps.len() / 2).copied().unwrap_or(0.0) {
                5e5.. => say(TimeUnit::Nanoseconds, "by their step"),
                5e2.. => say(TimeUnit::Microseconds, "by their step"),
                2.0.. => say(TimeUnit::Milliseconds, "by their step"),
                _ => say(TimeUnit::Seconds, "by their step"),
            }
        }
    }
}

fn by_name(candidates: &[Candidate]) -> Option<usize> {
    let ranked = candidates
        .iter()
        .enumerate()
        .filter(|(_, candidate)| candidate.kind != CandidateKind::Other)
        .filter_map(|(i, candidate)| {
            let (base, _) = suffix(&candidate.name);
            let rank =
                NAMES.iter().position(|name| *name == base).or_else(|| base.ends_with("header.stamp").then_some(4))?;
            Some((rank, i))
        });
    ranked.min().map(|(_, i)| i)
}

/// A name in lower case without its unit, and that unit: `Time_ns`, `t [ms]`, `t (s)`.
fn suffix(name: &str) -> (String, Option<TimeUnit>) {
    let lower = name.trim().to_lowercase();
    let (bare, bracket) = split_unit(&lower);
    let unit = bracket.and_then(TimeUnit::parse);
    if unit.is_some() {
        return (bare.to_owned(), unit);
    }
    if let Some((base, tail)) = bare.rsplit_once('_')
        && let Some(unit) = TimeUnit::parse(tail)
    {
        return (base.to_owned(), Some(unit));
    }
    // `sec` and `seconds` alone say it too.
    (bare.to_owned(), TimeUnit::parse(bare).filter(|_| bare.len() > 2))
}

/// A header such as `v [m/s]` or `v (m/s)`: the name without its unit, and the unit.
pub(crate) fn split_unit(header: &str) -> (&str, Option<&str>) {
    let header = header.trim();
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(inside) = header.strip_suffix(close)
            && let Some((name, unit)) = inside.rsplit_once(open)
        {
            let (name, unit) = (name.trim_end(), unit.trim());
            if !name.is_empty() && !unit.is_empty() && !unit.starts_with(|first: char| first.is_ascii_digit()) {
                return (name, Some(unit));
            }
        }
    }
    (header, None)
}

/// Whether the sample increases at every row and is not a mere row counter.
fn increases(candidate: &Candidate) -> bool {
    let sample = &candidate.sample;
    let rising = sample.len() >= 3 && sample.windows(2).all(|pair| pair[1] > pair[0]);
    match candidate.kind {
        CandidateKind::Other => false,
        CandidateKind::Integer => rising && sample.windows(2).any(|pair| pair[1] - pair[0] != 1.0),
        CandidateKind::Float | CandidateKind::Time => rising,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(name: &str, kind: CandidateKind, sample: &[f64]) -> Candidate {
        Candidate { name: name.into(), unit: None, kind, sample: sample.into() }
    }

    #[test]
    fn what_needs_no_clock_takes_one_by_its_name_or_for_the_order_of_rows() {
        use CandidateKind::Float;
        let rising = candidate("level", Float, &[1.0, 2.0, 4.0]);
        let named = candidate("t", Float, &[3.0, 1.0, 2.0]);
        let other = candidate("x", Float, &[3.0, 1.0, 2.0]);
        let taken = |candidates: &[Candidate], ordered: bool| {
            choose(candidates, &TimeSpec::Dispensable { ordered }).map(|clock| clock.column)
        };
        for ordered in [false, true] {
            assert_eq!(taken(&[other.clone(), rising.clone(), named.clone()], ordered), Some(2));
            assert_eq!(taken(std::slice::from_ref(&other), ordered), None);
        }
        assert_eq!(taken(&[other.clone(), rising.clone()], false), None, "a sorted column is no clock");
        assert_eq!(taken(&[other, rising], true), Some(1));
    }

    #[test]
    fn names_before_behaviour() {
        use CandidateKind::{Float, Integer, Other, Time};
        let rising = [1.0, 2.0, 4.0];
        let all =
            [candidate("x", Float, &rising), candidate("Time_ns", Integer, &rising), candidate("label", Other, &[])];
        let clock = choose(&all, &TimeSpec::Auto).unwrap();
        assert_eq!((clock.column, clock.unit, clock.assumed), (1, TimeUnit::Nanoseconds, None));
        let all = [
            candidate("count", Integer, &[0.0, 1.0, 2.0]),
            candidate("x", Float, &[0.0, 1.0, 0.5]),
            candidate("when", Time, &rising),
        ];
        let clock = choose(&all, &TimeSpec::Auto).unwrap();
        assert_eq!(clock.column, 2);
        assert!(clock.assumed.unwrap().contains("`when`"));
        assert_eq!(choose(&all[..2], &TimeSpec::Auto), None);
        assert_eq!(choose(&[candidate("/odom.header.stamp", Float, &[])], &TimeSpec::Auto).unwrap().column, 0);
        assert_eq!(choose(&[candidate("t (ms)", Float, &[])], &TimeSpec::Auto).unwrap().unit, TimeUnit::Milliseconds);
    }

    #[test]
    fn whole_numbers_are_placed_by_size_and_step() {
        let unit = |sample: &[f64]| choose(&[candidate("t", CandidateKind::Integer, sample)], &TimeSpec::Auto).unwrap();
        assert_eq!(unit(&[1.7e18]).unit, TimeUnit::Nanoseconds);
        assert_eq!(unit(&[1.7e15]).unit, TimeUnit::Microseconds);
        assert_eq!(unit(&[1.7e12]).unit, TimeUnit::Milliseconds);
        assert_eq!(unit(&[1.7e9]).unit, TimeUnit::Seconds);
        assert_eq!(unit(&[0.0, 1e6, 2e6]).unit, TimeUnit::Nanoseconds);
        assert_eq!(unit(&[0.0, 1e4, 2e4]).unit, TimeUnit::Microseconds);
        assert_eq!(unit(&[0.0, 10.0, 20.0]).unit, TimeUnit::Milliseconds);
        assert_eq!(unit(&[0.0, 1.0, 2.0]).unit, TimeUnit::Seconds);
        assert!(unit(&[0.0, 10.0]).assumed.is_some());
        let float = choose(&[candidate("t", CandidateKind::Float, &[0.0, 10.0])], &TimeSpec::Auto).unwrap();
        assert_eq!((float.unit, float.assumed), (TimeUnit::Seconds, None));
    }

    #[test]
    fn units_in_headers() {
        assert_eq!(split_unit("v [m/s]"), ("v", Some("m/s")));
        assert_eq!(split_unit("v (m/s)"), ("v", Some("m/s")));
        assert_eq!(split_unit("position[0]"), ("position[0]", None));
        assert_eq!(split_unit("[m]"), ("[m]", None));
        assert_eq!(split_unit("v"), ("v", None));
    }
}
