//! The `fleetfoot` command within the package: the binary's function, without the interpreter.

use std::{ffi::OsString, panic::catch_unwind};

use pyo3::prelude::*;

/// Exit code of a panic, which has told its message already.
const PANICKED: u8 = 101;

/// Runs the command with its arguments, of which the first is the program's name, and returns the exit code.
///
/// It has the standard streams and the signals of the process, not Python's, and the interpreter's lock is released.
#[pyfunction]
pub(crate) fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| catch_unwind(|| fleetfoot_cli::run(arguments)).unwrap_or(PANICKED))
}
