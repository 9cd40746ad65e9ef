//! `fleetfoot fit parameters`.

use fleetfoot::{
    Error, EstimateMethod, FitRequest, GainInterval, LimitReport, ParameterInterval, Parameters, ParametersReport,
    estimate::Uncertain,
};

use super::{Context, fit::Job, fit_sindy, flags};
use crate::{
    args::FitParameters,
    table::{count, number, table, text_table},
};

pub(crate) fn parameters(arguments: &FitParameters, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    for text in &arguments.parameter {
        let (name, section) = fit_sindy::parameter(text)?;
        recipe.parameters.insert(name, section);
    }
    recipe.override_with(arguments.estimate.clone());
    let job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.run::<Parameters>(FitRequest::default(), context, |fitted| to_text(&fitted[0].report), |_| None)
}

fn to_text(report: &ParametersReport) -> String {
    let mut text =
        format!("{} rows of {}; {}\n", report.rows, count(report.summary.episodes, "episode"), method_text(report));
    let rows = report.parameters.iter().map(row).collect();
    let header = ["parameter", "estimate", "95 % interval", "unit", ""];
    text.push_str(&format!("\n{}\n", table(&header, rows)));
    let of = match report.method {
        EstimateMethod::EquationError => "the equation residuals",
        EstimateMethod::FilterError => "the innovations",
        EstimateMethod::OutputError => "the measurement noise",
    };
    let noise: Vec<String> = report.noise.iter().map(|(name, value)| format!("{name} {}", number(*value))).collect();
    text.push_str(&format!("\nStandard deviation of {of}: {}{}\n", noise.join(", "), correlated(report)));
    if !report.free_noise.is_empty() {
        let free: Vec<String> = report.free_noise.iter().map(|value| number(*value)).collect();
        text.push_str(&format!("Without bounds of matrices: {}\n", free.join(", ")));
    }
    if !report.limits.is_empty() {
        text.push_str(&format!("\n{}\n", text_table(&LimitReport::table(&report.limits))));
    }
    if !report.gains.is_empty() {
        let gains: Vec<String> = report.gains.iter().map(gain).collect();
        text.push_str(&format!("Gains, from 0 (output error) to 1 (equation error): {}\n", gains.join(", ")));
    }
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

/// A gain with its interval.
fn gain(interval: &GainInterval) -> String {
    if interval.at_bound || !interval.standard_error.is_finite() {
        return format!(
            "{} {} ({})",
            interval.name,
            number(interval.value),
            if interval.at_bound { "bound" } else { "not determined" }
        );
    }
    let [low, high] = interval.interval.map(number);
    let uncertain = Uncertain { value: interval.value, error: interval.standard_error };
    format!("{} {uncertain} ({low} to {high})", interval.name)
}

/// The largest correlation of innovations.
fn correlated(report: &ParametersReport) -> String {
    let covariance = &report.innovations;
    let of = |i: usize, j: usize| covariance[i][j] / (covariance[i][i] * covariance[j][j]).sqrt();
    let pairs = (0..covariance.len()).flat_map(|i| (0..i).map(move |j| (of(i, j), i, j)));
    match pairs.filter(|pair| pair.0.is_finite()).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())) {
        Some((correlation, i, j)) => {
            format!("; correlation of {} and {} {correlation:.2}", report.gains[j].name, report.gains[i].name)
        }
        None => String::new(),
    }
}

/// The method and what it went over.
fn method_text(report: &ParametersReport) -> String {
    let Some([segments, missing]) = report.segments else {
        return "equation error: derivatives of the states, row by row".to_owned();
    };
    let (name, corrected) = match report.method {
        EstimateMethod::FilterError => ("filter error", " and corrected by the measurements"),
        _ => ("output error", ""),
    };
    let left = if missing == 0 { String::new() } else { format!(", {missing} left out for missing values") };
    format!("{name}: {}{left}, each from an estimated initial state{corrected}", count(segments, "segment"))
}

fn row(parameter: &ParameterInterval) -> Vec<String> {
    let interval = match (parameter.fixed, parameter.determined) {
        (true, _) => String::new(),
        (_, false) => "any".to_owned(),
        _ => format!("{} to {}", number(parameter.interval[0]), number(parameter.interval[1])),
    };
    let estimate = match parameter.fixed || parameter.at_bound || !parameter.determined {
        true => number(parameter.value),
        false => Uncertain { value: parameter.value, error: parameter.standard_error }.to_string(),
    };
    let note = match (parameter.fixed, parameter.at_bound, parameter.determined) {
        (true, ..) => "fixed",
        (_, true, _) => "at its bound",
        (.., false) => "not determined",
        _ => "",
    };
    vec![parameter.name.clone(), estimate, interval, parameter.unit.clone().unwrap_or_default(), note.to_owned()]
}
