//! Contents of a run's log: topics and columns.

use fleetfoot_data::Column;

use super::parameters::HexapodTreadmill;
use crate::{Kind, Regressors, Topic};

/// Topics, by their index.
pub(super) const IMU: usize = 0;
pub(super) const JOINT_STATES: usize = 1;
pub(super) const COMMAND: usize = 2;
pub(super) const MOCAP_POSE: usize = 3;
pub(super) const ROBOT_SYNC: usize = 4;
pub(super) const MOCAP_SYNC: usize = 5;
pub(super) const VOLTAGE: usize = 6;
pub(super) const TRUTH_ODOMETRY: usize = 7;
pub(super) const TRUTH_CRANKS: usize = 8;
pub(super) const TRUTH_COMMAND: usize = 9;
pub(super) const TRUTH_BELT: usize = 10;
pub(super) const TRUTH_FEET: usize = 11;
pub(super) const TRUTH_RATES: usize = 12;
pub(super) const TRUTH_IMU_BIAS: usize = 13;
pub(super) const TRUTH_MOCAP: usize = 14;
pub(super) const CONTROLLER_SYNC: usize = 15;

/// Names of the cranks as joints.
const CRANKS: [&str; 2] = ["left_crank", "right_crank"];
/// Names of the feet, as arrays of six have them.
const FEET: [&str; 6] = ["left_fore", "left_middle", "left_aft", "right_fore", "right_middle", "right_aft"];

/// Rates of change of the states' velocities.
const RATES: [&str; 8] =
    ["vx_dot", "vy_dot", "vz_dot", "wx_dot", "wy_dot", "wz_dot", "alpha_l_rate_dot", "alpha_r_rate_dot"];
/// Faults of the motion capture's sample of an instant.
const MOCAP_FAULTS: [&str; 2] = ["outlier", "missing"];

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

pub(super) fn topics(scenario: &HexapodTreadmill) -> Vec<Topic> {
    let topic = |name: &str, kind: Kind, frame: &str| Topic { name: name.to_owned(), kind, frame: frame.to_owned() };
    let child_frame = "trunk".to_owned();
    let biases = Kind::Imu { angular_velocity_deviation: 0.0, linear_acceleration_deviation: 0.0 };
    vec![
        topic("/imu/data", scenario.imu.kind(), "imu"),
        topic("/joint_states", Kind::Joints(names(&CRANKS)), ""),
        topic("/cmd_vel", Kind::Twist, "trunk"),
        topic("/mocap/pose", Kind::Pose, "treadmill"),
        topic("/robot/sync", Kind::Light, "trunk"),
        topic("/mocap/sync", Kind::Light, "treadmill"),
        topic("/motor/voltage", Kind::Numbers(names(&CRANKS)), ""),
        topic("/truth/odometry", Kind::Odometry { child_frame }, "treadmill"),
        topic("/truth/cranks", Kind::Joints(names(&CRANKS)), ""),
        topic("/truth/cmd_vel", Kind::Twist, "trunk"),
        topic("/truth/belt", Kind::Joints(names(&["belt"])), ""),
        topic("/truth/feet", Kind::Numbers(names(&FEET)), ""),
        topic("/truth/rates", Kind::Numbers(names(&RATES)), ""),
        topic("/truth/imu_bias", biases, "imu"),
        topic("/truth/mocap", Kind::Numbers(names(&MOCAP_FAULTS)), ""),
        topic("/controller/sync", Kind::Light, ""),
    ]
}

/// Columns with their units: the states of equations (3) and (4), the inputs, what else is known.
const STATES: [(&str, &str); 16] = [
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
    ("yaw", "rad"),
    ("pitch", "rad"),
    ("roll", "rad"),
    ("alpha_l", "rad"),
    ("alpha_r", "rad"),
    ("vx", "m/s"),
    ("vy", "m/s"),
    ("vz", "m/s"),
    ("wx", "rad/s"),
    ("wy", "rad/s"),
    ("wz", "rad/s"),
    ("alpha_l_rate", "rad/s"),
    ("alpha_r_rate", "rad/s"),
];
const INPUTS: [(&str, &str); 2] = [("u_v", "m/s"), ("u_w", "rad/s")];
const OTHERS: [(&str, &str); 27] = [
    ("belt_speed", "m/s"),
    ("voltage_l", "V"),
    ("voltage_r", "V"),
    ("torque_l", "N m"),
    ("torque_r", "N m"),
    ("foot_left_fore", ""),
    ("foot_left_middle", ""),
    ("foot_left_aft", ""),
    ("foot_right_fore", ""),
    ("foot_right_middle", ""),
    ("foot_right_aft", ""),
    ("vx_dot", "m/s^2"),
    ("vy_dot", "m/s^2"),
    ("vz_dot", "m/s^2"),
    ("wx_dot", "rad/s^2"),
    ("wy_dot", "rad/s^2"),
    ("wz_dot", "rad/s^2"),
    ("alpha_l_rate_dot", "rad/s^2"),
    ("alpha_r_rate_dot", "rad/s^2"),
    ("gyro_bias_x", "rad/s"),
    ("gyro_bias_y", "rad/s"),
    ("gyro_bias_z", "rad/s"),
    ("accelerometer_bias_x", "m/s^2"),
    ("accelerometer_bias_y", "m/s^2"),
    ("accelerometer_bias_z", "m/s^2"),
    ("mocap_outlier", ""),
    ("mocap_missing", ""),
];
/// Columns of a row.
pub(super) const WIDTH: usize = STATES.len() + INPUTS.len() + OTHERS.len();

pub(super) fn columns() -> Vec<Column> {
    let all = STATES.iter().chain(&INPUTS).chain(&OTHERS);
    all.map(|&(name, unit)| {
        let mut column = Column::float(name);
        column.unit = (!unit.is_empty()).then(|| unit.to_owned());
        column
    })
    .collect()
}

pub(super) const REGRESSORS: Regressors = Regressors { states: STATES.len(), inputs: INPUTS.len() };
