//! The convex program for the interior-point solver, in coordinates where its quadratic part is the identity.
//!
//! With A = U S V' and delta = V S^-1 u the quadratic part is `1/2 |u - U'z|^2`: whatever the condition of A, only the constraints carry it, and
//! every row of them is scaled to unit length again. Directions that A does not see keep their own coordinate and next to no weight.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use faer::Mat;
use fleetfoot_data::checkpoint;

use super::{
    ConstrainedError,
    scaled::{Row, Scaled, product},
};
use crate::kernel::norm;

/// Weight of the directions that A does not see: least norm where nothing else decides.
const UNSEEN: f64 = 1e-9;
/// Tolerance of the interior-point solver; its result is judged by the certificate.
const TOLERANCE: f64 = 1e-11;

/// Result of the interior-point solver.
pub(super) enum Outcome {
    /// Coefficients (k), multipliers (rows), rows that hold with equality (rows), penalised coefficients that are zero (k).
    Point { delta: Vec<f64>, multipliers: Vec<f64>, active: Vec<bool>, zero: Vec<bool> },
    /// The constraints contradict each other.
    Infeasible,
}

/// A program `1/2 x'Px + q'x` with rows `g'x >= h`, or equal.
struct Builder {
    diagonal: Vec<f64>,
    linear: Vec<f64>,
    rows: Vec<(Vec<(usize, f64)>, f64)>,
}

impl Builder {
    /// Solves it with the first `equalities` rows as equalities: x, multipliers, slacks, status.
    fn solve(&self, equalities: usize, max_iterations: u32) -> Result<Solved, ConstrainedError> {
        let (size, count) = (self.diagonal.len(), self.rows.len());
        let diagonal = || self.diagonal.iter().enumerate().filter(|(_, value)| **value != 0.0);
        let quadratic = CscMatrix::new_from_triplets(
            size,
            size,
            diagonal().map(|(i, _)| i).collect(),
            diagonal().map(|(i, _)| i).collect(),
            diagonal().map(|(_, value)| *value).collect(),
        );
        let entries = || self.rows.iter().enumerate().flat_map(|(i, (row, _))| row.iter().map(move |entry| (i, entry)));
        let constraints = CscMatrix::new_from_triplets(
            count,
            size,
            entries().map(|(i, _)| i).collect(),
            entries().map(|(_, (j, _))| *j).collect(),
            entries().map(|(_, (_, value))| -value).collect(),
        );
        let bounds: Vec<f64> = self.rows.iter().map(|(_, bound)| -bound).collect();
        let cones = [SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(count - equalities)];
        let settings = DefaultSettings {
            verbose: false,
            max_iter: max_iterations,
            tol_gap_abs: TOLERANCE,
            tol_gap_rel: TOLERANCE,
            tol_feas: TOLERANCE,
            presolve_enable: false,
            direct_solve_method: "qdldl".to_owned(),
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&quadratic, &self.linear, &constraints, &bounds, &cones, settings)
            .map_err(|error| ConstrainedError::Program { reason: error.to_string() })?;
        // A stop ends a long program between its iterations.
        solver.set_termination_callback(|_: &DefaultInfo<f64>| {
            checkpoint();
            false
        });
        solver.solve();
        let solution = solver.solution;
        Ok(Solved { x: solution.x, multipliers: solution.z, slacks: solution.s, status: solution.status })
    }
}

struct Solved {
    x: Vec<f64>,
    multipliers: Vec<f64>,
    slacks: Vec<f64>,
    status: SolverStatus,
}

impl Solved {
    fn infeasible(&self) -> bool {
        matches!(self.status, SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible)
    }
}

/// delta = W u (k x k): V S^-1, and V for directions that A does not see.
fn coordinates(scaled: &Scaled) -> Mat<f64> {
    let k = scaled.columns.len();
    Mat::from_fn(k, k, |j, i| scaled.svd.v[(j, i)] / if i < scaled.rank { scaled.svd.s[i] } else { 1.0 })
}

