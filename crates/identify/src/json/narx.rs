//! The report of an autoregression.

use fleetfoot_dynamics::OutputErrors;
use fleetfoot_sparse::narx::NarxOrder;
use serde_json::{Value, json};

use super::{FORMAT, real};
use crate::{FileRuns, NarxCandidate, NarxReport, NarxScores, NarxSearch};

impl NarxReport {
    /// Orders, equations and scores for programs.
    pub fn to_json(&self) -> Value {
        let tried = self.tried.iter().map(candidate);
        let orders = self.orders.iter().flat_map(|search| &search.scores).map(|score| {
        json!({
            "order": order(&score.order), "candidates": score.candidates, "terms": score.terms, "value": real(score.value),
            "standard_error": score.standard_error.map(real), "rss": score.rss,
        })
    });
        let regions = self.regions.iter().map(|region| {
        let equations = region.equations.iter().map(|equation| {
            let terms = equation.terms.iter().map(|term| {
                json!({ "function": term.function, "coefficient": real(term.coefficient), "err": real(term.err) })
            });
            json!({ "label": equation.label, "terms": terms.collect::<Vec<_>>() })
        });
        json!({ "name": region.name, "rows": region.rows, "shared": region.shared, "equations": equations.collect::<Vec<_>>() })
    });
        let mut report = json!({
            "format": FORMAT, "rows": self.rows, "episodes": self.episodes, "rows_at_border": self.left_out[0], "rows_incomplete": self.left_out[1],
            "order": order(&self.order), "direct": self.direct, "candidates": self.candidates, "partition": self.partition, "choice": self.choice,
            "held_out": self.held_out.as_ref().map(candidate), "linear_of_the_same_lags": self.linear().map(candidate),
            "search": self.search.as_ref().map(search), "tried": tried.collect::<Vec<_>>(), "orders": orders.collect::<Vec<_>>(), "regions": regions.collect::<Vec<_>>(),
            "train": self.train.as_ref().map(scores_json), "test": self.test.as_ref().map(scores_json), "files": self.files.as_ref().map(FileRuns::to_json),
            "notes": self.notes,
        });
        if let Some(refinement) = &self.refinement {
            report["objective"] = refinement.to_json();
        }
        report
    }
}

fn order(order: &NarxOrder) -> Value {
    json!({ "lags_out": order.outputs, "lags_in": order.inputs, "degree": order.degree })
}

fn candidate(candidate: &NarxCandidate) -> Value {
    json!({
        "order": order(&candidate.order), "direct": candidate.order.direct, "partition": candidate.specification, "seed": candidate.seed,
        "terms": candidate.terms, "rrse": real(candidate.rrse), "folds": candidate.folds.iter().map(|&value| real(value)).collect::<Vec<_>>(),
    })
}

fn search(search: &NarxSearch) -> Value {
    let stages = search.stages.iter().map(
        |stage| json!({ "name": stage.name, "orders": stage.orders, "models": stage.models, "rrse": real(stage.rrse) }),
    );
    let cut = search.cut.iter().map(|cut| {
        let mut value = order(cut);
        value["direct"] = json!(cut.direct);
        value
    });
    json!({
        "effort": search.effort.word(), "limit": search.limit, "spent": search.spent, "stages": stages.collect::<Vec<_>>(), "cut": cut.collect::<Vec<_>>(),
    })
}

impl FileRuns {
    /// The runs of every file, and their mean, for programs.
    pub fn to_json(&self) -> Value {
        let files = self.files.iter().map(|file| {
            let mut value = scores_json(&file.scores);
            value["file"] = json!(file.file);
            value
        });
        let mean =
            self.mean.iter().map(|mean| json!({ "name": mean.name, "rrse": real(mean.rrse), "fit": real(mean.fit) }));
        json!({ "by_file": files.collect::<Vec<_>>(), "mean": mean.collect::<Vec<_>>(), "skipped": self.skipped })
    }
}

fn scores_json(scores: &NarxScores) -> Value {
    let one_step = scores.one_step.targets.iter().map(|target| {
        let baselines = target.baselines.iter().map(|baseline| (format!("{:?}", baseline.baseline).to_lowercase(), real(baseline.rmse)));
        json!({
            "name": target.name, "rmse": real(target.rmse), "rrse": real(target.rmse / target.deviation), "r2": real(target.r2),
            "baseline_rmse": baselines.collect::<serde_json::Map<_, _>>(),
        })
    });
    let errors = |errors: &OutputErrors| {
        json!({
            "rows": errors.rows, "lost": errors.lost, "rrse": real(errors.rrse), "fit": real(errors.fit), "rmse": real(errors.rmse), "nrmse": real(errors.nrmse),
            "largest": real(errors.largest), "persistence_rrse": real(errors.persistence), "null_rrse": errors.null.map(real),
        })
    };
    let outputs = scores.free_run.outputs.iter().map(|output| {
        let mut value = errors(&output.errors);
        value["name"] = json!(output.name);
        value
    });
    let runs = scores.free_run.runs.iter().map(|run| {
        json!({
            "episode": run.start.episode, "row": run.start.row, "steps": run.steps, "end": format!("{:?}", run.end).to_lowercase(), "lost_at": run.lost_at,
            "left_domain": run.left_domain, "outputs": run.outputs.iter().map(errors).collect::<Vec<_>>(),
        })
    });
    json!({
        "one_step": one_step.collect::<Vec<_>>(), "free_run": outputs.collect::<Vec<_>>(), "runs": runs.collect::<Vec<_>>(),
        "replayed": scores.free_run.replayed,
        "episodes_skipped": scores.free_run.skipped,
    })
}
