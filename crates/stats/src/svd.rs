//! The singular value decomposition of a small matrix, on one thread.

use faer::{
    Mat, MatRef, Par,
    diag::Diag,
    dyn_stack::{MemBuffer, MemStack},
    linalg::svd::{self as routine, ComputeSvdVectors},
};

/// `A = U diag(s) V'`.
#[derive(Debug, Clone, PartialEq)]
pub struct Svd {
    /// Left singular vectors (m x min(m, n)).
    pub u: Mat<f64>,
    /// Singular values, descending (min(m, n)).
    pub s: Vec<f64>,
    /// Right singular vectors (n x n): those beyond min(m, n) belong to the value 0.
    pub v: Mat<f64>,
}

/// The singular value decomposition of A (m x n). The same bits on any number of threads.
///
/// `None` when an entry is not finite, or the iteration does not converge.
pub fn svd(a: MatRef<'_, f64>) -> Option<Svd> {
    let (m, n) = a.shape();
    let k = m.min(n);
    if k == 0 {
        return Some(Svd { u: Mat::zeros(m, 0), s: Vec::new(), v: Mat::identity(n, n) });
    }
    if !(0..n).all(|j| (0..m).all(|i| a[(i, j)].is_finite())) {
        return None;
    }
    let (mut u, mut v, mut s) = (Mat::zeros(m, k), Mat::zeros(n, n), Diag::zeros(k));
    let (thin, full, par) = (ComputeSvdVectors::Thin, ComputeSvdVectors::Full, Par::Seq);
    let mut memory = MemBuffer::new(routine::svd_scratch::<f64>(m, n, thin, full, par, Default::default()));
    let stack = MemStack::new(&mut memory);
    routine::svd(a, s.as_mut(), Some(u.as_mut()), Some(v.as_mut()), par, stack, Default::default()).ok()?;
    Some(Svd { u, s: s.column_vector().iter().copied().collect(), v })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_rebuild_the_matrix_and_are_orthonormal() {
        for (m, n) in [(7, 4), (4, 7), (5, 5), (40, 3), (1, 3), (3, 0)] {
            let a = Mat::from_fn(m, n, |i, j| ((i * 5 + j * 11) as f64 * 0.37).sin() + 0.2 * j as f64);
            let Svd { u, s, v } = svd(a.as_ref()).unwrap();
            assert!(s.windows(2).all(|pair| pair[0] >= pair[1]) && s.iter().all(|&s| s >= 0.0));
            let rebuilt = |i: usize, j: usize| (0..s.len()).map(|k| u[(i, k)] * s[k] * v[(j, k)]).sum::<f64>();
            assert!((0..m).all(|i| (0..n).all(|j| (rebuilt(i, j) - a[(i, j)]).abs() < 1e-13)));
            let product = v.transpose() * &v;
            assert!((0..n).all(|i| (0..n).all(|j| (product[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-13)));
        }
        assert!(svd(Mat::from_fn(2, 2, |_, _| f64::NAN).as_ref()).is_none());
    }
}
