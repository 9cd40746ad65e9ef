//! `fleetfoot fit parameters`.

use fleetfoot::{
    Error, EstimateMethod, ParameterInterval, ParametersReport, estimate::Uncertain, fit_parameters, write_model,
};
use serde_json::json;

use super::{Context, fit, fit_sindy, logs_or_statistic, read_by, with};
use crate::{
    args::FitParameters,
    table::{count, number, table},
};

pub(crate) fn parameters(arguments: &FitParameters, context: &Context) -> Result<(), Error> {
    let mut recipe = fit::recipe(&arguments.recipe)?;
    for text in &arguments.parameter {
        let (name, section) = fit_sindy::parameter(text)?;
        recipe.parameters.insert(name, section);
    }
    recipe.say(arguments.estimate.clone());
    recipe.cache = fit::cache(&arguments.recipe.time.channels, &arguments.output);
    let data = logs_or_statistic(&arguments.data)?;
    context.claim(std::slice::from_ref(&arguments.output), &read_by(&data, &arguments.recipe.recipe), false)?;
    let bar = context.bar();
    let fitted = fit_parameters(&recipe, &data, &bar);
    bar.finish();
    let fitted = fitted?;
    write_model(&fitted.model, &arguments.output)?;
    context.notes(&fitted.report.notes);
    let model = json!({ "model": arguments.output.display().to_string(), "hash": fitted.model.hash() });
    context.print(&with(fitted.report.to_json(), model), || to_text(&fitted.report));
    context.say(format!("wrote {}", arguments.output.display()));
    Ok(())
}

fn to_text(report: &ParametersReport) -> String {
    let mut text = format!("{} rows of {}; {}\n", report.rows, count(report.episodes, "episode"), how(report));
    let rows = report.parameters.iter().map(row).collect();
    let header = ["parameter", "estimate", "95 % interval", "unit", ""];
    text.push_str(&format!("\n{}\n", table(&header, rows)));
    let of = match report.method {
        EstimateMethod::EquationError => "what the equations leave",
        _ => "noise of the measurements",
    };
    let noise: Vec<String> = report.noise.iter().map(|(name, value)| format!("{name} {}", number(*value))).collect();
    text.push_str(&format!("\nStandard deviation of {of}: {}\n", noise.join(", ")));
    if let Some(held) = &report.held_out {
        text.push_str(&format!(
            "Held out ({} folds): rollouts of {} steps over persistence {}; {} of {} ended early\n",
            held.folds.len(),
            held.horizon,
            number(held.share()),
            held.ended,
            held.starts
        ));
    }
    report.warnings().iter().for_each(|warning| text.push_str(&format!("{warning}\n")));
    format!("{text}\n{}", report.equations.join("\n"))
}

/// The method and what it went over.
fn how(report: &ParametersReport) -> String {
    match report.segments {
        None => "equation error: the derivatives of the states row by row".to_owned(),
        Some([segments, missing]) => {
            let left = if missing == 0 { String::new() } else { format!(", {missing} left out for missing values") };
            format!("output error: {}{left}, each from a beginning of its own", count(segments, "segment"))
        }
    }
}

fn row(own: &ParameterInterval) -> Vec<String> {
    let interval = match (own.fixed, own.determined) {
        (true, _) => String::new(),
        (_, false) => "any".to_owned(),
        _ => format!("{} to {}", number(own.interval[0]), number(own.interval[1])),
    };
    let estimate = match own.fixed || own.at_bound || !own.determined {
        true => number(own.value),
        false => Uncertain { value: own.value, error: own.standard_error }.to_string(),
    };
    let note = match (own.fixed, own.at_bound, own.determined) {
        (true, ..) => "fixed",
        (_, true, _) => "at its bound",
        (.., false) => "not determined",
        _ => "",
    };
    vec![own.name.clone(), estimate, interval, own.unit.clone().unwrap_or_default(), note.to_owned()]
}
