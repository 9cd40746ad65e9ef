//! The Kalman filter of a chain, on covariances as products of triangles.
//!
//! A covariance is P = L D L' with L lower triangular, of ones on its diagonal, and D diagonal. A measurement of the first state scales the first entry of D and nothing else; a step orthogonalises the rows of [F L, N] under the weights
//! [D, q dt] (modified weighted Gram and Schmidt: Thornton and Bierman, "Gram-Schmidt algorithms for covariance propagation", International Journal of Control 25, 1977). Neither subtracts, so that D stays positive and the
//! smallest directions keep their digits, as in a filter on square roots; of these none is needed. Of two states all of it is a closed form, whose every term is positive.

use super::{
    chain::{Matrix, Step, transposed},
    number::Number,
};

/// Distribution of the state given the measurements up to a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Belief<const M: usize, T = f64> {
    /// Mean.
    pub(crate) mean: [T; M],
    /// D on the diagonal, L below.
    pub(crate) factor: Matrix<M, T>,
}

/// Distribution of the state given all measurements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posterior<const M: usize> {
    /// Mean.
    pub(crate) mean: [f64; M],
    /// P.
    pub(crate) covariance: Matrix<M>,
}

/// A measurement beside what was expected of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Innovation<T = f64> {
    /// Measured less expected.
    pub(crate) error: T,
    /// Its variance.
    pub(crate) variance: T,
    /// One over its variance.
    pub(crate) weight: T,
}

impl<T: Number> Innovation<T> {
    #[inline(always)]
    fn new(error: T, variance: T) -> Self {
        Self { error, variance, weight: variance.inverse() }
    }

    /// e^2 / v.
    #[inline(always)]
    pub(crate) fn square(self) -> T {
        self.error * self.error * self.weight
    }
}

/// A row of the array [A, N] that a step orthogonalises.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<const M: usize, T> {
    pub(super) state: [T; M],
    noise: [T; M],
}

/// Weights of the array's columns: D, and q dt.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights<const M: usize, T> {
    state: [T; M],
    noise: T,
}

impl<const M: usize, T: Number> Row<M, T> {
    /// The row times the weights, of the first so many columns of noise.
    #[inline(always)]
    pub(super) fn weighted(&self, weights: &Weights<M, T>, noises: usize) -> Self {
        let mut weighted = *self;
        for j in 0..M {
            weighted.state[j] = weighted.state[j] * weights.state[j];
        }
        for j in 0..noises {
            weighted.noise[j] = weighted.noise[j] * weights.noise;
        }
        weighted
    }

    #[inline(always)]
    pub(super) fn dot(&self, other: &Self, noises: usize) -> T {
        let (mut sum, mut noise) = (self.state[0] * other.state[0], self.noise[0] * other.noise[0]);
        for j in 1..M {
            sum = self.state[j].fused(other.state[j], sum);
        }
        for j in 1..noises {
            noise = self.noise[j].fused(other.noise[j], noise);
        }
        sum + noise
    }

    #[inline(always)]
    fn subtract(&mut self, share: T, other: &Self, noises: usize) {
        for j in 0..M {
            self.state[j] = self.state[j] - share * other.state[j];
        }
        for j in 0..noises {
            self.noise[j] = self.noise[j] - share * other.noise[j];
        }
    }
}

/// Makes the rows of `head` orthogonal, each to those before it, N of which is lower triangular on entry. D on the diagonal and L below it; the rows `carried` are made orthogonal to all of them, and have their shares in them handed back.
#[inline(always)]
pub(super) fn orthogonalise<const M: usize, const N: usize, T: Number>(
    head: &mut [Row<M, T>; M],
    carried: &mut [Row<M, T>; N],
    weights: &Weights<M, T>,
) -> (Matrix<M, T>, [[T; M]; N]) {
    let zero = weights.noise.like(0.0);
    let (mut factor, mut shares) = ([[zero; M]; M], [[zero; M]; N]);
    for i in 0..M {
        let (v, noises) = (head[i], i + 1);
        let weighted = v.weighted(weights, noises);
        let square = v.dot(&weighted, noises);
        let inverse = square.inverse();
        factor[i][i] = square;
        for j in i + 1..M {
            let share = head[j].dot(&weighted, noises) * inverse;
            head[j].subtract(share, &v, noises);
            factor[j][i] = share;
        }
        for j in 0..N {
            let share = carried[j].dot(&weighted, noises) * inverse;
            carried[j].subtract(share, &v, noises);
            shares[j][i] = share;
        }
    }
    (factor, shares)
}

