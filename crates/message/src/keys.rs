//! Names of array elements.
//!
//! Two conventions are common in robot messages. Parallel arrays stand beside an array of names in the same struct, as
//! in `sensor_msgs/JointState`. Arrays of structs carry the name inside the element, as in `tf2_msgs/TFMessage`.

use crate::Value;

/// Fields that hold the names of the elements of the other arrays of their struct.
pub(crate) const NAME_ARRAYS: [&str; 3] = ["name", "names", "joint_names"];

/// Text fields that name the struct that they stand in when it is an element of an array; the first one that it has counts.
///
/// The child frame comes before the frame: in a transform tree it is the child that is unique.
pub(crate) const KEY_FIELDS: [&str; 6] = ["child_frame_id", "name", "joint_name", "key", "id", "frame_id"];

/// The names that a struct's parallel arrays are keyed by: its first field of [`NAME_ARRAYS`] that holds an array of texts, with its place
/// among the fields.
pub(crate) fn names(fields: &[(std::sync::Arc<str>, Value)]) -> Option<(usize, &[Value])> {
    NAME_ARRAYS.iter().find_map(|wanted| {
        fields.iter().enumerate().find_map(|(place, (name, value))| match value {
            Value::Array(names) if **name == **wanted && names.iter().all(|name| matches!(name, Value::Text(_))) => {
                Some((place, &names[..]))
            }
            _ => None,
        })
    })
}

/// The name that an element of an array carries: the first of [`KEY_FIELDS`] that is a text in it.
pub(crate) fn key(element: &Value) -> Option<&str> {
    KEY_FIELDS.iter().find_map(|name| match element.field(name) {
        Some(Value::Text(text)) => Some(text.as_str()),
        _ => None,
    })
}

/// Returns true if some elements carry names. These names then replace those of an array beside.
pub(crate) fn are_keyed(elements: &[Value]) -> bool {
    elements.iter().any(|element| key(element).is_some())
}

/// Returns true if a path can name the field: a dot or a bracket would be read as syntax of the path. Only JSON and
/// broken schemas have such names.
pub(crate) fn nameable(field: &str) -> bool {
    !field.is_empty() && !field.contains(['.', '[', ']'])
}

/// Returns true if a name can stand in brackets of a path. Digits alone would be read as a place, and a bracket would
/// end the name.
pub(crate) fn usable(key: &str) -> bool {
    !key.is_empty() && !key.contains(']') && !key.bytes().all(|byte| byte.is_ascii_digit())
}
