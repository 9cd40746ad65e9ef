//! `fleetfoot fit pwa`.

use fleetfoot::{
    BoundedCandidate, Error, FitRequest, Pwa, PwaReport, TargetBaselines,
    pwa::{Score, Specification},
};

use super::{Context, fit, fit::Job, flags};
use crate::{
    args::FitPwa,
    table::{count, number, ratio, table, text_table},
};

pub(crate) fn pwa(arguments: &FitPwa, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    if let Some(partition) = &arguments.partition {
        recipe.model.partition = Some(partition.clone());
    }
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    recipe.override_with(arguments.pwa.clone());
    let unsaid = recipe.model.partition.is_none();
    let mut job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.known = true;
    job.run::<Pwa>(FitRequest::default(), context, |fitted| to_text(&fitted[0].report), |fitted| {
        let candidates = &fitted[0].report.identification.candidates;
        let several = candidates.len() > 1 && !candidates.iter().any(|score| score.specification.fits_targets());
        (unsaid && several).then(|| {
            "only k-means regions were tried; --partition refined:2,5,10 fits regions to the dynamics and takes several times as long".to_owned()
        })
    })
}

fn to_text(report: &PwaReport) -> String {
    let (identification, summary) = (&report.identification, &report.summary);
    let mut header = vec!["partition", "regions", "coefficients"];
    header.extend(identification.targets.iter().map(String::as_str));
    header.extend(["Mahalanobis", "loss"]);
    let continuous = identification.candidates.iter().any(|score| score.continuity.is_some());
    header.extend(continuous.then_some("loss apart"));
    header.push("");
    // Facts that the sums do not have.
    let quadratic = identification.candidates.iter().all(|score| score.over_null.iter().all(|value| value.is_nan()));
    let mut rows: Vec<Vec<String>> = identification
        .candidates
        .iter()
        .enumerate()
        .map(|(index, score)| {
            let mut row =
                vec![score.specification.to_string(), score.regions.to_string(), score.coefficients.to_string()];
            row.extend(if quadratic { &score.r2 } else { &score.over_null }.iter().map(|&value| ratio(value)));
            row.push(if quadratic { "-".into() } else { ratio(score.mahalanobis) });
            row.push(if score.loss.is_nan() {
                "-".into()
            } else {
                format!("{} +- {}", ratio(score.loss), ratio(score.standard_error))
            });
            if continuous {
                row.push(score.continuity.map_or_else(|| "-".into(), |joined| ratio(joined.apart)));
            }
            let marks = [
                (index == identification.chosen, "<- chosen"),
                (score.front && identification.candidates.len() > 1, "front"),
            ];
            row.push(marks.iter().filter(|(is, _)| *is).map(|(_, mark)| *mark).collect::<Vec<&str>>().join(", "));
            row
        })
        .collect();
    let width = header.len();
    let baseline = |name: &str, errors: Vec<f64>, loss: f64| {
        let mut row = vec![name.to_owned(), String::new(), String::new()];
        row.extend(errors.into_iter().map(ratio));
        row.extend([String::new(), if loss.is_nan() { "-".into() } else { ratio(loss) }]);
        row.resize(width, String::new());
        row
    };
    if !summary.baselines.is_empty() {
        let losses: Vec<f64> = summary.baselines.iter().map(TargetBaselines::loss).collect();
        let loss = losses.iter().sum::<f64>() / losses.len() as f64;
        let errors = summary.baselines.iter().map(|baseline| baseline.persistence_over_mean).collect();
        if !identification.candidates.iter().any(|score| score.specification == Specification::Null) {
            rows.push(baseline("(mean)", vec![1.0; losses.len()], 1.0));
        }
        rows.push(baseline("(persistence)", errors, loss));
    }
    let mut sigma = vec!["sigma".to_owned(), String::new(), String::new()];
    sigma.extend(identification.sigma.iter().map(|&value| number(value)));
    sigma.resize(header.len(), String::new());
    rows.push(sigma);
    let rollouts =
        summary.rollouts.as_ref().map_or_else(String::new, |choice| format!("{}\n\n", fit::by_rollouts(choice)));
    let rollouts = rollouts + &summary.refinement.as_ref().map_or_else(String::new, fit::refined_over_candidates);
    let by_spans = |target: &str| {
        let at = identification.targets.iter().position(|name| name == target)?;
        identification.candidates[identification.chosen].r2.get(at).map(|r2| 1.0 - r2)
    };
    let by_time =
        summary.by_time.as_ref().map_or_else(String::new, |comparison| format!("\n{}", comparison.in_words(by_spans)));
    let which = if identification.held_out { "cross-validated" } else { "in-sample" };
    let what = if quadratic { "R2" } else { "mean absolute error over the null model's" };
    format!(
        "{rollouts}{} rows of {} ({} independent), {} left out at borders, {} incomplete; condition {} (preconditioned {})\n\
         {what}, {which}{}; loss: squared error over variance\n{}",
        identification.rows,
        count(summary.episodes, "episode"),
        number(identification.effective_rows),
        identification.at_border,
        identification.incomplete,
        number(identification.condition),
        number(identification.preconditioned),
        identification.fold_rule.as_ref().map_or_else(String::new, |rule| format!(" ({rule})")),
        table(&header, rows)
    ) + &by_time
        + &identification.rule.map_or_else(String::new, |rule| format!("\nchosen: {rule}"))
        + &refinement(&identification.candidates[identification.chosen])
        + &continuity(&identification.candidates[identification.chosen])
        + &bounded(&identification.candidates, identification.held_out)
}

/// Largest jump at the borders of maps that meet there, with the count of free numbers.
fn continuity(score: &Score) -> String {
    score.continuity.map_or_else(String::new, |meeting| {
        format!(
            "\n{}: the maps meet at {} within {} standard deviations, with {} free coefficients per target",
            score.specification,
            count(meeting.borders, "border"),
            number(meeting.jump),
            meeting.numbers
        )
    })
}

/// Iterations and objective of a refined partition.
fn refinement(score: &Score) -> String {
    match score.objective.as_slice() {
        [first, .., last] => format!(
            "\n{}: the objective fell from {first:.4} to {last:.4} in {} passes",
            score.specification,
            score.objective.len()
        ),
        _ => String::new(),
    }
}

/// Bounds of the regions' maps, with the one-step error that they cost.
fn bounded(candidates: &[Score], held_out: bool) -> String {
    let tables = BoundedCandidate::tables(&BoundedCandidate::of(candidates, held_out));
    tables.iter().map(|table| format!("\n\n{}", text_table(table))).collect()
}
