//! ROS message definitions (`.msg`) with the definitions that they use behind separators, as `ros2msg` and `ros1msg` schemas hold them.

use std::collections::HashMap;

use re_ros_msg::{
    MessageSchema, is_schema_separator,
    message_spec::{ArraySize, BuiltInType, ComplexType, MessageSpecification, Type as Parsed},
};

use super::link::{Definition, Kind, Member, link};
use crate::{Length, Scalar, Schema, Type};

/// ROS version of a definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ros {
    One,
    Two,
}

/// The octet that a struct without fields has in IDL, which ROS 2 makes of its definitions, and in the parser's answer.
const DUMMY: &str = "structure_needs_at_least_one_member";

/// Reads the definitions in `text`, of which the first is `name`'s own.
///
/// # Errors
/// A line that is no field; a type that is missing or contains itself.
pub(super) fn parse(name: &str, text: &str, ros: Ros) -> Result<Schema, String> {
    if text.lines().any(|line| line.trim() == "---") {
        let service = name.strip_suffix("_Event").unwrap_or(name);
        return Err(format!(
            "the text is the definition of the service `{service}`; the definition of the message `{name}` is missing"
        ));
    }
    let parsed = MessageSchema::parse(name, &normalised(text))
        .map_err(|error| sentence(error.chain().map(ToString::to_string)))?;
    let mut definitions = Definitions::new(ros);
    let specs: Vec<&MessageSpecification> = std::iter::once(&parsed.spec).chain(&parsed.dependencies).collect();
    for spec in &specs {
        definitions.declare(&spec.name);
    }
    for (place, spec) in specs.iter().enumerate() {
        let fields = definitions.members(spec);
        definitions.list[place].fields = fields;
    }
    link(&definitions.list, 0)
}

fn sentence(chain: impl Iterator<Item = String>) -> String {
    chain.collect::<Vec<_>>().join(": ")
}

/// The text with nothing but what decides the bytes: separators, names, and one `type name` a line.
///
/// Constants and defaults are not in a message's bytes, so that none of them, however it is spelled, may make a log unreadable.
fn normalised(text: &str) -> String {
    let mut clean = String::with_capacity(text.len() + 64);
    let mut at_start = true;
    for line in text.lines() {
        if is_schema_separator(line) {
            at_start = true;
            continue;
        }
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        if let Some(name) = line.strip_prefix("MSG:").filter(|_| at_start) {
            // The blank line keeps the definition of an empty message, which the parser would drop.
            clean.push_str("===\nMSG: ");
            clean.push_str(name.trim());
            clean.push_str("\n\n");
        } else if let Some((kind, name)) = field(line) {
            clean.push_str(kind);
            clean.push(' ');
            clean.push_str(name);
            clean.push('\n');
        }
        at_start = false;
    }
    // A leading header would hide the main definition, which stands before the first separator.
    match clean.strip_prefix("===\nMSG: ") {
        Some(rest) => rest.split_once('\n').map(|(_, rest)| rest.to_owned()).unwrap_or_default(),
        None => clean,
    }
}

