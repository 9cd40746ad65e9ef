//! The numbers of a switched Kalman filter of a model with affine regions.

/// The numbers of a filter; matrices by rows, region after region.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilterTables {
    /// Names of the n states.
    pub states: Vec<String>,
    /// True for a state that is an angle.
    pub angles: Vec<bool>,
    /// Names of the m inputs.
    pub inputs: Vec<String>,
    /// Names of the regions.
    pub regions: Vec<String>,
    /// n x n of every region.
    pub a: Vec<Vec<f64>>,
    /// n x m.
    pub b: Vec<Vec<f64>>,
    /// n.
    pub c: Vec<Vec<f64>>,
    /// n x n: the covariance of a step's noise.
    pub q: Vec<Vec<f64>>,
    /// Correlation from row to row, if the noise is not white.
    pub colour: Option<FilterColour>,
    /// Of every sensor: the state that it measures, and its standard deviation.
    pub sensors: Vec<(usize, f64)>,
    /// Mean and standard deviation of every state before it is measured.
    pub prior: Vec<[f64; 2]>,
    /// Points of the standard normal distribution (points x n).
    pub points: Vec<f64>,
    /// Probabilities from region to region, where these do not follow from the state.
    pub transitions: Option<Vec<Vec<f64>>>,
    /// True if the partition reads inputs.
    pub regions_read_inputs: bool,
    /// Seconds of a step.
    pub period: f64,
}

/// Process noise that is correlated from row to row: an autoregression of order p of the q whitened residuals, matrices
/// by rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilterColour {
    /// Effect of a row's residuals on the states: n x q of every region.
    pub s: Vec<Vec<f64>>,
    /// q x (p q): by those of the row before, of the one before that, ...
    pub coefficients: Vec<f64>,
    /// q x q: the covariance of its innovation.
    pub innovation: Vec<f64>,
    /// (p q) x (p q): the covariance of the residuals of p rows.
    pub stationary: Vec<f64>,
}
