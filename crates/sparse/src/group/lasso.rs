//! Which columns belong together, and the solutions along lambda.

use super::{
    block::{Block, blocks},
    descent::Descent,
    shape::AtLambda,
};
use crate::{
    Certificate, Path, Penalty, Quadratic, Solution, SparseError,
    certificate::certify,
    coordinate::{Descended, check_grid, equal_factors},
    estimator::{PathSolver, Stop, sampled},
    kernel::Slab,
    path::{Point, finish_shaped},
    penalty::{Weights, check_ratio, check_strength, check_tolerance},
};

/// Which columns belong together.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groups {
    /// The group of every column (p), numbered from 0 and below p; the columns of a group need not be neighbours.
    pub of: Vec<usize>,
    /// Weights w_g of the groups' norms, by number (empty: the root of the number of penalised columns of the group); 0 leaves the norm unpenalised.
    pub weights: Vec<f64>,
}

impl Groups {
    /// Groups of equal weight a column: the root of their sizes.
    pub fn new(of: Vec<usize>) -> Self {
        Self { of, weights: Vec::new() }
    }

    /// Number of groups: one more than the largest number.
    pub fn len(&self) -> usize {
        self.of.iter().max().map_or(0, |last| last + 1)
    }

    /// Whether there are no columns.
    pub fn is_empty(&self) -> bool {
        self.of.is_empty()
    }

    /// The weight of every group under a penalty, once groups and problem belong together.
    fn checked(&self, columns: usize, penalty: &Penalty) -> Result<Vec<f64>, SparseError> {
        let (found, expected) = (self.of.len(), columns);
        if found != expected {
            return Err(SparseError::Length { what: "the list of the columns' groups", found, expected });
        }
        if let Some(column) = self.of.iter().position(|&group| group >= columns) {
            return Err(SparseError::GroupNumber { column, group: self.of[column], columns });
        }
        if self.weights.is_empty() {
            let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
            let mut sizes = vec![0.0_f64; self.len()];
            let penalised = (0..columns).filter(|&j| factor(j) > 0.0 && factor(j).is_finite());
            penalised.for_each(|j| sizes[self.of[j]] += 1.0);
            return Ok(sizes.into_iter().map(f64::sqrt).collect());
        }
        let (found, expected) = (self.weights.len(), self.len());
        if found < expected {
            return Err(SparseError::Length { what: "the list of the groups' weights", found, expected });
        }
        match self.weights.iter().position(|weight| !(*weight >= 0.0 && weight.is_finite())) {
            Some(group) => Err(SparseError::GroupWeight { group, value: self.weights[group] }),
            None => Ok(self.weights.clone()),
        }
    }
}

/// The group lasso and the sparse-group lasso:
///
/// `1/(2n) rss + lambda ((1 - l1_ratio) sum_g w_g |v_g| + l1_ratio sum_j |v_j|)`, `v_j = f_j u_j b_j`
///
/// with penalty factors f and units u of the [`Penalty`], whose signs hold too.
///
/// Block coordinate descent on the compressed problem: a group at a time, exactly (by the eigenvalues of its Gram block and a secular equation) where the penalty is
/// its norm alone, by proximal steps where coefficients may also leave alone; working sets by the sequential strong rule, checked against all groups; Newton
/// steps for the last digits. Every solution carries its duality gap, the dual point scaled by the exact dual norm. The same bits on any number of threads.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupLasso {
    /// Which columns belong together.
    pub groups: Groups,
    /// Share of the absolute values in the penalty: 0 is the group lasso, 1 the lasso.
    pub l1_ratio: f64,
    /// The violation of the optimality conditions, as a correlation, at which a solution is good ([`CoordinateOptions::tolerance`](crate::coordinate::CoordinateOptions)).
    pub tolerance: f64,
    /// The most sweeps over the working set, a lambda.
    pub max_epochs: usize,
    /// Lambdas of a path, in equal factors from the largest down.
    pub count: usize,
    /// The smallest of them over the largest.
    pub ratio: f64,
}

impl GroupLasso {
    /// The group lasso with these groups, paths of 100 lambdas over four decades.
    pub fn new(groups: Groups) -> Self {
        Self { groups, l1_ratio: 0.0, tolerance: 1e-9, max_epochs: 10_000, count: 100, ratio: 1e-4 }
    }

    /// The certificate of coefficients (p, raw units) at lambda, whoever computed them.
    ///
    /// # Errors
    /// When the penalty, the groups, an option or lambda is out of range, or a length is not that of the problem.
    pub fn certificate(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambda: f64,
        coefficients: &[f64],
    ) -> Result<Certificate, SparseError> {
        check_strength("lambda", lambda)?;
        let posed = Posed::new(self, problem, penalty)?;
        let scaled = posed.scaled(problem, coefficients, "the coefficients")?;
        let delta = Slab::from_fn(problem.columns(), 1, |j, _| scaled[j]);
        let (mut found, _) = certify(problem, &posed.weights, 0.0, &[posed.at(lambda)], &delta).remove(0);
        // A column that takes no part has no place in correlation form.
        if (0..problem.columns()).any(|j| coefficients[j] != 0.0 && !posed.weights.used(j)) {
            found.kkt = f64::INFINITY;
        }
        Ok(found)
    }
}

