//! Names of clocks, and the units in names and headers.

use std::collections::HashMap;

use crate::TimeUnit;

/// Base names of clocks, the most telling first; a unit suffix (`_ns`) or bracket (`[ms]`) may follow.
const NAMES: [&str; 25] = [
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
    "elapsed",
    "elapsed_time",
    "uptime",
    "time_boot",
    "rosbagtimestamp",
    "zeit",
    "zeitstempel",
    "seconds",
    "secs",
    "sec",
    "date",
    "tick",
    "ticks",
];

/// Rank of a column's name among those of clocks, and the unit in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Named {
    /// Rank of the name among those of clocks, the best first; `None` where it is no name of a clock.
    pub rank: Option<usize>,
    /// The unit of time in the name.
    pub unit: Option<TimeUnit>,
}

/// Rank and unit of a clock from a column's name and its unit in the file: `Time_ns`, `t [ms]`, `TimeUS`, `Zeit [s]`.
///
/// A capital `T` alone is a temperature as often as a time, and `t [V]` is a voltage: neither names a clock.
pub(super) fn named(name: &str, unit: Option<&str>) -> Named {
    let (bare, bracket) = split_unit(name);
    let written = unit.or(bracket);
    let unit_given = written.and_then(TimeUnit::parse);
    if written.is_some() && unit_given.is_none() {
        return Named { rank: None, unit: None };
    }
    let lower = bare.to_lowercase();
    let (base, suffix) = split_suffix(&lower);
    let by_name = NAMES.iter().position(|known| *known == base).or_else(|| base.ends_with("header.stamp").then_some(4));
    let is_temperature = bare == "T" && unit_given.is_none();
    // A unit of time in brackets says it of any name.
    let rank = by_name.or(unit_given.map(|_| NAMES.len())).filter(|_| !is_temperature);
    Named { rank, unit: unit_given.or(suffix) }
}

