//! `[clocks.NAME]`: topics that another computer stamps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Clock of another computer: its topics, and the channels that compare it with the reference clock.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClockSection {
    /// Topics that it stamps; a star matches anything.
    pub topics: Vec<String>,
    /// Two channels of one motion, fields or expressions: one by the reference clock, one by this clock. Offset and
    /// skew maximise the share of one that a straight line of the other explains.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<[String; 2]>,
    /// Two channels of one square wave, by the reference clock and by this one. The stamps before and after every edge
    /// bound offset and skew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wave: Option<[String; 2]>,
    /// A timer switches the wave: edges of one kind are equally far apart and bound one another (false).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub even: Option<bool>,
    /// Clock offset, this clock less the reference, in seconds: centre of the search, or, without `motion` and `wave`,
    /// the constant delay itself (default: from the log times).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// Seconds to either side of `offset` within which the clock offset is sought (1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
}
