//! `fleetfoot demo`: from a log to equations and code in a minute; with `--paper`, a paper's tables and figures.

mod gait;
mod horizons;
mod paper;
mod stage;
mod table_one;

use fleetfoot::Error;

use super::Context;
use crate::args;

pub(crate) fn demo(arguments: &args::Demo, context: &Context) -> Result<(), Error> {
    if arguments.paper { paper::demo(arguments, context) } else { stage::demo(arguments, context) }
}
