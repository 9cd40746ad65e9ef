//! Options of a fusion: its data, and prior knowledge of noise and constants.

use crate::{
    Estimate, Loss, SignalError,
    error::{check, check_stamps},
};

/// The readings of an inertial sensor: angular rate (rad/s) and specific force (m/s^2) in the body frame, a row a stamp (s); or those of a gyroscope alone.
#[derive(Debug, Clone, Copy)]
pub struct ImuRecord<'a> {
    /// Increasing.
    pub times: &'a [f64],
    /// Of the body against the world, in the body frame.
    pub rates: &'a [[f64; 3]],
    /// Acceleration less gravity: at rest it points up. Empty where there is no accelerometer.
    pub forces: &'a [[f64; 3]],
    /// Seconds before its stamp of which a rate, and a force, is the mean; 0: it is of the stamp itself. Means whose windows follow one another are held over these, so that what they sum to is exact.
    pub averages: [f64; 2],
}

/// Measured poses of the markers' frame in the world, a row a stamp (s).
#[derive(Debug, Clone, Copy)]
pub struct PoseRecord<'a> {
    /// Increasing.
    pub times: &'a [f64],
    /// m.
    pub positions: &'a [[f64; 3]],
    /// Quaternions x, y, z, w: the markers' frame to the world. Their sign does not matter, nor their norm.
    pub attitudes: &'a [[f64; 4]],
}

/// One recording of a body.
#[derive(Debug, Clone, Copy)]
pub struct BodyRun<'a> {
    /// The inertial sensor, whose frame is that of the body.
    pub imu: ImuRecord<'a>,
    /// The poses.
    pub poses: PoseRecord<'a>,
}

/// Noise of an inertial sensor, as in data sheets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise {
    /// Density of the rate's white noise about each axis, rad/s/sqrt(Hz).
    pub gyro: [f64; 3],
    /// Density of the force's white noise along each axis, m/s^2/sqrt(Hz).
    pub accelerometer: [f64; 3],
    /// Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz).
    pub gyro_walk: f64,
    /// Random walk of the accelerometer's bias, m/s^3/sqrt(Hz).
    pub accelerometer_walk: f64,
    /// Uncertainty of rate and force between two readings, as a factor. If neighbours jump by D beyond the slopes on
    /// either side, their integral is off by up to half of D times the step. With a uniformly distributed moment of the
    /// jump, the variance is D^2 / 12 times the square of the step. It is multiplied by the square of this factor. 0:
    /// no uncertainty, as for readings that are means.
    pub missed: [f64; 2],
    /// Deviations of the noise of single readings of rate and force, an axis. They are estimated from the readings, or
    /// else bounded by the differences of neighbours. Densities describe the error of integrals, which may be larger
    /// than the error of a reading. Infinite without any information.
    pub scatter: [[f64; 3]; 2],
}

impl ImuNoise {
    /// Densities that are the same for all axes, of rate and force, and of the walks of their biases.
    pub const fn even(gyro: f64, accelerometer: f64, gyro_walk: f64, accelerometer_walk: f64) -> Self {
        Self {
            gyro: [gyro; 3],
            accelerometer: [accelerometer; 3],
            gyro_walk,
            accelerometer_walk,
            missed: [0.0; 2],
            scatter: [[f64::INFINITY; 3]; 2],
        }
    }

    /// Densities of rate (0) or force (1).
    pub(super) fn densities(&self, which: usize) -> &[f64; 3] {
        if which == 0 { &self.gyro } else { &self.accelerometer }
    }

    /// Variances that single readings of rate (0) or force (1) do not exceed, those that stand for so many seconds where neighbours tell none.
    pub(super) fn greatest(&self, which: usize, seconds: f64) -> [f64; 3] {
        let (density, scatter) = (self.densities(which), self.scatter[which]);
        std::array::from_fn(|axis| match scatter[axis].is_finite() {
            true => scatter[axis].powi(2),
            false => density[axis].powi(2) / seconds,
        })
    }

    /// The variances of single readings of rate (0) or force (1) that stand for so many seconds.
    pub(super) fn variances(&self, which: usize, seconds: f64) -> [f64; 3] {
        let density = self.densities(which);
        std::array::from_fn(|axis| (density[axis].powi(2) / seconds).min(self.scatter[which][axis].powi(2)))
    }
}

