//! `fleetfoot init`.

use fleetfoot::{Error, log::write_atomic, starter_recipe};

use super::{Context, is_replaced, write_out};
use crate::args::Init;

pub(crate) fn init(arguments: &Init, context: &Context) -> Result<(), Error> {
    let info = fleetfoot::log::inspect(&arguments.file)?;
    let text = starter_recipe(&info);
    match &arguments.output {
        None => write_out(&text),
        Some(path) if is_replaced(path) && !arguments.force => {
            return Err(Error::output(format!("{} exists already; give --force to overwrite it", path.display())));
        }
        Some(path) => {
            let of = std::slice::from_ref;
            context.claim(of(path), of(&arguments.file), arguments.force)?;
            write_atomic(path, text.as_bytes())?;
            context.say(format!("wrote {}: uncomment states and inputs, then run fleetfoot fit", path.display()));
        }
    }
    Ok(())
}
