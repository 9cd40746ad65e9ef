//! Recordings followed by a model within bounds: `resimulate`.

mod words;
mod writer;

use std::path::Path;

use fleetfoot_data::Progress;
use fleetfoot_data::setting::ITERATIONS;
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_estimate::{Ending, EstimateError, Resimulated, Resimulation, ResimulationOptions};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_recipe::{Recipe, ResimulateSection};
use serde::Serialize;

use crate::{on_files::is_needed, output};

/// Recordings that a model followed, and notes about them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Followed {
    /// Result of the resimulation.
    pub resimulation: Resimulation,
    /// Units of the columns, where they are known.
    pub units: Vec<Option<String>>,
    /// Names of the episodes that were followed.
    pub names: Vec<String>,
    /// Names of those that were left out.
    pub left_out: Vec<String>,
    /// Names of those that the model was trained on.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Deviations of a column over the episodes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Spread {
    /// Half of the episodes are below.
    pub median: f64,
    /// Nine of ten are below.
    pub ninth: f64,
    /// The largest.
    pub worst: f64,
}

impl Spread {
    /// Quantiles between neighbours; infinite ones count as they are. NaN without a number.
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
            let place = share * last as f64;
            let (low, high) = (sorted[place as usize], sorted[(place.ceil() as usize).min(last)]);
            // Not between a number and infinity.
            if low == high || high.is_infinite() { high } else { low + (high - low) * place.fract() }
        };
        Self { median: at(0.5), ninth: at(0.9), worst: at(1.0) }
    }
}

impl Followed {
    /// Root mean square of followed less recorded, over the episodes, of a column.
    pub fn followed(&self, column: usize) -> Spread {
        Spread::of(self.resimulation.episodes.iter().map(|episode| self.resimulation.deviations_of(episode)[column]))
    }

    /// The same of the open loop; `None` for an input.
    pub fn open_loop(&self, column: usize) -> Option<Spread> {
        let of = |resimulated: &Resimulated| self.resimulation.open_loop_deviations(resimulated)[column];
        (column < self.resimulation.states).then(|| Spread::of(self.resimulation.episodes.iter().map(of)))
    }

    /// The worst of the certificates: of the dynamics, of the bounds, stationarity.
    pub fn worst(&self) -> [f64; 3] {
        let worst = |of: fn(&Resimulated) -> f64| self.resimulation.episodes.iter().map(of).fold(0.0, f64::max);
        [
            worst(|episode| episode.certificate.dynamics),
            worst(|episode| episode.certificate.bounds),
            worst(|episode| episode.certificate.stationarity),
        ]
    }

    /// Episodes that ended at a minimum.
    pub fn minima(&self) -> usize {
        self.resimulation.episodes.iter().filter(|episode| episode.ending == Ending::Minimum).count()
    }

    /// Warnings for the user, in sentences.
    pub fn warnings(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for (episode, name) in self.resimulation.episodes.iter().zip(&self.names) {
            let certificate = &episode.certificate;
            if episode.ending != Ending::Minimum {
                notes.push(format!(
                    "{name}: {} after {} convex programs, the dynamics violated by {:.1e} of a state's spread, stationarity {:.1e}: {}",
                    if episode.ending == Ending::Stalled { "no step was better" } else { "not at a minimum" },
                    episode.programs,
                    certificate.dynamics,
                    certificate.stationarity,
                    if episode.ending == Ending::Stalled {
                        "look whether the model's regions or functions break there, or widen the bounds".to_owned()
                    } else {
                        format!("allow more ({ITERATIONS})")
                    }
                ));
            }
        }
        notes
    }
}

/// Follows the episodes of logs with a model; writes the result if `output` is given. Settings are those of
/// `[resimulate]` in `changes`, above those of the model's recipe.
///
/// # Errors
/// Those of the settings, of opening and reading, of [`fleetfoot_estimate::resimulate`] and of writing.
pub fn resimulate(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Followed, Error> {
    let kind = output.map(output::kind).transpose()?;
    let logs = logs.into();
    let mut recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    recipe.override_with(changes.resimulate.clone());
    let options = options(&recipe.resimulate)?;
    let dataset = Dataset::for_run(model, changes, &logs, &|name| is_needed(model, name, true), progress)?;
    let view = dataset.view()?;
    let resimulation = fleetfoot_estimate::resimulate(model, &view, &options, progress).map_err(refused)?;
    dataset.all_were_read();
    let name = |episode: usize| dataset.episodes()[episode].name.clone();
    let unit = |column: &String| model.column(column).and_then(|at| model.columns[at].unit.clone());
    let mut notes = dataset.notes().to_vec();
    let reasons = [
        (&resimulation.missing, "a column that is followed has no value, or there are fewer than two rows"),
        (&resimulation.undefined, "the model has no finite value along them"),
    ];
    for (left, reason) in reasons.iter().filter(|(left, _)| !left.is_empty()) {
        let names: Vec<String> = left.iter().take(3).map(|&episode| name(episode)).collect();
        let (count, more) = (left.len(), if left.len() > 3 { ", ..." } else { "" });
        let all = dataset.episodes().len();
        notes.push(format!("{count} of {all} episodes left out ({}{more}): {reason}", names.join(", ")));
    }
    let followed = Followed {
        units: resimulation.columns.iter().map(unit).collect(),
        names: resimulation.episodes.iter().map(|episode| name(episode.episode)).collect(),
        left_out: resimulation.missing.iter().chain(&resimulation.undefined).map(|&episode| name(episode)).collect(),
        in_sample: dataset.in_sample(model),
        notes,
        resimulation,
    };
    if let (Some(path), Some(kind)) = (output, kind) {
        writer::write_followed(kind, path, model, &|episode| dataset.log_offset(episode), &followed, &logs)?;
    }
    Ok(followed)
}

/// Turns a request that cannot be met into an error of the request.
fn refused(error: EstimateError) -> Error {
    match &error {
        EstimateError::Option { .. } | EstimateError::Bounds { .. } | EstimateError::TooLong { .. } => {
            Error::value(error.to_string())
        }
        EstimateError::NoInput { name, .. } | EstimateError::NotFollowed { name, .. } => {
            Error::unknown(name, error.to_string())
        }
        EstimateError::LooksBack { .. } | EstimateError::Filtered { .. } | EstimateError::MixedSteps { .. } => {
            Error::conflict(error.to_string())
        }
        _ => error.into(),
    }
}

/// Options of `[resimulate]`, checked if that is possible without the model.
fn options(section: &ResimulateSection) -> Result<ResimulationOptions, Error> {
    let mut options = ResimulationOptions::default();
    options.every = section.every.unwrap_or(options.every);
    options.widen = section.widen.unwrap_or(options.widen);
    options.iterations = section.iterations.unwrap_or(options.iterations);
    options.free = section.free.as_deref().map(words::names).unwrap_or_default();
    options.deviations = section.deviations.as_deref().map(words::values).transpose()?.unwrap_or_default();
    options.bounds = section.bounds.as_deref().map(words::bounds).transpose()?.unwrap_or_default();
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_keep_infinity() {
        let spread = Spread::of([3.0, 1.0, f64::NAN, f64::INFINITY, 2.0].into_iter());
        assert_eq!((spread.median, spread.ninth, spread.worst), (2.5, f64::INFINITY, f64::INFINITY));
        assert!(Spread::of(std::iter::empty()).median.is_nan());
        assert_eq!(Spread::of(std::iter::once(7.0)).ninth, 7.0);
    }
}
