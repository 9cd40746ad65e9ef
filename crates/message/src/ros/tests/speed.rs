//! How fast programs run; measured on demand.

use std::time::Instant;

use super::super::codec;
use crate::{FieldPath, Row};

const IMU: &str = "std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
";

/// Messages a second of `sensor_msgs/Imu` from memory: `cargo test --release imu_speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn imu_speed() {
    let mut message = vec![0, 1, 0, 0, 10, 0, 0, 0, 20, 0, 0, 0, 9, 0, 0, 0];
    message.extend(b"imu_link\0");
    // The numbers are aligned to 8 from behind the encapsulation header.
    message.resize((message.len() - 4).next_multiple_of(8) + 4, 0);
    for place in 0..37 {
        message.extend(f64::from(place).to_le_bytes());
    }
    let codec = codec("cdr", "sensor_msgs/msg/Imu", "ros2msg", IMU.as_bytes()).unwrap();
    let vectors = ["angular_velocity", "linear_acceleration"];
    let mut all: Vec<String> = ["x", "y", "z", "w"].iter().map(|axis| format!("orientation.{axis}")).collect();
    all.extend((0..9).map(|place| format!("orientation_covariance[{place}]")));
    for vector in vectors {
        all.extend(["x", "y", "z"].iter().map(|axis| format!("{vector}.{axis}")));
        all.extend((0..9).map(|place| format!("{vector}_covariance[{place}]")));
    }
    for (name, fields) in [("all 37 numbers", all), ("angular_velocity.z", vec!["angular_velocity.z".to_owned()])] {
        let paths: Vec<FieldPath> = fields.iter().map(|field| field.parse().unwrap()).collect();
        let extract = codec.compile(&paths).unwrap();
        let mut row = Row::new(&*extract);
        for _ in 0..3 {
            const COUNT: usize = 3_000_000;
            let start = Instant::now();
            let mut sum = 0.0;
            for _ in 0..COUNT {
                extract.extract(std::hint::black_box(&message), &mut row).unwrap();
                sum += row.values[0];
            }
            let seconds = start.elapsed().as_secs_f64();
            let first = if paths.len() == 1 { 15.0 } else { 0.0 };
            assert_eq!(sum, first * COUNT as f64);
            assert_eq!(row.stamps, [10_000_000_020]);
            println!("{name}: {:.1} million messages/s", COUNT as f64 / seconds / 1e6);
        }
    }
}
