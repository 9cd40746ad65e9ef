//! Gaps that end an episode.

/// The gap between two stamps that ends an episode.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum MaxGap {
    /// More than five median periods of the file.
    #[default]
    Auto,
    /// More than these seconds.
    Seconds(f64),
    /// No gap ends an episode; a backward stamp still does.
    Unlimited,
}
