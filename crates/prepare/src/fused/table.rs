//! The columns of the motion of a body and of joints, and their roles in a fit.

use fleetfoot_data::Column;
use fleetfoot_dataset::Error;
use fleetfoot_output::{WriteColumn, WriteKind};
use fleetfoot_recipe::{AttitudeForm, Derivative, Frame, Kind, Recipe, State};
use fleetfoot_signal::fuse::BodyState;
use fleetfoot_task::rate_unit;

use super::{
    super::{TIMES, columns::quoted, write::unique},
    joints::JointPlan,
    sensors::Sensors,
};

/// Position, velocity, attitude as quaternion and as roll, pitch and yaw (R = Rz Ry Rx), rate in the body, acceleration in the world, biases.
const STATES: [(&str, &str); 25] = [
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
    ("vx", "m/s"),
    ("vy", "m/s"),
    ("vz", "m/s"),
    ("qx", ""),
    ("qy", ""),
    ("qz", ""),
    ("qw", ""),
    ("roll", "rad"),
    ("pitch", "rad"),
    ("yaw", "rad"),
    ("wx", "rad/s"),
    ("wy", "rad/s"),
    ("wz", "rad/s"),
    ("ax", "m/s^2"),
    ("ay", "m/s^2"),
    ("az", "m/s^2"),
    ("gyro_bias_x", "rad/s"),
    ("gyro_bias_y", "rad/s"),
    ("gyro_bias_z", "rad/s"),
    ("accelerometer_bias_x", "m/s^2"),
    ("accelerometer_bias_y", "m/s^2"),
    ("accelerometer_bias_z", "m/s^2"),
];

/// States with written standard deviations, in the order of the state; those of the attitude are about the axes of the body.
const DEVIATIONS: [&str; 15] = [
    "attitude_x",
    "attitude_y",
    "attitude_z",
    "x",
    "y",
    "z",
    "vx",
    "vy",
    "vz",
    "gyro_bias_x",
    "gyro_bias_y",
    "gyro_bias_z",
    "accelerometer_bias_x",
    "accelerometer_bias_y",
    "accelerometer_bias_z",
];

/// Those of rates.
const RATES: [&str; 3] = ["wx", "wy", "wz"];

/// Those of accelerations. Of a body of which no force is measured they stand in place of those of the accelerometer's bias.
const ACCELERATIONS: [&str; 3] = ["ax", "ay", "az"];

/// The state that is the attitude as a rotation.
const ATTITUDE: &str = "attitude";

/// Columns of [`STATES`] that such a body has.
const WITHOUT_FORCES: usize = 22;

/// A joint's columns.
struct JointColumns {
    names: [String; 3],
    unit: Option<String>,
    angle: bool,
}

/// Columns that are written.
pub(super) struct Columns {
    pub(super) write: Vec<WriteColumn>,
    /// Form of the body's attitude, if it has one.
    attitude: Option<AttitudeForm>,
    joints: Vec<JointColumns>,
}

impl Columns {
    /// Columns of a body, with its attitude as a state in the form of `attitude`; columns of joints; and the extra
    /// columns.
    pub(super) fn new(
        body: Option<&Sensors>,
        attitude: AttitudeForm,
        joints: &[JointPlan],
        along: &[Column],
    ) -> Result<Self, Error> {
        let is_taken = |name: &str| name == ATTITUDE && body.is_some() && attitude == AttitudeForm::Quaternion;
        if joints.iter().any(|column| is_taken(&column.name)) || along.iter().any(|column| is_taken(&column.name)) {
            return Err(Error::conflict(format!(
                "a state, an input or a joint has the name `{ATTITUDE}` of the rotation of [body]: give it another name"
            )));
        }
        let is_free = |time: &&&str| {
            along.iter().all(|column| column.name != **time) && joints.iter().all(|column| column.name != **time)
        };
        let time = TIMES.iter().find(is_free).copied().unwrap_or(TIMES[0]);
        let column = |name: String, unit: &str| {
            let plain = WriteColumn::new(name, WriteKind::Float);
            if unit.is_empty() { plain } else { plain.with_unit(unit) }
        };
        let mut write = vec![WriteColumn::new(time, WriteKind::Stamp)];
        if let Some(sensors) = body {
            let states = if sensors.has_forces() { &STATES[..] } else { &STATES[..WITHOUT_FORCES] };
            write.extend(states.iter().map(|(name, unit)| column((*name).to_owned(), unit)));
            // An angle where the state itself is a quaternion.
            let unit_of = |name: &str| STATES.iter().find(|(state, _)| *state == name).map_or("rad", |(_, unit)| unit);
            let biases = if sensors.has_forces() { &DEVIATIONS[12..] } else { &[] };
            let deviations = DEVIATIONS[..12].iter().chain(biases).chain(&ACCELERATIONS).chain(&RATES);
            write.extend(deviations.map(|name| column(format!("{name}_deviation"), unit_of(name))));
        }
        let joints: Vec<JointColumns> = joints
            .iter()
            .map(|joint| JointColumns {
                names: ["", "_dot", "_ddot"].map(|suffix| format!("{}{suffix}", joint.name)),
                unit: joint.unit.clone(),
                angle: joint.angle,
            })
            .collect();
        for joint in &joints {
            let rate = joint.unit.as_deref().map(rate_unit);
            let units =
                [joint.unit.clone(), rate.clone(), rate.as_deref().map(rate_unit)].map(Option::unwrap_or_default);
            write.extend(joint.names.iter().zip(&units).map(|(name, unit)| column(name.clone(), unit)));
            write.extend(joint.names.iter().zip(&units).map(|(name, unit)| column(format!("{name}_deviation"), unit)));
        }
        write.extend(
            along.iter().map(|planned| column(planned.name.clone(), planned.unit.as_deref().unwrap_or_default())),
        );
        let write = unique(write, "a state, an input or a joint has the name of another column")?;
        Ok(Self { write, attitude: body.map(|_| attitude), joints })
    }

