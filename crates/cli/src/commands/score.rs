//! `fleetfoot score`.

use fleetfoot::{
    Error, Scored,
    dynamics::{Baseline, Estimate, TargetScore},
    interval_in_words,
};
use serde::Serialize;
use serde_json::Value;

use super::{Context, files, fit_narx, in_sample, plane, read_by, read_model, time_changes};
use crate::{
    args::{List, Score},
    table::{count, number, ratio, table},
};

pub(crate) fn score(arguments: &Score, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model.model)?;
    let files = files(&arguments.model.data)?;
    let outputs: Vec<_> = arguments.output.iter().cloned().collect();
    context.claim(&outputs, &read_by(&files, [&arguments.model.model]), false)?;
    let changes = time_changes(&arguments.model)?;
    let bar = context.bar();
    let scored = fleetfoot::score(&model, &changes, &files, &bar).and_then(|scored| {
        let project = |axes: &List| {
            let output = arguments.output.as_deref();
            fleetfoot::project(&model, &changes, &files, &axes.0, arguments.bins, output, &bar)
        };
        Ok((scored, arguments.plane.as_ref().map(project).transpose()?))
    });
    bar.finish();
    let (scored, projected) = scored?;
    context.notes(&scored.notes);
    in_sample(context, &scored.in_sample, scored.episodes);
    let summary = ScoreOutput { scored: scored.to_json(), plane: projected.as_ref().map(plane::PlaneReport::from) };
    context.print(summary, || {
        let text = to_text(&scored, arguments.episodes);
        projected.as_ref().map_or(text.clone(), |projected| format!("{text}\n\n{}", plane::to_text(projected)))
    });
    if let Some(path) = &arguments.output {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

/// The scores, and the plane where one is asked for.
#[derive(Serialize)]
struct ScoreOutput {
    #[serde(flatten)]
    scored: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    plane: Option<plane::PlaneReport>,
}

fn interval(estimate: &Estimate, show: impl Fn(f64) -> String) -> String {
    if estimate.low.is_finite() && estimate.high.is_finite() {
        format!("{} [{}, {}]", show(estimate.value), show(estimate.low), show(estimate.high))
    } else {
        show(estimate.value)
    }
}

fn baseline(target: &TargetScore, which: Baseline) -> String {
    // Over the model's error on the very same rows: above one, the model is better.
    target
        .baselines
        .iter()
        .find(|score| score.baseline == which)
        .map_or("-".into(), |score| ratio(score.mae / score.model_mae))
}

fn to_text(scored: &Scored, episodes: bool) -> String {
    let scores = &scored.scores;
    let header = [
        "target",
        "sigma",
        "MAE",
        "MAE / null",
        "MAE / sigma",
        "RMSE",
        "R2",
        "null / model",
        "persistence / model",
        "const. vel. / model",
    ];
    // Beside the error on smoothed values that against their measurements.
    let raw = scores.targets.iter().any(|target| target.raw.is_some()).then_some("raw RMSE");
    let mut header = header.to_vec();
    raw.iter().for_each(|name| header.insert(6, name));
    let rows = scores
        .targets
        .iter()
        .map(|target| {
            let unit = target.unit.as_ref().map(|unit| format!(" [{unit}]")).unwrap_or_default();
            let mut cells = vec![
                format!("{}{unit}", target.name),
                number(target.deviation),
                number(target.mae.value),
                interval(&target.mae_over_null, ratio),
                ratio(target.mae_over_sigma),
                number(target.rmse),
                ratio(target.r2),
                baseline(target, Baseline::Null),
                baseline(target, Baseline::Persistence),
                baseline(target, Baseline::ConstantVelocity),
            ];
            if raw.is_some() {
                cells.insert(6, target.raw.map_or_else(|| "-".to_owned(), |raw| number(raw.rmse)));
            }
            cells
        })
        .collect();
    let skipped = &scores.skipped;
    let mut text = format!(
        "{} rows of {} scored; {} at borders, {} with missing values, {} without a finite prediction\n{}\n{}\n\
         Mahalanobis score {} (under the covariance of these targets {})\n\
         outside the training range of their region: {:.1} % of rows; outside the whole training range: {:.1} %",
        scores.rows,
        count(scored.episodes, "episode"),
        skipped.border,
        skipped.missing,
        skipped.non_finite,
        table(&header, rows),
        interval_in_words(&scores.basis),
        interval(&scores.mahalanobis, ratio),
        ratio(scores.mahalanobis_measured),
        100.0 * scores.outside_region as f64 / scores.rows as f64,
        100.0 * scores.outside_training as f64 / scores.rows as f64,
    );
    if !scored.free_runs.is_empty() {
        text.push_str(&format!("\n\nfree runs of whole files\n{}", fit_narx::files_text(&scored.free_runs)));
    }
    if episodes {
        let mut header = vec!["episode", "rows", "in training"];
        header.extend(scores.targets.iter().map(|target| target.name.as_str()));
        let rows = scores
            .episodes
            .iter()
            .map(|episode| {
                let mut row = vec![
                    episode.name.clone(),
                    episode.rows.to_string(),
                    if episode.in_training { "yes".into() } else { "no".into() },
                ];
                row.extend(episode.mae_over_null.iter().map(|&value| ratio(value)));
                row
            })
            .collect();
        text.push_str(&format!("\n\nMAE / null by episode\n{}", table(&header, rows)));
    }
    text
}
