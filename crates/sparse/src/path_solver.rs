//! Solvers of estimators: the one seam between penalties and everything that chooses, refits and reports.
//!
//! A penalty has an entry in the table of [`Estimator::solver`] and a [`PathSolver`]; the rest follows.

use crate::{
    Path, PathStatus, Penalty, Quadratic, Solution, SparseError, Strength, adaptive,
    coordinate::{CoordinateOptions, coordinate_descent_from, descend, lambda_max},
    estimator::{ElasticNet, Estimator, Stop},
    grid::{check_grid, equal_factors},
    group::{self, GroupLasso},
    lars::{LarsOptions, lars},
    penalty::{Weights, check_ratio, check_strength},
    solution::{Descended, Point, finish},
};

/// Lambdas of the path of an elastic net that has no exact knots, and the smallest over the largest.
const GRID: (usize, f64) = (100, 1e-4);

impl Estimator {
    fn solver(&self) -> &dyn PathSolver {
        match self {
            Self::ElasticNet(net) => net,
            Self::GroupLasso(lasso) => lasso,
        }
    }
}

impl Estimator {
    /// Name for people.
    pub fn name(&self) -> &'static str {
        self.solver().name()
    }

    /// The smallest lambda at which every penalised coefficient is zero; 0 when none ever differs from zero.
    ///
    /// # Errors
    /// When the penalty or an option is out of range, or there is no such lambda.
    pub fn lambda_max(&self, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError> {
        self.solver().lambda_max(problem, penalty)
    }

    /// `count` lambdas from the largest down to `ratio` of it, in equal factors.
    ///
    /// # Errors
    /// As [`Estimator::lambda_max`], and when `count` is 0 or `ratio` is not between 0 and 1.
    pub fn lambda_grid(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        count: usize,
        ratio: f64,
    ) -> Result<Vec<f64>, SparseError> {
        check_grid(count, ratio)?;
        Ok(equal_factors(self.lambda_max(problem, penalty)?, count, ratio))
    }

    /// The certified minimisers at every lambda, in the order given, each started from the one before (so descending is fastest), the first from the
    /// coefficients `start` (p, raw units) or from zero. One that missed its tolerance is marked by [`Solution::converged`], not refused.
    ///
    /// # Errors
    /// When the penalty, an option or a lambda is out of range, or `start` does not have one finite value a column.
    pub fn descend(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
        start: Option<&[f64]>,
    ) -> Result<Vec<Descended>, SparseError> {
        self.solver().descend(problem, penalty, lambdas, start)
    }

    /// The solutions of [`Estimator::descend`], from zero.
    ///
    /// # Errors
    /// As [`Estimator::descend`].
    pub fn solutions(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
    ) -> Result<Vec<Solution>, SparseError> {
        self.solver().solutions(problem, penalty, lambdas)
    }

    /// The certified minimiser at one lambda, with the path that led to it: what it says of columns that were left out.
    ///
    /// # Errors
    /// As [`Estimator::solutions`].
    pub fn at(&self, problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<(Solution, Path), SparseError> {
        self.solver().at(problem, penalty, lambda)
    }

    /// The path from the largest lambda down: every knot where it is piecewise linear, else the solutions at a grid of lambdas.
    ///
    /// # Errors
    /// As [`Estimator::solutions`].
    pub fn path(&self, problem: &Quadratic, penalty: &Penalty, stop: &Stop) -> Result<Path, SparseError> {
        self.solver().path(problem, penalty, stop)
    }

    /// The piecewise-linear path down to `end`, where the estimator has one and, unless `always`, where it is the cheaper way to many lambdas.
    ///
    /// # Errors
    /// As [`Estimator::solutions`].
    pub(crate) fn knots(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        end: f64,
        always: bool,
    ) -> Result<Option<Path>, SparseError> {
        self.solver().knots(problem, penalty, end, always)
    }

    /// Effective degrees of freedom of one of its solutions, the intercept not counted.
    ///
    /// # Errors
    /// When the penalty is not valid.
    pub fn degrees_of_freedom(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        solution: &Solution,
    ) -> Result<f64, SparseError> {
        self.solver().degrees_of_freedom(problem, penalty, solution)
    }
}

/// Solver of a penalty; its methods are those of [`Estimator`].
pub(crate) trait PathSolver {
    fn name(&self) -> &'static str;

    fn lambda_max(&self, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError>;

    fn descend(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
        start: Option<&[f64]>,
    ) -> Result<Vec<Descended>, SparseError>;

    fn solutions(&self, problem: &Quadratic, penalty: &Penalty, lambdas: &[f64]) -> Result<Vec<Solution>, SparseError> {
        let path = self.descend(problem, penalty, lambdas, None)?;
        Ok(path.into_iter().map(|point| point.solution).collect())
    }

    fn path(&self, problem: &Quadratic, penalty: &Penalty, stop: &Stop) -> Result<Path, SparseError>;

    fn at(&self, problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<(Solution, Path), SparseError>;

    fn knots(
        &self,
        _problem: &Quadratic,
        _penalty: &Penalty,
        _end: f64,
        _always: bool,
    ) -> Result<Option<Path>, SparseError> {
        Ok(None)
    }

    fn degrees_of_freedom(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        solution: &Solution,
    ) -> Result<f64, SparseError> {
        adaptive::degrees_of_freedom(problem, penalty, solution)
    }
}

/// The path that solutions at some lambdas are, as far as `stop` lets it go.
pub(crate) fn sampled(
    estimator: Estimator,
    (problem, penalty): (&Quadratic, &Penalty),
    grid: &[f64],
    stop: &Stop,
) -> Result<Path, SparseError> {
    let mut lambdas: Vec<f64> = grid.iter().copied().filter(|lambda| *lambda > stop.lambda).collect();
    if stop.lambda > 0.0 || lambdas.is_empty() {
        lambdas.push(stop.lambda);
    }
    let mut knots = estimator.solutions(problem, penalty, &lambdas)?;
    let fits = |knot: &Solution| stop.max_features.is_none_or(|most| knot.support.len() <= most);
    let kept = knots.iter().take_while(|knot| fits(knot)).count().max(1);
    let status = if kept < knots.len() { PathStatus::MaxFeatures } else { PathStatus::LambdaMin };
    knots.truncate(kept);
    let (collinear, constant) = (Vec::new(), problem.constant());
    let (columns, penalty) = (problem.columns(), penalty.clone());
    Ok(Path { knots, status, collinear, constant, columns, penalty, l2: 0.0, estimator, linear: false })
}

impl Path {
    /// The solution at any lambda of the path, certified; of a path that is not linear it is solved for.
    ///
    /// # Errors
    /// As [`Path::coefficients`], and when `problem` has another number of columns than the path.
    pub fn at(&self, problem: &Quadratic, lambda: f64) -> Result<Solution, SparseError> {
        if problem.columns() != self.columns {
            return Err(SparseError::OtherProblem { actual: self.columns, expected: problem.columns() });
        }
        if !self.linear {
            check_strength("lambda", lambda)?;
            let mut solutions = self.estimator.solutions(problem, &self.penalty, &[lambda])?;
            return Ok(solutions.remove(0));
        }
        let raw = self.coefficients(lambda)?;
        let size = problem.target_length();
        let delta = raw.iter().enumerate().filter(|(_, value)| **value != 0.0);
        let delta = delta.map(|(j, value)| (j, value * (problem.length[j] / size))).collect();
        let weights = Weights::new(problem, &self.penalty)?;
        let mut solutions = finish(problem, &weights, vec![Point { l1: lambda, l2: self.l2, delta, converged: true }]);
        Ok(solutions.remove(0))
    }
}

impl PathSolver for ElasticNet {
    fn name(&self) -> &'static str {
        if self.l1_ratio < 1.0 { "elastic net" } else { "lasso" }
    }

    fn lambda_max(&self, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError> {
        lambda_max(problem, penalty, self.l1_ratio)
    }

    fn descend(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
        start: Option<&[f64]>,
    ) -> Result<Vec<Descended>, SparseError> {
        let options = CoordinateOptions { l1_ratio: self.l1_ratio, ..self.descent.clone() };
        match start {
            Some(start) => coordinate_descent_from(problem, penalty, lambdas, &options, start),
            None => descend(problem, penalty, lambdas, &options, None),
        }
    }

    fn path(&self, problem: &Quadratic, penalty: &Penalty, stop: &Stop) -> Result<Path, SparseError> {
        if check_ratio(self.l1_ratio)? < 1.0 {
            let grid = equal_factors(self.lambda_max(problem, penalty)?, GRID.0, GRID.1);
            return sampled(self.clone().into(), (problem, penalty), &grid, stop);
        }
        let options =
            LarsOptions { lambda_min: stop.lambda, max_features: stop.max_features, ..LarsOptions::default() };
        lars(problem, penalty, &options)
    }

    /// By LARS with the squares as they are at lambda; by coordinate descent where rounding ends that path before.
    fn at(&self, problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<(Solution, Path), SparseError> {
        let Strength { l1, l2 } = Strength::elastic_net(lambda, self.l1_ratio);
        let path = lars(problem, penalty, &LarsOptions { lambda_min: l1, l2, ..LarsOptions::default() })?;
        let solution = match path.at(problem, l1) {
            Ok(solution) => solution,
            Err(_) => self.solutions(problem, penalty, &[lambda])?.remove(0),
        };
        Ok((solution, path))
    }

    fn knots(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        end: f64,
        always: bool,
    ) -> Result<Option<Path>, SparseError> {
        if check_ratio(self.l1_ratio)? < 1.0 || !(always || problem.columns() <= self.most_for_lars) {
            return Ok(None);
        }
        let options = LarsOptions { lambda_min: end, ..LarsOptions::default() };
        Ok(Some(lars(problem, penalty, &options)?))
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

    fn lambda_max(&self, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError> {
        group::lambda_max(self, problem, penalty)
    }

    fn descend(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambdas: &[f64],
        start: Option<&[f64]>,
    ) -> Result<Vec<Descended>, SparseError> {
        group::descend(self, problem, penalty, lambdas, start)
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
        group::degrees_of_freedom(self, problem, penalty, solution)
    }
}
