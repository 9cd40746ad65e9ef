//! `fleetfoot fit narx`.

use fleetfoot::{
    Error, FileRuns, FitRequest, Narx, NarxCandidate, NarxReport, NarxScores, NarxSearch, Recipe, dynamics::Baseline,
    replayed_in_words,
};

use super::{Context, files, fit, fit::Job, flags};
use crate::{
    args::FitNarx,
    table::{count, number, ratio, table},
};

/// Models that are shown of those tried.
const BEST: usize = 10;

pub(crate) fn narx(arguments: &FitNarx, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    apply(&mut recipe, arguments);
    if let Some(partition) = &arguments.partition {
        recipe.model.partition = Some(partition.clone());
    }
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    let free_run = if arguments.free_run.is_empty() { Vec::new() } else { files(&arguments.free_run)? };
    let mut job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.reads(&free_run);
    let request = FitRequest { free_run: (&free_run).into(), ..FitRequest::default() };
    job.run::<Narx>(request, context, |fitted| to_text(&fitted[0].report, arguments.tried), |_| None)
}

/// Flags stand above the recipe.
fn apply(recipe: &mut Recipe, arguments: &FitNarx) {
    for output in arguments.outputs.iter().flat_map(|list| &list.0) {
        recipe.states.entry(output.clone()).or_default();
    }
    if let Some(items) = &arguments.library {
        recipe.library.functions.clone_from(&items.0);
    }
    recipe.override_with(arguments.narx.clone());
}

fn to_text(report: &NarxReport, tried: bool) -> String {
    let mut text = format!(
        "{} rows of {}; {} at the border of an episode and {} with a missing value left out\nNARX, {}: {}; {}\n",
        report.rows,
        count(report.summary.episodes, "episode"),
        report.summary.left_out[0],
        report.summary.left_out[1],
        report.order,
        count(report.candidates, "candidate"),
        if report.regions.len() > 1 {
            format!("{} regions by {}", report.regions.len(), report.partition)
        } else {
            "one region".into()
        },
    );
    if let Some(choice) = &report.choice {
        text.push_str(&format!("chosen by {choice}\n"));
    }
    if let Some(refinement) = &report.summary.refinement {
        text.push_str(&format!("\n{}", fit::refined_over_candidates(refinement)));
    }
    if let Some(search) = &report.search {
        text.push_str(&format!("\n{}\n", search_text(search)));
    }
    if let Some(refinement) = report.summary.refinement.as_ref().filter(|refined| refined.written) {
        let targets: Vec<String> = report.regions[0].equations.iter().map(|equation| equation.label.clone()).collect();
        text.push_str(&format!("\n{}\n", fit::refined_held_out(refinement, &targets)));
    }
    if let Some(held_out) = &report.held_out {
        text.push_str(&format!("\n{}\n", held_out_text(held_out, report.linear.as_ref())));
    }
    if let Some(by_time) = &report.summary.by_time {
        text.push_str(&format!("\none step ahead, {}\n", by_time.in_words(|_| None)));
    }
    if !report.tried.is_empty() {
        text.push_str(&format!(
            "\n{}\n",
            tried_table(&report.tried, if tried { usize::MAX } else { BEST }, report.train.as_ref())
        ));
    }
    if report.tried.iter().filter(|one| one.front).count() > 1 {
        text.push_str(&format!("\n{}\n", front_table(&report.tried)));
    }
    if let Some(search) = &report.orders {
        text.push_str(&format!("\n{}\n", orders_table(search, if tried { usize::MAX } else { BEST })));
    }
    for region in &report.regions {
        if report.regions.len() > 1 {
            let shared = if region.shared { ", terms of all rows" } else { "" };
            text.push_str(&format!("\nregion {} ({} rows{shared})", region.name, region.rows));
        }
        for equation in &region.equations {
            let rows = equation
                .terms
                .iter()
                .map(|term| vec![term.function.clone(), number(term.coefficient), share(term.err)])
                .collect();
            text.push_str(&format!("\n{}\n", table(&[&equation.label, "coefficient", "ERR %"], rows)));
        }
    }
    for (name, scores) in [("training rows", report.train.as_ref()), ("rows kept back", report.test.as_ref())] {
        if let Some(scores) = scores {
            text.push_str(&format!("\n{}\n", scores_table(name, scores)));
        }
    }
    if let Some(files) = &report.files {
        text.push_str(&format!("\n{}\n", files_text(files)));
    }
    text
}

