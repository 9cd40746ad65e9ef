//! Reports for programs, as JSON. A number that is none is `null`.

mod narx;
mod parameters;
mod pwa;
mod rollout;
mod score;
mod sindy;
mod sparse;

use fleetfoot_dynamics::{Basis, Estimate};
use serde_json::{Value, json};

/// Version of the keys of reports (docs/reference/reports.md): raised when one is renamed, removed or means something else.
pub(crate) const FORMAT: u32 = 2;

/// A number for JSON, which has no NaN.
pub(crate) fn real(value: f64) -> Value {
    serde_json::Number::from_f64(value).map_or(Value::Null, Value::Number)
}

pub(crate) fn reals(values: &[f64]) -> Vec<Value> {
    values.iter().map(|&value| real(value)).collect()
}

/// A value and its interval.
fn estimate(estimate: &Estimate) -> Value {
    json!({ "value": real(estimate.value), "low": real(estimate.low), "high": real(estimate.high) })
}

/// What a simulation did not compute itself ([`Simulator::replayed`](fleetfoot_dynamics::Simulator::replayed)), for people.
pub fn replayed_in_words(columns: &[String]) -> String {
    match columns {
        [] => "replayed from the recording: nothing".into(),
        columns => format!("replayed from the recording: {}", columns.join(", ")),
    }
}

/// What an interval compares, for people.
pub fn interval_in_words(basis: &Basis) -> String {
    match basis {
        Basis::Episodes(count) => format!("95 % intervals across {count} episodes"),
        Basis::Folds(count) => {
            format!("95 % intervals across {count} folds of spans (too narrow: they are correlated)")
        }
        Basis::Spans(count) => {
            format!("95 % intervals across {count} spans of one episode (too narrow: they are correlated)")
        }
        Basis::Starts(count) => {
            format!("95 % intervals across {count} starts of one episode (too narrow: they are correlated)")
        }
    }
}
