//! `fleetfoot fit sparse`.

use fleetfoot::{
    CandidateReport, Error, FitRequest, Fitted, LatentReport, LeaveOneOutReport, LimitReport, Sparse, SparseReport,
    statistic::LabelKey, write_frequencies,
};

use super::{Context, fit::Job, flags};
use crate::{
    args::FitSparse,
    table::{count, number, ratio, table, text_table},
};

/// Tables of functions have their intervals while they are not wider.
const WIDTH: usize = 100;
/// Influential episodes that are shown; JSON has all.
const MOST_EPISODES: usize = 10;

pub(crate) fn sparse(arguments: &FitSparse, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    recipe.override_with(arguments.sparse.clone());
    let request = FitRequest {
        keys: arguments.key.iter().map(|text| text.parse::<LabelKey>()).collect::<Result<_, _>>()?,
        by: arguments.by.clone(),
        keep: arguments.keep.clone(),
        influence: arguments.influence,
        ..FitRequest::default()
    };
    let mut job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.beside = arguments.frequencies.iter().chain(&arguments.keep).cloned().collect();
    let files = job.files().to_vec();
    let write = |fitted: &[SparseFitted]| match &arguments.frequencies {
        Some(path) => write_frequencies(path, arguments.by.as_deref(), fitted, &files),
        None => Ok(()),
    };
    job.run_beside::<Sparse>(request, context, write, |fitted| to_text(fitted, arguments), |_| None)
}

type SparseFitted = Fitted<SparseReport>;

fn to_text(fitted: &[SparseFitted], arguments: &FitSparse) -> String {
    let mut text = String::new();
    match (fitted, &arguments.by) {
        ([one], None) => text.push_str(&one_text(&one.report)),
        (_, label) => {
            let label = label.as_deref().unwrap_or_default();
            for fit in fitted {
                let value = fit.value.as_deref().unwrap_or_default();
                text.push_str(&format!("{label} {value}: {}\n", summary(&fit.report)));
            }
            text.push_str(&by_value(fitted, label));
            for fit in fitted {
                let value = fit.value.as_deref().unwrap_or_default();
                if let Some(influence) = &fit.report.influence {
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
        count(report.summary.episodes, "episode"),
        number(report.lambda.value),
        report.lambda.how,
        candidates().filter(|candidate| candidate.selected).count(),
        candidates().count(),
        report.selection,
    )
}

fn one_text(report: &SparseReport) -> String {
    let [border, incomplete] = [0, 1].map(|at| report.summary.left_out.get(at).copied().unwrap_or(0));
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
                fitted.iter().map(|fit| &fit.report.latents[index].candidates[at]).collect();
            let frequency =
                |candidate: &CandidateReport| candidate.frequency.unwrap_or(f64::from(u8::from(candidate.selected)));
            let mean = candidates.iter().map(|candidate| frequency(candidate)).sum::<f64>() / candidates.len() as f64;
            let selected = candidates.iter().filter(|candidate| candidate.selected).count();
            let shades: String = candidates.iter().map(|candidate| tenths(frequency(candidate))).collect();
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
