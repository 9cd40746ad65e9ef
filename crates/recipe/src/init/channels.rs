//! A recipe for a robot's log: fields by topic with short names, a block for each odometry, and how channels are joined.

use std::{
    collections::{BTreeMap, HashMap},
    fmt::Write,
};

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_library::Expr;
use fleetfoot_log::TopicInfo;

use crate::recipe::{Input, Recipe};

use super::{
    columns_heading, episodes_section, heading, key, method_section, model_section, names::Names, quaternions,
    short::short_names, states_heading, text,
};

/// Ends of an odometry's fields with their proposed names and roles in the model.
const ODOMETRY: [(&str, &str); 5] = [
    ("x", "pose.pose.position.x"),
    ("y", "pose.pose.position.y"),
    ("yaw", "pose.pose.orientation"),
    ("v", "twist.twist.linear.x"),
    ("w", "twist.twist.angular.z"),
];

pub(crate) fn recipe(file: &str, columns: &[Column], topics: &[TopicInfo]) -> String {
    let mut out = String::new();
    heading(&mut out, file);
    columns_heading(&mut out);
    let mut names = Names::default();
    let odometries: Vec<Odometry> =
        topics.iter().filter(|topic| is_odometry(topic)).map(|topic| Odometry::new(&topic.name, &mut names)).collect();
    let drafted = draft(columns, odometries.is_empty());
    let attitude = Attitude::new(columns, &drafted, &mut names);
    let named = Drafted { roles: &drafted, attitude: attitude.as_ref() };
    let (states, given) = columns_section(&mut out, columns, topics, &odometries, named, &mut names);
    let _ = writeln!(out, "# all fields of a kind: q = \"/joint_states.position[*]\" gives q[left], q[right], ...\n");
    states_heading(&mut out, columns);
    odometries.iter().for_each(|odometry| odometry.states(&mut out));
    if let Some(attitude) = &attitude {
        attitude.states(&mut out, &states);
    }
    for name in &states {
        let _ = writeln!(out, "{} = {{}}", key(name));
    }
    let _ = writeln!(out, "\n# Inputs: columns that drive the model; their values hold between messages.");
    let _ = writeln!(out, "[inputs]");
    for name in &given {
        let _ = writeln!(out, "{} = {{}}", key(name));
    }
    let mut inputs = 0;
    for topic in topics.iter().filter(|topic| topic.name.contains("cmd") || topic.name.contains("command")) {
        for field in columns.iter().filter(|column| is_signal(column) && of_topic(&topic.name, &column.name)) {
            let _ = writeln!(out, "# {} = {}", names.take(&format!("u{inputs}")), text(&field.name));
            inputs += 1;
        }
    }
    let _ = writeln!(out, "\n# One clock for all channels, and the channel whose messages make the rows.");
    let _ = writeln!(out, "[time]");
    let _ = writeln!(
        out,
        "# stamp = \"header\"         # or log, publish (default: header where every channel in use has one)"
    );
    let base = topics.iter().find(|topic| is_odometry(topic)).or(topics.iter().max_by_key(|topic| topic.messages));
    if let Some(topic) = base {
        let name = text(&topic.name);
        let _ = writeln!(
            out,
            "# base = {name}   # or rate = 100; the others are joined to it (default: the first state's)"
        );
    }
    model_section(&mut out);
    let _ = writeln!(
        out,
        "\n# How other channels come to the rows' stamps, where the default is wrong: measured numbers linearly, inputs"
    );
    let _ = writeln!(
        out,
        "# and whole numbers held, quaternions by slerp, never across a gap of more than five of their periods."
    );
    let _ = writeln!(out, "# [join]\n# \"/gripper.state\" = {{ kind = \"hold\", max_gap = \"none\" }}");
    method_section(&mut out);
    episodes_section(&mut out);
    out
}

/// Messages of a topic below which it is not a signal.
const FEW_MESSAGES: u64 = 20;

