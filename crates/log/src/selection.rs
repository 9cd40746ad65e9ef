//! Selection from a recording: columns, clock, episodes, labels.

use std::collections::BTreeMap;

use crate::{JoinSpec, MaxGap};

/// Selection of the data to read, and rules for episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// The columns, by their names in the files; only these are decoded. A name given twice counts once.
    pub columns: Vec<String>,
    /// Source of the stamps.
    pub time: TimeSpec,
    /// The gap that ends an episode.
    pub max_gap: MaxGap,
    /// Labels for the episodes of the files whose name matches.
    pub label_rules: Vec<LabelRule>,
    /// Accept the same data twice (a fit would count it twice).
    pub allow_duplicates: bool,
    /// Bytes of decoded columns that are kept in memory, over all files; beyond it they go to an unnamed temporary file.
    pub memory_budget: usize,
    /// Rules that join the channels of a robot's log into one table.
    pub join: JoinSpec,
}

impl Selection {
    /// These columns, with the time column and the episodes found by themselves.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = S>) -> Self {
        Self { columns: columns.into_iter().map(Into::into).collect(), ..Self::default() }
    }
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            columns: Vec::new(),
            time: TimeSpec::Auto,
            max_gap: MaxGap::Auto,
            label_rules: Vec::new(),
            allow_duplicates: false,
            memory_budget: 256 << 20,
            join: JoinSpec::default(),
        }
    }
}

/// Source of the stamps.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum TimeSpec {
    /// By the name of a column, else the first column of strictly increasing times; the notes name the column.
    #[default]
    Auto,
    /// This column.
    Column {
        /// Its name.
        name: String,
        /// The unit of numbers; guessed from the name and the magnitude when not given. Dates and time types carry their own.
        unit: Option<TimeUnit>,
    },
    /// By the name of a column. If a file has no such column, no stamps are known: every file is one episode of rows in
    /// their order, nominally a second apart. For uses that need no clock.
    Dispensable {
        /// True if the order of the rows matters: then a column of strictly increasing times is taken as by
        /// [`TimeSpec::Auto`], if there is one.
        ordered: bool,
    },
    /// Rows are equally spaced; every file is one episode that starts at zero.
    Uniform {
        /// The sampling period, seconds.
        dt_seconds: f64,
    },
}

/// The unit of numeric stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TimeUnit {
    /// s
    Seconds,
    /// ms
    Milliseconds,
    /// us
    Microseconds,
    /// ns
    Nanoseconds,
}

impl TimeUnit {
    /// The power of ten of nanoseconds in one unit.
    pub(crate) fn exponent(self) -> i32 {
        match self {
            Self::Seconds => 9,
            Self::Milliseconds => 6,
            Self::Microseconds => 3,
            Self::Nanoseconds => 0,
        }
    }

    /// Nanoseconds in one unit.
    pub fn nanoseconds(self) -> i64 {
        10i64.pow(self.exponent().unsigned_abs())
    }

    /// Seconds in one unit.
    pub(crate) fn seconds(self) -> f64 {
        self.nanoseconds() as f64 / 1e9
    }

    /// `s`, `ms`, `us`, `ns`.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
        }
    }

    /// Reads `s`, `sec`, `seconds`, `ms`, `us`, `µs`, `ns`, ...
    pub fn parse(text: &str) -> Option<Self> {
        match text.trim().to_lowercase().as_str() {
            "s" | "sec" | "secs" | "second" | "seconds" => Some(Self::Seconds),
            "ms" | "msec" | "msecs" | "millis" | "millisecond" | "milliseconds" => Some(Self::Milliseconds),
            "us" | "\u{b5}s" | "\u{3bc}s" | "usec" | "usecs" | "micros" | "microsecond" | "microseconds" => {
                Some(Self::Microseconds)
            }
            "ns" | "nsec" | "nsecs" | "nanos" | "nanosecond" | "nanoseconds" => Some(Self::Nanoseconds),
            _ => None,
        }
    }
}

/// Labels for the episodes of matching files.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelRule {
    /// A glob over the file's name or its path, e.g. `grass_*`; the extension may be left out. An episode `file.csv#2` can be named alone.
    pub pattern: String,
    /// The labels, by key. A later rule overrides an earlier one.
    pub labels: BTreeMap<String, String>,
}
