//! `fleetfoot fit sindy`.

use std::path::PathBuf;

use fleetfoot::{
    EquationReport, Error, FrontPoint, LimitReport, ParameterReport, ParameterSection, Recipe, RegionReport, SindyPlan,
    SindyReport, SindyRequest, estimate::Uncertain, fit_sindy, is_known, is_statistic, output::together, plan_sindy,
    write_model,
};

use super::{Context, WithModel, fit, fit_known, logs_or_statistic, read_by, reading::reading};
use crate::{
    args::{EquationArgs, FitSindy},
    table::{bytes, count, number, ratio, table, text_table},
};

pub(crate) fn sindy(arguments: &FitSindy, context: &Context) -> Result<(), Error> {
    let mut recipe = fit::recipe(&arguments.recipe)?;
    apply(&mut recipe, &arguments.equations)?;
    recipe.say(arguments.sindy.clone());
    recipe.model.partition = arguments.partition.clone().or(recipe.model.partition.take());
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    recipe.cache = fit::cache(&arguments.recipe.time.channels, &arguments.output);
    let files = logs_or_statistic(&arguments.data)?;
    let read = read_by(&files, &arguments.recipe.recipe);
    context.claim(std::slice::from_ref(&arguments.output), &read, false)?;
    if is_known(&recipe) && !arguments.dry_run && !is_statistic(&files) {
        return fit_known::known(&recipe, &files, &arguments.output, context);
    }
    if arguments.dry_run {
        return dry_run(&recipe, &files, context);
    }
    fit::say_passes(recipe.sindy.objective, (1, false), context);
    let bar = context.bar();
    let horizon = fit::horizon(&recipe, arguments.horizon)?;
    let request = SindyRequest { front: arguments.front || arguments.keep_front, horizon };
    let fitted = fit_sindy(&recipe, request, &files, &bar);
    bar.finish();
    let fitted = fitted?;
    let mut written = vec![arguments.output.clone()];
    if arguments.keep_front {
        context.claim(&fitted.front_files(&arguments.output), &read, false)?;
    }
    together(|| {
        write_model(&fitted.model, &arguments.output)?;
        if arguments.keep_front {
            written.extend(fitted.write_front(&arguments.output)?);
        }
        Ok::<_, Error>(())
    })?;
    context.notes(&fitted.report.notes);
    let told = WithModel::new(fitted.report.to_json(), &fitted.model, &arguments.output);
    context.print(told, || to_text(&fitted.report, arguments.front));
    for path in &written {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

/// Flags stand above the recipe.
fn apply(recipe: &mut Recipe, arguments: &EquationArgs) -> Result<(), Error> {
    if let Some(items) = &arguments.library {
        recipe.library.functions.clone_from(&items.0);
    }
    for text in &arguments.nominal {
        let (name, expression) = fit::pair("--nominal", text)?;
        state(recipe, "--nominal", &name)?.nominal = Some(expression);
    }
    for text in &arguments.fixed {
        let (name, items) = fit::pair("--fixed", text)?;
        let items: crate::args::List =
            items.parse().map_err(|problem| Error::value(format!("--fixed {text}: {problem}")))?;
        state(recipe, "--fixed", &name)?.fixed = items.0;
    }
    for text in &arguments.parameter {
        let (name, section) = parameter(text)?;
        recipe.parameters.insert(name, section);
    }
    Ok(())
}

fn state<'a>(recipe: &'a mut Recipe, flag: &str, name: &str) -> Result<&'a mut fleetfoot::State, Error> {
    let known: Vec<String> = recipe.states.keys().cloned().collect();
    recipe.states.get_mut(name).ok_or_else(|| {
        let near = fleetfoot::data::nearest(name, known.iter().map(String::as_str));
        let near = fleetfoot::data::did_you_mean(&near);
        Error::unknown(name, format!("{flag}: `{name}` is not a state{near}"))
    })
}

