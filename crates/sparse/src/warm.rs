//! The lasso at one lambda from a guess of its active set: for resamples, whose solutions differ in a column or two.

use fleetfoot_data::checkpoint;

use crate::{
    Penalty, Quadratic, Sign, Solution, SparseError,
    factor::Factor,
    penalty::{Weights, check_strength},
    solution::{Point, finish},
};

/// The largest violation of the optimality conditions, as a correlation, that a solution found in this way may have.
const CERTIFIED: f64 = 1e-10;

/// The solution at lambda, found by exchanges from the columns `guess` with their signs: with the active set S and signs s the coefficients are those
/// of `A_S'A_S x = A_S'z - lambda omega s`; the column with the wrong sign farthest out leaves, else the inactive column with the largest violation
/// enters, until the optimality conditions hold.
///
/// `None` where that does not end, where columns depend on each other, and where signs are constrained: a path is the way then.
pub(crate) fn lasso_from(
    problem: &Quadratic,
    penalty: &Penalty,
    lambda: f64,
    guess: &[(usize, f64)],
) -> Result<Option<Solution>, SparseError> {
    check_strength("lambda", lambda)?;
    let weights = Weights::new(problem, penalty)?;
    if weights.signs.iter().any(|sign| *sign != Sign::Free) {
        return Ok(None);
    }
    let Some(delta) = exchange(problem, &weights, lambda / weights.tau, guess) else { return Ok(None) };
    let solution = finish(problem, &weights, vec![Point { l1: lambda, l2: 0.0, delta, converged: true }]);
    Ok(solution.into_iter().next().filter(|solution| solution.certificate.kkt <= CERTIFIED))
}

/// Coefficients in correlation form.
fn exchange(problem: &Quadratic, weights: &Weights, lambda: f64, guess: &[(usize, f64)]) -> Option<Vec<(usize, f64)>> {
    let p = problem.columns();
    let mut factor = Factor::new(problem, weights, 0.0);
    let mut side = vec![0.0; p];
    let free = (0..p).filter(|&j| weights.omega[j] == 0.0).map(|j| (j, 0.0));
    let guessed = guess.iter().copied().filter(|&(j, _)| weights.used(j) && weights.omega[j] > 0.0);
    for (j, sign) in free.chain(guessed) {
        if !factor.append(j, sign) {
            return None;
        }
        side[j] = sign;
    }
    for _ in 0..2 * p + 10 {
        checkpoint();
        let (x, y) = factor.solutions();
        let delta: Vec<f64> = x.iter().zip(&y).map(|(x, y)| x - lambda * y).collect();
        let wrong = |place: usize| {
            let side = side[factor.order[place]];
            if side == 0.0 { f64::NEG_INFINITY } else { -side * delta[place] }
        };
        let worst = (0..delta.len()).max_by(|&a, &b| wrong(a).total_cmp(&wrong(b)));
        if let Some(place) = worst.filter(|&place| wrong(place) >= 0.0) {
            side[factor.order[place]] = 0.0;
            factor.remove(place);
            continue;
        }
        let noise = factor.noise();
        let mut enters: Option<(usize, f64, f64)> = None;
        for j in (0..p).filter(|&j| weights.used(j) && !factor.is_active(j)) {
            let correlation = factor.left(j) + lambda * factor.rate(j);
            let limit = lambda * weights.omega[j];
            let violation = correlation.abs() - limit;
            let rounding = 4.0 * (noise + problem.noise[j]) + 32.0 * f64::EPSILON * limit;
            if violation > rounding && enters.is_none_or(|(_, _, worst)| violation > worst) {
                enters = Some((j, correlation.signum(), violation));
            }
        }
        let Some((j, sign, _)) = enters else {
            return Some(factor.order.iter().copied().zip(delta).collect());
        };
        if !factor.append(j, sign) {
            return None;
        }
        side[j] = sign;
    }
    None
}
