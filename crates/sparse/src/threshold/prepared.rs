//! A problem made ready for thresholding: columns in their units, the ridge folded in.

mod bounded;

use faer::Mat;
use fleetfoot_stats::{Compressed, SquareRoot, least_squares, svd};

use super::{
    Scaling, Status, Step, StepCertificate, Terms, ThresholdError, error::not_negative, terms::Checked,
    triangle::Triangle,
};
use crate::{SparseError, kernel::norm};

/// Least ratio of a triangle to its rounding, in all directions, for plain substitution.
const CLEAR: f64 = 8.0;

/// One problem, ready for one optimiser and any of its thresholds and targets.
pub(super) struct Prepared<'a> {
    problem: &'a Compressed,
    /// `|x_j|`; 0 where it is rounding (p).
    pub(super) length: Vec<f64>,
    /// A coefficient in the units that are thresholded and penalised is `unit_j b_j` (p).
    pub(super) unit: Vec<f64>,
    /// Columns that may be used and are not zero, ascending.
    pub(super) open: Vec<usize>,
    /// For each column: true if it is always in the model (p).
    pub(super) fixed: Vec<bool>,
    /// Least and greatest value of every coefficient (p); empty where all are free.
    bounds: Vec<[f64; 2]>,
    /// Ridge on the raw coefficients (p).
    ridge: Vec<f64>,
    /// `[R; diag(sqrt(ridge))]`, raw units, and all targets.
    triangle: Triangle,
    /// R and all targets, where there is a ridge.
    plain: Option<Triangle>,
    scaling: Scaling,
}

/// Least squares on a support.
pub(super) struct Solved {
    /// Coefficients of the support, raw units.
    pub(super) values: Vec<f64>,
    /// Groups of columns that cannot be told apart.
    pub(super) confounded: Vec<Vec<usize>>,
}

impl<'a> Prepared<'a> {
    /// `alpha` is the ridge in the units of `scaling`, none on fixed columns.
    pub(super) fn new(
        problem: &'a Compressed,
        terms: &Terms,
        scaling: Scaling,
        alpha: f64,
    ) -> Result<Self, ThresholdError> {
        not_negative("alpha, the ridge,", alpha)?;
        check(problem)?;
        let Checked { open, fixed, bounds } = terms.checked(problem)?;
        let length: Vec<f64> = (0..problem.columns())
            .map(|j| norm(problem.r.col_as_slice(j)[..=j].iter().copied()))
            .zip(&problem.noise)
            .map(|(length, noise)| if length > *noise { length } else { 0.0 })
            .collect();
        let unit: Vec<f64> = match scaling {
            Scaling::Physical => vec![1.0; length.len()],
            Scaling::Length | Scaling::Share => length.clone(),
        };
        let open = open.into_iter().filter(|&j| length[j] > 0.0).collect();
        let weight = |j: usize| if fixed[j] { 0.0 } else { alpha.sqrt() * unit[j] };
        let weights: Vec<f64> = (0..unit.len()).map(weight).collect();
        let triangle = Triangle::stacked(problem.r.as_ref(), problem.z.as_ref(), &weights);
        let zeros = vec![0.0; weights.len()];
        let plain = (weights != zeros).then(|| Triangle::stacked(problem.r.as_ref(), problem.z.as_ref(), &zeros));
        let ridge = weights.iter().map(|weight| weight * weight).collect();
        Ok(Self { problem, length, unit, open, fixed, bounds, ridge, triangle, plain, scaling })
    }

