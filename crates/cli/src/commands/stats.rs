//! `fleetfoot stats`.

use std::path::{Path, PathBuf};

use fleetfoot::{
    Error,
    statistic::{Sizes, StatisticFile, TaskSummary, Unwanted},
};
use serde::Serialize;

use super::{Context, is_replaced};
use crate::{
    args::{Stats, StatsCompact, StatsDrop, StatsInfo, StatsMerge},
    table::{bytes, count, number, ratio, table},
};

pub(crate) fn stats(arguments: &Stats, context: &Context) -> Result<(), Error> {
    match arguments {
        Stats::Info(arguments) => info(arguments, context),
        Stats::Merge(arguments) => merge(arguments, context),
        Stats::Drop(arguments) => drop(arguments, context),
        Stats::Compact(arguments) => compact(arguments, context),
    }
}

fn info(arguments: &StatsInfo, context: &Context) -> Result<(), Error> {
    let (file, sizes) = StatisticFile::read_with_sizes(&arguments.file)?;
    let tasks = file.task_summaries();
    context.print(fleetfoot::statistic::description(&file, &sizes, &tasks), || {
        let mut text = info_text(&file, &sizes, &tasks);
        if arguments.episodes {
            text.push_str(&episodes_text(&file));
        }
        if arguments.recipe {
            text.push_str(&format!("\n\nplan\n{}\nrecipe\n{}", file.plan_text(), file.recipe));
        }
        text
    });
    if file.is_partial() {
        context.say("note: an interrupted scan left this file; the same scan command continues from it");
    }
    Ok(())
}

fn info_text(file: &StatisticFile, sizes: &Sizes, tasks: &[TaskSummary]) -> String {
    let counts = file.scanned.counts();
    let rows = tasks
        .iter()
        .map(|task| {
            vec![
                if task.prior { format!("{} (prior)", task.name) } else { task.name.clone() },
                task.columns.to_string(),
                task.rank.to_string(),
                number(task.condition),
                number(task.preconditioned),
                number(task.deviation),
                ratio(task.r2),
                task.equation.clone(),
            ]
        })
        .collect();
    let header = ["task", "columns", "rank", "condition", "preconditioned", "sigma", "R2", "equation"];
    let latents = &file.plan.regression.latents;
    let latents: Vec<String> = latents
        .iter()
        .map(|latent| format!("{} ({})", latent.name, count(latent.functions.len(), "function")))
        .collect();
    let mut text = format!(
        "{}, {}: {} complete rows, {} at borders, {} incomplete\n{} of at most {} rows; plan {}; fleetfoot {}\n{}\nlatents: {}\nserves without the logs: {}",
        count(file.files.len(), "file"),
        count(file.episodes.len(), "episode"),
        counts.complete,
        counts.at_border,
        counts.incomplete,
        count(file.chunks(), "chunk"),
        file.plan.chunk_rows,
        file.plan_hash(),
        file.version,
        table(&header, rows),
        latents.join(", "),
        fleetfoot::statistic::serves(file).join(", "),
    );
    for (label, values) in file.by_label() {
        let rows = values
            .iter()
            .map(|(value, (episodes, rows))| vec![value.clone(), episodes.to_string(), rows.to_string()])
            .collect();
        text.push_str(&format!("\n{}", table(&[label.as_str(), "episodes", "rows"], rows)));
    }
    text.push_str(&format!("\n{}: {}", bytes(sizes.total), sections(sizes).join(", ")));
    text
}

/// Sizes by section; the tasks' together.
fn sections(sizes: &Sizes) -> Vec<String> {
    let mut sums: Vec<(&str, u64)> = Vec::new();
    for (name, size) in &sizes.sections {
        match sums.iter_mut().find(|(known, _)| known == name) {
            Some((_, sum)) => *sum += size,
            None => sums.push((name, *size)),
        }
    }
    sums.into_iter().map(|(name, size)| format!("{name} {}", bytes(size))).collect()
}

fn episodes_text(file: &StatisticFile) -> String {
    let rows = file
        .episodes
        .iter()
        .map(|episode| {
            let counts = file.scanned.rows.get(&episode.id).copied().unwrap_or_default();
            let labels: Vec<String> = episode.labels.iter().map(|(name, value)| format!("{name}={value}")).collect();
            let source = file.file_of(episode).map_or_else(String::new, |file| file.name.clone());
            let [rows, complete] = [episode.rows, counts.complete].map(|count| count.to_string());
            vec![episode.name.clone(), rows, complete, labels.join(" "), episode.id.to_string(), source]
        })
        .collect();
    format!("\n{}", table(&["episode", "rows", "complete", "labels", "identity", "file"], rows))
}

