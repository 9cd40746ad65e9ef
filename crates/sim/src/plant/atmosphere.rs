//! The International Standard Atmosphere up to 20 km, warmer or colder by a constant, and the speeds that depend on it.
//!
//! ISO 2533; the same model as in appendices A-C of the block-sparse bolasso paper, continued above 11 km. Altitude is
//! pressure altitude: on a day that is not standard the pressure at an altitude stays, temperature and density change.

/// Gravity, m/s^2.
pub const GRAVITY: f64 = 9.806_65;
/// Gas constant of air, J/(kg K) (appendix A).
pub const GAS_CONSTANT: f64 = 287.053;
/// Ratio of specific heats of air.
pub const HEAT_RATIO: f64 = 1.4;
/// Pressure at sea level, Pa.
pub const SEA_LEVEL_PRESSURE: f64 = 101_325.0;
/// Temperature at sea level, K.
pub const SEA_LEVEL_TEMPERATURE: f64 = 288.15;
/// Altitude of the top of the troposphere, m.
pub const TROPOPAUSE: f64 = 11_000.0;
/// Temperature gradient of the troposphere, K/m.
const LAPSE: f64 = -0.0065;

/// The state of the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Static temperature, K.
    pub temperature: f64,
    /// Static pressure, Pa.
    pub pressure: f64,
    /// kg/m^3
    pub density: f64,
    /// Speed of sound, m/s.
    pub sound_speed: f64,
}

impl Air {
    /// The air at a pressure altitude (m), `deviation` K warmer than standard.
    #[inline]
    pub fn at(altitude: f64, deviation: f64) -> Self {
        const EXPONENT: f64 = -GRAVITY / (GAS_CONSTANT * LAPSE);
        let troposphere = |altitude: f64| {
            let temperature = SEA_LEVEL_TEMPERATURE + LAPSE * altitude;
            (temperature, SEA_LEVEL_PRESSURE * (temperature / SEA_LEVEL_TEMPERATURE).powf(EXPONENT))
        };
        let (standard, pressure) = if altitude <= TROPOPAUSE {
            troposphere(altitude)
        } else {
            let (temperature, pressure) = troposphere(TROPOPAUSE);
            (temperature, pressure * (-GRAVITY * (altitude - TROPOPAUSE) / (GAS_CONSTANT * temperature)).exp())
        };
        let temperature = standard + deviation;
        Self {
            temperature,
            pressure,
            density: pressure / (GAS_CONSTANT * temperature),
            sound_speed: (HEAT_RATIO * GAS_CONSTANT * temperature).sqrt(),
        }
    }

    /// The Mach number that an airspeed indicator shows as this calibrated airspeed (m/s) at this pressure.
    ///
    /// Isentropic compression: `p_t - p = p_0 ((1 + 0.2 (CAS / a_0)^2)^3.5 - 1)`, `p_t / p = (1 + 0.2 M^2)^3.5`.
    pub fn mach_of_calibrated(&self, calibrated: f64) -> f64 {
        let impact = SEA_LEVEL_PRESSURE * ((1.0 + 0.2 * (calibrated / sea_level_sound()).powi(2)).powf(3.5) - 1.0);
        (5.0 * ((impact / self.pressure + 1.0).powf(1.0 / 3.5) - 1.0)).sqrt()
    }

    /// The calibrated airspeed (m/s) of a Mach number at this pressure: the inverse of [`Self::mach_of_calibrated`].
    pub fn calibrated_of_mach(&self, mach: f64) -> f64 {
        let impact = self.pressure * ((1.0 + 0.2 * mach * mach).powf(3.5) - 1.0);
        sea_level_sound() * (5.0 * ((impact / SEA_LEVEL_PRESSURE + 1.0).powf(1.0 / 3.5) - 1.0)).sqrt()
    }
}

fn sea_level_sound() -> f64 {
    (HEAT_RATIO * GAS_CONSTANT * SEA_LEVEL_TEMPERATURE).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ISO 2533, table 1: altitude (m), temperature (K), pressure (Pa), density (kg/m^3), speed of sound (m/s).
    #[test]
    fn the_published_table() {
        for (altitude, temperature, pressure, density, sound) in [
            (0.0, 288.15, 101_325.0, 1.2250, 340.294),
            (5_000.0, 255.65, 54_019.9, 0.736_116, 320.529),
            (11_000.0, 216.65, 22_632.0, 0.363_918, 295.069),
            (20_000.0, 216.65, 5_474.88, 0.088_034_9, 295.069),
        ] {
            let air = Air::at(altitude, 0.0);
            assert!((air.temperature - temperature).abs() < 1e-9);
            assert!((air.pressure / pressure - 1.0).abs() < 2e-5, "{altitude} {}", air.pressure);
            assert!((air.density / density - 1.0).abs() < 2e-5, "{altitude} {}", air.density);
            assert!((air.sound_speed / sound - 1.0).abs() < 2e-5, "{altitude} {}", air.sound_speed);
        }
    }

    #[test]
    fn a_warm_day_keeps_the_pressure() {
        let (standard, warm) = (Air::at(6_000.0, 0.0), Air::at(6_000.0, 12.0));
        assert_eq!(standard.pressure, warm.pressure);
        assert!((warm.density / standard.density - standard.temperature / warm.temperature).abs() < 1e-14);
    }

    #[test]
    fn calibrated_airspeed_and_mach_are_inverse() {
        let sea = Air::at(0.0, 0.0);
        assert!((sea.mach_of_calibrated(150.0) - 150.0 / sea.sound_speed).abs() < 1e-12);
        let air = Air::at(9_000.0, -5.0);
        assert!((air.calibrated_of_mach(air.mach_of_calibrated(155.0)) - 155.0).abs() < 1e-9);
        // The crossover of 300 kt and Mach 0.78 is published as 29,314 ft.
        let mach = Air::at(29_314.0 * 0.3048, 0.0).mach_of_calibrated(300.0 * 1852.0 / 3600.0);
        assert!((mach - 0.78).abs() < 1e-5, "{mach}");
    }
}
