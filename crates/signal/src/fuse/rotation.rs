//! Rotations and their tangent space: a rotation R is perturbed as R Exp(phi), phi in the frame on its right side.
//!
//! Notation and Jacobians: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics", arXiv:1812.01537, 2018, appendix B.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// A 3-vector.
pub(super) type Vector = Vector3<f64>;
/// A 3 x 3 matrix.
pub(super) type Matrix = Matrix3<f64>;
/// A rotation.
pub(super) type Rotation = UnitQuaternion<f64>;

/// Below this angle the quotients of the Jacobians are series.
const SMALL: f64 = 0.1;

/// x, y, z, w as a rotation.
pub(super) fn rotation(parts: &[f64; 4]) -> Rotation {
    let [x, y, z, w] = *parts;
    Rotation::new_normalize(Quaternion::new(w, x, y, z))
}

/// Exp: the rotation by this vector.
pub(super) fn exp(phi: &Vector) -> Rotation {
    let angle = phi.norm();
    let half = 0.5 * angle;
    // sin(half) / angle, which keeps its digits down to the smallest numbers.
    let scale = if angle < 1e-150 { 0.5 } else { half.sin() / angle };
    Rotation::new_unchecked(Quaternion::from_parts(half.cos(), phi * scale))
}

/// Log: the vector of a rotation, of the shorter way round.
pub(super) fn log(rotation: &Rotation) -> Vector {
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    let (scalar, vector) = (sign * rotation.w, sign * rotation.imag());
    let norm = vector.norm();
    if norm < 1e-150 { 2.0 * vector } else { vector * (2.0 * norm.atan2(scalar) / norm) }
}

/// The rotation, of unit norm again: products lose it digit by digit.
pub(super) fn normalised(rotation: &Rotation) -> Rotation {
    Rotation::new_normalize(rotation.into_inner())
}

/// Jr: Exp(phi + d) = Exp(phi) Exp(Jr d) to first order.
pub(super) fn right_jacobian(phi: &Vector) -> Matrix {
    let (angle, hat) = (phi.norm(), phi.cross_matrix());
    let x = angle * angle;
    let first = if angle < SMALL {
        0.5 - x / 24.0 + x * x / 720.0 - x * x * x / 40_320.0
    } else {
        2.0 * (0.5 * angle).sin().powi(2) / x
    };
    let second = if angle < SMALL {
        1.0 / 6.0 - x / 120.0 + x * x / 5040.0 - x * x * x / 362_880.0
    } else {
        (angle - angle.sin()) / (x * angle)
    };
    Matrix::identity() - first * hat + second * hat * hat
}

/// Jr^-1: Log(Exp(phi) Exp(d)) = phi + Jr^-1 d to first order. Its transpose is that of Log(Exp(d) Exp(phi)).
pub(super) fn right_jacobian_inverse(phi: &Vector) -> Matrix {
    let (angle, hat) = (phi.norm(), phi.cross_matrix());
    let x = angle * angle;
    let second = if angle < SMALL {
        1.0 / 12.0 + x / 720.0 + x * x / 30_240.0 + x * x * x / 1_209_600.0
    } else {
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / x
    };
    Matrix::identity() + 0.5 * hat + second * hat * hat
}

#[cfg(test)]
mod tests {
    use super::*;

    const VECTORS: [[f64; 3]; 5] =
        [[0.0; 3], [1e-9, -2e-9, 1e-10], [0.04, 0.05, -0.06], [0.08, -0.05, 0.05], [1.0, -2.0, 0.5]];

    #[test]
    fn log_undoes_exp() {
        for vector in VECTORS.map(Vector::from) {
            let back = log(&exp(&vector));
            assert!((back - vector).norm() <= 4e-16 * vector.norm(), "{vector}: {back}");
            assert!((log(&Rotation::new_unchecked(-exp(&vector).into_inner())) - vector).norm() < 1e-15);
        }
    }

    /// Central differences of step 1e-5: their own error is 1e-10.
    #[test]
    fn jacobians_are_the_derivatives() {
        let h = 1e-5;
        for phi in VECTORS.map(Vector::from) {
            let (jacobian, inverse) = (right_jacobian(&phi), right_jacobian_inverse(&phi));
            for axis in 0..3 {
                let d = Vector::ith(axis, h);
                let moved = |d: Vector| log(&(exp(&phi).inverse() * exp(&(phi + d))));
                let slope = (moved(d) - moved(-d)) / (2.0 * h);
                assert!((slope - jacobian.column(axis)).norm() < 1e-9, "{phi}: {slope}");
                let moved = |d: Vector| log(&(exp(&phi) * exp(&d)));
                let slope = (moved(d) - moved(-d)) / (2.0 * h);
                assert!((slope - inverse.column(axis)).norm() < 1e-9, "{phi}: {slope}");
            }
            assert!((jacobian * inverse - Matrix::identity()).norm() < 1e-12, "{phi}");
        }
    }
}
