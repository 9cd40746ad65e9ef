//! A model of a network that another program trained: the maps of an ONNX file, the meaning of its columns from a recipe.

use std::{io::Read, path::Path};

use fleetfoot_codegen::{OnnxError, OnnxNetwork};
use fleetfoot_data::setting::{COLUMNS, DT};
use fleetfoot_data::{Column as DataColumn, Progress, Source, packed, packed_row};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_dynamics::{Predicted, Predictor, PredictorWorkspace, RowStatus};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{AffineMap, Basis, Latent, Model, Partition, Prediction, RegionSummary, Role, Training};
use fleetfoot_recipe::{Derivative, PwaSection, Recipe, items};
use fleetfoot_stats::{Gram, Grid, reduce};
use fleetfoot_task::Task;

use crate::{error::Error, method::FitRequest, network::predicting, pipeline::fit, pwa::Pwa, radial};

/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// A model of an imported network.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ImportedModel {
    /// The model.
    pub model: Model,
    /// Regressor of each input of the network, in its order.
    pub inputs: Vec<String>,
    /// Target of each output of the network, in its order.
    pub outputs: Vec<String>,
    /// Units of the hidden layers and their activation, `16-16 tanh`, or a cell and its units, `gru 16`; `None` for an affine map.
    pub hidden: Option<String>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// The model of an ONNX file whose inputs are the regressors of a recipe, and whose outputs are its targets, as for
/// `fit network`: states, inputs and their lags; changes from row to row unless the recipe predicts something else.
///
/// `logs` are those that trained the network: they give training ranges, residuals and the time between rows. Without
/// them these are unknown, `step` or the recipe's `[time]` (`dt`, `rate`) gives the time between rows in seconds, and
/// the recipe names fields without wildcards.
///
/// # Errors
/// Those of the recipe and of reading; [`Error::Import`]; no time between rows, or two.
pub fn import_network(
    path: &Path,
    recipe: &Recipe,
    logs: Option<&Logs>,
    step: Option<f64>,
    progress: &dyn Progress,
) -> Result<ImportedModel, Error> {
    refuse(recipe)?;
    let mut recipe = predicting(recipe);
    // An imported network has one region.
    (recipe.model.partition, recipe.model.partition_on) = (Some("average".into()), None);
    recipe.pwa = PwaSection::default();
    let mut notes = Vec::new();
    let mut model = match (logs, step) {
        (None, _) => unseen(&recipe, step)?,
        (Some(_), Some(step)) => {
            return Err(Error::conflict(format!("{}: the logs give the time between rows; remove it", DT.to(step))));
        }
        (Some(logs), None) if logs.is_statistic() => {
            return Err(Error::needs_rows(
                "residuals need rows, and a statistic has none; give the logs instead".into(),
            ));
        }
        // The linear model of the same regressors has all statistics of the rows but residuals.
        (Some(logs), None) => fit::<Pwa>(&recipe, &FitRequest::default(), logs.clone(), progress)?.model,
    };
    let library = &model.libraries[model.latents.first().map_or(0, |latent| latent.library)];
    let inputs: Vec<String> = library.iter().map(ToString::to_string).collect();
    let outputs = model.outputs();
    let network = read(path, &inputs, &outputs)?;
    let hidden = network.hidden.as_ref().map(words);
    model.method = format!("imported network {}", hidden.as_deref().unwrap_or("linear"));
    model.latents.iter_mut().zip(network.maps()).for_each(|(latent, map)| latent.map = map);
    match logs {
        Some(logs) => {
            let (dataset, _) = Dataset::for_recipe(&recipe, &[], logs.clone(), progress)?;
            let residuals = residuals(&model, &dataset.view()?, progress)?;
            model.summaries[0].regions[0].residual_covariance = residuals;
        }
        None => {
            standardised(&mut model, &network);
            notes.push(
                "no logs were given: training ranges and residuals are unknown; score the network on logs that did not train it"
                    .to_owned(),
            );
        }
    }
    Ok(ImportedModel { model, inputs, outputs, hidden, notes })
}