    /// The problem underneath.
    pub(super) fn problem(&self) -> &'a Compressed {
        self.problem
    }

    /// Length of a target, about zero.
    pub(super) fn target_length(&self, target: usize) -> f64 {
        let z = self.problem.z.col_as_slice(target).iter().copied();
        norm(z.chain([self.problem.residual[target].max(0.0).sqrt()]))
    }

    /// Threshold on `unit_j b_j` for a threshold in the user's units.
    pub(super) fn cut(&self, threshold: f64, target: usize) -> f64 {
        if self.scaling == Scaling::Share { threshold * self.target_length(target) } else { threshold }
    }

    /// In another scaling than its own: the units of coefficients, and what a threshold of 1 is on them.
    pub(super) fn thresholded(&self, scaling: Scaling, target: usize) -> (impl Fn(usize) -> f64 + '_, f64) {
        let unit = move |j: usize| if scaling == Scaling::Physical { 1.0 } else { self.length[j] };
        (unit, if scaling == Scaling::Share { self.target_length(target) } else { 1.0 })
    }

    /// Condition number (2-norm) of the open columns in their units: what kappa multiplies in pysindy.
    pub(super) fn condition(&self) -> Result<f64, ThresholdError> {
        let (p, open) = (self.problem.columns(), &self.open);
        let entry = |i: usize, at: usize| {
            let j = open[at];
            if i <= j { self.problem.r[(i, j)] / self.unit[j] } else { 0.0 }
        };
        let values = svd(Mat::from_fn(p, open.len(), entry).as_ref()).ok_or(ThresholdError::NoCondition)?.s;
        match (values.first(), values.last()) {
            (Some(most), Some(least)) if *least > 0.0 => Ok(most / least),
            (None, _) => Ok(1.0),
            _ => Err(ThresholdError::NoCondition),
        }
    }

    /// Checks that a target exists and is finite.
    pub(super) fn check_target(&self, target: usize) -> Result<(), ThresholdError> {
        let targets = self.problem.targets();
        if target >= targets {
            return Err(SparseError::NoSuchTarget { target, targets }.into());
        }
        if self.target_length(target).is_finite() { Ok(()) } else { Err(SparseError::TargetNotFinite.into()) }
    }

    /// The triangle of some columns (ascending) for one target, with the ridge.
    pub(super) fn ridged(&self, columns: &[usize], target: usize) -> Triangle {
        self.triangle.select(columns, target)
    }

    /// The triangle of some columns (ascending) for one target, without the ridge.
    pub(super) fn plain(&self, columns: &[usize], target: usize) -> Triangle {
        self.plain.as_ref().unwrap_or(&self.triangle).select(columns, target)
    }

    /// Weight of the square of a raw coefficient.
    pub(super) fn ridge(&self, column: usize) -> f64 {
        self.ridge[column]
    }

    /// Returns true if any coefficient has bounds.
    pub(super) fn bounded(&self) -> bool {
        !self.bounds.is_empty()
    }

    /// Returns true if a coefficient may have a value.
    pub(super) fn within(&self, column: usize, value: f64) -> bool {
        self.bounds.get(column).is_none_or(|&[low, high]| low <= value && value <= high)
    }

    /// The nearest value that a coefficient may have.
    pub(super) fn clamped(&self, column: usize, value: f64) -> f64 {
        self.bounds.get(column).map_or(value, |&[low, high]| value.max(low).min(high))
    }

    /// Returns true if a coefficient is at one of its bounds.
    pub(super) fn at_bound(&self, column: usize, value: f64) -> bool {
        self.bounds.get(column).is_some_and(|bounds| bounds.contains(&value))
    }

    /// Returns true if a term is held at 0 by a bound: it is then not in the model.
    pub(super) fn held_out(&self, column: usize, value: f64) -> bool {
        value == 0.0 && !self.fixed[column] && self.at_bound(column, value)
    }

    /// Descent of the error along a coefficient in its allowed directions, half its derivative; `slope` is
    /// `x_j'(y - X b)`.
    pub(super) fn inwards(&self, column: usize, value: f64, slope: f64) -> f64 {
        match self.bounds.get(column) {
            Some(&[low, high]) if low == high => 0.0,
            Some(&[low, _]) if value == low => slope.max(0.0),
            Some(&[_, high]) if value == high => (-slope).max(0.0),
            _ => slope.abs(),
        }
    }

    /// Least squares on a triangle of `columns` within the bounds.
    pub(super) fn solve(&self, triangle: &Triangle, columns: &[usize]) -> Solved {
        let free = self.solve_free(triangle, columns);
        if self.bounded() { bounded::within_bounds(self, triangle, columns, free) } else { free }
    }

    /// Least squares on a triangle of `columns`: by substitution where every direction stands clear of rounding, else of minimum norm in units of the
    /// columns' lengths, with the columns named that cannot be told apart.
    pub(super) fn solve_free(&self, triangle: &Triangle, columns: &[usize]) -> Solved {
        let noise: Vec<f64> = columns.iter().map(|&j| self.problem.noise[j]).collect();
        let k = columns.len();
        let on_diagonal = (0..k).all(|j| triangle.r(j, j).abs() > CLEAR * noise[j]);
        if k == 0 || (on_diagonal && triangle.least(&noise) > CLEAR) {
            let mut values = triangle.z(0).to_vec();
            triangle.solve(&mut values);
            return Solved { values, confounded: Vec::new() };
        }
        let upper = |i: usize, j: usize| if i <= j { triangle.r(i, j) } else { 0.0 };
        let root = SquareRoot {
            rows: self.problem.rows,
            weight: self.problem.weight,
            mean_x: vec![0.0; k],
            mean_y: vec![0.0],
            r: Mat::from_fn(k, k, upper),
            z: Mat::from_fn(k, 1, |i, _| triangle.z(0)[i]),
            residual: vec![0.0],
            total: vec![0.0],
            condition: 1.0,
            noise: 1.0,
            magnitude: noise,
        };
        let lengths: Vec<f64> = columns.iter().map(|&j| self.length[j]).collect();
        let least_squares = least_squares(&root, &lengths);
        let name = |group: &Vec<usize>| group.iter().map(|&place| columns[place]).collect();
        Solved {
            values: least_squares.coefficients.col_as_slice(0).to_vec(),
            confounded: least_squares.confounded.iter().map(name).collect(),
        }
    }

    /// Least squares without ridge on a support.
    pub(super) fn refit(&self, columns: &[usize], target: usize) -> Solved {
        self.solve(&self.plain(columns, target), columns)
    }

    /// A model of given coefficients on a support. `ridged`: they are those of the ridge regression, else of plain least squares. Terms that a bound holds at 0 are not in it.
    pub(super) fn step(&self, target: usize, mut support: Vec<usize>, solved: Solved, ridged: bool) -> Step {
        let p = self.problem.columns();
        let mut coefficients = vec![0.0; p];
        support.iter().zip(&solved.values).for_each(|(&j, &value)| coefficients[j] = value);
        let left = self.residuals(target, &coefficients, &support);
        let rss = left.iter().map(|left| left * left).sum::<f64>() + self.problem.residual[target].max(0.0);
        let size = self.target_length(target);
        let gradient = |&j: &usize| {
            let with: f64 = self.problem.r.col_as_slice(j)[..=j].iter().zip(&left).map(|(r, left)| r * left).sum();
            let ridge = if ridged { self.ridge[j] * coefficients[j] } else { 0.0 };
            let against = self.inwards(j, coefficients[j], with - ridge);
            if size > 0.0 { against / (self.length[j] * size) } else { 0.0 }
        };
        let correlation = support.iter().map(gradient).fold(0.0, f64::max);
        support.retain(|&j| !self.held_out(j, coefficients[j]));
        Step {
            coefficients,
            support,
            rss,
            iterations: 1,
            status: Status::Converged,
            parameter: 0.0,
            err: None,
            confounded: solved.confounded,
            certificate: StepCertificate { correlation, dropped: 0.0, kept: f64::INFINITY },
        }
    }

    /// `z - R b` (p).
    pub(super) fn residuals(&self, target: usize, coefficients: &[f64], support: &[usize]) -> Vec<f64> {
        let mut left = self.problem.z.col_as_slice(target).to_vec();
        for &j in support {
            let column = &self.problem.r.col_as_slice(j)[..=j];
            left.iter_mut().zip(column).for_each(|(left, r)| *left -= r * coefficients[j]);
        }
        left
    }
}

/// Checks a problem's rows and columns.
fn check(problem: &Compressed) -> Result<(), ThresholdError> {
    if problem.weight.is_nan() || problem.weight <= 0.0 {
        return Err(SparseError::NoRows.into());
    }
    let finite = |j: &usize| problem.r.col_as_slice(*j)[..=*j].iter().all(|value| value.is_finite());
    match (0..problem.columns()).find(|j| !finite(j)) {
        Some(column) => Err(SparseError::ColumnNotFinite { column }.into()),
        None => Ok(()),
    }
}
