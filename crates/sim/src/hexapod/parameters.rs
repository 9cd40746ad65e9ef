//! Parameters of a hexapod.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Linkage;
use crate::DcMotor;
use crate::parameter_error::{ParameterError, in_range, not_negative, positive};
use crate::rigid::Contact;

/// The body that carries the legs: a box of uniform density, its origin in the middle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Trunk {
    /// kg
    pub mass: f64,
    /// Along x, m.
    pub length: f64,
    /// Along y, m.
    pub width: f64,
    /// Along z, m.
    pub height: f64,
}

impl Default for Trunk {
    fn default() -> Self {
        Self { mass: 0.0282, length: 0.10, width: 0.04, height: 0.012 }
    }
}

/// The six legs, all alike: a uniform rod below the hip with a ball at its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Leg {
    /// Of one leg with its share of the linkage, kg.
    pub mass: f64,
    /// From the hip to the sole, m.
    pub length: f64,
    /// Of the ball that is the foot, m.
    pub foot_radius: f64,
    /// The fore hips are this far before the middle ones and the aft hips as far behind, m.
    pub hip_spacing: f64,
    /// The hips are this far to the left or right of the trunk's middle plane, m.
    pub hip_offset: f64,
    /// The hips are this far below the trunk's middle, m.
    pub hip_drop: f64,
    /// Of the linkage against the leg's swing, N m/rad.
    pub swing_stiffness: f64,
    /// N m s/rad
    pub swing_damping: f64,
    /// Of the linkage against the leg's lift, N/m.
    pub lift_stiffness: f64,
    /// N s/m
    pub lift_damping: f64,
}

impl Default for Leg {
    fn default() -> Self {
        Self {
            mass: 3e-4,
            length: 0.025,
            foot_radius: 1.5e-3,
            hip_spacing: 0.034,
            hip_offset: 0.03,
            hip_drop: 0.0,
            swing_stiffness: 0.03,
            swing_damping: 9e-5,
            lift_stiffness: 60.0,
            lift_damping: 0.8,
        }
    }
}

impl Leg {
    /// Of the rod about the hip, across it, kg m^2.
    pub fn hip_inertia(&self) -> f64 {
        self.mass * self.length * self.length / 3.0
    }
}

/// A hexapod after the VelociRoACH (Buchan, Haldane, Fearing, IROS 2013, section II-A): six compliant legs, one motor and crank a side, no
/// imposed gait: the cranks run free of each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Hexapod {
    /// Length of a physics step, s. Halving the default changes mean speed and stride by 1 to 2 % where it walks (0.1 to 0.2 m/s); faster runs are chaotic, and
    /// their means differ by as much as those of other starts do. Twice the default is refused: the legs' dampers go unstable.
    pub step: f64,
    /// m/s^2
    pub gravity: f64,
    /// The body.
    pub trunk: Trunk,
    /// Each of the six.
    pub leg: Leg,
    /// Between cranks and legs.
    pub linkage: Linkage,
    /// One a side.
    pub motor: DcMotor,
    /// Feet and trunk on the ground.
    pub contact: Contact,
}

impl Default for Hexapod {
    fn default() -> Self {
        Self {
            step: 2.5e-4,
            gravity: 9.81,
            trunk: Trunk::default(),
            leg: Leg::default(),
            linkage: Linkage::default(),
            motor: DcMotor::default(),
            contact: Contact::default(),
        }
    }
}

/// Number of legs. Every array of six is in the order left fore, middle, aft, then right.
pub const LEGS: usize = 6;

/// The side of a leg (0 to 5): 0 left, 1 right.
pub const fn side(leg: usize) -> usize {
    leg / 3
}

/// Returns true for the middle leg of a side (legs 0 to 5), in antiphase to the other two.
pub const fn is_middle(leg: usize) -> bool {
    leg % 3 == 1
}

