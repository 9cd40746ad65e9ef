//! `fleetfoot predict`.

use fleetfoot::{Error, Written};
use serde::Serialize;

use super::{Context, files, read_by, read_model, time_changes};
use crate::args::Predict;

/// The file, and what it has.
#[derive(Serialize)]
struct PredictReport<'a> {
    file: String,
    #[serde(flatten)]
    written: &'a Written,
}

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
        PredictReport { file: path.to_string(), written: &written },
        || {
            format!(
                "wrote {path}: {} rows, {} with a prediction, {} of them with a measured target; {} outside the training range of their region",
                written.rows, written.predicted, written.compared, written.outside_domain
            )
        },
    );
    context.layouts(&layouts);
    Ok(())
}
