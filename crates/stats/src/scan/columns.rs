//! The columns of a pass: groups of expressions over a source, evaluated together.

use std::ops::Range;

use fleetfoot_data::{Block, Episode, Halo, Source};
use fleetfoot_library::{Design, DesignRows, Expr, TooLarge, UnknownColumn};

use super::RowCounts;

/// A row that cannot be summed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RowError {
    /// A value whose squares overflow.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// A row weight below zero.
    #[error("episode {episode}, row {}: the weight is {value}; weights are not negative", row + 1)]
    NegativeWeight {
        /// The episode.
        episode: String,
        /// Its row.
        row: usize,
        /// The weight.
        value: f64,
    },
}

/// Groups of expressions, and a weight where rows have one: one design, so that a row counts in all groups or in none.
pub struct Columns {
    design: Design,
    /// The column after the last of every group.
    ends: Vec<usize>,
    weighted: bool,
}

impl Columns {
    /// Compiles groups of expressions for a source.
    ///
    /// # Errors
    /// The source has no such column.
    pub fn compile(groups: &[&[Expr]], weight: Option<&Expr>, source: &dyn Source) -> Result<Self, UnknownColumn> {
        let expressions: Vec<Expr> = groups.iter().copied().flatten().chain(weight).cloned().collect();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let ends = groups.iter().scan(0, |end, group| {
            *end += group.len();
            Some(*end)
        });
        Ok(Self { design: Design::compile(&expressions, &names)?, ends: ends.collect(), weighted: weight.is_some() })
    }

    /// Neighbouring rows that a row reaches for.
    pub fn halo(&self) -> Halo {
        self.design.halo()
    }

    /// Number of columns, the weight among them.
    pub fn count(&self) -> usize {
        self.design.outputs()
    }

    /// Number of columns of some groups.
    pub fn width(&self, groups: Range<usize>) -> usize {
        self.place(groups).len()
    }

    /// Evaluates a tile of core rows of a block into `rows`, which are overwritten.
    ///
    /// # Errors
    /// A negative weight, or a value whose squares overflow.
    pub fn evaluate<'r>(
        &'r self,
        block: &Block,
        episode: &Episode,
        tile: Range<usize>,
        rows: &'r mut DesignRows,
    ) -> Result<Tile<'r>, RowError> {
        self.design.evaluate_for_squares(block, &episode.name, tile, rows)?;
        let tile = self.tile(rows);
        let below = |weights: &[f64]| weights.iter().position(|&weight| weight < 0.0).map(|at| (at, weights[at]));
        match tile.weights().and_then(below) {
            Some((at, value)) => {
                let row = block.first + rows.index[at];
                Err(RowError::NegativeWeight { episode: episode.name.clone(), row, value })
            }
            None => Ok(self.tile(rows)),
        }
    }

    /// Rows that [`Columns::evaluate`] has left.
    pub fn tile<'r>(&'r self, rows: &'r DesignRows) -> Tile<'r> {
        Tile { columns: self, rows }
    }

    fn place(&self, groups: Range<usize>) -> Range<usize> {
        let end = |group: usize| group.checked_sub(1).map_or(0, |last| self.ends[last]);
        end(groups.start)..end(groups.end)
    }
}

/// The complete rows of a tile.
#[derive(Clone, Copy)]
pub struct Tile<'r> {
    columns: &'r Columns,
    rows: &'r DesignRows,
}

impl<'r> Tile<'r> {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.rows()
    }

    /// Returns true if the tile has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of rows of the tile that were used and that were left out.
    pub fn counts(&self) -> RowCounts {
        RowCounts::of(self.rows)
    }

    /// All columns, one after the other.
    pub fn rows(&self) -> &'r DesignRows {
        self.rows
    }

    /// The core rows of the block that they are.
    pub fn index(&self) -> &'r [usize] {
        &self.rows.index
    }

    /// Neighbouring groups, column-major.
    pub fn values(&self, groups: Range<usize>) -> &'r [f64] {
        let place = self.columns.place(groups);
        &self.rows.values[place.start * self.len()..place.end * self.len()]
    }

    /// The columns of neighbouring groups.
    pub fn columns(&self, groups: Range<usize>) -> Vec<&'r [f64]> {
        self.columns.place(groups).map(|column| self.rows.output(column)).collect()
    }

    /// The weights, where rows have some.
    pub fn weights(&self) -> Option<&'r [f64]> {
        self.columns.weighted.then(|| self.rows.output(self.columns.count() - 1))
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};
    use fleetfoot_library::Scope;

    use super::*;

    #[test]
    fn groups_share_complete_rows() {
        let mut source = MemorySource::new(vec![Column::float("x"), Column::float("w")]);
        source.push_uniform("e", 1.0, vec![vec![1.0, 2.0, f64::NAN, 4.0, 5.0], vec![1.0, 1.0, 1.0, 0.0, 2.0]]);
        let parse = |text: &str| Expr::parse(text, &Scope::new(["x", "w"])).unwrap();
        let groups = [vec![parse("x"), parse("x^2")], vec![], vec![parse("lead(x, 1)")]];
        let groups: Vec<&[Expr]> = groups.iter().map(Vec::as_slice).collect();
        let columns = Columns::compile(&groups, Some(&parse("w")), &source).unwrap();
        let block = source.read(0, 0..5, columns.halo()).unwrap();
        let mut rows = DesignRows::default();
        let tile = columns.evaluate(&block, &source.episodes()[0], 0..5, &mut rows).unwrap();
        // Row 1 has no next value, row 2 none at all, row 4 no neighbour.
        assert_eq!(tile.counts(), RowCounts { complete: 2, at_border: 1, incomplete: 2 });
        assert_eq!(tile.index(), [0, 3]);
        assert_eq!((tile.values(0..1), tile.values(1..2)), (&[1.0, 4.0, 1.0, 16.0][..], &[][..]));
        assert_eq!((tile.values(2..3), tile.weights()), (&[2.0, 5.0][..], Some(&[1.0, 0.0][..])));
        assert_eq!((columns.width(0..3), columns.width(1..1), columns.count()), (3, 0, 4));
        let weight = Columns::compile(&[&[parse("x")]], Some(&parse("w - 1.5")), &source).unwrap();
        let error = weight.evaluate(&block, &source.episodes()[0], 1..5, &mut rows).err().unwrap();
        assert_eq!(error.to_string(), "episode e, row 2: the weight is -0.5; weights are not negative");
    }
}
