//! Quaternions against rotation matrices.

use std::f64::consts::PI;

use fleetfoot_library::{Expr, Quaternion, Scope, rotation_vector_rates};
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
                let value = value(&format!("{function}({q})"));
                // Close to the vertical, yaw and roll each are known less well.
                let tolerance = 1e-13 / pitch.cos();
                prop_assert!((value - wanted).abs() < tolerance, "{}({}) = {} not {}", function, q, value, wanted);
            }
            for vector in ["v", "/imu.a", "vec(v_x, v_y, v_z)"] {
                for (i, part) in ["x", "y", "z"].iter().enumerate() {
                    let forth: f64 = (0..3).map(|j| rotation[i][j] * v[j]).sum();
                    let back: f64 = (0..3).map(|j| rotation[j][i] * v[j]).sum();
                    let forth_value = value(&format!("rotate({q}, {vector}).{part}"));
                    let back_value = value(&format!("rotate_inv({q}, {vector}).{part}"));
                    prop_assert!((forth_value - forth).abs() < 1e-12, "{}: {} not {}", vector, forth_value, forth);
                    prop_assert!((back_value - back).abs() < 1e-12, "{}: {} not {}", vector, back_value, back);
                }
            }
            let there_and_back = value(&format!("rotate_inv({q}, rotate({q}, v)).y"));
            prop_assert!((there_and_back - v[1]).abs() < 1e-12);
        }
    }
}

/// Exp of a rotation vector.
fn exponential(v: [f64; 3]) -> [f64; 4] {
    let angle = v.iter().map(|part| part * part).sum::<f64>().sqrt();
    let scale = if angle > 0.0 { (0.5 * angle).sin() / angle } else { 0.5 };
    [(0.5 * angle).cos(), scale * v[0], scale * v[1], scale * v[2]]
}

/// Log of a quaternion, within half a turn.
fn logarithm(q: [f64; 4]) -> [f64; 3] {
    let sine = (q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let scale = if sine > 0.0 { 2.0 * sine.atan2(q[0]) / sine } else { 2.0 };
    [scale * q[1], scale * q[2], scale * q[3]]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Kinematics against central differences of finite turns, about the axes of the body and of the world, whose own error is 1e-9. Rotation vectors of any length up to half a turn.
    #[test]
    fn kinematics_are_the_limits_of_turns(
        direction in prop::array::uniform3(-1.0..1.0f64), size in prop_oneof![0.0..2.9f64, Just(0.0), 1e-12..1e-3f64],
        rates in prop::array::uniform3(-2.0..2.0f64), world: bool,
    ) {
        let norm = direction.iter().map(|part| part * part).sum::<f64>().sqrt().max(1e-3);
        let v = direction.map(|part| size * part / norm);
        let q = exponential(v);
        let column = |name: &str, _: i32| match name.split_at(1) {
            ("w", part) => rates["xyz".find(part).unwrap()],
            ("v", part) => v["xyz".find(part).unwrap()],
            (_, part) => q["wxyz".find(part).unwrap()],
        };
        let value = |expr: &Expr| expr.value(column, |_| 0.0);
        let turned = |h: f64| {
            let by = exponential(rates.map(|rate| h * rate));
            if world { hamilton(by, q) } else { hamilton(q, by) }
        };
        let h = 1e-5;
        let [w, x, y, z] = ["qw", "qx", "qy", "qz"].map(Expr::column);
        let expressions = ["wx", "wy", "wz"].map(Expr::column);
        let rates = Quaternion::new(x, y, z, w).rates(&expressions, world);
        for (i, rate) in rates.iter().enumerate() {
            let slope = (turned(h)[i] - turned(-h)[i]) / (2.0 * h);
            prop_assert!((value(rate) - slope).abs() < 1e-9, "{i}: {} not {slope}", value(rate));
        }
        let vector = ["vx", "vy", "vz"].map(Expr::column);
        for (i, rate) in rotation_vector_rates(&vector, &expressions, world).iter().enumerate() {
            let slope = (logarithm(turned(h))[i] - logarithm(turned(-h))[i]) / (2.0 * h);
            prop_assert!((value(rate) - slope).abs() < 1e-8, "{i}: {} not {slope}", value(rate));
        }
    }

    /// A rotation by its name, whatever its columns are called, is that of its quaternion; a rotation vector of length zero is one, too.
    #[test]
    fn rotations_have_names(
        v in prop::array::uniform3(-1.7..1.7f64), still: bool, a in prop::array::uniform3(-5.0..5.0f64),
    ) {
        let v = if still { [0.0; 3] } else { v };
        let q = exponential(v);
        let column = |name: &str, _: i32| match name {
            "first" => v[0], "second" => v[1], "third" => v[2],
            "ax" => a[0], "ay" => a[1], "az" => a[2],
            _ => q["wxyz".find(&name[2..]).unwrap()],
        };
        let mut scope = Scope::new(["first", "second", "third", "q.w", "q.x", "q.y", "q.z", "ax", "ay", "az"]);
        scope.define_rotation("attitude", Quaternion::of_vector(&["first", "second", "third"].map(Expr::column)));
        let value = |text: &str| Expr::parse(text, &scope).unwrap().value(column, |_| 0.0);
        for part in ["x", "y", "z"] {
            for function in ["rotate", "rotate_inv"] {
                let (value, other) = (value(&format!("{function}(attitude, a).{part}")), value(&format!("{function}(q, a).{part}")));
                prop_assert!((value - other).abs() < 1e-13, "{value} {other}");
            }
        }
        prop_assert!((value("yaw(attitude)") - value("yaw(q)")).abs() < 1e-12);
    }
}

#[test]
fn quarter_turn_of_pitch_keeps_digits() {
    // The inverse sine would lose half of them here.
    for away in [0.0, 1e-9, 1e-6] {
        let q = half_turn(1, PI / 2.0 - away);
        let column = |name: &str, _: i32| q["wxyz".find(&name[2..]).unwrap()];
        let pitch = Expr::parse("pitch(q)", &scope()).unwrap().value(column, |_| 0.0);
        assert!((pitch - (PI / 2.0 - away)).abs() < 1e-15, "{pitch}");
    }
}