/// The stages of a search, and what its effort cut.
fn search_text(search: &NarxSearch) -> String {
    let rows = search.stages.iter().map(|stage| {
        vec![
            stage.name.clone(),
            stage.orders.to_string(),
            stage.models.to_string(),
            error(stage.rrse),
            fit_percent(stage.rrse),
        ]
    });
    let header = format!("effort {}", search.effort.word());
    let table = table(&[&header, "orders", "models", "least RRSE, held out", "FIT %"], rows.collect());
    let cut = match search.cut.as_slice() {
        [] => "nothing was cut".to_owned(),
        [first, ..] => {
            format!("{} cut, from {first} on: --effort high goes further", count(search.cut.len(), "order"))
        }
    };
    let share = 100.0 * search.spent as f64 / search.limit as f64;
    format!("{table}\n  {share:.0} % of {:.1e} terms evaluated; {cut}", search.limit as f64)
}

/// Held-out errors of the written model, a number for each held-out span.
fn held_out_text(held_out: &NarxCandidate, linear: Option<&NarxCandidate>) -> String {
    if let Some(loss) = held_out.loss {
        let spans: Vec<String> = held_out.losses.iter().map(|&loss| ratio(loss)).collect();
        return format!("held out, one step: squared error over variance {} (spans {})", ratio(loss), spans.join(", "));
    }
    let of = |candidate: &NarxCandidate| {
        let folds: Vec<String> = candidate.folds.iter().map(|&rrse| fit_percent(rrse)).collect();
        format!("FIT {} % (RRSE {}; spans {})", fit_percent(candidate.rrse), error(candidate.rrse), folds.join(", "))
    };
    let mut text = format!("held out, free runs of these terms refitted on the other spans: {}", of(held_out));
    if let Some(linear) = linear.filter(|linear| *linear != held_out) {
        text.push_str(&format!("\n  the linear model of the same lags: {}", of(linear)));
    }
    text
}

/// Free runs of files one by one, and their mean.
pub(super) fn files_text(runs: &FileRuns) -> String {
    let mut parts: Vec<String> = runs.files.iter().map(|file| scores_table(&file.file, &file.scores)).collect();
    if runs.files.len() > 1 {
        let rows = runs
            .mean
            .iter()
            .map(|mean| vec![format!("{}, free run", mean.name), error(mean.rrse), fit_percent(mean.rrse)]);
        parts.push(table(&[&format!("mean of {} files", runs.files.len()), "RRSE", "FIT %"], rows.collect()));
    }
    if !runs.skipped.is_empty() {
        parts.push(format!("no free run can begin in {}: too short, or values are missing", runs.skipped.join(", ")));
    }
    parts.join("\n\n")
}

fn share(err: f64) -> String {
    if err.is_nan() { "-".into() } else { format!("{:.4}", 100.0 * err) }
}

/// The best models, the best first.
fn tried_table(tried: &[NarxCandidate], most: usize, train: Option<&NarxScores>) -> String {
    let mut order: Vec<&NarxCandidate> = tried.iter().collect();
    order.sort_by(|a, b| a.error().0.total_cmp(&b.error().0));
    let simulated = tried.iter().all(|candidate| candidate.loss.is_none());
    let several = tried.iter().any(|candidate| candidate.partition != tried[0].partition);
    let seeds = tried.iter().any(|candidate| candidate.seed != tried[0].seed);
    let rows = order.iter().take(most).map(|candidate| {
        let mut row = vec![candidate.order.to_string()];
        row.extend(several.then(|| candidate.specification.clone()));
        row.extend(seeds.then(|| candidate.seed.to_string()));
        row.push(candidate.terms.to_string());
        row.extend(errors(candidate, simulated));
        row
    });
    let runs = train.filter(|_| simulated).map_or(&[][..], |scores| &scores.free_run.outputs);
    let persistence = runs.iter().map(|output| output.errors.persistence).sum::<f64>() / runs.len() as f64;
    let doing_nothing = [("(mean)", 1.0), ("(persistence, training rows)", persistence)];
    let baselines = doing_nothing.into_iter().filter(|(_, rrse)| simulated && rrse.is_finite()).map(|(name, rrse)| {
        let mut row = vec![name.to_owned()];
        row.extend(several.then(String::new));
        row.extend(seeds.then(String::new));
        row.extend([String::new(), error(rrse), fit_percent(rrse)]);
        row
    });
    let rows = rows.chain(baselines);
    let mut header = vec![if simulated { "free runs, held out" } else { "one step, held out" }];
    header.extend(several.then_some("partition"));
    header.extend(seeds.then_some("seed"));
    header.push("terms");
    header.extend(error_heads(simulated));
    table(&header, rows.collect())
}

/// The held-out error of a model, as it is compared by it.
fn errors(candidate: &NarxCandidate, simulated: bool) -> Vec<String> {
    if simulated {
        vec![error(candidate.rrse), fit_percent(candidate.rrse)]
    } else {
        vec![candidate.loss.map_or_else(|| "-".into(), number)]
    }
}

