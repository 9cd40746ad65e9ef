//! The rows of a regression: expressions evaluated over tiles of blocks, incomplete rows left out and counted.

use std::ops::Range;

use fleetfoot_data::{Block, Halo};

use crate::{Expr, Program, Scratch, UnknownColumn};

/// Groups of expressions (regressors, targets, whatever the caller needs beside them) evaluated together.
pub struct Design {
    program: Program,
    outputs: usize,
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
        Ok(Self { program: Program::compile(expressions, columns)?, outputs: expressions.len() })
    }

    /// Neighbouring rows that the expressions reach for.
    pub fn halo(&self) -> Halo {
        self.program.halo()
    }

    /// Number of expressions.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Evaluates the tile `rows` (core rows) of a block into `out`, which is overwritten.
    pub fn evaluate(&self, block: &Block, rows: Range<usize>, out: &mut DesignRows) {
        let valid = self.program.valid_rows(block);
        let (first, last) = (rows.start.max(valid.start), rows.end.min(valid.end));
        let count = last.saturating_sub(first);
        out.at_border = (rows.len() - count) as u64;
        out.incomplete = 0;
        out.index.clear();
        // What is left of the last tile is overwritten.
        out.values.resize(count * self.outputs, 0.0);
        if count == 0 {
            return;
        }
        self.program.evaluate_block(block, first..last, &mut out.values, count, &mut out.scratch);
        // A sum of x * 0 is 0 unless some x is not finite.
        let mut poison = vec![0.0f64; count];
        for column in out.values.chunks_exact(count) {
            for (sum, value) in poison.iter_mut().zip(column) {
                *sum += value * 0.0;
            }
        }
        out.index.extend((0..count).filter(|&row| poison[row] == 0.0).map(|row| first + row));
        let complete = out.index.len();
        if complete < count {
            out.incomplete = (count - complete) as u64;
            let mut to = 0;
            for output in 0..self.outputs {
                for row in 0..complete {
                    out.values[to] = out.values[output * count + out.index[row] - first];
                    to += 1;
                }
            }
            out.values.truncate(complete * self.outputs);
        }
    }
}
