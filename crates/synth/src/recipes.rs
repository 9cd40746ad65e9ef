//! Recipe of each robot's logs, which is written beside them.

use std::fmt::{self, Write};

use fleetfoot_data::Column;
use fleetfoot_fit::Error;
use fleetfoot_recipe::Recipe;

use super::{Format, parquet_sink::TIME, world_file::comment};

/// Details of a state's equation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Details {
    /// Its derivative is fitted, and measured by differences.
    Fitted,
    /// Its derivative is measured by this column, and is this expression over columns and latents.
    Equation(&'static str, &'static str),
    /// Its derivative is this expression.
    Known(&'static str),
    /// An angle with this derivative.
    KnownAngle(&'static str),
    /// Its derivative is this expression, and nothing depends on it.
    Integrated(&'static str),
    /// An angle with this derivative, on which nothing depends.
    IntegratedAngle(&'static str),
}

impl fmt::Display for Details {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fitted => write!(f, "{{}}"),
            Self::Equation(column, right) => write!(f, "{{ derivative = \"{column}\", equation = \"{right}\" }}"),
            Self::Known(rate) => write!(f, "{{ known = \"{rate}\" }}"),
            Self::KnownAngle(rate) => write!(f, "{{ known = \"{rate}\", kind = \"angle\" }}"),
            Self::Integrated(rate) => write!(f, "{{ known = \"{rate}\", regressor = false }}"),
            Self::IntegratedAngle(rate) => {
                write!(f, "{{ known = \"{rate}\", kind = \"angle\", regressor = false }}")
            }
        }
    }
}

/// The parts of a robot's recipe, by the names of its columns of truth.
pub(super) struct RecipeParts {
    /// Description of the model, for the reader of the recipe.
    pub(super) about: &'static str,
    /// Fields of the messages that stand for columns of the rows of truth: name, field or expression. Later ones may
    /// use earlier ones.
    pub(super) fields: &'static [(&'static str, &'static str)],
    /// Expressions that both formats need, over fields and earlier ones.
    pub(super) aliases: &'static [(&'static str, &'static str)],
    /// States that the model advances in time.
    pub(super) states: &'static [(&'static str, Details)],
    /// Inputs from outside.
    pub(super) inputs: &'static [&'static str],
    /// The topic whose messages make the rows.
    pub(super) base: &'static str,
    /// The clock on which all messages of the truth agree: `header`, or `log` where they have no headers.
    pub(super) stamp: &'static str,
    /// Columns that partitions may have.
    pub(super) partition_on: &'static [&'static str],
    /// Sections of a structured sparse regression, where the robot has one.
    pub(super) sparse: &'static str,
}

impl RecipeParts {
    /// The recipe for logs of a format. `command` made them, `truth` are its columns, with the units that messages
    /// lack.
    pub(super) fn text(&self, format: Format, command: &str, truth: &[Column]) -> String {
        let mut out = String::new();
        comment(&mut out, &format!("Recipe for the truth in the logs of: {command}"));
        comment(&mut out, self.about);
        let _ =
            writeln!(out, "#   fleetfoot fit pwa -c THIS FILES... --partition null,average,kmeans:10 -o model.json");
        if !self.sparse.is_empty() {
            let _ = writeln!(out, "#   fleetfoot fit sparse -c THIS FILES... -o sparse.json");
        }
        out.push('\n');
        let columns: Vec<_> = match format {
            Format::Mcap => self.fields.iter().chain(self.aliases).collect(),
            Format::Parquet => self.aliases.iter().collect(),
        };
        if !columns.is_empty() {
            let _ = writeln!(out, "# Short names for fields of the log, and expressions over them.\n[columns]");
            out.extend(columns.iter().map(|(name, field)| format!("{name} = {}\n", text(field))));
            out.push('\n');
        }
        comment(
            &mut out,
            "What the model advances in time. A known derivative is integrated, the others are fitted; what is no regressor is not seen by the library and the partition.",
        );
        let _ = writeln!(out, "[states]");
        let unit = |name: &str| match format {
            Format::Mcap => truth.iter().find(|column| column.name == name)?.unit.as_deref(),
            Format::Parquet => None,
        };
        out.extend(self.states.iter().map(|(name, details)| format!("{name} = {}\n", with_unit(details, unit(name)))));
        let _ = writeln!(out, "\n# What is given from outside.\n[inputs]");
        out.extend(self.inputs.iter().map(|name| format!("{name} = {}\n", text(name))));
        let _ = writeln!(out, "\n[time]");
        let _ = match format {
            Format::Mcap => {
                writeln!(
                    out,
                    "stamp = {}\nbase = {}    # its messages make the rows",
                    text(self.stamp),
                    text(self.base)
                )
            }
            Format::Parquet => writeln!(out, "column = {}", text(TIME)),
        };
        let _ = writeln!(
            out,
            "\n[model]\npartition = \"null,average\"   # also zscore:1.5, kmeans:10, kmeans:2,5,10,20,50"
        );
        if !self.partition_on.is_empty() {
            let names: Vec<String> = self.partition_on.iter().map(|name| text(name)).collect();
            let _ = writeln!(out, "partition_on = [{}]", names.join(", "));
        }
        out.push_str(self.sparse);
        out
    }

