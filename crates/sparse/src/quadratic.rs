//! The least-squares problem that every solver here takes: a statistic, never rows.

use faer::{Accum, Mat, MatMut, Par, linalg::matmul::matmul};
use fleetfoot_data::{checkpoint, parallel_pieces};

use crate::kernel::{Slab, dot, padded};

/// A least-squares problem `1/(2n) sum s (y - x'b - b0)^2` in p regressors, known by its moments; n is the sum of the row weights s.
///
/// Held in correlation form: every column is divided by its length and the target by its own (lengths about the mean where an
/// intercept was eliminated), so that neither huge nor tiny units take part in any product. Two forms, after what it was made from:
///
/// - **square-root form**: at most max(n, p) compressed rows A, z with `A'A` the correlations of the columns, from [`Quadratic::from_square_root`] or
///   [`Quadratic::from_rows`]. Nothing is squared: solutions are as good as those of a Householder QR.
/// - **Gram form**: the correlations themselves, from [`Quadratic::from_gram`] or [`Quadratic::from_products`]. Digits are lost to
///   the square of the condition number; it is the cheaper form, and the one for thousands of columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Quadratic {
    pub(crate) weight: f64,
    /// Length of every column; 0 for columns that take no part because they do not vary.
    pub(crate) length: Vec<f64>,
    /// Length of the target; 0 when it does not vary.
    pub(crate) size: f64,
    pub(crate) means: Option<Means>,
    /// Rounding of every column, relative to its length.
    pub(crate) noise: Vec<f64>,
    pub(crate) form: Form,
}

/// Means that were subtracted: the intercept is `y - x'b` there.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Means {
    pub(crate) x: Vec<f64>,
    pub(crate) y: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Form {
    /// Compressed rows A (m x p, unit columns) and z (padded), and the squared length of the unit target beyond them.
    Root { a: Slab, z: Vec<f64>, beyond: f64 },
    /// Correlations of the columns (p x p) and with the target (padded).
    Gram { g: Slab, c: Vec<f64> },
}

impl Quadratic {
    /// Number of regressors, p.
    pub fn columns(&self) -> usize {
        self.length.len()
    }

    /// Sum of the row weights, n: the number of rows where they are 1.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Returns true if an intercept was eliminated by centring; every solution then has it back.
    pub fn has_intercept(&self) -> bool {
        self.means.is_some()
    }

    /// Root mean square of every regressor, about its mean where there is an intercept (p); 0 for columns that do not vary.
    pub fn deviation(&self) -> Vec<f64> {
        let root = self.weight.sqrt();
        self.length.iter().map(|length| length / root).collect()
    }

    /// Root mean square of the target, about its mean where there is an intercept.
    pub fn target_deviation(&self) -> f64 {
        self.size / self.weight.sqrt()
    }

    /// Columns that do not vary (that are zero, where there is no intercept): their coefficients are 0 in every solution.
    pub fn constant(&self) -> Vec<usize> {
        (0..self.columns()).filter(|&j| self.length[j] == 0.0).collect()
    }

    /// Correlations of the columns with what `delta` leaves of the target, and its squared length, in correlation form: one column of
    /// coefficients (p) a problem.
    ///
    /// Computed from the statistic alone, without anything a solver knows.
    pub(crate) fn residual_correlations(&self, delta: &Slab) -> (Slab, Vec<f64>) {
        let (p, count) = (self.columns(), delta.columns());
        let mut correlations = Slab::zeros(p, count);
        let rss = match &self.form {
            Form::Root { a, z, beyond } => {
                let explained = explained(a, delta);
                let left = Slab::from_fn(a.rows(), count, |i, k| z[i] - explained[(i, k)]);
                let products = products(a, &left);
                for k in 0..count {
                    let column = correlations.column_mut(k)[..p].iter_mut().enumerate();
                    column.for_each(|(j, value)| *value = products[(k, j)]);
                }
                (0..count).map(|k| dot(left.column(k), left.column(k)) + beyond).collect()
            }
            Form::Gram { g, c } => {
                let explained = if p < MANY { explained(g, delta).transpose().to_owned() } else { products(g, delta) };
                let left = |k: usize| {
                    let delta = delta.column(k);
                    // 1 - 2 c'd + d'Gd, by the residual correlations.
                    let term = |left: f64, j: usize| left - (2.0 * c[j] - explained[(k, j)]) * delta[j];
                    (0..p).fold(f64::from(self.size > 0.0), term)
                };
                let rss = (0..count).map(|k| left(k).max(0.0)).collect();
                for k in 0..count {
                    for (j, value) in correlations.column_mut(k)[..p].iter_mut().enumerate() {
                        *value = c[j] - explained[(k, j)];
                    }
                }
                rss
            }
        };
        (correlations, rss)
    }

