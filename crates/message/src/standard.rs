//! Definitions of ROS 2 types that a recording does not have with it.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::OnceLock,
};

/// Types of the standard packages whose fields are the same in all distributions from Foxy to Jazzy: name, then a field a line, then an empty line.
/// Types that changed (`visualization_msgs/msg/Marker`, `control_msgs/msg/JointTrajectoryControllerState`) are not here: their bytes would be read
/// wrongly. `Range` of `sensor_msgs` got a field in Jazzy, whose recordings have definitions with them.
const STANDARD: &str = include_str!("standard.txt");

const SEPARATOR: &str = "================================================================================";

/// Names that are no types of a package.
const PRIMITIVES: [&str; 17] = [
    "bool", "byte", "char", "duration", "float32", "float64", "int16", "int32", "int64", "int8", "string", "time",
    "uint16", "uint32", "uint64", "uint8", "wstring",
];

/// The text of a `ros2msg` schema for a type of the standard packages: its definition, and behind separators those of the types that it uses.
/// `None` for a type that is not one of them.
pub fn standard_definition(name: &str) -> Option<String> {
    complete_definition(name, &|_| None).ok()
}

/// The text of a `ros2msg` schema for a type (`pkg/msg/Type`), from definitions of single types that `definition_of` gives and those of the
/// standard packages.
///
/// # Errors
/// The name of the first type that has no definition.
pub fn complete_definition(name: &str, definition_of: &dyn Fn(&str) -> Option<String>) -> Result<String, String> {
    let find = |name: &str| definition_of(name).or_else(|| standard().get(name).map(|text| (*text).to_owned()));
    let mut text = find(name).ok_or_else(|| name.to_owned())?;
    let mut seen = BTreeSet::from([name.to_owned()]);
    let mut wanted = used(name, &text);
    while let Some(next) = wanted.pop() {
        if !seen.insert(next.clone()) {
            continue;
        }
        let text_there = find(&next).ok_or_else(|| next.clone())?;
        wanted.extend(used(&next, &text_there));
        text.push_str(&format!("\n{SEPARATOR}\nMSG: {}\n{text_there}", next.replacen("/msg/", "/", 1)));
    }
    Ok(text)
}

fn standard() -> &'static BTreeMap<&'static str, &'static str> {
    static TYPES: OnceLock<BTreeMap<&str, &str>> = OnceLock::new();
    TYPES.get_or_init(|| {
        let types = STANDARD.split("\n\n").map(|text| text.trim_matches('\n'));
        types.map(|text| text.split_once('\n').unwrap_or((text, ""))).collect()
    })
}

/// Types of packages that the fields of a definition have, by full names.
fn used(name: &str, definition: &str) -> Vec<String> {
    let package = name.split('/').next().unwrap_or_default();
    let kind = |line: &str| -> Option<String> {
        let word = line.split('#').next()?.split_ascii_whitespace().next()?;
        let kind = word.split(['[', '<']).next()?;
        let parts: Vec<&str> = kind.split('/').collect();
        match parts[..] {
            [word_there] if PRIMITIVES.contains(&word_there) || word_there.is_empty() || word_there == "---" => None,
            ["Header"] => Some("std_msgs/msg/Header".to_owned()),
            [word_there] => Some(format!("{package}/msg/{word_there}")),
            [package, word_there] | [package, "msg", word_there] => Some(format!("{package}/msg/{word_there}")),
            _ => None,
        }
    };
    definition.lines().filter_map(kind).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec;

    #[test]
    fn every_standard_type_has_a_decoder() {
        assert!(standard().len() > 90);
        for name in standard().keys() {
            let text = standard_definition(name).unwrap();
            assert!(codec("cdr", Some((name, "ros2msg", text.as_bytes()))).is_ok(), "{name}");
        }
        assert_eq!(standard_definition("my_msgs/msg/State"), None);
    }

    #[test]
    fn definitions_join_the_standard_packages() {
        let text_of = |name: &str| match name {
            "my_msgs/msg/State" => Some("# the state\nHeader header\nPart[2] parts # two\nfloat64<=3 x".to_owned()),
            "my_msgs/msg/Part" => {
                Some("geometry_msgs/Vector3 v\nmissing_msgs/msg/Other[] others\nint32 N=3".to_owned())
            }
            _ => None,
        };
        assert_eq!(complete_definition("my_msgs/msg/State", &text_of).unwrap_err(), "missing_msgs/msg/Other");
        let whole =
            |name: &str| if name == "missing_msgs/msg/Other" { Some("bool b".to_owned()) } else { text_of(name) };
        let text = complete_definition("my_msgs/msg/State", &whole).unwrap();
        for part in
            ["MSG: std_msgs/Header", "MSG: builtin_interfaces/Time", "MSG: my_msgs/Part", "MSG: geometry_msgs/Vector3"]
        {
            assert_eq!(text.matches(part).count(), 1, "{part}");
        }
    }
}
