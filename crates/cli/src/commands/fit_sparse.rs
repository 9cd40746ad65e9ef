//! `fleetfoot fit sparse`.

use std::path::PathBuf;

use fleetfoot::{
    CandidateReport, Error, LatentReport, LeaveOneOutReport, LimitReport, ReadPlan, Recipe, SparseFitted,
    SparseOptions, SparseReport, SparseRequest, file_by_value, fit_sparse, is_statistic,
    output::together,
    statistic::{LabelKey, PlannedLatent, ScanOptions, ScanPlan, StatisticFile, plan_scan},
    write_frequencies, write_model,
};
use serde::Serialize;

use super::{Context, WithModel, fit, logs_or_statistic, read_by, reading::reading};
use crate::{
    args::FitSparse,
    table::{bytes, count, number, ratio, table, text_table},
};

/// Tables of functions have their intervals while they are not wider.
const WIDTH: usize = 100;
/// Influential episodes that are shown; JSON has all.
const MOST_EPISODES: usize = 10;

pub(crate) fn sparse(arguments: &FitSparse, context: &Context) -> Result<(), Error> {
    let mut recipe = fit::recipe(&arguments.recipe)?;
    recipe.say(arguments.sparse.clone());
    recipe.cache = fit::cache(&arguments.recipe.time.channels, &arguments.output);
    let files = logs_or_statistic(&arguments.data)?;
    let read = read_by(&files, &arguments.recipe.recipe);
    let beside = || arguments.keep.iter().chain(&arguments.frequencies).cloned();
    context.claim(&std::iter::once(arguments.output.clone()).chain(beside()).collect::<Vec<_>>(), &read, false)?;
    let keys = arguments.key.iter().map(|text| text.parse::<LabelKey>()).collect::<Result<Vec<_>, _>>()?;
    if arguments.dry_run {
        return dry_run(&recipe, &ScanOptions { keys, chunk_rows: None }, &files, context);
    }
    let request =
        SparseRequest { keys, by: arguments.by.clone(), keep: arguments.keep.clone(), influence: arguments.influence };
    let bar = context.bar();
    let fitted = fit_sparse(&recipe, &request, &files, &bar);
    bar.finish();
    let fitted = fitted?;
    let mut written: Vec<PathBuf> = fitted.iter().map(|found| path_of(found, arguments)).collect();
    if let Some(twice) = written.iter().enumerate().find_map(|(at, path)| written[..at].contains(path).then_some(path))
    {
        let problem = format!("two values of the label would both be written to {}; rename one", twice.display());
        return Err(Error::output(problem));
    }
    fleetfoot::output::check_outputs(&written.iter().cloned().chain(beside()).collect::<Vec<_>>(), &read)?;
    together(|| {
        fitted.iter().zip(&written).try_for_each(|(found, path)| write_model(&found.model, path))?;
        match &arguments.frequencies {
            Some(path) => write_frequencies(path, arguments.by.as_deref(), &fitted, &files),
            None => Ok(()),
        }
    })?;
    written.extend(arguments.frequencies.clone());
    written.extend(arguments.keep.clone());
    for found in &fitted {
        let value = found.value.as_ref().map_or_else(String::new, |value| format!("{value}: "));
        context.notes(&found.report.notes.iter().map(|note| format!("{value}{note}")).collect::<Vec<_>>());
    }
    tell(&fitted, arguments, context);
    for path in &written {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

fn path_of(found: &SparseFitted, arguments: &FitSparse) -> PathBuf {
    found.value.as_ref().map_or_else(|| arguments.output.clone(), |value| file_by_value(&arguments.output, value))
}

/// What a fit on a statistic would take: no pass over rows.
#[derive(Serialize)]
struct PlannedOnStatistic {
    files: usize,
    episodes: usize,
    rows: u64,
    passes: usize,
    chunks: usize,
}

/// What a fit on logs would take: one pass, of which only the sums of the structured regression are kept.
#[derive(Serialize)]
struct Planned<'a> {
    #[serde(flatten)]
    reading: &'a ReadPlan,
    passes: usize,
    tasks: &'a [String],
    latents: &'a [PlannedLatent],
    chunks: usize,
    chunk_rows: usize,
    bytes: usize,
    operations: f64,
}

impl<'a> From<&'a ScanPlan> for Planned<'a> {
    fn from(plan: &'a ScanPlan) -> Self {
        Self {
            reading: &plan.reading,
            passes: 1,
            tasks: &plan.tasks,
            latents: &plan.latents,
            chunks: plan.chunks,
            chunk_rows: plan.chunk_rows,
            bytes: plan.bytes,
            operations: 0.0,
        }
    }
}

