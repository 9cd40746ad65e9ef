//! `fleetfoot init`.

use std::path::PathBuf;

use fleetfoot::{
    Error, Recipe,
    log::{DetectedRuns, inspect, inspect_together},
    output::write_atomic,
    starter_recipe, starter_recipe_of_runs,
};
use serde::Serialize;

use super::{Context, Files, files, is_replaced};
use crate::args::Init;

/// The recipe where it is written to no file.
#[derive(Serialize)]
struct RecipeText<'a> {
    recipe: &'a str,
}

pub(crate) fn init(arguments: &Init, context: &Context) -> Result<(), Error> {
    let files = files(&arguments.data)?;
    let text = recipe(&files, arguments, context)?;
    match &arguments.output {
        None => context.print(RecipeText { recipe: &text }, || text.clone()),
        Some(path) if is_replaced(path) && !arguments.force => {
            return Err(Error::output(format!("{} exists already; give --force to overwrite it", path.display())));
        }
        Some(path) => {
            let of = std::slice::from_ref;
            context.claim(of(path), &files, arguments.force)?;
            write_atomic(path, text.as_bytes())?;
            if context.json {
                context.print(Files { files: &[path.display().to_string()] }, String::new);
            }
            let drafted = Recipe::parse(&text, "the draft").is_ok_and(|recipe| !recipe.states.is_empty());
            let first = if drafted { "read the draft of states and inputs" } else { "uncomment states and inputs" };
            context.say(format!("wrote {}: {first}, then run fleetfoot fit", path.display()));
        }
    }
    Ok(())
}

/// A recipe that joins the files of runs, where they are such; else one for the first file.
fn recipe(files: &[PathBuf], arguments: &Init, context: &Context) -> Result<String, Error> {
    let topics = arguments.topic.as_ref().map_or(&[][..], |list| &list.0);
    let Some(first) = files.first() else { return Err(Error::missing("no file is given".into())) };
    if files.len() > 1 {
        let bar = context.bar();
        let infos = inspect_together(files, false, &bar);
        let runs = infos.map(|infos| DetectedRuns::among(&infos).filter(|runs| runs.share_a_clock(&bar)));
        bar.finish();
        if let Some(runs) = runs? {
            return Ok(starter_recipe_of_runs(&runs)?);
        }
        context.say(format!(
            "note: the recipe describes {} and files like it; the {} files are not parts of one run (different columns, overlapping clocks)",
            first.display(),
            files.len()
        ));
    }
    Ok(starter_recipe(&inspect(first)?.of_topics(topics)?))
}
