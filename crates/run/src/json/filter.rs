//! Filtered recordings.

use fleetfoot_dataset::json::report;
use serde_json::Value;

use crate::Filtered;

impl Filtered {
    /// The report for programs; estimates are not among it.
    pub fn to_json(&self) -> Value {
        report(self)
    }
}