/// A problem with its groups, checked, in correlation form.
pub(super) struct Posed {
    pub(super) weights: Weights,
    pub(super) blocks: Vec<Block>,
    /// The block of every column.
    of: Vec<Option<usize>>,
}

impl Posed {
    pub(super) fn new(lasso: &GroupLasso, problem: &Quadratic, penalty: &Penalty) -> Result<Self, SparseError> {
        check_ratio(lasso.l1_ratio)?;
        let weights = Weights::new(problem, penalty)?;
        let group = lasso.groups.checked(problem.columns(), penalty)?;
        let blocks = blocks(&weights, &lasso.groups.of, &group, lasso.l1_ratio);
        let mut of = vec![None; problem.columns()];
        for (at, block) in blocks.iter().enumerate() {
            block.columns.iter().for_each(|&j| of[j] = Some(at));
        }
        Ok(Self { weights, blocks, of })
    }

    /// The penalty at lambda, in the units of the target.
    fn at(&self, lambda: f64) -> AtLambda<'_> {
        AtLambda { blocks: &self.blocks, of: &self.of, lambda: lambda / self.weights.tau }
    }

    /// Raw coefficients in correlation form; 0 of columns that take no part.
    pub(super) fn scaled(&self, problem: &Quadratic, raw: &[f64], what: &'static str) -> Result<Vec<f64>, SparseError> {
        let (found, expected) = (raw.len(), problem.columns());
        if found != expected {
            return Err(SparseError::Length { what, found, expected });
        }
        if let Some(column) = raw.iter().position(|value| !value.is_finite()) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        let size = problem.target_length();
        let scaled = |(j, value): (usize, &f64)| {
            if self.weights.used(j) { value * (problem.length[j] / size) } else { 0.0 }
        };
        Ok(raw.iter().enumerate().map(scaled).collect())
    }
}

impl PathSolver for GroupLasso {
    fn name(&self) -> &'static str {
        match self.l1_ratio {
            0.0 => "group lasso",
            1.0 => "lasso",
            _ => "sparse-group lasso",
        }
    }

    /// Exact: the largest dual norm of a group.
    fn lambda_max(&self, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError> {
        let posed = Posed::new(self, problem, penalty)?;
        let mut descent = Descent::new(problem, &posed.blocks);
        descent.solve(f64::INFINITY, self.tolerance, self.max_epochs)?;
        let penalised = posed.blocks.iter().filter(|block| block.penalised());
        let entries = penalised.map(|block| block.critical(&descent.left.gradient, |j| problem.noise[j]));
        let largest = entries.fold(0.0, f64::max) * posed.weights.tau;
        Ok(if problem.target_deviation() > 0.0 { largest } else { 0.0 })
    }

    fn descend(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
        start: Option<&[f64]>,
    ) -> Result<Vec<Descended>, SparseError> {
        check_tolerance(self.tolerance)?;
        for &lambda in lambdas {
            check_strength("lambda", lambda)?;
        }
        let posed = Posed::new(self, problem, penalty)?;
        let mut descent = Descent::new(problem, &posed.blocks);
        if let Some(start) = start {
            descent.start(&posed.scaled(problem, start, "the start")?);
        }
        let (mut points, mut epochs) = (Vec::with_capacity(lambdas.len()), Vec::with_capacity(lambdas.len()));
        for &lambda in lambdas {
            let (converged, used) = descent.solve(lambda / posed.weights.tau, self.tolerance, self.max_epochs)?;
            let delta = descent.left.delta.iter().copied().enumerate().filter(|(_, value)| *value != 0.0).collect();
            points.push(Point { l1: lambda, l2: 0.0, delta, converged });
            epochs.push(used);
        }
        let solutions = finish_shaped(problem, &posed.weights, points, |point| posed.at(point.l1)).into_iter();
        Ok(solutions.zip(epochs).map(|(solution, epochs)| Descended { solution, epochs }).collect())
    }

    fn path(&self, problem: &Quadratic, penalty: &Penalty, stop: &Stop) -> Result<Path, SparseError> {
        check_grid(self.count, self.ratio)?;
        let grid = equal_factors(self.lambda_max(problem, penalty)?, self.count, self.ratio);
        sampled(self.clone().into(), (problem, penalty), &grid, stop)
    }

    fn at(&self, problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<(Solution, Path), SparseError> {
        let path = sampled(self.clone().into(), (problem, penalty), &[lambda], &Stop::default())?;
        Ok((path.knots[0].clone(), path))
    }

    fn degrees_of_freedom(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        solution: &Solution,
    ) -> Result<f64, SparseError> {
        super::degrees_of_freedom(self, problem, penalty, solution)
    }
}
