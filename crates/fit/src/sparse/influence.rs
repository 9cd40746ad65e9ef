//! Influence of every episode on a sparse fit, by name.

use fleetfoot_data::Progress;
use fleetfoot_dataset::StatisticFile;
use fleetfoot_sparse::inference::{InferenceError, Influence, influence};
use serde::Serialize;

use super::problem::Problem;
use crate::{error::Error, serialize};

/// A fit and the fits without each of its episodes: least squares on the columns selected from all rows.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct LeaveOneOutReport {
    /// Root mean square over all rows of the measured tasks' errors, each in its scale, by the fit on all rows.
    #[serde(rename = "in_sample_rms")]
    pub in_sample: f64,
    /// The same, every row by the fit without its episode; NaN when an episode cannot be left out.
    #[serde(rename = "held_out_rms")]
    pub held_out: f64,
    /// Episodes by descending Cook's distance.
    pub episodes: Vec<EpisodeInfluence>,
}

/// Change of the fit without an episode.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct EpisodeInfluence {
    /// The episode, as the statistic calls it.
    pub name: String,
    /// Its share of the weight of all rows.
    pub share: f64,
    /// Cook's distance; infinite if the other episodes do not determine the selected coefficients.
    #[serde(rename = "cooks_distance")]
    pub distance: f64,
    /// Root mean square of its errors, in the tasks' scales, by the fit on all rows.
    #[serde(rename = "in_sample_rms")]
    pub in_sample: f64,
    /// The same by the fit without it; NaN when there is none.
    #[serde(rename = "held_out_rms")]
    pub held_out: f64,
    /// The coefficient that changes most in its standard errors, `T: N1*rho`, and that change; `None` without a fit or
    /// without standard errors.
    #[serde(serialize_with = "serialize::largest_change")]
    pub largest_change: Option<(String, f64)>,
}

/// Leaves every episode out once. The support is that of the coefficients theta (p); `errors` (p): their standard
/// errors.
///
/// `None`, with a note that has the reason, if there is no answer.
pub(super) fn leave_one_out(
    problem: &Problem<'_>,
    file: &StatisticFile,
    theta: &[f64],
    errors: Option<&[f64]>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<LeaveOneOutReport>, Error> {
    let support: Vec<usize> = (0..theta.len()).filter(|&j| theta[j] != 0.0).collect();
    if support.is_empty() {
        notes.push("no influence of episodes: nothing was selected, so there is no coefficient to change".into());
        return Ok(None);
    }
    progress.stage("leave one out");
    let influence_of = match influence(&problem.banks, &problem.structure, &problem.assembly, &support, progress) {
        Ok(influence) => influence,
        Err(error @ InferenceError::Cancelled(_)) => return Err(error.into()),
        Err(error) => {
            notes.push(format!("no influence of episodes: {}", reason(problem, &error)));
            return Ok(None);
        }
    };
    let lost = influence_of.episodes.iter().filter(|episode| episode.coefficients.is_empty()).count();
    if lost > 0 {
        notes.push(format!(
            "{lost} of {} episodes cannot be left out: the others do not determine the selected coefficients (Cook's distance is infinite)",
            influence_of.episodes.len()
        ));
    }
    let of = |episode: &Influence| EpisodeInfluence {
        name: name(file, episode),
        share: episode.share,
        distance: episode.distance,
        in_sample: episode.in_sample.sqrt(),
        held_out: episode.held_out.sqrt(),
        largest_change: largest_change(problem, &support, &influence_of.coefficients, episode, errors),
    };
    Ok(Some(LeaveOneOutReport {
        in_sample: influence_of.mean_square.sqrt(),
        held_out: influence_of.held_out.sqrt(),
        episodes: influence_of.episodes.iter().map(of).collect(),
    }))
}

/// Why nothing can be left out, in the names of the recipe.
fn reason(problem: &Problem<'_>, error: &InferenceError) -> String {
    match error {
        InferenceError::TooFewClusters { clusters } => {
            format!("the data have {clusters} of them, and the fit without one needs at least two; give more logs")
        }
        InferenceError::NotIdentified { columns } => {
            let names: Vec<String> = columns.iter().map(|&column| problem.name(column)).collect();
            format!(
                "the rows and priors do not separate these from the other selected ones: {}; select fewer or add a prior",
                names.join(", ")
            )
        }
        other => other.to_string(),
    }
}

fn name(file: &StatisticFile, episode: &Influence) -> String {
    let record = file.episodes.iter().find(|record| record.id == episode.episode);
    record.map_or_else(|| episode.episode.to_string(), |record| record.name.clone())
}

fn largest_change(
    problem: &Problem<'_>,
    support: &[usize],
    coefficients: &[f64],
    without: &Influence,
    errors: Option<&[f64]>,
) -> Option<(String, f64)> {
    let errors = errors?;
    let changes = support.iter().zip(coefficients).zip(&without.coefficients);
    changes
        .map(|((&j, all), without)| (j, (without - all) / errors[j]))
        .filter(|(_, change)| change.is_finite())
        .max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))
        .map(|(j, change)| (problem.name(j), change))
}
