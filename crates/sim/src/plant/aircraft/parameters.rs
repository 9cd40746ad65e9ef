//! Parameters of the climbs of a fleet.

use serde::{Deserialize, Serialize};

use super::latent::{Latent, Terms};
use super::recorder::Recorder;
use crate::parameter_error::{ParameterError, in_range, not_negative, positive};

/// Climbs of twin-engine narrow-body jets from 5,000 ft to their cruise altitude, as quick access recorders keep them.
///
/// Flight mechanics in the vertical plane, equations (26)-(29) of the block-sparse bolasso paper, with latent functions
/// that are polynomials with known terms. A recording is one climb; it ends at its top. As in the paper there is no
/// wind, and height in (26) is pressure altitude on warm and cold days too.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AircraftClimb {
    /// Number of the aircraft in the fleet, from 0.
    pub aircraft: u32,
    /// Seconds between rows.
    pub row_period: f64,
    /// Steps of the integrator between rows: with two, a climb is within 1 mm of one with 32 times shorter steps.
    pub substeps: u32,
    /// When a recording begins, s since 1970. Default: 2025-01-01 00:00:00 UTC.
    pub epoch: i64,
    /// Differences between the aircraft of the fleet.
    pub fleet: Fleet,
    /// Differences between the flights.
    pub flights: Flights,
    /// Engine ratings, guidance and control.
    pub autopilot: Autopilot,
    /// Accelerations that the equations do not explain.
    pub turbulence: Turbulence,
    /// Noise and resolution of the recorded channels.
    pub recorder: Recorder,
    /// The terms of thrust, drag, lift and specific impulse of the type.
    pub terms: Terms,
}

impl Default for AircraftClimb {
    fn default() -> Self {
        Self {
            aircraft: 0,
            row_period: 1.0,
            substeps: 2,
            epoch: 1_735_689_600,
            fleet: Fleet::default(),
            flights: Flights::default(),
            autopilot: Autopilot::default(),
            turbulence: Turbulence::default(),
            recorder: Recorder::default(),
            terms: Terms::default(),
        }
    }
}

/// Differences of the fleet's aircraft from their type: a factor on every function, and another on every one of its
/// terms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Fleet {
    /// Number of the fleet: aircraft k of fleet s is always the same.
    pub seed: u64,
    /// Relative standard deviation of thrust (wear of the engines), 1.
    pub thrust: f64,
    /// Of drag (state of the surface), 1.
    pub drag: f64,
    /// Of lift (rigging), 1.
    pub lift: f64,
    /// Of specific impulse, 1.
    pub specific_impulse: f64,
    /// Of every single coefficient besides, 1.
    pub coefficient: f64,
}

impl Default for Fleet {
    fn default() -> Self {
        Self { seed: 0, thrust: 0.015, drag: 0.02, lift: 0.01, specific_impulse: 0.015, coefficient: 0.005 }
    }
}

/// A normal distribution, cut off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Its centre.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// Nothing is below.
    pub least: f64,
    /// Nothing is above.
    pub most: f64,
}

/// Differences between the flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Flights {
    /// Altitude at the beginning of a recording, m.
    pub initial_altitude: f64,
    /// Below this altitude (10,000 ft) the first speed holds, m.
    pub transition_altitude: f64,
    /// Calibrated airspeed below the transition altitude, m/s.
    pub initial_calibrated_speed: f64,
    /// Mass at the beginning, kg.
    pub mass: Spread,
    /// Temperature of the day above standard, K.
    pub isa_deviation: Spread,
    /// Calibrated airspeed up to the crossover to the Mach number, m/s.
    pub calibrated_speed: Spread,
    /// Mach number from the crossover.
    pub mach: Spread,
    /// Cruise altitude of an aircraft of mean mass, m; rounded to flight levels of 1,000 ft.
    pub cruise_altitude: Spread,
    /// Reduction of the cruise altitude for a heavier aircraft, m/kg.
    pub cruise_altitude_per_mass: f64,
    /// Chance of a climb with the thrust reduced by `autopilot.derate`, and, beyond it, by twice that, 1.
    pub derate_chance: f64,
    /// Climb rate at which the climb ends for want of thrust, m/s.
    pub residual_climb_rate: f64,
    /// The longest recording, s.
    pub longest: f64,
}

