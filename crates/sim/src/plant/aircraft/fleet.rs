//! The aircraft of a fleet, and the random conditions of their flights.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::latent::{Latent, Terms};
use super::parameters::{AircraftClimb, Spread};
use crate::parameter_error::ParameterError;
use crate::sensor::stream;

/// One aircraft of a fleet: the terms of its type with its own coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Airplane {
    pub(super) parameters: AircraftClimb,
    terms: Terms,
    index: u32,
}

impl Airplane {
    /// The aircraft that the parameters name.
    ///
    /// # Errors
    /// Those of [`AircraftClimb::validate`].
    pub fn new(parameters: &AircraftClimb) -> Result<Self, ParameterError> {
        parameters.validate()?;
        let fleet = &parameters.fleet;
        let mut random = stream(fleet.seed, &format!("fleet/{}", parameters.aircraft));
        // Cut off at three deviations: with the spreads allowed no coefficient changes its sign.
        let mut factor = |deviation: f64| {
            let normal: f64 = StandardNormal.sample(&mut random);
            1.0 + deviation * normal.clamp(-3.0, 3.0)
        };
        let mut terms = parameters.terms.clone();
        for (latent, deviation) in [
            (Latent::Thrust, fleet.thrust),
            (Latent::Drag, fleet.drag),
            (Latent::Lift, fleet.lift),
            (Latent::SpecificImpulse, fleet.specific_impulse),
        ] {
            let common = factor(deviation);
            terms.of_mut(latent).iter_mut().for_each(|term| term.coefficient *= common * factor(fleet.coefficient));
        }
        Ok(Self { parameters: parameters.clone(), terms, index: parameters.aircraft })
    }

    /// Its number in the fleet.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Its true terms.
    pub fn terms(&self) -> &Terms {
        &self.terms
    }
}

/// Conditions of one flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// At the beginning, kg.
    pub mass: f64,
    /// K warmer than standard.
    pub isa_deviation: f64,
    /// Calibrated airspeed up to the crossover, m/s.
    pub calibrated_speed: f64,
    /// From the crossover.
    pub mach: f64,
    /// Altitude at the end of the climb, m.
    pub cruise_altitude: f64,
    /// Taken off the fan speed in the lower climb, 1.
    pub derate: f64,
    /// Added to the fan speed, 1.
    pub fan_speed_offset: f64,
}

impl Conditions {
    /// Each from its own random numbers: one that is fixed by its parameters does not move the others.
    pub(super) fn draw(parameters: &AircraftClimb, seed: u64) -> Self {
        let flights = &parameters.flights;
        let of = |purpose: &str| stream(seed, &format!("conditions/{purpose}"));
        let mass = flights.mass.draw(&mut of("mass"));
        // A level of 1,000 ft, lower for the heavy.
        const LEVEL: f64 = 304.8;
        let heavier = flights.cruise_altitude_per_mass * (mass - flights.mass.mean);
        let altitude = flights.cruise_altitude.draw(&mut of("cruise_altitude")) - heavier;
        let levels = (altitude / LEVEL).round() * LEVEL;
        let chance: f64 = of("derate").random();
        let steps = if chance < flights.derate_chance {
            1.0
        } else if chance < 2.0 * flights.derate_chance {
            2.0
        } else {
            0.0
        };
        let normal: f64 = StandardNormal.sample(&mut of("fan_speed"));
        Self {
            mass,
            isa_deviation: flights.isa_deviation.draw(&mut of("isa_deviation")),
            calibrated_speed: flights.calibrated_speed.draw(&mut of("calibrated_speed")),
            mach: flights.mach.draw(&mut of("mach")),
            cruise_altitude: levels.clamp(flights.cruise_altitude.least, flights.cruise_altitude.most),
            derate: steps * parameters.autopilot.derate,
            fan_speed_offset: parameters.autopilot.fan_speed_flight * normal,
        }
    }
}

impl Spread {
    fn draw(&self, random: &mut Pcg64) -> f64 {
        let normal: f64 = StandardNormal.sample(random);
        (self.mean + self.deviation * normal).clamp(self.least, self.most)
    }
}
