//! The Kalman filter and the smoother of a chain, both on square roots of covariances.
//!
//! A covariance is P = S S' with S lower triangular. A measurement sees the first state alone, so that it scales the first column of S and nothing
//! else; a step triangularises [F S, L] by reflectors. Neither subtracts, so that P stays positive and its smallest directions keep their digits
//! (Kaminski, Bryson, Schmidt, "Discrete square root filtering", IEEE TAC 16(6), 1971).

use super::chain::{Matrix, Step};

/// What is known of the state from the measurements up to a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Belief<const M: usize> {
    /// Mean.
    pub(crate) mean: [f64; M],
    /// S.
    pub(crate) root: Matrix<M>,
}

/// What is known of the state from all measurements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posterior<const M: usize> {
    /// Mean.
    pub(crate) mean: [f64; M],
    /// P.
    pub(crate) covariance: Matrix<M>,
}

/// A measurement beside what was expected of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Innovation {
    /// Measured less expected.
    pub(crate) error: f64,
    /// Its variance.
    pub(crate) variance: f64,
}

impl Innovation {
    /// e^2 / v.
    #[inline]
    pub(crate) fn square(self) -> f64 {
        self.error * self.error / self.variance
    }
}

/// A row of the array [A, B] that a step triangularises.
#[derive(Debug, Clone, Copy)]
struct Row<const M: usize> {
    own: [f64; M],
    noise: [f64; M],
}

impl<const M: usize> Row<M> {
    /// Reflects the row: y - v beta v'y over the columns that the reflector of row `i` has.
    #[inline]
    fn reflect(&mut self, v: &Self, i: usize, beta: f64) {
        let mut dot = 0.0;
        for j in i..M {
            dot += v.own[j] * self.own[j];
        }
        for j in 0..=i {
            dot += v.noise[j] * self.noise[j];
        }
        dot *= beta;
        for j in i..M {
            self.own[j] -= dot * v.own[j];
        }
        for j in 0..=i {
            self.noise[j] -= dot * v.noise[j];
        }
    }
}

/// Reflects the columns of [A, B] so that the rows of `head` become [lower triangular, 0]. B of `head` is lower triangular on entry; the rows `carried` go along.
#[inline]
fn triangularise<const M: usize>(head: &mut [Row<M>; M], carried: &mut [Row<M>]) {
    for i in 0..M {
        let mut v = head[i];
        let tail: f64 = v.own[i + 1..].iter().chain(&v.noise[..=i]).map(|x| x * x).sum();
        if tail == 0.0 {
            continue;
        }
        let pivot = v.own[i];
        let norm = (pivot * pivot + tail).sqrt();
        let diagonal = if pivot > 0.0 { -norm } else { norm };
        v.own[i] = pivot - diagonal;
        let beta = 1.0 / (norm * (norm + pivot.abs()));
        for row in head[i + 1..].iter_mut().chain(carried.iter_mut()) {
            row.reflect(&v, i, beta);
        }
        head[i].own[i] = diagonal;
        head[i].own[i + 1..].fill(0.0);
        head[i].noise = [0.0; M];
    }
}

impl<const M: usize> Belief<M> {
    /// A belief with this mean, and any square root of its covariance.
    pub(crate) fn new(mean: [f64; M], square_root: Matrix<M>) -> Self {
        let mut head = square_root.map(|own| Row { own, noise: [0.0; M] });
        triangularise(&mut head, &mut []);
        Self { mean, root: head.map(|row| row.own) }
    }

    /// After a step.
    #[inline]
    pub(super) fn predicted(&self, step: &Step<M>) -> Self {
        Self::stepped(step.forward(&self.mean), &step.forward_matrix(&self.root), &step.root)
    }

    /// With this mean and the covariance A A' + B B', B lower triangular.
    #[inline]
    pub(crate) fn stepped(mean: [f64; M], a: &Matrix<M>, b: &Matrix<M>) -> Self {
        let mut head: [Row<M>; M] = std::array::from_fn(|i| Row { own: a[i], noise: b[i] });
        triangularise(&mut head, &mut []);
        Self { mean, root: head.map(|row| row.own) }
    }

    /// Learns of a measurement of the first state with an error of this variance.
    #[inline]
    pub(crate) fn measure(&mut self, value: f64, variance: f64) -> Innovation {
        let first = self.root[0][0];
        let innovation = Innovation { error: value - self.mean[0], variance: first * first + variance };
        let gain = first * innovation.error / innovation.variance;
        let shrink = (variance / innovation.variance).sqrt();
        for i in 0..M {
            self.mean[i] += self.root[i][0] * gain;
            self.root[i][0] *= shrink;
        }
        innovation
    }

