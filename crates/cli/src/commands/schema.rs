//! `fleetfoot schema`: the JSON schema of recipes.

use fleetfoot::{Error, Recipe, output::write_atomic};

use super::{Context, Files};
use crate::args::Schema;

pub(crate) fn schema(arguments: &Schema, context: &Context) -> Result<(), Error> {
    let schema = Recipe::schema();
    let text = format!("{schema:#}\n");
    let Some(path) = &arguments.output else {
        context.print(&schema, || text);
        return Ok(());
    };
    context.claim(std::slice::from_ref(path), &[], false)?;
    write_atomic(path, text.as_bytes())?;
    let name = path.display().to_string();
    context.print(Files { files: std::slice::from_ref(&name) }, || format!("wrote {name}"));
    let file = path.file_name().unwrap_or(path.as_os_str()).display();
    context.say(format!("begin a recipe in the same folder with the line `#:schema ./{file}`"));
    Ok(())
}
