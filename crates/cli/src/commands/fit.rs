//! Steps that the commands of all fitting methods share: arguments, files, printed text.

use std::path::PathBuf;

use fleetfoot::{
    Error, FitPlan, FitReport, FitRequest, Fitted, Method, Recipe, Refinement, RolloutCandidate, RolloutChoice,
    fit_all, is_known, is_statistic, output::together, plan,
};
use serde::Serialize;
use serde_json::Value;

use super::{Context, fit_known, flags, logs_or_statistic, read_by, reading::reading};
use crate::{
    args::{FitData, FitOutput},
    table::{bytes, count, number, ratio, table},
};

/// Left sides that a plan names.
const SHOWN: usize = 12;

/// A fit that is asked for.
pub(crate) struct Job<'a> {
    recipe: Recipe,
    files: Vec<PathBuf>,
    /// All files that are read.
    read: Vec<PathBuf>,
    output: &'a FitOutput,
    /// True if a recipe that names all states is copied unchanged.
    pub(crate) known: bool,
    /// Files that are written beside the models.
    pub(crate) beside: Vec<PathBuf>,
}

impl<'a> Job<'a> {
    /// Of a recipe with all flags.
    pub(crate) fn new(mut recipe: Recipe, data: &FitData, output: &'a FitOutput) -> Result<Self, Error> {
        recipe.cache = flags::cache(&data.recipe.time.channels, &output.output);
        let files = logs_or_statistic(&data.data)?;
        let read = read_by(&files, &data.recipe.recipe);
        Ok(Self { recipe, files, read, output, known: false, beside: Vec::new() })
    }

    /// The logs.
    pub(crate) fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Files that are read beside the logs.
    pub(crate) fn reads(&mut self, files: &[PathBuf]) {
        self.read.extend_from_slice(files);
    }

    /// Plans or fits, writes the models, and prints what came of it: `text` of the fits, and `last` as the last note.
    pub(crate) fn run<M: Method>(
        self,
        request: FitRequest,
        context: &Context,
        text: impl FnOnce(&[Fitted<M::Report>]) -> String,
        last: impl FnOnce(&[Fitted<M::Report>]) -> Option<String>,
    ) -> Result<(), Error> {
        self.run_beside::<M>(request, context, |_| Ok(()), text, last)
    }

