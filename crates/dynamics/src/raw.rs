//! Errors against raw measurements, beside those against smoothed rows: same predictions, other references.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_library::{Expr, Program, Scratch};
use fleetfoot_model::{Equation, Model, Prediction};

use crate::{Error, predict::overlap};

/// Errors of one step against raw measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct RawError {
    /// Rows with a measurement.
    pub rows: u64,
    /// Mean absolute error.
    pub mae: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
}

/// Errors of rollouts against raw measurements by step, from step 1; NaN where nothing was measured.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RawHorizon {
    /// Root of the mean squared error, steps x states.
    pub rmse: Vec<f64>,
    /// Mean absolute error, steps x states.
    pub mae: Vec<f64>,
}

/// The raw measurements of the quantities that fitted equations predict. A derivative is never measured; for a
/// difference it is the value that it leads to.
pub(crate) struct RawTargets<'a> {
    raw: &'a dyn Source,
    /// Of the rows that are scored, and of the raw ones.
    levels: [Program; 2],
    equations: usize,
}

/// Memory of [`RawTargets::shifts`].
#[derive(Default)]
pub(crate) struct RawWorkspace {
    values: [Vec<f64>; 2],
    scratch: Scratch,
}

/// Measured expression of an equation's left side; `None` for a derivative.
fn level(equation: &Equation) -> Option<Expr> {
    match equation.prediction {
        Prediction::Derivative => None,
        Prediction::Next | Prediction::Value => equation.target.clone(),
        Prediction::Difference => Some(Expr::column(equation.subject.as_str()).shifted(-1)),
    }
}

impl<'a> RawTargets<'a> {
    /// Of a model, on rows with these columns.
    pub(crate) fn new(model: &Model, columns: &[&str], raw: &'a dyn Source) -> Result<Self, Error> {
        let known: Vec<&str> = raw.columns().iter().map(|column| column.name.as_str()).collect();
        let is_known =
            |level: &Expr| level.columns().iter().all(|name| columns.contains(&&**name) && known.contains(&&**name));
        let nothing = || Expr::number(f64::NAN);
        let levels: Vec<Expr> =
            model.fitted().map(|equation| level(equation).filter(is_known).unwrap_or_else(nothing)).collect();
        let compiled = [Program::compile(&levels, columns)?, Program::compile(&levels, &known)?];
        Ok(Self { raw, levels: compiled, equations: levels.len() })
    }

    pub(crate) fn halo(&self) -> Halo {
        self.levels[0].halo()
    }

    /// Raw measurements minus smoothed values at some core rows of a block (equations x rows); NaN without a
    /// measurement.
    pub(crate) fn shifts(
        &self,
        episode: usize,
        block: &Block,
        rows: &Range<usize>,
        workspace: &mut RawWorkspace,
        out: &mut Vec<f64>,
    ) -> Result<(), Error> {
        out.clear();
        out.resize(rows.len() * self.equations, f64::NAN);
        let first = block.first + rows.start;
        let raw = self.raw.read(episode, first..first + rows.len(), self.halo())?;
        let there = overlap(rows, &self.levels[0].valid_rows(block));
        let measured = self.levels[1].valid_rows(&raw);
        let there = overlap(&there, &(rows.start + measured.start..rows.start + measured.end));
        if there.is_empty() {
            return Ok(());
        }
        let (count, offset) = (there.len(), there.start - rows.start);
        let RawWorkspace { values, scratch } = workspace;
        values.iter_mut().for_each(|values| values.resize(count * self.equations, 0.0));
        let [smooth, measured] = values;
        self.levels[0].evaluate_block(block, there, smooth, count, scratch);
        self.levels[1].evaluate_block(&raw, offset..offset + count, measured, count, scratch);
        for equation in 0..self.equations {
            let of = |values: &[f64], row: usize| values[equation * count + row];
            for row in 0..count {
                out[equation * rows.len() + offset + row] = of(measured, row) - of(smooth, row);
            }
        }
        Ok(())
    }
}
