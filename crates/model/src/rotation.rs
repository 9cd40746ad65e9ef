//! Representations of a rotation in columns, and computations with them.
//!
//! A rotation R takes vectors of the body to the world. As a unit quaternion it has four columns w, x, y, z (q and -q
//! are the same rotation). As a rotation vector (axis times angle, rad) it has three, x, y, z, of length pi at most
//! (the axis times a whole turn more is the same rotation). Differences of rotations are rotation vectors in the body's
//! axes: Log(b^-1 a), so that b Exp(difference) = a.
//!
//! Exponential, logarithm and right Jacobian: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics", arXiv:1812.01537, 2018, appendix B.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

/// Representation of a rotation in columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum RotationKind {
    /// A unit quaternion: w, x, y, z.
    #[serde(rename = "quaternion")]
    Quaternion,
    /// A rotation vector, axis times angle in radians: x, y, z.
    #[serde(rename = "rotation-vector")]
    Vector,
}

/// The part of a column in a rotation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RotationPart {
    /// The rotation's name.
    pub group: String,
    /// Representation of the rotation.
    pub kind: RotationKind,
    /// Index of the column's part, in the order of [`RotationKind::letters`].
    pub part: usize,
}

/// Below this squared angle quotients are their limits, within 1e-17.
const SMALL: f64 = 1e-16;

