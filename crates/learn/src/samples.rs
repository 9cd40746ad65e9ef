//! Rows in memory: as they were read, and in tiles, standardised.

use crate::Error;

/// Rows of a tile.
pub const TILE: usize = 256;

/// Rows of inputs and targets as they were read.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    pub(crate) inputs: usize,
    pub(crate) targets: usize,
    /// Rows x (inputs, then targets).
    values: Vec<f64>,
}

/// Mean and deviation of every input and target on the rows that train.
#[derive(Debug, Clone, PartialEq)]
pub struct Units {
    /// Mean of every column.
    pub centre: Vec<f64>,
    /// Deviation of every column.
    pub scale: Vec<f64>,
}

/// Standardised rows in tiles of [`TILE`], of which each has its columns one after another; the last one is filled up with zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    pub(crate) inputs: usize,
    pub(crate) targets: usize,
    pub(crate) rows: usize,
    values: Vec<f64>,
}

impl Table {
    /// Rows of so many inputs and targets, row after row.
    ///
    /// # Errors
    /// A value that is not finite, and a length that does not fit.
    pub fn new(inputs: usize, targets: usize, values: Vec<f64>) -> Result<Self, Error> {
        let width = inputs + targets;
        if inputs == 0 || targets == 0 || !values.len().is_multiple_of(width) {
            let count = values.len();
            return Err(Error::Shape(format!("{count} values for rows of {inputs} inputs and {targets} targets")));
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(Error::NotFinite { row: at / width, column: at % width }),
            None => Ok(Self { inputs, targets, values }),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.values.len() / self.width()
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// Inputs and targets of a row.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.width()..][..self.width()]
    }

    fn width(&self) -> usize {
        self.inputs + self.targets
    }

    /// Some rows, standardised, in this order.
    pub fn samples(&self, rows: &[usize], units: &Units) -> Samples {
        let width = self.width();
        let mut values = vec![0.0; rows.len().div_ceil(TILE) * TILE * width];
        for (at, &row) in rows.iter().enumerate() {
            let tile = &mut values[at / TILE * TILE * width..][..TILE * width];
            for (column, value) in self.row(row).iter().enumerate() {
                tile[column * TILE + at % TILE] = (value - units.centre[column]) / units.scale[column];
            }
        }
        Samples { inputs: self.inputs, targets: self.targets, rows: rows.len(), values }
    }
}

impl Units {
    /// Those of some rows.
    ///
    /// # Errors
    /// Fewer than two rows; a column that is constant.
    pub fn of(table: &Table, rows: &[usize]) -> Result<Self, Error> {
        let (centre, scale) = Self::moments(table, rows)?;
        match (0..scale.len()).find(|&column| is_constant(scale[column], centre[column])) {
            Some(column) => Err(Error::Constant { column }),
            None => Ok(Self { centre, scale }),
        }
    }

    /// Those of some rows, with the scale 1 for a column that is constant on them: it is zero in the samples, and has no weight.
    ///
    /// # Errors
    /// Fewer than two rows.
    pub fn measured(table: &Table, rows: &[usize]) -> Result<Self, Error> {
        let (centre, mut scale) = Self::moments(table, rows)?;
        for (scale, mean) in scale.iter_mut().zip(&centre) {
            if is_constant(*scale, *mean) {
                *scale = 1.0;
            }
        }
        Ok(Self { centre, scale })
    }

    fn moments(table: &Table, rows: &[usize]) -> Result<(Vec<f64>, Vec<f64>), Error> {
        if rows.len() < 2 {
            return Err(Error::TooFewRows { rows: rows.len(), least: 2 });
        }
        let (count, width) = (rows.len() as f64, table.width());
        let mut centre = vec![0.0; width];
        for &row in rows {
            centre.iter_mut().zip(table.row(row)).for_each(|(sum, value)| *sum += value / count);
        }
        let mut square = vec![0.0; width];
        for &row in rows {
            let parts = square.iter_mut().zip(table.row(row)).zip(&centre);
            parts.for_each(|((sum, value), mean)| *sum += (value - mean) * (value - mean) / count);
        }
        Ok((centre, square.into_iter().map(f64::sqrt).collect()))
    }
}

/// True if a deviation is no more than the rounding of a constant.
fn is_constant(scale: f64, mean: f64) -> bool {
    scale <= 1e-12 * mean.abs() || scale == 0.0
}

impl Samples {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.rows.div_ceil(TILE)
    }

    /// Inputs and targets of a tile, column after column, and how many of its rows there are.
    pub(crate) fn tile(&self, tile: usize) -> (&[f64], &[f64], usize) {
        let width = (self.inputs + self.targets) * TILE;
        let (inputs, targets) = self.values[tile * width..][..width].split_at(self.inputs * TILE);
        (inputs, targets, (self.rows - tile * TILE).min(TILE))
    }
}
