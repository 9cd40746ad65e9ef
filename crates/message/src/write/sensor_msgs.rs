//! `sensor_msgs`: inertial units, joints and light.

use super::{
    Header, Message,
    cdr::Cdr,
    definition::{header, quaternion, section, vector3},
};

/// `sensor_msgs/msg/Imu`. A covariance that begins with -1 says that its quantity is not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imu<'a> {
    /// When, and the frame of the unit.
    pub header: Header<'a>,
    /// x, y, z, w; of length one.
    pub orientation: [f64; 4],
    /// About x, y, z, row-major.
    pub orientation_covariance: [f64; 9],
    /// About x, y, z in rad/s.
    pub angular_velocity: [f64; 3],
    /// About x, y, z, row-major.
    pub angular_velocity_covariance: [f64; 9],
    /// x, y, z in m/s^2.
    pub linear_acceleration: [f64; 3],
    /// Along x, y, z, row-major.
    pub linear_acceleration_covariance: [f64; 9],
}

impl Default for Imu<'_> {
    /// Not turned, everything else zero; covariances of zero mean unknown ones.
    fn default() -> Self {
        Self {
            header: Header::default(),
            orientation: [0.0, 0.0, 0.0, 1.0],
            orientation_covariance: [0.0; 9],
            angular_velocity: [0.0; 3],
            angular_velocity_covariance: [0.0; 9],
            linear_acceleration: [0.0; 3],
            linear_acceleration_covariance: [0.0; 9],
        }
    }
}

impl Message for Imu<'_> {
    const NAME: &'static str = "sensor_msgs/msg/Imu";
    const SCHEMA: &'static str = concat!(
        "std_msgs/Header header\n",
        "geometry_msgs/Quaternion orientation\n",
        "float64[9] orientation_covariance\n",
        "geometry_msgs/Vector3 angular_velocity\n",
        "float64[9] angular_velocity_covariance\n",
        "geometry_msgs/Vector3 linear_acceleration\n",
        "float64[9] linear_acceleration_covariance\n",
        quaternion!(),
        vector3!(),
        header!()
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.f64s(&self.orientation);
        cdr.f64s(&self.orientation_covariance);
        cdr.f64s(&self.angular_velocity);
        cdr.f64s(&self.angular_velocity_covariance);
        cdr.f64s(&self.linear_acceleration);
        cdr.f64s(&self.linear_acceleration_covariance);
    }
}

/// `sensor_msgs/msg/JointState`. Each array has one element a joint, or none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointState<'a> {
    /// When; the frame is not used.
    pub header: Header<'a>,
    /// The joints.
    pub name: &'a [&'a str],
    /// In rad or m.
    pub position: &'a [f64],
    /// In rad/s or m/s.
    pub velocity: &'a [f64],
    /// In N m or N.
    pub effort: &'a [f64],
}

impl Message for JointState<'_> {
    const NAME: &'static str = "sensor_msgs/msg/JointState";
    const SCHEMA: &'static str = concat!(
        "std_msgs/Header header\n",
        "string[] name\n",
        "float64[] position\n",
        "float64[] velocity\n",
        "float64[] effort\n",
        header!()
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.count(self.name.len());
        for name in self.name {
            cdr.text(name);
        }
        cdr.f64_sequence(self.position);
        cdr.f64_sequence(self.velocity);
        cdr.f64_sequence(self.effort);
    }
}

/// `sensor_msgs/msg/Illuminance`: light on a flat sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Illuminance<'a> {
    /// When, and the frame whose x axis the sensor looks along.
    pub header: Header<'a>,
    /// In lx.
    pub illuminance: f64,
    /// Of the illuminance, in lx^2; 0 means unknown.
    pub variance: f64,
}

impl Message for Illuminance<'_> {
    const NAME: &'static str = "sensor_msgs/msg/Illuminance";
    const SCHEMA: &'static str =
        concat!("std_msgs/Header header\n", "float64 illuminance\n", "float64 variance\n", header!());

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        self.header.put(&mut cdr);
        cdr.f64(self.illuminance);
        cdr.f64(self.variance);
    }
}
