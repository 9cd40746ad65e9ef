//! What a fit of a piecewise-affine model is asked for, and what it found.

use std::path::{Path, PathBuf};

use fleetfoot_output::together;
use fleetfoot_pwa::{Identification, Specification};

use crate::{error::Error, model_file::write_model, objective::Refinement, rollout_choice::RolloutChoice};

/// What is wanted beside the model.
#[derive(Debug, Clone, Copy, Default)]
pub struct PwaRequest {
    /// The models of all partitions, not only the chosen one.
    pub keep_all: bool,
}

/// What a fit found, and on what.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Fitted {
    /// The model, its rivals, and their scores.
    pub identification: Identification,
    /// Episodes used.
    pub episodes: usize,
    /// Files used.
    pub files: usize,
    /// How partition and spans were chosen by rollouts, where they were.
    pub rollouts: Option<RolloutChoice>,
    /// The fit to simulations, where it was asked for.
    pub refinement: Option<Refinement>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Fitted {
    /// Writes the models of all candidates beside the chosen one's file, if they were kept ([`PwaRequest::keep_all`]); tells the files, in the
    /// order of the candidates.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write_rivals(&self, chosen: &Path) -> Result<Vec<PathBuf>, Error> {
        let found = &self.identification;
        let written: Vec<PathBuf> =
            found.models.iter().zip(&found.candidates).map(|(_, own)| rival(chosen, &own.specification)).collect();
        together(|| found.models.iter().zip(&written).try_for_each(|(model, path)| write_model(model, path)))?;
        Ok(written)
    }
}

/// `model.json` and `kmeans:10` make `model_kmeans10.json`.
pub fn rival(chosen: &Path, specification: &Specification) -> PathBuf {
    let stem = chosen.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
    let name: String = specification
        .to_string()
        .chars()
        .filter(|&c| c != ':')
        .map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '-' })
        .collect();
    let extension = chosen.extension().map_or_else(|| "json".into(), |extension| extension.to_string_lossy());
    chosen.with_file_name(format!("{stem}_{name}.{extension}"))
}