impl Default for Flights {
    fn default() -> Self {
        let spread = |mean, deviation, least, most| Spread { mean, deviation, least, most };
        Self {
            initial_altitude: 1524.0,
            transition_altitude: 3048.0,
            initial_calibrated_speed: 128.6,
            mass: spread(64_000.0, 5_000.0, 52_000.0, 76_000.0),
            isa_deviation: spread(0.0, 8.0, -20.0, 20.0),
            calibrated_speed: spread(152.0, 7.0, 138.0, 167.0),
            mach: spread(0.765, 0.012, 0.73, 0.79),
            cruise_altitude: spread(10_800.0, 500.0, 8_800.0, 11_900.0),
            cruise_altitude_per_mass: 0.1,
            derate_chance: 0.3,
            residual_climb_rate: 1.5,
            longest: 3_600.0,
        }
    }
}

/// Engine ratings, guidance and control. Guidance works once a row, control all the time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Autopilot {
    /// Climb rating at sea level, fan speed over its maximum, 1.
    pub fan_speed: f64,
    /// Climb rating at 11 km, 1.
    pub fan_speed_high: f64,
    /// Reduction of the fan speed by one step of reduced thrust, up to 3 km; it is gone at 6 km. 1.
    pub derate: f64,
    /// Standard deviation of the rating from flight to flight, 1.
    pub fan_speed_flight: f64,
    /// Standard deviation of the slow wander of the fan speed within a flight, 1.
    pub fan_speed_wander: f64,
    /// Time constant of the engines, s.
    pub engine_lag: f64,
    /// Standard deviation of the slow wander of the target speed, m/s.
    pub speed_wander: f64,
    /// Correlation time of the slow wanders, s.
    pub wander_correlation: f64,
    /// Standard deviation of the wander of the commanded normal acceleration, m/s^2.
    pub normal_wander: f64,
    /// Its correlation time, s.
    pub normal_correlation: f64,
    /// Demanded acceleration for an error of speed, 1/s.
    pub speed_gain: f64,
    /// The most deceleration that it asks for, m/s^2.
    pub deceleration: f64,
    /// The most of the excess thrust that it spends on acceleration, 1.
    pub acceleration_share: f64,
    /// Demanded rate of the path angle for an error of it, 1/s.
    pub path_gain: f64,
    /// Time constant of the loop that holds the normal acceleration by the angle of attack, s.
    pub load_lag: f64,
    /// Slope of lift over dynamic pressure that the loop assumes, m^2/rad.
    pub lift_slope: f64,
    /// The most angle of attack, rad.
    pub alpha_most: f64,
}

impl Default for Autopilot {
    fn default() -> Self {
        Self {
            fan_speed: 0.86,
            fan_speed_high: 0.92,
            derate: 0.02,
            fan_speed_flight: 0.005,
            fan_speed_wander: 0.002,
            engine_lag: 2.0,
            speed_wander: 1.5,
            wander_correlation: 60.0,
            normal_wander: 0.15,
            normal_correlation: 4.0,
            speed_gain: 0.06,
            deceleration: 0.3,
            acceleration_share: 0.6,
            path_gain: 0.2,
            load_lag: 1.0,
            lift_slope: 650.0,
            alpha_most: 0.17,
        }
    }
}

/// Accelerations that the equations do not explain: Ornstein-Uhlenbeck processes, held between rows, off by default.
///
/// With them on, the right-hand side of (27) has `eps_V` added and that of (28), times V, `eps_gamma`: the errors of (35)
/// and (36) over the mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Turbulence {
    /// Standard deviation along the path, m/s^2.
    pub longitudinal: f64,
    /// Standard deviation normal to it, m/s^2.
    pub normal: f64,
    /// Correlation time, s.
    pub correlation: f64,
}

