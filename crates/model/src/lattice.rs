//! The tree of joins that the regions of a lattice are a level of.

/// Joins of many small cells into few regions, and the errors of the numbers of regions that were tried.
///
/// Errors are squared errors over the variance of a target, means over the targets.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Joins that would follow the regions of this model, down to one region: the cheapest join first.
    pub joins: Vec<Join>,
    /// The numbers of regions that were tried, ascending.
    pub levels: Vec<Level>,
}

/// Two regions that become one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Join {
    /// The region that stands for both.
    pub kept: u32,
    /// The region that is gone.
    pub gone: u32,
    /// Error of the training rows afterwards.
    pub training: f64,
}

/// Errors with a number of regions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Regions.
    pub regions: usize,
    /// Error of the training rows.
    pub training: f64,
    /// Error of rows that did not train; NaN without folds.
    pub held_out: f64,
    /// Its standard error across folds.
    pub standard_error: f64,
    /// Bayesian information criterion.
    pub bic: f64,
}
