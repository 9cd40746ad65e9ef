//! `fleetfoot fit pwa` and `fit sindy` where every equation is given: nothing is fitted, the model is written as it is.

use std::path::{Path, PathBuf};

use fleetfoot::{Error, KnownModel, Recipe, known_model, write_model};
use serde::Serialize;

use super::Context;
use crate::table::count;

#[derive(Serialize)]
struct KnownReport<'a> {
    rows: u64,
    episodes: usize,
    files: usize,
    equations: &'a [String],
    model: String,
    hash: String,
    notes: &'a [String],
}

/// Writes the model of a recipe in which every state is known.
pub(crate) fn known(recipe: &Recipe, files: &[PathBuf], output: &Path, context: &Context) -> Result<(), Error> {
    let bar = context.bar();
    let fitted = known_model(recipe, files, &bar);
    bar.finish();
    let fitted = fitted?;
    write_model(&fitted.model, output)?;
    context.notes(&fitted.notes);
    context.say("note: all states are known: nothing is fitted, and no library or partition is used; score the model by rollouts");
    let equations = equations(&fitted);
    context.print(
        KnownReport {
            rows: fitted.rows,
            episodes: fitted.episodes,
            files: fitted.files,
            equations: &equations,
            model: output.display().to_string(),
            hash: fitted.model.hash(),
            notes: &fitted.notes,
        },
        || {
            let text = format!("{} rows of {}", fitted.rows, count(fitted.episodes, "episode"));
            format!("{text}; every equation is given\n\n{}", equations.join("\n"))
        },
    );
    context.say(format!("wrote {}", output.display()));
    Ok(())
}

fn equations(known_model: &KnownModel) -> Vec<String> {
    known_model.model.equations.iter().map(|equation| format!("{} = {}", equation.label(), equation.right)).collect()
}
