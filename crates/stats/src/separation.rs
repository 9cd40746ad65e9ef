//! Columns that the data can distinguish: the rank decision, made once, in units of each column's rounding noise.

use faer::Mat;
use fleetfoot_data::{checkpoint, parallel_pieces};

use crate::{
    householder::{Pivoted, condition, pivoted_qr, solve_upper},
    kernel::{MANY_COLUMNS, least_length, norm},
};

/// Least ratio of a triangle to its noise, in all directions, at which its columns are independent without pivoting.
const CLEAR: f64 = 8.0;
/// Dependent columns that a thread rebuilds at once.
const DEPENDENT_AT_ONCE: usize = 8;

/// A triangle factored by column-pivoted QR in units of its columns' noise.
pub(crate) struct Separation {
    /// Column at each position; the first `rank` are independent.
    pub(crate) order: Vec<usize>,
    /// Number of independent columns.
    pub(crate) rank: usize,
    /// `[R11 R12]` in pivoted order, column k in units of `noise[order[k]]`; rows from `rank` on mean nothing.
    pub(crate) r: Mat<f64>,
    /// `Q'B`.
    pub(crate) rhs: Mat<f64>,
    /// Condition of the independent columns, each scaled to unit length.
    pub(crate) condition: f64,
    /// Columns that are nothing but noise.
    pub(crate) constant: Vec<bool>,
}

/// Separates the columns of `r` (m x p, upper triangular). `noise[j] > 0` is the length below which column j is rounding.
///
/// Dividing every column by its noise makes the noise of all directions 1: a pivot below 1 is rounding and nothing else. The decision
/// does not depend on the units of the columns. No pivot is shorter than the least singular value: many columns of which the first stand clear of their noise
/// in all directions, and leave nothing but noise of the others, are factored already, and stay in their order.
pub(crate) fn separate(r: &Mat<f64>, noise: &[f64], rhs: Mat<f64>) -> Separation {
    let constant: Vec<bool> = (0..r.ncols()).map(|j| norm(r.col_as_slice(j)) <= noise[j]).collect();
    let scaled = Mat::from_fn(r.nrows(), r.ncols(), |i, j| if constant[j] { 0.0 } else { r[(i, j)] / noise[j] });
    let Pivoted { order, rank, r, rhs } = match clear(&scaled) {
        Some(rank) => Pivoted { order: (0..r.ncols()).collect(), rank, r: scaled, rhs },
        None => pivoted_qr(&scaled, &rhs, 1.0),
    };
    let condition = condition(&r, rank);
    Separation { order, rank, r, rhs, condition, constant }
}

/// The rank of a triangle of many columns in units of their noise, where no pivoting is needed to see it.
fn clear(scaled: &Mat<f64>) -> Option<usize> {
    let p = scaled.ncols();
    if p < MANY_COLUMNS || scaled.nrows() < p {
        return None;
    }
    let rank = (0..p).position(|j| scaled[(j, j)].abs() <= 1.0).unwrap_or(p);
    let left = |j: usize| norm(&scaled.col_as_slice(j)[rank..=j]);
    let ones = vec![1.0; rank];
    let is_clear = (rank..p).all(|j| left(j) <= 1.0) && least_length(|j| scaled.col_as_slice(j), &ones) > CLEAR;
    is_clear.then_some(rank)
}

impl Separation {
    /// Groups of columns that cannot be told apart, each ascending, by first column. A constant column is a group of itself.
    ///
    /// A dependent column belongs with the independent columns that rebuild it; groups that share a column are one.
    pub(crate) fn confounded(&self) -> Vec<Vec<usize>> {
        let p = self.order.len();
        let mut group: Vec<Option<usize>> = (0..p).map(|j| self.constant[j].then_some(j)).collect();
        let lengths: Vec<f64> = (0..self.rank).map(|i| norm(&self.r.col_as_slice(i)[..=i])).collect();
        let mut dependent: Vec<usize> = (self.rank..p).filter(|&k| !self.constant[self.order[k]]).collect();
        let rebuilt = parallel_pieces(&mut dependent, DEPENDENT_AT_ONCE, |_, some| {
            some.iter().map(|&k| (self.order[k], self.rebuilt_from(k, &lengths))).collect::<Vec<_>>()
        });
        for (column, mut members) in rebuilt.into_iter().flatten() {
            members.push(column);
            let known: Vec<usize> = members.iter().filter_map(|&member| group[member]).collect();
            let name = known.iter().copied().min().unwrap_or(column);
            group.iter_mut().filter(|g| g.is_some_and(|g| known.contains(&g))).for_each(|g| *g = Some(name));
            members.iter().for_each(|&member| group[member] = Some(name));
        }
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut names: Vec<usize> = Vec::new();
        for (column, name) in group.iter().enumerate() {
            let Some(name) = name else { continue };
            match names.iter().position(|known| known == name) {
                Some(at) => groups[at].push(column),
                None => {
                    names.push(*name);
                    groups.push(vec![column]);
                }
            }
        }
        groups
    }

    /// The independent columns, of these lengths, that matter for the dependent column at position `k`.
    fn rebuilt_from(&self, k: usize, lengths: &[f64]) -> Vec<usize> {
        checkpoint();
        let mut weights = Mat::from_fn(self.rank, 1, |i, _| self.r[(i, k)]);
        let length = norm(weights.col_as_slice(0));
        solve_upper(&self.r, self.rank, &mut weights);
        // Noise of length 1 in the column moves the weights by the inverse of R11; a share below that is not a finding.
        let least = (10.0 * self.condition / length).clamp(1e-6, 0.1);
        (0..self.rank).filter(|&i| weights[(i, 0)].abs() * lengths[i] > least * length).map(|i| self.order[i]).collect()
    }
}