    /// The recipe for logs of a format.
    pub(super) fn recipe(&self, format: Format) -> Result<Recipe, Error> {
        Ok(Recipe::parse(&self.text(format, "", &[]), "recipe of the generated logs")?)
    }
}

/// The inline table of a state, its unit included.
fn with_unit(details: &Details, unit: Option<&str>) -> String {
    let table = details.to_string();
    match (unit, table.trim_end_matches('}').trim_end()) {
        (None, _) => table,
        (Some(unit), "{") => format!("{{ unit = {} }}", text(unit)),
        (Some(unit), rest) => format!("{rest}, unit = {} }}", text(unit)),
    }
}

/// A TOML string.
fn text(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Velocities along and about a body's axes to rates of its place and its Z-Y'-X'' angles.
const RATES: [&str; 6] = [
    "vx*cos(yaw)*cos(pitch) + vy*(cos(yaw)*sin(pitch)*sin(roll) - sin(yaw)*cos(roll)) + vz*(cos(yaw)*sin(pitch)*cos(roll) + sin(yaw)*sin(roll))",
    "vx*sin(yaw)*cos(pitch) + vy*(sin(yaw)*sin(pitch)*sin(roll) + cos(yaw)*cos(roll)) + vz*(sin(yaw)*sin(pitch)*cos(roll) - cos(yaw)*sin(roll))",
    "vz*cos(pitch)*cos(roll) + vy*cos(pitch)*sin(roll) - vx*sin(pitch)",
    "(wy*sin(roll) + wz*cos(roll))/cos(pitch)",
    "wy*cos(roll) - wz*sin(roll)",
    "wx + (wy*sin(roll) + wz*cos(roll))*sin(pitch)/cos(pitch)",
];

/// The hexapod on its treadmill: equations (3) and (4) of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot*.
pub(super) const HEXAPOD: RecipeParts = RecipeParts {
    about: "A hexapod on a treadmill: place and angles follow from the velocities along and about the trunk's axes; how these and the cranks' rates change is fitted.",
    fields: &[
        ("x", "/truth/odometry.pose.pose.position.x"),
        ("y", "/truth/odometry.pose.pose.position.y"),
        ("z", "/truth/odometry.pose.pose.position.z"),
        ("yaw", "yaw(/truth/odometry.pose.pose.orientation)"),
        ("pitch", "pitch(/truth/odometry.pose.pose.orientation)"),
        ("roll", "roll(/truth/odometry.pose.pose.orientation)"),
        ("alpha_l", "/truth/cranks.position[left_crank]"),
        ("alpha_r", "/truth/cranks.position[right_crank]"),
        ("vx", "/truth/odometry.twist.twist.linear.x"),
        ("vy", "/truth/odometry.twist.twist.linear.y"),
        ("vz", "/truth/odometry.twist.twist.linear.z"),
        ("wx", "/truth/odometry.twist.twist.angular.x"),
        ("wy", "/truth/odometry.twist.twist.angular.y"),
        ("wz", "/truth/odometry.twist.twist.angular.z"),
        ("alpha_l_rate", "/truth/cranks.velocity[left_crank]"),
        ("alpha_r_rate", "/truth/cranks.velocity[right_crank]"),
        ("u_v", "/truth/cmd_vel.twist.linear.x"),
        ("u_w", "/truth/cmd_vel.twist.angular.z"),
        ("belt_speed", "/truth/belt.velocity[belt]"),
    ],
    aliases: &[],
    states: &[
        ("x", Details::Integrated(RATES[0])),
        ("y", Details::Integrated(RATES[1])),
        ("z", Details::Known(RATES[2])),
        ("yaw", Details::KnownAngle(RATES[3])),
        ("pitch", Details::Known(RATES[4])),
        ("roll", Details::Known(RATES[5])),
        ("alpha_l", Details::KnownAngle("alpha_l_rate")),
        ("alpha_r", Details::KnownAngle("alpha_r_rate")),
        ("vx", Details::Fitted),
        ("vy", Details::Fitted),
        ("vz", Details::Fitted),
        ("wx", Details::Fitted),
        ("wy", Details::Fitted),
        ("wz", Details::Fitted),
        ("alpha_l_rate", Details::Fitted),
        ("alpha_r_rate", Details::Fitted),
    ],
    inputs: &["u_v", "u_w"],
    base: "/truth/odometry",
    stamp: "header",
    partition_on: &[],
    sparse: "",
};

/// The climbing jet: equations (26) to (29) of the block-sparse bolasso paper, whose derivatives the truth has.
pub(super) const AIRCRAFT: RecipeParts = RecipeParts {
    about: "A climbing jet: altitude follows from speed and path angle; how these and the mass change is fitted.",
    fields: &[
        ("h", "/truth/aircraft.data[0]"),
        ("V", "/truth/aircraft.data[1]"),
        ("gamma", "/truth/aircraft.data[2]"),
        ("m", "/truth/aircraft.data[3]"),
        ("alpha", "/truth/aircraft.data[4]"),
        ("N1", "/truth/aircraft.data[5]"),
        ("SAT", "/truth/aircraft.data[6]"),
        ("V_dot", "/truth/aircraft.data[11]"),
        ("gamma_dot", "/truth/aircraft.data[12]"),
        ("m_dot", "/truth/aircraft.data[13]"),
    ],
    // Pressure follows altitude (ISO 2533), and the temperature is the day's: written so, a simulation computes density, Mach number and dynamic pressure from
    // its own states. The log has them too, but of the flight that was recorded.
    aliases: &[
        ("p", "101325*exp(5.255877*log(1 - 0.0065*min(h, 11000)/288.15) - 9.80665*max(h - 11000, 0)/(287.053*216.65))"),
        ("rho", "p/(287.053*SAT)"),
        ("M", "V/sqrt(1.4*287.053*SAT)"),
        ("q", "0.5*rho*V^2"),
        ("Isp_model", "35304/((0.334 + 0.44*M)*sqrt(SAT/288.15))"),
    ],
    states: &[
        ("h", Details::Known("V*sin(gamma)")),
        ("V", Details::Equation("V_dot", "(T*cos(alpha) - D)/m - 9.80665*sin(gamma)")),
        ("gamma", Details::Equation("gamma_dot", "(T*sin(alpha) + L)/(m*V) - 9.80665*cos(gamma)/V")),
        ("m", Details::Equation("m_dot", "-T/Isp")),
    ],
    inputs: &["alpha", "N1"],
    base: "/truth/aircraft",
    stamp: "log",
    partition_on: &[],
    sparse: AIRCRAFT_SPARSE,
};

/// Equations (31) to (34), the libraries of section 8.2, and the prior of equation (41).
const AIRCRAFT_SPARSE: &str = r#"
# For `fit sparse`: thrust, drag, lift and specific impulse are unknown functions that the equations share. Each may be any sum of its
# candidates: what stands in `times`, times the monomials of the variables up to a degree. Without a prior, thrust and impulse can be scaled together.
[latents]
T = { times = "N1", of = ["rho", "M"], degree = 4 }
D = { times = "q", of = ["alpha", "M"], degree = 3 }
L = { times = "q", of = ["alpha", "M"], degree = 3 }
Isp = { times = "SAT", of = ["h", "M"], degree = 3, prior = "Isp_model", prior_strength = 10.0 }

# What is regressed on them: forces along and across the path, and what the fuel gives.
[tasks]
along = { target = "m*V_dot + m*9.80665*sin(gamma)", right = "T*cos(alpha) - D" }
normal = { target = "m*V*gamma_dot + m*9.80665*cos(gamma)", right = "T*sin(alpha) + L" }
fuel = { target = "0", right = "T + m_dot*Isp", scale = 1e4 }
"#;

/// The wheeled robot: where it is follows from the velocities in the axes of its heading.
pub(super) const DIFFDRIVE: RecipeParts = RecipeParts {
    about: "A wheeled robot with two motors: where it is follows from its velocities; how these and the wheels' rates answer to the commands is fitted.",
    fields: &[
        ("x", "/truth/odometry.pose.pose.position.x"),
        ("y", "/truth/odometry.pose.pose.position.y"),
        ("yaw", "yaw(/truth/odometry.pose.pose.orientation)"),
        // Messages have the axes of the chassis, which pitches a little; the rows and the model have those of the heading.
        ("x_rate", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.linear).x"),
        ("y_rate", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.linear).y"),
        ("v", "x_rate*cos(yaw) + y_rate*sin(yaw)"),
        ("vy", "y_rate*cos(yaw) - x_rate*sin(yaw)"),
        ("w", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.angular).z"),
        ("left_rate", "/truth/wheels.velocity[left_wheel_joint]"),
        ("right_rate", "/truth/wheels.velocity[right_wheel_joint]"),
        ("v_command", "/truth/cmd_vel.twist.linear.x"),
        ("w_command", "/truth/cmd_vel.twist.angular.z"),
        ("left_voltage", "/truth/voltage.data[0]"),
        ("right_voltage", "/truth/voltage.data[1]"),
    ],
    aliases: &[],
    states: &[
        ("x", Details::Integrated("v*cos(yaw) - vy*sin(yaw)")),
        ("y", Details::Integrated("v*sin(yaw) + vy*cos(yaw)")),
        ("yaw", Details::IntegratedAngle("w")),
        ("v", Details::Fitted),
        ("vy", Details::Fitted),
        ("w", Details::Fitted),
        ("left_rate", Details::Fitted),
        ("right_rate", Details::Fitted),
    ],
    inputs: &["v_command", "w_command"],
    base: "/truth/odometry",
    stamp: "header",
    partition_on: &[],
    sparse: "",
};

/// The quadrotor in wind: velocities in the world's axes, rates in its own.
pub(super) const QUADROTOR: RecipeParts = RecipeParts {
    about: "A quadrotor in wind: place and angles follow from velocities and rates; how these and the rotors' speeds change is fitted.",
    fields: &[
        ("x", "/truth/odometry.pose.pose.position.x"),
        ("y", "/truth/odometry.pose.pose.position.y"),
        ("z", "/truth/odometry.pose.pose.position.z"),
        ("vx", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.linear).x"),
        ("vy", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.linear).y"),
        ("vz", "rotate(/truth/odometry.pose.pose.orientation, /truth/odometry.twist.twist.linear).z"),
        ("yaw", "yaw(/truth/odometry.pose.pose.orientation)"),
        ("pitch", "pitch(/truth/odometry.pose.pose.orientation)"),
        ("roll", "roll(/truth/odometry.pose.pose.orientation)"),
        ("wx", "/truth/odometry.twist.twist.angular.x"),
        ("wy", "/truth/odometry.twist.twist.angular.y"),
        ("wz", "/truth/odometry.twist.twist.angular.z"),
        ("rotor_1", "/truth/rotors.data[0]"),
        ("rotor_2", "/truth/rotors.data[1]"),
        ("rotor_3", "/truth/rotors.data[2]"),
        ("rotor_4", "/truth/rotors.data[3]"),
        ("u_1", "/truth/command.data[0]"),
        ("u_2", "/truth/command.data[1]"),
        ("u_3", "/truth/command.data[2]"),
        ("u_4", "/truth/command.data[3]"),
    ],
    aliases: &[],
    states: &[
        ("x", Details::Integrated("vx")),
        ("y", Details::Integrated("vy")),
        ("z", Details::Integrated("vz")),
        ("vx", Details::Fitted),
        ("vy", Details::Fitted),
        ("vz", Details::Fitted),
        ("yaw", Details::KnownAngle(RATES[3])),
        ("pitch", Details::Known(RATES[4])),
        ("roll", Details::Known(RATES[5])),
        ("wx", Details::Fitted),
        ("wy", Details::Fitted),
        ("wz", Details::Fitted),
        ("rotor_1", Details::Fitted),
        ("rotor_2", Details::Fitted),
        ("rotor_3", Details::Fitted),
        ("rotor_4", Details::Fitted),
    ],
    inputs: &["u_1", "u_2", "u_3", "u_4"],
    base: "/truth/odometry",
    stamp: "log",
    partition_on: &[],
    sparse: "",
};

/// The positioning stage: its speed alone is fitted.
pub(super) const STAGE: RecipeParts = RecipeParts {
    about: "A positioning stage with dry friction: the position follows from the speed; how this changes is fitted.",
    fields: &[
        ("q", "/truth/joint_states.position[carriage]"),
        ("qd", "/truth/joint_states.velocity[carriage]"),
        ("u", "/stage/voltage.data"),
    ],
    aliases: &[],
    states: &[("q", Details::Integrated("qd")), ("qd", Details::Fitted)],
    inputs: &["u"],
    base: "/truth/joint_states",
    stamp: "log",
    partition_on: &[],
    sparse: "",
};
