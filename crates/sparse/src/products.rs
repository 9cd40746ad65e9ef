//! Products of the columns that coordinate descent needs, and no others.

use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use fleetfoot_data::{checkpoint, parallel_pieces};

use crate::{
    Quadratic,
    kernel::{Slab, add_scaled, dot},
    quadratic::Form,
};

/// Products of columns in correlation form, made when their columns first take part. What is made depends on the shape of the problem.
pub(crate) enum Products<'a> {
    /// All of them are known.
    Gram(&'a Slab),
    /// Square-root form, a triangle: whole columns of the Gram matrix.
    Columns { problem: &'a Quadratic, formed: Vec<Option<Vec<f64>>> },
    /// More columns than rows, or rows that were kept: the products of those that took part, with each other alone. The correlations of all come from the residual, in rows times
    /// columns, where columns of the Gram matrix would be as many times that as there are active ones.
    Pairs { rows: &'a Slab, target: &'a [f64], pairs: Pairs },
}

/// A symmetric matrix that grows by rows.
#[derive(Default)]
pub(crate) struct Pairs {
    /// The columns in the order in which they joined.
    joined: Vec<usize>,
    /// Place of a column there.
    place: Vec<Option<usize>>,
    /// Row k: the products with the columns that joined before, and with itself.
    products: Vec<Vec<f64>>,
}

impl<'a> Products<'a> {
    pub(crate) fn of(problem: &'a Quadratic) -> Self {
        let p = problem.columns();
        match &problem.form {
            Form::Gram { g, .. } => Self::Gram(g),
            // As many rows as columns are a triangle.
            Form::Root { a, z, .. } if a.rows() != p => {
                Self::Pairs { rows: a, target: z, pairs: Pairs { place: vec![None; p], ..Pairs::default() } }
            }
            Form::Root { .. } => Self::Columns { problem, formed: vec![None; p] },
        }
    }

    /// Makes the products of some columns available.
    pub(crate) fn form(&mut self, columns: &[usize]) {
        match self {
            Self::Gram(_) => {}
            Self::Columns { problem, formed } => {
                for &j in columns {
                    checkpoint();
                    formed[j].get_or_insert_with(|| {
                        let mut column = vec![0.0; Slab::zeros(problem.columns(), 0).stride()];
                        problem.correlations_of(j, &mut column);
                        column
                    });
                }
            }
            Self::Pairs { rows, pairs, .. } => pairs.join(rows, columns),
        }
    }

    /// The products of some columns with column j; all of them were formed.
    pub(crate) fn with(&self, j: usize, columns: &[usize], out: &mut [f64]) {
        let gather = |out: &mut [f64], column: &[f64]| {
            out.iter_mut().zip(columns).for_each(|(out, &i)| *out = column[i]);
        };
        match self {
            Self::Gram(g) => gather(out, g.column(j)),
            Self::Columns { formed, .. } => gather(out, formed[j].as_deref().unwrap_or(&[])),
            Self::Pairs { pairs, .. } => out.iter_mut().zip(columns).for_each(|(out, &i)| *out = pairs.get(i, j)),
        }
    }

    /// The product of two columns that were formed.
    pub(crate) fn pair(&self, i: usize, j: usize) -> f64 {
        match self {
            Self::Gram(g) => g.column(j)[i],
            Self::Columns { formed, .. } => formed[j].as_ref().map_or(f64::NAN, |column| column[i]),
            Self::Pairs { pairs, .. } => pairs.get(i, j),
        }
    }

    /// Correlations of all columns with what the coefficients `delta` (p) leave of the target; `target` are those with the target itself (padded), and
    /// what is not zero in `delta` was formed.
    pub(crate) fn left(&self, delta: &[f64], target: &[f64], out: &mut [f64]) {
        let active = (0..delta.len()).filter(|&j| delta[j] != 0.0);
        match self {
            Self::Gram(g) => {
                out.copy_from_slice(target);
                active.for_each(|j| add_scaled(-delta[j], g.column(j), out));
            }
            Self::Columns { formed, .. } => {
                out.copy_from_slice(target);
                let column = |j: usize| formed[j].as_deref().unwrap_or(&[]);
                active.for_each(|j| add_scaled(-delta[j], column(j), out));
            }
            Self::Pairs { rows, target, .. } => {
                let mut residual = target.to_vec();
                active.for_each(|j| add_scaled(-delta[j], rows.column(j), &mut residual));
                rows.products(&residual, &mut out[..delta.len()]);
            }
        }
    }
}

/// Values of new columns up to which they are multiplied one by one.
const FEW_VALUES: usize = 1 << 15;
/// Columns that all new ones are multiplied with at once.
const PANEL: usize = 64;

/// Some columns beside each other.
fn gathered(rows: &Slab, columns: &[usize]) -> Mat<f64> {
    let mut values = Mat::zeros(rows.rows(), columns.len());
    for (k, &j) in columns.iter().enumerate() {
        values.col_as_slice_mut(k).copy_from_slice(&rows.column(j)[..rows.rows()]);
    }
    values
}

impl Pairs {
    fn join(&mut self, rows: &Slab, columns: &[usize]) {
        let first = self.joined.len();
        for &j in columns {
            if self.place[j].is_none() {
                self.place[j] = Some(self.joined.len());
                self.joined.push(j);
            }
        }
        self.products.resize(self.joined.len(), Vec::new());
        let new = self.joined.len() - first;
        if new * rows.rows() < FEW_VALUES {
            // One column after the other against all new ones, which stay in cache meanwhile.
            for (i, &column) in self.joined.iter().enumerate() {
                checkpoint();
                for k in first.max(i)..self.joined.len() {
                    self.products[k].push(dot(rows.column(column), rows.column(self.joined[k])));
                }
            }
            return;
        }
        let columns = gathered(rows, &self.joined[first..]);
        let mut panels: Vec<&[usize]> = self.joined.chunks(PANEL).collect();
        let found = parallel_pieces(&mut panels, 1, |_, panel| {
            checkpoint();
            let mut products = Mat::zeros(panel[0].len(), new);
            let left = gathered(rows, panel[0]);
            matmul(products.as_mut(), Accum::Replace, left.transpose(), &columns, 1.0, Par::Seq);
            products
        });
        for (k, row) in self.products[first..].iter_mut().enumerate() {
            for products in &found {
                let wanted = (first + k + 1 - row.len()).min(products.nrows());
                row.extend_from_slice(&products.col_as_slice(k)[..wanted]);
            }
        }
    }

    fn get(&self, i: usize, j: usize) -> f64 {
        match (self.place[i], self.place[j]) {
            (Some(i), Some(j)) => self.products[i.max(j)][i.min(j)],
            _ => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    /// The same numbers whatever is kept: all products, columns of them, or pairs.
    #[test]
    fn every_form_gives_the_same_correlations() {
        for (n, p, kept) in [(9, 20, false), (30, 7, false), (30, 7, true)] {
            let x = Mat::from_fn(n, p, |i, j| ((i * (j + 3) + 5 * j) as f64 * 0.37).sin());
            let y: Vec<f64> = (0..n).map(|i| (0.9 * i as f64).cos() + x[(i, 2)]).collect();
            let problem = if kept { Quadratic::from_rows_as_they_are } else { Quadratic::from_rows };
            let problem = problem(x.as_ref(), &y, None, true).unwrap();
            let mut products = Products::of(&problem);
            assert_eq!(matches!(products, Products::Pairs { .. }), n < p || kept);
            products.form(&[5, 2]);
            products.form(&[2, 0, 5, 6]);
            let mut column = vec![0.0; problem.target_correlations().len()];
            for j in [0, 2, 5, 6] {
                problem.correlations_of(j, &mut column);
                let mut found = [0.0; 4];
                products.with(j, &[0, 2, 5, 6], &mut found);
                [0, 2, 5, 6].iter().zip(found).for_each(|(&i, found)| assert!((found - column[i]).abs() < 1e-14));
            }
            let mut delta = vec![0.0; p];
            (delta[2], delta[6]) = (0.7, -0.2);
            let (target, mut found) = (problem.target_correlations(), problem.target_correlations());
            products.left(&delta, &target, &mut found);
            let mut expected = target.clone();
            for j in [2, 6] {
                problem.correlations_of(j, &mut column);
                (0..p).for_each(|i| expected[i] -= delta[j] * column[i]);
            }
            (0..p).for_each(|i| assert!((found[i] - expected[i]).abs() < 1e-14));
        }
    }
}
