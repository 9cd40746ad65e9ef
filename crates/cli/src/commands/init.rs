//! `fleetfoot init`.

use fleetfoot::{Error, log::write_atomic, starter_recipe};
use serde_json::json;

use super::{Context, is_replaced};
use crate::args::Init;

pub(crate) fn init(arguments: &Init, context: &Context) -> Result<(), Error> {
    let info = fleetfoot::log::inspect(&arguments.file)?;
    let text = starter_recipe(&info);
    match &arguments.output {
        None => context.print(&json!({ "recipe": text }), || text.clone()),
        Some(path) if is_replaced(path) && !arguments.force => {
            return Err(Error::output(format!("{} exists already; give --force to overwrite it", path.display())));
        }
        Some(path) => {
            let of = std::slice::from_ref;
            context.claim(of(path), of(&arguments.file), arguments.force)?;
            write_atomic(path, text.as_bytes())?;
            if context.json {
                context.print(&json!({ "files": [path.display().to_string()] }), String::new);
            }
            context.say(format!("wrote {}: uncomment states and inputs, then run fleetfoot fit", path.display()));
        }
    }
    Ok(())
}
