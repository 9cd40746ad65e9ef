//! `fleetfoot completions`: a shell's completions, made from the arguments.

use clap::CommandFactory;
use fleetfoot::Error;

use super::write_out;
use crate::args::{Cli, Completions};

pub(crate) fn completions(arguments: &Completions) -> Result<(), Error> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "fleetfoot", &mut script);
    write_out(&String::from_utf8_lossy(&script));
    Ok(())
}