impl Default for Turbulence {
    fn default() -> Self {
        Self { longitudinal: 0.0, normal: 0.0, correlation: 5.0 }
    }
}

impl AircraftClimb {
    /// Checks that a climb can be computed with these parameters.
    ///
    /// # Errors
    /// The first invalid parameter, with its value and its allowed range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("row_period", self.row_period, 0.01, 10.0, "from 0.01 to 10 s")?;
        in_range("substeps", f64::from(self.substeps), 1.0, 1000.0, "from 1 to 1000")?;
        in_range("epoch", self.epoch as f64, 0.0, 2e9, "from 0 to 2000000000 s")?;
        let step = self.row_period / f64::from(self.substeps.max(1));
        let shortest = self.autopilot.load_lag.min(self.autopilot.engine_lag);
        if step > 0.6 * shortest {
            let allowed =
                format!("at least {:.0} with these lags of the autopilot", (self.row_period / (0.6 * shortest)).ceil());
            return Err(ParameterError::new("substeps", self.substeps, allowed));
        }
        self.fleet.validate().map_err(|error| error.within("fleet"))?;
        self.flights.validate().map_err(|error| error.within("flights"))?;
        self.autopilot.validate().map_err(|error| error.within("autopilot"))?;
        not_negative("turbulence.longitudinal", self.turbulence.longitudinal)?;
        not_negative("turbulence.normal", self.turbulence.normal)?;
        positive("turbulence.correlation", self.turbulence.correlation)?;
        self.recorder.validate().map_err(|error| error.within("recorder"))?;
        self.check_terms().map_err(|error| error.within("terms"))
    }

    /// Degrees, and signs over the corners and the middle of the envelope: an aircraft without thrust, drag, lift slope
    /// or specific impulse does not climb.
    fn check_terms(&self) -> Result<(), ParameterError> {
        for latent in Latent::ALL {
            let name = field(latent);
            for term in self.terms.of(latent) {
                if term.powers[0] > latent.degree() || term.powers[0] + term.powers[1] > latent.degree() {
                    let allowed = format!("powers that sum up to {} at most", latent.degree());
                    return Err(ParameterError::new(name, format!("{:?}", term.powers), allowed));
                }
                if !term.coefficient.is_finite() {
                    return Err(ParameterError::new(name, term.coefficient, "a finite coefficient"));
                }
            }
            let envelope: [[f64; 2]; 3] = match latent {
                Latent::Thrust => [[0.3, 1.25], [0.3, 0.8], [0.4, 0.8]],
                Latent::Drag | Latent::Lift => [[-0.02, 0.12], [0.3, 0.8], [0.4, 0.8]],
                Latent::SpecificImpulse => [[0.0, 12_000.0], [0.3, 0.8], [0.4, 0.8]],
            };
            for second in envelope[0] {
                for third in envelope[1].iter().chain(&envelope[2]) {
                    let at = |second: f64| self.terms.value(latent, [1.0, second, *third]);
                    let value = if latent == Latent::Lift { at(second + 0.01) - at(second) } else { at(second) };
                    if !(value > 0.0 && value.is_finite()) {
                        let [first, two, three] = latent.variables();
                        let what = if latent == Latent::Lift { "growing with alpha" } else { "positive" };
                        let place = format!("{}/{first} {what} at {two} = {second}, {three} = {third}", latent.name());
                        return Err(ParameterError::new(name, value, place));
                    }
                }
            }
        }
        Ok(())
    }
}

/// The field of [`Terms`].
fn field(latent: Latent) -> &'static str {
    match latent {
        Latent::Thrust => "thrust",
        Latent::Drag => "drag",
        Latent::Lift => "lift",
        Latent::SpecificImpulse => "specific_impulse",
    }
}

impl Fleet {
    fn validate(&self) -> Result<(), ParameterError> {
        for (name, value) in [
            ("thrust", self.thrust),
            ("drag", self.drag),
            ("lift", self.lift),
            ("specific_impulse", self.specific_impulse),
            ("coefficient", self.coefficient),
        ] {
            in_range(name, value, 0.0, 0.1, "from 0 to 0.1")?;
        }
        Ok(())
    }
}