    /// The name of the stamps.
    pub(super) fn time(&self) -> &str {
        self.write.first().map_or(TIMES[0], |column| &column.name)
    }

    /// The recipe with the states of body and joints before those that go along.
    pub(super) fn recipe(&self, mut recipe: Recipe) -> Recipe {
        let along = std::mem::take(&mut recipe.states);
        if let Some(attitude) = self.attitude {
            body_states(&mut recipe, attitude);
        }
        for joint in &self.joints {
            let [position, rate, acceleration] = &joint.names;
            let kind = joint.angle.then_some(Kind::Angle);
            let known = Some(quoted(rate));
            recipe.states.insert(position.clone(), State { known, kind, unit: joint.unit.clone(), ..State::default() });
            let derivative = Some(Derivative::Text(quoted(acceleration)));
            recipe.states.insert(rate.clone(), State { derivative, ..State::default() });
        }
        recipe.states.extend(along);
        recipe
    }
}

/// The states of a body: position, velocity with measured accelerations, the attitude with its kinematics, and rates.
fn body_states(recipe: &mut Recipe, attitude: AttitudeForm) {
    for axis in ["x", "y", "z"] {
        recipe.states.insert(axis.into(), State { regressor: Some(false), ..known(&format!("v{axis}")) });
    }
    for axis in ["x", "y", "z"] {
        let derivative = Some(Derivative::Text(format!("a{axis}")));
        recipe.states.insert(format!("v{axis}"), State { derivative, ..State::default() });
    }
    match attitude {
        AttitudeForm::Euler => {
            for (name, text) in [
                ("roll", "wx + tan(pitch)*(sin(roll)*wy + cos(roll)*wz)"),
                ("pitch", "cos(roll)*wy - sin(roll)*wz"),
                ("yaw", "(sin(roll)*wy + cos(roll)*wz)/cos(pitch)"),
            ] {
                recipe.states.insert(name.into(), State { kind: Some(Kind::Angle), ..known(text) });
            }
        }
        AttitudeForm::Quaternion => {
            let names = |names: &[&str]| Some(names.iter().map(|name| (*name).to_owned()).collect());
            let rotation = State {
                kind: Some(Kind::Quaternion),
                columns: names(&["qw", "qx", "qy", "qz"]),
                order: Some("wxyz".into()),
                rate: names(&RATES),
                frame: Some(Frame::Body),
                ..State::default()
            };
            recipe.states.insert(ATTITUDE.into(), rotation);
        }
    }
    for axis in ["x", "y", "z"] {
        recipe.states.insert(format!("w{axis}"), State::default());
    }
}

/// A state whose equation is given.
fn known(text: &str) -> State {
    State { known: Some(text.to_owned()), ..State::default() }
}

/// Largest pitch of a body's nose, up or down, rad.
pub(super) fn steepest(states: &[BodyState]) -> f64 {
    states.iter().map(|state| angles(state.attitude)[1].abs()).fold(0.0, f64::max)
}

/// Roll, pitch and yaw of a quaternion x, y, z, w.
fn angles([x, y, z, w]: [f64; 4]) -> [f64; 3] {
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw]
}

/// States as columns, in the order of [`Columns`] without stamps and extra columns.
pub(super) fn values(states: &[BodyState], has_forces: bool) -> Vec<Vec<f64>> {
    let biases = if has_forces { 3 } else { 0 };
    let row = |state: &BodyState| {
        let parts: [&[f64]; 11] = [
            &state.position,
            &state.velocity,
            &state.attitude,
            &angles(state.attitude),
            &state.rate,
            &state.acceleration,
            &state.gyro_bias,
            &state.accelerometer_bias[..biases],
            &state.deviations[..12 + biases],
            &state.acceleration_deviations,
            &state.rate_deviations,
        ];
        parts.concat()
    };
    let rows: Vec<Vec<f64>> = states.iter().map(row).collect();
    let width = WITHOUT_FORCES + biases + 12 + biases + ACCELERATIONS.len() + RATES.len();
    (0..width).map(|column| rows.iter().map(|row| row[column]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rz Ry Rx of half angles, multiplied out.
    #[test]
    fn angles_of_a_quaternion() {
        let [roll, pitch, yaw] = [0.3_f64, -1.1, 2.5];
        let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| (0.5 * angle).sin_cos());
        let quaternion = [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ];
        let computed = angles(quaternion);
        assert!(computed.iter().zip([roll, pitch, yaw]).all(|(a, b)| (a - b).abs() < 1e-12), "{computed:?}");
    }
}