/// States of the first measured odometry of a robot's log, if it has one: the pose follows from speeds and heading, the
/// speeds are fitted. Inputs are the commanded speed and turn, of other commands all fields.
pub(super) fn of_odometry(columns: &[Column], topics: &[TopicInfo]) -> Option<Recipe> {
    let moves = |topic: &&TopicInfo| topic.messages.is_none_or(|count| count >= FEW_MESSAGES);
    let odometries = || topics.iter().filter(|topic| is_odometry(topic)).filter(moves);
    let topic = odometries().find(|topic| !topic.name.contains("truth")).or_else(|| odometries().next())?;
    let odometry = Odometry::new(&topic.name, &mut Names::default());
    let mut draft = Recipe::default();
    let has = |field: &str| columns.iter().any(|column| column.name.starts_with(field));
    for (name, end) in ODOMETRY {
        let field = format!("{}.{end}", topic.name);
        if !has(&field) {
            return None;
        }
        let field = if name == "yaw" { format!("yaw({field})") } else { field };
        draft.columns.insert(name.to_owned(), field);
    }
    let mut states = String::from("[states]\n");
    odometry.states(&mut states);
    draft.states = Recipe::parse(&states.replace("# of ", "#").replace("\n# ", "\n"), "the draft").ok()?.states;
    let commands =
        topics.iter().filter(|other| other.name.contains("cmd") || other.name.contains("command")).filter(moves);
    for topic in commands.filter(|other| other.name.contains("truth") == topic.name.contains("truth")) {
        let fields = columns.iter().filter(|column| is_signal(column) && of_topic(&topic.name, &column.name));
        let fields: Vec<&str> = fields.map(|column| column.name.as_str()).collect();
        let of_twist = |field: &&&str| field.ends_with("linear.x") || field.ends_with("angular.z");
        let wanted: Vec<&&str> = match fields.iter().any(|field| field.ends_with("linear.x")) {
            true => fields.iter().filter(of_twist).collect(),
            false => fields.iter().collect(),
        };
        for field in wanted {
            let name = format!("u{}", draft.inputs.len());
            draft.inputs.insert(name, Input::Text((*field).to_owned()));
        }
    }
    Some(draft)
}

/// The names of the states and of the inputs that are proposed.
type Proposed = (Vec<String>, Vec<String>);

/// Lists the fields of all topics; of a large log with a draft only those of its topics.
fn columns_section(
    out: &mut String,
    columns: &[Column],
    topics: &[TopicInfo],
    odometries: &[Odometry],
    Drafted { roles: drafted, attitude }: Drafted<'_>,
    names: &mut Names,
) -> Proposed {
    let mut proposed = Proposed::default();
    let fields: Vec<&Column> = columns.iter().filter(|column| is_signal(column)).collect();
    let short = short_names(&fields);
    let quaternions = quaternions(columns);
    let (fields_of, quaternions_of) = (
        by_topic(topics, fields.iter().map(|field| field.name.as_str())),
        by_topic(topics, quaternions.iter().map(AsRef::as_ref)),
    );
    for topic in topics {
        let rate = topic.rate.map(|rate| format!(", {rate:.4} Hz")).unwrap_or_default();
        let count = topic.messages.map(|count| format!(", {count} messages{rate}")).unwrap_or_default();
        let _ = writeln!(out, "# {} ({}{count})", topic.name, topic.type_name);
        if let Some(problem) = &topic.problem {
            let _ = writeln!(out, "#   cannot be read: {}", problem.replace('\n', " "));
        }
        let places = |of: &HashMap<&str, Vec<usize>>| of.get(topic.name.as_str()).cloned().unwrap_or_default();
        let listed: Vec<(&Column, &String)> = places(&fields_of).iter().map(|&at| (fields[at], &short[at])).collect();
        // A message that comes once is no signal.
        if topic.messages.is_some_and(|count| count < 2) && !listed.is_empty() {
            let _ = writeln!(out, "#   said once; `fleetfoot info --values` lists its {} fields", listed.len());
            continue;
        }
        if let Some(attitude) = attitude.filter(|attitude| attitude.topic == topic.name) {
            attitude.aliases(out);
        }
        let is_drafted = listed.iter().any(|(field, _)| drafted.contains_key(&field.name));
        if fields.len() > MANY_FIELDS && !drafted.is_empty() && !is_drafted {
            let _ = writeln!(out, "#   {} fields; `fleetfoot init --topic {}` lists them", listed.len(), topic.name);
            continue;
        }
        let odometry = odometries.iter().find(|odometry| odometry.topic == topic.name);
        for (field, name) in listed {
            let known = odometry.and_then(|odometry| odometry.name_of(&field.name));
            let role = drafted.get(&field.name);
            let wanted = role.and_then(|role| usual_name(*role, &field.name)).unwrap_or_else(|| name.clone());
            let name = known.map_or_else(|| names.take(&wanted), str::to_owned);
            let mark = if role.is_some() { "" } else { "# " };
            let _ = writeln!(out, "{mark}{} = {}", key(&name), text(&field.name));
            match role {
                Some(Role::State) => proposed.0.push(name),
                Some(Role::Input) => proposed.1.push(name),
                None => {}
            }
        }
        for prefix in places(&quaternions_of).iter().map(|&at| &quaternions[at]) {
            let known = odometry.and_then(|odometry| odometry.name_of(prefix));
            let name = known.map_or_else(|| names.take("yaw"), str::to_owned);
            let _ = writeln!(out, "# {} = \"yaw({prefix})\"   # and pitch(...), roll(...)", key(&name));
        }
    }
    proposed
}

