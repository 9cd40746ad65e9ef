//! Parameters of a flight of the quadrotor.

use serde::{Deserialize, Serialize};

use super::airframe::Airframe;
use super::controller::Tracking;
use super::reference::Reference;
use crate::parameter_error::{ParameterError, in_range, not_negative};
use crate::partial_table::partial_table;
use crate::plant::wind::Wind;
use crate::sensor::{
    AccelerometerParameters, ClocksParameters, GyroscopeParameters, ImuParameters, LatencyParameters, MocapParameters,
};

/// A quadrotor that tracks a trajectory in wind.
///
/// Equations (1)-(4) of chapter 3 of *Sparse Non-linear System Identification in Robotics Using Meta-Learning
/// Approaches*. The forces of the air are those of [`Airframe`], and rotors follow their commands with a lag. There is
/// no ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QuadrotorFlight {
    /// Seconds between rows, which is the period of control and wind as well; periods of sensors are multiples of it.
    pub row_period: f64,
    /// Steps of the integrator between rows. One of 2 ms is good to 1e-8 m in half a second of tumbling.
    pub substeps: u32,
    /// Distance from its trajectory beyond which the quadrotor is lost, m.
    pub lost_distance: f64,
    /// Standard deviation of noise on every rotor's command, of the full command, new with every row: excitation.
    pub command_noise: f64,
    /// The rigid body with its rotors.
    pub airframe: Airframe,
    /// The wind.
    pub wind: Wind,
    /// Trajectory to fly.
    pub reference: Reference,
    /// Controller.
    pub tracking: Tracking,
    /// The clocks of its computers.
    pub clocks: ClocksParameters,
    /// The way from the robot to the logging computer.
    pub link: LatencyParameters,
    /// The inertial unit. Default: sampled at 500 Hz.
    #[serde(deserialize_with = "some_of_imu")]
    pub imu: ImuParameters,
    /// The motion-capture system.
    pub mocap: MocapParameters,
    /// The robot's estimate of its own motion.
    pub odometry: Odometry,
}

/// The robot's estimate of its own motion: the truth with white noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Odometry {
    /// Seconds between estimates.
    pub period: f64,
    /// Standard deviation on each coordinate, m.
    pub position_noise: f64,
    /// About each axis, rad.
    pub orientation_noise: f64,
    /// On each component, m/s.
    pub velocity_noise: f64,
    /// On each component, rad/s.
    pub rate_noise: f64,
}

impl Default for Odometry {
    fn default() -> Self {
        Self { period: 0.01, position_noise: 0.001, orientation_noise: 0.003, velocity_noise: 0.01, rate_noise: 0.01 }
    }
}

impl Default for QuadrotorFlight {
    fn default() -> Self {
        Self {
            row_period: 0.002,
            substeps: 1,
            lost_distance: 5.0,
            command_noise: 0.005,
            airframe: Airframe::default(),
            wind: Wind::default(),
            reference: Reference::default(),
            tracking: Tracking::default(),
            clocks: ClocksParameters::default(),
            link: LatencyParameters::default(),
            imu: imu(),
            mocap: MocapParameters::default(),
            odometry: Odometry::default(),
        }
    }
}

impl QuadrotorFlight {
    /// Checks that a flight can be computed with these parameters.
    ///
    /// # Errors
    /// The first invalid parameter, with its value and its allowed range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("row_period", self.row_period, 1e-4, 0.02, "from 0.0001 to 0.02 s")?;
        in_range("substeps", f64::from(self.substeps), 1.0, 100.0, "from 1 to 100")?;
        in_range("lost_distance", self.lost_distance, 0.1, 1e6, "from 0.1 to 1000000 m")?;
        in_range("command_noise", self.command_noise, 0.0, 0.2, "from 0 to 0.2")?;
        self.airframe.validate().map_err(|error| error.within("airframe"))?;
        self.wind.validate().map_err(|error| error.within("wind"))?;
        self.reference.validate().map_err(|error| error.within("reference"))?;
        self.tracking.validate().map_err(|error| error.within("tracking"))?;
        self.clocks.validate().map_err(|error| error.within("clocks"))?;
        self.link.validate().map_err(|error| error.within("link"))?;
        self.imu.validate().map_err(|error| error.within("imu"))?;
        self.mocap.validate().map_err(|error| error.within("mocap"))?;
        self.odometry.validate().map_err(|error| error.within("odometry"))?;
        self.rows_in("imu.period", self.imu.period)?;
        self.rows_in("mocap.period", self.mocap.period)?;
        self.rows_in("odometry.period", self.odometry.period).map(drop)
    }

    /// Number of rows in a sensor's period.
    pub(super) fn rows_in(&self, name: &str, period: f64) -> Result<u64, ParameterError> {
        let rows = (period / self.row_period).round();
        if rows >= 1.0 && (period - rows * self.row_period).abs() < 1e-9 * period {
            Ok(rows as u64)
        } else {
            Err(ParameterError::new(name, period, format!("a multiple of row_period, {} s", self.row_period)))
        }
    }
}

impl Odometry {
    fn validate(&self) -> Result<(), ParameterError> {
        in_range("period", self.period, 1e-4, 10.0, "from 0.0001 to 10 s")?;
        not_negative("position_noise", self.position_noise)?;
        in_range("orientation_noise", self.orientation_noise, 0.0, 1.0, "from 0 to 1 rad")?;
        not_negative("velocity_noise", self.velocity_noise)?;
        not_negative("rate_noise", self.rate_noise)
    }
}

partial_table!(
    some_of_imu,
    ImuParameters {
        period: f64,
        position: [f64; 3],
        mounting: [f64; 3],
        gyroscope: GyroscopeParameters,
        accelerometer: AccelerometerParameters,
    },
    imu()
);

fn imu() -> ImuParameters {
    ImuParameters { period: 0.002, ..ImuParameters::default() }
}
