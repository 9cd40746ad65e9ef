//! The discrete algebraic Riccati equation.

use faer::{Mat, MatRef, linalg::solvers::Solve};

use super::{is_finite, norm, spectral_radius, symmetric};

/// Doublings; the error of the k-th is the spectral radius of the closed loop to the power `2^(k+1)`.
const MOST_DOUBLINGS: usize = 64;
/// Applications of Riccati's own map behind them, each of which contracts the error by the closed loop.
const CORRECTIONS: usize = 3;
/// A change by this share is rounding.
const CONVERGED: f64 = 1e-15;

/// The stabilising solution of `X = A'XA - A'XB (R + B'XB)^-1 B'XA + Q`.
#[derive(Debug, Clone)]
pub struct Riccati {
    /// X (n x n), symmetric: the cost of a state.
    pub x: Mat<f64>,
    /// K (m x n): `u = -K x` is optimal.
    pub gain: Mat<f64>,
    /// `R + B'XB` (m x m): the cost of an input.
    pub weighed: Mat<f64>,
    /// `|X - F(X)| / |X|`, F being the equation's right side: the certificate of the solution.
    pub residual: f64,
    /// The spectral radius of `A - B K`.
    pub radius: f64,
}

/// The regulator of `x+ = A x + B u` that minimises the sum of `x'Qx + u'Ru`, by structured doubling (Chu, Fan, Lin,
/// Wang, "Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations", Int. J. Control 77,
/// 2004). It converges quadratically, keeps X symmetric, and divides by `I + G X` alone. A Schur method divides by A or
/// by a basis of the stable subspace.
///
/// Q (n x n) is positive semidefinite, R (m x m) positive definite. `None` without a finite solution: (A, B) is not
/// stabilisable, or R is singular. The solution's radius decides if it stabilises: a mode on the unit circle that costs
/// nothing is left unchanged.
///
/// # Panics
/// If the shapes disagree.
pub fn riccati(a: MatRef<'_, f64>, b: MatRef<'_, f64>, q: MatRef<'_, f64>, r: MatRef<'_, f64>) -> Option<Riccati> {
    let (n, m) = (a.nrows(), b.ncols());
    assert!(a.ncols() == n && b.nrows() == n && q.shape() == (n, n) && r.shape() == (m, m), "shapes");
    if n == 0 || ![a, b, q, r].into_iter().all(is_finite) {
        return None;
    }
    let mut power = a.to_owned();
    let mut g = symmetric(&(b * r.partial_piv_lu().solve(b.transpose())));
    let mut x = q.to_owned();
    for _ in 0..MOST_DOUBLINGS {
        let w = Mat::<f64>::identity(n, n) + &g * &x;
        let lu = w.partial_piv_lu();
        let (w_power, w_g) = (lu.solve(&power), lu.solve(&g));
        let step = symmetric(&(power.transpose() * &x * &w_power));
        g = symmetric(&(&g + &power * w_g * power.transpose()));
        power = &power * w_power;
        x = &x + &step;
        if !is_finite(x.as_ref()) {
            return None;
        }
        if norm(step.as_ref()) <= CONVERGED * norm(x.as_ref()) {
            break;
        }
    }
    for _ in 0..CORRECTIONS {
        x = cost(a, b, q, r, &x)?.0;
    }
    let (next, gain) = cost(a, b, q, r, &x)?;
    let size = norm(x.as_ref()).max(f64::MIN_POSITIVE);
    let radius = spectral_radius((a - b * &gain).as_ref())?;
    let weighed = r + b.transpose() * &x * b;
    Some(Riccati { residual: norm((&next - &x).as_ref()) / size, x, gain, weighed, radius })
}

