//! Training data of a model, as text.

use serde::{Deserialize, Serialize};

use super::{
    Real, Reals, floats,
    marks::{self, MarksText},
    reals,
};
use crate::{Estimated, Training};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TrainingText {
    version: String,
    recipe: String,
    seed: u64,
    rows: u64,
    episodes: Vec<(String, String)>,
    /// By the identity of an episode: for some fields, hashes of some rows.
    #[serde(default, skip_serializing_if = "MarksText::is_empty")]
    marks: MarksText,
    target_mean: Reals,
    target_covariance: Reals,
    target_deviation: Reals,
    state_covariance: Reals,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    state_mean: Reals,
    /// Name, value, half the width of the 95 % interval; of models whose parameters were estimated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    parameters: Vec<(String, Real, Real)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    parameter_covariance: Reals,
}

impl From<&Training> for TrainingText {
    fn from(t: &Training) -> Self {
        Self {
            version: t.version.clone(),
            recipe: t.recipe.clone(),
            seed: t.seed,
            rows: t.rows,
            episodes: t.episodes.iter().map(|episode| (episode.id.clone(), episode.name.clone())).collect(),
            marks: marks::of(&t.episodes),
            target_mean: reals(&t.target_mean),
            target_covariance: reals(&t.target_covariance),
            target_deviation: reals(&t.target_deviation),
            state_covariance: reals(&t.state_covariance),
            state_mean: reals(&t.state_mean),
            parameters: t.parameters.iter().map(|p| (p.name.clone(), Real(p.value), Real(p.half_width))).collect(),
            parameter_covariance: reals(&t.parameter_covariance),
        }
    }
}

impl TrainingText {
    pub(super) fn into_training(self) -> Result<Training, String> {
        let problem = "marks of an episode that is not there, or that are no hexadecimal numbers";
        Ok(Training {
            version: self.version,
            recipe: self.recipe,
            seed: self.seed,
            rows: self.rows,
            episodes: marks::joined(self.episodes, self.marks).ok_or(problem)?,
            target_mean: floats(self.target_mean),
            target_covariance: floats(self.target_covariance),
            target_deviation: floats(self.target_deviation),
            state_covariance: floats(self.state_covariance),
            state_mean: floats(self.state_mean),
            parameters: (self.parameters.into_iter())
                .map(|(name, value, half_width)| Estimated { name, value: value.0, half_width: half_width.0 })
                .collect(),
            parameter_covariance: floats(self.parameter_covariance),
        })
    }
}