/// The model of a recipe of which no row was seen, with maps that are zero.
fn unseen(recipe: &Recipe, step: Option<f64>) -> Result<Model, Error> {
    let fields = fields(recipe);
    let is_wildcard = |text: &str| text.contains("[*]") || text.trim_end().ends_with(".*");
    if let Some((name, _)) = recipe.columns.iter().find(|(_, text)| is_wildcard(text)) {
        return Err(Error::value(format!(
            "{}: without logs the fields of a wildcard are unknown; give the logs, or write one name a field",
            COLUMNS.entry(name)
        )));
    }
    let recipe = recipe.expand(&fields)?;
    let problem = Task::resolve(&recipe, &fields, &[], 0.0)?.problem;
    let is_discrete = problem.equations.iter().any(|equation| equation.prediction != Prediction::Value);
    let step = match step.or(recipe.time.dt).or(recipe.time.rate.map(|rate| 1.0 / rate)) {
        Some(step) if step.is_finite() && step > 0.0 => step,
        Some(step) => return Err(Error::value(format!("{}: write a positive number of seconds", DT.to(step)))),
        None if is_discrete => {
            return Err(Error::missing(format!(
                "the time between rows is unknown, and the file of a network does not have it; give {}, or the logs",
                DT.to("SECONDS")
            )));
        }
        None => 0.0,
    };
    let names: Vec<String> = problem
        .equations
        .iter()
        .filter(|equation| equation.target.is_some())
        .filter_map(|equation| equation.right.as_column().map(str::to_owned))
        .collect();
    let (functions, targets) = (problem.library.len(), names.len());
    let states = problem.columns.iter().filter(|column| column.role == Role::State).count();
    let training = Training {
        version: env!("CARGO_PKG_VERSION").into(),
        recipe: recipe.to_toml(),
        target_mean: vec![0.0; targets],
        target_covariance: identity(targets),
        target_deviation: vec![f64::NAN; targets],
        state_covariance: identity(states),
        state_mean: vec![0.0; states],
        ..Training::default()
    };
    let mut model = Model::new("", problem.columns, step, training);
    let partition = Partition::whole();
    let region = RegionSummary {
        name: partition.region_name(0),
        rows: 0,
        mean: vec![f64::NAN; functions],
        covariance: vec![f64::NAN; packed_row(functions)],
        range: vec![[f64::NEG_INFINITY, f64::INFINITY]; functions],
        residual_covariance: vec![f64::NAN; packed_row(targets)],
        rank: functions,
        condition: f64::NAN,
        confounded: Vec::new(),
    };
    model.add_partition(partition, vec![region]);
    let zero = AffineMap { constants: vec![0.0], coefficients: vec![vec![0.0; functions]] };
    let latent = |name| Latent { name, library: 0, partition: 0, map: zero.clone().into(), beyond: Vec::new() };
    model.latents = names.into_iter().map(latent).collect();
    model.libraries = vec![problem.library];
    model.equations = problem.equations;
    Ok(model)
}

/// A packed matrix with ones on its diagonal: errors count in the units of the columns.
fn identity(count: usize) -> Vec<f64> {
    let mut matrix = vec![0.0; packed_row(count)];
    (0..count).for_each(|i| matrix[packed(i, i)] = 1.0);
    matrix
}

/// Hidden layers in words.
fn words(hidden: &Basis) -> String {
    match hidden {
        Basis::Network(network) => format!("{} {}", network.sizes(), network.activation.name()),
        Basis::Recurrent(cell) => format!("{} {}", cell.cell.name(), cell.count()),
        Basis::Gaussian(_) => hidden.kind().into(),
    }
}

/// The scale by which hidden layers standardise a function of the library.
fn scale(hidden: &Basis, function: usize) -> Option<f64> {
    let at = hidden.inputs().iter().position(|&input| input == function)?;
    match hidden {
        Basis::Network(network) => network.scale.get(at).copied(),
        Basis::Recurrent(cell) => cell.scale.get(at % cell.columns()).copied(),
        Basis::Gaussian(gaussian) => gaussian.scale.get(at).copied(),
    }
}

/// Takes the variances of states by which the network standardises them.
fn standardised(model: &mut Model, network: &OnnxNetwork) {
    let Some(hidden) = &network.hidden else { return };
    let states = model.columns.iter().filter(|column| column.role == Role::State);
    for (i, state) in states.enumerate() {
        let at = model.libraries[0].iter().position(|function| function.as_column() == Some(state.name.as_str()));
        if let Some(scale) = at.and_then(|at| scale(hidden, at)) {
            model.training.state_covariance[packed(i, i)] = scale * scale;
        }
    }
}

