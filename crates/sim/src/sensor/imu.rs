//! An inertial measurement unit: specific force and angular velocity, as in its registers.

use glam::{DQuat, DVec3, EulerRot};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{check, quantise::Converter, streams};
use crate::{Kind, ParameterError, Reading};

/// m/s^2, by convention: what a unit's range in g means.
const STANDARD_GRAVITY: f64 = 9.80665;

/// An inertial measurement unit. The noise, ranges and bits are those that data sheets of small MEMS units state (2000 deg/s and 16 g at 16
/// bits, 5 mdeg/s and 400 ug a root hertz at a bandwidth of about 260 Hz).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuParameters {
    /// Seconds between samples.
    pub period: f64,
    /// Position of the unit in the body's axes, from the point whose velocity is given (the centre of mass), m.
    pub position: [f64; 3],
    /// Orientation of the unit in the body: yaw, pitch, roll, rad.
    pub mounting: [f64; 3],
    /// The gyroscope.
    pub gyroscope: GyroscopeParameters,
    /// The accelerometer.
    pub accelerometer: AccelerometerParameters,
}

impl Default for ImuParameters {
    fn default() -> Self {
        Self {
            period: 1e-3,
            position: [0.0; 3],
            mounting: [0.0; 3],
            gyroscope: GyroscopeParameters::default(),
            accelerometer: AccelerometerParameters::default(),
        }
    }
}

/// A three-axis gyroscope.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GyroscopeParameters {
    /// Standard deviation of a sample's white noise, rad/s.
    pub noise: f64,
    /// Standard deviation of the bias at the beginning of a run, rad/s.
    pub bias: f64,
    /// Standard deviation that the bias gathers as a random walk, rad/s a root second.
    pub bias_walk: f64,
    /// Largest rate, rad/s.
    pub range: f64,
    /// Bits over the range, both signs; 0 does not round.
    pub bits: u32,
}

impl Default for GyroscopeParameters {
    fn default() -> Self {
        Self { noise: 1.4e-3, bias: 0.01, bias_walk: 1e-4, range: 2000f64.to_radians(), bits: 16 }
    }
}

/// A three-axis accelerometer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AccelerometerParameters {
    /// Standard deviation of a sample's white noise, m/s^2.
    pub noise: f64,
    /// Standard deviation of the bias at the beginning of a run, m/s^2.
    pub bias: f64,
    /// Standard deviation that the bias gathers as a random walk, m/s^2 a root second.
    pub bias_walk: f64,
    /// Largest specific force, m/s^2.
    pub range: f64,
    /// Bits over the range, both signs; 0 does not round.
    pub bits: u32,
}

impl Default for AccelerometerParameters {
    fn default() -> Self {
        Self { noise: 0.063, bias: 0.2, bias_walk: 1e-3, range: 16.0 * STANDARD_GRAVITY, bits: 16 }
    }
}

impl ImuParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::positive("period", self.period, 1.0)?;
        check::position("position", self.position)?;
        for (index, angle) in self.mounting.into_iter().enumerate() {
            check::within(&format!("mounting[{index}]"), angle, -7.0..=7.0)?;
        }
        let GyroscopeParameters { noise, bias, bias_walk, range, bits } = self.gyroscope;
        triad([noise, bias, bias_walk], range, bits).map_err(|error| error.within("gyroscope"))?;
        let AccelerometerParameters { noise, bias, bias_walk, range, bits } = self.accelerometer;
        triad([noise, bias, bias_walk], range, bits).map_err(|error| error.within("accelerometer"))
    }

    /// Kind of this unit's topic.
    pub fn kind(&self) -> Kind {
        Kind::Imu {
            angular_velocity_deviation: self.gyroscope.noise,
            linear_acceleration_deviation: self.accelerometer.noise,
        }
    }
}

fn triad([noise, bias, walk]: [f64; 3], range: f64, bits: u32) -> Result<(), ParameterError> {
    check::within("noise", noise, 0.0..=1e4)?;
    check::within("bias", bias, 0.0..=1e4)?;
    check::within("bias_walk", walk, 0.0..=1e4)?;
    check::positive("range", range, 1e6)?;
    check::within("bits", f64::from(bits), 0.0..=32.0)
}

