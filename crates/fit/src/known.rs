//! A model whose equations are all given: known physics, as a baseline of fitted models.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_model::{Column, Model, Role, TrainedEpisode, Training};
use fleetfoot_recipe::{Recipe, State};
use fleetfoot_stats::{Gram, Grid, reduce};
use fleetfoot_task::KnownTask;

use crate::{constant::constant_target, error::Error};

/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// A model of given equations, and the logs on which its states were measured.
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
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Returns true if every state of a recipe is given, so that nothing is fitted.
pub fn is_known(recipe: &Recipe) -> bool {
    let of_states =
        matches!(recipe.model.predict.as_deref(), None | Some("derivative" | "next" | "delta" | "difference"));
    of_states && !recipe.states.is_empty() && recipe.states.values().all(State::is_given)
}

/// The model of a recipe in which every state is given. The logs give the sampling period, and the spread of the
/// states, which is the unit of rollout errors.
///
/// # Errors
/// Those of the recipe and of opening; a row with all states is nowhere.
pub fn known_model(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<KnownModel, Error> {
    let logs = &logs.into();
    let (dataset, task) = Dataset::for_known(recipe, logs, progress)?;
    let model = given("known", recipe, task, (&dataset.view()?, dataset.step()), progress)?;
    Ok(KnownModel {
        rows: model.training.rows,
        episodes: dataset.episodes().len(),
        files: logs.len(),
        notes: dataset.notes().to_vec(),
        model,
    })
}

/// A model of given equations on an opened recording, which gives the spread of its states.
pub(crate) fn given(
    method: &str,
    recipe: &Recipe,
    task: KnownTask,
    (view, step): (&dyn Source, f64),
    progress: &dyn Progress,
) -> Result<Model, Error> {
    let states = task.columns.iter().filter(|column| column.role == Role::State);
    let states: Vec<Expr> = states.map(|column| Expr::column(column.name.as_str())).collect();
    let spread = moments(view, &states, progress)?;
    if spread.rows == 0 {
        return Err(Error::too_few_rows(
            0,
            1,
            "no row has a value of every state: the spread of the states is unknown; give other files".into(),
        ));
    }
    // The data of a parameter must vary.
    let estimated = task.equations.iter().filter(|equation| equation.target.is_some());
    for equation in estimated {
        let at = names_of(&task.columns, Role::State).position(|name| name == equation.subject);
        if let Some(at) = at.filter(|&at| spread.is_constant(at)) {
            return Err(constant_target(&equation.subject, spread.mean[at]));
        }
    }
    let targets: Vec<Expr> = task.equations.iter().filter_map(|equation| equation.target.clone()).collect();
    let measured = moments(view, &targets, progress)?;
    let training = Training {
        version: env!("CARGO_PKG_VERSION").into(),
        recipe: recipe.to_toml(),
        rows: spread.rows,
        episodes: view.episodes().iter().map(TrainedEpisode::from).collect(),
        target_mean: measured.mean.clone(),
        target_covariance: covariance(&measured),
        target_deviation: vec![f64::NAN; targets.len()],
        state_covariance: covariance(&spread),
        state_mean: spread.mean.clone(),
        ..Training::default()
    };
    let mut model = Model::new(method, task.columns, step, training);
    model.equations = task.equations;
    Ok(model)
}

/// The columns of a role, by name.
fn names_of(columns: &[Column], role: Role) -> impl Iterator<Item = &str> {
    columns.iter().filter(move |column| column.role == role).map(|column| column.name.as_str())
}

/// The covariance of the sums, packed.
fn covariance(sums: &Gram) -> Vec<f64> {
    let entries = (0..sums.mean.len()).flat_map(|i| (0..=i).map(move |j| (i, j)));
    entries.map(|(i, j)| sums.get(i, j) / sums.weight).collect()
}

/// Moments of some expressions over the rows that have them all.
fn moments(view: &dyn Source, expressions: &[Expr], progress: &dyn Progress) -> Result<Gram, Error> {
    progress.stage("scan");
    let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
    let design = Design::compile(expressions, &names).map_err(fleetfoot_dynamics::Error::from)?;
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
    let mut total = Gram::new(expressions.len());
    if expressions.is_empty() {
        return Ok(total);
    }
    reduce(
        view,
        &chunks,
        design.halo(),
        progress,
        || (Gram::new(expressions.len()), DesignRows::default()),
        |(sum, complete), _, block, rows| -> Result<(), Error> {
            design.evaluate(block, rows, complete);
            if complete.rows() > 0 {
                let columns: Vec<&[f64]> = (0..expressions.len()).map(|j| complete.output(j)).collect();
                sum.merge(&Gram::of_columns(&columns, None));
            }
            Ok(())
        },
        |_, (sum, _)| {
            if sum.rows > 0 {
                total.merge(&sum);
            }
            Ok(())
        },
    )?;
    Ok(total)
}
