//! The robot's parts.

use serde::{Deserialize, Serialize};

use super::defaults::{self, default_contact, default_motor};
use crate::parameter_error::{finite, in_range, not_negative, positive};
use crate::rigid::Contact;
use crate::{DcMotor, ParameterError};

/// A round robot on two driven wheels and a caster, the size of a small vacuum cleaner.
///
/// Its frame `base_link` has its origin in the middle of the wheels' axle: x forward, y left, z up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheeledRobot {
    /// Its body.
    pub chassis: Chassis,
    /// Both wheels.
    pub wheel: Wheel,
    /// Caster that supports the other end.
    pub caster: Caster,
    /// Of each wheel.
    #[serde(deserialize_with = "defaults::motor")]
    pub motor: DcMotor,
    /// Of tyres with the floor; friction of 0.05 is wet ice.
    #[serde(deserialize_with = "defaults::contact")]
    pub contact: Contact,
}

/// An upright cylinder about the axle's middle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Chassis {
    /// Without the wheels, kg.
    pub mass: f64,
    /// m
    pub radius: f64,
    /// m
    pub height: f64,
    /// From the floor to its lower side, m.
    pub clearance: f64,
    /// Of its centre of mass from the axle's middle, forward and up, m. Behind the axle, where the caster is.
    pub centre_of_mass: [f64; 2],
    /// Coulomb coefficient of its shell with walls, 1.
    pub friction: f64,
}

/// A disc on an axle across the robot. Its tyre is crowned: it touches at one point, under its middle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wheel {
    /// m
    pub radius: f64,
    /// Of the disc that its inertia is computed from, m.
    pub width: f64,
    /// kg
    pub mass: f64,
    /// Between the two wheels' middles, m.
    pub track: f64,
}

/// A ball that slides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Caster {
    /// Behind the axle, m; negative: before it.
    pub distance: f64,
    /// m
    pub radius: f64,
    /// Coulomb coefficient, or the floor's if that is less, 1: a ball that rolls in its socket.
    pub friction: f64,
}

impl Default for WheeledRobot {
    fn default() -> Self {
        Self {
            chassis: Chassis::default(),
            wheel: Wheel::default(),
            caster: Caster::default(),
            motor: default_motor(),
            contact: default_contact(),
        }
    }
}

impl Default for Chassis {
    fn default() -> Self {
        Self { mass: 1.5, radius: 0.12, height: 0.08, clearance: 0.015, centre_of_mass: [-0.03, 0.01], friction: 0.3 }
    }
}

impl Default for Wheel {
    fn default() -> Self {
        Self { radius: 0.035, width: 0.02, mass: 0.06, track: 0.18 }
    }
}

impl Default for Caster {
    fn default() -> Self {
        Self { distance: 0.09, radius: 0.012, friction: 0.03 }
    }
}

impl WheeledRobot {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        self.validate_chassis().map_err(|error| error.within("chassis"))?;
        self.validate_wheel().map_err(|error| error.within("wheel"))?;
        self.validate_caster().map_err(|error| error.within("caster"))?;
        self.motor.validate().map_err(|error| error.within("motor"))?;
        self.contact.validate().map_err(|error| error.within("contact"))
    }

    fn validate_chassis(&self) -> Result<(), ParameterError> {
        let Chassis { mass, radius, height, clearance, centre_of_mass: [x, z], friction } = self.chassis;
        positive("mass", mass)?;
        positive("radius", radius)?;
        positive("height", height)?;
        positive("clearance", clearance)?;
        let (low, high) =
            if self.caster.distance > 0.0 { (-self.caster.distance, 0.0) } else { (0.0, -self.caster.distance) };
        in_range("centre_of_mass[0]", x, low, high, &format!("between axle and caster, from {low} to {high}"))?;
        finite("centre_of_mass[1]", z)?;
        not_negative("friction", friction)
    }

    fn validate_wheel(&self) -> Result<(), ParameterError> {
        positive("radius", self.wheel.radius)?;
        positive("width", self.wheel.width)?;
        positive("mass", self.wheel.mass)?;
        let most = 2.0 * self.chassis.radius;
        positive("track", self.wheel.track)?;
        in_range("track", self.wheel.track, 0.0, most, &format!("at most the chassis's width, {most}"))
    }

    fn validate_caster(&self) -> Result<(), ParameterError> {
        let reach = self.chassis.radius;
        let words = format!("from -{reach} to {reach}, the chassis's radius, and not 0");
        in_range("distance", self.caster.distance, -reach, reach, &words)?;
        if self.caster.distance == 0.0 {
            return Err(ParameterError::new("distance", self.caster.distance, words));
        }
        positive("radius", self.caster.radius)?;
        not_negative("friction", self.caster.friction)
    }

    /// Of all bodies, kg.
    pub fn mass(&self) -> f64 {
        self.chassis.mass + 2.0 * self.wheel.mass
    }

    /// Of a wheel about its axle with the gearbox and rotor of its motor, kg m^2.
    pub fn wheel_inertia(&self) -> f64 {
        0.5 * self.wheel.mass * self.wheel.radius * self.wheel.radius + self.motor.inertia()
    }
}
