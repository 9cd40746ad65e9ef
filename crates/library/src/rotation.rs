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
