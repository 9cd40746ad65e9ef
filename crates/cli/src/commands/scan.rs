//! `fleetfoot scan`.

use fleetfoot::{
    Error,
    statistic::{LabelKey, ScanOptions, ScanOutcome, ScanTarget, StatisticFile, plan_scan, scan_to},
};
use serde_json::json;

use super::{Context, files, fit, read_by};
use crate::{
    args::Scan,
    table::{bytes, count},
};

pub(crate) fn scan(arguments: &Scan, context: &Context) -> Result<(), Error> {
    let mut recipe = fit::recipe(&arguments.recipe)?;
    if let Some(items) = &arguments.library {
        recipe.library.functions.clone_from(&items.0);
    }
    recipe.model.partition = arguments.partition.clone().or(recipe.model.partition.take());
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    recipe.cache = fit::cache(&arguments.recipe.time.channels, &arguments.output);
    let keys = arguments.key.iter().map(|text| text.parse::<LabelKey>()).collect::<Result<_, _>>()?;
    let options = ScanOptions { keys, chunk_rows: arguments.chunk_rows };
    let files = files(&arguments.data)?;
    let read = read_by(&files, arguments.plan.iter().chain(&arguments.recipe.recipe));
    context.claim(std::slice::from_ref(&arguments.output), &read, arguments.force)?;
    let bar = context.bar();
    if arguments.dry_run {
        let append = Some(&arguments.output).filter(|output| arguments.append && output.exists());
        let plan = match append.or(arguments.plan.as_ref()) {
            Some(base) => StatisticFile::read(base).and_then(|base| base.plan_append(&recipe, &options, &files, &bar)),
            None => plan_scan(&recipe, &options, &files, &bar),
        };
        bar.finish();
        let plan = plan?;
        context.notes(&plan.notes);
        context.print(&plan_json(&plan), || plan_text(&plan));
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
        context.say("went on where the same command was stopped");
    }
    context.print(&to_json(&outcome, &arguments.output), || to_text(&outcome));
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
        file.serves().join(", "),
        bytes(outcome.sizes.total),
    )
}

fn to_json(outcome: &ScanOutcome, output: &std::path::Path) -> serde_json::Value {
    let (file, report) = (&outcome.file, &outcome.report);
    let counts = file.scanned.counts();
    json!({
        "file": output.display().to_string(), "plan": file.plan_hash(), "serves": file.serves(), "resumed": outcome.resumed,
        "scanned": { "files": report.files, "episodes": report.episodes, "rows": report.rows },
        "skipped": report.skipped, "notes": report.notes,
        "files": file.files.len(), "episodes": file.episodes.len(), "chunks": file.chunks(), "chunk_rows": file.plan.chunk_rows,
        "rows": { "complete": counts.complete, "at_border": counts.at_border, "incomplete": counts.incomplete },
        "bytes": outcome.sizes.total, "bytes_before": outcome.before,
    })
}

fn plan_text(plan: &fleetfoot::statistic::ScanPlan) -> String {
    let decoded = match plan.decoded {
        None => String::new(),
        Some((size, true)) => format!("\n{} of decoded columns, in the cache already", bytes(size)),
        Some((size, false)) => format!("\none pass to decode them: {} of columns, less in the cache", bytes(size)),
    };
    let skipped = match plan.skipped {
        0 => String::new(),
        number => format!(" ({number} more are there already)"),
    };
    let latents: Vec<String> =
        plan.latents.iter().map(|(name, functions)| format!("{name} ({})", count(*functions, "function"))).collect();
    format!(
        "{}{skipped}, {}{} rows\n{} columns read: {}{decoded}\n{}: {}\n{}: {}\n{} over the rows; {} of at most {} rows; about {} of statistics",
        count(plan.files, "file"),
        plan.episodes.map_or("at most ".to_owned(), |episodes| format!("{}, ", count(episodes, "episode"))),
        plan.rows,
        plan.columns.len(),
        plan.columns.join(", "),
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

fn plan_json(plan: &fleetfoot::statistic::ScanPlan) -> serde_json::Value {
    json!({
        "files": plan.files, "skipped": plan.skipped, "episodes": plan.episodes, "rows": plan.rows, "columns": plan.columns, "tasks": plan.tasks,
        "latents": plan.latents.iter().map(|(name, functions)| json!({ "name": name, "functions": functions })).collect::<Vec<_>>(),
        "decoded_bytes": plan.decoded.map(|(bytes, _)| bytes), "cached": plan.decoded.map(|(_, cached)| cached),
        "passes": 1 + plan.equation_passes, "chunk_rows": plan.chunk_rows, "chunks": plan.chunks,
        "bytes": plan.bytes + plan.equation_bytes,
    })
}