    /// Correlations of column j with all columns (padded), written to `out`.
    pub(crate) fn correlations_of(&self, j: usize, out: &mut [f64]) {
        match &self.form {
            Form::Root { a, .. } => a.products(a.column(j), &mut out[..self.columns()]),
            Form::Gram { g, .. } => out.copy_from_slice(g.column(j)),
        }
    }

    /// Correlations of the columns with the target (padded).
    pub(crate) fn target_correlations(&self) -> Vec<f64> {
        match &self.form {
            Form::Root { a, z, .. } => {
                let mut c = vec![0.0; padded(self.columns()).max(8)];
                a.products(z, &mut c[..self.columns()]);
                c
            }
            Form::Gram { c, .. } => c.clone(),
        }
    }

    /// Length of the target that coefficients in correlation form are relative to.
    pub(crate) fn target_length(&self) -> f64 {
        if self.size > 0.0 { self.size } else { self.weight.sqrt() }
    }

    /// Coefficients in raw units from those in correlation form, one column.
    pub(crate) fn raw(&self, j: usize, delta: f64) -> f64 {
        if delta == 0.0 { 0.0 } else { delta * (self.target_length() / self.length[j]) }
    }

    /// Intercept of coefficients `(column, value)` in raw units; 0 without an intercept.
    pub(crate) fn intercept(&self, coefficients: impl Iterator<Item = (usize, f64)>) -> f64 {
        match &self.means {
            Some(means) => coefficients.fold(means.y, |left, (j, value)| left - means.x[j] * value),
            None => 0.0,
        }
    }
}

/// Columns from which on few coefficients are told apart from those that are zero.
const MANY: usize = 256;
/// Columns with coefficients that are multiplied at once.
const AT_ONCE: usize = 256;
/// Values of the columns that one thread multiplies at once.
const PIECE: usize = 1 << 16;

/// `A D` (m x k): by the columns that have coefficients where these are few of many.
fn explained(a: &Slab, delta: &Slab) -> Mat<f64> {
    let (p, count) = (a.columns(), delta.columns());
    let mut explained = Mat::zeros(a.rows(), count);
    let used = |&j: &usize| (0..count).any(|k| delta.column(k)[j] != 0.0);
    let some: Vec<usize> = if p < MANY { Vec::new() } else { (0..p).filter(used).collect() };
    if p < MANY || 2 * some.len() > p {
        matmul(explained.as_mut(), Accum::Replace, a.as_mat(), delta.as_mat(), 1.0, Par::Seq);
        return explained;
    }
    for some in some.chunks(AT_ONCE) {
        let mut columns = Slab::zeros(a.rows(), some.len());
        some.iter().enumerate().for_each(|(at, &j)| columns.column_mut(at).copy_from_slice(a.column(j)));
        let values = Mat::from_fn(some.len(), count, |at, k| delta.column(k)[some[at]]);
        matmul(explained.as_mut(), Accum::Add, columns.as_mat(), &values, 1.0, Par::Seq);
    }
    explained
}

/// `B'A` (k x p), some columns of A at a time.
fn products(a: &Slab, b: &Slab) -> Mat<f64> {
    let (p, count) = (a.columns(), b.columns());
    if p < MANY {
        let mut products = Mat::zeros(p, count);
        matmul(products.as_mut(), Accum::Replace, a.as_mat().transpose(), b.as_mat(), 1.0, Par::Seq);
        return products.transpose().to_owned();
    }
    let mut values = vec![0.0; p * count];
    let at_once = (PIECE / a.stride()).max(1);
    parallel_pieces(&mut values, at_once * count.max(1), |piece, values| {
        checkpoint();
        let width = values.len() / count;
        let out = MatMut::from_column_major_slice_mut(values, count, width);
        matmul(out, Accum::Replace, b.as_mat().transpose(), a.as_mat().subcols(piece * at_once, width), 1.0, Par::Seq);
    });
    Mat::from_fn(count, p, |k, j| values[j * count + k])
}
