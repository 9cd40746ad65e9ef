//! A flight as a scenario that writes a log.

use fleetfoot_data::Column;
use glam::{DVec3, DVec4, EulerRot};
use rand_distr::{Distribution, StandardNormal};

use super::airframe::QuadrotorState;
use super::controller::Controller;
use super::instant::Instant;
use super::parameters::QuadrotorFlight;
use super::reference::{Target, Trajectory};
use super::sensors::Sensors;
use crate::parameter_error::ParameterError;
use crate::plant::wind::WindField;
use crate::sensor::stream;
use crate::{End, Regressors, Run, Scenario, Sink, SinkError, Topic};

/// Names and units of the columns.
const COLUMNS: [(&str, &str); 43] = [
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
    ("vx", "m/s"),
    ("vy", "m/s"),
    ("vz", "m/s"),
    ("yaw", "rad"),
    ("pitch", "rad"),
    ("roll", "rad"),
    ("wx", "rad/s"),
    ("wy", "rad/s"),
    ("wz", "rad/s"),
    ("rotor_1", "rad/s"),
    ("rotor_2", "rad/s"),
    ("rotor_3", "rad/s"),
    ("rotor_4", "rad/s"),
    ("u_1", "1"),
    ("u_2", "1"),
    ("u_3", "1"),
    ("u_4", "1"),
    ("qx", "1"),
    ("qy", "1"),
    ("qz", "1"),
    ("qw", "1"),
    ("ax", "m/s^2"),
    ("ay", "m/s^2"),
    ("az", "m/s^2"),
    ("wx_dot", "rad/s^2"),
    ("wy_dot", "rad/s^2"),
    ("wz_dot", "rad/s^2"),
    ("thrust", "N"),
    ("torque_x", "N m"),
    ("torque_y", "N m"),
    ("torque_z", "N m"),
    ("fa_x", "N"),
    ("fa_y", "N"),
    ("fa_z", "N"),
    ("wind_x", "m/s"),
    ("wind_y", "m/s"),
    ("wind_z", "m/s"),
    ("target_x", "m"),
    ("target_y", "m"),
    ("target_z", "m"),
];

/// Flights of a quadrotor in wind.
///
/// States: position and velocity (world's axes), yaw, pitch, roll, angular velocity (body's axes), rotor speeds;
/// inputs: the rotors' commands as they are held until the next row. Then the quaternion, what the states' derivatives
/// are at the row, thrust and torque, the force of the air f_a, the wind, and the trajectory that is tracked.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadrotorScenario {
    parameters: QuadrotorFlight,
}

impl QuadrotorScenario {
    /// Flights with these parameters.
    ///
    /// # Errors
    /// Those of [`QuadrotorFlight::validate`].
    pub fn new(parameters: &QuadrotorFlight) -> Result<Self, ParameterError> {
        parameters.validate()?;
        Ok(Self { parameters: parameters.clone() })
    }

    fn row(&self, now: &Instant, target: &Target) -> [f64; COLUMNS.len()] {
        let Instant { state, command, wind, loads } = now;
        let airframe = &self.parameters.airframe;
        let (yaw, pitch, roll) = state.orientation.to_euler(EulerRot::ZYX);
        let acceleration = airframe.acceleration(state, loads);
        let angular_acceleration = airframe.angular_acceleration(state, loads);
        let mut row = [0.0; COLUMNS.len()];
        let mut at = 0;
        let mut put = |values: &[f64]| {
            row[at..at + values.len()].copy_from_slice(values);
            at += values.len();
        };
        put(&state.position.to_array());
        put(&state.velocity.to_array());
        put(&[yaw, pitch, roll]);
        put(&state.angular_velocity.to_array());
        put(&state.rotors.to_array());
        put(&command.to_array());
        put(&state.orientation.to_array());
        put(&acceleration.to_array());
        put(&angular_acceleration.to_array());
        put(&[loads.thrust]);
        put(&loads.torque.to_array());
        put(&loads.air.to_array());
        put(&wind.to_array());
        put(&target.position.to_array());
        row
    }

    /// Reason why the quadrotor is lost, if it is.
    fn lost(&self, state: &QuadrotorState, target: &Target) -> Option<String> {
        let distance = state.position.distance(target.position);
        let up = (state.orientation * DVec3::Z).z;
        if distance.is_nan() || distance > self.parameters.lost_distance {
            Some(format!("{distance:.1} m from its trajectory"))
        } else if up.is_nan() || up < -0.5 {
            Some("it turned over".to_owned())
        } else {
            None
        }
    }
}

impl Scenario for QuadrotorScenario {
    fn topics(&self) -> Vec<Topic> {
        Sensors::topics(&self.parameters)
    }

    fn columns(&self) -> Vec<Column> {
        COLUMNS.iter().map(|&(name, unit)| Column { unit: Some(unit.to_owned()), ..Column::float(name) }).collect()
    }

    fn regressors(&self) -> Regressors {
        Regressors { states: 16, inputs: 4 }
    }

    fn row_period(&self) -> f64 {
        self.parameters.row_period
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let parameters = &self.parameters;
        let (airframe, period) = (&parameters.airframe, parameters.row_period);
        let nanoseconds = period * 1e9;
        let rows = (run.seconds / period).round() as u64;
        let mut trajectory = Trajectory::new(&parameters.reference, run.seed);
        let mut field = WindField::new(&parameters.wind, period, run.seed);
        let mut controller = Controller::new(&parameters.tracking, airframe, period);
        let mut noise = stream(run.seed, "command");
        let mut sensors = Sensors::new(parameters, run.seed);
        let mut state = QuadrotorState::at(trajectory.at(0.0).position);
        state.rotors = DVec4::splat(airframe.hover_speed());
        let mut end = End::Complete;
        for index in 0..rows {
            let seconds = index as f64 * period;
            let target = trajectory.at(seconds);
            if let Some(reason) = self.lost(&state, &target) {
                end = End::Fault { seconds, reason };
                break;
            }
            let wind = field.next();
            let shake = DVec4::from_array(std::array::from_fn(|_| StandardNormal.sample(&mut noise)));
            let command = controller.command(&state, &target) + parameters.command_noise * shake;
            let command = command.clamp(DVec4::ZERO, DVec4::ONE);
            let now = Instant { state, command, wind, loads: airframe.loads(&state, wind) };
            let time = (index as f64 * nanoseconds).round() as i64;
            sensors.sense(index, time, &now, sink)?;
            sink.row(sensors.true_stamp(time), &self.row(&now, &target))?;
            state =
                airframe.advance(&state, command, wind, period / f64::from(parameters.substeps), parameters.substeps);
        }
        sensors.finish(sink)?;
        Ok(end)
    }
}
