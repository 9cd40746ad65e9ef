//! Fig. 8: how long each model is the best one to simulate with.

use fleetfoot::{
    RolledOut,
    dynamics::{Baseline, Estimate, Horizon, Reign, reigns},
    interval_in_words,
};
use serde::Serialize;

use crate::{
    commands::rollout::printed_steps,
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
    let rows = printed_steps(horizon.time.len())
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

/// Result of the paper's authors.
const PAPER: &str =
    "(the paper, on the real robot: K-50 up to 40 ms, K-10 from 40 to 60 ms, average from 60 to 200 ms, null beyond)";

/// Best model at each horizon.
fn frontier(what: &str, lists: &[(String, &[Estimate])], horizon: &Horizon) -> String {
    let spans_text: Vec<String> = spans(lists)
        .iter()
        .map(|reign| {
            let (from, to) = (seconds(horizon.time[reign.first - 1]), seconds(horizon.time[reign.last - 1]));
            let when = if reign.first == reign.last { from } else { format!("{from} to {to}") };
            format!("{} ({when})", lists[reign.model].0)
        })
        .collect();
    format!("{what}: {}", spans_text.join(", "))
}

/// Fig. 8 for programs: scores with the ends of their intervals by step, and which model is the best when.
#[derive(Serialize)]
pub(super) struct HorizonReport<'a> {
    seconds: &'a [f64],
    scores: Vec<Scores>,
    best: Vec<Best>,
    simulations: Vec<Simulations<'a>>,
}

#[derive(Serialize)]
struct Scores {
    model: String,
    mahalanobis: Vec<[f64; 3]>,
}

#[derive(Serialize)]
struct Best {
    model: String,
    first_step: usize,
    last_step: usize,
}

#[derive(Serialize)]
struct Simulations<'a> {
    model: &'a str,
    count: usize,
    diverged: usize,
    left_domain: usize,
}

impl<'a> From<&'a Curve> for Simulations<'a> {
    fn from(curve: &'a Curve) -> Self {
        let rollouts = &curve.rolled.rollouts;
        Self {
            model: &curve.model,
            count: rollouts.outcomes.len(),
            diverged: rollouts.diverged(),
            left_domain: rollouts.left_domain(),
        }
    }
}

impl<'a> HorizonReport<'a> {
    pub(super) fn new(curves: &'a [Curve]) -> Self {
        let lists = lists(curves);
        let best = spans(&lists[..curves.len()]).into_iter().map(|reign| Best {
            model: lists[reign.model].0.clone(),
            first_step: reign.first,
            last_step: reign.last,
        });
        let best = best.collect();
        let triple = |estimate: &Estimate| [estimate.value, estimate.low, estimate.high];
        let scores =
            lists.into_iter().map(|(model, list)| Scores { model, mahalanobis: list.iter().map(triple).collect() });
        Self {
            seconds: curves.first().map_or(&[][..], |curve| &curve.rolled.rollouts.horizon.time),
            scores: scores.collect(),
            best,
            simulations: curves.iter().map(Simulations::from).collect(),
        }
    }
}
