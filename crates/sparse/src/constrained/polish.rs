//! From an interior point to a minimiser with the digits that the data have. The active constraints, signs and zeros
//! are taken from the point, and the problem with these as equalities is solved by orthogonal factors. The guess is
//! corrected until the conditions of the minimum hold.

use faer::{Mat, MatRef};
use fleetfoot_stats::{Svd, svd};

use super::scaled::{Scaled, product, rank_level};
use crate::kernel::norm;

/// Coefficients (k) and multipliers (rows) in correlation form.
#[derive(Debug, Clone)]
pub(super) struct Point {
    pub(super) delta: Vec<f64>,
    pub(super) multipliers: Vec<f64>,
}

/// Guess of the active set at the minimum.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Guess {
    /// Rows that hold with equality, the surest first.
    pub(super) active: Vec<usize>,
    /// Sign of every penalised coefficient, 0 for zero; 1 for those that are not penalised.
    pub(super) signs: Vec<f64>,
}

impl Guess {
    /// From an interior point, the rows that are active there and the coefficients that are zero.
    pub(super) fn new(scaled: &Scaled, point: &Point, active: &[bool], zero: &[bool]) -> Self {
        let row = |at: usize| &scaled.rows[at];
        let multiplier = |at: usize| point.multipliers[at];
        let mut active: Vec<usize> = (0..scaled.rows.len()).filter(|&at| active[at]).collect();
        active.sort_by(|&a, &b| row(b).equality.cmp(&row(a).equality).then(multiplier(b).total_cmp(&multiplier(a))));
        let sign = |c: usize| match scaled.limit[c] > 0.0 {
            true if zero[c] => 0.0,
            true => point.delta[c].signum(),
            false => 1.0,
        };
        Self { active, signs: (0..point.delta.len()).map(sign).collect() }
    }
}

/// Rows whose forms differ from those of the rows before by less than this are spared: what they say is said.
const INDEPENDENT: f64 = 1e-9;

/// Rounding of slacks and forces, relative to the terms that make them.
const ROUNDING: f64 = 1e-12;

/// Solves and mends until nothing is wrong; `None` when that does not come to an end.
pub(super) fn polish(scaled: &Scaled, mut guess: Guess) -> Option<Point> {
    let limit = 20 + 2 * (scaled.columns.len() + scaled.rows.len()).min(90);
    for _ in 0..limit {
        let (point, used) = solve(scaled, &guess)?;
        if !mend(scaled, &point, &used, &mut guess) {
            return Some(point);
        }
    }
    None
}

/// The minimiser with the active rows as equalities, the zeros at zero and the signs as they are; the rows that were not spared.
fn solve(scaled: &Scaled, guess: &Guess) -> Option<(Point, Vec<usize>)> {
    let free: Vec<usize> = (0..scaled.columns.len()).filter(|&c| guess.signs[c] != 0.0).collect();
    let used = independent(scaled, &guess.active, &free);
    let (f, w) = (free.len(), used.len());
    let c = Mat::from_fn(w, f, |i, j| scaled.rows[used[i]].coefficients[free[j]]);
    let rows = svd(c.as_ref())?;
    let bounds: Vec<f64> = used.iter().map(|&at| scaled.rows[at].bound).collect();
    let particular = pseudo_solve(&rows, w, &bounds);
    // The rest lies in the null space N of the active rows: least squares there, with the pull of the penalty.
    let a = Mat::from_fn(scaled.z.len(), f, |i, j| scaled.a[(i, free[j])]);
    let inside = rows.v.as_ref().subcols(w, f - w);
    let reduced = &a * inside;
    let factors = svd(reduced.as_ref())?;
    let known = scaled.residual(&spread(scaled, &free, &particular));
    let pull: Vec<f64> = free.iter().map(|&c| scaled.limit[c] * guess.signs[c]).collect();
    let pull = transposed(inside, &pull);
    let least = factors.s.first().map_or(0.0, |largest| largest.max(1.0)) * rank_level(f);
    let mut within = vec![0.0; f - w];
    for (i, &s) in factors.s.iter().enumerate().filter(|(_, s)| **s > least) {
        let v = factors.v.col_as_slice(i);
        let along = product(factors.u.col_as_slice(i), &known) / s - product(v, &pull) / s / s;
        within.iter_mut().zip(v).for_each(|(within, v)| *within += along * v);
    }
    let mut values = particular;
    for (i, &step) in within.iter().enumerate() {
        values.iter_mut().zip(inside.col(i).iter()).for_each(|(value, n)| *value += step * n);
    }
    let delta = spread(scaled, &free, &values);
    let forces = scaled.forces(&scaled.residual(&delta), &[]);
    let wanted: Vec<f64> = free.iter().map(|&c| scaled.limit[c] * guess.signs[c] - forces[c]).collect();
    let mut multipliers = vec![0.0; scaled.rows.len()];
    for (i, &s) in rows.s.iter().enumerate() {
        let along = product(rows.v.col_as_slice(i), &wanted) / s;
        used.iter().zip(rows.u.col_as_slice(i)).for_each(|(&at, u)| multipliers[at] += along * u);
    }
    Some((Point { delta, multipliers }, used))
}