fn dry_run(recipe: &Recipe, options: &ScanOptions, files: &[PathBuf], context: &Context) -> Result<(), Error> {
    if let (true, [path]) = (is_statistic(files), files) {
        let file = StatisticFile::read(path)?;
        let rows = file.scanned.counts().complete;
        context.print(
            PlannedOnStatistic { files: 1, episodes: file.episodes.len(), rows, passes: 0, chunks: file.chunks() },
            || {
                format!(
                    "{}, {rows} rows, {}; no pass",
                    count(file.episodes.len(), "episode"),
                    count(file.chunks(), "chunk")
                )
            },
        );
        return Ok(());
    }
    let bar = context.bar();
    let plan = plan_scan(recipe, options, files, &bar);
    bar.finish();
    let plan = plan?;
    context.notes(&plan.notes);
    let coefficients = plan.latents.iter().map(|own| own.functions).sum();
    let work = SparseOptions::new(&recipe.sparse)?.planned_work(coefficients, plan.reading.episodes);
    context.expect(work);
    let latents: Vec<String> = plan.latents.iter().map(|own| format!("{} ({})", own.name, own.functions)).collect();
    context.print(Planned { operations: work.operations, ..Planned::from(&plan) }, || {
        format!(
            "{}\ntasks: {}\nlatents and their functions: {}\none pass over the rows; {} of at most {} rows, about {}",
            reading(&plan.reading, 0),
            plan.tasks.join(", "),
            latents.join(", "),
            count(plan.chunks, "chunk"),
            plan.chunk_rows,
            bytes(plan.bytes as u64)
        )
    });
    Ok(())
}

fn to_text(fitted: &[SparseFitted], arguments: &FitSparse) -> String {
    let mut text = String::new();
    match (fitted, &arguments.by) {
        ([one], None) => text.push_str(&one_text(&one.report)),
        (_, label) => {
            let label = label.as_deref().unwrap_or_default();
            for found in fitted {
                let value = found.value.as_deref().unwrap_or_default();
                text.push_str(&format!("{label} {value}: {}\n", summary(&found.report)));
            }
            text.push_str(&by_value(fitted, label));
            for found in fitted {
                let value = found.value.as_deref().unwrap_or_default();
                if let Some(influence) = &found.report.influence {
                    text.push_str(&format!("\n\n{label} {value}: {}", influence_text(influence)));
                }
            }
        }
    }
    text
}

fn summary(report: &SparseReport) -> String {
    let candidates = || report.latents.iter().flat_map(|latent| &latent.candidates);
    format!(
        "{} rows of {}, lambda {} ({}), {} of {} columns by {}",
        report.rows,
        count(report.episodes, "episode"),
        number(report.lambda.value),
        report.lambda.how,
        candidates().filter(|candidate| candidate.selected).count(),
        candidates().count(),
        report.selection,
    )
}

fn one_text(report: &SparseReport) -> String {
    let [border, incomplete] = report.left_out;
    let mut text = format!(
        "{}\n{border} rows left out at borders, {incomplete} incomplete; the {} at lambda: optimality conditions to {:.1e}, duality gap {:.1e}\n",
        summary(report),
        report.penalty,
        report.certificate.kkt,
        report.certificate.gap
    );
    let rows = report.tasks.iter().map(|task| {
        let name = if task.prior {
            format!("{} (strength {})", task.name, number(task.weight * task.scale * task.scale))
        } else {
            task.name.clone()
        };
        let plain = |value: f64| if value.is_nan() { "-".to_owned() } else { number(value) };
        let r2 = if task.r2.is_nan() { "-".to_owned() } else { format!("{:.6}", task.r2) };
        let mut row = vec![name, number(task.scale), plain(task.rms), r2, plain(task.held_out)];
        row.extend(task.free.iter().flat_map(|free| [plain(free.rms), plain(free.held_out)]));
        row
    });
    let mut header = vec!["task", "scale", "error (rms)", "R2", "held out"];
    if !report.limits.is_empty() {
        header.extend(["without bounds", "held out"]);
    }
    text.push_str(&table(&header, rows.collect()));
    if !report.limits.is_empty() {
        text.push_str(&format!("\n\n{}", text_table(&LimitReport::table(&report.limits))));
    }
    let tables = |intervals: bool| -> Vec<String> {
        report.latents.iter().map(|latent| latent_table(latent, intervals)).collect()
    };
    let all = tables(report.latents.iter().any(has_intervals));
    let fits = all.iter().flat_map(|table| table.lines()).all(|line| line.chars().count() <= WIDTH);
    let tables = if fits { all } else { tables(false) };
    for (latent, table) in report.latents.iter().zip(tables) {
        let used = latent.candidates.iter().filter(|candidate| candidate.selected).count();
        text.push_str(&format!("\n\n{}: {used} of {} functions\n{table}", latent.name, latent.candidates.len()));
    }
    for group in &report.confounded {
        text.push_str(&format!("\n\nhard to tell apart: {}", group.join(" ~ ")));
    }
    if let Some(influence) = &report.influence {
        text.push_str(&format!("\n\n{}", influence_text(influence)));
    }
    text
}

