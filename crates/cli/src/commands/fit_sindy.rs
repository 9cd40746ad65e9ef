//! `fleetfoot fit sindy`.

use fleetfoot::{
    EquationReport, Error, FitRequest, FrontPoint, LimitReport, ParameterReport, ParameterSection, Recipe,
    RegionReport, Sindy, SindyReport, TargetBaselines, estimate::Uncertain,
};

use super::{Context, fit, fit::Job, flags};
use crate::{
    args::{EquationArgs, FitSindy},
    table::{count, number, ratio, table, text_table},
};

pub(crate) fn sindy(arguments: &FitSindy, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    apply(&mut recipe, &arguments.equations)?;
    recipe.override_with(arguments.sindy.clone());
    recipe.model.partition = arguments.partition.clone().or(recipe.model.partition.take());
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    let mut request = FitRequest::default();
    (request.horizon, request.rivals) = (flags::horizon(&recipe, arguments.horizon)?, arguments.front);
    let mut job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.known = true;
    job.run::<Sindy>(request, context, |fitted| to_text(&fitted[0].report, arguments.front), |_| None)
}

/// Flags stand above the recipe.
fn apply(recipe: &mut Recipe, arguments: &EquationArgs) -> Result<(), Error> {
    if let Some(items) = &arguments.library {
        recipe.library.functions.clone_from(&items.0);
    }
    for text in &arguments.nominal {
        let (name, expression) = flags::pair("--nominal", text)?;
        state(recipe, "--nominal", &name)?.nominal = Some(expression);
    }
    for text in &arguments.fixed {
        let (name, items) = flags::pair("--fixed", text)?;
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
    let (name, value) = flags::pair("--parameter", text)?;
    let (initial, bounds) = match value.split_once(" in ") {
        None => (value.as_str(), None),
        Some((initial, range)) => (initial, Some(range.split_once("..").ok_or_else(refused)?)),
    };
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| refused());
    let bounds = bounds.map(|(least, most)| Ok::<_, Error>([number(least)?, number(most)?])).transpose()?;
    Ok((name, ParameterSection { initial: number(initial)?, bounds, ..ParameterSection::default() }))
}

fn to_text(report: &SindyReport, front: bool) -> String {
    let summary = &report.summary;
    let [border, incomplete, unassigned] = [0, 1, 2].map(|at| summary.left_out.get(at).copied().unwrap_or(0));
    let none = if unassigned > 0 { format!(", {unassigned} in no region") } else { String::new() };
    let unit = if report.windows.is_some() { "windows" } else { "rows" };
    let mut text = format!(
        "{} {unit} of {}, {border} left out at borders, {incomplete} incomplete{none}; {}\n{}; {}\n",
        report.rows,
        count(summary.episodes, "episode"),
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
    if let Some(choice) = &summary.rollouts {
        text.push_str(&format!("{}\n", fit::by_rollouts(choice)));
    }
    if let Some(refinement) = &summary.refinement {
        text.push_str(&format!("{}\n", refinement.in_words()));
    }
    if let Some(by_time) = &summary.by_time {
        let equations = || report.regions.iter().flat_map(|region| &region.equations);
        let by_spans = |target: &str| match report.regions.len() {
            1 => equations().find(|equation| equation.label == target).map(|equation| 1.0 - equation.held_out_r2),
            _ => None,
        };
        text.push_str(&format!("{}\n", by_time.in_words(by_spans)));
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
        text.push_str(&format!("\n{}\n", scores(region, &summary.baselines, !report.limits.is_empty())));
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
fn scores(region: &RegionReport, baselines: &[TargetBaselines], bounded: bool) -> String {
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
        let baseline = baselines.iter().find(|baseline| baseline.target == equation.label);
        row.extend(
            baseline.into_iter().flat_map(|baseline| [plain(baseline.mean_rmse), plain(baseline.persistence_rmse)]),
        );
        row.extend(equation.free.iter().flat_map(|free| [plain(free.rms), plain(free.held_out)]));
        row
    });
    let mut header = vec!["equation", "terms", "error (rms)", "R2", "held out (rms)", "R2"];
    if !baselines.is_empty() {
        header.extend(["mean (rms)", "persistence (rms)"]);
    }
    if bounded {
        header.extend(["without bounds", "held out"]);
    }
    table(&header, rows.collect())
}

/// Orders and errors of derivatives by central differences.
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
