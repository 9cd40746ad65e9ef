//! `fleetfoot auto`.

use fleetfoot::{Auto, AutoOutput, Candidate, Error, Finding, Logs, auto as find, data::unstoppable, describe};

use super::{Context, files, flags, read_by};
use crate::{
    args::Auto as Arguments,
    table::{count, number, ratio, table},
};

/// Regions and coefficients of a model whose equations are printed.
const REGIONS: usize = 3;
const COEFFICIENTS: usize = 60;

pub(crate) fn auto(arguments: &Arguments, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.recipe)?;
    recipe.override_with(arguments.auto.clone());
    recipe.cache = flags::cache(&arguments.recipe.time.channels, &arguments.output);
    let files = files(&arguments.data)?;
    let output = AutoOutput { folder: arguments.output.clone(), force: arguments.force, c: arguments.export.is_some() };
    output.check(&read_by(&files, &arguments.recipe.recipe))?;
    let logs = Logs::from(&files);
    let bar = context.bar();
    let outcome = find(&recipe, &logs, &bar);
    bar.finish();
    let outcome = outcome?;
    // Also after a stop: what is done is written.
    let written = unstoppable(|| outcome.write(&output, &logs, &fleetfoot::Silent))?;
    if let (Some(warning), true) = (&outcome.warning, context.json) {
        context.say(format!("warning: {warning}"));
    }
    if outcome.stopped {
        let done = outcome.candidates.len();
        context.say(format!("note: stopped after {}: the best of them is written", count(done, "candidate")));
    }
    context.notes(&outcome.notes);
    context.print(outcome.to_json(), || to_text(&outcome, usize::MAX));
    for path in &written {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

/// The result for people, with so many of the best candidates beside those that all are compared with.
pub(crate) fn to_text(outcome: &Auto, best: usize) -> String {
    let mut text = outcome.warning.as_ref().map(|warning| format!("WARNING: {warning}\n\n")).unwrap_or_default();
    for Finding { place, what, .. } in outcome.checked.iter().flat_map(|checked| &checked.findings) {
        text.push_str(&format!("check: {place}: {what}\n"));
    }
    let folds = outcome.candidates.iter().map(|candidate| candidate.folds.len()).max().unwrap_or(0);
    text.push_str(&format!(
        "candidates: error of simulations of {} on rows that did not train, over that of persistence; mean and standard error of {folds} folds\n",
        count(outcome.horizon.steps, "step")
    ));
    let mut ranked: Vec<usize> = (0..outcome.candidates.len()).collect();
    let error = |&at: &usize| outcome.candidates[at].error.unwrap_or(f64::INFINITY);
    ranked.sort_by(|a, b| error(a).total_cmp(&error(b)));
    ranked.truncate(best);
    let is_shown =
        |at: &usize| *at == outcome.chosen || outcome.candidates[*at].coefficients == 0 || ranked.contains(at);
    let shown: Vec<usize> = (0..outcome.candidates.len()).filter(|at| best == usize::MAX || is_shown(at)).collect();
    let rows = shown.iter().map(|&at| row(&outcome.candidates[at], at == outcome.chosen));
    text.push_str(&table(&["candidate", "coefficients", "error", "+-", ""], rows.collect()));
    match outcome.candidates.len() - shown.len() {
        0 => {}
        left => text.push_str(&format!("\n  and {} more, with larger errors", count(left, "candidate"))),
    }
    text.push_str("\n\ntest: error of simulations on rows that neither fits nor the choice saw (root of the mean square; 95 % interval)\n");
    text.push_str(&tested(outcome));
    text.push_str(&equations(outcome));
    text.push('\n');
    for sentence in &outcome.sentences {
        text.push_str(&format!("\n{sentence}"));
    }
    text
}

fn row(candidate: &Candidate, chosen: bool) -> Vec<String> {
    let known = |value: Option<f64>| value.map_or_else(|| "-".into(), ratio);
    let mark = match (&candidate.reason, chosen) {
        (_, true) => "<- chosen".to_owned(),
        (Some(reason), false) => shortened(reason),
        (None, false) => String::new(),
    };
    let coefficients = if candidate.coefficients > 0 { candidate.coefficients.to_string() } else { "-".into() };
    vec![candidate.name.clone(), coefficients, known(candidate.error), known(candidate.standard_error), mark]
}

/// Letters of a reason that stand in a table.
const REASON: usize = 60;

fn shortened(reason: &str) -> String {
    match reason.char_indices().nth(REASON) {
        Some((at, _)) => format!("{}...", &reason[..at]),
        None => reason.to_owned(),
    }
}

fn tested(outcome: &Auto) -> String {
    let known = |value: Option<f64>| value.map_or_else(|| "-".into(), number);
    let rows = outcome.tested.iter().map(|state| {
        vec![
            state.state.clone(),
            state.unit.clone().unwrap_or_default(),
            number(state.rmse.value),
            format!("{} to {}", number(state.rmse.low), number(state.rmse.high)),
            known(state.linear),
            number(state.persistence),
            known(state.mean),
        ]
    });
    table(&["state", "unit", "model", "interval", "linear", "persistence", "mean"], rows.collect())
}

/// The equations of a model that a screen holds.
fn equations(outcome: &Auto) -> String {
    let model = &outcome.model;
    let regions = model.partitions.iter().map(|partition| partition.rule.count()).max().unwrap_or(1);
    if regions > REGIONS || outcome.candidates[outcome.chosen].coefficients > COEFFICIENTS {
        return String::new();
    }
    let text = describe(model, REGIONS);
    text.find("\nequations").map(|at| format!("\n\n{}", text[at + 1..].trim_end())).unwrap_or_default()
}
