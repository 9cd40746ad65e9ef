//! The prior of a smoothing spline: a chain of integrators driven by white noise, discretised exactly.
//!
//! | symbol | here |
//! |---|---|
//! | s = (f, f', ..., f^(M-1)) | the state of the chain |
//! | F | transition over a step dt: `F[i][j] = dt^(j-i) / (j-i)!` |
//! | Q = L L' | covariance of what the noise adds over a step: `Q[i][j] = q dt^(2M-1-i-j) / ((2M-1-i-j) (M-1-i)! (M-1-j)!)` |
//! | q | spectral density of the noise, in units of the variance of a measurement of weight one: 1 / lambda |

use super::number::Number;

/// A small square matrix, row by row.
pub(crate) type Matrix<const M: usize, T = f64> = [[T; M]; M];

/// A chain of `M` integrators.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain<const M: usize, T = f64> {
    /// L of a step of 1 s and q of one.
    root: Matrix<M>,
    /// q.
    pub(super) density: T,
}

/// A chain over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<const M: usize, T: Number = f64> {
    /// `dt^k / k!`.
    pub(super) powers: [T::Shared; M],
    /// L over the square root of q dt.
    pub(crate) noise: Matrix<M, T::Shared>,
    /// q dt.
    pub(crate) variance: T,
}

impl<const M: usize, T: Number> Chain<M, T> {
    /// The prior of a spline whose penalty, the integral of the squared M-th derivative, is multiplied by 1 / q.
    pub(crate) fn new(density: T) -> Self {
        let factorial = |k: usize| (1..=k).map(|i| i as f64).product::<f64>();
        let covariance =
            |i: usize, j: usize| 1.0 / ((2 * M - 1 - i - j) as f64 * factorial(M - 1 - i) * factorial(M - 1 - j));
        let mut root = [[0.0; M]; M];
        for i in 0..M {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| root[i][k] * root[j][k]).sum();
                let rest = covariance(i, j) - known;
                root[i][j] = if i == j { rest.sqrt() } else { rest / root[j][j] };
            }
        }
        Self { root, density }
    }

    /// The chain over a step of `dt`.
    #[inline(always)]
    pub(crate) fn step(&self, dt: T::Shared) -> Step<M, T> {
        let one = dt.like(1.0);
        let mut powers = [one; M];
        for k in 1..M {
            powers[k] = (powers[k - 1] * dt).times(1.0 / k as f64);
        }
        let (mut noise, mut scale) = ([[one; M]; M], one);
        for i in (0..M).rev() {
            for j in 0..M {
                noise[i][j] = scale.times(self.root[i][j]);
            }
            scale = scale * dt;
        }
        Step { powers, noise, variance: self.density.by(dt) }
    }
}

impl<const M: usize> Chain<M> {
    /// The same chain in other numbers.
    #[inline(always)]
    pub(super) fn with<T: Number>(&self, density: T) -> Chain<M, T> {
        Chain { root: self.root, density }
    }
}

impl<const M: usize> Step<M> {
    /// L.
    pub(crate) fn root(&self) -> Matrix<M> {
        let size = self.variance.sqrt();
        self.noise.map(|row| row.map(|entry| entry * size))
    }
}

impl<const M: usize, T: Number> Step<M, T> {
    /// F s.
    #[inline(always)]
    pub(crate) fn forward<N: Number<Shared = T::Shared>>(&self, state: &[N; M]) -> [N; M] {
        let mut next = *state;
        for i in 0..M {
            for j in i + 1..M {
                next[i] = state[j].fused_by(self.powers[j - i], next[i]);
            }
        }
        next
    }

    /// F^-1 s.
    #[inline(always)]
    pub(super) fn backward<N: Number<Shared = T::Shared>>(&self, state: &[N; M]) -> [N; M] {
        let mut last = *state;
        for i in 0..M {
            for j in i + 1..M {
                let share = state[j].by(self.powers[j - i]);
                last[i] = if (j - i) % 2 == 1 { last[i] - share } else { last[i] + share };
            }
        }
        last
    }

    /// F A.
    #[inline(always)]
    pub(super) fn forward_matrix<N: Number<Shared = T::Shared>>(&self, a: &Matrix<M, N>) -> Matrix<M, N> {
        let mut product = *a;
        for i in 0..M {
            for k in i + 1..M {
                for j in 0..M {
                    product[i][j] = a[k][j].fused_by(self.powers[k - i], product[i][j]);
                }
            }
        }
        product
    }

    /// F^-1 A.
    #[inline(always)]
    pub(super) fn backward_matrix<N: Number<Shared = T::Shared>>(&self, a: &Matrix<M, N>) -> Matrix<M, N> {
        let mut columns = transposed(a);
        for column in &mut columns {
            *column = self.backward(column);
        }
        transposed(&columns)
    }

    /// F^-1 A F^-T of a symmetric A.
    #[inline(always)]
    pub(super) fn backward_both<N: Number<Shared = T::Shared>>(&self, a: &Matrix<M, N>) -> Matrix<M, N> {
        let mut half = *a;
        for row in &mut half {
            *row = self.backward(row);
        }
        self.backward_matrix(&half)
    }
}

#[inline(always)]
pub(super) fn transposed<const M: usize, N: Copy>(a: &Matrix<M, N>) -> Matrix<M, N> {
    let mut columns = *a;
    for i in 0..M {
        for j in 0..M {
            columns[j][i] = a[i][j];
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// L L' against the closed form of the integrated Wiener process (Solin and Sarkka, "Applied Stochastic Differential Equations", 2019, chapter 6).
    #[test]
    fn increments_have_the_covariance_of_the_integrated_wiener_process() {
        let (dt, lambda) = (0.3_f64, 7.0);
        let root = Chain::<3>::new(1.0 / lambda).step(dt).root();
        let expected = [
            [dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0],
            [dt.powi(4) / 8.0, dt.powi(3) / 3.0, dt.powi(2) / 2.0],
            [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt],
        ];
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| root[i][k] * root[j][k]).sum();
                assert!((product * lambda / expected[i][j] - 1.0).abs() < 1e-14, "{i} {j}");
            }
        }
    }

    #[test]
    fn a_step_back_undoes_a_step() {
        let step = Chain::<3>::new(1.0_f64).step(0.7);
        let back = step.backward(&step.forward(&[1.0, -2.0, 3.0]));
        assert!(back.iter().zip([1.0, -2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-15), "{back:?}");
    }
}
