//! `fleetfoot import`.

use fleetfoot::{Error, ImportedModel, Logs, Recipe, import_network, write_model};
use serde::Serialize;

use super::{Context, logs_or_statistic, read_by};
use crate::{args::Import, table::count};

#[derive(Serialize)]
struct ImportReport<'a> {
    inputs: &'a [String],
    outputs: &'a [String],
    hidden: Option<&'a str>,
    model: String,
    hash: String,
    notes: &'a [String],
}

pub(crate) fn import(arguments: &Import, context: &Context) -> Result<(), Error> {
    let recipe = Recipe::read(&arguments.recipe)?;
    let files = if arguments.data.is_empty() { Vec::new() } else { logs_or_statistic(&arguments.data)? };
    let read = read_by(&files, [&arguments.network, &arguments.recipe]);
    context.claim(std::slice::from_ref(&arguments.output), &read, false)?;
    let logs = (!files.is_empty()).then(|| Logs::from(files.as_slice()));
    let bar = context.bar();
    let imported = import_network(&arguments.network, &recipe, logs.as_ref(), arguments.dt, &bar);
    bar.finish();
    let imported = imported?;
    write_model(&imported.model, &arguments.output)?;
    context.notes(&imported.notes);
    let report = ImportReport {
        inputs: &imported.inputs,
        outputs: &imported.outputs,
        hidden: imported.hidden.as_deref(),
        model: arguments.output.display().to_string(),
        hash: imported.model.hash(),
        notes: &imported.notes,
    };
    context.print(report, || to_text(&imported));
    context.say(format!("wrote {}", arguments.output.display()));
    Ok(())
}

fn to_text(imported: &ImportedModel) -> String {
    let layers = imported.hidden.as_ref().map_or_else(|| "an affine map".into(), |hidden| format!("network {hidden}"));
    format!(
        "{layers}\n{}: {}\n{}: {}",
        count(imported.inputs.len(), "input"),
        imported.inputs.join(", "),
        count(imported.outputs.len(), "output"),
        imported.outputs.join(", ")
    )
}
