//! Quaternions against rotation matrices.

use std::f64::consts::PI;

use fleetfoot_library::{Expr, Scope};
use proptest::prelude::*;

type Matrix = [[f64; 3]; 3];

fn times(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The rotation by `angle` about axis 0, 1 or 2.
fn about(axis: usize, angle: f64) -> Matrix {
    let (s, c) = angle.sin_cos();
    let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut matrix = [[0.0; 3]; 3];
    matrix[axis][axis] = 1.0;
    matrix[j][j] = c;
    matrix[k][k] = c;
    matrix[j][k] = -s;
    matrix[k][j] = s;
    matrix
}

/// Hamilton's product of (w, x, y, z).
fn hamilton(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn half_turn(axis: usize, angle: f64) -> [f64; 4] {
    let mut q = [0.0; 4];
    (q[axis + 1], q[0]) = (angle / 2.0).sin_cos();
    q
}

/// Columns in the three manners of naming, and a topic.
fn scope() -> Scope {
    Scope::new([
        "q.x", "q.y", "q.z", "q.w", "v_x", "v_y", "v_z", "/imu.ax", "/imu.ay", "/imu.az", "px", "py", "pz", "pw",
    ])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn angles_and_rotated_vectors_agree_with_matrices(
        yaw in -PI..PI, pitch in -1.57..1.57f64, roll in -PI..PI,
        v in prop::array::uniform3(-5.0..5.0f64), factor in prop_oneof![Just(1.0), Just(-1.0), 0.01..100.0f64],
    ) {
        let q = hamilton(hamilton(half_turn(2, yaw), half_turn(1, pitch)), half_turn(0, roll)).map(|part| factor * part);
        let rotation = times(times(about(2, yaw), about(1, pitch)), about(0, roll));
        let column = |name: &str, _: i32| match name.split_at(name.len() - 1) {
            ("q." | "p", "w") => q[0],
            ("q." | "p", part) => q[1 + "xyz".find(part).unwrap()],
            (_, part) => v["xyz".find(part).unwrap()],
        };
        let value = |text: &str| Expr::parse(text, &scope()).unwrap().value(column, |_| 0.0);
        for q in ["q", "p", "quat(q.x, q.y, q.z, q.w)", "quat(2*px, 2*py, 2*pz, 2*pw)"] {
            for (function, wanted) in [("yaw", yaw), ("pitch", pitch), ("roll", roll)] {
                let found = value(&format!("{function}({q})"));
                // Close to the vertical, yaw and roll each are known less well.
                let tolerance = 1e-13 / pitch.cos();
                prop_assert!((found - wanted).abs() < tolerance, "{}({}) = {} not {}", function, q, found, wanted);
            }
            for vector in ["v", "/imu.a", "vec(v_x, v_y, v_z)"] {
                for (i, part) in ["x", "y", "z"].iter().enumerate() {
                    let forth: f64 = (0..3).map(|j| rotation[i][j] * v[j]).sum();
                    let back: f64 = (0..3).map(|j| rotation[j][i] * v[j]).sum();
                    let forth_found = value(&format!("rotate({q}, {vector}).{part}"));
                    let back_found = value(&format!("rotate_inv({q}, {vector}).{part}"));
                    prop_assert!((forth_found - forth).abs() < 1e-12, "{}: {} not {}", vector, forth_found, forth);
                    prop_assert!((back_found - back).abs() < 1e-12, "{}: {} not {}", vector, back_found, back);
                }
            }
            let there_and_back = value(&format!("rotate_inv({q}, rotate({q}, v)).y"));
            prop_assert!((there_and_back - v[1]).abs() < 1e-12);
        }
    }
}

#[test]
fn a_quarter_turn_of_pitch_keeps_its_digits() {
    // The inverse sine would lose half of them here.
    for away in [0.0, 1e-9, 1e-6] {
        let q = half_turn(1, PI / 2.0 - away);
        let column = |name: &str, _: i32| q["wxyz".find(&name[2..]).unwrap()];
        let pitch = Expr::parse("pitch(q)", &scope()).unwrap().value(column, |_| 0.0);
        assert!((pitch - (PI / 2.0 - away)).abs() < 1e-15, "{pitch}");
    }
}
