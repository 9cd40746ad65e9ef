//! What one clock shows against another.

/// A straight line between two clocks: the second shows `offset + skew (t - at)` more than the first when that shows t. Seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockLine {
    /// A moment by the first clock, s.
    pub at: f64,
    /// How much more the second clock shows then, s.
    pub offset: f64,
    /// How much faster it goes, seconds a second.
    pub skew: f64,
}

impl ClockLine {
    /// What the second clock shows when the first one shows `time`.
    pub fn second(&self, time: f64) -> f64 {
        time + self.offset + self.skew * (time - self.at)
    }

    /// What the first clock shows when the second one shows `time`.
    pub fn first(&self, time: f64) -> f64 {
        let since = time - self.at;
        self.at + (since - self.offset) / (1.0 + self.skew)
    }
}