/// A lower-case name without the unit at its end, and that unit.
fn split_suffix(lower: &str) -> (&str, Option<TimeUnit>) {
    if let Some((base, tail)) = lower.rsplit_once(['_', '-', ' '])
        && let Some(unit) = TimeUnit::parse(tail)
    {
        return (base, Some(unit));
    }
    // `timeus` of `TimeUS`: one letter alone says too little (`times`).
    let glued = NAMES.iter().find_map(|known| {
        let tail = lower.strip_prefix(known).filter(|tail| tail.len() > 1)?;
        Some((*known, TimeUnit::parse(tail)?))
    });
    if let Some((base, unit)) = glued {
        return (base, Some(unit));
    }
    // `sec` and `seconds` alone say it too.
    (lower, TimeUnit::parse(lower).filter(|_| lower.len() > 2))
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

/// The columns of stamps in two parts, whole seconds and the nanoseconds beyond: `stamp.sec` and `stamp.nanosec`. Takes columns with their names.
pub(super) fn seconds_and_nanoseconds(columns: &[(usize, &str)]) -> Vec<(usize, usize)> {
    const PARTS: [(&str, &[&str]); 3] =
        [("sec", &["nanosec", "nsec"]), ("secs", &["nsecs", "nanosecs"]), ("seconds", &["nanoseconds", "nanos"])];
    let lower: Vec<(usize, String)> = columns.iter().map(|&(column, name)| (column, name.to_lowercase())).collect();
    let mut pairs = Vec::new();
    for (whole, parts) in PARTS {
        let is_stem = |stem: &&str| stem.is_empty() || stem.ends_with(['.', '_', '/']);
        let mut stems: HashMap<&str, Vec<usize>> = HashMap::new();
        for (column, name) in &lower {
            if let Some(stem) = name.strip_suffix(whole).filter(is_stem) {
                stems.entry(stem).or_default().push(*column);
            }
        }
        for (column, name) in &lower {
            let stem = parts.iter().find_map(|part| stems.get(name.strip_suffix(part)?));
            pairs.extend(stem.into_iter().flatten().map(|&seconds| (seconds, *column)));
        }
    }
    pairs
}

/// Returns true if a column's name is that of the weeks of GPS.
pub(super) fn is_gps_week(name: &str) -> bool {
    const WEEKS: [&str; 8] = ["week", "gpsweek", "weeknumber", "gpsweeknumber", "weekno", "gwk", "wn", "wnc"];
    WEEKS.contains(&&*letters(split_unit(name).0))
}

/// `Some` if a column's name is that of the time of the week, with the unit that the name gives.
pub(super) fn time_of_week(name: &str) -> Option<Option<TimeUnit>> {
    const MILLISECONDS: [&str; 8] =
        ["gms", "itow", "towms", "gpsms", "weekms", "timeweekms", "msofweek", "gpsmilliseconds"];
    const SECONDS: [&str; 7] = ["sow", "gpssow", "tows", "secondsofweek", "weekseconds", "gpsseconds", "gpssec"];
    const OPEN: [&str; 5] = ["tow", "gpstow", "timeofweek", "gpstimeofweek", "weektime"];
    let (bare, unit) = split_unit(name);
    let letters = &*letters(bare);
    let by_name = match letters {
        _ if MILLISECONDS.contains(&letters) => Some(TimeUnit::Milliseconds),
        _ if SECONDS.contains(&letters) => Some(TimeUnit::Seconds),
        _ if OPEN.contains(&letters) => None,
        _ => return None,
    };
    Some(unit.and_then(TimeUnit::parse).or(by_name))
}

/// The last part of a name, in lower case and without what separates its words: `gps.time_week_ms` becomes
/// `timeweekms`.
fn letters(name: &str) -> String {
    let last = name.rsplit(['.', '/']).next().unwrap_or(name);
    last.chars().filter(|c| !matches!(c, '_' | '-' | ' ')).flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_in_headers() {
        assert_eq!(split_unit("v [m/s]"), ("v", Some("m/s")));
        assert_eq!(split_unit("v (m/s)"), ("v", Some("m/s")));
        assert_eq!(split_unit("position[0]"), ("position[0]", None));
        assert_eq!(split_unit("[m]"), ("[m]", None));
        assert_eq!(split_unit("v"), ("v", None));
    }

    #[test]
    fn names_tell_clocks_and_units() {
        use TimeUnit::{Microseconds, Milliseconds, Nanoseconds, Seconds};
        for (name, rank, unit) in [
            ("t", Some(0), None),
            ("Time_ns", Some(1), Some(Nanoseconds)),
            ("TimeUS", Some(1), Some(Microseconds)),
            ("timestampNs", Some(2), Some(Nanoseconds)),
            ("time_boot_ms", Some(15), Some(Milliseconds)),
            ("t [ms]", Some(0), Some(Milliseconds)),
            ("Zeit [ms]", Some(17), Some(Milliseconds)),
            ("Tid (s)", Some(NAMES.len()), Some(Seconds)),
            ("/odom.header.stamp", Some(4), None),
            ("seconds", Some(19), Some(Seconds)),
            ("T [s]", Some(0), Some(Seconds)),
            ("T", None, None),
            ("t [V]", None, None),
            ("T (\u{b0}C)", None, None),
            ("times", None, None),
            ("v_ms", None, Some(Milliseconds)),
            ("x", None, None),
        ] {
            assert_eq!(named(name, None), Named { rank, unit }, "{name}");
        }
        assert_eq!(named("t", Some("us")).unit, Some(Microseconds));
    }

    #[test]
    fn stamps_in_two_parts() {
        let are =
            |seconds: &str, nanoseconds: &str| seconds_and_nanoseconds(&[(3, seconds), (7, nanoseconds)]) == [(3, 7)];
        assert!(are("header.stamp.sec", "header.stamp.nanosec"));
        assert!(are("secs", "nsecs"));
        assert!(!are("a.sec", "b.nanosec") && !are("x", "y"));
        // Many columns, among them one stamp: no column is compared with all others.
        let names: Vec<String> = (0..40_000).map(|column| format!("joint{column}.x")).collect();
        let all = names.iter().map(String::as_str).chain(["stamp.Sec", "stamp.Nanosec"]);
        let all: Vec<(usize, &str)> = all.enumerate().collect();
        assert_eq!(seconds_and_nanoseconds(&all), [(40_000, 40_001)]);
    }
}
