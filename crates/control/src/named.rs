//! Names and numbers from a user: their place, and checks.

use fleetfoot_data::nearest;

use crate::control_error::ControlError;

/// Refuses a number that is not finite.
pub(crate) fn finite(of: &'static str, name: &str, value: f64) -> Result<(), ControlError> {
    if value.is_finite() {
        return Ok(());
    }
    Err(ControlError::Value { of, name: name.to_owned(), value, allowed: "a finite number" })
}

/// The place of a name.
pub(crate) fn find(of: &'static str, kind: &'static str, name: &str, known: &[&String]) -> Result<usize, ControlError> {
    known.iter().position(|candidate| *candidate == name).ok_or_else(|| {
        let names = || known.iter().map(|name| name.as_str());
        let similar = nearest(name, names());
        let hint = match similar.as_slice() {
            [] => format!("there is {}", names().collect::<Vec<_>>().join(", ")),
            similar => format!("did you mean {}?", similar.join(", ")),
        };
        ControlError::Unknown { of, kind, name: name.to_owned(), hint }
    })
}

/// The places of names, ascending, each once.
pub(crate) fn indices(
    of: &'static str,
    kind: &'static str,
    names: &[String],
    known: &[String],
) -> Result<Vec<usize>, ControlError> {
    let known: Vec<&String> = known.iter().collect();
    let mut indices = names.iter().map(|name| find(of, kind, name, &known)).collect::<Result<Vec<_>, _>>()?;
    indices.sort_unstable();
    indices.dedup();
    Ok(indices)
}
