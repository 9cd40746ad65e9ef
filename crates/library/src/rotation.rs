//! Rotations: Euler angles of quaternions and rotated vectors, as expressions.

use crate::Expr;

/// A unit quaternion w + xi + yj + zk as expressions: the rotation from the body to the world, as in ROS.
///
/// It need not be normalised: every function here is homogeneous in it, so a common factor cancels. A quaternion
/// that is all zeros is no rotation: angles of it are 0, and rotated vectors NaN.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Quaternion {
    /// Components x, y, z of the vector part.
    pub vector: [Expr; 3],
    /// The scalar part.
    pub w: Expr,
}

impl Quaternion {
    /// From its components; note the order, x first.
    pub fn new(x: Expr, y: Expr, z: Expr, w: Expr) -> Self {
        Self { vector: [x, y, z], w }
    }

    /// Of a rotation vector, axis times angle in radians: `(|v|/2 cot(|v|/2), v/2)`, but for a common factor.
    ///
    /// That of length zero is the rotation by nothing; its quotient is that of a length of 1e-15, which is 1 to the last digit.
    pub fn of_vector(vector: &[Expr; 3]) -> Self {
        let length = squared_length(vector).max(Expr::number(1e-30)).sqrt();
        let scale = (0.5 * &length).sin() / &length;
        Self { vector: vector.each_ref().map(|part| part * &scale), w: (0.5 * &length).cos() }
    }

    /// Derivatives of the components w, x, y, z for turn rates (rad/s) about the axes of the body:
    /// `q' = 1/2 q (0, rates)`; of the world: `q' = 1/2 (0, rates) q`.
    pub fn rates(&self, [a, b, c]: &[Expr; 3], world: bool) -> [Expr; 4] {
        let ([x, y, z], w) = (self.vector.each_ref(), &self.w);
        let twist = |plus: Expr, minus: Expr| if world { minus - plus } else { plus - minus };
        [
            -0.5 * (x * a + y * b + z * c),
            0.5 * (w * a + twist(y * c, z * b)),
            0.5 * (w * b + twist(z * a, x * c)),
            0.5 * (w * c + twist(x * b, y * a)),
        ]
    }

    /// The rotation matrix by rows: the axes of the body in those of the world are its columns.
    pub fn rotation_matrix(&self) -> [[Expr; 3]; 3] {
        let unit = |i: usize| std::array::from_fn(|j| Expr::number(if i == j { 1.0 } else { 0.0 }));
        let columns: [[Expr; 3]; 3] = std::array::from_fn(|i| self.rotate(&unit(i)));
        std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i].simplified()))
    }

    /// The rotation about the vertical axis, last of intrinsic Z-Y-X angles: `atan2(R10, R00)`.
    pub fn yaw(&self) -> Expr {
        let [r00, r10, ..] = self.euler_entries();
        r10.atan2(r00)
    }

    /// The rotation about the lateral axis of intrinsic Z-Y-X angles, in [-pi/2, pi/2]: `atan2(-R20, |(R00, R10)|)`.
    ///
    /// Nothing is lost near a quarter turn, where the inverse sine of R20 loses half its digits.
    pub fn pitch(&self) -> Expr {
        let [r00, r10, r20, ..] = self.euler_entries();
        (-r20).atan2((r00.powi(2) + r10.powi(2)).sqrt())
    }

    /// The rotation about the longitudinal axis of intrinsic Z-Y-X angles: `atan2(R21, R22)`.
    pub fn roll(&self) -> Expr {
        let [.., r21, r22] = self.euler_entries();
        r21.atan2(r22)
    }

    /// The vector `v` of the body in the world's axes: R v.
    pub fn rotate(&self, v: &[Expr; 3]) -> [Expr; 3] {
        let rows = self.matrix();
        self.product(|i, j| &rows[i][j], v)
    }

    /// The vector `v` of the world in the body's axes: R' v.
    pub fn rotate_inverse(&self, v: &[Expr; 3]) -> [Expr; 3] {
        let rows = self.matrix();
        self.product(|i, j| &rows[j][i], v)
    }

    fn product<'a>(&self, entry: impl Fn(usize, usize) -> &'a Expr, v: &[Expr; 3]) -> [Expr; 3] {
        let [x, y, z] = self.vector.each_ref();
        let norm = self.w.powi(2) + x.powi(2) + y.powi(2) + z.powi(2);
        std::array::from_fn(|i| {
            let sum = entry(i, 0) * &v[0] + entry(i, 1) * &v[1] + entry(i, 2) * &v[2];
            sum / &norm
        })
    }

    /// R00, R10, R20, R21, R22, times the squared norm.
    fn euler_entries(&self) -> [Expr; 5] {
        let [[r00, ..], [r10, ..], [r20, r21, r22]] = self.matrix();
        [r00, r10, r20, r21, r22]
    }

    /// The rotation matrix by rows, times the squared norm.
    fn matrix(&self) -> [[Expr; 3]; 3] {
        let [x, y, z] = self.vector.each_ref();
        let w = &self.w;
        let square = |a: &Expr| a.powi(2);
        let twice_sum = |a: Expr, b: Expr| 2.0 * (a + b);
        let twice_difference = |a: Expr, b: Expr| 2.0 * (a - b);
        [
            [square(w) + square(x) - square(y) - square(z), twice_difference(x * y, w * z), twice_sum(x * z, w * y)],
            [twice_sum(x * y, w * z), square(w) - square(x) + square(y) - square(z), twice_difference(y * z, w * x)],
            [twice_difference(x * z, w * y), twice_sum(y * z, w * x), square(w) - square(x) - square(y) + square(z)],
        ]
    }
}

/// Derivative of a rotation vector v (axis times angle, rad) for turn rates w (rad/s). About the axes of the body it is
/// `v' = Jr^-1 w = w + v x w/2 + c v x (v x w)`; about those of the world the second term has the other sign.
/// `c = (1 - |v|/2 cot(|v|/2))/|v|^2` (Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics",
/// arXiv:1812.01537, 2018, equation 144).
///
/// For |v|^2 < 1e-8, c is that of 1e-8: its error is 1e-11 there, in a term that is 1e-8 of the rates at most.
pub fn rotation_vector_rates(v: &[Expr; 3], rates: &[Expr; 3], world: bool) -> [Expr; 3] {
    let square = squared_length(v).max(Expr::number(1e-8));
    let half = 0.5 * square.sqrt();
    let factor = (1.0 - &half * half.cos() / half.sin()) / &square;
    let once = cross(v, rates);
    let twice = cross(v, &once);
    std::array::from_fn(|i| {
        let turned = 0.5 * &once[i];
        let first = if world { &rates[i] - turned } else { &rates[i] + turned };
        first + &factor * &twice[i]
    })
}

fn squared_length([x, y, z]: &[Expr; 3]) -> Expr {
    x.powi(2) + y.powi(2) + z.powi(2)
}

fn cross(a: &[Expr; 3], b: &[Expr; 3]) -> [Expr; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        &a[j] * &b[k] - &a[k] * &b[j]
    })
}