/// Orientation and velocities of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyMotion {
    /// Body to world.
    pub orientation: DQuat,
    /// Of the point that [`ImuParameters::position`] counts from, in the world's axes, m/s.
    pub linear_velocity: DVec3,
    /// In the world's axes, rad/s.
    pub angular_velocity: DVec3,
}

/// Reading of the unit, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// rad/s
    pub angular_velocity: DVec3,
    /// Specific force, m/s^2.
    pub linear_acceleration: DVec3,
}

impl ImuSample {
    /// As a message.
    pub fn reading(&self) -> Reading<'static> {
        Reading::Imu { angular_velocity: self.angular_velocity, linear_acceleration: self.linear_acceleration }
    }
}

/// An inertial measurement unit on a body.
///
/// The accelerometer reports the mean of the specific force over the sample, `(change of its velocity) / period + g`,
/// in the axes of the unit in the middle of the sample. A unit that integrates between its samples does the same, and
/// this catches the whole of an impact shorter than a sample. The gyroscope reports the rate at the sample's end.
#[derive(Debug, Clone)]
pub struct Imu {
    period: f64,
    /// Specific force at rest, in the world's axes.
    gravity: DVec3,
    position: DVec3,
    /// Unit's axes to body's.
    mounting: DQuat,
    gyroscope: Triad,
    accelerometer: Triad,
    last: Option<BodyMotion>,
}

impl Imu {
    /// A unit whose parameters have passed [`ImuParameters::validate`], in a world whose `gravity` (m/s^2) pulls down. `sensor` names its
    /// streams of random numbers.
    pub fn new(parameters: &ImuParameters, gravity: f64, seed: u64, sensor: &str) -> Self {
        let [yaw, pitch, roll] = parameters.mounting;
        let GyroscopeParameters { noise, bias, bias_walk, range, bits } = parameters.gyroscope;
        let walk = bias_walk * parameters.period.sqrt();
        let gyroscope =
            Triad::new([noise, bias, walk], Converter::new(range, bits), seed, &format!("{sensor}/gyroscope"));
        let AccelerometerParameters { noise, bias, bias_walk, range, bits } = parameters.accelerometer;
        let walk = bias_walk * parameters.period.sqrt();
        let purpose = format!("{sensor}/accelerometer");
        let accelerometer = Triad::new([noise, bias, walk], Converter::new(range, bits), seed, &purpose);
        Self {
            period: parameters.period,
            gravity: DVec3::new(0.0, 0.0, gravity),
            position: DVec3::from_array(parameters.position),
            mounting: DQuat::from_euler(EulerRot::ZYX, yaw, pitch, roll),
            gyroscope,
            accelerometer,
            last: None,
        }
    }

    /// The sample that ends now; to be called once a period. The first takes the body as unaccelerated.
    pub fn sample(&mut self, now: BodyMotion) -> ImuSample {
        let before = self.last.replace(now).unwrap_or(now);
        let change = self.velocity(&now) - self.velocity(&before);
        let force = change / self.period + self.gravity;
        let middle = before.orientation.lerp(now.orientation, 0.5) * self.mounting;
        let rate = (now.orientation * self.mounting).inverse() * now.angular_velocity;
        ImuSample {
            angular_velocity: self.gyroscope.measure(rate),
            linear_acceleration: self.accelerometer.measure(middle.inverse() * force),
        }
    }

    /// The biases as they are now, rad/s and m/s^2, in the unit's axes: truth to compare an estimate with.
    pub fn biases(&self) -> (DVec3, DVec3) {
        (self.gyroscope.bias, self.accelerometer.bias)
    }

    /// Of the unit, in the world's axes.
    fn velocity(&self, body: &BodyMotion) -> DVec3 {
        body.linear_velocity + body.angular_velocity.cross(body.orientation * self.position)
    }
}

/// Three axes of one sensor: noise, bias and converter.
#[derive(Debug, Clone)]
struct Triad {
    noise: f64,
    /// Standard deviation of the bias's step in a sample.
    walk: f64,
    bias: DVec3,
    converter: Converter,
    noise_stream: Pcg64,
    bias_stream: Pcg64,
}

