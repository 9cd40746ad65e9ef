//! Cross-validation of lambda: every fold is a reweighting of the same statistics.

use faer::Mat;
use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_stats::{Gram, SquareRoot};

use super::{CrossValidation, Folds, HeldOut, SelectError, held_out::Coefficients, score::Scored};
use crate::{
    Path, Penalty, Quadratic, Solution, SparseError,
    estimator::Estimator,
    penalty::check_strength,
    structured::{Assembly, assemble},
};
use fleetfoot_sums::structured::{Banks, Structure};

/// Lambdas to compare.
#[derive(Debug, Clone, PartialEq)]
pub enum Lambdas {
    /// `count` of them, in equal factors, from the largest of the problem on all rows down to `ratio` of it.
    Grid {
        /// Number of lambdas.
        count: usize,
        /// The smallest over the largest.
        ratio: f64,
    },
    /// These.
    List(Vec<f64>),
    /// The knots of all folds' paths, exactly, down to the largest lambda at which one of them ends. The error is a
    /// piecewise quadratic between them.
    Knots,
}

/// Options for fitting and comparing models.
#[derive(Debug, Clone, PartialEq)]
pub struct SelectOptions {
    /// Lambdas to compare.
    pub lambdas: Lambdas,
    /// Estimator to fit at each of them.
    pub estimator: Estimator,
}

impl Default for SelectOptions {
    /// The lasso at 100 lambdas over three decades.
    fn default() -> Self {
        Self { lambdas: Lambdas::Grid { count: 100, ratio: 1e-3 }, estimator: Estimator::default() }
    }
}

/// One fold: a training problem, and the rows that were kept from it.
#[derive(Debug, Clone)]
pub struct Split {
    /// The training problem.
    pub train: Quadratic,
    /// Its penalty.
    pub penalty: Penalty,
    /// The held-out rows.
    pub test: HeldOut,
}