impl RotationKind {
    /// The parts, in their order.
    pub fn letters(self) -> &'static [&'static str] {
        match self {
            Self::Quaternion => &["w", "x", "y", "z"],
            Self::Vector => &["x", "y", "z"],
        }
    }

    /// Number of parts: 4 or 3.
    pub fn parts(self) -> usize {
        self.letters().len()
    }

    /// The word for it in recipes and files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Quaternion => "quaternion",
            Self::Vector => "rotation-vector",
        }
    }

    /// The representation that `word` names.
    pub fn of_word(word: &str) -> Option<Self> {
        [Self::Quaternion, Self::Vector].into_iter().find(|kind| kind.word() == word)
    }

    /// Retracts the result of a time step to a rotation: a quaternion to unit length, its sign kept. A vector that is
    /// longer than half a turn becomes the same rotation the other way round.
    #[inline]
    pub fn retract(self, x: &mut [f64]) {
        match self {
            Self::Quaternion => {
                let norm = length(x);
                x.iter_mut().for_each(|part| *part /= norm);
            }
            Self::Vector => {
                let angle = length(x);
                if angle > PI && angle.is_finite() {
                    let turns = ((angle + PI) / TAU).floor();
                    let factor = 1.0 - turns * TAU / angle;
                    x.iter_mut().for_each(|part| *part *= factor);
                }
            }
        }
    }

    /// The derivatives of [`RotationKind::retract`] at the result of a step (parts x parts, row by row). They are
    /// `(I - q q')/|p|` of a quaternion p with q = p/|p|, and `c I + (1 - c) u u'` of a vector of direction u that is
    /// shortened by the factor c.
    pub fn retraction_derivative(self, p: &[f64]) -> Vec<f64> {
        let norm = length(p);
        let (inner, outer) = match self {
            Self::Quaternion => (1.0 / norm, -1.0 / norm),
            Self::Vector if norm > PI => {
                let factor = 1.0 - ((norm + PI) / TAU).floor() * TAU / norm;
                (factor, 1.0 - factor)
            }
            Self::Vector => (1.0, 0.0),
        };
        let n = p.len();
        let entry = |i: usize, j: usize| {
            let along = if outer == 0.0 { 0.0 } else { outer * (p[i] / norm) * (p[j] / norm) };
            if i == j { inner + along } else { along }
        };
        (0..n * n).map(|at| entry(at / n, at % n)).collect()
    }

    /// The same rotation, as near to `to` as it can be written.
    pub fn nearest(self, x: &mut [f64], to: &[f64]) {
        let along: f64 = x.iter().zip(to).map(|(a, b)| a * b).sum();
        match self {
            Self::Quaternion if along < 0.0 => x.iter_mut().for_each(|part| *part = -*part),
            Self::Quaternion => {}
            Self::Vector => {
                let angle = length(x);
                if angle > 0.0 && angle.is_finite() && along.is_finite() {
                    let turns = ((along / angle - angle) / TAU).round();
                    if turns != 0.0 {
                        let factor = 1.0 + turns * TAU / angle;
                        x.iter_mut().for_each(|part| *part *= factor);
                    }
                }
            }
        }
    }

    /// Writes the rotations of consecutive rows, each as near as it can be to the last known one (parts x rows). Curves
    /// can then go through their parts.
    pub fn turn_on(self, parts: &mut [Vec<f64>]) {
        let mut last: Option<Vec<f64>> = None;
        for row in 0..parts.first().map_or(0, Vec::len) {
            let mut values: Vec<f64> = parts.iter().map(|part| part[row]).collect();
            if values.iter().any(|part| !part.is_finite()) {
                continue;
            }
            if let Some(last) = &last {
                self.nearest(&mut values, last);
            }
            parts.iter_mut().zip(&values).for_each(|(part, value)| part[row] = *value);
            last = Some(values);
        }
    }

    /// The unique form of a recorded rotation, whatever its form in the log: of unit length with w >= 0, or of length
    /// pi at most.
    pub fn settle(self, x: &mut [f64]) {
        self.retract(x);
        if self == Self::Quaternion && x[0] < 0.0 {
            x.iter_mut().for_each(|part| *part = -*part);
        }
    }

    /// The rotation as a quaternion w, x, y, z.
    pub fn quaternion(self, x: &[f64]) -> [f64; 4] {
        match self {
            Self::Quaternion => [x[0], x[1], x[2], x[3]],
            Self::Vector => exponential([x[0], x[1], x[2]]),
        }
    }

    /// Rotation vector that turns `b` into `a`, in the body's axes, rad, of length pi at most: Log(b^-1 a). Its length
    /// is the angle between the two.
    pub fn difference(self, a: &[f64], b: &[f64]) -> [f64; 3] {
        let [w, x, y, z] = self.quaternion(b);
        logarithm(product([w, -x, -y, -z], self.quaternion(a)))
    }

    /// The rotation `x` turned by a vector in the body's axes, rad: x Exp(phi).
    pub fn moved(self, x: &[f64], phi: [f64; 3]) -> Vec<f64> {
        let moved = product(self.quaternion(x), exponential(phi));
        match self {
            Self::Quaternion => moved.to_vec(),
            Self::Vector => logarithm(moved).to_vec(),
        }
    }

    /// Derivatives of the parts as the rotation at `x` turns about the axes of the body, each rad (parts x 3, row by
    /// row). They are `x (0, phi)/2` of a quaternion, `Jr(x)^-1 phi` of a vector. [`RotationKind::turning`] undoes it.
    pub fn turned(self, x: &[f64]) -> Vec<f64> {
        match self {
            Self::Quaternion => {
                let (w, [x, y, z]) = (x[0], [x[1], x[2], x[3]]);
                [-x, -y, -z, w, -z, y, z, w, -x, -y, x, w].map(|entry| 0.5 * entry).to_vec()
            }
            Self::Vector => {
                let square: f64 = x.iter().map(|part| part * part).sum();
                let half = 0.5 * square.sqrt();
                let second = if square < SMALL { 1.0 / 12.0 } else { (1.0 - half / half.tan()) / square };
                let [a, b, c] = [x[0], x[1], x[2]];
                let hat = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
                let entry = |i: usize, j: usize| {
                    let twice = x[i] * x[j] - if i == j { square } else { 0.0 };
                    f64::from(u8::from(i == j)) + 0.5 * hat[i][j] + second * twice
                };
                (0..9).map(|at| entry(at / 3, at % 3)).collect()
            }
        }
    }

    /// Turn of the rotation at `x` by small changes of the parts, rad in the body's axes (3 x parts, row by row). It is
    /// `2 vec(x^-1 dx)` of a quaternion, `Jr(x) dx` of a vector.
    pub fn turning(self, x: &[f64]) -> Vec<f64> {
        match self {
            Self::Quaternion => {
                let (w, [x, y, z]) = (x[0], [x[1], x[2], x[3]]);
                [-x, w, z, -y, -y, -z, w, x, -z, y, -x, w].map(|entry| 2.0 * entry).to_vec()
            }
            Self::Vector => {
                let square: f64 = x.iter().map(|part| part * part).sum();
                let angle = square.sqrt();
                let (first, second) = if square < SMALL {
                    (0.5, 1.0 / 6.0)
                } else {
                    (2.0 * (0.5 * angle).sin().powi(2) / square, (angle - angle.sin()) / (square * angle))
                };
                let [a, b, c] = [x[0], x[1], x[2]];
                let hat = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
                let entry = |i: usize, j: usize| {
                    let twice = x[i] * x[j] - if i == j { square } else { 0.0 };
                    f64::from(u8::from(i == j)) - first * hat[i][j] + second * twice
                };
                (0..9).map(|at| entry(at / 3, at % 3)).collect()
            }
        }
    }
}

