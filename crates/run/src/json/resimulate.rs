//! Recordings that a model followed, for programs.

use std::collections::BTreeMap;

use fleetfoot_dataset::json::report;
use fleetfoot_estimate::{Ending, Resimulated};
use serde::Serialize;
use serde_json::Value;

use crate::{Followed, resimulate::Spread};

impl Followed {
    /// Deviations, certificates and settings; trajectories are not among them.
    pub fn to_json(&self) -> Value {
        let resimulation = &self.resimulation;
        let [dynamics, bounds, stationarity] = self.worst();
        report(Content {
            rule: if resimulation.continuous { "hermite-simpson" } else { "next-row" },
            rows: resimulation.episodes.iter().map(|episode| episode.rows.len()).sum(),
            columns: (0..resimulation.columns.len()).map(|at| Column::new(self, at)).collect(),
            replayed: &resimulation.replayed,
            violation: Violation { dynamics, bounds },
            stationarity,
            minima: self.minima(),
            episodes: resimulation
                .episodes
                .iter()
                .zip(&self.names)
                .map(|(episode, name)| Episode::new(self, episode, name))
                .collect(),
            left_out: &self.left_out,
            in_sample_episodes: &self.in_sample,
            warnings: self.warnings(),
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    rule: &'static str,
    rows: usize,
    columns: Vec<Column<'a>>,
    replayed: &'a [String],
    violation: Violation,
    stationarity: f64,
    minima: usize,
    episodes: Vec<Episode<'a>>,
    left_out: &'a [String],
    in_sample_episodes: &'a [String],
    warnings: Vec<String>,
    notes: &'a [String],
}

/// By how much equations and bounds are violated at most.
#[derive(Serialize)]
struct Violation {
    dynamics: f64,
    bounds: f64,
}

/// A column over the episodes.
#[derive(Serialize)]
struct Column<'a> {
    name: &'a str,
    unit: Option<&'a str>,
    kind: &'static str,
    deviation: f64,
    bounds: [f64; 2],
    spread: f64,
    followed: Spread,
    open_loop: Option<Spread>,
}

impl<'a> Column<'a> {
    fn new(all: &'a Followed, at: usize) -> Self {
        let resimulation = &all.resimulation;
        Self {
            name: &resimulation.columns[at],
            unit: all.units[at].as_deref(),
            kind: if at < resimulation.states { "state" } else { "input" },
            deviation: resimulation.deviations[at],
            bounds: resimulation.bounds[at],
            spread: resimulation.spreads[at],
            followed: all.followed(at),
            open_loop: all.open_loop(at),
        }
    }
}

/// An episode, its deviations by column.
#[derive(Serialize)]
struct Episode<'a> {
    episode: &'a str,
    rows: usize,
    ending: &'static str,
    programs: usize,
    violation: Violation,
    stationarity: f64,
    followed: BTreeMap<&'a str, f64>,
    open_loop: BTreeMap<&'a str, f64>,
}

impl<'a> Episode<'a> {
    fn new(all: &'a Followed, resimulated: &Resimulated, name: &'a str) -> Self {
        let resimulation = &all.resimulation;
        let by_column = |values: Vec<f64>| resimulation.columns.iter().map(String::as_str).zip(values).collect();
        let certificate = &resimulated.certificate;
        Self {
            episode: name,
            rows: resimulated.rows.len(),
            ending: match resimulated.ending {
                Ending::Minimum => "minimum",
                Ending::Stalled => "stalled",
                _ => "iterations",
            },
            programs: resimulated.programs,
            violation: Violation { dynamics: certificate.dynamics, bounds: certificate.bounds },
            stationarity: certificate.stationarity,
            followed: by_column(resimulation.deviations_of(resimulated)),
            open_loop: by_column(resimulation.open_loop_deviations(resimulated)),
        }
    }
}
