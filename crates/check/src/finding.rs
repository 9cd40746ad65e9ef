//! A fault: its place, its measured number, and the remedy.

use serde::Serialize;

/// Kinds of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Fault {
    /// Stamps go backward.
    Backward,
    /// Stamps come twice.
    Repeated,
    /// Header stamps are zero, or run away from the log's clock.
    TwoClocks,
    /// The messages of a topic share no moment with those of others.
    NoOverlap,
    /// Rows are missing between others.
    Dropped,
    /// Periods scatter.
    Jitter,
    /// Rows come in groups.
    Bursts,
    /// A channel never changes.
    Dead,
    /// A channel stands still for long while it moves else.
    Stuck,
    /// Values stand at the end of a range.
    Saturated,
    /// Steps of values are coarse.
    Quantised,
    /// Single values far from their neighbours.
    GrossErrors,
    /// Values are missing.
    Missing,
    /// Numbers are written as text.
    Text,
    /// Two channels have the same values.
    Duplicate,
    /// A unit cannot be.
    Unit,
    /// Two axes are exchanged.
    SwappedAxes,
    /// A sign is turned.
    Sign,
    /// A channel is late beside another.
    Delay,
    /// Nothing moves.
    AtRest,
}

impl Fault {
    /// The most serious first.
    pub(crate) fn rank(self) -> u8 {
        self as u8
    }
}

/// A fault in a channel, a topic or a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Finding {
    /// The kind of fault.
    pub fault: Fault,
    /// The channel, topic or file.
    pub place: String,
    /// The measurement that shows the fault, in words.
    pub what: String,
    /// The number that shows the fault: a share, a ratio, seconds.
    pub value: f64,
    /// The command or the recipe entry that mends it.
    pub mend: String,
}

impl Finding {
    pub(crate) fn new(
        fault: Fault,
        place: impl Into<String>,
        (value, what): (f64, String),
        mend: impl Into<String>,
    ) -> Self {
        Self { fault, place: place.into(), what, value, mend: mend.into() }
    }
}
