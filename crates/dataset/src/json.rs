//! Reports for programs, as JSON: the version of their keys, with NaN and infinities as `null`.

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

/// Version of the keys of reports (docs/reference/reports.md): raised when one is renamed, removed or means something else.
const FORMAT: u32 = 2;

/// A report with the version of its keys.
#[derive(Serialize)]
struct Report<R> {
    format: u32,
    #[serde(flatten)]
    content: R,
}

/// A report as a tree of values.
pub fn report(content: impl Serialize) -> Value {
    value(Report { format: FORMAT, content })
}

/// A part of a report as a tree of values.
pub fn value(report: impl Serialize) -> Value {
    serde_json::to_value(report).expect("keys of reports are text, and nothing else can fail in memory")
}

/// Numbers of a report that is read again: one that is none was told as `null`.
pub fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    Ok(Vec::<Option<f64>>::deserialize(deserializer)?.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}

/// The same of one number.
pub fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
