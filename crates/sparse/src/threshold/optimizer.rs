//! Method that makes a model sparse.

use fleetfoot_stats::Compressed;

use super::{
    Frols, PenalisedPath, Regularizer, Scaling, Sr3, Ssr, Stlsq, Terms, ThresholdError, Trail, criteria::rounding,
    prepared::Prepared,
};

/// A method that makes a model sparse.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Optimizer {
    /// None: least squares on all allowed columns, of least norm where they depend on each other.
    LeastSquares,
    /// Sequentially thresholded least squares.
    Stlsq(Stlsq),
    /// Sparse relaxed regularised regression.
    Sr3(Sr3),
    /// Stepwise regression.
    Ssr(Ssr),
    /// Forward regression.
    Frols(Frols),
    /// The path of the lasso or of another penalty.
    Path(PenalisedPath),
}

impl Optimizer {
    /// A threshold on coefficients as the parameter of a method that has one: lambda, of [`Sr3`].
    pub fn parameter_of_threshold(&self, threshold: f64) -> f64 {
        match self {
            Self::Sr3(sr3) if sr3.regularizer == Regularizer::L0 => Sr3::lambda_of_threshold(threshold, sr3.nu),
            Self::Sr3(sr3) => threshold / sr3.nu,
            _ => threshold,
        }
    }

    /// The ridge, and its units, of the coefficients that the method writes for a support; 0 where it refits by least squares.
    pub(super) fn written_ridge(&self) -> (f64, Scaling) {
        match self {
            Self::Stlsq(stlsq) if !stlsq.unbias => (stlsq.alpha, stlsq.scaling),
            Self::Ssr(ssr) if !ssr.unbias => (ssr.alpha, ssr.scaling),
            _ => (0.0, Scaling::Physical),
        }
    }
}

impl Default for Optimizer {
    fn default() -> Self {
        Self::Stlsq(Stlsq::default())
    }
}

/// Models of one target of a problem, by one method.
///
/// The same bits whatever else runs. Columns that are zero up to their rounding are left out.
///
/// # Errors
/// When the target or a named column does not exist, the problem has no rows or is not finite, or an option is out of its range.
pub fn optimize(
    problem: &Compressed,
    target: usize,
    optimizer: &Optimizer,
    terms: &Terms,
) -> Result<Trail, ThresholdError> {
    let mut trail = match optimizer {
        Optimizer::LeastSquares => least_squares(problem, target, terms),
        Optimizer::Stlsq(stlsq) => stlsq.trail(problem, target, terms),
        Optimizer::Sr3(sr3) => sr3.trail(problem, target, terms),
        Optimizer::Ssr(ssr) => ssr.trail(problem, target, terms),
        Optimizer::Frols(frols) => frols.trail(problem, target, terms),
        Optimizer::Path(path) => path.trail(problem, target, terms),
    }?;
    trail.rounding = rounding(problem, target);
    Ok(trail)
}

fn least_squares(problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
    let prepared = Prepared::new(problem, terms, Scaling::Physical, 0.0)?;
    prepared.check_target(target)?;
    let open = prepared.open.clone();
    let solved = prepared.refit(&open, target);
    let mut step = prepared.step(target, open, solved, false);
    step.parameter = step.terms() as f64;
    Ok(Trail::single(step))
}