impl Triad {
    fn new([noise, bias, walk]: [f64; 3], converter: Converter, seed: u64, purpose: &str) -> Self {
        let noise_stream = streams::stream(seed, &format!("{purpose}/noise"));
        let mut bias_stream = streams::stream(seed, &format!("{purpose}/bias"));
        let bias = bias * normals(&mut bias_stream);
        Self { noise, walk, bias, converter, noise_stream, bias_stream }
    }

    fn measure(&mut self, truth: DVec3) -> DVec3 {
        let value = truth + self.bias + self.noise * normals(&mut self.noise_stream);
        self.bias += self.walk * normals(&mut self.bias_stream);
        DVec3::from_array(value.to_array().map(|axis| self.converter.convert(axis)))
    }
}

fn normals(random: &mut Pcg64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| streams::normal(random)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: f64 = 9.81;

    /// Neither noise nor bias nor rounding, and a range that nothing leaves.
    fn exact() -> ImuParameters {
        ImuParameters {
            gyroscope: GyroscopeParameters { noise: 0.0, bias: 0.0, bias_walk: 0.0, range: 1e6, bits: 0 },
            accelerometer: AccelerometerParameters { noise: 0.0, bias: 0.0, bias_walk: 0.0, range: 1e6, bits: 0 },
            ..ImuParameters::default()
        }
    }

    fn still(orientation: DQuat) -> BodyMotion {
        BodyMotion { orientation, linear_velocity: DVec3::ZERO, angular_velocity: DVec3::ZERO }
    }

    #[test]
    fn gravity_and_rate_are_measured_in_sensor_axes() {
        let mounting = [0.4, -0.3, 0.2];
        let mut imu = Imu::new(&ImuParameters { mounting, ..exact() }, G, 1, "imu");
        let orientation = DQuat::from_euler(EulerRot::ZYX, 1.0, 0.5, -0.7);
        let angular_velocity = DVec3::new(1.0, -2.0, 3.0);
        imu.sample(BodyMotion { angular_velocity, ..still(orientation) });
        let sample = imu.sample(BodyMotion { angular_velocity, ..still(orientation) });
        let [yaw, pitch, roll] = mounting;
        let unit = orientation * DQuat::from_euler(EulerRot::ZYX, yaw, pitch, roll);
        assert!((unit * sample.linear_acceleration).abs_diff_eq(DVec3::new(0.0, 0.0, G), 1e-12));
        assert!((unit * sample.angular_velocity).abs_diff_eq(angular_velocity, 1e-12));
    }

    #[test]
    fn a_falling_body_feels_nothing() {
        let mut imu = Imu::new(&exact(), G, 1, "imu");
        for step in 0..100 {
            let velocity = DVec3::new(0.3, 0.0, -G * f64::from(step) * 1e-3);
            let force =
                imu.sample(BodyMotion { linear_velocity: velocity, ..still(DQuat::IDENTITY) }).linear_acceleration;
            assert!(step == 0 || force.length() < 1e-9, "{force}");
        }
    }

    /// A unit at radius r on a body turning at rate w about an upright axis feels w^2 r inwards, and w about that axis.
    #[test]
    fn the_lever_arm_feels_the_centripetal_acceleration() {
        let (rate, radius) = (20.0, 0.05);
        let parameters = ImuParameters { position: [radius, 0.0, 0.0], mounting: [1.2, 0.0, 0.0], ..exact() };
        let mut imu = Imu::new(&parameters, G, 1, "imu");
        let body = DQuat::from_rotation_z(1.2);
        for step in 0..500 {
            let orientation = DQuat::from_rotation_z(rate * f64::from(step) * 1e-3);
            let angular_velocity = DVec3::new(0.0, 0.0, rate);
            let sample = imu.sample(BodyMotion { angular_velocity, ..still(orientation) });
            let expected = DVec3::new(-rate * rate * radius, 0.0, G);
            // The chord of 0.02 rad is shorter than its arc by 0.02^2 / 24.
            let error = body * sample.linear_acceleration - expected;
            assert!(step == 0 || error.length() < 20.0 * 0.02f64.powi(2) / 23.0, "{step}: {error}");
            assert!((sample.angular_velocity - angular_velocity).length() < 1e-12);
        }
    }

    #[test]
    fn noise_and_bias_have_their_deviations() {
        const SAMPLES: usize = 20_000;
        const UNITS: u64 = 400;
        let parameters = ImuParameters::default();
        let mut imu = Imu::new(&parameters, G, 4, "imu");
        let (gyroscope, accelerometer) = imu.biases();
        let errors = (0..SAMPLES).map(|_| {
            let (rate, force) = imu.biases();
            let sample = imu.sample(still(DQuat::IDENTITY));
            let force = sample.linear_acceleration - force - DVec3::new(0.0, 0.0, G);
            [(sample.angular_velocity - rate).length_squared(), force.length_squared()]
        });
        let [rates, forces] = errors.fold([0.0; 2], |sum, error| [sum[0] + error[0], sum[1] + error[1]]);
        let count = 3.0 * SAMPLES as f64;
        let ratio = |sum: f64, noise: f64, range: f64| {
            // Rounding adds the variance of a uniform distribution over one step of the converter.
            sum / count / (noise.powi(2) + (range / 32_768.0).powi(2) / 12.0)
        };
        let bound = 5.0 * (2.0 / count).sqrt();
        let (rate, force) = (&parameters.gyroscope, &parameters.accelerometer);
        assert!((ratio(rates, rate.noise, rate.range) - 1.0).abs() < bound);
        assert!((ratio(forces, force.noise, force.range) - 1.0).abs() < bound);
        // The walk over 20 s, and the first bias, both over many units.
        let (mut first, mut walked) = (0.0, 0.0);
        for seed in 0..UNITS {
            let mut imu = Imu::new(&parameters, G, seed, "imu");
            let start = imu.biases();
            for _ in 0..50 {
                imu.sample(still(DQuat::IDENTITY));
            }
            first += start.0.length_squared() / rate.bias.powi(2);
            walked += (imu.biases().1 - start.1).length_squared() / (force.bias_walk.powi(2) * 0.05);
        }
        let count = 3.0 * UNITS as f64;
        for sum in [first, walked] {
            assert!((sum / count - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "{}", sum / count);
        }
        assert_ne!((gyroscope, accelerometer), imu.biases());
    }

    #[test]
    fn readings_are_on_the_grid_and_clip() {
        let parameters = ImuParameters::default();
        let mut imu = Imu::new(&parameters, G, 4, "imu");
        let steps = [parameters.gyroscope.range / 32_768.0, parameters.accelerometer.range / 32_768.0];
        for step in 0..200 {
            let velocity = DVec3::new(if step % 2 == 0 { 0.4 } else { 0.0 }, 0.001, 0.0);
            let turning = DVec3::new(50.0, 0.3, -50.0);
            let sample = imu.sample(BodyMotion {
                linear_velocity: velocity,
                angular_velocity: turning,
                ..still(DQuat::IDENTITY)
            });
            for (value, grid) in [(sample.angular_velocity, steps[0]), (sample.linear_acceleration, steps[1])] {
                for axis in (value / grid).to_array() {
                    assert!(
                        (axis - axis.round()).abs() < 1e-6 && (-32_768.0..=32_767.0).contains(&axis.round()),
                        "{axis}"
                    );
                }
            }
            assert_eq!((sample.angular_velocity / steps[0]).round().x, 32_767.0);
            assert_eq!((sample.angular_velocity / steps[0]).round().z, -32_768.0);
            let clipped = (sample.linear_acceleration / steps[1]).round().x;
            assert!(step == 0 || clipped == if step % 2 == 0 { 32_767.0 } else { -32_768.0 }, "{clipped}");
        }
    }

    #[test]
    fn bad_imu_parameters_are_refused() {
        let mut parameters = ImuParameters::default();
        parameters.validate().unwrap();
        parameters.accelerometer.range = 0.0;
        let error = parameters.validate().unwrap_err();
        assert_eq!(error.name, "accelerometer.range");
        let parameters = ImuParameters { mounting: [0.0, f64::NAN, 0.0], ..ImuParameters::default() };
        assert_eq!(parameters.validate().unwrap_err().name, "mounting[1]");
    }
}
