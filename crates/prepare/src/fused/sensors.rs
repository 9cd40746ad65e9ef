//! The sensors of a recipe, checked once: their channels, and their known constants.

use fleetfoot_dataset::Error;
use fleetfoot_recipe::{Gravity, Mounting, Recipe, SensorKind, SensorSection, Tunable};
use fleetfoot_signal::{
    Loss,
    fuse::{FuseOptions, Prior},
};

/// Largest deviation from the given stamps in the search for a delay, s: clocks that are further apart need `[clocks]`
/// first.
pub(super) const DELAY: f64 = 0.02;

/// Sensors that make a body.
pub(super) struct Sensors {
    /// Three channels of angular rate, and three of specific force where there is an accelerometer.
    pub(super) readings: Vec<String>,
    /// Position and quaternion x, y, z, w.
    pub(super) poses: Vec<String>,
    /// Seconds before their stamps over which rates and forces are means.
    pub(super) averages: [f64; 2],
    /// The same of poses.
    pub(super) pose_average: f64,
    pub(super) options: FuseOptions,
}

pub(super) fn refused(name: &str, what: &str, allowed: &str) -> Error {
    Error::value(format!("[sensor.{name}] {what}: {allowed}"))
}

/// `N` numbers.
pub(super) fn numbers<const N: usize>(name: &str, what: &str, values: &[f64]) -> Result<[f64; N], Error> {
    let allowed = format!("write {N} finite numbers");
    let numbers: [f64; N] = values.try_into().map_err(|_| refused(name, what, &allowed))?;
    if numbers.iter().all(|value| value.is_finite()) { Ok(numbers) } else { Err(refused(name, what, &allowed)) }
}

/// Numbers that are given, or found from nothing.
fn prior<const N: usize>(
    name: &str,
    what: &str,
    given: Option<&Mounting>,
    otherwise: [f64; N],
) -> Result<Prior<[f64; N]>, Error> {
    match given {
        None => Ok(otherwise.into()),
        Some(Mounting::Given(values)) => Ok(numbers(name, what, values)?.into()),
        Some(Mounting::Word(word)) if word == "auto" => Ok(Prior { value: otherwise, deviation: f64::INFINITY }),
        Some(Mounting::Word(word)) => {
            Err(refused(name, &format!("{what} = {word:?}"), &format!("write {N} numbers, or \"auto\"")))
        }
    }
}

/// Number of channels of a sensor.
pub(super) fn channels(kind: SensorKind) -> usize {
    match kind {
        SensorKind::Pose => 7,
        SensorKind::Imu => 6,
        SensorKind::Gyro | SensorKind::Accelerometer => 3,
        SensorKind::Position | SensorKind::Rate => 1,
    }
}

/// A number of seconds, 0 by default.
pub(super) fn seconds(name: &str, what: &str, given: Option<f64>) -> Result<f64, Error> {
    let seconds = given.unwrap_or(0.0);
    match seconds >= 0.0 && seconds.is_finite() {
        true => Ok(seconds),
        false => Err(refused(name, &format!("{what} = {seconds}"), "write seconds, zero or more")),
    }
}

/// Loss of the residuals: `huber` or `student` of a section.
pub(super) fn loss(place: &str, huber: Option<f64>, student: Option<f64>) -> Result<Loss, Error> {
    match (huber, student) {
        (Some(_), Some(_)) => {
            Err(Error::conflict(format!("{place}: huber and student exclude each other; write one of them")))
        }
        (Some(threshold), None) => Ok(Loss::Huber(threshold)),
        (None, Some(freedom)) => Ok(Loss::Student(freedom)),
        (None, None) => Ok(Loss::default()),
    }
}

impl Sensors {
    /// Reads `[body]` and `[sensor.NAME]`.
    pub(super) fn new(recipe: &Recipe) -> Result<Self, Error> {
        let mut sensors = Self {
            readings: Vec::new(),
            poses: Vec::new(),
            averages: [0.0; 2],
            pose_average: 0.0,
            options: FuseOptions { fit_walks: [true; 2], ..FuseOptions::default() },
        };
        let (mut forces, mut silent) = (Vec::new(), false);
        for (name, sensor) in recipe.sensor.iter().filter(|(_, sensor)| !sensor.kind.is_of_joint()) {
            let channels = channels(sensor.kind);
            if sensor.channels.len() != channels {
                let count = sensor.channels.len();
                return Err(refused(
                    name,
                    &format!("channels has {count}"),
                    &format!("write {channels}, as many as this kind of sensor has"),
                ));
            }
            let (rate, force) = sensor.channels.split_at(channels.min(3));
            let (room, channels) = match sensor.kind {
                SensorKind::Pose => (&mut sensors.poses, &sensor.channels[..]),
                SensorKind::Imu => {
                    if !forces.is_empty() {
                        return Err(refused(
                            name,
                            "kind",
                            "another sensor measures the specific force too; remove one of them",
                        ));
                    }
                    forces = force.to_vec();
                    (&mut sensors.readings, rate)
                }
                SensorKind::Gyro => (&mut sensors.readings, rate),
                SensorKind::Accelerometer => (&mut forces, rate),
                SensorKind::Position | SensorKind::Rate => continue,
            };
            if !room.is_empty() {
                return Err(refused(
                    name,
                    "kind",
                    "another sensor measures the same quantity, and only one is fused; remove one of them",
                ));
            }
            room.extend_from_slice(channels);
            sensors.read(name, sensor)?;
            silent |= sensor.noise.is_none();
        }
        for (room, what) in [
            (&sensors.readings, "angular rate (kind = \"imu\" or \"gyro\")"),
            (&sensors.poses, "pose (kind = \"pose\")"),
        ] {
            if room.is_empty() {
                return Err(Error::missing(format!(
                    "[body] needs poses and a gyroscope, best with an accelerometer: name a [sensor.NAME] of its {what}"
                )));
            }
        }
        sensors.readings.append(&mut forces);
        let alone = sensors.readings.len() == 3;
        sensors.body(recipe)?;
        sensors.options.fit_noise = silent || (alone && recipe.body.as_ref().is_none_or(|body| body.jerk.is_none()));
        Ok(sensors)
    }

