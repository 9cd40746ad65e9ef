//! Rules that join the channels of a robot's log into one table.

use std::{collections::BTreeMap, path::PathBuf};

use crate::{MaxGap, join::JoinKind};

/// Rules that join the channels of a robot's log into one table of rows: the clock, the rows, and the values between
/// two samples.
///
/// Tables (CSV, Parquet) are one channel already; for them only a rate and the joins of columns count, by which rows are made anew.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinSpec {
    /// The one clock of all channels; found when not given: the headers' where every channel has one, else the log's.
    pub stamp: Option<Stamp>,
    /// Source of the rows; the channel of the first column when not given.
    pub base: Option<Base>,
    /// Join of single columns, by their names; by their types when not given.
    pub columns: BTreeMap<String, ColumnJoin>,
    /// Samples whose stamps are out of order by less than these seconds are put in order; a larger step back begins an
    /// episode.
    pub reorder_seconds: f64,
    /// Topics as the columns call them, and as the files do.
    pub renames: Vec<(String, String)>,
    /// A folder for decoded columns as Parquet, so that the next command need not decode again.
    pub cache: Option<Cache>,
    /// Topics that another clock stamps, whose stamps become those of the others before anything is joined; where several name a topic, each counts.
    pub clocks: Vec<TopicClock>,
}

impl Default for JoinSpec {
    fn default() -> Self {
        Self {
            stamp: None,
            base: None,
            columns: BTreeMap::new(),
            reorder_seconds: 0.05,
            renames: Vec::new(),
            cache: None,
            clocks: Vec::new(),
        }
    }
}

/// Choice among a message's three stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stamp {
    /// When it was measured: `header.stamp`, `stamp` or `timestamp` inside the message.
    Header,
    /// When it was recorded.
    Log,
    /// When it was published.
    Publish,
}

impl Stamp {
    /// `header`, `log` or `publish`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Header => "header",
            Self::Log => "log",
            Self::Publish => "publish",
        }
    }

    /// Reads `header`, `header.stamp`, `log`, `log_time`, `publish`, `publish_time`.
    pub fn parse(text: &str) -> Option<Self> {
        match text.trim().to_lowercase().as_str() {
            "header" | "header.stamp" => Some(Self::Header),
            "log" | "log_time" => Some(Self::Log),
            "publish" | "publish_time" => Some(Self::Publish),
            _ => None,
        }
    }
}

/// Source of the rows of a joined table.
#[derive(Debug, Clone, PartialEq)]
pub enum Base {
    /// Every sample of this topic (`/odom`), or of the field's group (`/tf.transforms[base_link]`).
    Channel(String),
    /// This many rows a second, while all channels have samples.
    Rate(f64),
}

/// Rule that turns a column's samples into values at the rows' stamps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ColumnJoin {
    /// The kind; by the field's type when not given: `linear` for real numbers, `slerp` for quaternions, `hold` for all else.
    pub kind: Option<JoinKind>,
    /// The longest gap that is bridged; five median periods of the channel when not given. Unlimited: a value holds until the next, whenever that comes.
    pub max_gap: MaxGap,
}

/// A clock that stamps some topics, with its difference from the clock of the others: `offset + skew (stamp - at)`.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicClock {
    /// The log whose clock it is, by the path that it is opened by; every log's when not given.
    pub log: Option<PathBuf>,
    /// Topics by their names in columns; a star matches any text.
    pub topics: Vec<String>,
    /// A moment by this clock, nanoseconds.
    pub at: i64,
    /// Time by this clock less the others' at that moment, nanoseconds.
    pub offset: i64,
    /// Rate relative to the others, seconds a second of its own; positive: faster.
    pub skew: f64,
}

impl TopicClock {
    /// Returns true if the clock stamps a topic. A pattern that cannot be read is a name.
    pub fn stamps(&self, topic: &str) -> bool {
        let is_named = |pattern: &String| {
            pattern == topic || glob::Pattern::new(pattern).is_ok_and(|pattern| pattern.matches(topic))
        };
        self.topics.iter().any(is_named)
    }

    /// Time by the others' clock when this one shows `stamp`.
    pub fn corrected(&self, stamp: i64) -> i64 {
        let drift = (self.skew * stamp.saturating_sub(self.at) as f64).round() as i64;
        stamp.saturating_sub(self.offset).saturating_sub(drift)
    }
}

/// Place for decoded columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    /// The folder; made when needed.
    pub folder: PathBuf,
    /// Files smaller than this together are decoded anew each time.
    pub least_bytes: u64,
}
