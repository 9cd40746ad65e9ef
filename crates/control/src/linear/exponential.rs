//! The exponential of a matrix.

use faer::{Mat, MatRef, Scale, linalg::solvers::Solve};

use super::{is_finite, norm};

/// Coefficients of the diagonal Pade approximant of degree 13 (Higham 2005, equation (2.4) and table 2.3).
const PADE: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];

/// The largest norm for which the approximant is exact to rounding (table 2.3, theta_13).
const LARGEST: f64 = 5.371_920_351_148_152;

/// exp(A) by scaling and squaring with a Pade approximant of degree 13 (Higham, "The scaling and squaring method for the matrix exponential revisited", SIAM J.
/// Matrix Anal. Appl. 26, 2005). NaN where A is not finite or its exponential is not.
///
/// # Panics
/// If A is not square.
pub fn exponential(a: MatRef<'_, f64>) -> Mat<f64> {
    let n = a.nrows();
    assert_eq!(n, a.ncols(), "a square matrix");
    if n == 0 || !is_finite(a) {
        return Mat::from_fn(n, n, |_, _| f64::NAN);
    }
    let squarings = (norm(a) / LARGEST).log2().ceil().max(0.0);
    if squarings > 1000.0 {
        return Mat::from_fn(n, n, |_, _| f64::NAN);
    }
    let a = Scale((-squarings).exp2()) * a;
    let identity = Mat::<f64>::identity(n, n);
    let a2 = &a * &a;
    let a4 = &a2 * &a2;
    let a6 = &a2 * &a4;
    let sum = |first: usize| {
        // The even (or, of a factor A, the odd) powers from `first` on, the highest ones grouped by A^6.
        let high = Mat::from_fn(n, n, |i, j| {
            PADE[first + 12] * a6[(i, j)] + PADE[first + 10] * a4[(i, j)] + PADE[first + 8] * a2[(i, j)]
        });
        let low = Mat::from_fn(n, n, |i, j| {
            PADE[first + 6] * a6[(i, j)]
                + PADE[first + 4] * a4[(i, j)]
                + PADE[first + 2] * a2[(i, j)]
                + PADE[first] * identity[(i, j)]
        });
        &a6 * high + low
    };
    // Powers 1, 3, ..., 13 and 0, 2, ..., 12.
    let odd = &a * sum(1);
    let even = sum(0);
    let mut power = (&even - &odd).partial_piv_lu().solve(&even + &odd);
    for _ in 0..squarings as usize {
        power = &power * &power;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
        norm((a - b).as_ref()) / norm(b.as_ref())
    }

    #[test]
    fn closed_forms() {
        // A rotation, a chain of integrators, and a matrix that needs many squarings.
        for angle in [0.0, 1e-9, 0.3, 40.0f64] {
            let a = Mat::from_fn(2, 2, |i, j| [[0.0, -angle], [angle, 0.0]][i][j]);
            let (s, c) = angle.sin_cos();
            let expected = Mat::from_fn(2, 2, |i, j| [[c, -s], [s, c]][i][j]);
            assert!(distance(&exponential(a.as_ref()), &expected) < 1e-14 * angle.max(1.0));
        }
        let h: f64 = 0.01;
        let chain = exponential(Mat::from_fn(4, 4, |i, j| if j == i + 1 { h } else { 0.0 }).as_ref());
        for (k, factorial) in [1.0, 1.0, 2.0, 6.0].into_iter().enumerate() {
            assert!((chain[(0, k)] - h.powi(k as i32) / factorial).abs() <= 1e-15 * h.powi(k as i32));
        }
        let a = Mat::from_fn(1, 1, |_, _| -300.0);
        assert!((exponential(a.as_ref())[(0, 0)] / (-300.0f64).exp() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_dense_matrix_agrees_with_scipy() {
        // scipy 1.17.1: the first row of expm(a).
        let a = Mat::from_fn(6, 6, |i, j| 0.9 * ((3 * i + 7 * j) as f64).sin());
        let scipy = [
            0.8988973524515422,
            0.5246655189123316,
            0.8921956825168711,
            0.8205911538173329,
            0.3450953589972504,
            -0.3002548155944545,
        ];
        let power = exponential(a.as_ref());
        assert!(scipy.iter().enumerate().all(|(j, scipy)| (power[(0, j)] - scipy).abs() < 1e-13));
    }

    #[test]
    fn the_inverse_is_the_exponential_of_the_opposite() {
        let a = Mat::from_fn(6, 6, |i, j| 0.9 * ((3 * i + 7 * j) as f64).sin());
        let product = exponential(a.as_ref()) * exponential((-&a).as_ref());
        assert!(distance(&product, &Mat::identity(6, 6)) < 1e-12);
        assert!(exponential(Mat::from_fn(2, 2, |_, _| f64::NAN).as_ref())[(0, 0)].is_nan());
    }
}
