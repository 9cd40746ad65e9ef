//! Cost, derivatives and sums of one pass over the rows at given parameters.

use faer::Mat;

/// Residuals and Jacobian of all rows, compressed: `|r + J s|^2 = |rhs + jacobian s|^2 + beyond` for every step s.
#[derive(Debug, Clone)]
pub(crate) struct Evaluation {
    /// (m x p).
    pub(crate) jacobian: Mat<f64>,
    pub(crate) rhs: Vec<f64>,
    /// `|r|^2`.
    pub(crate) cost: f64,
    /// `sum (sqrt(weight) target)^2`.
    pub(crate) targets: f64,
    /// Complete rows.
    pub(crate) rows: u64,
    /// J'r of every chunk (p each).
    pub(crate) scores: Vec<Vec<f64>>,
    /// Linear coefficients solved for on the way, one entry a residual.
    pub(crate) linear: Vec<LinearPart>,
    /// Share of the cost of each residual or output; empty unless requested.
    pub(crate) shares: Vec<f64>,
    /// Simulations that ended early.
    pub(crate) ended: u64,
}

/// Linear coefficients at given nonlinear parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LinearPart {
    pub(crate) coefficients: Vec<f64>,
    /// Sum of squares that they leave, without weight.
    pub(crate) rss: f64,
}
