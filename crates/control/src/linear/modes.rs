//! Modes of a linear system, and those of them that its inputs do not reach.

use faer::{
    Mat, MatRef, Par,
    diag::Diag,
    dyn_stack::{MemBuffer, MemStack},
    linalg::evd::{self as routine, ComputeEigenvectors},
};
use fleetfoot_stats::svd;

use super::{is_finite, norm};

/// A mode grows, or stays, if its eigenvalue is this near to the unit circle: the accuracy of a defective pair of
/// eigenvalues.
const BORDER: f64 = 1e-7;
/// A row of `[A - lambda, B]` below this share of |A| is rounding.
const ROUNDING: f64 = 1e-13;
/// Singular values of rows of unit length below this say that they depend on each other.
const DEPENDENT: f64 = 1e-9;

/// A mode that does not decay and that no input reaches.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Its eigenvalue, real and imaginary part (not negative).
    pub eigenvalue: [f64; 2],
    /// Share of every state in it (n), the largest one 1: the left eigenvector, by absolute value.
    pub share: Vec<f64>,
}

/// Eigenvalues of a square matrix, real and imaginary parts; `None` where they cannot be computed.
fn eigenvalues(a: MatRef<'_, f64>) -> Option<Vec<[f64; 2]>> {
    let n = a.nrows();
    if n == 0 {
        return Some(Vec::new());
    }
    if !is_finite(a) {
        return None;
    }
    let (mut real, mut imaginary) = (Diag::zeros(n), Diag::zeros(n));
    let (none, par) = (ComputeEigenvectors::No, Par::Seq);
    let mut memory = MemBuffer::new(routine::evd_scratch::<f64>(n, none, none, par, Default::default()));
    let stack = MemStack::new(&mut memory);
    let (re, im) = (real.as_mut(), imaginary.as_mut());
    routine::evd_real(a, re, im, None, None, par, stack, Default::default()).ok()?;
    let pairs = real.column_vector().iter().zip(imaginary.column_vector().iter());
    Some(pairs.map(|(&re, &im)| [re, im]).collect())
}

/// The largest absolute value of an eigenvalue; `None` where they cannot be computed.
pub fn spectral_radius(a: MatRef<'_, f64>) -> Option<f64> {
    Some(eigenvalues(a)?.iter().map(|[re, im]| re.hypot(*im)).fold(0.0, f64::max))
}

