//! The robots that logs can be generated of: one entry each.

use std::f64::consts::PI;

use fleetfoot_sim::{
    Excitation, HexapodTreadmill, Wheeled,
    excitation::Axis,
    plant::{
        aircraft::{AircraftClimb, ClimbScenario},
        quadrotor::{QuadrotorFlight, QuadrotorScenario},
        stage::{Stage, StageScenario},
    },
};

use super::{
    recipes,
    robot::{Kind, Robot},
};

/// All robots, in the order of messages.
pub(super) static ROBOTS: &[&dyn Robot] = &[&HEXAPOD, &DIFFDRIVE, &AIRCRAFT, &QUADROTOR, &STAGE];

static HEXAPOD: Kind<HexapodTreadmill> = Kind {
    name: "hexapod",
    speed: Some("belt.speed"),
    excite: Some(|world, kind| {
        // Well within what keeps the robot on the belt.
        world.excitation.velocity = Excitation::over(kind, -0.1, 0.1)?;
        world.excitation.yaw_rate = Excitation::over(kind, -1.0, 1.0)?;
        Ok(())
    }),
    // The leg-phase plane.
    spread: &[("alpha_l", Axis { low: -PI, high: PI, bins: 24 }), ("alpha_r", Axis { low: -PI, high: PI, bins: 24 })],
    tables: false,
    seconds: 60.0,
    recipe: recipes::HEXAPOD,
    scenario: |world| {
        world.validate()?;
        Ok(Box::new(world))
    },
};

static DIFFDRIVE: Kind<Wheeled> = Kind {
    name: "diffdrive",
    speed: None,
    excite: Some(|world, kind| {
        // Four fifths of what the commands are limited to.
        let (v, w) = (0.8 * world.commands.v_limit, 0.8 * world.commands.w_limit);
        world.commands.v = Excitation::over(kind, -v, v)?;
        world.commands.w = Excitation::over(kind, -w, w)?;
        Ok(())
    }),
    spread: &[("v", Axis { low: -1.0, high: 1.0, bins: 20 }), ("w", Axis { low: -4.0, high: 4.0, bins: 20 })],
    tables: false,
    seconds: 60.0,
    recipe: recipes::DIFFDRIVE,
    scenario: |world| {
        world.validate()?;
        Ok(Box::new(world))
    },
};

static AIRCRAFT: Kind<AircraftClimb> = Kind {
    name: "aircraft",
    speed: None,
    excite: None,
    spread: &[("h", Axis { low: 0.0, high: 13_000.0, bins: 26 }), ("V", Axis { low: 100.0, high: 260.0, bins: 16 })],
    tables: true,
    // A climb ends at its top, long before.
    seconds: 3600.0,
    recipe: recipes::AIRCRAFT,
    scenario: |world| Ok(Box::new(ClimbScenario::new(&world)?)),
};

static QUADROTOR: Kind<QuadrotorFlight> = Kind {
    name: "quadrotor",
    speed: None,
    excite: None,
    spread: &[("vx", Axis { low: -3.0, high: 3.0, bins: 15 }), ("vy", Axis { low: -3.0, high: 3.0, bins: 15 })],
    tables: false,
    seconds: 60.0,
    recipe: recipes::QUADROTOR,
    scenario: |world| Ok(Box::new(QuadrotorScenario::new(&world)?)),
};

static STAGE: Kind<Stage> = Kind {
    name: "stage",
    speed: None,
    excite: Some(|world, kind| {
        // Four fifths of the amplifier's voltage.
        let most = 0.8 * world.voltage;
        world.excitation = Excitation::over(kind, -most, most)?;
        Ok(())
    }),
    spread: &[("q", Axis { low: -0.12, high: 0.12, bins: 12 }), ("qd", Axis { low: -0.5, high: 0.5, bins: 20 })],
    tables: false,
    seconds: 20.0,
    recipe: recipes::STAGE,
    scenario: |world| Ok(Box::new(StageScenario::new(&world)?)),
};
