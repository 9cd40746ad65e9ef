//! The square-root form of rows that were preconditioned before they were summed.

use faer::Mat;

use crate::{
    Gram, PivotedCholesky, Preconditioner, SquareRoot,
    householder::{condition_of, fold_rows},
    kernel::{MANY_COLUMNS, Slab, norm},
    square_root::{add_scaled, noise_level},
};

impl Preconditioner {
    /// The square-root form, in raw units, of the Gram matrix of preconditioned rows ([`Preconditioner::apply`]).
    ///
    /// A pivoted Cholesky factor of the Gram matrix is stopped where only rounding remains (relative to the diagonal, and to what
    /// [`Preconditioner::apply`] rounded); its product with T is brought to triangular form by a QR.
    ///
    /// # Panics
    /// When `gram` has another dimension.
    pub fn square_root(&self, gram: &Gram) -> SquareRoot {
        let (p, weight) = (self.regressors(), gram.weight);
        let (cholesky, made_from) = self.pivoted(gram);
        let (order, rank) = (&cholesky.order, cholesky.rank());
        let condition = condition_of(|j| cholesky.factor.column(order[j]), rank);

        let factor = self.raw_factor(&cholesky);
        let (mean_x, mean_y) = self.means(gram);
        let mut magnitude = vec![0.0; p];
        for (k, &column) in self.order().iter().enumerate() {
            magnitude[column] = made_from[k] + weight.sqrt() * mean_x[column].abs().max(self.centre()[column].abs());
        }
        // Errors of the Cholesky factor in weak directions leak into the directions that it does not see.
        let leak = if rank < p { condition } else { 1.0 };
        SquareRoot::assemble(
            (gram.rows, weight),
            (mean_x, mean_y),
            factor,
            self.left(&cholesky),
            condition * condition,
            noise_level(p) * leak,
            magnitude,
        )
    }

    /// Means in raw units, of the regressors (p) and of the targets (q), of the Gram matrix of preconditioned rows: those of [`Preconditioner::square_root`],
    /// without the rest of it.
    pub fn means(&self, gram: &Gram) -> (Vec<f64>, Vec<f64>) {
        let (p, q) = (self.regressors(), self.targets());
        let mean = |k: usize| self.column(k).iter().zip(&gram.mean).map(|(t, mean)| t * mean).sum::<f64>();
        let mut mean_x = self.centre()[..p].to_vec();
        self.order().iter().enumerate().for_each(|(k, &column)| mean_x[column] += mean(k));
        (mean_x, (p..p + q).map(|k| self.centre()[k] + mean(k)).collect())
    }

    /// The squared error, per target and in raw units, of the least squares on the rows of a Gram matrix: [`SquareRoot::residual`], without the rest of
    /// the square-root form.
    ///
    /// # Panics
    /// When `gram` has another dimension.
    pub fn residual(&self, gram: &Gram) -> Vec<f64> {
        self.left(&self.pivoted(gram).0)
    }

    /// Sums of squared residuals of the targets after a factor, in raw units (q).
    fn left(&self, cholesky: &PivotedCholesky) -> Vec<f64> {
        let p = self.regressors();
        let residual = |t: usize| {
            let size = self.column(p + t)[p + t];
            cholesky.left[p + t].max(0.0) * size * size
        };
        (0..self.targets()).map(residual).collect()
    }

    /// The pivoted Cholesky factor of the Gram matrix of preconditioned rows, and the lengths that the columns were made from.
    pub(crate) fn pivoted(&self, gram: &Gram) -> (PivotedCholesky, Vec<f64>) {
        let (p, q) = (self.regressors(), self.targets());
        assert_eq!(gram.dimension(), p + q, "a Gram matrix of the preconditioned columns");
        let weight = gram.weight;
        // Lengths about the pilot's centre: what the substitutions and products were made of.
        let length: Vec<f64> = (0..p).map(|k| (gram.get(k, k) + weight * gram.mean[k] * gram.mean[k]).sqrt()).collect();
        let made_from = |k: usize| {
            let terms: Vec<f64> = self.column(k).iter().zip(&length).map(|(t, length)| t * length).collect();
            norm(&terms)
        };
        let made_from: Vec<f64> = (0..p).map(made_from).collect();
        let floor = |k: usize| {
            if self.is_native() {
                return noise_level(p) * length[k];
            }
            let centre = self.centre()[self.order()[k]].abs() * weight.sqrt();
            noise_level(p) * (made_from[k] + centre) / self.column(k)[k].abs()
        };
        let rounding = 8.0 * (p as f64) * f64::EPSILON;
        let floor: Vec<f64> =
            (0..p).map(|k| (rounding * gram.get(k, k)).max(floor(k).powi(2)).max(f64::MIN_POSITIVE)).collect();
        // No more rows than columns leave some that depend on others.
        let factor = if gram.rows > p as u64 { PivotedCholesky::in_order } else { PivotedCholesky::new };
        (factor(p, p + q, |i, j| gram.get(i, j), &floor), made_from)
    }
}

impl Preconditioner {
    /// `[R z]` in raw units: the Cholesky factor times `[T B; 0 diag(s)]`, made triangular. Of many columns that all kept their order it is a triangle already.
    fn raw_factor(&self, cholesky: &PivotedCholesky) -> Mat<f64> {
        let (p, q) = (self.regressors(), self.targets());
        let part = |i: usize| &cholesky.factor.column(i)[..cholesky.rank()];
        let mut stack = Slab::zeros(p, p + q);
        for k in 0..p + q {
            // Only the targets' own diagonal stands below row p.
            let raw = self.order().get(k).copied().unwrap_or(k);
            let entries = self.column(k).iter().enumerate().filter(|&(i, t)| *t != 0.0 && (i < p || i == k));
            for (i, t) in entries {
                add_scaled(stack.column_mut(raw), part(i), *t);
            }
        }
        let in_order = |order: &[usize]| order.iter().copied().eq(0..p);
        if p >= MANY_COLUMNS && in_order(&cholesky.order) && in_order(self.order()) {
            // No diagonal entry is negative, as a reduction leaves them.
            let sign: Vec<f64> = (0..p).map(|i| stack.column(i)[i].signum()).collect();
            return Mat::from_fn(p, p + q, |i, j| if i <= j { sign[i] * stack.column(j)[i] } else { 0.0 });
        }
        let mut factor = Mat::zeros(p, p + q);
        fold_rows(&mut factor, &mut stack);
        factor
    }
}
