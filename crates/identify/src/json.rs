//! Reports for programs, as JSON: the structures of reports serialise themselves, and what a report tells otherwise than it is kept has a structure of its own here. A number
//! that is none is `null`.

mod control;
mod filter;
mod narx;
mod page;
mod parameters;
mod plan;
mod pwa;
mod resimulate;
mod rollout;
mod score;
mod sindy;
mod sparse;
mod statistic;

use std::collections::BTreeMap;

use fleetfoot_dynamics::{Baseline, Basis, Estimate};
use serde::{Serialize, Serializer};
use serde_json::Value;

pub(crate) use narx::tried_order;
pub(crate) use plan::decoded;
pub(crate) use sparse::{certificate, largest_change};

/// Version of the keys of reports (docs/reference/reports.md): raised when one is renamed, removed or means something else.
const FORMAT: u32 = 2;

/// A report with the version of its keys.
#[derive(Serialize)]
struct Report<R> {
    format: u32,
    #[serde(flatten)]
    told: R,
}

/// A report as a tree of values.
fn report(told: impl Serialize) -> Value {
    value(Report { format: FORMAT, told })
}

/// A part of a report as a tree of values.
pub(crate) fn value(told: impl Serialize) -> Value {
    serde_json::to_value(told).expect("keys of reports are text, and nothing else can fail in memory")
}

/// A value and the ends of its interval, as every report tells them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// The value.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl From<&Estimate> for Interval {
    fn from(estimate: &Estimate) -> Self {
        Self { value: estimate.value, low: estimate.low, high: estimate.high }
    }
}

/// Rows that were left out: at borders, incomplete ones and, where there are regions, those that none took.
pub(crate) fn left_out<S: Serializer>(rows: &[u64], serializer: S) -> Result<S::Ok, S::Error> {
    let keys = ["rows_at_border", "rows_incomplete", "rows_unassigned"];
    serializer.collect_map(keys.iter().zip(rows))
}

/// Functions and their coefficients along something.
#[derive(Serialize)]
struct Along<'a> {
    function: &'a str,
    coefficients: &'a [f64],
}

fn functions(functions: &[(String, Vec<f64>)]) -> Vec<Along<'_>> {
    functions.iter().map(|(function, coefficients)| Along { function, coefficients }).collect()
}

pub(crate) fn along<S: Serializer>(along: &[(String, Vec<f64>)], serializer: S) -> Result<S::Ok, S::Error> {
    functions(along).serialize(serializer)
}

/// What is told of every baseline, by its name.
fn by_baseline<T, V>(all: &[(Baseline, T)], of: impl Fn(&T) -> V) -> BTreeMap<&'static str, V> {
    all.iter().map(|(baseline, own)| (baseline.name(), of(own))).collect()
}

/// What a simulation did not compute itself ([`Simulator::replayed`](fleetfoot_dynamics::Simulator::replayed)), for people.
pub fn replayed_in_words(columns: &[String]) -> String {
    match columns {
        [] => "replayed from the recording: nothing".into(),
        columns => format!("replayed from the recording: {}", columns.join(", ")),
    }
}

/// What an interval compares, for people.
pub fn interval_in_words(basis: &Basis) -> String {
    match basis {
        Basis::Episodes(count) => format!("95 % intervals across {count} episodes"),
        Basis::Folds(count) => {
            format!("95 % intervals across {count} folds of spans (too narrow: they are correlated)")
        }
        Basis::Spans(count) => {
            format!("95 % intervals across {count} spans of one episode (too narrow: they are correlated)")
        }
        Basis::Starts(count) => {
            format!("95 % intervals across {count} starts of one episode (too narrow: they are correlated)")
        }
    }
}