impl Spread {
    fn validate(&self, name: &str, least: f64, most: f64, unit: &str) -> Result<(), ParameterError> {
        let inner = |part: &str| format!("{name}.{part}");
        let allowed = format!("from {least} to {most} {unit}");
        in_range(&inner("least"), self.least, least, most, &allowed)?;
        in_range(
            &inner("most"),
            self.most,
            self.least,
            most,
            &format!("from {} (`least`) to {most} {unit}", self.least),
        )?;
        let allowed = format!("from {} (`least`) to {} (`most`)", self.least, self.most);
        in_range(&inner("mean"), self.mean, self.least, self.most, &allowed)?;
        not_negative(&inner("deviation"), self.deviation)
    }
}

impl Flights {
    fn validate(&self) -> Result<(), ParameterError> {
        in_range("initial_altitude", self.initial_altitude, 0.0, 8_000.0, "from 0 to 8000 m")?;
        in_range("transition_altitude", self.transition_altitude, 0.0, 8_000.0, "from 0 to 8000 m")?;
        in_range("initial_calibrated_speed", self.initial_calibrated_speed, 100.0, 180.0, "from 100 to 180 m/s")?;
        self.mass.validate("mass", 30_000.0, 100_000.0, "kg")?;
        self.isa_deviation.validate("isa_deviation", -40.0, 40.0, "K")?;
        self.calibrated_speed.validate("calibrated_speed", 100.0, 180.0, "m/s")?;
        self.mach.validate("mach", 0.5, 0.85, "")?;
        self.cruise_altitude.validate("cruise_altitude", self.initial_altitude, 14_000.0, "m")?;
        in_range("cruise_altitude_per_mass", self.cruise_altitude_per_mass, 0.0, 1.0, "from 0 to 1 m/kg")?;
        in_range("derate_chance", self.derate_chance, 0.0, 0.5, "from 0 to 0.5")?;
        in_range("residual_climb_rate", self.residual_climb_rate, 0.0, 10.0, "from 0 to 10 m/s")?;
        in_range("longest", self.longest, 1.0, 36_000.0, "from 1 to 36000 s")
    }
}

impl Autopilot {
    fn validate(&self) -> Result<(), ParameterError> {
        in_range("fan_speed", self.fan_speed, 0.3, 1.1, "from 0.3 to 1.1")?;
        in_range("fan_speed_high", self.fan_speed_high, 0.3, 1.1, "from 0.3 to 1.1")?;
        in_range("derate", self.derate, 0.0, 0.1, "from 0 to 0.1")?;
        in_range("fan_speed_flight", self.fan_speed_flight, 0.0, 0.05, "from 0 to 0.05")?;
        in_range("fan_speed_wander", self.fan_speed_wander, 0.0, 0.05, "from 0 to 0.05")?;
        positive("engine_lag", self.engine_lag)?;
        in_range("speed_wander", self.speed_wander, 0.0, 10.0, "from 0 to 10 m/s")?;
        positive("wander_correlation", self.wander_correlation)?;
        in_range("normal_wander", self.normal_wander, 0.0, 2.0, "from 0 to 2 m/s^2")?;
        positive("normal_correlation", self.normal_correlation)?;
        in_range("speed_gain", self.speed_gain, 0.005, 0.2, "from 0.005 to 0.2 1/s")?;
        in_range("deceleration", self.deceleration, 0.01, 2.0, "from 0.01 to 2 m/s^2")?;
        in_range("acceleration_share", self.acceleration_share, 0.05, 1.0, "from 0.05 to 1")?;
        in_range("path_gain", self.path_gain, 0.02, 0.5, "from 0.02 to 0.5 1/s")?;
        in_range("load_lag", self.load_lag, 0.2, 5.0, "from 0.2 to 5 s")?;
        in_range("lift_slope", self.lift_slope, 100.0, 3_000.0, "from 100 to 3000 m^2/rad")?;
        in_range("alpha_most", self.alpha_most, 0.05, 0.3, "from 0.05 to 0.3 rad")
    }
}
