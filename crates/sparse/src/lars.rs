//! Least angle regression and its lasso modification: the whole path, knot by knot.

use crate::{
    Path, PathStatus, Penalty, Quadratic, Sign, Solution, SparseError,
    estimator::Estimator,
    homotopy::{Homotopy, Settled},
    penalty::{Weights, check_strength},
    solution::{Point, finish},
};

/// The largest violation of the optimality conditions, as a correlation, that a knot may have.
const CERTIFIED: f64 = 1e-8;

/// Kind of path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// The minimisers of the objective: columns leave where their coefficients reach zero.
    #[default]
    Lasso,
    /// Least angle regression: columns stay once they are in. The certificates are those of the lasso, so they show where the paths differ.
    Lars,
}

/// Options and end of a path.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LarsOptions {
    /// Kind of path.
    pub method: Method,
    /// Weight of the squares, the same along the path (elastic net).
    pub l2: f64,
    /// End of the path: the smallest lambda, in the units of the target.
    pub lambda_min: f64,
    /// The most columns with coefficients that are not zero; `None`: all.
    pub max_features: Option<usize>,
    /// The most knots; `None`: 50 a column, and at least 1000.
    pub max_knots: Option<usize>,
}

/// The path over lambda of the minimisers of
///
/// `1/(2n) sum s (y - x'b - b0)^2 + lambda sum_j w_j |u_j b_j| + l2/2 sum_j w_j (u_j b_j)^2`
///
/// with its exact knots, from the lambda where the first penalised column enters down to [`LarsOptions::lambda_min`] (Efron, Hastie, Johnstone,
/// Tibshirani 2004, section 3.1; Osborne, Presnell, Turlach 2000). Where several columns reach the bound at once, or one would enter and leave at the
/// same knot, the direction of the path is the solution of a non-negative least-squares problem among them. Duplicated and dependent columns stay out,
/// the first in order of entry (then of index) goes in; the fit is the same whichever does.
///
/// Every knot carries its certificate, and a lasso path ends ([`PathStatus::Stalled`]) before the first whose violation is above 1e-8: in Gram form
/// that may happen from condition numbers of 1e7 on; the square-root form goes on. Cost: about `p k` operations for a knot with k active columns in Gram form, `p m + 4 m k` with m compressed rows.
///
/// # Errors
/// When the penalty or an option is out of range, or plain LARS is asked to watch signs.
pub fn lars(problem: &Quadratic, penalty: &Penalty, options: &LarsOptions) -> Result<Path, SparseError> {
    check_strength("lambda_min", options.lambda_min)?;
    check_strength("l2", options.l2)?;
    let weights = Weights::new(problem, penalty)?;
    let constrained = weights.signs.iter().position(|&sign| sign != Sign::Free);
    if let (Method::Lars, Some(column)) = (options.method, constrained) {
        return Err(SparseError::SignsNeedLasso { column });
    }
    let watch = options.method == Method::Lasso;
    let mut homotopy = Homotopy::new(problem, &weights, options.l2, watch, options.max_features.unwrap_or(usize::MAX));
    let (points, status) = follow(problem, &mut homotopy, &weights, options);
    let collinear = homotopy.collinear();
    let left = (0..problem.columns()).filter(|&j| weights.used(j)).count() - homotopy.active();
    let mut knots = finish(problem, &weights, points);
    let mut status = status;
    // The path ends once the condition number has used up all digits: later knots are noise.
    if let Some(first) =
        knots.iter().position(|knot| watch && (knot.certificate.kkt > CERTIFIED || knot.certificate.kkt.is_nan()))
    {
        knots.truncate(first.max(1));
        status = PathStatus::Stalled;
    }
    let interpolates = knots.last().is_some_and(|knot| 1.0 - knot.r2 <= 1e-20) && problem.target_deviation() > 0.0;
    let saturated = status == PathStatus::Complete && interpolates && left > 0 && collinear.len() == left;
    Ok(Path {
        knots,
        status: if saturated { PathStatus::Saturated } else { status },
        collinear,
        constant: problem.constant(),
        columns: problem.columns(),
        penalty: penalty.clone(),
        l2: options.l2,
        estimator: Estimator::default(),
        linear: true,
    })
}

/// The solution at one lambda: the end of the path that stops there, the only point of it that is certified. `None` when rounding ends the path
/// before, or hides how good the end is.
pub(crate) fn lasso_at(problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<Option<Solution>, SparseError> {
    check_strength("lambda", lambda)?;
    let weights = Weights::new(problem, penalty)?;
    let mut homotopy = Homotopy::new(problem, &weights, 0.0, true, usize::MAX);
    let options = LarsOptions { lambda_min: lambda, ..LarsOptions::default() };
    let (mut points, _) = follow(problem, &mut homotopy, &weights, &options);
    let last = points.pop().filter(|point| point.l1 == lambda);
    let solution = finish(problem, &weights, last.into_iter().collect());
    Ok(solution.into_iter().next().filter(|solution| solution.certificate.kkt <= CERTIFIED))
}

fn follow(
    problem: &Quadratic,
    homotopy: &mut Homotopy<'_>,
    weights: &Weights,
    options: &LarsOptions,
) -> (Vec<Point>, PathStatus) {
    let end = options.lambda_min / weights.tau;
    let most = options.max_knots.unwrap_or(1000.max(50 * problem.columns())).max(1);
    let started = homotopy.start();
    let mut lambda = homotopy.lambda_max().max(end);
    let point = |lambda: f64, delta: Vec<(usize, f64)>| {
        // The end is what was asked for, to the bit.
        let l1 = if lambda == end { options.lambda_min } else { lambda * weights.tau };
        Point { l1, l2: options.l2, delta, converged: true }
    };
    let mut points = vec![point(lambda, homotopy.coefficients(lambda))];
    if started == Settled::Stalled {
        return (points, PathStatus::Stalled);
    }
    // Steps without progress: each changes the active set, and rounding may make it go in circles.
    let mut idle = 0;
    while lambda > end {
        homotopy.drop_zeros(lambda);
        match homotopy.settle(lambda) {
            Settled::Done => {}
            Settled::Full => return (points, PathStatus::MaxFeatures),
            Settled::Stalled => return (points, PathStatus::Stalled),
        }
        let next = homotopy.next(lambda);
        // A knot that only rounding tells from the end is the end.
        let next = if next <= end * (1.0 + 8.0 * f64::EPSILON) { end } else { next };
        idle = if next < lambda { 0 } else { idle + 1 };
        if idle > 2 * problem.columns() + 10 {
            return (points, PathStatus::Stalled);
        }
        if next < lambda {
            if points.len() >= most {
                return (points, PathStatus::MaxKnots);
            }
            points.push(point(next, homotopy.coefficients(next)));
        }
        lambda = next;
    }
    (points, if options.lambda_min > 0.0 { PathStatus::LambdaMin } else { PathStatus::Complete })
}
