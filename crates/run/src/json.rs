//! Reports of scores, rollouts and filters, as JSON.

mod control;
mod filter;
mod frequency;
mod resimulate;
mod rollout;
mod score;

use std::collections::BTreeMap;

use fleetfoot_dynamics::Baseline;

/// Values of all baselines, by name.
fn by_baseline<T, V>(all: &[(Baseline, T)], of: impl Fn(&T) -> V) -> BTreeMap<&'static str, V> {
    all.iter().map(|(baseline, score)| (baseline.name(), of(score))).collect()
}