/// Noise of all sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyNoise {
    /// Of the inertial sensor.
    pub imu: ImuNoise,
    /// Standard deviation of a measured position, m an axis.
    pub position: f64,
    /// Standard deviation of a measured attitude, rad an axis.
    pub attitude: f64,
    /// Density of the white noise that an axis' jerk is taken for where there is no accelerometer, m/s^3/sqrt(Hz).
    pub jerk: f64,
}

impl Default for BodyNoise {
    /// A sensor of some ten euros under a motion-capture system: a begin for [`FuseOptions::fit_noise`].
    fn default() -> Self {
        Self { imu: ImuNoise::even(2e-4, 2e-3, 2e-5, 3e-3), position: 1e-3, attitude: 5e-3, jerk: 100.0 }
    }
}

/// Prior of a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior<T> {
    /// The value that is expected.
    pub value: T,
    /// The standard deviation of its error. 0: it is given, and not estimated; infinite: nothing is known, and the value is where the search begins.
    pub deviation: f64,
}

impl<T> From<T> for Prior<T> {
    /// A value that is given.
    fn from(value: T) -> Self {
        Self { value, deviation: 0.0 }
    }
}

/// Options for the fusion of a body's sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct FuseOptions {
    /// Noise of the sensors.
    pub noise: BodyNoise,
    /// True to estimate noise from the residuals: the deviations of poses, the white noise of the inertial sensor, and
    /// its uncertainty between readings. The noise of single readings is estimated from the readings. `noise` is the
    /// first value.
    pub fit_noise: bool,
    /// True to estimate the walks of the biases of gyroscope and accelerometer as well; this needs `fit_noise`.
    pub fit_walks: [bool; 2],
    /// Gravity in the world, m/s^2. Its deviation is that of its direction, rad; the size stays. Infinite: the direction of the mean force is where the search begins.
    pub gravity: Prior<[f64; 3]>,
    /// The origin of the markers' frame in the body frame, m.
    pub lever: Prior<[f64; 3]>,
    /// The markers' frame to the body frame: a quaternion x, y, z, w; the deviation in rad. Infinite: found from the turns that both saw, however the markers are mounted.
    pub mounting: Prior<[f64; 4]>,
    /// Offset to add to the stamps of the poses for the times of the inertial sensor, s.
    pub offset: Prior<f64>,
    /// The gyroscope's bias at the beginning of every run, rad/s. Its deviation is not 0.
    pub gyro_bias: Prior<[f64; 3]>,
    /// The accelerometer's bias at the beginning of every run, m/s^2. Its deviation is not 0.
    pub accelerometer_bias: Prior<[f64; 3]>,
    /// Loss of the residuals of a measured position, or of an attitude.
    pub loss: Loss,
    /// Deviations beyond which a measured position, or an attitude, is left out; 0: no gate.
    pub gate: f64,
    /// Measurements from which states are estimated.
    pub estimate: Estimate,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self {
            noise: BodyNoise::default(),
            fit_noise: false,
            fit_walks: [false; 2],
            gravity: [0.0, 0.0, -9.806_65].into(),
            lever: [0.0; 3].into(),
            mounting: [0.0, 0.0, 0.0, 1.0].into(),
            offset: 0.0.into(),
            gyro_bias: Prior { value: [0.0; 3], deviation: 0.1 },
            accelerometer_bias: Prior { value: [0.0; 3], deviation: 0.5 },
            loss: Loss::default(),
            gate: 10.0,
            estimate: Estimate::Smoother,
        }
    }
}

/// Refuses numbers that are none, and rows that lack a stamp.
fn check_rows<const N: usize>(what: &'static str, values: &[[f64; N]], stamps: usize) -> Result<(), SignalError> {
    if values.len() != stamps {
        return Err(SignalError::Length { what, count: values.len(), expected: stamps });
    }
    match values.iter().enumerate().find_map(|(row, axes)| Some((row, *axes.iter().find(|x| !x.is_finite())?))) {
        Some((row, value)) => Err(SignalError::NotFinite { row, value }),
        None => Ok(()),
    }
}

