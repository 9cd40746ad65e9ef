//! The best beginning of one segment at given parameters, and the derivatives without its part.

// Matrices are capitals.
#![allow(non_snake_case)]

use std::cell::RefCell;

use faer::{Mat, MatRef};
use fleetfoot_data::Block;
use fleetfoot_dynamics::{Stretch, StretchPath, Stretches};
use fleetfoot_stats::{kernel::norm, svd};

use crate::{
    EstimateError, Options,
    descent::Descent,
    evaluate::{Evaluation, Objective, Pass},
    products::compressed,
    step::rank_level,
};

/// A segment with its rows.
pub(super) struct Segment<'a> {
    pub(super) stretches: &'a Stretches<'a>,
    pub(super) block: &'a Block,
    pub(super) stretch: Stretch,
    /// Of every state, `1 / sigma` where it is compared, else 0.
    pub(super) scale: &'a [f64],
    /// Of every state, by how much measurements correct the simulation; none by output error.
    pub(super) gains: &'a [f64],
    /// When the search for a beginning ends.
    pub(super) search: Options,
    /// Without bounds (n).
    pub(super) bounds: &'a [[f64; 2]],
    /// The last simulation.
    pub(super) last: RefCell<Option<(Vec<f64>, StretchPath)>>,
}

/// The derivatives of a segment's residuals and the residuals themselves, by columns: rows times outputs each, missing ones 0.
pub(super) struct Residuals {
    /// Measured less simulated over sigma.
    pub(super) values: Vec<f64>,
    /// Of every value, whether it was measured.
    pub(super) there: Vec<bool>,
    /// By the parameters, and the gains of the compared states (p).
    pub(super) by_parameters: Mat<f64>,
    /// By the beginning (n).
    pub(super) by_beginning: Mat<f64>,
    /// Sum of the squares of the measurements, in these units.
    pub(super) size: f64,
}

/// A segment at its best beginning.
pub(super) struct Best {
    pub(super) beginning: Vec<f64>,
    /// Derivatives of the beginning by the parameters (n x p).
    pub(super) response: Mat<f64>,
    /// The derivatives by the parameters are those that no beginning takes up.
    pub(super) residuals: Residuals,
}

/// When a search for a beginning ends, to the last digits or not.
pub(super) fn search(exact: bool) -> Options {
    let [gradient, step, cost] = if exact { [1e-9, 1e-12, 1e-14] } else { [1e-4, 1e-6, 1e-8] };
    Options { gradient, step, cost, max_iterations: 50, ..Options::default() }
}

impl Segment<'_> {
    /// Searches from `guess`; `None` where the simulation diverges there.
    pub(super) fn best(&self, guess: Vec<f64>) -> Result<Option<Best>, EstimateError> {
        let Pass::Finite(at) = self.evaluate(&guess)? else { return Ok(None) };
        let mut descent = Descent::from(self, guess, at, &self.search)?;
        descent.run()?;
        let beginning = descent.theta;
        let Some(path) = self.path(&beginning) else { return Ok(None) };
        let mut residuals = self.residuals(&beginning, &path, true);
        let Some(response) = eliminate(&mut residuals) else { return Err(EstimateError::Overflow) };
        Ok(Some(Best { beginning, response, residuals }))
    }

    /// The simulation from a beginning, which the last one may have been.
    fn path(&self, beginning: &[f64]) -> Option<StretchPath> {
        match self.last.take() {
            Some((known, path)) if known == beginning => Some(path),
            _ => self.simulated(beginning),
        }
    }

    fn simulated(&self, beginning: &[f64]) -> Option<StretchPath> {
        self.stretches.simulate(self.block, self.stretch, beginning, self.gains)
    }

    /// Residuals, with the derivatives by the parameters on request.
    fn residuals(&self, beginning: &[f64], path: &StretchPath, parameters: bool) -> Residuals {
        let (n, rows) = (beginning.len(), self.stretch.steps + 1);
        let width = path.by_coefficients.len() / (rows * n);
        let compared: Vec<usize> = (0..n).filter(|&s| self.scale[s] > 0.0).collect();
        let gains = if self.gains.is_empty() { 0 } else { compared.len() };
        let p = if parameters { width + gains } else { 0 };
        let cells: Vec<usize> = (0..rows).flat_map(|row| compared.iter().map(move |s| row * n + s)).collect();
        let there: Vec<bool> = cells.iter().map(|&cell| path.errors[cell].is_finite()).collect();
        let scale = |at: usize| if there[at] { self.scale[cells[at] % n] } else { 0.0 };
        let values = |at: usize| if there[at] { scale(at) * path.errors[cells[at]] } else { 0.0 };
        Residuals {
            values: (0..cells.len()).map(values).collect(),
            by_parameters: Mat::from_fn(cells.len(), p, |at, j| {
                -scale(at)
                    * match j.checked_sub(width) {
                        None => path.by_coefficients[cells[at] * width + j],
                        Some(gain) => path.by_gains[cells[at] * n + compared[gain]],
                    }
            }),
            by_beginning: Mat::from_fn(cells.len(), n, |at, j| -scale(at) * path.by_beginning[cells[at] * n + j]),
            // Measurements are of the order of the first values: a bound for rounding, and no more.
            size: compared.iter().map(|&s| rows as f64 * (self.scale[s] * beginning[s]).powi(2)).sum(),
            there,
        }
    }
}

