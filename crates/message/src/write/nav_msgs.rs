//! `nav_msgs`: odometry.

use super::{
    Header, Message, Pose, Twist,
    cdr::Cdr,
    definition::{header, pose, quaternion, section, twist, vector3},
};

/// `nav_msgs/msg/Odometry`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odometry<'a> {
    /// When, and the frame that the pose is given in.
    pub header: Header<'a>,
    /// The frame that moves, which the velocities are given in.
    pub child_frame_id: &'a str,
    /// Pose.
    pub pose: Pose,
    /// Of x, y, z and the rotations about them, row-major.
    pub pose_covariance: [f64; 36],
    /// Velocity.
    pub twist: Twist,
    /// Of the velocities along and about x, y, z, row-major.
    pub twist_covariance: [f64; 36],
}

impl Default for Odometry<'_> {
    /// At rest at the origin, covariances zero.
    fn default() -> Self {
        Self {
            header: Header::default(),
            child_frame_id: "",
            pose: Pose::default(),
            pose_covariance: [0.0; 36],
            twist: Twist::default(),
            twist_covariance: [0.0; 36],
        }
    }
}

impl Message for Odometry<'_> {
    const NAME: &'static str = "nav_msgs/msg/Odometry";
    const SCHEMA: &'static str = concat!(
        "std_msgs/Header header\n",
        "string child_frame_id\n",
        "geometry_msgs/PoseWithCovariance pose\n",
        "geometry_msgs/TwistWithCovariance twist\n",
        section!("geometry_msgs/PoseWithCovariance", "Pose pose\nfloat64[36] covariance\n"),
        pose!(),
        section!("geometry_msgs/TwistWithCovariance", "Twist twist\nfloat64[36] covariance\n"),
        twist!(),
        header!()
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.text(self.child_frame_id);
        self.pose.put(&mut cdr);
        cdr.f64s(&self.pose_covariance);
        self.twist.put(&mut cdr);
        cdr.f64s(&self.twist_covariance);
    }
}