/// Fields of a log from which only those of the draft's topics are listed.
const MANY_FIELDS: usize = 300;

/// Role of a field in the draft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    State,
    Input,
}

/// Fields that usually are the states: rates of turn, else speeds of a twist, else positions and speeds of joints; and
/// those that usually are the inputs. The first group of each in the log is taken. A log with an odometry takes none,
/// as its states are proposed already.
const DRAFTS: [(Role, &[&str]); 2] = [
    (
        Role::State,
        &[
            "/vehicle_angular_velocity.xyz[",
            "/IMU.GyrX|/IMU.GyrY|/IMU.GyrZ",
            "/vehicle_attitude.rollspeed|/vehicle_attitude.pitchspeed|/vehicle_attitude.yawspeed",
            ".twist.linear.|.twist.angular.",
            "/joint_states.position[|/joint_states.velocity[",
        ],
    ),
    (
        Role::Input,
        &[
            "/actuator_controls_0.control[",
            "/vehicle_torque_setpoint.xyz[",
            "/actuator_motors.control[",
            "/actuator_outputs.output[",
            "/RCOU.C1|/RCOU.C2|/RCOU.C3|/RCOU.C4",
            "/cmd_vel.linear.|/cmd_vel.angular.|/cmd_vel.twist.",
        ],
    ),
];

/// Content of the draft: fields by their roles, and the attitude that turns with the rates among them.
#[derive(Clone, Copy)]
struct Drafted<'a> {
    roles: &'a BTreeMap<String, Role>,
    attitude: Option<&'a Attitude>,
}

/// The end of the topic whose quaternion, w first, is a PX4 vehicle's attitude. It turns the body (forward, right,
/// down) to the world (north, east, down).
const ATTITUDE: &str = "vehicle_attitude";

/// The topic of ArduPilot with an attitude in degrees.
const ANGLES: &str = "/ATT";

/// Roll, pitch and yaw of a vehicle.
struct Attitude {
    topic: String,
    /// Comment of the draft about their form in the log.
    comment: &'static str,
    /// Their expressions, radians.
    angles: [String; 3],
    names: [String; 3],
}

impl Attitude {
    /// That of a log from which three rates of turn are drafted: a quaternion of PX4, or angles of ArduPilot.
    fn new(columns: &[Column], drafted: &BTreeMap<String, Role>, names: &mut Names) -> Option<Self> {
        let is_rate = |name: &str| {
            let is_of = |part: &str| name.contains(part);
            is_of("/vehicle_angular_velocity.xyz[") || is_of("/IMU.Gyr") || name.ends_with("speed") && is_of(ATTITUDE)
        };
        let states = || drafted.iter().filter(|(_, role)| **role == Role::State);
        if states().count() != 3 || !states().all(|(name, _)| is_rate(name)) {
            return None;
        }
        let (topic, comment, angles) = Self::quaternion(columns).or_else(|| Self::degrees(columns))?;
        Some(Self { topic, comment, angles, names: ["roll", "pitch", "yaw"].map(|name| names.take(name)) })
    }

