//! Working sets of groups along decreasing lambda.

use faer::Mat;

use super::{
    block::Block,
    small::{Part, Small},
    spectrum::Spectrum,
};
use crate::{Quadratic, SparseError, kernel::Slab, residual::Residual};

/// Columns that join the working set at once, at least.
const JOIN: usize = 32;
/// The least violation, as a correlation, that is more than rounding.
const MOST_EXACT: f64 = 1e-14;

/// Coefficients that are carried from lambda to lambda, in correlation form.
pub(super) struct Descent<'a> {
    blocks: &'a [Block],
    pub(super) left: Residual<'a>,
    /// Of the blocks that were in a working set.
    spectra: Vec<Option<Spectrum>>,
    /// Strength of the solution that the coefficients are.
    lambda: f64,
}

impl<'a> Descent<'a> {
    pub(super) fn new(problem: &'a Quadratic, blocks: &'a [Block]) -> Self {
        Self { blocks, left: Residual::new(problem), spectra: vec![None; blocks.len()], lambda: f64::INFINITY }
    }

    /// Goes on from these coefficients, in correlation form.
    pub(super) fn start(&mut self, delta: &[f64]) {
        let mut allowed = vec![0.0; delta.len()];
        for block in self.blocks {
            for (&j, _) in block.columns.iter().zip(&block.signs).filter(|(j, sign)| sign.allows(delta[**j])) {
                allowed[j] = delta[j];
            }
        }
        self.left.start(allowed);
    }

    /// The minimiser at lambda (in units of the target's deviation), from the present coefficients on; whether it meets the tolerance, and the sweeps.
    ///
    /// At infinity only what is not penalised is fitted.
    pub(super) fn solve(
        &mut self,
        lambda: f64,
        tolerance: f64,
        max_epochs: usize,
    ) -> Result<(bool, usize), SparseError> {
        let mut working = self.strong(lambda);
        self.lambda = lambda;
        let tolerance = self.tolerance(lambda, tolerance);
        let (mut epochs, mut idle) = (max_epochs, 0);
        loop {
            epochs -= self.descend(&working, lambda, 0.5 * tolerance, epochs)?.min(epochs);
            let mut broken = self.broken(lambda, tolerance);
            if broken.is_empty() {
                return Ok((true, max_epochs - epochs));
            }
            broken.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let size = |working: &[usize]| working.iter().map(|&at| self.blocks[at].columns.len()).sum::<usize>();
            let (before, most) = (working.len(), 2 * size(&working).max(JOIN));
            for (_, at) in broken {
                if !working.contains(&at) && (working.len() == before || size(&working) < most) {
                    working.push(at);
                }
            }
            // Nothing joined: what is broken lies in the working set, and sweeping again mends rounding at best.
            idle += usize::from(working.len() == before);
            if epochs == 0 || idle > 2 {
                return Ok((false, max_epochs - epochs));
            }
        }
    }

    /// The blocks that the sequential strong rule (Tibshirani et al. 2012) cannot discard: a gradient moves, in the dual norm of its block, by about as much as
    /// lambda.
    fn strong(&self, lambda: f64) -> Vec<usize> {
        let reach = if self.lambda.is_finite() { 2.0 * lambda - self.lambda } else { f64::INFINITY };
        let keeps = |block: &Block| {
            let active = block.columns.iter().any(|&j| self.left.delta[j] != 0.0);
            active || !block.penalised() || block.critical(&self.left.gradient, |_| 0.0) >= reach
        };
        (0..self.blocks.len()).filter(|&at| keeps(&self.blocks[at])).collect()
    }

    /// The violation at which a solution is good: one as large as the penalty itself would be no solution.
    fn tolerance(&self, lambda: f64, wanted: f64) -> f64 {
        let limit = |block: &Block| {
            let rule = block.at(lambda);
            block.units.iter().copied().fold(f64::INFINITY, f64::min) * (rule.l1 + rule.group)
        };
        let least = self.blocks.iter().map(limit).filter(|limit| *limit > 0.0).fold(f64::INFINITY, f64::min);
        wanted.min((0.01 * least).max(MOST_EXACT))
    }

    /// Blocks that break the optimality conditions, and by how much.
    fn broken(&self, lambda: f64, tolerance: f64) -> Vec<(f64, usize)> {
        let violation = |block: &Block| {
            if block.penalised() && lambda.is_infinite() {
                return 0.0;
            }
            let (v, gradient) = (block.coefficients(&self.left.delta), block.gradients(&self.left.gradient));
            block.at(lambda).violation(&v, &gradient)
        };
        let all = self.blocks.iter().enumerate().map(|(at, block)| (violation(block), at));
        all.filter(|(violation, _)| *violation > tolerance).collect()
    }

    /// Minimises in the blocks of the working set, all others zero; the sweeps.
    fn descend(&mut self, working: &[usize], lambda: f64, tolerance: f64, epochs: usize) -> Result<usize, SparseError> {
        let columns: Vec<(usize, f64)> = working.iter().flat_map(|&at| self.blocks[at].members()).collect();
        let matrix = self.matrix(&columns);
        working.iter().try_for_each(|&at| self.decompose(at))?;
        let mut target: Vec<f64> = columns.iter().map(|(j, unit)| self.left.target[*j] / unit).collect();
        target.resize(matrix.stride(), 0.0);
        let mut parts = Vec::with_capacity(working.len());
        let mut first = 0;
        for &at in working {
            let rule = self.blocks[at].at(lambda);
            parts.push(Part { first, rule, spectrum: self.spectra[at].as_ref() });
            first += rule.units.len();
        }
        let mut v: Vec<f64> = columns.iter().map(|(j, unit)| self.left.delta[*j] * unit).collect();
        let (_, used) = Small { matrix, target, parts }.minimise(&mut v, tolerance, epochs);
        columns.iter().zip(&v).for_each(|((j, unit), v)| self.left.delta[*j] = v / unit);
        self.left.refresh();
        Ok(used)
    }

    /// Correlations of some columns, each divided by both units.
    pub(super) fn matrix(&mut self, columns: &[(usize, f64)]) -> Slab {
        let members: Vec<usize> = columns.iter().map(|(j, _)| *j).collect();
        self.left.products.form(&members);
        let mut matrix = Slab::zeros(columns.len(), columns.len());
        for (at, &(j, unit)) in columns.iter().enumerate() {
            let column = matrix.column_mut(at);
            self.left.products.with(j, &members, column);
            column.iter_mut().zip(columns).for_each(|(entry, (_, other))| *entry = *entry / unit / other);
        }
        matrix
    }

    /// Makes the spectrum of a block of several columns available.
    fn decompose(&mut self, at: usize) -> Result<(), SparseError> {
        let block = &self.blocks[at];
        if block.columns.len() == 1 || self.spectra[at].is_some() {
            return Ok(());
        }
        let entry = |i: usize, k: usize| {
            self.left.products.pair(block.columns[i], block.columns[k]) / block.units[k] / block.units[i]
        };
        let k = block.columns.len();
        let spectrum = Spectrum::of(&Mat::from_fn(k, k, entry));
        self.spectra[at] = Some(spectrum.ok_or(SparseError::ColumnNotFinite { column: block.columns[0] })?);
        Ok(())
    }
}
