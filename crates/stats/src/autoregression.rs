//! Vector autoregressions by their autocovariances.

use faer::{Mat, Side, linalg::solvers::Solve};

/// A vector autoregression of q numbers, `r_k = sum_j Phi_j r_(k-j) + e_k` with e white.
#[derive(Debug, Clone, PartialEq)]
pub struct Autoregression {
    /// `[Phi_1 ... Phi_p]`: q x (p q) by rows.
    pub coefficients: Vec<f64>,
    /// The covariance of e: q x q by rows, symmetric to the bit.
    pub innovation: Vec<f64>,
    /// The covariance of `(r_k, ..., r_(k-p+1))`: (p q) x (p q) by rows, symmetric to the bit.
    pub stationary: Vec<f64>,
    /// The logarithm of the determinant of `innovation`.
    pub log_determinant: f64,
}

impl Autoregression {
    /// The autoregression whose autocovariances `E r_k r_(k-h)'` of lag 0, 1, ..., p (q x q by rows) are these: the equations of Yule and Walker (Luetkepohl, *New Introduction to Multiple Time
    /// Series Analysis*, section 3.3.4). It is stable where the autocovariances are those of any series, in whole or divided by one number of rows for all lags. `None` where they are not positive
    /// definite.
    ///
    /// # Panics
    /// When there is no lag 0, or a matrix is not q x q.
    pub fn yule_walker(autocovariances: &[Vec<f64>], q: usize) -> Option<Self> {
        assert!(autocovariances.iter().all(|matrix| matrix.len() == q * q), "q x q autocovariances");
        let order = autocovariances.len().checked_sub(1)?;
        // E r_(k-i) r_(k-j)' = Gamma(j - i), and Gamma(-h) = Gamma(h)'.
        let between = |i: usize, j: usize, a: usize, b: usize| match j >= i {
            true => autocovariances[j - i][a * q + b],
            false => autocovariances[i - j][b * q + a],
        };
        let all = order * q;
        // The lower triangle stands for both.
        let entry = |i: usize, j: usize| between(i / q, j / q, i % q, j % q);
        let symmetric = |i: usize, j: usize| if i >= j { entry(i, j) } else { entry(j, i) };
        let past = Mat::from_fn(all, all, symmetric);
        let ahead = Mat::from_fn(all, q, |at, a| autocovariances[at / q + 1][a * q + at % q]);
        let solved = match all {
            0 => Mat::zeros(0, q),
            _ => past.llt(Side::Lower).ok()?.solve(&ahead),
        };
        let explained = ahead.transpose() * &solved;
        let left = |a: usize, b: usize| autocovariances[0][a * q + b] - 0.5 * (explained[(a, b)] + explained[(b, a)]);
        let innovation: Vec<f64> = (0..q * q).map(|at| left((at / q).max(at % q), (at / q).min(at % q))).collect();
        let factor = Mat::from_fn(q, q, |i, j| innovation[i * q + j]).llt(Side::Lower).ok()?;
        let log_determinant = (0..q).map(|a| 2.0 * factor.L()[(a, a)].ln()).sum();
        Some(Self {
            coefficients: (0..q * all).map(|at| solved[(at % all, at / all)]).collect(),
            innovation,
            stationary: (0..all * all).map(|at| past[(at / all, at % all)]).collect(),
            log_determinant,
        })
    }

    /// Numbers of a row, q.
    pub fn targets(&self) -> usize {
        self.innovation.len().isqrt()
    }

    /// The order, p.
    pub fn order(&self) -> usize {
        let q = self.innovation.len();
        self.coefficients.len().checked_div(q).unwrap_or(0)
    }

    /// Rows that say of a mean what one independent row does, the mean of the q numbers in units of their deviations: the variance of a sum over many rows by theirs, `H cov(e) H'` with
    /// `H = (I - sum_j Phi_j)^-1`; at least 1. NaN where they have no spread.
    pub fn correlation_time(&self) -> f64 {
        let (q, p) = (self.targets(), self.order());
        let left = |a: usize, b: usize| {
            let all: f64 = (0..p).map(|j| self.coefficients[a * p * q + j * q + b]).sum();
            f64::from(u8::from(a == b)) - all
        };
        let innovation = Mat::from_fn(q, q, |a, b| self.innovation[a * q + b]);
        let inverse = Mat::from_fn(q, q, left).partial_piv_lu().solve(Mat::<f64>::identity(q, q));
        let long = &inverse * innovation * inverse.transpose();
        let variance = |a: usize| if p > 0 { self.stationary[a * p * q + a] } else { self.innovation[a * q + a] };
        ((0..q).map(|a| long[(a, a)] / variance(a)).sum::<f64>() / q as f64).max(1.0)
    }

