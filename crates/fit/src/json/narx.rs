//! The report of an autoregression.

use std::collections::BTreeMap;

use fleetfoot_dataset::json::value;
use fleetfoot_dynamics::{FreeRunOutcome, OutputErrors, TargetScore};
use fleetfoot_sparse::narx::OrderScore;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::report;
use crate::{
    method::FitReport,
    narx::{FileRuns, MeanRun, NarxCandidate, NarxRegion, NarxReport, NarxScores, NarxSearch, NarxStage},
    serialize::Order,
    summary::FitSummary,
};

impl FitReport for NarxReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }

    fn to_json(&self) -> Value {
        report(Told {
            rows: self.rows,
            order: self.order.into(),
            direct: self.direct,
            candidates: self.candidates,
            partition: &self.partition,
            choice: self.choice.as_deref(),
            held_out: self.held_out.as_ref(),
            linear_of_the_same_lags: self.linear(),
            search: self.search.as_ref(),
            tried: &self.tried,
            orders: self.orders.iter().flat_map(|search| &search.scores).map(Compared::from).collect(),
            regions: &self.regions,
            train: self.train.as_ref(),
            test: self.test.as_ref(),
            files: self.files.as_ref(),
            summary: &self.summary,
        })
    }
}

#[derive(Serialize)]
struct Told<'a> {
    rows: u64,
    order: Order,
    direct: bool,
    candidates: usize,
    partition: &'a str,
    choice: Option<&'a str>,
    held_out: Option<&'a NarxCandidate>,
    linear_of_the_same_lags: Option<&'a NarxCandidate>,
    search: Option<&'a NarxSearch>,
    tried: &'a [NarxCandidate],
    orders: Vec<Compared<'a>>,
    regions: &'a [NarxRegion],
    train: Option<&'a NarxScores>,
    test: Option<&'a NarxScores>,
    files: Option<&'a FileRuns>,
    #[serde(flatten)]
    summary: &'a FitSummary,
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

impl Serialize for NarxSearch {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Search<'a> {
            effort: &'static str,
            limit: u64,
            spent: u64,
            stages: &'a [NarxStage],
            cut: Vec<Cut>,
        }
        #[derive(Serialize)]
        struct Cut {
            #[serde(flatten)]
            order: Order,
            direct: bool,
        }
        let cut = self.cut.iter().map(|&order| Cut { order: order.into(), direct: order.direct });
        Search {
            effort: self.effort.word(),
            limit: self.limit,
            spent: self.spent,
            stages: &self.stages,
            cut: cut.collect(),
        }
        .serialize(serializer)
    }
}

impl FileRuns {
    /// The runs of every file, and their mean, for programs.
    pub fn to_json(&self) -> Value {
        value(self)
    }
}

impl Serialize for FileRuns {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Runs<'a> {
            by_file: Vec<Run<'a>>,
            mean: &'a [MeanRun],
            skipped: &'a [String],
        }
        #[derive(Serialize)]
        struct Run<'a> {
            file: &'a str,
            #[serde(flatten)]
            scores: &'a NarxScores,
        }
        let by_file = self.files.iter().map(|run| Run { file: &run.file, scores: &run.scores });
        Runs { by_file: by_file.collect(), mean: &self.mean, skipped: &self.skipped }.serialize(serializer)
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
        let baselines = target.baselines.iter().map(|own| (own.baseline.name(), own.rmse));
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
