//! Reports for programs, as JSON: the structures of reports serialise themselves, and what a report tells otherwise than it is kept has a structure of its own here. A number
//! that is none is `null`.

mod control;
mod filter;
mod narx;
mod page;
mod parameters;
mod pwa;
mod resimulate;
mod rollout;
mod score;
mod sindy;
mod sparse;
mod statistic;

use std::collections::BTreeMap;

use fleetfoot_dynamics::{Baseline, Estimate};
use serde::Serialize;
use serde_json::Value;

use crate::told::value;

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

/// What is told of every baseline, by its name.
fn by_baseline<T, V>(all: &[(Baseline, T)], of: impl Fn(&T) -> V) -> BTreeMap<&'static str, V> {
    all.iter().map(|(baseline, own)| (baseline.name(), of(own))).collect()
}
