//! Guidance and control of a climb: calibrated airspeed, then Mach number, held by pitch; thrust at its rating.

use rand_pcg::Pcg64;

use super::dynamics::{Forces, State};
use super::fleet::Conditions;
use super::parameters::{AircraftClimb, Autopilot};
use crate::OrnsteinUhlenbeck;
use crate::plant::atmosphere::{Air, GRAVITY, TROPOPAUSE};
use crate::sensor::stream;

/// Targets of the guidance until the next row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reference {
    /// True airspeed, m/s.
    pub(super) speed: f64,
    /// Fan speed, 1.
    pub(super) fan_speed: f64,
    /// Normal acceleration besides, m/s^2.
    pub(super) normal: f64,
}

/// The schedule of one flight with its slow wanders.
pub(super) struct Guidance<'a> {
    parameters: &'a AircraftClimb,
    conditions: Conditions,
    speed: (OrnsteinUhlenbeck, Pcg64),
    fan_speed: (OrnsteinUhlenbeck, Pcg64),
    normal: (OrnsteinUhlenbeck, Pcg64),
}

impl<'a> Guidance<'a> {
    pub(super) fn new(parameters: &'a AircraftClimb, conditions: Conditions, seed: u64) -> Self {
        let autopilot = &parameters.autopilot;
        let wander = |purpose: &str, deviation: f64, correlation: f64| {
            let mut random = stream(seed, purpose);
            (OrnsteinUhlenbeck::new(deviation, correlation, parameters.row_period, &mut random), random)
        };
        let slow = autopilot.wander_correlation;
        Self {
            parameters,
            conditions,
            speed: wander("guidance/speed", autopilot.speed_wander, slow),
            fan_speed: wander("guidance/fan_speed", autopilot.fan_speed_wander, slow),
            normal: wander("guidance/normal", autopilot.normal_wander, autopilot.normal_correlation),
        }
    }

    /// The next row's reference at an altitude (m).
    pub(super) fn next(&mut self, altitude: f64) -> Reference {
        let wander = |(process, random): &mut (OrnsteinUhlenbeck, Pcg64)| process.next(random);
        Reference {
            speed: self.scheduled_speed(altitude) + wander(&mut self.speed),
            fan_speed: self.rated_fan_speed(altitude) + wander(&mut self.fan_speed),
            normal: wander(&mut self.normal),
        }
    }

    /// True airspeed of the schedule, m/s: the lesser of the calibrated airspeed and the Mach number.
    pub(super) fn scheduled_speed(&self, altitude: f64) -> f64 {
        let flights = &self.parameters.flights;
        let air = Air::at(altitude, self.conditions.isa_deviation);
        let calibrated = if altitude < flights.transition_altitude {
            flights.initial_calibrated_speed.min(self.conditions.calibrated_speed)
        } else {
            self.conditions.calibrated_speed
        };
        air.mach_of_calibrated(calibrated).min(self.conditions.mach) * air.sound_speed
    }

    /// The climb rating, less what the flight takes off below 6 km.
    pub(super) fn rated_fan_speed(&self, altitude: f64) -> f64 {
        let autopilot = &self.parameters.autopilot;
        let rise = (altitude / TROPOPAUSE).clamp(0.0, 1.0) * (autopilot.fan_speed_high - autopilot.fan_speed);
        let left = ((6_000.0 - altitude) / 3_000.0).clamp(0.0, 1.0);
        autopilot.fan_speed + rise + self.conditions.fan_speed_offset - self.conditions.derate * left
    }
}

impl Autopilot {
    /// Rates of the angle of attack (rad/s) and of the fan speed (1/s).
    ///
    /// Three loops, slow to fast. The error of speed asks for an acceleration; the path angle is that at which the rest
    /// of the measured specific force climbs, sin gamma = (f_x - V'_c) / g. The error of the path angle asks for a
    /// normal acceleration. The angle of attack integrates the error of the measured normal acceleration, as
    /// fly-by-wire load-factor laws do.
    #[inline]
    pub(super) fn control(&self, state: &State, forces: &Forces, reference: &Reference) -> [f64; 2] {
        let [_, speed, path, mass, alpha, fan] = *state;
        let [along, normal] = forces.specific(state);
        let spendable = (self.acceleration_share * along).max(0.0);
        let acceleration = (self.speed_gain * (reference.speed - speed)).clamp(-self.deceleration, spendable);
        let path_asked = ((along - acceleration) / GRAVITY).clamp(-0.05, 0.3).asin();
        let turn = (speed * self.path_gain * (path_asked - path)).clamp(-2.0, 2.0);
        let normal_asked = GRAVITY * path.cos() + turn + reference.normal;
        let slope = forces.dynamic_pressure * self.lift_slope / mass;
        let rate = (normal_asked - normal) / (slope * self.load_lag);
        // Protection: towards the limit no faster than it is away.
        let rate = rate.min((self.alpha_most - alpha) / self.load_lag);
        [rate, (reference.fan_speed - fan) / self.engine_lag]
    }
}