impl Hexapod {
    /// Checks every value, and that the springs are soft enough for the step.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("step", self.step, 1e-6, 1e-3, "from 0.000001 to 0.001 s")?;
        in_range("gravity", self.gravity, 0.0, 100.0, "from 0 to 100 m/s^2")?;
        self.check_bodies()?;
        self.linkage.validate().map_err(|e| e.within("linkage"))?;
        self.motor.validate().map_err(|e| e.within("motor"))?;
        self.contact.validate().map_err(|e| e.within("contact"))?;
        let longest = 2.0 * self.leg.length;
        let allowed = format!("at most 2 leg lengths, {longest} m");
        in_range("linkage.lift_amplitude", self.linkage.lift_amplitude, 0.0, longest, &allowed)?;
        in_range("linkage.arc_radius", self.linkage.arc_radius, 0.0, longest, &allowed)?;
        self.check_step()
    }

    fn check_bodies(&self) -> Result<(), ParameterError> {
        let Trunk { mass, length, width, height } = self.trunk;
        for (name, value) in [("mass", mass), ("length", length), ("width", width), ("height", height)] {
            positive(name, value).map_err(|e| e.within("trunk"))?;
        }
        let leg = &self.leg;
        for (name, value) in [("leg.mass", leg.mass), ("leg.length", leg.length), ("leg.foot_radius", leg.foot_radius)]
        {
            positive(name, value)?;
        }
        let allowed = format!("less than half the leg's length, {} m", leg.length);
        in_range("leg.foot_radius", leg.foot_radius, 0.0, 0.5 * leg.length, &allowed)?;
        for (name, value) in [
            ("leg.hip_spacing", leg.hip_spacing),
            ("leg.hip_offset", leg.hip_offset),
            ("leg.swing_stiffness", leg.swing_stiffness),
            ("leg.swing_damping", leg.swing_damping),
            ("leg.lift_stiffness", leg.lift_stiffness),
            ("leg.lift_damping", leg.lift_damping),
        ] {
            not_negative(name, value)?;
        }
        in_range("leg.hip_drop", leg.hip_drop, -height, height, "within the trunk's height of its middle")
    }

    /// Springs and dampers act explicitly on the legs: a free leg wants (step w)^2 + step d/m well below 2. Measured, the walking robot goes wrong at 1.4.
    fn check_step(&self) -> Result<(), ParameterError> {
        let leg = &self.leg;
        let stiffness = |stiffness: f64, damping: f64, inertia: f64| {
            (self.step * self.step * stiffness + self.step * damping) / inertia
        };
        let worst = stiffness(leg.swing_stiffness, leg.swing_damping, leg.hip_inertia()).max(stiffness(
            leg.lift_stiffness,
            leg.lift_damping,
            leg.mass,
        ));
        if worst < 0.9 {
            return Ok(());
        }
        let allowed =
            "short enough for the legs' stiffness, damping and mass: halve it, or make the legs softer or heavier";
        Err(ParameterError::new("step", self.step, allowed))
    }

    /// Travel per crank angle if nothing slips or bends, m/rad: the effective leg radius of the paper's equation (2).
    pub fn effective_radius(&self) -> f64 {
        self.linkage.effective_radius(self.leg.length)
    }

    /// Between the left and right feet, m: the width d of the paper's equation (2).
    pub fn track_width(&self) -> f64 {
        2.0 * self.leg.hip_offset
    }

    /// Of the whole robot, kg.
    pub fn mass(&self) -> f64 {
        self.trunk.mass + LEGS as f64 * self.leg.mass
    }

    /// Position of a leg's hip in the trunk at zero lift, m.
    pub fn hip(&self, leg: usize) -> DVec3 {
        let along = [1.0, 0.0, -1.0][leg % 3];
        let across = [1.0, -1.0][side(leg)];
        DVec3::new(along * self.leg.hip_spacing, across * self.leg.hip_offset, -self.leg.hip_drop)
    }

    /// The linkage's target for a leg at its side's crank angle.
    pub fn target(&self, leg: usize, crank_angle: f64) -> super::LegTarget {
        if is_middle(leg) { self.linkage.middle(crank_angle) } else { self.linkage.outer(crank_angle) }
    }
}
