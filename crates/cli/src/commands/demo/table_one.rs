//! Table I: absolute errors of the accelerations over those of the null model.

use fleetfoot::{
    Interval, PwaReport,
    dynamics::Estimate,
    interval_in_words,
    pwa::{Identification, Score},
};
use serde::Serialize;

use crate::table::{count, number, ratio, table};

/// Table I of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot" (2013): what its authors
/// measured on the real VelociRoACH.
const PAPER: [(&str, [f64; 8]); 6] = [
    ("null", [1.0; 8]),
    ("average", [0.843, 0.781, 0.672, 0.950, 0.790, 0.737, 0.820, 0.821]),
    ("zbox:1.5", [0.791, 0.760, 0.622, 0.925, 0.768, 0.730, 0.744, 0.765]),
    ("kmeans:10", [0.719, 0.728, 0.594, 0.839, 0.648, 0.663, 0.727, 0.713]),
    ("kmeans:50", [0.627, 0.638, 0.521, 0.684, 0.516, 0.529, 0.575, 0.555]),
    ("sigma", [6.581, 10.18, 9.449, 515.9, 294.7, 112.1, 2259.0, 2203.0]),
];
/// Its columns.
const PAPER_COLUMNS: [&str; 8] = ["x''", "y''", "z''", "yaw''", "pitch''", "roll''", "alpha_l''", "alpha_r''"];

pub(super) fn to_text(fitted: &PwaReport) -> String {
    let identification = &fitted.identification;
    format!(
        "Table I. Mean absolute error of the accelerations over the null model's, 10-fold cross-validated:\n\
         {} rows of {}; half-widths of {}\n{}\n{}",
        identification.rows,
        count(fitted.summary.episodes, "run"),
        interval_in_words(&identification.basis),
        errors(fitted),
        ordering(identification)
    )
}

/// The rows of the candidates, and the scale of the errors.
fn errors(fitted: &PwaReport) -> String {
    let identification = &fitted.identification;
    // Accelerations, without the room that "d()/dt" takes.
    let names: Vec<String> = identification.model.fitted().map(|equation| format!("{}'", equation.subject)).collect();
    let header: Vec<&str> = std::iter::once("model").chain(names.iter().map(String::as_str)).collect();
    let mut rows: Vec<Vec<String>> = identification
        .candidates
        .iter()
        .map(|score| {
            let mut row = vec![score.specification.to_string()];
            row.extend(score.over_null_interval.iter().map(|e| {
                let half = 0.5 * (e.high - e.low);
                if half.is_finite() { format!("{} +-{half:.3}", ratio(e.value)) } else { ratio(e.value) }
            }));
            row
        })
        .collect();
    let line = |name: &str, cells: Vec<String>| std::iter::once(name.to_owned()).chain(cells).collect::<Vec<_>>();
    rows.push(line("sigma", identification.sigma.iter().map(|&value| number(value)).collect()));
    rows.push(line("units", units(identification)));
    table(&header, rows)
}

/// The same table as its authors printed it.
pub(super) fn paper() -> String {
    let header: Vec<&str> = std::iter::once("model").chain(PAPER_COLUMNS).collect();
    let rows = PAPER
        .iter()
        .map(|(name, values)| {
            let show = |&value: &f64| if *name == "sigma" { number(value) } else { ratio(value) };
            std::iter::once((*name).to_owned()).chain(values.iter().map(show)).collect()
        })
        .collect();
    format!(
        "The paper's Table I, of the real robot (100,000 rows; sigma in m/s^2 and rad/s^2)\n{}",
        table(&header, rows)
    )
}

fn units(identification: &Identification) -> Vec<String> {
    identification.model.fitted().map(|equation| equation.unit.clone().unwrap_or_else(|| "-".into())).collect()
}

/// Pairs of candidates whose order the paper's table claims, of those that are there.
fn pairs(identification: &Identification) -> Vec<(usize, usize)> {
    let place = |name: &str| identification.candidates.iter().position(|score| score.specification.to_string() == name);
    let ladder: Vec<usize> = ["null", "average", "kmeans:10", "kmeans:50"].into_iter().filter_map(place).collect();
    ladder.windows(2).map(|pair| (pair[1], pair[0])).collect()
}

/// Order of the models by error, with the pairs that differ significantly.
fn ordering(identification: &Identification) -> String {
    let name = |candidate: usize| identification.candidates[candidate].specification.to_string();
    pairs(identification)
        .into_iter()
        .map(|(fine, coarse)| {
            let ratios = identification.error_ratio(fine, coarse);
            let doubtful: Vec<String> = ratios
                .iter()
                .zip(&identification.targets)
                // An interval that is not known proves nothing.
                .filter(|(e, _)| e.high.is_nan() || e.high >= 1.0)
                .map(|(e, target)| format!("{target} {} [{}, {}]", ratio(e.value), ratio(e.low), ratio(e.high)))
                .collect();
            let widest = ratios.iter().map(|e| e.high).fold(f64::NEG_INFINITY, f64::max);
            let (fine, coarse) = (name(fine), name(coarse));
            if doubtful.is_empty() {
                format!(
                    "{fine} is below {coarse} in all of them: its error is at most {} of {coarse}'s (paired, 95 %)",
                    ratio(widest)
                )
            } else {
                format!("{fine} is not proven below {coarse} in {}", doubtful.join(", "))
            }
        })
        .collect::<Vec<_>>()
        .join("\n")
}

/// Table I for programs, and what its authors measured.
#[derive(Serialize)]
pub(super) struct TableReport<'a> {
    targets: &'a [String],
    units: Vec<String>,
    sigma: &'a [f64],
    rows: u64,
    runs: usize,
    intervals: String,
    models: Vec<Row>,
    ordering: Vec<Pair>,
    paper: Vec<Printed>,
}

#[derive(Serialize)]
struct Row {
    model: String,
    mae_over_null: Vec<Interval>,
    mahalanobis: f64,
    loss: f64,
}

impl From<&Score> for Row {
    fn from(score: &Score) -> Self {
        Self {
            model: score.specification.to_string(),
            mae_over_null: intervals(&score.over_null_interval),
            mahalanobis: score.mahalanobis,
            loss: score.loss,
        }
    }
}

/// Two models of which the paper says that the fine one errs less.
#[derive(Serialize)]
struct Pair {
    fine: String,
    coarse: String,
    error_ratio: Vec<Interval>,
}

/// A row of the paper's table.
#[derive(Serialize)]
struct Printed {
    model: &'static str,
    values: [f64; 8],
}

impl<'a> From<&'a PwaReport> for TableReport<'a> {
    fn from(fitted: &'a PwaReport) -> Self {
        let identification = &fitted.identification;
        let name = |candidate: usize| identification.candidates[candidate].specification.to_string();
        let pair = |(fine, coarse)| Pair {
            fine: name(fine),
            coarse: name(coarse),
            error_ratio: intervals(&identification.error_ratio(fine, coarse)),
        };
        Self {
            targets: &identification.targets,
            units: units(identification),
            sigma: &identification.sigma,
            rows: identification.rows,
            runs: fitted.summary.episodes,
            intervals: interval_in_words(&identification.basis),
            models: identification.candidates.iter().map(Row::from).collect(),
            ordering: pairs(identification).into_iter().map(pair).collect(),
            paper: PAPER.iter().map(|&(model, values)| Printed { model, values }).collect(),
        }
    }
}

fn intervals(list: &[Estimate]) -> Vec<Interval> {
    list.iter().map(Interval::from).collect()
}
