//! From files and a recipe to a piecewise-affine model.

use std::path::PathBuf;

use fleetfoot_data::Progress;
use fleetfoot_pwa::{Identification, Options, Specification};

use crate::{Dataset, Error, Recipe};

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
    /// What the user should know.
    pub notes: Vec<String>,
}

/// What a fit would read and keep.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct FitPlan {
    /// Files.
    pub files: usize,
    /// Episodes.
    pub episodes: usize,
    /// Rows.
    pub rows: usize,
    /// Columns that are read.
    pub columns: Vec<String>,
    /// Columns of the regression, the constant left out.
    pub regressors: usize,
    /// Fitted equations.
    pub targets: usize,
    /// Rows that k-means keeps.
    pub clustered_rows: usize,
    /// Bytes, about.
    pub memory: usize,
    /// What was assumed or left out.
    pub notes: Vec<String>,
}

/// Opens the files and tells what [`fit_pwa`] would do.
pub fn plan_pwa(
    recipe: &Recipe,
    options: &Options,
    files: &[PathBuf],
    progress: &dyn Progress,
) -> Result<FitPlan, Error> {
    let options = with_partitions(recipe, options)?;
    let (dataset, task) = Dataset::for_recipe(recipe, &labels(&options), files, progress)?;
    let cost = fleetfoot_pwa::cost(&task.problem, &options, dataset.rows());
    Ok(FitPlan {
        files: files.len(),
        episodes: dataset.episodes().len(),
        rows: dataset.rows(),
        columns: dataset.columns(),
        regressors: task.problem.library.len(),
        targets: task.problem.equations.iter().filter(|equation| equation.target.is_some()).count(),
        clustered_rows: cost.clustered_rows,
        memory: cost.bytes,
        notes: dataset.notes().to_vec(),
    })
}

fn with_partitions(recipe: &Recipe, options: &Options) -> Result<Options, Error> {
    let mut options = options.clone();
    if let Some(text) = &recipe.model.partition {
        options.partitions = Specification::parse_list(text)?;
    }
    Ok(options)
}

fn labels(options: &Options) -> Vec<String> {
    options.partitions.iter().filter_map(|p| p.label().map(str::to_owned)).collect()
}

/// Fits a piecewise-affine model.
///
/// The partitions are `options.partitions` when given there explicitly, else the recipe's, else one region. `purge` is the gap between held-out
/// and training rows, seconds.
pub fn fit_pwa(
    recipe: &Recipe,
    options: &Options,
    purge: f64,
    files: &[PathBuf],
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let mut options = with_partitions(recipe, options)?;
    let (dataset, task) = Dataset::for_recipe(recipe, &labels(&options), files, progress)?;
    if dataset.step() > 0.0 {
        options.purge = options.purge.max((purge / dataset.step()).ceil() as usize);
    }
    let view = dataset.view()?;
    let mut identification = fleetfoot_pwa::identify(&task.problem, &options, &view, progress)?;
    identification.model.training.recipe = recipe.to_toml();
    let mut notes = dataset.notes().to_vec();
    notes.append(&mut identification.notes);
    Ok(Fitted { identification, episodes: dataset.episodes().len(), files: files.len(), notes })
}
