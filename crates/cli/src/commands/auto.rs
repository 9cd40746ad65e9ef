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
    recipe.say(arguments.auto.clone());
    recipe.cache = flags::cache(&arguments.recipe.time.channels, &arguments.output);
    let files = files(&arguments.data)?;
    let output = AutoOutput { folder: arguments.output.clone(), force: arguments.force, c: arguments.export.is_some() };
    output.check(&read_by(&files, &arguments.recipe.recipe))?;
    let logs = Logs::from(&files);
    let bar = context.bar();
    let found = find(&recipe, &logs, &bar);
    bar.finish();
    let found = found?;
    // Also after a stop: what is done is written.
    let written = unstoppable(|| found.write(&output, &logs, &fleetfoot::Silent))?;
    if let (Some(warning), true) = (&found.warning, context.json) {
        context.say(format!("warning: {warning}"));
    }
    if found.stopped {
        let done = found.candidates.len();
        context.say(format!("note: stopped after {}: the best of them is written", count(done, "candidate")));
    }
    context.notes(&found.notes);
    context.print(found.to_json(), || to_text(&found, usize::MAX));
    for path in &written {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

/// The result for people, with so many of the best candidates beside those that all are compared with.
pub(crate) fn to_text(found: &Auto, best: usize) -> String {
    let mut text = found.warning.as_ref().map(|warning| format!("WARNING: {warning}\n\n")).unwrap_or_default();
    for Finding { place, what, .. } in found.checked.iter().flat_map(|checked| &checked.findings) {
        text.push_str(&format!("check: {place}: {what}\n"));
    }
    let folds = found.candidates.iter().map(|own| own.folds.len()).max().unwrap_or(0);
    text.push_str(&format!(
        "candidates: error of simulations of {} on rows that did not train, over that of persistence; mean and standard error of {folds} folds\n",
        count(found.horizon.steps, "step")
    ));
    let mut ranked: Vec<usize> = (0..found.candidates.len()).collect();
    let error = |&at: &usize| found.candidates[at].error.unwrap_or(f64::INFINITY);
    ranked.sort_by(|a, b| error(a).total_cmp(&error(b)));
    ranked.truncate(best);
    let is_shown = |at: &usize| *at == found.chosen || found.candidates[*at].coefficients == 0 || ranked.contains(at);
    let shown: Vec<usize> = (0..found.candidates.len()).filter(|at| best == usize::MAX || is_shown(at)).collect();
    let rows = shown.iter().map(|&at| row(&found.candidates[at], at == found.chosen));
    text.push_str(&table(&["candidate", "coefficients", "error", "+-", ""], rows.collect()));
    match found.candidates.len() - shown.len() {
        0 => {}
        left => text.push_str(&format!("\n  and {} more, with larger errors", count(left, "candidate"))),
    }
    text.push_str("\n\ntest: error of simulations on rows that neither fits nor the choice saw (root of the mean square; 95 % interval)\n");
    text.push_str(&tested(found));
    text.push_str(&equations(found));
    text.push('\n');
    for sentence in &found.sentences {
        text.push_str(&format!("\n{sentence}"));
    }
    text
}

fn row(own: &Candidate, chosen: bool) -> Vec<String> {
    let known = |value: Option<f64>| value.map_or_else(|| "-".into(), ratio);
    let mark = match (&own.reason, chosen) {
        (_, true) => "<- chosen".to_owned(),
        (Some(reason), false) => shortened(reason),
        (None, false) => String::new(),
    };
    let coefficients = if own.coefficients > 0 { own.coefficients.to_string() } else { "-".into() };
    vec![own.name.clone(), coefficients, known(own.error), known(own.standard_error), mark]
}

/// Letters of a reason that stand in a table.
const REASON: usize = 60;

fn shortened(reason: &str) -> String {
    match reason.char_indices().nth(REASON) {
        Some((at, _)) => format!("{}...", &reason[..at]),
        None => reason.to_owned(),
    }
}

fn tested(found: &Auto) -> String {
    let known = |value: Option<f64>| value.map_or_else(|| "-".into(), number);
    let rows = found.tested.iter().map(|own| {
        vec![
            own.state.clone(),
            own.unit.clone().unwrap_or_default(),
            number(own.rmse.value),
            format!("{} to {}", number(own.rmse.low), number(own.rmse.high)),
            known(own.linear),
            number(own.persistence),
            known(own.mean),
        ]
    });
    table(&["state", "unit", "model", "interval", "linear", "persistence", "mean"], rows.collect())
}

/// The equations of a model that a screen holds.
fn equations(found: &Auto) -> String {
    let model = &found.model;
    let regions = model.partitions.iter().map(|own| own.rule.count()).max().unwrap_or(1);
    if regions > REGIONS || found.candidates[found.chosen].coefficients > COEFFICIENTS {
        return String::new();
    }
    let text = describe(model, REGIONS);
    text.find("\nequations").map(|at| format!("\n\n{}", text[at + 1..].trim_end())).unwrap_or_default()
}
