//! `fleetfoot init`.

use fleetfoot::{Error, log::write_atomic, starter_recipe};
use serde::Serialize;

use super::{Context, Files, is_replaced};
use crate::args::Init;

/// The recipe where it is written to no file.
#[derive(Serialize)]
struct Told<'a> {
    recipe: &'a str,
}

pub(crate) fn init(arguments: &Init, context: &Context) -> Result<(), Error> {
    let info =
        fleetfoot::log::inspect(&arguments.file)?.of_topics(arguments.topic.as_ref().map_or(&[], |list| &list.0))?;
    let text = starter_recipe(&info);
    match &arguments.output {
        None => context.print(Told { recipe: &text }, || text.clone()),
        Some(path) if is_replaced(path) && !arguments.force => {
            return Err(Error::output(format!("{} exists already; give --force to overwrite it", path.display())));
        }
        Some(path) => {
            let of = std::slice::from_ref;
            context.claim(of(path), of(&arguments.file), arguments.force)?;
            write_atomic(path, text.as_bytes())?;
            if context.json {
                context.print(Files { files: &[path.display().to_string()] }, String::new);
            }
            context.say(format!("wrote {}: uncomment states and inputs, then run fleetfoot fit", path.display()));
        }
    }
    Ok(())
}