/// The type and the name of a line; none for a constant. A line of one word comes back with an empty name, for the parser to refuse.
fn field(line: &str) -> Option<(&str, &str)> {
    let (kind, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim_start();
    let end = rest.find(|c: char| c.is_whitespace() || c == '=').unwrap_or(rest.len());
    let (name, after) = rest.split_at(end);
    (!after.trim_start().starts_with('=')).then_some((kind, name))
}

/// Definitions found so far, and the names that they go by.
struct Definitions {
    ros: Ros,
    list: Vec<Definition>,
    /// By package and type.
    full: HashMap<(String, String), usize>,
    /// By type alone, for texts that leave the package out.
    short: HashMap<String, usize>,
}

impl Definitions {
    fn new(ros: Ros) -> Self {
        Self { ros, list: Vec::new(), full: HashMap::new(), short: HashMap::new() }
    }

    /// Makes room for a definition. Of several with one name the first counts: they are copies.
    fn declare(&mut self, name: &str) -> usize {
        let (package, kind) = parts(name);
        let place = self.list.len();
        let name = match self.ros {
            Ros::Two if !package.is_empty() && name.matches('/').count() == 1 => format!("{package}/msg/{kind}"),
            _ => name.to_owned(),
        };
        self.list.push(Definition { name, ..Definition::default() });
        self.full.entry((package.to_owned(), kind.to_owned())).or_insert(place);
        self.short.entry(kind.to_owned()).or_insert(place);
        place
    }

    fn members(&mut self, spec: &MessageSpecification) -> Vec<Member> {
        let package = parts(&spec.name).0.to_owned();
        let mut members = Vec::with_capacity(spec.fields.len());
        for field in &spec.fields {
            if self.ros == Ros::Two || field.name != DUMMY {
                members.push(Member {
                    name: field.name.clone(),
                    kind: self.kind(&field.ty, &package),
                    optional: false,
                });
            }
        }
        if members.is_empty() && self.ros == Ros::Two {
            // Left out by the parser where only constants of one octet stand; on the wire it is there all the same.
            members.push(octet(DUMMY));
        }
        members
    }

    fn kind(&mut self, parsed: &Parsed, package: &str) -> Kind {
        match parsed {
            Parsed::BuiltIn(kind) => Kind::Known(builtin(kind, self.ros)),
            Parsed::Array { ty, size } => {
                let length = match *size {
                    ArraySize::Fixed(length) => Length::Fixed(length),
                    ArraySize::Bounded(most) => Length::Sequence(Some(most)),
                    ArraySize::Unbounded => Length::Sequence(None),
                };
                Kind::Array(Box::new(self.kind(ty, package)), length)
            }
            Parsed::Complex(ComplexType::Absolute { package, name }) => {
                let package = package.split('/').next().unwrap_or_default();
                self.known(package, name).unwrap_or_else(|| Kind::Missing(format!("{package}/{name}")))
            }
            Parsed::Complex(ComplexType::Relative { name }) => {
                let known_kind = self.known(package, name);
                let known_kind =
                    known_kind.or_else(|| if name == "Header" { self.known("std_msgs", name) } else { None });
                let known_kind = known_kind.or_else(|| self.primitive_time(name));
                let known_kind = known_kind.or_else(|| self.short.get(name).copied().map(Kind::Struct));
                known_kind.unwrap_or_else(|| {
                    Kind::Missing(if package.is_empty() { name.clone() } else { format!("{package}/{name}") })
                })
            }
        }
    }

    /// A definition of the text, or a well-known one that texts may leave out.
    fn known(&mut self, package: &str, name: &str) -> Option<Kind> {
        if let Some(&place) = self.full.get(&(package.to_owned(), name.to_owned())) {
            return Some(Kind::Struct(place));
        }
        match (self.ros, package, name) {
            (Ros::Two, "builtin_interfaces", "Time" | "Duration") => {
                Some(self.time(&format!("builtin_interfaces/{name}"), [("sec", Scalar::I32), ("nanosec", Scalar::U32)]))
            }
            _ => None,
        }
    }

    /// `time` and `duration`, which are primitive in ROS 1 and old spellings of the messages in ROS 2.
    fn primitive_time(&mut self, name: &str) -> Option<Kind> {
        match (self.ros, name) {
            (Ros::Two, "time") => self.known("builtin_interfaces", "Time"),
            (Ros::Two, "duration") => self.known("builtin_interfaces", "Duration"),
            (Ros::One, "time") => Some(self.time("time", [("secs", Scalar::U32), ("nsecs", Scalar::U32)])),
            (Ros::One, "duration") => Some(self.time("duration", [("secs", Scalar::I32), ("nsecs", Scalar::I32)])),
            _ => None,
        }
    }

    fn time(&mut self, name: &str, fields: [(&str, Scalar); 2]) -> Kind {
        let (package, kind) = parts(name);
        if let Some(&place) = self.full.get(&(package.to_owned(), kind.to_owned())) {
            return Kind::Struct(place);
        }
        let place = self.declare(name);
        self.list[place].fields = fields
            .map(|(name, scalar)| Member {
                name: name.to_owned(),
                kind: Kind::Known(Type::Scalar(scalar)),
                optional: false,
            })
            .into();
        Kind::Struct(place)
    }
}

fn octet(name: &str) -> Member {
    Member { name: name.to_owned(), kind: Kind::Known(Type::Scalar(Scalar::U8)), optional: false }
}

/// The package and the type of a name: `std_msgs/msg/Header` and `std_msgs/Header` are the same.
fn parts(name: &str) -> (&str, &str) {
    match (name.split_once('/'), name.rsplit_once('/')) {
        (Some((package, _)), Some((_, kind))) => (package, kind),
        _ => ("", name),
    }
}

fn builtin(kind: &BuiltInType, ros: Ros) -> Type {
    Type::Scalar(match kind {
        BuiltInType::Bool => Scalar::Bool,
        BuiltInType::Byte if ros == Ros::One => Scalar::I8,
        // `char` is an unsigned octet in ROS 1 and, through its IDL type uint8, in ROS 2.
        BuiltInType::Byte | BuiltInType::Char | BuiltInType::UInt8 => Scalar::U8,
        BuiltInType::Int8 => Scalar::I8,
        BuiltInType::Int16 => Scalar::I16,
        BuiltInType::UInt16 => Scalar::U16,
        BuiltInType::Int32 => Scalar::I32,
        BuiltInType::UInt32 => Scalar::U32,
        BuiltInType::Int64 => Scalar::I64,
        BuiltInType::UInt64 => Scalar::U64,
        BuiltInType::Float32 => Scalar::F32,
        BuiltInType::Float64 => Scalar::F64,
        BuiltInType::String(_) => return Type::Text { wide: false },
        BuiltInType::WString(_) => return Type::Text { wide: true },
    })
}
