//! Sparse rows: products of their nonzero values, in time proportional to the rows times the square of the values a
//! row.

use std::ops::Range;

use fleetfoot_data::{Progress, packed_row, parallel_pieces};
use fleetfoot_stats::{Gram, Preconditioner};

use super::{DenseDesign, DenseError, ROOT_COLUMNS, sums::Sums};
use crate::kernel::norm;

/// Share of values that are not zero up to which products of these are cheaper than those of all.
const FEW: f64 = 0.1;
/// Rows that are read at once.
const BLOCK: usize = 1 << 16;
/// Parts of the matrix that are summed each by itself.
const PARTS: usize = 16;
/// Least remainder of a column beside the ones before, relative to its length, at which plain products lose at most two
/// digits.
const APART: f64 = 1e-2;

/// The regressors of some rows that are not zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Nonzeros {
    /// Index of every row's first value, and the end of the last row (rows + 1).
    pub starts: Vec<usize>,
    /// Column of every value, ascending within a row.
    pub columns: Vec<u32>,
    /// The values.
    pub values: Vec<f64>,
}

impl Sums {
    /// The sums of a design whose rows hold few values; `None` where they are no such rows, or where their products as they are would lose too much.
    pub(super) fn of_nonzeros(design: &DenseDesign, progress: &dyn Progress) -> Result<Option<Self>, DenseError> {
        if design.rows.density() > FEW {
            return Ok(None);
        }
        progress.stage("products of the rows");
        let mut moments: Vec<Moments> = (0..design.groups).map(|_| Moments::new(design)).collect();
        let n = design.rows.rows();
        for first in (0..n).step_by(BLOCK) {
            if progress.cancelled() {
                return Err(fleetfoot_data::Cancelled.into());
            }
            let rows = first..(first + BLOCK).min(n);
            let Some(block) = Block::read(design, rows.clone()) else { return Ok(None) };
            for (group, moments) in moments.iter_mut().enumerate() {
                moments.add(&block, |row| design.labels.get(first + row).map_or(0, |&label| label as usize) == group);
            }
            progress.advance(rows.len(), n);
        }
        let grams: Vec<Gram> = moments.into_iter().map(Moments::gram).collect();
        let plain = design.columns() > ROOT_COLUMNS;
        let preconditioner = Preconditioner::identity(design.regressors(), design.targets());
        let sums = Self::new(preconditioner, grams, plain);
        Ok((plain || sums.stands_apart(design)).then_some(sums))
    }

    /// Returns true if every column that varies has a large enough remainder beside the ones before.
    fn stands_apart(&self, design: &DenseDesign) -> bool {
        let root = self.root(&vec![true; design.groups]);
        (0..root.regressors()).all(|j| {
            let column = &root.r.col_as_slice(j)[..=j];
            let length = norm(column);
            length <= root.noise * root.magnitude[j] || column[j].abs() > APART * length
        })
    }
}

/// Some rows with their weights and targets.
struct Block {
    regressors: Nonzeros,
    /// Column after column.
    targets: Vec<f64>,
    weights: Vec<f64>,
}

impl Block {
    fn read(design: &DenseDesign, rows: Range<usize>) -> Option<Self> {
        let regressors = design.rows.nonzeros(rows.clone())?;
        let mut targets = Vec::new();
        design.rows.read_columns(design.regressors()..design.columns(), rows.clone(), &mut targets);
        let weights = match &design.weights {
            None => vec![1.0; rows.len()],
            Some(weights) => weights[rows].to_vec(),
        };
        Some(Self { regressors, targets, weights })
    }

    /// The values of a row, targets about their centres, with their columns.
    fn row(&self, row: usize, centre: &[f64], regressors: usize, out: &mut Vec<(usize, f64)>) {
        out.clear();
        let held = self.regressors.starts[row]..self.regressors.starts[row + 1];
        let columns = self.regressors.columns[held.clone()].iter().map(|&column| column as usize);
        out.extend(columns.zip(self.regressors.values[held].iter().copied()));
        let rows = self.weights.len();
        let target = |k: usize| self.targets[k * rows + row] - centre[k];
        out.extend((0..centre.len()).map(|k| (regressors + k, target(k))));
    }
}

/// Sums over the rows of a group: regressors about zero, targets about one of their values.
struct Moments {
    regressors: usize,
    /// Of the targets; `None` before the first row.
    centre: Option<Vec<f64>>,
    targets: usize,
    rows: u64,
    weight: f64,
    /// `sum w z` (d).
    first: Vec<f64>,
    /// `sum w z z'` in parts of rows of the lower triangle: the rows, and the entries one row after the other.
    second: Vec<(Range<usize>, Vec<f64>)>,
}

impl Moments {
    fn new(design: &DenseDesign) -> Self {
        let d = design.columns();
        // Of equal area.
        let border = |part: usize| (d as f64 * (part as f64 / PARTS as f64).sqrt()).round() as usize;
        let part = |rows: Range<usize>| (rows.clone(), vec![0.0; packed_row(rows.end) - packed_row(rows.start)]);
        Self {
            regressors: design.regressors(),
            targets: design.targets(),
            centre: None,
            rows: 0,
            weight: 0.0,
            first: vec![0.0; d],
            second: (0..PARTS).map(|at| part(border(at)..border(at + 1))).collect(),
        }
    }

    fn add(&mut self, block: &Block, is_meant: impl Fn(usize) -> bool + Sync) {
        let n = block.weights.len();
        let used = |row: &usize| block.weights[*row] > 0.0 && is_meant(*row);
        let Some(any) = (0..n).find(used) else { return };
        let centre = self.centre.get_or_insert_with(|| (0..self.targets).map(|k| block.targets[k * n + any]).collect());
        let (centre, regressors) = (&*centre, self.regressors);
        let mut held = Vec::new();
        for row in (0..n).filter(used) {
            let weight = block.weights[row];
            block.row(row, centre, regressors, &mut held);
            held.iter().for_each(|&(column, value)| self.first[column] += weight * value);
            self.rows += 1;
            self.weight += weight;
        }
        parallel_pieces(&mut self.second, 1, |_, part| {
            let (columns, sums) = &mut part[0];
            let base = packed_row(columns.start);
            let mut held = Vec::new();
            for row in (0..n).filter(used) {
                block.row(row, centre, regressors, &mut held);
                let from = held.partition_point(|&(column, _)| column < columns.start);
                let to = held.partition_point(|&(column, _)| column < columns.end);
                for at in from..to {
                    let (i, value) = held[at];
                    let (line, value) = (&mut sums[packed_row(i) - base..], block.weights[row] * value);
                    held[..=at].iter().for_each(|&(j, other)| line[j] += value * other);
                }
            }
        });
    }

    fn gram(self) -> Gram {
        let mut centre = vec![0.0; self.regressors];
        centre.extend(self.centre.unwrap_or_else(|| vec![0.0; self.targets]));
        let second: Vec<f64> = self.second.into_iter().flat_map(|(_, sums)| sums).collect();
        Gram::from_moments(self.rows, self.weight, &centre, &self.first, &second)
    }
}
