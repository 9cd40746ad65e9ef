//! `fleetfoot export`.

use fleetfoot::{
    Error, Model, Recipe,
    codegen::{Cost, ExportOptions, Precision, StepMethod, Target},
    made_controller,
};
use serde::Serialize;

use super::{Context, read_model};
use crate::args::{Export, ExportMethod, ExportPrecision, ExportTo};

/// The files, and what their code takes.
#[derive(Serialize)]
struct ExportReport<'a> {
    files: &'a [String],
    compared: usize,
    cost: Option<&'a Cost>,
}

/// The files of a filter.
#[derive(Serialize)]
struct Written<'a> {
    files: &'a [String],
}

/// The filter of a model.
fn filter(model: &Model, arguments: &Export, options: &ExportOptions, context: &Context) -> Result<(), Error> {
    let recipe = arguments.recipe.as_ref().map(|path| Recipe::read(path)).transpose()?.unwrap_or_default();
    let inputs: Vec<_> = arguments.recipe.iter().chain([&arguments.model]).cloned().collect();
    let files = fleetfoot::export_filter(model, &recipe.filter, options, &arguments.output, &inputs)?;
    let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    context.print(Written { files: &files }, || format!("wrote {}", files.join(", ")));
    Ok(())
}

pub(crate) fn export(arguments: &Export, context: &Context) -> Result<(), Error> {
    let controller = made_controller(&arguments.model)?;
    let mut options = ExportOptions::new(match arguments.to {
        ExportTo::C => Target::C,
        ExportTo::Rust => Target::Rust,
        ExportTo::Python => Target::Python,
        ExportTo::Latex => Target::Latex,
        ExportTo::Npz => Target::Npz,
        ExportTo::Onnx => Target::Onnx,
    });
    options.precision = match arguments.precision {
        ExportPrecision::Float => Precision::Float,
        ExportPrecision::Double => Precision::Double,
    };
    options.method = match arguments.method {
        ExportMethod::Euler => StepMethod::Euler,
        ExportMethod::Rk4 => StepMethod::Rk4,
    };
    options.prefix.clone_from(&arguments.prefix);
    options.discretize = arguments.discretize;
    // A controller has no training domain.
    options.domain = controller.is_none() && !arguments.no_domain;
    if arguments.filter {
        return filter(&read_model(&arguments.model)?, arguments, &options, context);
    }
    let before: Vec<_> = std::fs::read_dir(&arguments.output)
        .map(|entries| entries.flatten().map(|entry| entry.path()).collect())
        .unwrap_or_default();
    let inputs = std::slice::from_ref(&arguments.model);
    let exported = match &controller {
        Some(made) => fleetfoot::export_controller(made, &options, &arguments.output, inputs)?,
        None => fleetfoot::export(&read_model(&arguments.model)?, &options, &arguments.output, inputs)?,
    };
    for file in exported.files.iter().filter(|file| before.contains(file)) {
        context.say(format!("note: {} was there and is replaced", file.display()));
    }
    let files: Vec<String> = exported.files.iter().map(|file| file.display().to_string()).collect();
    context.print(ExportReport { files: &files, compared: exported.compared, cost: exported.cost.as_ref() }, || {
        let mut lines = vec![format!("wrote {}", files.join(", "))];
        if let Some(cost) = &exported.cost {
            lines.push(format!("compared with the engine at {} points", exported.compared));
            lines.extend(cost.lines());
        }
        lines.join("\n")
    });
    Ok(())
}
