//! Meaning of channels' names: rates and their quantities, axes.

/// Words of rates, and of their quantities; neither distinguishes one channel from another.
const RATES: [&str; 18] = [
    "v",
    "vel",
    "velocity",
    "velocities",
    "rate",
    "rates",
    "speed",
    "twist",
    "linear",
    "angular",
    "dot",
    "d",
    "omega",
    "gyro",
    "gyroscope",
    "w",
    "dt",
    "derivative",
];
const PLACES: [&str; 12] = [
    "pos",
    "position",
    "positions",
    "pose",
    "point",
    "p",
    "angle",
    "angles",
    "orientation",
    "rotation",
    "attitude",
    "joint",
];
/// Words of rates that are those of angles.
const ANGULAR: [&str; 7] = ["omega", "w", "gyro", "gyroscope", "angular", "rate", "rates"];
/// Words of accelerations.
const ACCELERATIONS: [&str; 5] = ["acc", "accel", "acceleration", "accelerometer", "imu"];
/// Words that a letter before makes rates: `vx`, `dyaw`.
const AXES: [&str; 16] = [
    "x", "y", "z", "q", "yaw", "pitch", "roll", "theta", "phi", "psi", "heading", "alpha", "beta", "left", "right", "s",
];
/// Words of angles.
const ANGLES: [&str; 9] = ["yaw", "pitch", "roll", "heading", "theta", "phi", "psi", "angle", "bearing"];

/// Symbols of angles whose rate is called `omega` or `w`.
const TURNS: [&str; 10] = ["yaw", "pitch", "roll", "heading", "theta", "phi", "psi", "bearing", "alpha", "q"];

/// A name in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Words {
    /// Words that remain without those of rates and places, in order.
    pub(crate) rest: Vec<String>,
    /// True if the name is that of a rate.
    pub(crate) rate: bool,
    /// True if the name has the word of an angle's rate: `omega`.
    pub(crate) angular: bool,
    /// True if the name has the word of a place: `pos`.
    pub(crate) place: bool,
    /// True if the name is that of an acceleration.
    pub(crate) acceleration: bool,
    /// True if the name is that of an angle.
    pub(crate) angle: bool,
}

impl Words {
    pub(crate) fn of(name: &str) -> Self {
        let mut words =
            Self { rest: Vec::new(), rate: false, angular: false, place: false, acceleration: false, angle: false };
        for word in split(name) {
            words.acceleration |= ACCELERATIONS.contains(&word.as_str());
            words.angle |= ANGLES.contains(&word.as_str());
            words.angular |= ANGULAR.contains(&word.as_str());
            if RATES.contains(&word.as_str()) {
                words.rate = true;
            } else if PLACES.contains(&word.as_str()) {
                words.place = true;
            } else if let Some(axis) = word.strip_suffix("dot").filter(|axis| AXES.contains(axis)) {
                words.rate = true;
                words.rest.push(axis.to_owned());
            } else if let Some(axis) = word.strip_prefix(['v', 'd']).filter(|axis| AXES.contains(axis)) {
                words.rate = true;
                words.rest.push(axis.to_owned());
            } else if let Some(axis) = word.strip_suffix('d').filter(|axis| AXES.contains(axis)) {
                words.rate = true;
                words.rest.push(axis.to_owned());
            } else {
                words.rest.push(word);
            }
        }
        words
    }

    /// Returns true if the name is that of the other's rate: both have the same words, or `omega` that of `theta`.
    pub(crate) fn is_rate_of(&self, other: &Self) -> bool {
        if !self.rate || other.rate {
            return false;
        }
        if self.rest == other.rest {
            return !self.rest.is_empty() || other.place;
        }
        let is_angle = |word: &&String| TURNS.contains(&word.as_str());
        let one_angle = other.rest.iter().filter(is_angle).count() == 1;
        self.angular && one_angle && other.rest.iter().filter(|word| !is_angle(word)).eq(&self.rest)
    }

    /// The last of x, y and z, and the words without it.
    pub(crate) fn axis(&self) -> Option<(usize, Vec<&str>)> {
        let is_axis = |word: &str| ["x", "y", "z"].iter().position(|axis| *axis == word);
        let (place, axis) = self.rest.iter().enumerate().rev().find_map(|(at, word)| Some((at, is_axis(word)?)))?;
        let others = self.rest.iter().enumerate().filter(|(at, _)| *at != place).map(|(_, word)| word.as_str());
        Some((axis, others.collect()))
    }
}

/// Lower-case words of a name: letters and digits apart, and parts of camel case.
pub fn split(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut before = ' ';
    for letter in name.chars() {
        let begins = !before.is_alphanumeric()
            || before.is_numeric() != letter.is_numeric()
            || before.is_lowercase() && letter.is_uppercase();
        if letter.is_alphanumeric() {
            if begins {
                words.push(String::new());
            }
            if let Some(word) = words.last_mut() {
                word.extend(letter.to_lowercase());
            }
        }
        before = letter;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_known_by_their_names() {
        for (place, rate) in [
            ("x", "vx"),
            ("yaw", "yaw_rate"),
            ("q1", "qd1"),
            ("/odom.pose.pose.position.x", "/odom.twist.twist.linear.x"),
            ("jointPosition[2]", "jointVelocity[2]"),
            ("theta", "thetadot"),
            ("pos", "vel"),
            ("position", "velocity"),
            ("theta", "omega"),
            ("angle", "rate"),
            ("p", "v"),
            ("q1", "w1"),
            ("wheel_theta", "wheel_omega"),
        ] {
            assert!(Words::of(rate).is_rate_of(&Words::of(place)), "{place} {rate}");
            assert!(!Words::of(place).is_rate_of(&Words::of(rate)), "{place} {rate}");
        }
        for (one, other) in [
            ("x", "vy"),
            ("x", "omega"),
            ("left_speed", "right"),
            ("u", "v"),
            ("q1", "qd2"),
            ("u", "omega"),
            ("q1", "w2"),
            ("left_pos", "vel"),
        ] {
            assert!(!Words::of(other).is_rate_of(&Words::of(one)), "{one} {other}");
        }
        assert_eq!(Words::of("imu.accel.y").axis(), Some((1, vec!["imu", "accel"])));
    }
}