/// The diagonal D, and L.
#[inline(always)]
fn parted<const M: usize, T: Number>(factor: &Matrix<M, T>) -> ([T; M], Matrix<M, T>) {
    let (mut diagonal, mut lower) = (factor[0], *factor);
    for i in 0..M {
        diagonal[i] = factor[i][i];
        for j in i..M {
            lower[i][j] = diagonal[i].like(if i == j { 1.0 } else { 0.0 });
        }
    }
    (diagonal, lower)
}

/// The covariance of a chain of two over a step.
pub(super) struct Two<T> {
    /// F P F'.
    pub(super) a: Matrix<2, T>,
    /// Its determinant, and that of F P F' + Q.
    pub(super) determinants: [T; 2],
    /// F L's first column.
    pub(super) first: [T; 2],
    /// First column of F P F' + Q.
    pub(super) column: [T; 2],
}

impl<T: Number> Two<T> {
    /// Determinants are sums of the squares of all minors under their weights (Cauchy and Binet): no term is negative.
    #[inline(always)]
    pub(super) fn new([a, l, d]: [T; 3], h: T::Shared, q: T) -> Self {
        let square = h * h;
        let u = l.by(h);
        let p = u.plus(1.0);
        let (ap, al) = (a * p, a * l);
        let first = ap.fused(p, d.by(square));
        let crossed = ap.fused(l, d.by(h));
        let middle = u.times(0.5).plus(1.0);
        let turned = middle.fused(middle, (u * u).times(1.0 / 12.0));
        let grown = q.fused_by(square.times(1.0 / 12.0), a.fused(turned, d.by(square.times(1.0 / 3.0))));
        let variance = a * d;
        let whole = q.fused(grown, variance);
        Self {
            a: [[first, crossed], [crossed, al.fused(l, d)]],
            determinants: [variance, whole],
            first: [p, l],
            column: [q.fused_by(square.times(1.0 / 3.0), first), q.fused_by(h.times(0.5), crossed)],
        }
    }
}

impl<const M: usize> Belief<M> {
    /// A belief with this mean, and any square root of its covariance.
    pub(crate) fn new(mean: [f64; M], square_root: Matrix<M>) -> Self {
        Self::stepped(mean, &square_root, &[1.0; M], &[[0.0; M]; M], 0.0)
    }

    /// With this mean and the covariance A D A' + v N N', N lower triangular.
    #[inline]
    pub(crate) fn stepped(mean: [f64; M], a: &Matrix<M>, d: &[f64; M], noise: &Matrix<M>, variance: f64) -> Self {
        let mut head: [Row<M, f64>; M] = std::array::from_fn(|i| Row { state: a[i], noise: noise[i] });
        Self { mean, factor: orthogonalise(&mut head, &mut [], &Weights { state: *d, noise: variance }).0 }
    }

    /// D, and L.
    pub(crate) fn parted(&self) -> ([f64; M], Matrix<M>) {
        parted(&self.factor)
    }

    /// Derivatives of D and L by a covariance, with P' the slope of the covariance and X = L^-1 P' L^-T. The derivative
    /// of D is the diagonal of X. L^-1 L' is the part of X below it, over D.
    pub(super) fn grown(&self, slope: &Matrix<M>) -> Matrix<M> {
        let (d, lower) = self.parted();
        let solved = |mut rows: Matrix<M>| {
            for i in 0..M {
                for j in 0..i {
                    for k in 0..M {
                        rows[i][k] -= lower[i][j] * rows[j][k];
                    }
                }
            }
            rows
        };
        let x = solved(transposed(&solved(*slope)));
        let mut grown = [[0.0; M]; M];
        for i in 0..M {
            grown[i][i] = x[i][i];
            for j in 0..i {
                grown[i][j] = (j + 1..=i).map(|k| lower[i][k] * x[k][j] / d[j]).sum();
            }
        }
        grown
    }

