//! Controllers.

use serde_json::Value;

use super::report;
use crate::ControllerFile;

impl ControllerFile {
    /// The controller for programs: what its file has, without the checksum.
    pub fn told(&self) -> Value {
        report(self)
    }
}
