//! Problems from Gram matrices, square-root forms and compressed rows.

use faer::MatRef;
use fleetfoot_stats::{Compressed, Gram, SquareRoot};

use crate::{
    SparseError,
    kernel::{Slab, norm, padded},
    quadratic::{Form, Means, Quadratic},
};

/// Side of the squares in which a matrix is mirrored.
const SQUARE: usize = 32;

impl Quadratic {
    /// One target of a square-root form, intercept free.
    ///
    /// # Errors
    /// When there are no rows, no such target, or the statistic is not finite.
    pub fn from_square_root(root: &SquareRoot, target: usize) -> Result<Self, SparseError> {
        let (p, targets) = (root.regressors(), root.targets());
        if target >= targets {
            return Err(SparseError::NoSuchTarget { target, targets });
        }
        if root.weight.is_nan() || root.weight <= 0.0 {
            return Err(SparseError::NoRows);
        }
        let column = |j: usize| root.r.col_as_slice(j)[..=j].iter().copied();
        let finite =
            |j: usize| column(j).all(f64::is_finite) && root.mean_x[j].is_finite() && root.magnitude[j].is_finite();
        if let Some(column) = (0..p).find(|&j| !finite(j)) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        let z = root.z.col_as_slice(target);
        let residual = root.residual[target].max(0.0);
        if !(z.iter().all(|value| value.is_finite()) && residual.is_finite() && root.mean_y[target].is_finite()) {
            return Err(SparseError::TargetNotFinite);
        }
        let noise: Vec<f64> = root.magnitude.iter().map(|magnitude| root.noise * magnitude).collect();
        let means = Means { x: root.mean_x.clone(), y: root.mean_y[target] };
        let size = norm(z.iter().copied().chain([residual.sqrt()]));
        let least = root.noise * root.weight.sqrt() * means.y.abs();
        // A triangle's rows of zeros (fewer rows than columns) carry nothing but the residual.
        let empty = |i: usize| (i..p).all(|j| root.r[(i, j)] == 0.0);
        let kept: Vec<usize> = (0..p).filter(|&i| !empty(i)).collect();
        let dropped = norm((0..p).filter(|&i| empty(i)).map(|i| z[i]).chain([residual.sqrt()]));
        let entry = |i: usize, j: usize| if kept[i] <= j { root.r[(kept[i], j)] } else { 0.0 };
        let rows = Slab::from_fn(kept.len(), p, entry);
        let z = kept.iter().map(|&i| z[i]).collect();
        Ok(Self::of_compressed(root.weight, Some(means), rows, z, dropped, (size, least), noise))
    }

    /// In square-root form from raw rows A (m x p) and z (m), the length of the target `beyond` them, its whole length `size` with the length
    /// `least` below which it is rounding, and the length of rounding of every column.
    pub(crate) fn of_compressed(
        weight: f64,
        means: Option<Means>,
        mut rows: Slab,
        mut z: Vec<f64>,
        beyond: f64,
        (size, least): (f64, f64),
        mut noise: Vec<f64>,
    ) -> Self {
        let p = rows.columns();
        let mut length = vec![0.0; p];
        for j in 0..p {
            let column = rows.column_mut(j);
            let norm = norm(column.iter().copied());
            length[j] = if norm > noise[j] { norm } else { 0.0 };
            noise[j] = if length[j] > 0.0 { noise[j] / norm } else { 0.0 };
            column.iter_mut().for_each(|value| *value = if length[j] > 0.0 { *value / norm } else { 0.0 });
        }
        let size = if size > least { size } else { 0.0 };
        z.iter_mut().for_each(|value| *value = if size > 0.0 { *value / size } else { 0.0 });
        z.resize(rows.stride(), 0.0);
        let beyond = if size > 0.0 { (beyond / size).powi(2) } else { 0.0 };
        Self { weight, length, size, means, noise, form: Form::Root { a: rows, z, beyond } }
    }

    /// The last column of a centred Gram matrix on the others, or on those of `columns` (indices into the matrix), intercept free.
    ///
    /// # Errors
    /// When there are no rows, the target does not exist, or the moments are not finite or not those of any rows.
    pub fn from_gram(gram: &Gram, columns: &[usize], target: usize) -> Result<Self, SparseError> {
        let d = gram.dimension();
        if let Some(&target) = columns.iter().chain([&target]).find(|&&column| column >= d) {
            return Err(SparseError::NoSuchTarget { target, targets: d });
        }
        let moments = scatter(gram, columns);
        let xy = columns.iter().map(|&column| gram.get(column, target)).collect();
        let means = Means { x: columns.iter().map(|&column| gram.mean[column]).collect(), y: gram.mean[target] };
        Self::of_moments(gram.weight, Some(means), moments, xy, gram.get(target, target), true)
    }