/// `C^+ bounds` for independent rows.
fn pseudo_solve(factors: &Svd, rows: usize, bounds: &[f64]) -> Vec<f64> {
    let mut solution = vec![0.0; factors.v.nrows()];
    for i in 0..rows {
        let along = product(factors.u.col_as_slice(i), bounds) / factors.s[i];
        solution.iter_mut().zip(factors.v.col_as_slice(i)).for_each(|(value, v)| *value += along * v);
    }
    solution
}

fn transposed(matrix: MatRef<'_, f64>, x: &[f64]) -> Vec<f64> {
    (0..matrix.ncols()).map(|j| matrix.col(j).iter().zip(x).map(|(m, x)| m * x).sum()).collect()
}

fn spread(scaled: &Scaled, free: &[usize], values: &[f64]) -> Vec<f64> {
    let mut delta = vec![0.0; scaled.columns.len()];
    free.iter().zip(values).for_each(|(&c, &value)| delta[c] = value);
    delta
}

/// Rows that are independent over the free columns, the earlier ones preferred (Gram-Schmidt, twice).
fn independent(scaled: &Scaled, active: &[usize], free: &[usize]) -> Vec<usize> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut used = Vec::new();
    for &at in active {
        if used.len() == free.len() {
            break;
        }
        let mut form: Vec<f64> = free.iter().map(|&c| scaled.rows[at].coefficients[c]).collect();
        for _ in 0..2 {
            for known in &basis {
                let share = product(known, &form);
                form.iter_mut().zip(known).for_each(|(value, known)| *value -= share * known);
            }
        }
        let length = norm(form.iter().copied());
        if length > INDEPENDENT {
            form.iter_mut().for_each(|value| *value /= length);
            basis.push(form);
            used.push(at);
        }
    }
    used
}

/// Changes the guess where the point breaks a condition of the minimum: whether it did.
///
/// Broken bounds and signs come first: while there are any, multipliers say nothing.
fn mend(scaled: &Scaled, point: &Point, used: &[usize], guess: &mut Guess) -> bool {
    let mut changed = false;
    for (c, sign) in guess.signs.iter_mut().enumerate().filter(|(c, sign)| scaled.limit[*c] > 0.0 && **sign != 0.0) {
        if point.delta[c] * *sign < 0.0 {
            *sign = 0.0;
            changed = true;
        }
    }
    let violation = |at: usize| {
        let row = &scaled.rows[at];
        let size: f64 = row.coefficients.iter().zip(&point.delta).map(|(c, delta)| (c * delta).abs()).sum();
        let slack = row.slack(&point.delta);
        let broken = if row.equality { slack.abs() } else { -slack };
        if broken > ROUNDING * (size + row.bound.abs()) + f64::MIN_POSITIVE { broken } else { 0.0 }
    };
    let outside = (0..scaled.rows.len()).filter(|at| !used.contains(at));
    if let Some((worst, _)) =
        outside.map(|at| (at, violation(at))).filter(|(_, broken)| *broken > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
    {
        guess.active.retain(|&at| at != worst);
        let equalities = guess.active.iter().filter(|&&at| scaled.rows[at].equality).count();
        let place = if scaled.rows[worst].equality { 0 } else { equalities };
        guess.active.insert(place, worst);
        changed = true;
    }
    if changed {
        return true;
    }
    let forces = scaled.forces(&scaled.residual(&point.delta), &point.multipliers);
    let largest = point.multipliers.iter().fold(1.0_f64, |largest, value| largest.max(value.abs()));
    let pulled = (0..forces.len()).filter(|&c| guess.signs[c] == 0.0).map(|c| (c, forces[c].abs() - scaled.limit[c]));
    if let Some((c, _)) = pulled.filter(|(_, excess)| *excess > ROUNDING * largest).max_by(|a, b| a.1.total_cmp(&b.1)) {
        guess.signs[c] = forces[c].signum();
        return true;
    }
    let negative = used.iter().filter(|&&at| !scaled.rows[at].equality && point.multipliers[at] < -ROUNDING * largest);
    if let Some(&worst) = negative.min_by(|&&a, &&b| point.multipliers[a].total_cmp(&point.multipliers[b])) {
        guess.active.retain(|&at| at != worst);
        return true;
    }
    false
}