/// Minimises the scaled problem.
pub(super) fn solve(scaled: &Scaled, max_iterations: u32) -> Result<Outcome, ConstrainedError> {
    let k = scaled.columns.len();
    let w = coordinates(scaled);
    let penalised: Vec<usize> = (0..k).filter(|&c| scaled.limit[c] > 0.0).collect();
    let mut builder = Builder { diagonal: Vec::new(), linear: Vec::new(), rows: Vec::new() };
    for i in 0..k {
        let seen = i < scaled.rank;
        builder.diagonal.push(if seen { 1.0 } else { UNSEEN });
        builder.linear.push(if seen { -product(scaled.svd.u.col_as_slice(i), &scaled.z) } else { 0.0 });
    }
    let order = equalities_first(&scaled.rows);
    let equalities = scaled.rows.iter().filter(|row| row.equality).count();
    let mut lengths = Vec::with_capacity(order.len());
    for &at in &order {
        let row = &scaled.rows[at];
        let mut form: Vec<f64> = (0..k).map(|i| product(w.col_as_slice(i), &row.coefficients)).collect();
        let length = norm(form.iter().copied());
        form.iter_mut().for_each(|value| *value /= length);
        builder.rows.push((form.into_iter().enumerate().collect(), row.bound / length));
        lengths.push(length);
    }
    // |delta_c| <= length t: t is what is penalised.
    for (extra, &c) in penalised.iter().enumerate() {
        let form: Vec<f64> = (0..k).map(|i| w[(c, i)]).collect();
        let length = norm(form.iter().copied());
        builder.diagonal.push(0.0);
        builder.linear.push(scaled.limit[c] * length);
        for side in [1.0, -1.0] {
            let entries = form.iter().enumerate().map(|(i, value)| (i, side * value / length));
            builder.rows.push((entries.chain([(k + extra, 1.0)]).collect(), 0.0));
        }
    }
    let solved = builder.solve(equalities, max_iterations)?;
    if solved.infeasible() {
        return Ok(Outcome::Infeasible);
    }
    let x: Vec<f64> = solved.x[..k].iter().map(|&x| if x.is_finite() { x } else { 0.0 }).collect();
    let mut delta = vec![0.0; k];
    for (i, x) in x.iter().enumerate() {
        delta.iter_mut().zip(w.col_as_slice(i)).for_each(|(delta, w)| *delta += w * x);
    }
    let (mut multipliers, mut active) = (vec![0.0; order.len()], vec![false; order.len()]);
    for (place, &at) in order.iter().enumerate() {
        multipliers[at] = solved.multipliers[place] / lengths[place];
        // Complementary numbers: the larger one is the one that is not zero, both in the problem's units: a row's length carries the condition of A.
        let slack = solved.slacks[place] * lengths[place];
        active[at] = scaled.rows[at].equality || multipliers[at] > slack;
    }
    // Both sides of |delta| <= t hold with equality where the coefficient is 0, and share the penalty; elsewhere one of them has all of it.
    let mut zero = vec![false; k];
    for (extra, &c) in penalised.iter().enumerate() {
        let first = order.len() + 2 * extra;
        let (upper, lower) = (solved.multipliers[first], solved.multipliers[first + 1]);
        zero[c] = upper.min(lower) > delta[c].abs() * (upper + lower);
    }
    Ok(Outcome::Point { delta, multipliers, active, zero })
}

fn equalities_first(rows: &[Row]) -> Vec<usize> {
    let of = |equality: bool| (0..rows.len()).filter(move |&i| rows[i].equality == equality);
    of(true).chain(of(false)).collect()
}

/// A set of rows that contradict each other, no row of which can be spared; empty when they do not, as far as the solver can tell.
///
/// The multipliers of the proof of infeasibility name the candidates; then every candidate is left out in turn, and stays out when the others
/// contradict each other without it (the deletion filter of Chinneck and Dravnieks 1991).
pub(super) fn contradiction(rows: &[Row], max_iterations: u32) -> Result<Vec<usize>, ConstrainedError> {
    let all: Vec<usize> = (0..rows.len()).collect();
    let Some(mut left) = proof(rows, &all, max_iterations)? else {
        return Ok(Vec::new());
    };
    let mut at = 0;
    while at < left.len() {
        let mut without = left.clone();
        without.remove(at);
        match proof(rows, &without, max_iterations)? {
            Some(fewer) => {
                left = without.into_iter().filter(|row| fewer.contains(row) || left[..at].contains(row)).collect()
            }
            None => at += 1,
        }
    }
    Ok(left)
}

/// The rows that take part in a proof that `chosen` contradict each other, if there is one.
fn proof(rows: &[Row], chosen: &[usize], max_iterations: u32) -> Result<Option<Vec<usize>>, ConstrainedError> {
    let k = rows.first().map_or(0, |row| row.coefficients.len());
    let mut order = chosen.to_vec();
    order.sort_by_key(|&at| (!rows[at].equality, at));
    let of = |&at: &usize| (rows[at].coefficients.iter().copied().enumerate().collect(), rows[at].bound);
    let builder = Builder { diagonal: vec![1.0; k], linear: vec![0.0; k], rows: order.iter().map(of).collect() };
    let equalities = order.iter().filter(|&&at| rows[at].equality).count();
    let solved = builder.solve(equalities, max_iterations)?;
    if !solved.infeasible() {
        return Ok(None);
    }
    let largest = solved.multipliers.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let involved = order.iter().zip(&solved.multipliers).filter(|(_, value)| value.abs() > 1e-6 * largest);
    let mut involved: Vec<usize> = involved.map(|(&at, _)| at).collect();
    involved.sort_unstable();
    Ok(Some(involved))
}
