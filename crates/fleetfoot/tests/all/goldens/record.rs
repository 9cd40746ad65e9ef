//! Records of models, reports and statistics.

use std::path::PathBuf;

use fleetfoot::{
    Model, Recipe, Silent,
    dynamics::{RolloutOptions, Starts},
    predict_rows, rollout, score,
    statistic::StatisticFile,
};
use serde_json::Value;

use super::{book::Entry, logs::without_folder};

/// Steps of the rollouts.
const HORIZON: usize = 25;

impl Entry {
    /// A model: the hash of its bytes without version and recipe, that of its recipe, and the coefficients that are not zero.
    pub(super) fn model(&mut self, model: &Model) {
        self.words("method", &*model.method);
        self.hash("model", bare(model).as_bytes());
        self.hash("recipe", model.training.recipe.as_bytes());
        for latent in &model.latents {
            let regions = &model.summaries[latent.partition].regions;
            let Some(map) = latent.affine() else { continue };
            for (region, coefficients) in map.coefficients.iter().enumerate() {
                let name = match regions.get(region) {
                    Some(summary) if regions.len() > 1 => format!("{} in {}", latent.name, summary.name),
                    _ => latent.name.clone(),
                };
                let functions = model.libraries[latent.library].iter().map(ToString::to_string);
                let terms = functions.zip(coefficients.iter().copied());
                let all = [("1".to_owned(), map.constants[region])].into_iter().chain(terms);
                self.labelled(&name, all.filter(|(_, value)| *value != 0.0));
            }
        }
    }

    /// A report: the hash of its text, without that of the model, and without the path and the front of orders, which were added since the goldens were written.
    pub(super) fn report(&mut self, name: &str, report: &Value) {
        check_documented(report);
        let mut report = report.clone();
        if let Some(fields) = report.as_object_mut() {
            ["hash", "path"].iter().for_each(|key| drop(fields.remove(*key)));
            fields.get_mut("tried").and_then(Value::as_array_mut).into_iter().flatten().for_each(drop_front);
            for key in ["held_out", "linear_of_the_same_lags"] {
                fields.get_mut(key).into_iter().for_each(drop_front);
            }
        }
        self.hash(name, without_folder(&report.to_string()).as_bytes());
    }

    /// Numbers of a report by their places in it; `null` is NaN, and nothing is told where all are. `*` stands for every entry of a list.
    pub(super) fn field(&mut self, name: &str, report: &Value, place: &str) {
        let mut values = Vec::new();
        collect(report, place.trim_start_matches('/'), &mut values);
        assert!(!values.is_empty(), "{place} is missing from {report:#}");
        if values.iter().all(|value| value.is_null()) {
            return;
        }
        if values.iter().all(|value| value.is_number() || value.is_null()) {
            self.numbers(name, values.iter().map(|value| value.as_f64().unwrap_or(f64::NAN)));
        } else {
            let texts: Vec<String> =
                values.iter().map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_owned)).collect();
            self.words(name, without_folder(&texts.join(", ")));
        }
    }

    /// A statistic: the hash of its bytes, without version and folder, and what it holds.
    pub(super) fn statistic(&mut self, file: &StatisticFile) {
        self.hash("stats", &bytes_of(file));
        self.numbers("rows", [file.scanned.counts().complete as f64, file.chunks() as f64]);
        for task in file.task_summaries() {
            let of = [("deviation", task.deviation), ("r2", task.r2), ("condition", task.condition)];
            self.labelled(&task.name, of.map(|(label, value)| (label.to_owned(), value)));
        }
    }

    /// A model run on logs that did not train it: score, predictions, rollouts.
    pub(super) fn run(&mut self, model: &Model, logs: &[PathBuf]) {
        self.score(model, logs);
        self.predictions(model, logs);
        self.rollouts(model, logs);
    }

    /// One-step scores.
    pub(super) fn score(&mut self, model: &Model, logs: &[PathBuf]) {
        let mut scored = score(model, &Recipe::default(), logs, &Silent).unwrap().to_json();
        for target in scored["targets"].as_array_mut().into_iter().flatten() {
            // Added since the goldens were written.
            target.as_object_mut().map(|fields| fields.remove("explained_variance"));
        }
        self.report("score", &scored);
        self.field("score: rmse", &scored, "targets/*/rmse");
        self.field("score: r2", &scored, "targets/*/r2");
        self.field("score: mahalanobis", &scored, "mahalanobis/value");
    }

    /// Predictions row by row: the hash of all that is told of every row, and the mean of each column.
    pub(super) fn predictions(&mut self, model: &Model, logs: &[PathBuf]) {
        let (mut bytes, mut sums, mut rows) = (Vec::new(), [0.0; 3], 0.0);
        let written = predict_rows(model, &Recipe::default(), logs, &Silent, |_, prediction| {
            let prediction = prediction.predicted;
            let columns = [
                &prediction.measured,
                &prediction.predicted,
                &prediction.residual,
                &prediction.distance,
                &prediction.centre_distance,
            ];
            columns
                .iter()
                .for_each(|column| column.iter().for_each(|value| bytes.extend(canonical(*value).to_le_bytes())));
            bytes.extend(prediction.region.iter().flat_map(|region| region.to_le_bytes()));
            for (sum, column) in
                sums.iter_mut().zip([&prediction.predicted, &prediction.residual, &prediction.distance])
            {
                *sum += column.iter().filter(|value| value.is_finite()).sum::<f64>();
            }
            rows += prediction.rows as f64;
            Ok(())
        });
        let written = written.unwrap();
        self.hash("predictions", &bytes);
        let counts = [written.rows, written.predicted, written.compared, written.outside_domain];
        self.numbers("predictions: rows", counts.map(|count| count as f64));
        self.numbers("predictions: means", sums.map(|sum| sum / rows));
    }

    /// Rollouts from measured states.
    pub(super) fn rollouts(&mut self, model: &Model, logs: &[PathBuf]) {
        let options = RolloutOptions::new(HORIZON);
        let rollouts = rollout(model, &Recipe::default(), logs, &Starts::Even(5), &options, None, None, &Silent);
        let report = without_later(rollouts.unwrap().to_json());
        self.report("rollouts", &report);
        self.field("rollouts: last rmse", &report, &format!("model/rmse/{}/*", HORIZON - 1));
        self.field("rollouts: diverged", &report, "diverged");
    }
}

