//! The report of an autoregression.

use std::collections::BTreeMap;

use fleetfoot_dataset::json::value;
use fleetfoot_dynamics::{FreeRunOutcome, OutputErrors, TargetScore};
use fleetfoot_sparse::narx::{NarxOrder, OrderScore, OrderSearch};
use serde::{Serialize, Serializer};
use serde_json::Value;

use crate::{
    method::FitReport,
    narx::{FileRuns, NarxReport, NarxScores},
    serialize::Order,
    summary::FitSummary,
};

impl FitReport for NarxReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

/// Lags and degree.
pub(crate) fn order<S: Serializer>(order: &NarxOrder, serializer: S) -> Result<S::Ok, S::Error> {
    Order::from(*order).serialize(serializer)
}

/// Orders that were compared by one-step errors; none where they were not.
pub(crate) fn orders<S: Serializer>(orders: &Option<OrderSearch>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(orders.iter().flat_map(|search| &search.scores).map(Compared::from))
}

/// Orders, each with whether inputs act at once.
pub(crate) fn cut<S: Serializer>(orders: &[NarxOrder], serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Cut {
        #[serde(flatten)]
        order: Order,
        direct: bool,
    }
    serializer.collect_seq(orders.iter().map(|&order| Cut { order: order.into(), direct: order.direct }))
}

/// An order that was compared by one-step errors.
#[derive(Serialize)]
struct Compared<'a> {
    order: Order,
    candidates: usize,
    terms: &'a [usize],
    value: f64,
    standard_error: Option<f64>,
    rss: &'a [f64],
}

impl<'a> From<&'a OrderScore> for Compared<'a> {
    fn from(score: &'a OrderScore) -> Self {
        Self {
            order: score.order.into(),
            candidates: score.candidates,
            terms: &score.terms,
            value: score.value,
            standard_error: score.standard_error,
            rss: &score.rss,
        }
    }
}

impl FileRuns {
    /// The runs of every file, and their mean, for programs.
    pub fn to_json(&self) -> Value {
        value(self)
    }
}

impl Serialize for NarxScores {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Scores<'a> {
            one_step: Vec<OneStep<'a>>,
            free_run: Vec<Output<'a>>,
            runs: Vec<Run>,
            replayed: &'a [String],
            episodes_skipped: usize,
        }
        #[derive(Serialize)]
        struct Output<'a> {
            name: &'a str,
            #[serde(flatten)]
            errors: Errors,
        }
        let run = &self.free_run;
        let outputs = run.outputs.iter().map(|output| Output { name: &output.name, errors: (&output.errors).into() });
        Scores {
            one_step: self.one_step.targets.iter().map(OneStep::from).collect(),
            free_run: outputs.collect(),
            runs: run.runs.iter().map(Run::from).collect(),
            replayed: &run.replayed,
            episodes_skipped: run.skipped,
        }
        .serialize(serializer)
    }
}

/// Errors one row ahead.
#[derive(Serialize)]
struct OneStep<'a> {
    name: &'a str,
    rmse: f64,
    rrse: f64,
    r2: f64,
    baseline_rmse: BTreeMap<&'static str, f64>,
}

impl<'a> From<&'a TargetScore> for OneStep<'a> {
    fn from(target: &'a TargetScore) -> Self {
        let baselines = target.baselines.iter().map(|baseline| (baseline.baseline.name(), baseline.rmse));
        Self {
            name: &target.name,
            rmse: target.rmse,
            rrse: target.rmse / target.deviation,
            r2: target.r2,
            baseline_rmse: baselines.collect(),
        }
    }
}

/// Errors of free runs.
#[derive(Serialize)]
struct Errors {
    rows: u64,
    lost: u64,
    rrse: f64,
    fit: f64,
    rmse: f64,
    nrmse: f64,
    largest: f64,
    persistence_rrse: f64,
    null_rrse: Option<f64>,
}

impl From<&OutputErrors> for Errors {
    fn from(errors: &OutputErrors) -> Self {
        Self {
            rows: errors.rows,
            lost: errors.lost,
            rrse: errors.rrse,
            fit: errors.fit,
            rmse: errors.rmse,
            nrmse: errors.nrmse,
            largest: errors.largest,
            persistence_rrse: errors.persistence,
            null_rrse: errors.null,
        }
    }
}

/// A simulation from its start to its end.
#[derive(Serialize)]
struct Run {
    episode: usize,
    row: usize,
    steps: usize,
    end: &'static str,
    lost_at: Option<usize>,
    left_domain: Option<usize>,
    outputs: Vec<Errors>,
}

impl From<&FreeRunOutcome> for Run {
    fn from(run: &FreeRunOutcome) -> Self {
        Self {
            episode: run.start.episode,
            row: run.start.row,
            steps: run.steps,
            end: run.end.name(),
            lost_at: run.lost_at,
            left_domain: run.left_domain,
            outputs: run.outputs.iter().map(Errors::from).collect(),
        }
    }
}
