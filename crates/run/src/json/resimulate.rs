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
        let found = &self.found;
        let [dynamics, bounds, stationarity] = self.worst();
        report(Told {
            rule: if found.continuous { "hermite-simpson" } else { "next-row" },
            rows: found.episodes.iter().map(|own| own.rows.len()).sum(),
            columns: (0..found.columns.len()).map(|at| Column::new(self, at)).collect(),
            replayed: &found.replayed,
            violation: Violation { dynamics, bounds },
            stationarity,
            minima: self.minima(),
            episodes: found.episodes.iter().zip(&self.names).map(|(own, name)| Episode::new(self, own, name)).collect(),
            left_out: &self.left_out,
            in_sample_episodes: &self.in_sample,
            warnings: self.warnings(),
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Told<'a> {
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
        let found = &all.found;
        Self {
            name: &found.columns[at],
            unit: all.units[at].as_deref(),
            kind: if at < found.states { "state" } else { "input" },
            deviation: found.deviations[at],
            bounds: found.bounds[at],
            spread: found.spreads[at],
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
    fn new(all: &'a Followed, own: &Resimulated, name: &'a str) -> Self {
        let found = &all.found;
        let by_column = |values: Vec<f64>| found.columns.iter().map(String::as_str).zip(values).collect();
        let certificate = &own.certificate;
        Self {
            episode: name,
            rows: own.rows.len(),
            ending: match own.ending {
                Ending::Minimum => "minimum",
                Ending::Stalled => "stalled",
                _ => "iterations",
            },
            programs: own.programs,
            violation: Violation { dynamics: certificate.dynamics, bounds: certificate.bounds },
            stationarity: certificate.stationarity,
            followed: by_column(found.deviations_of(own)),
            open_loop: by_column(found.open_loop_deviations(own)),
        }
    }
}
