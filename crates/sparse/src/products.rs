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

/// A symmetric matrix that grows by columns, and its only copy: who works on it lends it and brings it back.
#[derive(Default)]
pub(crate) struct Pairs {
    /// The columns in the order in which they joined.
    joined: Vec<usize>,
    /// Place of a column there.
    place: Vec<Option<usize>>,
    /// Their products with each other.
    matrix: Slab,
    /// Those with themselves.
    squares: Vec<f64>,
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

    /// Columns of the products that are made pair by pair, in the order of their matrix; `None` for other products.
    pub(crate) fn joined(&self) -> Option<&[usize]> {
        match self {
            Self::Pairs { pairs, .. } => Some(&pairs.joined),
            _ => None,
        }
    }

    /// Forgets all pairs but those of the columns that are kept.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        if let Self::Pairs { pairs, .. } = self {
            pairs.retain(keep);
        }
    }

    /// The matrix of all columns that joined, out of its place until it is brought back ([`Products::bring_back`]): what is on its diagonal is the borrower's.
    pub(crate) fn lend(&mut self) -> Option<Slab> {
        match self {
            Self::Pairs { pairs, .. } => Some(std::mem::take(&mut pairs.matrix)),
            _ => None,
        }
    }

    /// Brings back what was lent; `None` where nothing was.
    pub(crate) fn bring_back(&mut self, matrix: Slab) -> Option<Slab> {
        match self {
            Self::Pairs { pairs, .. } => {
                pairs.matrix = matrix;
                None
            }
            _ => Some(matrix),
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
/// New columns that are multiplied at once, at most.
const AT_ONCE: usize = 512;

/// Some columns beside each other.
fn gathered(rows: &Slab, columns: &[usize]) -> Mat<f64> {
    let mut values = Mat::zeros(rows.rows(), columns.len());
    for (k, &j) in columns.iter().enumerate() {
        values.col_as_slice_mut(k).copy_from_slice(&rows.column(j)[..rows.rows()]);
    }
    values
}

/// Rows and columns that are mirrored at once.
const MIRROR: usize = 32;

/// Makes a matrix symmetric whose columns `first..last` say what stands above their diagonal.
pub(crate) fn mirror(matrix: &mut Slab, first: usize, last: usize) {
    for (from, to) in (0..last).step_by(MIRROR).flat_map(|i| (first..last).step_by(MIRROR).map(move |k| (i, k))) {
        for k in to..(to + MIRROR).min(last) {
            for i in from..(from + MIRROR).min(k) {
                let value = matrix.column(k)[i];
                matrix.column_mut(i)[k] = value;
            }
        }
    }
}

impl Pairs {
    fn join(&mut self, rows: &Slab, columns: &[usize]) {
        let first = self.joined.len();
        let mut new = Vec::new();
        for &j in columns {
            if self.place[j].is_none() {
                self.place[j] = Some(first + new.len());
                new.push(j);
            }
        }
        if !new.is_empty() {
            self.matrix.resize(first + new.len(), first + new.len());
        }
        new.chunks(AT_ONCE).for_each(|some| self.join_some(rows, some));
    }

    /// The products of columns that have their places.
    fn join_some(&mut self, rows: &Slab, new: &[usize]) {
        let first = self.joined.len();
        self.joined.extend_from_slice(new);
        let last = self.joined.len();
        if new.len() * rows.rows() < FEW_VALUES {
            // One column after the other against all new ones, which stay in cache meanwhile.
            for (i, &column) in self.joined.iter().enumerate() {
                checkpoint();
                for k in first.max(i)..last {
                    let product = dot(rows.column(column), rows.column(self.joined[k]));
                    (self.matrix.column_mut(k)[i], self.matrix.column_mut(i)[k]) = (product, product);
                }
            }
        } else {
            let columns = gathered(rows, &self.joined[first..]);
            let mut panels: Vec<&[usize]> = self.joined.chunks(PANEL).collect();
            let pieces = parallel_pieces(&mut panels, 1, |_, panel| {
                checkpoint();
                let mut products = Mat::zeros(panel[0].len(), last - first);
                let left = gathered(rows, panel[0]);
                matmul(products.as_mut(), Accum::Replace, left.transpose(), &columns, 1.0, Par::Seq);
                products
            });
            for (panel, products) in pieces.iter().enumerate() {
                for (k, products) in products.col_iter().enumerate() {
                    let column = &mut self.matrix.column_mut(first + k)[panel * PANEL..];
                    column.iter_mut().zip(products.iter()).for_each(|(entry, product)| *entry = *product);
                }
            }
            mirror(&mut self.matrix, first, last);
        }
        self.squares.extend((first..last).map(|k| self.matrix.column(k)[k]));
    }

    fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let kept: Vec<usize> = (0..self.joined.len()).filter(|&at| keep(self.joined[at])).collect();
        self.joined.iter().for_each(|&j| self.place[j] = None);
        self.joined = kept.iter().map(|&at| self.joined[at]).collect();
        self.joined.iter().enumerate().for_each(|(at, &j)| self.place[j] = Some(at));
        self.squares = kept.iter().map(|&at| self.squares[at]).collect();
        self.matrix.retain(&kept);
    }

    fn get(&self, i: usize, j: usize) -> f64 {
        match (self.place[i], self.place[j]) {
            (Some(i), Some(j)) if i == j => self.squares[i],
            (Some(i), Some(j)) => self.matrix.column(j)[i],
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
                let mut computed = [0.0; 4];
                products.with(j, &[0, 2, 5, 6], &mut computed);
                [0, 2, 5, 6]
                    .iter()
                    .zip(computed)
                    .for_each(|(&i, product)| assert!((product - column[i]).abs() < 1e-14));
            }
            let mut delta = vec![0.0; p];
            (delta[2], delta[6]) = (0.7, -0.2);
            let (target, mut correlations) = (problem.target_correlations(), problem.target_correlations());
            products.left(&delta, &target, &mut correlations);
            let mut expected = target.clone();
            for j in [2, 6] {
                problem.correlations_of(j, &mut column);
                (0..p).for_each(|i| expected[i] -= delta[j] * column[i]);
            }
            (0..p).for_each(|i| assert!((correlations[i] - expected[i]).abs() < 1e-14));
        }
    }

    #[test]
    fn pairs_are_forgotten_and_made_again() {
        let x = Mat::from_fn(90, 400, |i, j| ((i * (j + 3) + 5 * j) as f64 * 0.37).sin());
        let y: Vec<f64> = (0..90).map(|i| (0.9 * i as f64).cos()).collect();
        let problem = Quadratic::from_rows(x.as_ref(), &y, None, true).unwrap();
        let mut products = Products::of(&problem);
        let direct = |i: usize, j: usize| {
            let Form::Root { a, .. } = &problem.form else { panic!("rows") };
            dot(a.column(i), a.column(j))
        };
        let check = |products: &Products<'_>| {
            let joined = products.joined().unwrap();
            for &j in joined.iter().step_by(3) {
                for &i in joined {
                    let (pair, back) = (products.pair(i, j), products.pair(j, i));
                    assert!((pair - direct(i, j)).abs() < 1e-14 && pair == back, "{i} {j}");
                }
            }
            joined.to_vec()
        };
        // Few and many at once.
        products.form(&(0..5).chain(390..400).collect::<Vec<_>>());
        products.form(&(0..395).rev().collect::<Vec<_>>());
        assert_eq!(check(&products).len(), 400);
        products.retain(|j| j % 3 == 1);
        assert!(check(&products).iter().all(|j| j % 3 == 1));
        products.form(&[3, 4, 5]);
        assert_eq!(check(&products).len(), 135);
        // Lent products come back with another diagonal.
        let mut matrix = products.lend().unwrap();
        (0..135).for_each(|k| matrix.column_mut(k)[k] = 7.0);
        assert_eq!(products.bring_back(matrix), None);
        products.form(&[6]);
        assert_eq!(check(&products).len(), 136);
    }
}