fn has_intervals(latent: &LatentReport) -> bool {
    latent.candidates.iter().any(|candidate| candidate.interval.is_some())
}

/// The selected functions of a latent; empty when there are none.
fn latent_table(latent: &LatentReport, intervals: bool) -> String {
    let row = |candidate: &CandidateReport| {
        let frequency = candidate.frequency.map_or_else(|| "-".into(), ratio);
        let mut row = vec![
            candidate.function.clone(),
            number(candidate.coefficient),
            number(candidate.standard_error),
            frequency,
        ];
        if intervals {
            row.push(
                candidate
                    .interval
                    .map_or_else(|| "-".into(), |[low, high]| format!("{} to {}", number(low), number(high))),
            );
        }
        row
    };
    let rows: Vec<Vec<String>> = latent.candidates.iter().filter(|candidate| candidate.selected).map(row).collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut header = vec!["function", "coefficient", "standard error", "frequency"];
    if intervals {
        header.push("95 % of lassos");
    }
    table(&header, rows)
}

/// The errors in and out of sample, and the most influential episodes.
fn influence_text(influence: &LeaveOneOutReport) -> String {
    let shown = &influence.episodes[..influence.episodes.len().min(MOST_EPISODES)];
    let rows = shown.iter().map(|episode| {
        let change = episode.largest_change.as_ref();
        vec![
            episode.name.clone(),
            format!("{:.1} %", 100.0 * episode.share),
            number(episode.distance),
            number(episode.held_out),
            number(episode.in_sample),
            change.map_or_else(|| "-".into(), |(name, change)| format!("{change:+.2} of {name}")),
        ]
    });
    let header = ["left out", "rows", "Cook's distance", "held out", "in sample", "largest change (standard errors)"];
    format!(
        "errors of all tasks in their scales (rms): {} with every episode predicted by the others, {} in sample\n\
         {} of {}, by Cook's distance:\n{}",
        number(influence.held_out),
        number(influence.in_sample),
        shown.len(),
        count(influence.episodes.len(), "episode"),
        table(&header, rows.collect())
    )
}

/// Selection frequencies (or 1 for selected, where there are no replicates): their mean, in how many fits the function is selected, and a character a value of the
/// label, in the order of the lines above.
fn by_value(fitted: &[SparseFitted], label: &str) -> String {
    let Some(first) = fitted.first() else { return String::new() };
    let strip = format!("by {label} (tenths, # is always)");
    let mut rows = Vec::new();
    for (index, latent) in first.report.latents.iter().enumerate() {
        for (at, candidate) in latent.candidates.iter().enumerate() {
            let candidates: Vec<&CandidateReport> =
                fitted.iter().map(|found| &found.report.latents[index].candidates[at]).collect();
            let frequency = |found: &CandidateReport| found.frequency.unwrap_or(f64::from(u8::from(found.selected)));
            let mean = candidates.iter().map(|found| frequency(found)).sum::<f64>() / candidates.len() as f64;
            let selected = candidates.iter().filter(|found| found.selected).count();
            let shades: String = candidates.iter().map(|found| tenths(frequency(found))).collect();
            rows.push(vec![
                latent.name.clone(),
                candidate.function.clone(),
                ratio(mean),
                format!("{selected} of {}", candidates.len()),
                shades,
            ]);
        }
    }
    table(&["latent", "function", "mean frequency", "selected", &strip], rows)
}

fn tenths(frequency: f64) -> char {
    match frequency {
        f if f <= 0.0 => '.',
        f if f >= 1.0 => '#',
        f => char::from_digit((f * 10.0) as u32, 10).unwrap_or('9'),
    }
}

/// What was found by the value of a label.
#[derive(Serialize)]
struct ByValue<'a> {
    by: Option<&'a str>,
    models: Vec<Found<'a>>,
}

#[derive(Serialize)]
struct Found<'a> {
    value: Option<&'a str>,
    #[serde(flatten)]
    fitted: WithModel,
}

impl<'a> Found<'a> {
    fn new(found: &'a SparseFitted, arguments: &FitSparse) -> Self {
        let fitted = WithModel::new(found.report.to_json(), &found.model, &path_of(found, arguments));
        Self { value: found.value.as_deref(), fitted }
    }
}

fn tell(fitted: &[SparseFitted], arguments: &FitSparse, context: &Context) {
    let text = || to_text(fitted, arguments);
    match (fitted, arguments.by.as_deref()) {
        ([one], None) => context.print(Found::new(one, arguments), text),
        (_, by) => {
            let models = fitted.iter().map(|found| Found::new(found, arguments)).collect();
            context.print(ByValue { by, models }, text);
        }
    }
}
