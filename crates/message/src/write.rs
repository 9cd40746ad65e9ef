//! Well-known ROS 2 messages, written.
//!
//! Viewers and drivers know these types by name, so they draw or replay them without further settings. Each type here
//! is a plain struct of borrowed data with its name, its definition and its bytes. The bytes are little-endian CDR
//! (XCDR version 1), as every ROS 2 middleware since Foxy reads it.
//!
//! Vectors are `[x, y, z]` in SI units: metres, metres per second, radians per second, newtons or newton metres, as
//! stated at their field. Quaternions are `[x, y, z, w]`; covariances are row-major.

mod cdr;
mod definition;
mod geometry_msgs;
mod header;
mod nav_msgs;
mod sensor_msgs;
mod std_msgs;
#[cfg(test)]
mod tests;
mod tf2_msgs;

pub use geometry_msgs::{Pose, PoseStamped, Twist, TwistStamped, Vector3Stamped, WrenchStamped};
pub use header::{Header, Time};
pub use nav_msgs::Odometry;
pub use sensor_msgs::{Illuminance, Imu, JointState};
pub use std_msgs::{Bool, Float64, Float64MultiArray, MultiArrayDimension};
pub use tf2_msgs::{TFMessage, TransformStamped};

/// MCAP's name for the encoding of [`Message::encode`].
pub const MESSAGE_ENCODING: &str = "cdr";

/// MCAP's name for the encoding of [`Message::SCHEMA`].
pub const SCHEMA_ENCODING: &str = "ros2msg";

/// A message of a type that ROS 2 defines.
pub trait Message {
    /// Its type, e.g. `sensor_msgs/msg/Imu`.
    const NAME: &'static str;

    /// The type's definition with those of all types it uses, joined as rosbag2 joins them.
    const SCHEMA: &'static str;

    /// Replaces the contents of `out` by the message, from the encapsulation header on.
    ///
    /// Texts and arrays carry 32-bit counts: what is longer gives bytes that nobody can read, and these are at least 4 GiB. Whoever stores
    /// messages refuses such.
    fn encode(&self, out: &mut Vec<u8>);
}
