//! `fleetfoot predict`.

use fleetfoot::Error;
use serde_json::json;

use super::{Context, files, read_by, read_model, time_changes};
use crate::args::Predict;

pub(crate) fn predict(arguments: &Predict, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model.model)?;
    let files = files(&arguments.model.data)?;
    let layouts = fleetfoot::layout_files(&arguments.output);
    let outputs: Vec<_> = std::iter::once(&arguments.output).chain(&layouts).cloned().collect();
    context.claim(&outputs, &read_by(&files, [&arguments.model.model]), false)?;
    let bar = context.bar();
    let written = fleetfoot::predict(&model, &time_changes(&arguments.model)?, &files, &arguments.output, &bar);
    bar.finish();
    let written = written?;
    context.notes(&written.notes);
    let path = arguments.output.display();
    context.print(
        &json!({
            "file": path.to_string(), "rows": written.rows, "predicted": written.predicted, "compared": written.compared,
            "outside_domain": written.outside_domain, "notes": written.notes,
        }),
        || {
            format!(
                "wrote {path}: {} rows, {} with a prediction, {} of them with a measured target; {} outside what their region saw in training",
                written.rows, written.predicted, written.compared, written.outside_domain
            )
        },
    );
    context.layouts(&layouts);
    Ok(())
}