    /// The same, with more files that `write` writes together with the models.
    pub(crate) fn run_beside<M: Method>(
        self,
        mut request: FitRequest,
        context: &Context,
        write: impl FnOnce(&[Fitted<M::Report>]) -> Result<(), Error>,
        text: impl FnOnce(&[Fitted<M::Report>]) -> String,
        last: impl FnOnce(&[Fitted<M::Report>]) -> Option<String>,
    ) -> Result<(), Error> {
        let Self { recipe, files, read, output: FitOutput { keep_all, dry_run, output }, known, beside } = self;
        let first: Vec<PathBuf> = std::iter::once(output.clone()).chain(beside.iter().cloned()).collect();
        context.claim(&first, &read, false)?;
        if known && is_known(&recipe) && !dry_run && !is_statistic(&files) {
            return fit_known::known(&recipe, &files, output, context);
        }
        request.rivals |= keep_all;
        if *dry_run {
            let bar = context.bar();
            let planned = plan::<M>(&recipe, &request, &files, &bar);
            bar.finish();
            let planned = planned?;
            context.notes(&planned.notes);
            context.expect(planned.work.clone());
            context.print(&planned, || plan_text(&planned));
            return Ok(());
        }
        if let Some(words) = M::new(&recipe, &request)?.simulations() {
            context.say(format!("note: {words}"));
        }
        let bar = context.bar();
        let fitted = fit_all::<M>(&recipe, &request, &files, &bar);
        bar.finish();
        let mut fitted = fitted?;
        if !keep_all {
            fitted.iter_mut().for_each(|fit| fit.rivals.clear());
        }
        let mut written: Vec<PathBuf> = fitted.iter().flat_map(|fit| fit.files(output)).collect();
        if let Some(twice) =
            written.iter().enumerate().find_map(|(at, path)| written[..at].contains(path).then_some(path))
        {
            let problem = format!(
                "two models would both be written to {}; rename the label or candidate of one",
                twice.display()
            );
            return Err(Error::output(problem));
        }
        written.extend(beside);
        let new: Vec<PathBuf> = written.iter().filter(|path| !first.contains(path)).cloned().collect();
        context.claim(&new, &read, false)?;
        together(|| {
            fitted.iter().try_for_each(|fit| fit.write(output).map(|_| ()))?;
            write(&fitted)
        })?;
        for fit in &fitted {
            let value = fit.value.as_ref().map_or_else(String::new, |value| format!("{value}: "));
            let notes = fit.report.summary().notes.iter().map(|note| format!("{value}{note}"));
            context.notes(&notes.collect::<Vec<_>>());
        }
        let of = |fit: &Fitted<M::Report>| FitEntry {
            value: fit.value.clone(),
            report: fit.report.to_json(),
            model: fit.file(output).display().to_string(),
            hash: fit.model.hash(),
            seed: fit.model.training.seed,
        };
        let reports: Vec<FitEntry> = fitted.iter().map(of).collect();
        let text = || {
            let verdicts = fitted.iter().filter_map(|fit| {
                let value = fit.value.as_ref().map_or_else(String::new, |value| format!("{value}: "));
                Some(format!("{value}{}", fit.report.summary().verdict.as_ref()?))
            });
            // Last, above the prompt.
            let verdicts: Vec<String> = verdicts.collect();
            format!("{}\n\n{}", text(&fitted).trim_end(), verdicts.join("\n"))
        };
        match (reports.as_slice(), &request.by) {
            ([one], None) => context.print(one, text),
            (models, by) => context.print(ByValue { by: by.as_deref(), models }, text),
        }
        if let Some(last) = last(&fitted) {
            context.say(last);
        }
        for path in &written {
            context.say(format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// JSON report of a fit, with the name of the written model.
#[derive(Serialize)]
struct FitEntry {
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<String>,
    #[serde(flatten)]
    report: Value,
    model: String,
    hash: String,
    seed: u64,
}

/// Results by the value of a label.
#[derive(Serialize)]
struct ByValue<'a> {
    by: Option<&'a str>,
    models: &'a [FitEntry],
}

/// Text of the plan of a fit: files to read, memory and work.
fn plan_text(plan: &FitPlan) -> String {
    let some: Vec<&str> = plan.equations.iter().take(SHOWN).map(String::as_str).collect();
    let more = if plan.equations.len() > some.len() { ", ..." } else { "" };
    let mut lines = vec![reading(&plan.reading, 0)];
    if plan.passes == 0 {
        lines.push("no pass over rows".to_owned());
        lines.extend_from_slice(&plan.details);
        return lines.join("\n");
    }
    lines.push(format!("fitted: {}{more}", some.join(", ")));
    let passes = if plan.passes == 1 { "one pass".to_owned() } else { format!("{} passes", plan.passes) };
    lines.push(format!(
        "{}, {}, {passes} over the rows",
        count(plan.candidates, "candidate function"),
        count(plan.regions, "region")
    ));
    lines.extend(plan.details.iter().chain(&plan.simulations).cloned());
    lines.push(format!("about {} of memory", bytes(plan.memory as u64)));
    lines.join("\n")
}

/// Result of a fit to simulations, printed above the table of candidates.
pub(crate) fn refined_over_candidates(refinement: &Refinement) -> String {
    format!("{}\nThe table below compares models fitted one step ahead.\n\n", refinement.in_words())
}

/// Errors one step ahead, on the spans that did not train, of the model that was fitted to simulations.
pub(crate) fn refined_held_out(refinement: &Refinement, targets: &[String]) -> String {
    let row = |(at, name): (usize, &String)| {
        let [rmse, r2] = refinement.held_out(at);
        vec![name.clone(), number(rmse), ratio(r2)]
    };
    let rows = targets.iter().enumerate().map(row).collect();
    table(&["held out, one step, of the written model", "RMSE", "R2"], rows)
}

/// Table of the candidates' rollout errors.
pub(crate) fn by_rollouts(choice: &RolloutChoice) -> String {
    let over = choice.candidates.iter().any(|candidate| candidate.over.is_some());
    let mut header = vec!["partition", "terms", "rollouts over persistence", "worst fold", ""];
    if over {
        header.insert(1, "derivative");
    }
    let row = |(at, candidate): (usize, &RolloutCandidate)| {
        let worst = candidate.folds.iter().copied().fold(0.0, f64::max);
        let mut row =
            vec![candidate.partition.clone(), candidate.size.to_string(), ratio(candidate.error()), ratio(worst)];
        row.push(if at == choice.chosen { "<- chosen".into() } else { String::new() });
        if over {
            row.insert(1, candidate.over.map_or_else(|| "central".into(), |rows| format!("over {rows} rows")));
        }
        row
    };
    let rows = choice.candidates.iter().enumerate().map(row).collect();
    format!("chosen: {}\n{}", choice.in_words(), table(&header, rows))
}