fn error_heads(simulated: bool) -> &'static [&'static str] {
    if simulated { &["RRSE", "FIT %"] } else { &["loss"] }
}

/// Models that none of as few coefficients beats, the one of the least BIC, and the one that is written, by their number of coefficients.
fn front_table(tried: &[NarxCandidate]) -> String {
    // Of models that are the same, as refinements to several numbers of regions may be, the first.
    let known = |one: &NarxCandidate| one.bic.unwrap_or(f64::INFINITY);
    let least = tried.iter().filter(|one| one.bic.is_some()).min_by(|a, b| known(a).total_cmp(&known(b)));
    let criterion = least.is_some();
    let simulated = tried.iter().all(|candidate| candidate.loss.is_none());
    let several = tried.iter().any(|candidate| candidate.partition != tried[0].partition);
    let is_least = |one: &NarxCandidate| least.is_some_and(|least| std::ptr::eq(one, least));
    let mut shown: Vec<&NarxCandidate> = tried.iter().filter(|one| one.front || one.chosen || is_least(one)).collect();
    shown.sort_by(|a, b| a.coefficients.cmp(&b.coefficients).then(b.error().0.total_cmp(&a.error().0)));
    let rows = shown.iter().map(|one| {
        let mut row = vec![one.order.to_string()];
        row.extend(several.then(|| one.specification.clone()));
        row.extend([one.terms.to_string(), one.coefficients.to_string()]);
        row.extend(errors(one, simulated));
        row.extend(criterion.then(|| one.bic.map_or_else(|| "-".into(), number)));
        let marks = [(one.chosen, "<- chosen"), (is_least(one), "least BIC"), (!one.front, "not on the front")];
        row.push(marks.iter().filter(|(is, _)| *is).map(|(_, mark)| *mark).collect::<Vec<&str>>().join(", "));
        row
    });
    let mut header = vec!["front: error, coefficients"];
    header.extend(several.then_some("partition"));
    header.extend(["terms", "coefficients"]);
    header.extend(error_heads(simulated));
    header.extend(criterion.then_some("BIC"));
    header.push("");
    table(&header, rows.collect())
}

fn orders_table(search: &fleetfoot::sparse::narx::OrderSearch, most: usize) -> String {
    let chosen = search.choice();
    let mut order: Vec<_> = search.scores.iter().collect();
    order.sort_by(|a, b| a.value.total_cmp(&b.value));
    let rows = order.iter().take(most).map(|score| {
        let terms = score.terms.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        let mark = if score.order == chosen.order { " *" } else { "" };
        vec![
            format!("{}{mark}", score.order),
            score.candidates.to_string(),
            terms,
            number(score.value),
            score.standard_error.map_or("-".into(), number),
        ]
    });
    table(&["one-step errors", "candidates", "terms", "value", "standard error"], rows.collect())
}

fn error(rrse: f64) -> String {
    match rrse {
        _ if rrse.is_infinite() => "diverged".into(),
        _ if rrse.is_nan() => "-".into(),
        _ => format!("{rrse:.4}"),
    }
}

fn fit_percent(rrse: f64) -> String {
    if !rrse.is_finite() { "-".into() } else { format!("{:.2}", 100.0 * (1.0 - rrse)) }
}

fn scores_table(name: &str, scores: &NarxScores) -> String {
    let mut rows = Vec::new();
    for target in &scores.one_step.targets {
        let of = |wanted: Baseline| {
            target
                .baselines
                .iter()
                .find(|baseline| baseline.baseline == wanted)
                .map_or(f64::NAN, |b| b.rmse / target.deviation)
        };
        rows.push(vec![
            format!("{}, one step", target.name),
            number(target.rmse),
            error(target.rmse / target.deviation),
            fit_percent(target.rmse / target.deviation),
            ratio(of(Baseline::Null)),
            ratio(of(Baseline::Persistence)),
        ]);
    }
    for output in &scores.free_run.outputs {
        let errors = &output.errors;
        rows.push(vec![
            format!("{}, free run", output.name),
            number(errors.rmse),
            error(errors.rrse),
            fit_percent(errors.rrse),
            ratio(errors.null.unwrap_or(f64::NAN)),
            ratio(errors.persistence),
        ]);
    }
    let mut text = table(&[name, "RMSE", "RRSE", "FIT %", "null model", "persistence"], rows);
    text.push_str(&format!("\n  free run: {}", replayed_in_words(&scores.free_run.replayed)));
    for run in scores.free_run.runs.iter().filter(|run| run.lost_at.is_some()).take(BEST) {
        let at = run.lost_at.unwrap_or_default() + 1;
        text.push_str(&format!(
            "\n  the run from row {} of episode {} ends at row {at}: {:?}",
            run.start.row + 1,
            run.start.episode,
            run.end
        ));
    }
    text
}