fn merge(arguments: &StatsMerge, context: &Context) -> Result<(), Error> {
    claim(context, &arguments.output, &arguments.files, arguments.force)?;
    let mut inputs = arguments.files.iter();
    let Some(first) = inputs.next() else { return Err(Error::missing("no file is given".into())) };
    let (mut whole, sizes) = StatisticFile::read_with_sizes(first)?;
    let mut before = vec![sizes.total];
    for path in inputs {
        let (part, sizes) = StatisticFile::read_with_sizes(path)?;
        // Files already joined go by the first one's name.
        whole.merge(&first.display().to_string(), part, &path.display().to_string())?;
        before.push(sizes.total);
    }
    let sizes = whole.write(&arguments.output)?;
    let done = Done { merged: Some(arguments.files.len()), ..Done::default() };
    let text = format!("merged {}", count(arguments.files.len(), "file"));
    tell(context, &whole, (done, text), before.iter().sum(), &sizes, &arguments.output);
    Ok(())
}

fn drop(arguments: &StatsDrop, context: &Context) -> Result<(), Error> {
    claim(context, &arguments.output, std::slice::from_ref(&arguments.input), arguments.force)?;
    let (mut file, before) = StatisticFile::read_with_sizes(&arguments.input)?;
    let mut unwanted: Vec<Unwanted> = arguments.episode.iter().cloned().map(Unwanted::Episode).collect();
    unwanted.extend(arguments.file.iter().cloned().map(Unwanted::File));
    for text in &arguments.label {
        let Some((name, value)) = text.split_once('=') else {
            return Err(Error::value(format!("--where {text}: write LABEL=VALUE")));
        };
        unwanted.push(Unwanted::Label(name.trim().to_owned(), value.trim().to_owned()));
    }
    let names = file.drop_episodes(&unwanted)?;
    let sizes = file.write(&arguments.output)?;
    let some: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
    let more = if names.len() > 8 { ", ..." } else { "" };
    let text = format!("dropped {}: {}{more}", count(names.len(), "episode"), some.join(", "));
    let done = Done { dropped: Some(&names), ..Done::default() };
    tell(context, &file, (done, text), before.total, &sizes, &arguments.output);
    Ok(())
}

fn compact(arguments: &StatsCompact, context: &Context) -> Result<(), Error> {
    claim(context, &arguments.output, std::slice::from_ref(&arguments.file), arguments.force)?;
    let (mut file, before) = StatisticFile::read_with_sizes(&arguments.file)?;
    let chunks = file.chunks();
    file.compact();
    let sizes = file.write(&arguments.output)?;
    let text = format!(
        "{} became {}, one for each {}; bootstrap of blocks and folds within an episode are no longer possible",
        count(chunks, "chunk"),
        file.chunks(),
        arguments.by
    );
    let done = Done { chunks_before: Some(chunks), ..Done::default() };
    tell(context, &file, (done, text), before.total, &sizes, &arguments.output);
    Ok(())
}

fn claim(context: &Context, output: &PathBuf, inputs: &[PathBuf], force: bool) -> Result<(), Error> {
    context.claim(std::slice::from_ref(output), inputs, force)?;
    if is_replaced(output) && !force {
        let problem = format!("{} exists already; --force replaces it", output.display());
        return Err(Error::output(problem));
    }
    Ok(())
}

/// Result of an operation: joined files, removed episodes, chunks before joining.
#[derive(Default, Serialize)]
struct Done<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    merged: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dropped: Option<&'a [String]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    chunks_before: Option<usize>,
}

#[derive(Serialize)]
struct StatsReport<'a> {
    #[serde(flatten)]
    done: Done<'a>,
    file: String,
    episodes: usize,
    chunks: usize,
    bytes_before: u64,
    bytes: u64,
}

/// Prints the result of an operation with the sizes before and after.
fn tell(
    context: &Context,
    file: &StatisticFile,
    (done, text): (Done<'_>, String),
    before: u64,
    sizes: &Sizes,
    output: &Path,
) {
    let report = StatsReport {
        done,
        file: output.display().to_string(),
        episodes: file.episodes.len(),
        chunks: file.chunks(),
        bytes_before: before,
        bytes: sizes.total,
    };
    context.print(report, || {
        format!(
            "{text}\n{}, {} complete rows, {}\n{} before, {} now",
            count(file.episodes.len(), "episode"),
            file.scanned.counts().complete,
            count(file.chunks(), "chunk"),
            bytes(before),
            bytes(sizes.total)
        )
    });
    context.say(format!("wrote {}", output.display()));
}