/// Documentation of the keys of reports.
const KEYS: &str = include_str!("../../../../../docs/reference/reports.md");
/// Keys whose value has names for keys.
const BY_NAME: [&str; 3] = ["baselines", "baseline_rmse", "better_than"];

/// Every key of a report stands on the page of keys.
fn check_documented(report: &Value) {
    match report {
        Value::Array(all) => all.iter().for_each(check_documented),
        Value::Object(fields) => {
            for (key, value) in fields {
                assert!(KEYS.contains(&format!("`{key}`")), "docs/reference/reports.md does not tell of `{key}`");
                match value {
                    Value::Object(named) if BY_NAME.contains(&key.as_str()) => {
                        named.values().for_each(check_documented)
                    }
                    value => check_documented(value),
                }
            }
        }
        _ => {}
    }
}

/// Later entries of a tried autoregression.
fn drop_front(tried: &mut Value) {
    if let Some(fields) = tried.as_object_mut().filter(|fields| fields.contains_key("rrse")) {
        ["coefficients", "loss", "bic", "front", "chosen"].iter().for_each(|key| drop(fields.remove(*key)));
    }
}

/// The report of rollouts without what was added to it since the goldens were written: what there was stays what it was.
fn without_later(mut report: Value) -> Value {
    let later = [
        "ended_outside",
        "summary",
        "displacement",
        "displacement_summary",
        "path",
        "orientation",
        "average_orientation",
        "explained_variance",
        "explained_variance_by_step",
        "beside_reference",
    ];
    let drop_from = |value: &mut Value| {
        if let Some(fields) = value.as_object_mut() {
            later.iter().for_each(|key| drop(fields.remove(*key)));
        }
    };
    drop_from(&mut report);
    drop_from(&mut report["model"]);
    if let Some(baselines) = report["baselines"].as_object_mut() {
        baselines.values_mut().for_each(drop_from);
    }
    report
}

/// A model's file without the version that wrote it and its recipe.
pub(super) fn bare(model: &Model) -> String {
    let mut bare = model.clone();
    bare.training.version.clear();
    bare.training.recipe.clear();
    bare.to_json()
}

/// The one NaN whose bits are the same everywhere.
fn canonical(value: f64) -> f64 {
    if value.is_nan() { f64::NAN } else { value }
}

/// The bytes of a statistic without the version that wrote it and the folder of its files.
pub(super) fn bytes_of(file: &StatisticFile) -> Vec<u8> {
    let mut file = file.clone();
    file.version.clear();
    for record in &mut file.files {
        record.name = record.name.rsplit('/').next().unwrap_or_default().to_owned();
    }
    file.to_bytes().unwrap()
}

fn collect<'a>(value: &'a Value, place: &str, values: &mut Vec<&'a Value>) {
    let (head, rest) = place.split_once('/').unwrap_or((place, ""));
    match value {
        _ if place.is_empty() => values.push(value),
        Value::Array(list) if head == "*" => list.iter().for_each(|item| collect(item, rest, values)),
        Value::Array(list) => {
            if let Some(item) = head.parse().ok().and_then(|at: usize| list.get(at)) {
                collect(item, rest, values);
            }
        }
        Value::Object(fields) => {
            if let Some(item) = fields.get(head) {
                collect(item, rest, values);
            }
        }
        _ => {}
    }
}