    /// Returns true if there is an accelerometer.
    pub(super) fn has_forces(&self) -> bool {
        self.readings.len() > 3
    }

    fn body(&mut self, recipe: &Recipe) -> Result<(), Error> {
        let body = recipe.body.clone().unwrap_or_default();
        let options = &mut self.options;
        options.gravity = match body.gravity {
            None => Prior { value: [0.0, 0.0, -9.806_65], deviation: f64::INFINITY },
            Some(Gravity::Size(size)) if size > 0.0 && size.is_finite() => {
                Prior { value: [0.0, 0.0, -size], deviation: f64::INFINITY }
            }
            Some(Gravity::Size(size)) => {
                return Err(Error::value(format!(
                    "[body] gravity = {size}: write its size in m/s^2, or its three components in the world"
                )));
            }
            Some(Gravity::Components(components)) => components.into(),
        };
        options.loss = loss("[body]", body.huber, body.student)?;
        options.noise.jerk = body.jerk.unwrap_or(options.noise.jerk);
        options.gate = body.gate.unwrap_or(options.gate);
        options.estimate = body.estimate.map_or(options.estimate, Into::into);
        Ok(())
    }

    /// Reads the settings of a section beside its channels.
    fn read(&mut self, name: &str, sensor: &SensorSection) -> Result<(), Error> {
        let (options, is_pose) = (&mut self.options, sensor.kind == SensorKind::Pose);
        if !is_pose && (sensor.lever.is_some() || sensor.mounting.is_some() || sensor.delay.is_some()) {
            return Err(refused(
                name,
                "lever, mounting, delay",
                "only poses have these, as the inertial sensor defines the body's frame and clock; remove them",
            ));
        }
        if is_pose && sensor.walk.is_some() {
            return Err(refused(name, "walk", "poses have no bias; remove it"));
        }
        if sensor.resolution.is_some() || sensor.bias.is_some() {
            return Err(refused(name, "resolution, bias", "only sensors of a joint have these; remove them"));
        }
        let average = seconds(name, "average", sensor.average)?;
        match sensor.kind {
            SensorKind::Pose => self.pose_average = average,
            SensorKind::Imu => self.averages = [average; 2],
            SensorKind::Gyro => self.averages[0] = average,
            _ => self.averages[1] = average,
        }
        let imu = &mut options.noise.imu;
        let (noise, walk) = (sensor.noise.as_deref(), sensor.walk.as_deref());
        match sensor.kind {
            SensorKind::Pose => {
                if let Some(noise) = noise {
                    [options.noise.position, options.noise.attitude] = numbers(name, "noise", noise)?;
                }
                options.lever = prior(name, "lever", sensor.lever.as_ref(), [0.0; 3])?;
                options.mounting = prior(name, "mounting", sensor.mounting.as_ref(), [0.0, 0.0, 0.0, 1.0])?;
                options.offset = match &sensor.delay {
                    None => 0.0.into(),
                    Some(Tunable::Number(delay)) => (-delay).into(),
                    Some(Tunable::Word(word)) if word == "auto" => Prior { value: 0.0, deviation: DELAY },
                    Some(Tunable::Word(word)) => {
                        return Err(refused(name, &format!("delay = {word:?}"), "write seconds, or \"auto\""));
                    }
                };
            }
            SensorKind::Imu => {
                if let Some(noise) = noise {
                    let [gyro, accelerometer] = numbers(name, "noise", noise)?;
                    (imu.gyro, imu.accelerometer) = ([gyro; 3], [accelerometer; 3]);
                }
                if let Some(walk) = walk {
                    [imu.gyro_walk, imu.accelerometer_walk] = numbers(name, "walk", walk)?;
                    options.fit_walks = [false; 2];
                }
            }
            SensorKind::Gyro => {
                if let Some(noise) = noise {
                    let [gyro] = numbers(name, "noise", noise)?;
                    imu.gyro = [gyro; 3];
                }
                if let Some(walk) = walk {
                    [imu.gyro_walk] = numbers(name, "walk", walk)?;
                    options.fit_walks[0] = false;
                }
            }
            SensorKind::Accelerometer => {
                if let Some(noise) = noise {
                    let [accelerometer] = numbers(name, "noise", noise)?;
                    imu.accelerometer = [accelerometer; 3];
                }
                if let Some(walk) = walk {
                    [imu.accelerometer_walk] = numbers(name, "walk", walk)?;
                    options.fit_walks[1] = false;
                }
            }
            SensorKind::Position | SensorKind::Rate => {}
        }
        Ok(())
    }
}