/// `tau=0.05`, `tau=0.05 in 0.01..0.3`.
pub(super) fn parameter(text: &str) -> Result<(String, ParameterSection), Error> {
    let refused = || {
        Error::value(format!(
            "--parameter {text}: write NAME=VALUE, or NAME=VALUE in LEAST..GREATEST: `tau=0.05 in 0.01..0.3`"
        ))
    };
    let (name, value) = fit::pair("--parameter", text)?;
    let (initial, bounds) = match value.split_once(" in ") {
        None => (value.as_str(), None),
        Some((initial, range)) => (initial, Some(range.split_once("..").ok_or_else(refused)?)),
    };
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| refused());
    let bounds = bounds.map(|(least, most)| Ok::<_, Error>([number(least)?, number(most)?])).transpose()?;
    Ok((name, ParameterSection { initial: number(initial)?, bounds, ..ParameterSection::default() }))
}

fn dry_run(recipe: &Recipe, files: &[PathBuf], context: &Context) -> Result<(), Error> {
    let bar = context.bar();
    let plan = plan_sindy(recipe, files, &bar);
    bar.finish();
    let plan = plan?;
    context.notes(&plan.notes);
    context.expect(plan.work);
    context.print(&plan, || plan_text(&plan));
    Ok(())
}

fn plan_text(plan: &SindyPlan) -> String {
    let parameters = match plan.parameters.as_slice() {
        [] => String::new(),
        names => format!("\nestimated first, a pass a step: {}", names.join(", ")),
    };
    let simulations =
        fleetfoot::simulation_cost(plan.objective, 1, false).map_or_else(String::new, |words| format!("\n{words}"));
    let smoothing = plan.smoothing.map_or_else(String::new, |most| {
        format!(
            "\nstates are smoothed where --smooth-states asks for it, or noise is more than a fifth of what differences vary by: some hundred passes over rows in memory, {} of it at most",
            bytes(most as u64)
        )
    });
    let some: Vec<&str> = plan.candidates.iter().take(12).map(String::as_str).collect();
    let more = if plan.candidates.len() > some.len() { ", ..." } else { "" };
    format!(
        "{}\n{}: {}\n{}: {}{more}{parameters}{simulations}{smoothing}\n{}, about {} of memory",
        reading(&plan.reading, 0),
        count(plan.equations.len(), "equation"),
        plan.equations.join(", "),
        count(plan.candidates.len(), "candidate"),
        some.join(", "),
        count(plan.regions, "region"),
        bytes(plan.memory as u64),
    )
}

fn to_text(report: &SindyReport, front: bool) -> String {
    let [border, incomplete, unassigned] = report.left_out;
    let none = if unassigned > 0 { format!(", {unassigned} in no region") } else { String::new() };
    let unit = if report.windows.is_some() { "windows" } else { "rows" };
    let mut text = format!(
        "{} {unit} of {}, {border} left out at borders, {incomplete} incomplete{none}; {}\n{}; {}\n",
        report.rows,
        count(report.episodes, "episode"),
        count(report.candidates.len(), "candidate"),
        report.method,
        report.choice,
    );
    if let Some(ensemble) = &report.ensemble {
        text.push_str(&format!("{ensemble}\n"));
    }
    if let Some(windows) = &report.windows {
        text.push_str(&format!("{windows}\n"));
    }
    if let Some(smoothing) = &report.smoothing {
        text.push_str(&format!("{}\n", smoothing.in_words()));
    }
    if let Some(choice) = &report.rollouts {
        text.push_str(&format!("{}\n", fit::by_rollouts(choice)));
    }
    if let Some(refinement) = &report.refinement {
        text.push_str(&format!("{}\n", refinement.in_words()));
    }
    for parameter in &report.parameters {
        text.push_str(&format!("{}\n", parameter_text(parameter)));
    }
    if !report.limits.is_empty() {
        text.push_str(&format!("\n{}\n", text_table(&LimitReport::table(&report.limits))));
    }
    for region in &report.regions {
        if report.regions.len() > 1 {
            text.push_str(&format!("\nregion {} ({} {unit})\n", region.name, region.rows));
        }
        text.push('\n');
        for equation in &region.equations {
            text.push_str(&format!("{} = {}\n", equation.label, equation.right));
        }
        text.push_str(&format!("\n{}\n", scores(region, !report.limits.is_empty())));
        text.push_str(&format!("\n{}\n", terms(region)));
        if let Some(differences) = differences(region) {
            text.push_str(&format!("\n{differences}\n"));
        }
        for equation in &region.equations {
            for group in &equation.confounded {
                text.push_str(&format!("\n{}: hard to tell apart: {}\n", equation.label, group.join(" ~ ")));
            }
            if front {
                text.push_str(&format!("\n{}: error by number of terms\n{}\n", equation.label, front_text(equation)));
            }
        }
    }
    text
}

