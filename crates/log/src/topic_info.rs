//! Description of a topic in a robot's log.

use serde::Serialize;

/// A topic of a robot's log. Times are the log's: when messages were recorded.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[non_exhaustive]
pub struct TopicInfo {
    /// Its name.
    pub name: String,
    /// The type of its messages, e.g. `nav_msgs/msg/Odometry`; empty without a schema.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Encoding of its messages, e.g. `cdr`.
    pub message_encoding: String,
    /// Encoding of its schema, e.g. `ros2msg`; empty without a schema.
    pub schema_encoding: String,
    /// Messages, if the file states their number.
    pub messages: Option<u64>,
    /// Stamp of the first message, nanoseconds.
    pub start: Option<i64>,
    /// Stamp of the last message, nanoseconds.
    pub end: Option<i64>,
    /// Messages a second, from the first to the last.
    pub rate: Option<f64>,
    /// The median deviation of the periods from their median, seconds, where the file has an index.
    pub jitter: Option<f64>,
    /// Groups of messages less than a tenth of the mean period apart, where the file has an index.
    pub bursts: Option<usize>,
    /// Gaps longer than five median periods, where the file has an index.
    pub gaps: Option<usize>,
    /// The longest gap, seconds, where the file has an index.
    pub largest_gap: Option<f64>,
    /// Offset to add to the headers' stamps for the log's times, seconds, from the first and the last messages; `None`
    /// without headers.
    pub header_offset: Option<HeaderOffset>,
    /// Why its messages cannot be read.
    pub problem: Option<String>,
}

/// Offset of the log's clock from the headers' clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct HeaderOffset {
    /// Log stamp minus header stamp of the first message, seconds.
    pub first: f64,
    /// Log stamp minus header stamp of the last message looked at, seconds. Another value than the first: the clocks run apart.
    pub last: f64,
    /// All header stamps looked at are zero: they were never filled in.
    pub zero: bool,
}
