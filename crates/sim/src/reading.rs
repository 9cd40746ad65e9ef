//! Readings of sensors in SI units, without the format of a log.

use glam::{DQuat, DVec3};

/// A topic of a robot's log: which kind of reading it carries, and in which frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Its name, e.g. `/imu/data`.
    pub name: String,
    /// Kind of every message on it.
    pub kind: Kind,
    /// Frame of its values; empty without a frame.
    pub frame: String,
}

/// Kinds of readings.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Kind {
    /// [`Reading::Imu`], with the standard deviations of the sensor's noise.
    Imu {
        /// rad/s
        angular_velocity_deviation: f64,
        /// m/s^2
        linear_acceleration_deviation: f64,
    },
    /// [`Reading::Joints`] of these joints.
    Joints(Vec<String>),
    /// [`Reading::Pose`].
    Pose,
    /// [`Reading::Odometry`] of this frame in the topic's frame.
    Odometry {
        /// The moving frame.
        child_frame: String,
    },
    /// [`Reading::Twist`], stamped.
    Twist,
    /// [`Reading::Vector`], stamped.
    Vector,
    /// [`Reading::Light`].
    Light,
    /// [`Reading::Number`]: no stamp of its own.
    Number,
    /// [`Reading::Flag`]: no stamp of its own.
    Flag,
    /// [`Reading::Numbers`] with these labels: no stamp of its own.
    Numbers(Vec<String>),
}

/// One message of a topic.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Reading<'a> {
    /// An inertial unit, in its own axes.
    Imu {
        /// rad/s
        angular_velocity: DVec3,
        /// Specific force, m/s^2: a unit at rest reads +g upwards.
        linear_acceleration: DVec3,
    },
    /// Joints, in the order of [`Kind::Joints`]. A slice is empty where nothing is measured.
    Joints {
        /// rad or m
        position: &'a [f64],
        /// rad/s or m/s
        velocity: &'a [f64],
        /// N m or N
        effort: &'a [f64],
    },
    /// Pose of a body.
    Pose {
        /// m
        position: DVec3,
        /// Body to world.
        orientation: DQuat,
    },
    /// Pose and velocity of a body.
    Odometry {
        /// In the topic's frame, m.
        position: DVec3,
        /// Body to world.
        orientation: DQuat,
        /// In the body's axes, m/s.
        linear_velocity: DVec3,
        /// In the body's axes, rad/s.
        angular_velocity: DVec3,
    },
    /// A velocity, or the command of one.
    Twist {
        /// m/s
        linear: DVec3,
        /// rad/s
        angular: DVec3,
    },
    /// A vector in the topic's frame.
    Vector(DVec3),
    /// The light of a lamp: 0 is dark.
    Light(f64),
    /// A number.
    Number(f64),
    /// Yes or no.
    Flag(bool),
    /// Numbers.
    Numbers(&'a [f64]),
}

impl Reading<'static> {
    /// The velocity, or the command of one, of a robot that moves forward (m/s) and turns about its vertical (rad/s).
    pub fn planar_twist([forward, turn]: [f64; 2]) -> Self {
        Self::Twist { linear: DVec3::new(forward, 0.0, 0.0), angular: DVec3::new(0.0, 0.0, turn) }
    }
}

/// When a message was made and when it was logged, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamps {
    /// By the clock of the computer that made it: the header's stamp.
    pub header: i64,
    /// By the clock of the computer that logs, at reception.
    pub log: i64,
}