    /// As [`Quadratic::from_gram`], without an intercept: the means return to the products.
    ///
    /// # Errors
    /// As [`Quadratic::from_gram`].
    pub fn from_gram_at_origin(gram: &Gram, columns: &[usize], target: usize) -> Result<Self, SparseError> {
        let d = gram.dimension();
        if let Some(&target) = columns.iter().chain([&target]).find(|&&column| column >= d) {
            return Err(SparseError::NoSuchTarget { target, targets: d });
        }
        let product = |i: usize, j: usize| gram.get(i, j) + gram.weight * gram.mean[i] * gram.mean[j];
        let mut moments = scatter(gram, columns);
        for (j, &column) in columns.iter().enumerate() {
            let values = moments.column_mut(j).iter_mut().zip(columns);
            values.for_each(|(value, &other)| *value += gram.weight * gram.mean[other] * gram.mean[column]);
        }
        let xy = columns.iter().map(|&column| product(column, target)).collect();
        Self::of_moments(gram.weight, None, moments, xy, product(target, target), true)
    }

    /// As [`Quadratic::from_products`], the Gram matrix column after column (p x p), where `y'y` need not be known: then solutions are right, but
    /// [`Solution::mse`](crate::Solution), [`Solution::r2`](crate::Solution) and what else is relative to the target's length are relative to
    /// `sum_j (x_j'y)^2 / x_j'x_j` in its place.
    ///
    /// # Errors
    /// As [`Quadratic::from_products`].
    pub fn from_dense_products(gram: &[f64], xy: &[f64], yy: Option<f64>, n: f64) -> Result<Self, SparseError> {
        let p = xy.len();
        if gram.len() != p * p {
            return Err(SparseError::Length { what: "the Gram matrix", actual: gram.len(), expected: p * p });
        }
        let gram = MatRef::from_column_major_slice(gram, p, p);
        let share = |j: usize| if gram[(j, j)] > 0.0 { xy[j] * (xy[j] / gram[(j, j)]) } else { 0.0 };
        Self::from_products(gram, xy, yy.unwrap_or_else(|| (0..p).map(share).sum()), n)
    }

    /// From plain products `X'X` (p x p), `X'y` (p) and `y'y` of rows whose weights sum to n, without an intercept (or of rows that were centred).
    ///
    /// # Errors
    /// When n is not positive, the shapes disagree, or the moments are not finite or not those of any rows.
    pub fn from_products(gram: MatRef<'_, f64>, xy: &[f64], yy: f64, n: f64) -> Result<Self, SparseError> {
        let p = xy.len();
        for size in [gram.nrows(), gram.ncols()] {
            if size != p {
                return Err(SparseError::Length { what: "the Gram matrix", actual: size, expected: p });
            }
        }
        Self::of_moments(n, None, Slab::from_fn(p, p, |i, j| gram[(i, j)]), xy.to_vec(), yy, false)
    }

    /// `symmetric`: the products are so by how they were made, and nobody needs to look.
    fn of_moments(
        weight: f64,
        means: Option<Means>,
        mut g: Slab,
        mut c: Vec<f64>,
        yy: f64,
        symmetric: bool,
    ) -> Result<Self, SparseError> {
        let p = c.len();
        if !(weight > 0.0 && weight.is_finite()) {
            return Err(SparseError::NoRows);
        }
        if let Some(column) = (0..p).find(|&j| !g.column(j)[..p].iter().all(|value| value.is_finite())) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        if !(yy.is_finite() && c.iter().all(|value| value.is_finite())) {
            return Err(SparseError::TargetNotFinite);
        }
        if let Some(column) = (0..p).find(|&j| g.column(j)[j] < 0.0).or((yy < 0.0).then_some(p)) {
            return Err(SparseError::NotMoments { column, other: column, targets: p });
        }
        // Rounding of a centred sum of squares is relative to the square of what was centred.
        let level = 16.0 * f64::EPSILON;
        let shift = |mean: f64| level * level * weight * mean * mean;
        let varies = |square: f64, mean: f64| if square > shift(mean) { square.sqrt() } else { 0.0 };
        let mean = |j: usize| means.as_ref().map_or(0.0, |means| means.x[j]);
        let length: Vec<f64> = (0..p).map(|j| varies(g.column(j)[j], mean(j))).collect();
        let size = varies(yy, means.as_ref().map_or(0.0, |means| means.y));
        for j in 0..p {
            let values = g.column_mut(j)[..p].iter_mut().zip(&length);
            values.for_each(|(value, &other)| *value = unit(*value, other, length[j]));
            c[j] = unit(c[j], length[j], size);
        }
        let slack = 1.0 + 1e-9;
        for j in 0..p {
            let column = &g.column(j)[..p];
            let asymmetric = |i: usize| !symmetric && (column[i] - g.column(i)[j]).abs() > 1e-9;
            if let Some(other) = (0..p).find(|&i| column[i].abs() > slack || asymmetric(i)) {
                return Err(SparseError::NotMoments { column: j, other, targets: p });
            }
            if c[j].abs() > slack {
                return Err(SparseError::NotMoments { column: j, other: p, targets: p });
            }
        }
        c.resize(padded(p).max(8), 0.0);
        let noise = vec![0.0; p];
        Ok(Self { weight, length, size, means, noise, form: Form::Gram { g, c } })
    }

