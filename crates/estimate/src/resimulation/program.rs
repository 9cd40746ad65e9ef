//! The convex program of a step, for the interior-point solver: quadratic in the step, with linear constraints between neighbouring rows.
//!
//! ```text
//! minimise    1/2 d'W d + (W xi)'d + nu |s|_1
//! such that   zeta + J d = s,    low <= d <= high
//! ```
//!
//! all in units of the columns' deviations. Most steps need neither s nor the bounds. s is 0 unless the region of trust
//! leaves no step that satisfies the constraints, and a step of the equations alone that stays within the bounds is the
//! solution.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultInfo, DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use fleetfoot_data::checkpoint;

use crate::EstimateError;
use crate::transcription::Defects;

/// Tolerance of the solver; the certificate judges the result.
const TOLERANCE: f64 = 1e-10;
/// Largest distance beyond a bound, in deviations, at which a step is put on it.
const NEAR: f64 = 1e-10;
/// The least unit of a program with bounds: in a smaller one they would be far away.
const BOUNDED_UNIT: f64 = 1e-3;

/// The program of a step.
pub(super) struct Program<'a> {
    pub(super) states: usize,
    pub(super) columns: usize,
    /// W (rows x columns).
    pub(super) weights: &'a [f64],
    /// W xi (rows x columns).
    pub(super) slope: &'a [f64],
    /// J; the values are those of `values`.
    pub(super) defects: &'a Defects,
    /// zeta (intervals x states).
    pub(super) values: &'a [f64],
    /// Expected multipliers (intervals x states). The solver computes the remainder, which then has as many digits as
    /// the solver gives.
    pub(super) known: &'a [f64],
    pub(super) low: &'a [f64],
    pub(super) high: &'a [f64],
}

/// A step.
pub(super) struct Step {
    pub(super) step: Vec<f64>,
    /// Multipliers of the constraints (intervals x states).
    pub(super) multipliers: Vec<f64>,
    /// Components that are at a bound, ascending, and where that is.
    pinned: Vec<(usize, f64)>,
}

/// Kind of a program.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Equations,
    Bounded,
    /// With s, of this price.
    Elastic(f64),
}