/// Second moments of a model's residuals over all rows, packed.
fn residuals(model: &Model, view: &dyn Source, progress: &dyn Progress) -> Result<Vec<f64>, Error> {
    let columns: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &columns)?;
    let targets = model.latents.len();
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
    let mut total = Gram::new(targets);
    reduce(
        view,
        &chunks,
        predictor.halo(),
        progress,
        || (Gram::new(targets), PredictorWorkspace::default(), Predicted::default()),
        |(sum, workspace, predicted), _, block, rows| -> Result<(), Error> {
            predictor.predict(block, rows, workspace, predicted);
            let complete = |row: &usize| predicted.status[*row] == RowStatus::Complete;
            let column = |target: usize| {
                let rows = (0..predicted.rows).filter(complete);
                rows.map(|row| predicted.residual[target * predicted.rows + row]).collect()
            };
            let columns: Vec<Vec<f64>> = (0..targets).map(column).collect();
            if columns.iter().any(|column| !column.is_empty()) {
                let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
                sum.merge(&Gram::of_columns(&columns, None));
            }
            Ok(())
        },
        |_, (sum, ..)| {
            if sum.rows > 0 {
                total.merge(&sum);
            }
            Ok(())
        },
    )?;
    let entries = (0..targets).flat_map(|i| (0..=i).map(move |j| (i, j)));
    Ok(entries.map(|(i, j)| total.get(i, j) / total.weight + total.mean[i] * total.mean[j]).collect())
}

/// Refuses settings that an imported network cannot have.
fn refuse(recipe: &Recipe) -> Result<(), Error> {
    radial::refuse(recipe, "import")?;
    match &recipe.model.weight {
        None => Ok(()),
        Some(weight) => Err(Error::conflict(format!("weight = \"{weight}\": nothing is fitted to rows; remove it"))),
    }
}

/// The network of a file.
fn read(path: &Path, inputs: &[String], outputs: &[String]) -> Result<OnnxNetwork, Error> {
    let opened = std::fs::File::open(path);
    let mut bytes = Vec::new();
    // One byte more than is read at most shows a file that is too large, also of a pipe.
    let read = opened.and_then(|file| file.take(OnnxNetwork::MOST_BYTES + 1).read_to_end(&mut bytes));
    let network = read.map_err(OnnxError::from).and_then(|_| OnnxNetwork::read(&bytes, inputs, outputs));
    network.map_err(|source| Error::Import { path: path.to_owned(), source })
}

/// The fields of logs that a recipe reads, as far as their names tell: texts that are no expression are refused later,
/// with their place.
fn fields(recipe: &Recipe) -> Vec<DataColumn> {
    let states = recipe.states.iter().flat_map(|(name, state)| {
        let derivative = match &state.derivative {
            Some(Derivative::Text(text)) if !Derivative::is_word(text) => Some(text.clone()),
            _ => None,
        };
        let column = state.column.clone().unwrap_or_else(|| name_text(name));
        [Some(column), state.known.clone(), derivative].into_iter().flatten().collect::<Vec<String>>()
    });
    let inputs = recipe.inputs.iter().map(|(name, input)| input.table().column.unwrap_or_else(|| name_text(name)));
    let predicted = recipe.model.predict.iter().flat_map(|text| items(text));
    let texts = recipe.columns.values().cloned().chain(states).chain(inputs).chain(predicted);
    let mut names: Vec<String> = Vec::new();
    for text in texts {
        let sources = Expr::parse(&text, &Scope::open()).map(|expression| expression.sources());
        for name in sources.into_iter().flatten().map(|name| name.to_string()) {
            let is_alias = recipe.columns.get(&name).is_some_and(|text| text.trim_matches('`') != name);
            if !is_alias && !names.contains(&name) {
                names.push(name);
            }
        }
    }
    names.iter().map(DataColumn::float).collect()
}

/// A name as an expression.
fn name_text(name: &str) -> String {
    Expr::column(name).to_string()
}
