//! Definitions of the ROS 2 interfaces, in pieces.
//!
//! A message's text is the definition of its type followed by one section for each type that it uses, in the order of rosbag2: depth first,
//! siblings by name, every type once. They are macros because `concat!` takes only literals.

/// One used type: a rule, its name, its fields.
macro_rules! section {
    ($name:literal, $fields:literal) => {
        concat!(
            "\n================================================================================\nMSG: ",
            $name,
            "\n",
            $fields
        )
    };
}

macro_rules! header {
    () => {
        concat!(
            section!("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
            section!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
        )
    };
}

macro_rules! vector3 {
    () => {
        section!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
    };
}

macro_rules! quaternion {
    () => {
        section!("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n")
    };
}

macro_rules! pose {
    () => {
        concat!(
            section!("geometry_msgs/Pose", "Point position\nQuaternion orientation\n"),
            section!("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
            quaternion!()
        )
    };
}

macro_rules! twist {
    () => {
        concat!(section!("geometry_msgs/Twist", "Vector3 linear\nVector3 angular\n"), vector3!())
    };
}

pub(super) use {header, pose, quaternion, section, twist, vector3};