fn length(x: &[f64]) -> f64 {
    x.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// Exp: the rotation by this vector.
fn exponential(phi: [f64; 3]) -> [f64; 4] {
    let angle = length(&phi);
    let half = 0.5 * angle;
    let scale = if angle * angle < SMALL { 0.5 } else { half.sin() / angle };
    [half.cos(), scale * phi[0], scale * phi[1], scale * phi[2]]
}

/// Log: the vector of a quaternion, of the shorter way round; the quaternion's length cancels.
fn logarithm([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let norm = length(&[x, y, z]);
    let scale = if norm < 1e-150 { 2.0 / w.abs() } else { 2.0 * norm.atan2(sign * w) / norm };
    [x, y, z].map(|part| sign * scale * part)
}

/// Hamilton's product a b.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vectors(length: f64) -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(-1.0..1.0f64).prop_filter_map("of a direction", move |v| {
            let norm = super::length(&v);
            (norm > 1e-3).then(|| v.map(|part| part * length / norm.max(1.0)))
        })
    }

    fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
    }

    const KINDS: [RotationKind; 2] = [RotationKind::Quaternion, RotationKind::Vector];

    fn written(kind: RotationKind, phi: [f64; 3]) -> Vec<f64> {
        match kind {
            RotationKind::Quaternion => exponential(phi).to_vec(),
            RotationKind::Vector => phi.to_vec(),
        }
    }

    proptest! {
        /// `turning` undoes `turned`, which is the slope of moving a rotation.
        #[test]
        fn turned_parts_turn_back(phi in vectors(3.0), axis in 0..3usize) {
            for kind in KINDS {
                let x = written(kind, phi);
                let (turned, turning, parts) = (kind.turned(&x), kind.turning(&x), x.len());
                for (i, j) in (0..9).map(|at| (at / 3, at % 3)) {
                    let product: f64 = (0..parts).map(|k| turning[i * parts + k] * turned[3 * k + j]).sum();
                    prop_assert!((product - f64::from(u8::from(i == j))).abs() < 1e-9, "{kind:?} {i} {j} {product}");
                }
                let step = |size: f64| {
                    let mut small = [0.0; 3];
                    small[axis] = size;
                    kind.moved(&x, small)
                };
                // The error of a central difference of 1e-5 is some 1e-10, and more where vectors are near half a turn.
                let (ahead, back) = (step(1e-5), step(-1e-5));
                let slopes: Vec<f64> = (0..parts).map(|k| (ahead[k] - back[k]) / 2e-5).collect();
                let projections: Vec<f64> = (0..parts).map(|k| turned[3 * k + axis]).collect();
                prop_assert!(near(&slopes, &projections, 1e-6), "{kind:?} {slopes:?} {projections:?}");
            }
        }
    }

    #[test]
    fn rotations_turn_on() {
        // More than a turn about z, as logs settle it: w >= 0.
        let half = |k: usize| 0.2 * k as f64;
        let sign = |k: usize| if half(k).cos() < 0.0 { -1.0 } else { 1.0 };
        let part = |of: fn(f64) -> f64| (0..20).map(|k| sign(k) * of(half(k))).collect::<Vec<_>>();
        let mut parts = vec![part(f64::cos), vec![0.0; 20], vec![0.0; 20], part(f64::sin)];
        parts.iter_mut().for_each(|part| part[5] = f64::NAN);
        RotationKind::Quaternion.turn_on(&mut parts);
        for k in (0..20).filter(|k| *k != 5) {
            assert_eq!([parts[0][k], parts[3][k]], [half(k).cos(), half(k).sin()], "{k}");
        }
        // And as rotation vectors, which go on beyond half a turn.
        let wrapped = |k: usize| 2.0 * half(k) - TAU * (2.0 * half(k) / TAU).round();
        let mut parts = vec![vec![0.0; 12], (0..12).map(wrapped).collect(), vec![0.0; 12]];
        RotationKind::Vector.turn_on(&mut parts);
        assert!((0..12).all(|k| (parts[1][k] - 2.0 * half(k)).abs() < 1e-14), "{parts:?}");
    }

    proptest! {
        /// A difference undoes a motion, however either rotation is written.
        #[test]
        fn differences_undo_motions(at in vectors(3.0), by in vectors(3.0), flip: bool) {
            for kind in KINDS {
                let x = written(kind, at);
                let mut moved = kind.moved(&x, by);
                match kind {
                    RotationKind::Quaternion if flip => moved.iter_mut().for_each(|part| *part = -*part),
                    RotationKind::Vector if flip => {
                        let angle = length(&moved);
                        moved.iter_mut().for_each(|part| *part *= 1.0 - TAU / angle);
                    }
                    _ => {}
                }
                prop_assert!(near(&kind.difference(&moved, &x), &by, 1e-13), "{kind:?}");
            }
        }

        /// A retraction keeps the rotation of a step, and a second one changes nothing but the last bits.
        #[test]
        fn retractions_keep_the_rotation(at in vectors(9.0), scale in 0.5..2.0f64) {
            for kind in KINDS {
                let mut x = written(kind, at);
                if kind == RotationKind::Quaternion {
                    x.iter_mut().for_each(|part| *part *= scale);
                }
                let before = x.clone();
                kind.retract(&mut x);
                prop_assert!(length(&kind.difference(&x, &before)) < 1e-14);
                let norm = length(&x);
                let whole = match kind {
                    RotationKind::Quaternion => (norm - 1.0).abs() < 1e-15,
                    RotationKind::Vector => norm < PI + 1e-14,
                };
                prop_assert!(whole);
                let once = x.clone();
                kind.retract(&mut x);
                prop_assert!(near(&x, &once, 1e-15));
            }
        }

        /// However a recorded rotation is written, it is read as the same numbers: of signs the same bits.
        #[test]
        fn recorded_rotations_are_settled(at in vectors(3.0)) {
            let (mut a, mut b) = (exponential(at), exponential(at).map(|part| -part));
            RotationKind::Quaternion.settle(&mut a);
            RotationKind::Quaternion.settle(&mut b);
            prop_assert_eq!(a, b);
            let angle = length(&at);
            let (mut a, mut b) = (at, at.map(|part| part * (1.0 + TAU / angle)));
            RotationKind::Vector.settle(&mut a);
            RotationKind::Vector.settle(&mut b);
            prop_assert!(near(&a, &b, 1e-14));
        }

        /// The nearest way of writing is the same rotation, and none of the others is nearer.
        #[test]
        fn the_nearest_is_the_nearest(at in vectors(3.0), to in vectors(3.0)) {
            for kind in KINDS {
                let (mut x, to) = (written(kind, at), written(kind, to));
                let before = x.clone();
                kind.nearest(&mut x, &to);
                prop_assert!(length(&kind.difference(&x, &before)) < 1e-14);
                let distance = |x: &[f64]| length(&x.iter().zip(&to).map(|(a, b)| a - b).collect::<Vec<_>>());
                let others: Vec<Vec<f64>> = match kind {
                    RotationKind::Quaternion => vec![before.iter().map(|part| -part).collect(), before.clone()],
                    RotationKind::Vector => {
                        let angle = length(&before);
                        let turned = |k: f64| before.iter().map(|part| part * (1.0 + k * TAU / angle)).collect();
                        [-1.0, 0.0, 1.0].map(turned).to_vec()
                    }
                };
                prop_assert!(others.iter().all(|other| distance(&x) <= distance(other) + 1e-14));
            }
        }

        /// The derivatives are those of central differences, whose own error is 1e-9.
        #[test]
        fn derivatives_are_differences(at in vectors(5.0)) {
            let h = 1e-5;
            for kind in KINDS {
                let mut x = written(kind, at);
                if kind == RotationKind::Quaternion {
                    x.iter_mut().for_each(|part| *part *= 1.3);
                } else if (length(&x) - PI).abs() < 1e-3 {
                    continue;
                }
                let n = x.len();
                let jacobian = kind.retraction_derivative(&x);
                let moved_value = |j: usize, step: f64| {
                    let mut moved = x.clone();
                    moved[j] += step;
                    moved
                };
                for j in 0..n {
                    let retracted = |step: f64| {
                        let mut moved = moved_value(j, step);
                        kind.retract(&mut moved);
                        moved
                    };
                    for (i, (a, b)) in retracted(h).iter().zip(&retracted(-h)).enumerate() {
                        prop_assert!(((a - b) / (2.0 * h) - jacobian[i * n + j]).abs() < 1e-8);
                    }
                }
                kind.retract(&mut x);
                let turning = kind.turning(&x);
                for j in 0..n {
                    let slope = |step: f64| {
                        let mut moved = x.clone();
                        moved[j] += step;
                        kind.difference(&moved, &x)
                    };
                    for (i, (a, b)) in slope(h).iter().zip(&slope(-h)).enumerate() {
                        prop_assert!(((a - b) / (2.0 * h) - turning[i * n + j]).abs() < 1e-8);
                    }
                }
            }
        }
    }
}
