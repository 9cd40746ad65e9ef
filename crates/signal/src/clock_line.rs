//! Line between the readings of two clocks.

/// A straight line between two clocks: the second shows `offset + skew (t - at)` more than the first when that shows t. Seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockLine {
    /// A moment by the first clock, s.
    pub at: f64,
    /// Reading of the second clock less that of the first at this moment, s.
    pub offset: f64,
    /// Rate of the second clock relative to the first, seconds a second; positive: faster.
    pub skew: f64,
}

impl ClockLine {
    /// The reading of the second clock when the first one reads `time`.
    pub fn second(&self, time: f64) -> f64 {
        time + self.offset + self.skew * (time - self.at)
    }

    /// The reading of the first clock when the second one reads `time`.
    pub fn first(&self, time: f64) -> f64 {
        let since = time - self.at;
        self.at + (since - self.offset) / (1.0 + self.skew)
    }
}
