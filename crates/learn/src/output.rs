//! The output layer: least squares from sums.

use faer::{Accum, Mat, MatRef, Par, Side, linalg::matmul::matmul, prelude::Solve};

use crate::{Error, samples::TILE};

/// Share of the rows that is added to the diagonal for the linear map, whose inputs may be collinear (lags of a smooth signal): far below what rows tell.
const FLOOR: f64 = 1e-10;

/// Sums of products of `1, x, h, y` over rows: what an output layer is solved from and judged by, whatever its ridge.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistic {
    /// Inputs x of the linear map.
    pub inputs: usize,
    /// Features h.
    pub features: usize,
    /// Targets y.
    pub targets: usize,
    /// Rows.
    pub rows: usize,
    pub(crate) sums: Mat<f64>,
}

/// An output layer: constants, linear map and weights of the features, `(1 + inputs + features) x targets`.
#[derive(Debug, Clone, PartialEq)]
pub struct Output(pub Mat<f64>);

impl Statistic {
    pub(crate) fn new(inputs: usize, features: usize, targets: usize) -> Self {
        let width = 1 + inputs + features + targets;
        Self { inputs, features, targets, rows: 0, sums: Mat::zeros(width, width) }
    }

    /// Adds the rows of a tile, columns `1, x, h, y`.
    pub(crate) fn add(&mut self, columns: &[f64], rows: usize) {
        let width = self.sums.nrows();
        let columns = MatRef::from_column_major_slice(columns, TILE, width);
        matmul(self.sums.as_mut(), Accum::Add, columns.transpose(), columns, 1.0, Par::Seq);
        self.rows += rows;
    }

    /// Adds the sums of other rows.
    pub fn merge(&mut self, other: &Self) {
        self.sums += &other.sums;
        self.rows += other.rows;
    }

    /// The numbers of an output for every target.
    pub fn width(&self) -> usize {
        1 + self.inputs + self.features
    }

    /// The sums without the features: those of a linear map.
    #[must_use]
    pub fn linear(&self) -> Self {
        let head = 1 + self.inputs;
        let width = head + self.targets;
        let place = |i: usize| if i < head { i } else { i + self.features };
        let sums = Mat::from_fn(width, width, |i, j| self.sums[(place(i), place(j))]);
        Self { features: 0, sums, ..self.clone() }
    }

    /// The output layer with the least `sum of squares + ridge * rows * |weights of the features|^2`; constants and the linear map are free.
    ///
    /// # Errors
    /// Fewer rows than numbers of the linear map; sums that are not finite.
    pub fn solve(&self, ridge: f64) -> Result<Output, Error> {
        let (width, head) = (self.width(), 1 + self.inputs);
        if self.rows < head + 1 {
            return Err(Error::TooFewRows { rows: self.rows, least: head + 1 });
        }
        let rows = self.rows as f64;
        let mut gram = self.sums.as_ref().submatrix(0, 0, width, width).to_owned();
        for k in 1..width {
            gram[(k, k)] += rows * if k < head { FLOOR } else { ridge.max(FLOOR) };
        }
        let factor = gram.llt(Side::Lower).map_err(|_| Error::Diverged)?;
        let solution = factor.solve(self.sums.as_ref().submatrix(0, width, width, self.targets));
        let is_finite = solution.col_iter().all(|column| column.iter().all(|value| value.is_finite()));
        match is_finite {
            true => Ok(Output(solution)),
            false => Err(Error::Diverged),
        }
    }

    /// Mean squared error of every target with this output layer.
    pub fn errors(&self, output: &Output) -> Vec<f64> {
        let width = self.width();
        let gram = self.sums.as_ref().submatrix(0, 0, width, width);
        let product = gram * &output.0;
        let of = |t: usize| {
            let terms = (0..width).map(|k| output.0[(k, t)] * (product[(k, t)] - 2.0 * self.sums[(k, width + t)]));
            ((self.sums[(width + t, width + t)] + terms.sum::<f64>()) / self.rows as f64).max(0.0)
        };
        (0..self.targets).map(of).collect()
    }

    /// Mean product of the errors of two targets with this output layer.
    pub fn error_product(&self, output: &Output, targets: [usize; 2]) -> f64 {
        let width = self.width();
        let [a, b] = targets;
        let column = |t: usize, k: usize| if k < width { output.0[(k, t)] } else { -f64::from(k - width == t) };
        let entry = |i: usize, j: usize| column(a, i) * self.sums[(i, j)] * column(b, j);
        let all = 0..width + self.targets;
        all.clone().map(|i| all.clone().map(|j| entry(i, j)).sum::<f64>()).sum::<f64>() / self.rows as f64
    }

    /// Mean of [`Statistic::errors`] over targets.
    pub fn error(&self, output: &Output) -> f64 {
        self.errors(output).iter().sum::<f64>() / self.targets as f64
    }
}