    /// One target of compressed rows, without an intercept of its own: the constant, where there is one, is a column like the others, and free when its penalty
    /// factor is 0.
    ///
    /// # Errors
    /// When there are no rows, no such target, or the statistic is not finite.
    pub fn from_compressed(problem: &Compressed, target: usize) -> Result<Self, SparseError> {
        let (p, targets) = (problem.columns(), problem.targets());
        if target >= targets {
            return Err(SparseError::NoSuchTarget { target, targets });
        }
        if problem.weight.is_nan() || problem.weight <= 0.0 {
            return Err(SparseError::NoRows);
        }
        let finite = |&j: &usize| problem.r.col_as_slice(j)[..=j].iter().all(|value| value.is_finite());
        if let Some(column) = (0..p).find(|j| !finite(j)) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        let z = problem.z.col_as_slice(target);
        let residual = problem.residual[target].max(0.0);
        if !(z.iter().all(|value| value.is_finite()) && residual.is_finite()) {
            return Err(SparseError::TargetNotFinite);
        }
        let size = norm(z.iter().copied().chain([residual.sqrt()]));
        // A triangle's rows of zeros (fewer rows than columns) carry nothing but the residual.
        let empty = |i: usize| (i..p).all(|j| problem.r[(i, j)] == 0.0);
        let kept: Vec<usize> = (0..p).filter(|&i| !empty(i)).collect();
        let beyond = norm((0..p).filter(|&i| empty(i)).map(|i| z[i]).chain([residual.sqrt()]));
        let entry = |i: usize, j: usize| if kept[i] <= j { problem.r[(kept[i], j)] } else { 0.0 };
        let rows = Slab::from_fn(kept.len(), p, entry);
        let z = kept.iter().map(|&i| z[i]).collect();
        Ok(Self::of_compressed(problem.weight, None, rows, z, beyond, (size, 0.0), problem.noise.clone()))
    }
}

/// Centred second moments of some columns with each other.
fn scatter(gram: &Gram, columns: &[usize]) -> Slab {
    let mut moments = Slab::zeros(columns.len(), columns.len());
    for (k, &column) in columns.iter().enumerate() {
        let values = moments.column_mut(k)[..=k].iter_mut().zip(columns);
        values.for_each(|(value, &other)| *value = gram.get(column, other));
    }
    mirror(&mut moments);
    moments
}

/// Copies what is above the diagonal below it, in squares that stay in cache.
fn mirror(matrix: &mut Slab) {
    let p = matrix.columns();
    let mut square = [[0.0; SQUARE]; SQUARE];
    for top in (0..p).step_by(SQUARE) {
        let rows = top..(top + SQUARE).min(p);
        for left in (top..p).step_by(SQUARE) {
            let columns = left..(left + SQUARE).min(p);
            for (line, j) in square.iter_mut().zip(columns.clone()) {
                line[..rows.len()].copy_from_slice(&matrix.column(j)[rows.clone()]);
            }
            for (at, i) in rows.clone().enumerate() {
                let target = matrix.column_mut(i);
                columns.clone().zip(&square).filter(|(j, _)| *j > i).for_each(|(j, line)| target[j] = line[at]);
            }
        }
    }
}

fn unit(value: f64, length: f64, other: f64) -> f64 {
    if length > 0.0 && other > 0.0 { value / length / other } else { 0.0 }
}
