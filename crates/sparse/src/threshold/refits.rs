//! Least squares on one support after the other: one factor follows them.

use fleetfoot_stats::Compressed;

use super::{
    Scaling, Step, Terms, ThresholdError,
    prepared::{Prepared, Solved},
};
use crate::{Penalty, Quadratic, SparseError, factor::Factor, penalty::Weights};

/// Deletions after which the factor is made anew, so that the rounding of their rotations does not add up.
const DELETIONS: usize = 64;

/// A gradient, as a correlation, that least squares with the factor may leave; beyond it the support is solved by itself.
const CERTIFIED: f64 = 1e-10;

/// Least squares on each of these supports (columns, ascending), in their order, within the bounds of the terms.
///
/// Each is reached from the one before by rank-one changes of one orthogonal factor: supports that differ by a column, as those of a path do, cost `p m + k^2`
/// operations each (p columns, m compressed rows, k terms) where a factorisation of its own costs `p k^2`. A support with columns that cannot be told apart is
/// solved by itself, with minimum norm.
///
/// # Errors
/// When the target or a column does not exist, the problem has no rows or is not finite.
pub fn refit_supports(
    problem: &Compressed,
    target: usize,
    terms: &Terms,
    supports: &[Vec<usize>],
) -> Result<Vec<Step>, ThresholdError> {
    let prepared = Prepared::new(problem, terms, Scaling::Physical, 0.0)?;
    prepared.check_target(target)?;
    let quadratic = Quadratic::from_compressed(problem, target)?;
    let columns = problem.columns();
    if let Some(&column) = supports.iter().flatten().find(|column| **column >= columns) {
        return Err(ThresholdError::NoSuchColumn { what: "wanted", column, columns });
    }
    Ok(Refits::new(&prepared, &quadratic, target)?.steps(supports))
}

/// Supports followed by a factor.
pub(super) struct Refits<'a> {
    prepared: &'a Prepared<'a>,
    quadratic: &'a Quadratic,
    target: usize,
    weights: Weights,
}

impl<'a> Refits<'a> {
    /// `quadratic` is the target of the prepared problem.
    pub(super) fn new(
        prepared: &'a Prepared<'a>,
        quadratic: &'a Quadratic,
        target: usize,
    ) -> Result<Self, SparseError> {
        let weights =
            Weights::new(quadratic, &Penalty { factors: vec![0.0; quadratic.columns()], ..Penalty::default() })?;
        Ok(Self { prepared, quadratic, target, weights })
    }

    /// Least squares on each of these supports.
    pub(super) fn steps(&self, supports: &[Vec<usize>]) -> Vec<Step> {
        let fresh = || Factor::new(self.quadratic, &self.weights, 0.0);
        let (mut factor, mut deletions) = (fresh(), 0);
        let mut steps = Vec::with_capacity(supports.len());
        for support in supports {
            let wanted = |j: &usize| support.binary_search(j).is_ok();
            if deletions > DELETIONS {
                (factor, deletions) = (fresh(), 0);
            }
            while let Some(place) = factor.order.iter().position(|j| !wanted(j)) {
                factor.remove(place);
                deletions += 1;
            }
            let reached =
                support.iter().all(|&j| factor.is_active(j) || (self.weights.used(j) && factor.append(j, 0.0)));
            let step =
                reached.then(|| self.prepared.step(self.target, support.clone(), self.solved(&factor, support), false));
            let kept = |step: &Step| {
                let within = |&j: &usize| self.prepared.within(j, step.coefficients[j]);
                step.certificate.correlation <= CERTIFIED && support.iter().all(within)
            };
            steps.push(step.filter(kept).unwrap_or_else(|| {
                let solved = self.prepared.refit(support, self.target);
                self.prepared.step(self.target, support.clone(), solved, false)
            }));
        }
        steps
    }

    /// Coefficients of the factor's columns, in the order of the support.
    fn solved(&self, factor: &Factor<'_>, support: &[usize]) -> Solved {
        let (delta, _) = factor.solutions();
        let mut values = vec![0.0; support.len()];
        for (&j, delta) in factor.order.iter().zip(delta) {
            if let Ok(place) = support.binary_search(&j) {
                values[place] = self.quadratic.raw(j, delta);
            }
        }
        Solved { values, confounded: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use fleetfoot_stats::Factor as Rows;

    use super::*;

    /// 12 columns, the last a copy of the first but for a little, and one that is the sum of two others.
    fn problem() -> Compressed {
        let value = |i: usize, j: usize| ((i * (2 * j + 3)) as f64 * 0.37).sin() + 0.1 * j as f64;
        let rows = Mat::from_fn(300, 13, |i, j| match j {
            12 => 2.0 * value(i, 0) - 0.5 * value(i, 3) + 0.07 * value(i, 1) + 0.01 * ((i * i) as f64).cos(),
            11 => value(i, 0) + 1e-5 * value(i, 5),
            10 => value(i, 2) + value(i, 4),
            j => 10_f64.powi(j as i32 - 5) * value(i, j),
        });
        let mut factor = Rows::new(12, 1);
        factor.push(rows.as_ref(), None);
        factor.square_root().compressed(false)
    }

    #[test]
    fn refits_match_separate_supports() {
        let problem = problem();
        // A walk that adds and drops columns, with supports that cannot be told apart (2, 4 and 10) on its way.
        let mut walk: Vec<Vec<usize>> = vec![Vec::new()];
        for step in 0..200_usize {
            let mut next = walk[step].clone();
            let column = (step * step * 7 + step / 3) % 12;
            match next.binary_search(&column) {
                Ok(place) => {
                    next.remove(place);
                }
                Err(place) => next.insert(place, column),
            }
            walk.push(next);
        }
        let refits = refit_supports(&problem, 0, &Terms::all(), &walk).unwrap();
        let prepared = Prepared::new(&problem, &Terms::all(), Scaling::Physical, 0.0).unwrap();
        let mut confounded = 0;
        for (step, support) in refits.iter().zip(&walk) {
            assert_eq!(&step.support, support);
            let alone = prepared.step(0, support.clone(), prepared.refit(support, 0), false);
            assert_eq!(step.confounded, alone.confounded);
            confounded += usize::from(!alone.confounded.is_empty());
            for (a, b) in step.coefficients.iter().zip(&alone.coefficients) {
                // The copy of a column costs five digits.
                assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()) * b.abs().max(1.0), "{support:?}: {a} {b}");
            }
            assert!((step.rss - alone.rss).abs() <= 1e-12 * alone.rss.max(1.0));
        }
        assert!(confounded > 5, "{confounded}");
        assert!(refit_supports(&problem, 0, &Terms::all(), &[vec![12]]).is_err());
    }
}
