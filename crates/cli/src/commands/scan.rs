//! `fleetfoot scan`.

use fleetfoot::{
    Error,
    statistic::{LabelKey, ScanOptions, ScanOutcome, ScanTarget, StatisticFile, plan_append, plan_scan, scan_to},
};
use serde::Serialize;
use serde_json::Value;

use super::{Context, files, flags, read_by, reading::reading};
use crate::{
    args::Scan,
    table::{bytes, count},
};

/// The statistic's file, and what was scanned into it.
#[derive(Serialize)]
struct ScanReport {
    file: String,
    #[serde(flatten)]
    scanned: Value,
}

pub(crate) fn scan(arguments: &Scan, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.recipe)?;
    if let Some(items) = &arguments.library {
        recipe.library.functions.clone_from(&items.0);
    }
    recipe.model.partition = arguments.partition.clone().or(recipe.model.partition.take());
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    recipe.cache = flags::cache(&arguments.recipe.time.channels, &arguments.output);
    let keys = arguments.key.iter().map(|text| text.parse::<LabelKey>()).collect::<Result<_, _>>()?;
    let options = ScanOptions { keys, chunk_rows: arguments.chunk_rows };
    let files = files(&arguments.data)?;
    let read = read_by(&files, arguments.plan.iter().chain(&arguments.recipe.recipe));
    context.claim(std::slice::from_ref(&arguments.output), &read, arguments.force)?;
    let bar = context.bar();
    if arguments.dry_run {
        let append = Some(&arguments.output).filter(|output| arguments.append && output.exists());
        let plan = match append.or(arguments.plan.as_ref()) {
            Some(base) => StatisticFile::read(base)
                .map_err(Into::into)
                .and_then(|base| plan_append(&base, &recipe, &options, &files, &bar)),
            None => plan_scan(&recipe, &options, &files, &bar),
        };
        bar.finish();
        let plan = plan?;
        context.notes(&plan.notes);
        context.print(&plan, || plan_text(&plan));
        return Ok(());
    }
    let target = ScanTarget {
        output: arguments.output.clone(),
        plan: arguments.plan.clone(),
        append: arguments.append,
        force: arguments.force,
    };
    let outcome = scan_to(&target, &recipe, &options, &files, &bar);
    bar.finish();
    let outcome = outcome?;
    context.notes(&outcome.report.notes);
    for skipped in &outcome.report.skipped {
        context.say(format!("skipped {skipped}"));
    }
    if outcome.resumed {
        context.say("continued the scan that was stopped");
    }
    let file = arguments.output.display().to_string();
    context.print(ScanReport { file, scanned: outcome.to_json() }, || to_text(&outcome));
    context.say(format!("wrote {}", arguments.output.display()));
    Ok(())
}

fn to_text(outcome: &ScanOutcome) -> String {
    let (file, report) = (&outcome.file, &outcome.report);
    let counts = file.scanned.counts();
    let before = outcome.before.map_or(String::new(), |before| format!(" (it was {})", bytes(before)));
    format!(
        "scanned {}, {}, {} rows\n{}: {} complete rows, {} at borders, {} incomplete; {} of at most {} rows\nserves without the logs: {}\n{}{before}",
        count(report.files, "file"),
        count(report.episodes, "episode"),
        report.rows,
        count(file.episodes.len(), "episode"),
        counts.complete,
        counts.at_border,
        counts.incomplete,
        count(file.chunks(), "chunk"),
        file.plan.chunk_rows,
        fleetfoot::statistic::serves(file).join(", "),
        bytes(outcome.sizes.total),
    )
}

fn plan_text(plan: &fleetfoot::statistic::ScanPlan) -> String {
    let latents: Vec<String> = plan
        .latents
        .iter()
        .map(|latent| format!("{} ({})", latent.name, count(latent.functions, "function")))
        .collect();
    format!(
        "{}\n{}: {}\n{}: {}\n{} over the rows; {} of at most {} rows; about {} of statistics",
        reading(&plan.reading, plan.skipped),
        count(plan.tasks.len(), "task"),
        plan.tasks.join(", "),
        count(plan.latents.len(), "latent"),
        latents.join(", "),
        if plan.equation_passes == 0 {
            "one pass".into()
        } else {
            format!("at most {} passes", 1 + plan.equation_passes)
        },
        count(plan.chunks, "chunk"),
        plan.chunk_rows,
        bytes((plan.bytes + plan.equation_bytes) as u64),
    )
}