/// The cost of a step with the best input, if the later cost is X, and the best gain. It is a sum of positive
/// semidefinite terms (Joseph's form), so that nothing cancels.
fn cost(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    q: MatRef<'_, f64>,
    r: MatRef<'_, f64>,
    x: &Mat<f64>,
) -> Option<(Mat<f64>, Mat<f64>)> {
    let bx = b.transpose() * x;
    let gain = (r + &bx * b).partial_piv_lu().solve(&bx * a);
    let closed = a - b * &gain;
    let next = symmetric(&(q + gain.transpose() * r * &gain + closed.transpose() * x * &closed));
    is_finite(next.as_ref()).then_some((next, gain))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn mat(rows: &[&[f64]]) -> Mat<f64> {
        Mat::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
    }

    #[test]
    fn the_scalar_equation_has_its_closed_form() {
        // x = a^2 x - (a b x)^2 / (r + b^2 x) + q, a quadratic in x.
        for (a, b, q, r) in
            [(1.2f64, 0.5, 1.0, 1.0), (1.0, 0.01, 1e-6, 1.0), (0.5, 1.0, 3.0, 0.1), (30.0, 1.0, 0.0, 1.0)]
        {
            let c = r - a * a * r - q * b * b;
            let x = (-c + (c * c + 4.0 * b * b * q * r).sqrt()) / (2.0 * b * b);
            let solution =
                riccati(mat(&[&[a]]).as_ref(), mat(&[&[b]]).as_ref(), mat(&[&[q]]).as_ref(), mat(&[&[r]]).as_ref());
            let solution = solution.unwrap();
            // Of q = 0 and |a| > 1 the stabilising solution is the positive one, which doubling from Q = 0 does not find.
            if q > 0.0 {
                // A loop that keeps 0.999 of an error from sample to sample makes a thousand times of a rounding.
                assert!((solution.x[(0, 0)] / x - 1.0).abs() < 1e-11, "{} {x}", solution.x[(0, 0)]);
                assert!(solution.residual < 1e-14 && solution.radius < 1.0);
            }
        }
    }

    #[test]
    fn double_integrator_matches_scipy() {
        let a = mat(&[&[1.0, 0.1], &[0.0, 1.0]]);
        let b = mat(&[&[0.005], &[0.1]]);
        let q = mat(&[&[1.0, 0.0], &[0.0, 0.1]]);
        let solution = riccati(a.as_ref(), b.as_ref(), q.as_ref(), mat(&[&[0.01]]).as_ref()).unwrap();
        assert!(solution.residual < 1e-14 && solution.radius < 1.0, "{solution:?}");
        // scipy 1.17.1: solve_discrete_are([[1, .1], [0, 1]], [[.005], [.1]], diag([1, .1]), [[.01]]).
        let scipy = mat(&[&[6.022540785844572, 1.012422836565833], &[1.012422836565833, 0.6091146407455232]]);
        assert!(norm((&solution.x - scipy).as_ref()) < 1e-13 * norm(solution.x.as_ref()));
        // The cost of a path is that of its start: x0' X x0 is the sum along the closed loop.
        let closed = &a - &b * &solution.gain;
        let mut x = mat(&[&[0.3], &[-1.0]]);
        let claimed = (x.transpose() * &solution.x * &x)[(0, 0)];
        let mut paid = 0.0;
        for _ in 0..2000 {
            let u = (&solution.gain * &x)[(0, 0)];
            paid += (x.transpose() * &q * &x)[(0, 0)] + 0.01 * u * u;
            x = &closed * x;
        }
        assert!((paid / claimed - 1.0).abs() < 1e-12, "{paid} {claimed}");
    }

    #[test]
    fn unreachable_unstable_mode_has_no_solution() {
        let a = mat(&[&[1.1, 0.0], &[0.0, 0.5]]);
        let b = mat(&[&[0.0], &[1.0]]);
        let solution = riccati(a.as_ref(), b.as_ref(), Mat::identity(2, 2).as_ref(), mat(&[&[1.0]]).as_ref());
        assert!(solution.is_none_or(|solution| solution.radius > 1.0));
    }

    proptest! {
        #[test]
        fn solution_solves_the_equation_and_stabilises(
            values in proptest::collection::vec(-1.0f64..1.0, 5 * 5 + 5 * 2),
            weight in -3.0f64..3.0,
        ) {
            let a = Mat::from_fn(5, 5, |i, j| 1.5 * values[5 * i + j]);
            let b = Mat::from_fn(5, 2, |i, j| values[25 + 2 * i + j]);
            let r = Mat::from_fn(2, 2, |i, j| if i == j { 10f64.powf(weight) } else { 0.0 });
            if super::super::unreached_modes(a.as_ref(), b.as_ref()).is_empty()
                && let Some(solution) = riccati(a.as_ref(), b.as_ref(), Mat::identity(5, 5).as_ref(), r.as_ref())
            {
                // Random pairs may be nearly unreachable: then X is large, and its own rounding is told.
                let size = norm(solution.x.as_ref());
                prop_assert!(solution.residual < 1e-9_f64.max(1e-14 * size), "{} {size}", solution.residual);
                prop_assert!(solution.radius < 1.0, "{}", solution.radius);
            }
        }
    }
}