    /// Learns of a measurement of `slopes` times the state with an error of this variance (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter V, from the last state to the first).
    pub(crate) fn measure_along(&mut self, slopes: &[f64; M], value: f64, variance: f64) -> Innovation {
        let expected: f64 = slopes.iter().zip(&self.mean).map(|(slope, state)| slope * state).sum();
        let (d, lower) = self.parted();
        let (mut known, mut gain) = (variance, [0.0; M]);
        for j in (0..M).rev() {
            let seen: f64 = (j..M).map(|i| slopes[i] * lower[i][j]).sum();
            let moved = d[j] * seen;
            let next = known + moved * seen;
            self.factor[j][j] = d[j] * (known / next);
            for i in j + 1..M {
                self.factor[i][j] = lower[i][j] - gain[i] * (seen / known);
                gain[i] += lower[i][j] * moved;
            }
            gain[j] = moved;
            known = next;
        }
        let innovation = Innovation::new(value - expected, known);
        for i in 0..M {
            self.mean[i] += gain[i] * innovation.weight * innovation.error;
        }
        innovation
    }

    /// At the last row nothing more will be known.
    pub(super) fn posterior(&self) -> Posterior<M> {
        let (d, lower) = self.parted();
        let entry = |i: usize, j: usize| (0..M).map(|k| lower[i][k] * d[k] * lower[j][k]).sum();
        let mut covariance = [[0.0; M]; M];
        for i in 0..M {
            for j in 0..=i {
                covariance[i][j] = entry(i, j);
                covariance[j][i] = covariance[i][j];
            }
        }
        Posterior { mean: self.mean, covariance }
    }
}

impl<const M: usize, T: Number> Belief<M, T> {
    /// After a step.
    #[inline(always)]
    pub(super) fn predicted(&self, step: &Step<M, T>) -> Self {
        let mean = step.forward(&self.mean);
        let mut factor = self.factor;
        if M == 2 {
            let h = step.powers[1];
            let Two { determinants, column, .. } =
                Two::new([factor[0][0], factor[1][0], factor[1][1]], h, step.variance);
            let inverse = column[0].inverse();
            factor[0][0] = column[0];
            factor[1][0] = column[1] * inverse;
            factor[1][1] = determinants[1] * inverse;
        } else {
            let (weights, mut head) = self.array(step);
            factor = orthogonalise(&mut head, &mut [], &weights).0;
        }
        Self { mean, factor }
    }

    /// [F L, N] and its weights.
    #[inline(always)]
    pub(super) fn array(&self, step: &Step<M, T>) -> (Weights<M, T>, [Row<M, T>; M]) {
        let (diagonal, lower) = parted(&self.factor);
        let moved = step.forward_matrix(&lower);
        let mut head = [Row { state: diagonal, noise: diagonal }; M];
        for i in 0..M {
            head[i].state = moved[i];
            for j in 0..M {
                head[i].noise[j] = step.variance.of(step.noise[i][j]);
            }
        }
        (Weights { state: diagonal, noise: step.variance }, head)
    }

    /// Learns of a measurement of the first state with an error of this variance.
    #[inline(always)]
    pub(crate) fn measure(&mut self, value: f64, variance: T) -> Innovation<T> {
        let first = self.factor[0][0];
        let innovation = Innovation::new(first.like(value) - self.mean[0], first + variance);
        let share = first * innovation.weight;
        let moved = share * innovation.error;
        self.mean[0] = self.mean[0] + moved;
        for i in 1..M {
            self.mean[i] = self.factor[i][0].fused(moved, self.mean[i]);
        }
        self.factor[0][0] = share * variance;
        innovation
    }
}
