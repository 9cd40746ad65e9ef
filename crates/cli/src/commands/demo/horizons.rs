//! Fig. 8: how long each model is the best one to simulate with.

use fleetfoot::{
    RolledOut,
    dynamics::{Baseline, Estimate, Horizon, Reign, reigns},
    interval_in_words,
};
use serde_json::json;

use crate::{
    commands::{real, rollout::told},
    table::{count, ratio, seconds, table},
};

/// Rollouts of one model.
pub(super) struct Curve {
    pub(super) model: String,
    pub(super) rolled: RolledOut,
}

/// The models' scores by step and the baselines', which are the same for all of them: names and lists.
fn lists(curves: &[Curve]) -> Vec<(String, &[Estimate])> {
    let mut lists: Vec<(String, &[Estimate])> = curves
        .iter()
        .map(|curve| (curve.model.clone(), curve.rolled.rollouts.horizon.model.mahalanobis.as_slice()))
        .collect();
    if let Some(first) = curves.first() {
        let others = first.rolled.rollouts.horizon.baselines.iter().filter(|(which, _)| *which != Baseline::Null);
        lists.extend(others.map(|(which, score)| (which.name().to_owned(), score.mahalanobis.as_slice())));
    }
    lists
}

pub(super) fn to_text(curves: &[Curve], loop_: &str) -> String {
    let Some(first) = curves.first() else { return String::new() };
    let horizon = &first.rolled.rollouts.horizon;
    let lists = lists(curves);
    let header: Vec<&str> = std::iter::once("time").chain(lists.iter().map(|(name, _)| name.as_str())).collect();
    let rows = told(horizon.time.len())
        .into_iter()
        .map(|step| {
            let cell = |list: &[Estimate]| {
                let e = &list[step - 1];
                let half = 0.5 * (e.high - e.low);
                if half.is_finite() { format!("{} +-{half:.2}", ratio(e.value)) } else { ratio(e.value) }
            };
            std::iter::once(seconds(horizon.time[step - 1])).chain(lists.iter().map(|(_, list)| cell(list))).collect()
        })
        .collect();
    let ended: Vec<String> = curves
        .iter()
        .filter(|curve| curve.rolled.rollouts.diverged() > 0)
        .map(|curve| format!("{} {}", curve.model, curve.rolled.rollouts.diverged()))
        .collect();
    let diverged = if ended.is_empty() { String::new() } else { format!("\ndiverged: {}", ended.join(", ")) };
    format!(
        "Fig. 8, {loop_}. Mahalanobis score of the simulated state by horizon: {} from {} that did not train; half-widths of {}\n{}{diverged}\n{}",
        count(first.rolled.rollouts.outcomes.len(), "simulation"),
        count(first.rolled.episodes, "run"),
        interval_in_words(&horizon.basis),
        table(&header, rows),
        [
            frontier("best model", &lists[..curves.len()], horizon),
            frontier("with the predictions that need no model", &lists, horizon),
            PAPER.into()
        ]
        .join("\n")
    )
}

fn spans(lists: &[(String, &[Estimate])]) -> Vec<Reign> {
    reigns(&lists.iter().map(|(_, list)| *list).collect::<Vec<_>>())
}

/// What the authors of the paper found.
const PAPER: &str =
    "(the paper, on the real robot: K-50 up to 40 ms, K-10 from 40 to 60 ms, average from 60 to 200 ms, null beyond)";

/// Who is the best when.
fn frontier(what: &str, lists: &[(String, &[Estimate])], horizon: &Horizon) -> String {
    let told: Vec<String> = spans(lists)
        .iter()
        .map(|reign| {
            let (from, to) = (seconds(horizon.time[reign.first - 1]), seconds(horizon.time[reign.last - 1]));
            let when = if reign.first == reign.last { from } else { format!("{from} to {to}") };
            format!("{} ({when})", lists[reign.model].0)
        })
        .collect();
    format!("{what}: {}", told.join(", "))
}

pub(super) fn to_json(curves: &[Curve]) -> serde_json::Value {
    let lists = lists(curves);
    let time = curves.first().map_or(&[][..], |curve| &curve.rolled.rollouts.horizon.time);
    json!({
        "seconds": time,
        "scores": lists.iter().map(|(name, list)| json!({
            "model": name, "mahalanobis": list.iter().map(|e| json!([real(e.value), real(e.low), real(e.high)])).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "best": spans(&lists[..curves.len()]).iter().map(|reign| json!({
            "model": lists[reign.model].0, "first_step": reign.first, "last_step": reign.last,
        })).collect::<Vec<_>>(),
        "simulations": curves.iter().map(|curve| json!({
            "model": curve.model, "count": curve.rolled.rollouts.outcomes.len(), "diverged": curve.rolled.rollouts.diverged(),
            "left_domain": curve.rolled.rollouts.left_domain(),
        })).collect::<Vec<_>>(),
    })
}