/// Cross-validates lambda for a structured regression.
///
/// Training and held-out statistics of all folds come from one product a task, as in [`Banks::roots`]; the columns' scales are those of the fold's training rows.
/// The task weights of `assembly` are taken as they are, for all folds. Scored are the measured tasks; priors and the Tikhonov term shape the
/// models only. Lambdas are comparable between folds because the objective is a mean over rows; [`Tikhonov`](crate::structured::Tikhonov) is relative to a
/// sum, and so weighs a little more in a fold than on all rows.
///
/// # Errors
/// When folds and members disagree, an option is out of range, a problem cannot be posed, or the user stops it.
pub fn cross_validate(
    structure: &Structure,
    banks: &Banks,
    assembly: &Assembly,
    folds: &Folds,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<CrossValidation, SelectError> {
    let mut roots = fold_roots(banks, folds, progress)?;
    let full = assemble(structure, &roots.remove(2 * folds.len()), assembly)?;
    let k = folds.len();
    let splits = parallel_map(k, progress, |fold| {
        let train = assemble(structure, &roots[fold], assembly)?;
        let test = HeldOut::tasks(structure, &roots[k + fold], assembly, train.scale)?;
        Ok::<_, SelectError>(Split { train: train.problem, penalty: train.penalty, test })
    })?;
    cross_validate_problems((&full.problem, &full.penalty), &splits, folds.overlap(), options, progress)
}

/// Cross-validates lambda for one task alone, with a free intercept: what scikit-learn calls `LassoLarsCV` ([`Lambdas::Knots`]), `LassoCV` and
/// `ElasticNetCV`. `penalty` is in the task's columns (that of equal penalties in raw units is `Penalty::default()`, as there).
///
/// # Errors
/// As [`cross_validate`], and when the task does not exist.
pub fn cross_validate_task(
    banks: &Banks,
    task: usize,
    penalty: &Penalty,
    folds: &Folds,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<CrossValidation, SelectError> {
    let roots = fold_roots(banks, folds, progress)?;
    let (k, tasks) = (folds.len(), roots[0].len());
    if task >= tasks {
        return Err(SelectError::NoSuchTask { task, tasks });
    }
    let full = Quadratic::from_square_root(&roots[2 * k][task], 0)?;
    let splits = parallel_map(k, progress, |fold| {
        let train = Quadratic::from_square_root(&roots[fold][task], 0)?;
        let test = HeldOut::target(roots[k + fold][task].clone(), 0)?;
        Ok::<_, SelectError>(Split { train, penalty: penalty.clone(), test })
    })?;
    cross_validate_problems((&full, penalty), &splits, folds.overlap(), options, progress)
}

/// Square-root forms of the training rows of every fold, then of the held-out rows, then of all: one product a task.
pub(super) fn fold_roots(
    banks: &Banks,
    folds: &Folds,
    progress: &dyn Progress,
) -> Result<Vec<Vec<SquareRoot>>, SelectError> {
    let (members, k) = (banks.keys().len(), folds.len());
    if folds.members() != members {
        return Err(SelectError::Members { what: "the folds", actual: folds.members(), expected: members });
    }
    let weights = Mat::from_fn(members, 2 * k + 1, |m, column| match column {
        fold if fold < k => folds.train()[(m, fold)],
        fold if fold < 2 * k => folds.test()[(m, fold - k)],
        _ => 1.0,
    });
    progress.stage("statistics of the folds");
    let grams: Vec<Vec<Gram>> = banks.tasks().iter().map(|(_, bank)| bank.combine(weights.as_ref())).collect();
    parallel_map(2 * k + 1, progress, |column| {
        let tasks = banks.tasks().iter().zip(&grams);
        Ok(tasks.map(|((preconditioner, _), grams)| preconditioner.square_root(&grams[column])).collect())
    })
}

/// Cross-validates lambda over problems made elsewhere: `full` is the problem and penalty on all rows, which a grid of lambdas starts from; `overlap`
/// says that held-out rows repeat ([`Folds::overlap`]).
///
/// # Errors
/// When an option is out of range, a fold holds out nothing or has another number of columns, or the user stops it.
pub fn cross_validate_problems(
    full: (&Quadratic, &Penalty),
    splits: &[Split],
    overlap: bool,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<CrossValidation, SelectError> {
    check(full.0, splits, options)?;
    let solver = Solver { options, columns: full.0.columns() };
    let given = match &options.lambdas {
        Lambdas::Grid { count, ratio } => Some(options.estimator.lambda_grid(full.0, full.1, *count, *ratio)?),
        Lambdas::List(list) => Some(list.clone()),
        Lambdas::Knots => None,
    };
    progress.stage("paths of the folds");
    let end = given.as_ref().map_or(0.0, |list| list.iter().copied().fold(f64::INFINITY, f64::min));
    let paths =
        parallel_map(splits.len(), progress, |fold| solver.path(&splits[fold].train, &splits[fold].penalty, end))?;
    let lambdas = sorted(given.unwrap_or_else(|| knots(&paths)));
    if lambdas.is_empty() {
        return Err(SelectError::NoLambdas);
    }
    progress.stage("held-out errors");
    let scored =
        parallel_map(splits.len(), progress, |fold| solver.score(&splits[fold], paths[fold].as_ref(), &lambdas))?;
    CrossValidation::new(lambdas, &scored, overlap)
}

/// Models of one problem at some lambdas.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct GridSolutions {
    /// Coefficients in raw units (p x lambdas).
    pub coefficients: Mat<f64>,
    /// Intercepts; 0 for problems without one.
    pub intercepts: Vec<f64>,
    /// True if the solver met its tolerance, for each lambda.
    pub exact: Vec<bool>,
}

/// The models that a fold compares: at all `lambdas` (best descending), from a piecewise-linear path or one by one, as the estimator of `options` does. Its own
/// lambdas do not count.
///
/// # Errors
/// When an option, a lambda or the penalty is out of range.
pub fn solve_grid(
    problem: &Quadratic,
    penalty: &Penalty,
    lambdas: &[f64],
    options: &SelectOptions,
) -> Result<GridSolutions, SelectError> {
    for &lambda in lambdas {
        check_strength("lambda", lambda)?;
    }
    let solver = Solver { options, columns: problem.columns() };
    let end = lambdas.iter().copied().fold(f64::INFINITY, f64::min);
    let path = if lambdas.is_empty() { None } else { solver.path(problem, penalty, end)? };
    let (solved, exact) = solver.solve(problem, penalty, path.as_ref(), lambdas)?;
    Ok(GridSolutions { coefficients: solved.values, intercepts: solved.intercepts, exact })
}

fn check(full: &Quadratic, splits: &[Split], options: &SelectOptions) -> Result<(), SelectError> {
    if let Lambdas::List(list) = &options.lambdas {
        if list.is_empty() {
            return Err(SelectError::NoLambdas);
        }
        for &lambda in list {
            check_strength("lambda", lambda)?;
        }
    }
    if splits.is_empty() {
        return Err(SelectError::FoldCount { count: 0 });
    }
    for (fold, split) in splits.iter().enumerate() {
        for columns in [split.train.columns(), split.test.coefficients()] {
            if columns != full.columns() {
                return Err(SparseError::OtherProblem { actual: columns, expected: full.columns() }.into());
            }
        }
        if split.test.weight().is_nan() || split.test.weight() <= 0.0 {
            return Err(SelectError::EmptyFold { fold, side: "test" });
        }
    }
    Ok(())
}

/// Knots of all paths, down to where the first of them ends.
fn knots(paths: &[Option<Path>]) -> Vec<f64> {
    let last = |path: &Path| path.knots.last().map_or(0.0, |knot| knot.l1);
    let end = paths.iter().flatten().map(last).fold(0.0, f64::max);
    paths.iter().flatten().flat_map(|path| &path.knots).map(|knot| knot.l1).filter(|&lambda| lambda >= end).collect()
}

/// Descending, each once.
fn sorted(mut lambdas: Vec<f64>) -> Vec<f64> {
    lambdas.sort_by(|a, b| b.total_cmp(a));
    lambdas.dedup();
    lambdas
}

struct Solver<'a> {
    options: &'a SelectOptions,
    columns: usize,
}

impl Solver<'_> {
    /// The path of a fold, where one is followed.
    fn path(&self, problem: &Quadratic, penalty: &Penalty, end: f64) -> Result<Option<Path>, SelectError> {
        let always = self.options.lambdas == Lambdas::Knots;
        Ok(self.options.estimator.knots(problem, penalty, end, always)?)
    }

    /// Errors of a fold at all lambdas: from its path, and one by one where there is none or it ended before.
    fn score(&self, split: &Split, path: Option<&Path>, lambdas: &[f64]) -> Result<Scored, SelectError> {
        let count = lambdas.len();
        let (solved, exact) = self.solve(&split.train, &split.penalty, path, lambdas)?;
        let tasks = split.test.errors(&solved);
        let nonzero = |k: usize| solved.values.col_as_slice(k).iter().filter(|value| **value != 0.0).count();
        Ok(Scored {
            errors: (0..count).map(|k| split.test.total(tasks.as_ref(), k)).collect(),
            tasks,
            features: (0..count).map(nonzero).collect(),
            exact,
            rows: [split.test.weight(), split.train.weight()],
        })
    }

    /// The solutions at all lambdas, and whether each is exact.
    fn solve(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        path: Option<&Path>,
        lambdas: &[f64],
    ) -> Result<(Coefficients, Vec<bool>), SelectError> {
        let count = lambdas.len();
        let end = path.map_or(f64::INFINITY, |path| path.knots.last().map_or(0.0, |knot| knot.l1));
        let on_path = lambdas.iter().take_while(|&&lambda| lambda >= end).count();
        let mut solved = Coefficients { values: Mat::zeros(self.columns, count), intercepts: vec![0.0; count] };
        let mut exact = vec![true; count];
        if let Some(path) = path {
            for (k, &lambda) in lambdas[..on_path].iter().enumerate() {
                let values = path.coefficients(lambda)?;
                solved.intercepts[k] = problem.intercept(values.iter().copied().enumerate());
                solved.values.col_as_slice_mut(k).copy_from_slice(&values);
            }
        }
        if on_path < count {
            let solutions: Vec<Solution> = self.options.estimator.solutions(problem, penalty, &lambdas[on_path..])?;
            for (solution, k) in solutions.iter().zip(on_path..) {
                solved.intercepts[k] = solution.intercept;
                solved.values.col_as_slice_mut(k).copy_from_slice(&solution.dense(self.columns));
                exact[k] = solution.converged;
            }
        }
        Ok((solved, exact))
    }
}
