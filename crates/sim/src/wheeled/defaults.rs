//! Tables of a world file with some of their keys: the others keep the values that this robot has, not those of any motor or sensor.

use fleetfoot_control::controller::Pid;

use crate::DcMotor;
use crate::partial_table::partial_table;
use crate::rigid::Contact;
use crate::sensor::{
    AccelerometerParameters, EncoderParameters, GyroscopeParameters, ImuParameters, LatencyParameters,
};

partial_table!(
    motor,
    DcMotor {
        resistance: f64,
        torque_constant: f64,
        gear_ratio: f64,
        rotor_inertia: f64,
        viscous_friction: f64,
        coulomb_friction: f64,
        supply_voltage: f64,
    },
    default_motor()
);
partial_table!(contact, Contact { friction: f64, natural_frequency: f64, damping_ratio: f64 }, default_contact());
partial_table!(
    pid,
    Pid {
        proportional: f64,
        integral: f64,
        derivative: f64,
        feedforward: f64,
        derivative_filter: f64,
        lowest: f64,
        highest: f64,
    },
    default_pid()
);
partial_table!(
    encoder,
    EncoderParameters { period: f64, bits: u32, noise: f64, zero: f64, rate_cutoff: f64 },
    default_encoder()
);
partial_table!(
    imu,
    ImuParameters {
        period: f64,
        position: [f64; 3],
        mounting: [f64; 3],
        gyroscope: GyroscopeParameters,
        accelerometer: AccelerometerParameters,
    },
    default_imu()
);
partial_table!(latency, LatencyParameters { minimum: f64, mean: f64, maximum: f64 }, default_latency());

/// A brushed motor of 25 mm for 6 V with a gearbox of 20:1: stalls at 0.27 N m, runs free at 52 rad/s.
pub(super) fn default_motor() -> DcMotor {
    DcMotor {
        resistance: 2.5,
        torque_constant: 5.7e-3,
        gear_ratio: 20.0,
        rotor_inertia: 2e-7,
        viscous_friction: 1e-4,
        coulomb_friction: 8e-3,
        supply_voltage: 6.0,
    }
}

/// Rubber on a dry floor.
pub(super) fn default_contact() -> Contact {
    Contact { friction: 0.7, ..Contact::default() }
}

/// The feedforward is the voltage that makes up for the back-EMF; the integral's time is that of the loaded motor, 0.2 s.
pub(super) fn default_pid() -> Pid {
    Pid { proportional: 0.3, integral: 1.5, feedforward: 0.114, lowest: -6.0, highest: 6.0, ..Pid::default() }
}

pub(super) fn default_encoder() -> EncoderParameters {
    EncoderParameters { period: 0.01, rate_cutoff: 20.0, ..EncoderParameters::default() }
}

pub(super) fn default_imu() -> ImuParameters {
    ImuParameters { period: 0.01, ..ImuParameters::default() }
}

/// Programs on one computer.
pub(super) fn default_latency() -> LatencyParameters {
    LatencyParameters { minimum: 1e-4, mean: 5e-4, maximum: 5e-3 }
}