impl Program<'_> {
    /// The step; with s, of the price `nu`, only where there is none without.
    ///
    /// # Errors
    /// The solver refuses the matrices.
    pub(super) fn step(&self, nu: f64) -> Result<Step, EstimateError> {
        let within = |step: &[f64]| {
            step.iter().zip(self.low).zip(self.high).all(|((d, low), high)| d.is_finite() && d >= low && d <= high)
        };
        if let Some(step) = self.solve(Kind::Equations, &[])?.filter(|step| within(&step.step)) {
            return Ok(step);
        }
        for kind in [Kind::Bounded, Kind::Elastic(nu)] {
            let Some(mut step) = self.solve(kind, &[])? else { continue };
            // With a known set of active bounds, the step solves the equations again, to the last digits.
            if kind == Kind::Bounded {
                let pinned = std::mem::take(&mut step.pinned);
                let exact = self.solve(Kind::Equations, &pinned)?;
                let near = |d: f64, low: f64, high: f64| d >= low - NEAR && d <= high + NEAR;
                let inside = |step: &Step| {
                    step.step.iter().zip(self.low.iter().zip(self.high)).all(|(&d, (&low, &high))| near(d, low, high))
                };
                step = exact.filter(inside).unwrap_or(step);
            }
            let bounds = self.low.iter().zip(self.high);
            step.step.iter_mut().zip(bounds).for_each(|(d, (low, high))| *d = d.clamp(*low, *high));
            return Ok(step);
        }
        let (step, multipliers) = (vec![0.0; self.slope.len()], vec![0.0; self.values.len()]);
        Ok(Step { step, multipliers, pinned: Vec::new() })
    }

    /// Solves with some components of the step pinned to bounds; `None` without a solution.
    fn solve(&self, kind: Kind, pinned: &[(usize, f64)]) -> Result<Option<Step>, EstimateError> {
        let (count, constraints) = (self.slope.len(), self.values.len());
        let elastic = matches!(kind, Kind::Elastic(_));
        let slack = if elastic { 2 * constraints } else { 0 };
        let bounds = if kind == Kind::Equations { 0 } else { 2 * count };
        let equal = constraints + pinned.len();
        let none = vec![0.0; constraints];
        let known = if elastic { &none[..] } else { self.known };
        let mut linear = self.defects.transposed(self.states, known);
        linear.iter_mut().zip(self.slope).for_each(|(entry, slope)| *entry += slope);
        let mut right: Vec<f64> = self.values.iter().map(|value| -value).collect();
        right.extend(pinned.iter().map(|pin| pin.1));
        let unit = unit(linear.iter().chain(&right), if bounds > 0 { BOUNDED_UNIT } else { 0.0 });
        if let Kind::Elastic(nu) = kind {
            linear.resize(count + slack, nu);
        }
        if bounds > 0 {
            right.extend(self.high);
            right.extend(self.low.iter().map(|low| -low));
        }
        right.resize(equal + bounds + slack, 0.0);
        linear.iter_mut().chain(&mut right).for_each(|value| *value /= unit);
        let cones = [SupportedConeT::ZeroConeT(equal), SupportedConeT::NonnegativeConeT(bounds + slack)];
        let cones = &cones[..if bounds + slack > 0 { 2 } else { 1 }];
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: TOLERANCE,
            tol_gap_rel: TOLERANCE,
            tol_feas: TOLERANCE,
            presolve_enable: false,
            direct_solve_method: "qdldl".to_owned(),
            ..DefaultSettings::default()
        };
        let (quadratic, matrix) = (self.quadratic(slack), self.matrix(pinned, bounds, slack));
        let mut solver = DefaultSolver::new(&quadratic, &linear, &matrix, &right, cones, settings)
            .map_err(|error| EstimateError::Program { reason: error.to_string() })?;
        // Of long recordings a program takes seconds: a stop ends it between its iterations.
        solver.set_termination_callback(|_: &DefaultInfo<f64>| {
            checkpoint();
            false
        });
        solver.solve();
        let solution = solver.solution;
        let infeasible =
            matches!(solution.status, SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible);
        if infeasible || !solution.x.iter().chain(&solution.z).all(|value| value.is_finite()) {
            return Ok(None);
        }
        let active = |row: usize| solution.z[row] > solution.s[row];
        let pin = |at: usize| match () {
            () if active(equal + at) => Some((at, self.high[at])),
            () if active(equal + count + at) => Some((at, self.low[at])),
            () => None,
        };
        let pinned = if kind == Kind::Bounded { (0..count).filter_map(pin).collect() } else { Vec::new() };
        let multipliers = solution.z.iter().zip(known).map(|(missing, known)| known + unit * missing).collect();
        let step = solution.x[..count].iter().map(|value| unit * value).collect();
        Ok(Some(Step { step, multipliers, pinned }))
    }

    fn quadratic(&self, slack: usize) -> CscMatrix {
        let size = self.weights.len() + slack;
        let places: Vec<usize> = (0..self.weights.len()).collect();
        let starts = (0..=size).map(|j| j.min(self.weights.len())).collect();
        CscMatrix::new(size, size, starts, places, self.weights.to_vec())
    }

    /// The constraints by columns: those of the interval before a row, those of the interval behind it, pins, bounds.
    /// Of s its place among the constraints, and its sign.
    fn matrix(&self, pinned: &[(usize, f64)], bounds: usize, slack: usize) -> CscMatrix {
        let (n, c, count, constraints) = (self.states, self.columns, self.slope.len(), self.values.len());
        let equal = constraints + pinned.len();
        let mut pins = pinned.iter().map(|pin| pin.0).zip(constraints..).peekable();
        let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
        for column in 0..count {
            let (k, j) = (column / c, column % c);
            let blocks = [(k.checked_sub(1), &self.defects.behind), (Some(k), &self.defects.before)];
            for (interval, block) in blocks {
                let Some(interval) = interval.filter(|&interval| (interval + 1) * n <= constraints) else { continue };
                for row in interval * n..(interval + 1) * n {
                    places.push(row);
                    values.push(block[row * c + j]);
                }
            }
            if let Some((_, row)) = pins.next_if(|pin| pin.0 == column) {
                places.push(row);
                values.push(1.0);
            }
            if bounds > 0 {
                places.extend([equal + column, equal + count + column]);
                values.extend([1.0, -1.0]);
            }
            starts.push(places.len());
        }
        for at in 0..slack {
            places.extend([at % constraints, equal + bounds + at]);
            values.extend([if at < constraints { -1.0 } else { 1.0 }, -1.0]);
            starts.push(places.len());
        }
        CscMatrix::new(equal + bounds + slack, count + slack, starts, places, values)
    }
}

/// The unit of a program's right sides. The step and the multipliers are proportional to them, and the solver's
/// tolerance is for numbers of the order of 1. In this unit a small step has as many digits as a large one.
fn unit<'a>(sides: impl Iterator<Item = &'a f64>, least: f64) -> f64 {
    let largest = sides.fold(least, |largest, value| largest.max(value.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}
