//! A model whose equations are all given: what is known of the physics, as a baseline for what is fitted.

use fleetfoot_data::{Progress, Source};
use fleetfoot_model::{Model, Role, Training};
use fleetfoot_stats::{Gram, Grid, reduce};

use crate::{Dataset, Error, Logs, Recipe};

/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// A model of given equations, and on what its states were measured.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct KnownModel {
    /// The model.
    pub model: Model,
    /// Rows whose states are all there.
    pub rows: u64,
    /// Episodes.
    pub episodes: usize,
    /// Files.
    pub files: usize,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Whether every state of a recipe is given, and so nothing is to be fitted.
pub fn is_known(recipe: &Recipe) -> bool {
    let of_states =
        matches!(recipe.model.predict.as_deref(), None | Some("derivative" | "next" | "delta" | "difference"));
    of_states && !recipe.states.is_empty() && recipe.states.values().all(|state| state.known.is_some())
}

/// The model of a recipe in which every state is given. The logs tell the sampling period, and how far the states spread: what errors of rollouts are measured by.
///
/// # Errors
/// Those of the recipe and of opening; a row with all states is nowhere.
pub fn known_model(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<KnownModel, Error> {
    let logs = &logs.into();
    let (dataset, task) = Dataset::for_known(recipe, logs, progress)?;
    let view = dataset.view()?;
    let states: Vec<usize> = task
        .columns
        .iter()
        .filter(|column| column.role == Role::State)
        .filter_map(|column| view.column_index(&column.name))
        .collect();
    let spread = spread(&view, &states, progress)?;
    if spread.rows == 0 {
        return Err(Error::too_few_rows(
            0,
            1,
            "no row has a value of every state: how far the states spread is not known; give other files".into(),
        ));
    }
    let covariance = |i: usize| (0..=i).map(move |j| (i, j));
    let training = Training {
        version: env!("CARGO_PKG_VERSION").into(),
        recipe: recipe.to_toml(),
        rows: spread.rows,
        episodes: view.episodes().iter().map(|episode| (episode.id.to_string(), episode.name.clone())).collect(),
        state_covariance: (0..states.len())
            .flat_map(covariance)
            .map(|(i, j)| spread.get(i, j) / spread.weight)
            .collect(),
        ..Training::default()
    };
    let mut model = Model::new("known", task.columns, dataset.step(), training);
    model.equations = task.equations;
    Ok(KnownModel {
        model,
        rows: spread.rows,
        episodes: dataset.episodes().len(),
        files: logs.len(),
        notes: dataset.notes().to_vec(),
    })
}

/// Moments of some columns over the rows that have them all.
fn spread(view: &dyn Source, columns: &[usize], progress: &dyn Progress) -> Result<Gram, Error> {
    progress.stage("scan");
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
    let mut total = Gram::new(columns.len());
    reduce(
        view,
        &chunks,
        fleetfoot_data::Halo::default(),
        progress,
        || Gram::new(columns.len()),
        |sum, _, block, rows| -> Result<(), Error> {
            let there = |row: &usize| columns.iter().all(|&column| block.core(column)[*row].is_finite());
            let complete: Vec<usize> = rows.filter(there).collect();
            let values = |column: &usize| complete.iter().map(|&row| block.core(*column)[row]).collect();
            let values: Vec<Vec<f64>> = columns.iter().map(values).collect();
            if !complete.is_empty() {
                let columns: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
                sum.merge(&Gram::of_columns(&columns, None));
            }
            Ok(())
        },
        |_, sum| {
            if sum.rows > 0 {
                total.merge(&sum);
            }
            Ok(())
        },
    )?;
    Ok(total)
}