fn parameter_text(parameter: &ParameterReport) -> String {
    let unit = parameter.unit.as_ref().map_or_else(String::new, |unit| format!(" {unit}"));
    let bound = if parameter.at_bound { " (at its bound)" } else { "" };
    format!(
        "{} = {}{unit}{bound}",
        parameter.name,
        Uncertain { value: parameter.value, error: parameter.standard_error }
    )
}

/// `bounded`: beside them the errors without bounds of coefficients.
fn scores(region: &RegionReport, bounded: bool) -> String {
    let plain = |value: f64| if value.is_nan() { "-".to_owned() } else { number(value) };
    let share = |value: f64| if value.is_nan() { "-".to_owned() } else { format!("{value:.6}") };
    let rows = region.equations.iter().map(|equation| {
        let mut row = vec![
            equation.label.clone(),
            format!("{} of {}", equation.terms.len(), equation.candidates),
            number(equation.rms),
            share(equation.r2),
            number(equation.held_out),
            share(equation.held_out_r2),
        ];
        row.extend(equation.free.iter().flat_map(|free| [plain(free.rms), plain(free.held_out)]));
        row
    });
    let mut header = vec!["equation", "terms", "error (rms)", "R2", "held out (rms)", "R2"];
    if bounded {
        header.extend(["without bounds", "held out"]);
    }
    table(&header, rows.collect())
}

/// How derivatives by central differences were measured, and what they err by.
fn differences(region: &RegionReport) -> Option<String> {
    let row = |equation: &EquationReport| {
        let errors = equation.difference?;
        let mut row = vec![equation.label.clone(), errors.order.to_string()];
        row.extend(errors.by_order.iter().chain([&errors.noise]).map(|&value| number(value)));
        Some(row)
    };
    let rows: Vec<Vec<String>> = region.equations.iter().filter_map(row).collect();
    let header = ["central differences", "order", "error of order 2", "4", "6", "by noise"];
    (!rows.is_empty()).then(|| table(&header, rows))
}

fn terms(region: &RegionReport) -> String {
    let all = || region.equations.iter().flat_map(|equation| &equation.terms);
    let with_inclusion = all().any(|term| term.inclusion.is_some());
    let with_unit = all().any(|term| term.unit.is_some());
    let mut header = vec!["equation", "term", "coefficient", "standard error"];
    if with_unit {
        header.push("unit");
    }
    if with_inclusion {
        header.push("inclusion");
    }
    let mut rows = Vec::new();
    for equation in &region.equations {
        for (at, term) in equation.terms.iter().enumerate() {
            let label = if at == 0 { equation.label.clone() } else { String::new() };
            let fixed = if term.fixed { " (fixed)" } else { "" };
            let mut row =
                vec![label, format!("{}{fixed}", term.function), six(term.coefficient), number(term.standard_error)];
            if with_unit {
                row.push(term.unit.clone().unwrap_or_else(|| "-".into()));
            }
            if with_inclusion {
                row.push(term.inclusion.map_or_else(|| "-".into(), ratio));
            }
            rows.push(row);
        }
    }
    table(&header, rows)
}

/// Six significant digits.
fn six(value: f64) -> String {
    let magnitude = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if (-4..6).contains(&magnitude) {
        format!("{value:.*}", (5 - magnitude).max(0) as usize)
    } else {
        format!("{value:.5e}")
    }
}

fn front_text(equation: &EquationReport) -> String {
    let row = |point: &FrontPoint| {
        let chosen = if point.chosen { "<- chosen" } else { "" };
        vec![
            point.terms.to_string(),
            number(point.rms),
            number(point.held_out),
            number(point.parameter),
            point.functions.join(", "),
            chosen.to_owned(),
        ]
    };
    let header = ["terms", "error (rms)", "held out (rms)", "parameter", "functions", ""];
    table(&header, equation.front.iter().map(row).collect())
}
