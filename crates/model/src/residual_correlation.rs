//! Correlation of a model's residuals from row to row.

/// The correlation of a partition's residuals from row to row, if it is more than chance. Residuals of the q fitted
/// equations are whitened by their region: `rho = L^-1 r`, L the lower Cholesky factor of the region's residual
/// covariance, so that `E rho rho' = I`. The kept correlation is common to all regions.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualCorrelation {
    /// `E rho_k rho_(k-h)'` for h = 1, 2, ..., each q x q by rows. An autoregression of as many lags leaves white
    /// noise, within the accuracy of the rows.
    pub lags: Vec<Vec<f64>>,
}

impl ResidualCorrelation {
    /// Autocovariances from lag 0 on, each q x q by rows: those of an autoregression.
    pub fn autocovariances(&self) -> Vec<Vec<f64>> {
        let q = self.targets();
        let identity = (0..q * q).map(|at| f64::from(u8::from(at / q == at % q))).collect();
        std::iter::once(identity).chain(self.lags.iter().cloned()).collect()
    }

    /// Number of fitted equations.
    pub fn targets(&self) -> usize {
        self.lags.first().map_or(0, |lag| lag.len().isqrt())
    }

    /// The root mean square correlation of residuals with those of some rows before (1 up to the number of lags), each in its own direction.
    pub fn size(&self, lag: usize) -> f64 {
        let (lag, q) = (&self.lags[lag - 1], self.targets());
        (lag.iter().map(|value| value * value).sum::<f64>() / q as f64).sqrt()
    }

    /// Checks that it has the size of so many fitted equations.
    pub(crate) fn check(&self, fitted: usize) -> Result<(), String> {
        let fits = |matrix: &Vec<f64>| matrix.len() == fitted * fitted && matrix.iter().all(|value| value.is_finite());
        match !self.lags.is_empty() && self.lags.iter().all(fits) {
            true => Ok(()),
            false => Err(format!("correlations of residuals are not {fitted} x {fitted} numbers")),
        }
    }
}