    /// Learns of a measurement of `slopes` times the state with an error of this variance.
    ///
    /// A reflector turns the columns of S so that the measurement sees the first alone, which is scaled as in [`Belief::measure`].
    pub(crate) fn measure_along(&mut self, slopes: &[f64; M], value: f64, variance: f64) -> Innovation {
        let seen: [f64; M] = std::array::from_fn(|j| (0..M).map(|i| slopes[i] * self.root[i][j]).sum());
        let square: f64 = seen.iter().map(|x| x * x).sum();
        let expected: f64 = slopes.iter().zip(&self.mean).map(|(slope, state)| slope * state).sum();
        let innovation = Innovation { error: value - expected, variance: square + variance };
        let norm = square.sqrt();
        if norm == 0.0 {
            return innovation;
        }
        let first = if seen[0] > 0.0 { -norm } else { norm };
        let mut v = seen;
        v[0] -= first;
        let beta = 1.0 / (norm * (norm + seen[0].abs()));
        let (gain, shrink) = (first * innovation.error / innovation.variance, (variance / innovation.variance).sqrt());
        let mut root = self.root;
        for (row, mean) in root.iter_mut().zip(&mut self.mean) {
            let dot: f64 = beta * v.iter().zip(row.iter()).map(|(v, x)| v * x).sum::<f64>();
            row.iter_mut().zip(&v).for_each(|(x, v)| *x -= dot * v);
            *mean += row[0] * gain;
            row[0] *= shrink;
        }
        *self = Self::new(self.mean, root);
        innovation
    }

    /// At the last row nothing more will be known.
    pub(super) fn posterior(&self) -> Posterior<M> {
        let entry = |i: usize, j: usize| (0..M).map(|k| self.root[i][k] * self.root[j][k]).sum();
        Posterior { mean: self.mean, covariance: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))) }
    }

    /// The state of a row from that of the next.
    ///
    /// The state is F^-1 (s - w), s the next state and w what the noise added. Given s, w has the mean J (s - F mean) with J = Q (F P F' + Q)^-1 and a covariance Z Z';
    /// both come from the reflectors of the step, [0, L] carried along, without a difference of covariances. Under a strong penalty w is nearly nothing
    /// and its share of s keeps its digits, which the textbook's gain P F' (F P F' + Q)^-1 would not.
    #[inline]
    pub(super) fn smoothed(&self, step: &Step<M>, next: &Posterior<M>) -> Posterior<M> {
        let moved = step.forward_matrix(&self.root);
        let mut head: [Row<M>; M] = std::array::from_fn(|i| Row { own: moved[i], noise: step.root[i] });
        let mut carried: [Row<M>; M] = std::array::from_fn(|i| Row { own: [0.0; M], noise: step.root[i] });
        triangularise(&mut head, &mut carried);
        let j = divide(&carried, &head);
        let expected = step.forward(&self.mean);
        let mut end = next.mean;
        for i in 0..M {
            for k in 0..M {
                end[i] -= j[i][k] * (next.mean[k] - expected[k]);
            }
        }
        let kept: Matrix<M> = std::array::from_fn(|i| std::array::from_fn(|k| f64::from(i == k) - j[i][k]));
        let covariance = step.backward_both(&sandwich(&kept, &next.covariance, &carried.map(|row| row.noise)));
        Posterior { mean: step.backward(&end), covariance }
    }
}

/// Y S^-1, S lower triangular.
#[inline]
fn divide<const M: usize>(y: &[Row<M>; M], s: &[Row<M>; M]) -> Matrix<M> {
    let mut quotient = [[0.0; M]; M];
    for i in 0..M {
        for k in (0..M).rev() {
            let known: f64 = (k + 1..M).map(|l| quotient[i][l] * s[l].own[k]).sum();
            quotient[i][k] = (y[i].own[k] - known) / s[k].own[k];
        }
    }
    quotient
}

/// K P K' + Z Z', symmetric to the last bit.
#[inline]
pub(super) fn sandwich<const M: usize>(k: &Matrix<M>, p: &Matrix<M>, z: &Matrix<M>) -> Matrix<M> {
    let mut half = [[0.0; M]; M];
    for i in 0..M {
        for l in 0..M {
            for j in 0..M {
                half[i][j] += k[i][l] * p[l][j];
            }
        }
    }
    let mut sum = [[0.0; M]; M];
    for i in 0..M {
        for j in 0..=i {
            let mut entry = 0.0;
            for l in 0..M {
                entry += half[i][l] * k[j][l] + z[i][l] * z[j][l];
            }
            sum[i][j] = entry;
            sum[j][i] = entry;
        }
    }
    sum
}
