//! Ranges of regressors in training.

/// Ranges of the regressors in use, per region.
pub(crate) struct Ranges {
    /// Index of the latents' group.
    pub(crate) group: usize,
    pub(crate) width: usize,
    pub(crate) low: Vec<f64>,
    pub(crate) high: Vec<f64>,
}

impl Ranges {
    /// Puts values outside of a region's range on its border; NaN stays.
    #[inline(always)]
    pub(crate) fn hold(&self, region: usize, functions: &mut [f64]) {
        let own = region * self.width..(region + 1) * self.width;
        for ((value, &low), &high) in functions.iter_mut().zip(&self.low[own.clone()]).zip(&self.high[own]) {
            if *value < low {
                *value = low;
            } else if *value > high {
                *value = high;
            }
        }
    }
}
