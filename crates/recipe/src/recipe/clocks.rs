//! `[clocks.NAME]`: topics that another computer stamps.

use serde::{Deserialize, Serialize};

/// The clock of another computer: its topics, and what tells how it goes beside the clock of the others.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockSection {
    /// The topics that it stamps; a star stands for anything.
    pub topics: Vec<String>,
    /// Two channels that saw one motion, fields or expressions: one by the reference clock, one by this clock. Offset and skew are those at which a straight line of
    /// the one explains most of the other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<[String; 2]>,
    /// Two channels that saw one square wave, by the reference clock and by this one. Offset and skew are bounded by the stamps before and after every edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wave: Option<[String; 2]>,
    /// Whether a timer switches the wave, so that edges of one kind are equally far apart and bound one another (no).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub even: Option<bool>,
    /// Seconds that this clock shows more than the reference: about which is searched, or, without `motion` and `wave`, what is taken as it is (a constant delay). What log
    /// times tell when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// Seconds to either side of that within which the offset is looked for (1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
}
