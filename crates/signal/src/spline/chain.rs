//! The prior of a smoothing spline: a chain of integrators driven by white noise, discretised exactly.
//!
//! | symbol | here |
//! |---|---|
//! | s = (f, f', ..., f^(M-1)) | the state of the chain |
//! | F | transition over a step dt: `F[i][j] = dt^(j-i) / (j-i)!` |
//! | Q = L L' | covariance of what the noise adds over a step: `Q[i][j] = q dt^(2M-1-i-j) / ((2M-1-i-j) (M-1-i)! (M-1-j)!)` |
//! | q | spectral density of the noise, in units of the variance of a measurement of weight one: 1 / lambda |

/// A small square matrix, row by row.
pub(crate) type Matrix<const M: usize> = [[f64; M]; M];

/// A chain of `M` integrators.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain<const M: usize> {
    /// L of a step of 1 s, times the square root of q.
    root: Matrix<M>,
}

/// A chain over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<const M: usize> {
    /// `dt^k / k!`.
    powers: [f64; M],
    /// L.
    pub(crate) root: Matrix<M>,
}

impl<const M: usize> Chain<M> {
    /// The prior of a spline whose penalty is `lambda` times the integral of the squared M-th derivative.
    pub(crate) fn new(lambda: f64) -> Self {
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
        let scale = lambda.sqrt().recip();
        Self { root: root.map(|row| row.map(|entry| entry * scale)) }
    }

    /// The chain over a step of `dt`.
    #[inline]
    pub(crate) fn step(&self, dt: f64) -> Step<M> {
        let mut powers = [1.0; M];
        for k in 1..M {
            powers[k] = powers[k - 1] * dt / k as f64;
        }
        let mut root = self.root;
        let mut scale = dt.sqrt();
        for row in root.iter_mut().rev() {
            for entry in row.iter_mut() {
                *entry *= scale;
            }
            scale *= dt;
        }
        Step { powers, root }
    }
}

impl<const M: usize> Step<M> {
    /// F s.
    #[inline]
    pub(crate) fn forward(&self, state: &[f64; M]) -> [f64; M] {
        let mut next = *state;
        for i in 0..M {
            for j in i + 1..M {
                next[i] += self.powers[j - i] * state[j];
            }
        }
        next
    }

    /// F^-1 s.
    #[inline]
    pub(super) fn backward(&self, state: &[f64; M]) -> [f64; M] {
        let mut last = *state;
        for i in 0..M {
            for j in i + 1..M {
                let sign = if (j - i) % 2 == 1 { -1.0 } else { 1.0 };
                last[i] += sign * self.powers[j - i] * state[j];
            }
        }
        last
    }

    /// F A.
    #[inline]
    pub(super) fn forward_matrix(&self, a: &Matrix<M>) -> Matrix<M> {
        let mut product = *a;
        for i in 0..M {
            for k in i + 1..M {
                for j in 0..M {
                    product[i][j] += self.powers[k - i] * a[k][j];
                }
            }
        }
        product
    }

    /// F^-1 A F^-T of a symmetric A.
    #[inline]
    pub(super) fn backward_both(&self, a: &Matrix<M>) -> Matrix<M> {
        let half = a.map(|row| self.backward(&row));
        let mut both = [[0.0; M]; M];
        for j in 0..M {
            let mut column = [0.0; M];
            for i in 0..M {
                column[i] = half[i][j];
            }
            let column = self.backward(&column);
            for i in 0..M {
                both[i][j] = column[i];
            }
        }
        both
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// L L' against the closed form of the integrated Wiener process (Solin and Sarkka, "Applied Stochastic Differential Equations", 2019, chapter 6).
    #[test]
    fn increments_have_the_covariance_of_the_integrated_wiener_process() {
        let (dt, lambda) = (0.3_f64, 7.0);
        let root = Chain::<3>::new(lambda).step(dt).root;
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
        let step = Chain::<3>::new(1.0).step(0.7);
        let back = step.backward(&step.forward(&[1.0, -2.0, 3.0]));
        assert!(back.iter().zip([1.0, -2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-15), "{back:?}");
    }
}
