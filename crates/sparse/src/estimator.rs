//! The one seam between penalties and everything that chooses, refits and reports.
//!
//! Selection, criteria, sweeps of supports, the recipes of `fit sparse` and `fit sindy` know an [`Estimator`] and nothing of its penalty. A new penalty is a
//! module with its shape for the certificate (`shape`) and its solver (`PathSolver`), and one line in each of the two tables below.

use crate::{
    Path, PathStatus, Penalty, Quadratic, Solution, SparseError, Strength, adaptive,
    coordinate::{
        CoordinateOptions, Descended, check_grid, coordinate_descent_from, descend, equal_factors, lambda_max,
    },
    group::GroupLasso,
    lars::{LarsOptions, lars},
    penalty::check_ratio,
};

/// Lambdas of the path of an elastic net that has no exact knots, and the smallest over the largest.
const GRID: (usize, f64) = (100, 1e-4);

/// A penalty, and how its solutions are found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Estimator {
    /// The lasso and the elastic net.
    ElasticNet(ElasticNet),
    /// The group lasso and the sparse-group lasso.
    GroupLasso(GroupLasso),
}

impl Estimator {
    fn solver(&self) -> &dyn PathSolver {
        match self {
            Self::ElasticNet(net) => net,
            Self::GroupLasso(lasso) => lasso,
        }
    }
}

impl Default for Estimator {
    /// The lasso.
    fn default() -> Self {
        Self::ElasticNet(ElasticNet::default())
    }
}

impl From<ElasticNet> for Estimator {
    fn from(net: ElasticNet) -> Self {
        Self::ElasticNet(net)
    }
}

impl From<GroupLasso> for Estimator {
    fn from(lasso: GroupLasso) -> Self {
        Self::GroupLasso(lasso)
    }
}

/// Where a path ends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Stop {
    /// The smallest lambda, in the units of the target; 0: where the estimator ends its paths.
    pub lambda: f64,
    /// The most columns with coefficients that are not zero; `None`: all.
    pub max_features: Option<usize>,
}

impl Estimator {
    /// What people call it.
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

/// What a penalty brings; the methods are those of [`Estimator`].
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
        let found = self.descend(problem, penalty, lambdas, None)?;
        Ok(found.into_iter().map(|found| found.solution).collect())
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

/// The lasso and the elastic net: by LARS where its knots are wanted or few columns make it the cheaper way, else by coordinate descent.
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticNet {
    /// Share of the l1 penalty: 1 is the lasso; below it, coordinate descent solves the elastic net.
    pub l1_ratio: f64,
    /// The most columns for which whole LARS paths are followed to compare lambdas; beyond, coordinate descent goes from lambda to lambda.
    pub most_for_lars: usize,
    /// Options of coordinate descent; its `l1_ratio` is the one above.
    pub descent: CoordinateOptions,
}

impl Default for ElasticNet {
    /// The lasso.
    fn default() -> Self {
        Self { l1_ratio: 1.0, most_for_lars: 400, descent: CoordinateOptions::default() }
    }
}

impl ElasticNet {
    /// With this share of the l1 penalty.
    pub fn new(l1_ratio: f64) -> Self {
        Self { l1_ratio, ..Self::default() }
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
        let found = match path.at(problem, l1) {
            Ok(solution) => solution,
            Err(_) => self.solutions(problem, penalty, &[lambda])?.remove(0),
        };
        Ok((found, path))
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