    fn quaternion(columns: &[Column]) -> Option<(String, &'static str, [String; 3])> {
        let end = format!("/{ATTITUDE}.q[0]");
        let topic = columns.iter().find(|column| column.name.ends_with(&end))?.name.strip_suffix(".q[0]")?;
        let part = |at: usize| field(columns, &format!("{topic}.q[{at}]"));
        let [x, y, z, w] = [part(1)?, part(2)?, part(3)?, part(0)?];
        let quaternion = format!("quat({x}, {y}, {z}, {w})");
        let angles = ["roll", "pitch", "yaw"].map(|angle| format!("{angle}({quaternion})"));
        Some((topic.to_owned(), "its quaternion is w first, and quat(x, y, z, w) takes w last", angles))
    }

    fn degrees(columns: &[Column]) -> Option<(String, &'static str, [String; 3])> {
        let [roll, pitch, yaw] = ["Roll", "Pitch", "Yaw"].map(|angle| field(columns, &format!("{ANGLES}.{angle}")));
        let angles = [roll?, pitch?, yaw?].map(|angle| format!("{angle}*(pi/180)"));
        Some((ANGLES.to_owned(), "its angles are degrees, and states of the kind `angle` are radians", angles))
    }

    fn aliases(&self, out: &mut String) {
        let _ = writeln!(out, "# {}", self.comment);
        for (name, angle) in self.names.iter().zip(&self.angles) {
            let _ = writeln!(out, "{} = {}", key(name), text(angle));
        }
    }

    /// The angles follow from the rates about the body's axes; how the rates change is fitted.
    fn states(&self, out: &mut String, rates: &[String]) {
        let ([roll, pitch, yaw], [p, q, r]) = (&self.names, rates) else { return };
        let _ = writeln!(out, "# the attitude follows from the rates of turn; how these change is fitted");
        for (name, known) in [
            (roll, format!("{p} + tan({pitch})*({q}*sin({roll}) + {r}*cos({roll}))")),
            (pitch, format!("{q}*cos({roll}) - {r}*sin({roll})")),
            (yaw, format!("({q}*sin({roll}) + {r}*cos({roll}))/cos({pitch})")),
        ] {
            let _ =
                writeln!(out, "{} = {{ kind = \"angle\", known = {}, regressor = false }}", key(name), text(&known));
        }
    }
}

/// A field of the log as expressions write it.
fn field(columns: &[Column], name: &str) -> Option<String> {
    columns.iter().any(|column| column.name == name).then(|| Expr::column(name).to_string())
}

/// Usual names of fields in a draft: p, q and r are the rates of turn about the body's axes, u0, u1, ... inputs.
fn usual_name(role: Role, field: &str) -> Option<String> {
    if let Some(axis) = field.strip_prefix("/IMU.Gyr") {
        return ["X", "Y", "Z"].iter().position(|letter| *letter == axis).map(|at| ["p", "q", "r"][at].to_owned());
    }
    if let Some(channel) = field.strip_prefix("/RCOU.C") {
        return Some(format!("u{}", channel.parse::<usize>().ok()?.checked_sub(1)?));
    }
    let (array, element) = field.strip_suffix(']')?.rsplit_once('[')?;
    let element: usize = element.parse().ok()?;
    match role {
        Role::State if array.ends_with("/vehicle_angular_velocity.xyz") => {
            ["p", "q", "r"].get(element).map(ToString::to_string)
        }
        Role::State => None,
        Role::Input => Some(format!("u{element}")),
    }
}

/// Elements of an array that a draft takes: outputs that no motor has are constant or missing.
const FIRST_ELEMENTS: usize = 4;