    /// The autoregression of least BIC, `n ln|innovation| + p q^2 ln n`, of the orders that the autocovariances allow: order 0 where rows of n are as good as independent. `None` where the numbers of a row
    /// are not.
    pub fn of_least_bic(autocovariances: &[Vec<f64>], q: usize, rows: f64) -> Option<Self> {
        let orders = (0..autocovariances.len()).map_while(|p| Self::yule_walker(&autocovariances[..=p], q));
        let price = |model: &Self| rows * model.log_determinant + (model.order() * q * q) as f64 * rows.ln();
        orders.reduce(|best, next| if price(&next) < price(&best) { next } else { best })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Autocovariances of `r = Phi_1 r + Phi_2 r + e`, by the powers of its companion matrix from e on.
    fn autocovariances(phi: [[f64; 4]; 2], innovation: [f64; 4], lags: usize) -> Vec<Vec<f64>> {
        let companion = Mat::from_fn(4, 4, |i, j| match i < 2 {
            true => phi[j / 2][i * 2 + j % 2],
            false => f64::from(u8::from(i == j + 2)),
        });
        let pushed = Mat::from_fn(4, 4, |i, j| if i < 2 && j < 2 { innovation[i * 2 + j] } else { 0.0 });
        let mut all = pushed.clone();
        let mut power = companion.clone();
        for _ in 0..60 {
            all = &all + &power * &all * power.transpose();
            power = &power * &power;
        }
        let mut ahead = all;
        (0..=lags)
            .map(|_| {
                let block = (0..4).map(|at| ahead[(at / 2, at % 2)]).collect();
                ahead = &companion * &ahead;
                block
            })
            .collect()
    }

    #[test]
    fn autoregression_is_recovered_from_autocovariances() {
        let phi = [[0.9, 0.2, -0.1, 0.5], [-0.3, 0.0, 0.1, 0.2]];
        let known = autocovariances(phi, [1.0, 0.3, 0.3, 0.5], 3);
        let estimate = Autoregression::yule_walker(&known, 2).expect("a series");
        assert_eq!(estimate.order(), 3);
        for (at, value) in estimate.coefficients.iter().enumerate() {
            let (row, lag, column) = (at / 6, at % 6 / 2, at % 2);
            let truth = phi.get(lag).map_or(0.0, |matrix| matrix[row * 2 + column]);
            assert!((value - truth).abs() < 1e-12, "{at}: {value} {truth}");
        }
        for (value, truth) in estimate.innovation.iter().zip([1.0, 0.3, 0.3, 0.5]) {
            assert!((value - truth).abs() < 1e-12, "{value} {truth}");
        }
        // The third lag is worth no numbers.
        assert_eq!(Autoregression::of_least_bic(&known, 2, 1e6).expect("a series").order(), 2);
        let white = [known[0].clone(), vec![1e-4; 4]];
        assert_eq!(Autoregression::of_least_bic(&white, 2, 1e4).expect("a series").order(), 0);
    }

    #[test]
    fn first_order_autoregression_has_correlation_time() {
        // (1 + a) / (1 - a) of 0.9 and 0.5.
        let (one, other) = (0.9, 0.5);
        let estimate =
            Autoregression::yule_walker(&[vec![2.0, 0.0, 0.0, 3.0], vec![2.0 * one, 0.0, 0.0, 3.0 * other]], 2);
        let time = estimate.expect("a series").correlation_time();
        assert!((time - 0.5 * (19.0 + 3.0)).abs() < 1e-12, "{time}");
    }

    #[test]
    fn equal_values_have_no_autoregression() {
        assert_eq!(Autoregression::yule_walker(&[vec![1.0; 4], vec![0.5; 4]], 2), None);
    }
}
