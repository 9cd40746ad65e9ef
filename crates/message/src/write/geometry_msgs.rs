//! `geometry_msgs`: poses, velocities, forces.

use super::{
    Header, Message,
    cdr::Cdr,
    definition::{header, pose, quaternion, section, twist, vector3},
};

/// `geometry_msgs/msg/Pose`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// x, y, z in metres.
    pub position: [f64; 3],
    /// x, y, z, w; of length one.
    pub orientation: [f64; 4],
}

impl Default for Pose {
    /// At the origin, not turned.
    fn default() -> Self {
        Self { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl Pose {
    pub(super) fn put(&self, cdr: &mut Cdr<'_>) {
        cdr.f64s(&self.position);
        cdr.f64s(&self.orientation);
    }
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseStamped<'a> {
    /// When, and the frame that the pose is given in.
    pub header: Header<'a>,
    /// The pose.
    pub pose: Pose,
}

impl Message for PoseStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/PoseStamped";
    const SCHEMA: &'static str = concat!("std_msgs/Header header\nPose pose\n", pose!(), header!());

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        self.pose.put(&mut cdr);
    }
}

/// `geometry_msgs/msg/Twist`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// x, y, z in m/s.
    pub linear: [f64; 3],
    /// About x, y, z in rad/s.
    pub angular: [f64; 3],
}

impl Twist {
    pub(super) fn put(&self, cdr: &mut Cdr<'_>) {
        cdr.f64s(&self.linear);
        cdr.f64s(&self.angular);
    }
}

impl Message for Twist {
    const NAME: &'static str = "geometry_msgs/msg/Twist";
    const SCHEMA: &'static str = concat!("Vector3 linear\nVector3 angular\n", vector3!());

    fn encode(&self, out: &mut Vec<u8>) {
        self.put(&mut Cdr::begin(out));
    }
}

/// `geometry_msgs/msg/TwistStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TwistStamped<'a> {
    /// When, and the frame that the velocities are given in.
    pub header: Header<'a>,
    /// The velocities.
    pub twist: Twist,
}

impl Message for TwistStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/TwistStamped";
    const SCHEMA: &'static str = concat!("std_msgs/Header header\nTwist twist\n", twist!(), header!());

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        self.twist.put(&mut cdr);
    }
}

/// `geometry_msgs/msg/Vector3Stamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vector3Stamped<'a> {
    /// When, and the frame that the vector is given in.
    pub header: Header<'a>,
    /// x, y, z.
    pub vector: [f64; 3],
}

impl Message for Vector3Stamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/Vector3Stamped";
    const SCHEMA: &'static str = concat!("std_msgs/Header header\nVector3 vector\n", vector3!(), header!());

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.f64s(&self.vector);
    }
}

/// `geometry_msgs/msg/WrenchStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WrenchStamped<'a> {
    /// When, and the frame that the wrench is given in.
    pub header: Header<'a>,
    /// x, y, z in newtons.
    pub force: [f64; 3],
    /// About x, y, z in newton metres.
    pub torque: [f64; 3],
}

impl Message for WrenchStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/WrenchStamped";
    const SCHEMA: &'static str = concat!(
        "std_msgs/Header header\nWrench wrench\n",
        section!("geometry_msgs/Wrench", "Vector3 force\nVector3 torque\n"),
        vector3!(),
        header!()
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.f64s(&self.force);
        cdr.f64s(&self.torque);
    }
}