fn draft(columns: &[Column], without_odometry: bool) -> BTreeMap<String, Role> {
    let mut drafted = BTreeMap::new();
    for (role, groups) in DRAFTS.into_iter().filter(|_| without_odometry) {
        let of_group = |group: &&&str| {
            let is_of = |name: &str, pattern: &str| {
                let Some((_, rest)) = name.split_once(pattern) else { return false };
                // A whole name is that of no longer one: C1 is not C10.
                if pattern.ends_with(|last: char| last.is_ascii_alphanumeric()) && !rest.is_empty() {
                    return false;
                }
                let index = rest.trim_end_matches(']').parse::<usize>().ok().filter(|_| pattern.ends_with('['));
                index.is_none_or(|index| index < FIRST_ELEMENTS)
            };
            let is_wanted =
                |column: &&Column| is_signal(column) && group.split('|').any(|word| is_of(&column.name, word));
            columns.iter().filter(is_wanted).map(|column| column.name.clone()).collect::<Vec<_>>()
        };
        let group_columns = groups.iter().map(|group| of_group(&group)).find(|group_columns| !group_columns.is_empty());
        drafted.extend(group_columns.unwrap_or_default().into_iter().map(|name| (name, role)));
    }
    let has_states = drafted.values().any(|role| *role == Role::State);
    if has_states { drafted } else { BTreeMap::new() }
}

/// The places of the fields of every topic, in one pass over the fields. A topic may be the beginning of another, whose fields are its own too.
fn by_topic<'a>(topics: &'a [TopicInfo], fields: impl Iterator<Item = &'a str>) -> HashMap<&'a str, Vec<usize>> {
    let mut places: HashMap<&str, Vec<usize>> = topics.iter().map(|topic| (topic.name.as_str(), Vec::new())).collect();
    for (at, field) in fields.enumerate() {
        for (end, _) in field.match_indices(['.', '[']) {
            if let Some(columns) = places.get_mut(&field[..end]) {
                columns.push(at);
            }
        }
    }
    places
}

fn of_topic(topic: &str, field: &str) -> bool {
    field.strip_prefix(topic).is_some_and(|rest| rest.starts_with(['.', '[']))
}

fn is_odometry(topic: &TopicInfo) -> bool {
    topic.type_name.ends_with("/Odometry")
}

/// An odometry's topic and the names of its fields, in the order of [`ODOMETRY`].
struct Odometry {
    topic: String,
    names: [String; 5],
}

impl Odometry {
    fn new(topic: &str, names: &mut Names) -> Self {
        Self { topic: topic.to_owned(), names: ODOMETRY.map(|(name, _)| names.take(name)) }
    }

    /// The name of one of its fields.
    fn name_of(&self, field: &str) -> Option<&str> {
        let rest = field.strip_prefix(self.topic.as_str())?.strip_prefix('.')?;
        let place = ODOMETRY.iter().position(|(_, end)| *end == rest)?;
        Some(&self.names[place])
    }

    /// The usual states: the pose follows from speeds and heading, the speeds are fitted.
    fn states(&self, out: &mut String) {
        let Self { topic, names: [x, y, yaw, v, w] } = self;
        let _ =
            writeln!(out, "# of {topic}: where it is follows from speed and heading; how the speeds change is fitted");
        let _ = writeln!(out, "# {x} = {{ known = \"{v}*cos({yaw})\", regressor = false }}");
        let _ = writeln!(out, "# {y} = {{ known = \"{v}*sin({yaw})\", regressor = false }}");
        let _ = writeln!(out, "# {yaw} = {{ known = \"{w}\", kind = \"angle\", regressor = false }}");
        let _ = writeln!(out, "# {v} = {{}}\n# {w} = {{}}");
    }
}

/// Returns true for a possible state or input: no text, no stamp of a header, no covariance.
fn is_signal(column: &Column) -> bool {
    let stamp =
        [".sec", ".nanosec", ".secs", ".nsecs", ".seconds", ".nanos", ".nsec", ".timestamp", ".timestamp_sample"];
    !matches!(column.kind, ColumnKind::Category(_))
        && !column.name.contains("covariance")
        && !column.name.contains(".header.")
        && !stamp.iter().any(|end| column.name.ends_with(end))
}

#[cfg(test)]
mod tests;