/// The modes of `x+ = A x + B u` that do not decay and that u does not reach, by the test of Popov, Belevitch and
/// Hautus: `[A - lambda I, B]` loses rank. Without any the system is stabilisable.
///
/// Rows are compared at unit length, which changes no rank: a short sampling period makes all that inputs do small.
///
/// # Panics
/// If the shapes disagree.
pub fn unreached_modes(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Vec<Mode> {
    let n = a.nrows();
    assert!(a.ncols() == n && b.nrows() == n, "shapes");
    let mut modes: Vec<Mode> = Vec::new();
    for [re, im] in eigenvalues(a).unwrap_or_default() {
        if im < 0.0 || re.hypot(im) < 1.0 - BORDER {
            continue;
        }
        let same = |mode: &Mode| (mode.eigenvalue[0] - re).hypot(mode.eigenvalue[1] - im) <= BORDER;
        if modes.iter().any(same) {
            continue;
        }
        modes.extend(directions(a, b, re, im).into_iter().map(|share| Mode { eigenvalue: [re, im], share }));
    }
    modes
}

/// The left eigenvectors of an eigenvalue that are orthogonal to B, by absolute value.
fn directions(a: MatRef<'_, f64>, b: MatRef<'_, f64>, re: f64, im: f64) -> Vec<Vec<f64>> {
    let (n, m) = b.shape();
    let floor = ROUNDING * norm(a).max(1.0);
    // Complex numbers as pairs of real ones: [[P, -S], [S, P]] for P + iS.
    let complex = im > 0.0;
    let blocks = if complex { 2 } else { 1 };
    let entry = |row: usize, column: usize| {
        let (i, upper) = (row % n, row < n);
        if column < blocks * n {
            let (j, left) = (column % n, column < n);
            if upper == left { a[(i, j)] - if i == j { re } else { 0.0 } } else { signed(i == j, upper, im) }
        } else {
            let j = column - blocks * n;
            let on_diagonal = upper == (j < m);
            if on_diagonal { b[(i, j % m)] } else { 0.0 }
        }
    };
    let mut matrix = Mat::from_fn(blocks * n, blocks * (n + m), entry);
    let mut lengths = vec![0.0; blocks * n];
    for (row, length) in lengths.iter_mut().enumerate() {
        let norm: f64 = (0..matrix.ncols()).map(|j| matrix[(row, j)].powi(2)).sum::<f64>().sqrt();
        *length = if norm > floor { norm } else { 0.0 };
        for j in 0..matrix.ncols() {
            matrix[(row, j)] = if norm > floor { matrix[(row, j)] / norm } else { 0.0 };
        }
    }
    let Some(factors) = svd(matrix.as_ref()) else { return Vec::new() };
    // Every complex direction counts twice as a real one.
    let lost: Vec<usize> = (0..factors.s.len()).filter(|&k| factors.s[k] <= DEPENDENT).step_by(blocks).collect();
    let share = |k: usize| {
        let of = |row: usize| factors.u[(row, k)] / if lengths[row] > 0.0 { lengths[row] } else { floor };
        let sizes: Vec<f64> = (0..n).map(|i| if complex { of(i).hypot(of(i + n)) } else { of(i).abs() }).collect();
        let largest = sizes.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        sizes.into_iter().map(|value| value / largest).collect()
    };
    lost.into_iter().map(share).collect()
}

/// The imaginary part off the diagonal blocks of `A - lambda I`.
fn signed(diagonal: bool, upper: bool, im: f64) -> f64 {
    match (diagonal, upper) {
        (false, _) => 0.0,
        (true, true) => im,
        (true, false) => -im,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::exponential;

    #[test]
    fn a_rotation_that_grows_has_its_radius() {
        let a = Mat::from_fn(2, 2, |i, j| [[0.9, -0.8], [0.8, 0.9]][i][j]);
        assert!((spectral_radius(a.as_ref()).unwrap() - 0.9f64.hypot(0.8)).abs() < 1e-14);
        assert_eq!(spectral_radius(Mat::zeros(0, 0).as_ref()), Some(0.0));
        assert_eq!(spectral_radius(Mat::from_fn(1, 1, |_, _| f64::NAN).as_ref()), None);
    }

    #[test]
    fn unreached_modes_are_named_at_any_rate() {
        for h in [1.0, 1e-2, 1e-4] {
            // A chain of three integrators, and a state that rotates with another beside it, which nothing drives.
            let generator = Mat::from_fn(6, 6, |i, j| match (i, j) {
                (0, 1) | (1, 2) | (2, 5) => h,
                (3, 4) => h,
                (4, 3) => -h,
                _ => 0.0,
            });
            let e = exponential(generator.as_ref());
            let a = Mat::from_fn(5, 5, |i, j| e[(i, j)]);
            let b = Mat::from_fn(5, 1, |i, _| e[(i, 5)]);
            let modes = unreached_modes(a.as_ref(), b.as_ref());
            assert_eq!(modes.len(), 1, "{h}: {modes:?}");
            assert!((modes[0].eigenvalue[0] - h.cos()).abs() < 1e-9 && (modes[0].eigenvalue[1] - h.sin()).abs() < 1e-9);
            assert!(modes[0].share[..3].iter().all(|&share| share < 1e-6) && modes[0].share[3] > 0.99, "{modes:?}");
            let reached = Mat::from_fn(5, 2, |i, j| if j == 0 { b[(i, 0)] } else { f64::from(u8::from(i == 4)) });
            assert!(unreached_modes(a.as_ref(), reached.as_ref()).is_empty());
        }
    }

    #[test]
    fn unreached_sum_of_states_names_both() {
        // u moves both states alike: their difference stays.
        let a = Mat::<f64>::identity(2, 2);
        let b = Mat::from_fn(2, 1, |_, _| 0.1);
        let modes = unreached_modes(a.as_ref(), b.as_ref());
        assert_eq!(modes.len(), 1);
        assert!((modes[0].share[0] - 1.0).abs() < 1e-12 && (modes[0].share[1] - 1.0).abs() < 1e-12);
    }
}