impl Objective for Segment<'_> {
    fn bounds(&self) -> &[[f64; 2]] {
        self.bounds
    }

    fn residuals(&self) -> usize {
        1
    }

    /// Parts of a beginning that the rows do not determine stay as measured.
    fn unknowns(&self) -> usize {
        0
    }

    fn evaluate(&self, beginning: &[f64]) -> Result<Pass, EstimateError> {
        let refused = || Pass::Refused(EstimateError::Diverges { episode: String::new(), row: self.stretch.start.row });
        let Some(path) = self.simulated(beginning) else { return Ok(refused()) };
        let Residuals { values, by_beginning: J, size, there, .. } = self.residuals(beginning, &path, false);
        let cost: f64 = values.iter().map(|r| r * r).sum();
        let finite = (0..J.ncols()).all(|j| J.col_as_slice(j).iter().all(|value| value.is_finite()));
        if !(cost.is_finite() && finite) {
            return Ok(refused());
        }
        let slope: Vec<f64> = (0..J.ncols()).map(|j| dot(J.col_as_slice(j), &values)).collect();
        let (jacobian, rhs) = compressed(&products(J.as_ref()), &slope).ok_or(EstimateError::Overflow)?;
        self.last.replace(Some((beginning.to_vec(), path)));
        let rows = there.iter().filter(|&&there| there).count() as u64;
        let (targets, scores, linear, shares) = (size, Vec::new(), Vec::new(), Vec::new());
        Ok(Pass::Finite(Evaluation { jacobian, rhs, cost, targets, rows, scores, linear, shares, ended: 0 }))
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// J'J.
pub(super) fn products(J: MatRef<'_, f64>) -> Mat<f64> {
    J.transpose() * J
}

/// Takes the part that a beginning takes up out of the derivatives by the parameters: `S - U U'S` with U an orthonormal
/// basis of the derivatives by the beginning. Returns the derivatives of the best beginning by the parameters. `None`
/// if the decomposition fails.
fn eliminate(residuals: &mut Residuals) -> Option<Mat<f64>> {
    let (J, S) = (&residuals.by_beginning, &mut residuals.by_parameters);
    let (n, p) = (J.ncols(), S.ncols());
    let length = |j: usize| norm(J.col_as_slice(j).iter().copied());
    let lengths: Vec<f64> = (0..n).map(length).map(|length| if length > 0.0 { length } else { 1.0 }).collect();
    let scaled = Mat::from_fn(J.nrows(), n, |i, j| J[(i, j)] / lengths[j]);
    let factors = svd(products(scaled.as_ref()).as_ref())?;
    let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(n));
    let rank = factors.s.iter().filter(|&&s| s > least).count();
    let root = Mat::from_fn(n, rank, |j, i| factors.v[(j, i)] / factors.s[i].sqrt());
    let basis = &scaled * &root;
    let mut along = Mat::<f64>::zeros(rank, p);
    // Twice is enough: the basis is orthonormal up to the condition of the derivatives.
    for _ in 0..2 {
        let projection = basis.transpose() * &*S;
        *S -= &basis * &projection;
        along += projection;
    }
    let response = &root * &along;
    Some(Mat::from_fn(n, p, |j, k| -response[(j, k)] / lengths[j]))
}
