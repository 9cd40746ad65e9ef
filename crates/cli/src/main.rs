//! The binary of the `fleetfoot` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(fleetfoot_cli::run(std::env::args_os()))
}