impl BodyRun<'_> {
    /// Checks that the records can be fused.
    ///
    /// # Errors
    /// Records of different lengths or of fewer than two rows. Stamps that do not increase; values that are not finite;
    /// an attitude that is no rotation.
    pub fn check(&self) -> Result<(), SignalError> {
        let Self { imu, poses } = self;
        check_stamps(imu.times)?;
        check_rows("the angular rate", imu.rates, imu.times.len())?;
        if !imu.forces.is_empty() {
            check_rows("the specific force", imu.forces, imu.times.len())?;
        }
        for average in imu.averages {
            check(
                average >= 0.0 && average.is_finite(),
                "the window of a mean",
                average,
                "it must be 0 s or more, and finite",
            )?;
        }
        check_stamps(poses.times)?;
        check_rows("the position", poses.positions, poses.times.len())?;
        check_rows("the attitude", poses.attitudes, poses.times.len())?;
        for (what, rows) in [("an inertial sensor", imu.times.len()), ("a record of poses", poses.times.len())] {
            if rows < 2 {
                return Err(SignalError::TooShort { what, rows, needed: 1 });
            }
        }
        let square = |parts: &[f64; 4]| parts.iter().map(|part| part * part).sum::<f64>();
        match poses.attitudes.iter().map(square).position(|norm| norm < 1e-6) {
            Some(row) => Err(SignalError::Attitude { row }),
            None => Ok(()),
        }
    }
}

impl FuseOptions {
    pub(super) fn check(&self) -> Result<(), SignalError> {
        let BodyNoise { imu, position, attitude, jerk } = self.noise;
        let least = |axes: [f64; 3]| axes.into_iter().reduce(|a, b| if b > a { a } else { b }).unwrap_or(0.0);
        for (what, value) in [
            ("the noise density of the gyroscope", least(imu.gyro)),
            ("the noise density of the accelerometer", least(imu.accelerometer)),
            ("the walk of the gyroscope's bias", imu.gyro_walk),
            ("the walk of the accelerometer's bias", imu.accelerometer_walk),
            ("the deviation of positions", position),
            ("the deviation of attitudes", attitude),
            ("the density of the jerk", jerk),
        ] {
            check(value > 0.0 && value.is_finite(), what, value, "it must be positive and finite")?;
        }
        for missed in imu.missed {
            let allowed = "it must be a factor, 0 or more (0: nothing is missed)";
            check(missed >= 0.0 && missed.is_finite(), "what is missed between readings", missed, allowed)?;
        }
        self.loss.check()?;
        check(self.gate >= 0.0, "the gate", self.gate, "it must be a number of deviations, or 0 for none")?;
        let size = self.gravity.value.iter().map(|part| part * part).sum::<f64>().sqrt();
        check(size > 0.0 && size.is_finite(), "the size of gravity", size, "it must be positive and finite")?;
        let norm = self.mounting.value.iter().map(|part| part * part).sum::<f64>().sqrt();
        check(norm > 1e-3 && norm.is_finite(), "the norm of the mounting", norm, "a quaternion must have the norm 1")?;
        for (what, value, deviation) in [
            ("the lever", self.lever.value.iter().sum::<f64>(), self.lever.deviation),
            ("the mounting", norm, self.mounting.deviation),
            ("the offset", self.offset.value, self.offset.deviation),
            ("gravity", size, self.gravity.deviation),
        ] {
            check(value.is_finite(), what, value, "it is finite")?;
            check(
                deviation >= 0.0,
                what,
                deviation,
                "its deviation must be 0 (given), positive, or infinite (unknown)",
            )?;
        }
        for (what, prior) in
            [("the gyroscope's bias", &self.gyro_bias), ("the accelerometer's bias", &self.accelerometer_bias)]
        {
            let sum: f64 = prior.value.iter().sum();
            check(sum.is_finite(), what, sum, "it is finite")?;
            check(
                prior.deviation > 0.0,
                what,
                prior.deviation,
                "its deviation must be positive, or infinite (unknown)",
            )?;
        }
        Ok(())
    }
}
