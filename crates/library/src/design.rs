//! The rows of a regression: expressions evaluated over tiles of blocks, incomplete rows left out and counted.

use std::ops::Range;

use fleetfoot_data::{Block, Halo};

use crate::{Expr, Program, Scratch, UnknownColumn, kernel::all_within};

/// Groups of expressions (regressors, targets, whatever the caller needs beside them) evaluated together.
pub struct Design {
    program: Program,
    expressions: Vec<Expr>,
}

/// The complete rows of one tile: a column-major matrix of `rows` x outputs.
#[derive(Debug, Default)]
pub struct DesignRows {
    /// Core rows of the block, ascending, that are complete.
    pub index: Vec<usize>,
    /// Values, one output after the other, `index.len()` each.
    pub values: Vec<f64>,
    /// Rows left out because a lag or difference would have crossed the border of the episode.
    pub at_border: u64,
    /// Rows left out because a value was missing or not finite.
    pub incomplete: u64,
    scratch: Scratch,
}

/// The largest size of a value whose squares may be summed over any number of rows.
const LARGEST: f64 = 1e150;

/// A value whose squares overflow.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "`{expression}` is {value:e} in row {} of {episode}: squares of values beyond 1e150 overflow; scale its columns (an alias such as `small = 1e{}*({expression})`), \
     or leave out what is no measurement", row + 1, -value.abs().log10().floor()
)]
pub struct TooLarge {
    /// Expression that has the value.
    pub expression: String,
    /// The episode.
    pub episode: String,
    /// The row of the episode.
    pub row: usize,
    /// The value.
    pub value: f64,
}

impl DesignRows {
    /// Number of complete rows.
    pub fn rows(&self) -> usize {
        self.index.len()
    }

    /// The values of an output.
    pub fn output(&self, output: usize) -> &[f64] {
        &self.values[output * self.index.len()..(output + 1) * self.index.len()]
    }
}

impl Design {
    /// Compiles the expressions for a source with these columns.
    pub fn compile(expressions: &[Expr], columns: &[&str]) -> Result<Self, UnknownColumn> {
        Ok(Self { program: Program::compile(expressions, columns)?, expressions: expressions.to_vec() })
    }

    /// Neighbouring rows that the expressions reach for.
    pub fn halo(&self) -> Halo {
        self.program.halo()
    }

    /// Number of expressions.
    pub fn outputs(&self) -> usize {
        self.expressions.len()
    }

    /// [`Design::evaluate`] for sums of squares.
    ///
    /// # Errors
    /// A value whose squares overflow.
    pub fn evaluate_for_squares(
        &self,
        block: &Block,
        episode: &str,
        rows: Range<usize>,
        out: &mut DesignRows,
    ) -> Result<(), TooLarge> {
        if self.evaluate_within(block, rows, out, LARGEST) {
            return Ok(());
        }
        let count = out.index.len().max(1);
        let largest = |column: &[f64]| column.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
        // The first: what others are made of stands before them.
        let too_large =
            out.values.chunks_exact(count).zip(&self.expressions).find(|(column, _)| largest(column) > LARGEST);
        let Some((column, expression)) = too_large else { return Ok(()) };
        let at = column.iter().position(|value| value.abs() > LARGEST).unwrap_or_default();
        Err(TooLarge {
            expression: expression.to_string(),
            episode: episode.to_owned(),
            row: block.first + out.index[at],
            value: column[at],
        })
    }

    /// Evaluates the tile `rows` (core rows) of a block into `out`, which is overwritten.
    pub fn evaluate(&self, block: &Block, rows: Range<usize>, out: &mut DesignRows) {
        self.evaluate_within(block, rows, out, f64::MAX);
    }

    /// [`Design::evaluate`]; whether all rows are complete and no value is larger than `limit`.
    fn evaluate_within(&self, block: &Block, rows: Range<usize>, out: &mut DesignRows, limit: f64) -> bool {
        let valid = self.program.valid_rows(block);
        let (first, last) = (rows.start.max(valid.start), rows.end.min(valid.end));
        let count = last.saturating_sub(first);
        out.at_border = (rows.len() - count) as u64;
        out.incomplete = 0;
        out.index.clear();
        // Old values of the last tile are overwritten.
        out.values.resize(count * self.outputs(), 0.0);
        if count == 0 {
            return true;
        }
        self.program.evaluate_block(block, first..last, &mut out.values, count, &mut out.scratch);
        if all_within(&out.values, limit) {
            out.index.extend(first..last);
            return true;
        }
        out.leave_out_incomplete(first..last, self.outputs());
        false
    }
}

impl DesignRows {
    /// Keeps the complete ones of these core rows, which all have values.
    fn leave_out_incomplete(&mut self, rows: Range<usize>, outputs: usize) {
        let count = rows.len();
        // A sum of x * 0 is 0 unless some x is not finite.
        let mut poison = vec![0.0f64; count];
        for column in self.values.chunks_exact(count) {
            for (sum, value) in poison.iter_mut().zip(column) {
                *sum += value * 0.0;
            }
        }
        self.index.extend((0..count).filter(|&row| poison[row] == 0.0).map(|row| rows.start + row));
        let complete = self.index.len();
        if complete < count {
            self.incomplete = (count - complete) as u64;
            let mut to = 0;
            for output in 0..outputs {
                for row in 0..complete {
                    self.values[to] = self.values[output * count + self.index[row] - rows.start];
                    to += 1;
                }
            }
            self.values.truncate(complete * outputs);
        }
    }
}
