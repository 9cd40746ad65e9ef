//! Controllers.

use fleetfoot_dataset::json::report;
use serde_json::Value;

use crate::ControllerFile;

impl ControllerFile {
    /// The controller for programs: the content of its file, without the checksum.
    pub fn to_value(&self) -> Value {
        report(self)
    }
}
