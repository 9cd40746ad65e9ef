//! Choice of a network's past rows by simulations of held-out rows. One-step errors nearly always favour past rows.

use fleetfoot_data::{Cancelled, Progress, setting::LAGS};
use fleetfoot_dynamics::{RolloutOptions, Starts};
use fleetfoot_learn::Units;
use fleetfoot_library::{Expr, Library};
use fleetfoot_model::{Basis, Model};
use fleetfoot_task::Task;

use super::{
    Network, NetworkSolution,
    report::{LagChoice, NetworkCandidate},
    rows::Rows,
    search::choose,
    train::{Fitted, solved},
};
use crate::{
    error::Error,
    folds::smoothed_rows,
    method::{Data, Method},
    narx::PastRows,
    rollout_choice::{HeldOut, RolloutRule, USUAL_HORIZON},
};

/// Ridges of the units' weights in the output layer that are compared by simulations.
const RIDGES: [f64; 8] = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1];

/// Simulations of held-out spans by models without past rows and with them.
struct Simulated {
    /// Steps.
    horizon: usize,
    /// Errors over those of persistence, of every fold.
    errors: [Vec<f64>; 2],
    /// The models, of every fold.
    models: [Vec<Model>; 2],
}

/// The task whose functions are those of past rows; `None` where there are none beside the present row.
///
/// # Errors
/// More functions than a library may have.
pub(super) fn with_past(data: Data<'_, Task>, past: &PastRows) -> Result<Option<Task>, Error> {
    with_variables(data, past.variables.clone())
}

/// The task whose functions are those of other variables; `None` if they are the same.
///
/// # Errors
/// More functions than a library may have.
pub(super) fn with_variables(data: Data<'_, Task>, variables: Vec<Expr>) -> Result<Option<Task>, Error> {
    let degree = data.recipe.model.degree.unwrap_or(1).max(1);
    let library = Library::polynomial(&variables, degree).map_err(fleetfoot_recipe::Error::from)?;
    let mut task = data.task.clone();
    task.problem.library = library.functions().to_vec();
    task.variables = variables;
    Ok((task.problem.library != data.task.problem.library).then_some(task))
}

impl Network {
    /// The model of present rows, or that of past rows where its simulations are better by more than one standard error.
    pub(super) fn with_lags(
        &self,
        data: Data<'_, Task>,
        present: (NetworkSolution, Vec<String>),
        (task, past): (&Task, &PastRows),
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<NetworkSolution, Error> {
        let mut of_past = Vec::new();
        let compared = self.one(Data { task, ..data }, &mut of_past, progress).and_then(|lagged| {
            let simulated = self.simulated(data, [&present.0, &lagged], progress)?;
            Ok((lagged, simulated))
        });
        let (mut solution, mut of_present) = present;
        let (lagged, Simulated { horizon, errors: [without, with], models: [present_models, past_models] }) =
            match compared {
                Ok(compared) => compared,
                Err(error) => {
                    let reason = match &error {
                        Error::Cancelled(_) => "stopped".to_owned(),
                        other => other.to_string(),
                    };
                    notes.append(&mut of_present);
                    notes.push(format!("models of past rows were not compared ({reason}): only the present row is read; {LAGS} gives past rows"));
                    return Ok(solution);
                }
            };
        let candidate = |losses: &Vec<f64>| NetworkCandidate::new((None, &[]), 0, losses.clone(), Vec::new());
        let chosen = choose(&[candidate(&without), candidate(&with)]) == 1;
        let mut of_folds = (present_models, &without[..]);
        if chosen {
            (solution, of_present, of_folds) = (lagged, of_past, (past_models, &with[..]));
        }
        notes.append(&mut of_present);
        let (written, anew) = self.steadied(data, &mut solution, horizon, of_folds, progress)?;
        if anew {
            notes.push("simulations of all rows chose the hidden layers and the ridge of the written model, among those of all rows and of the folds: the first training simulated its rows worse than the folds' networks their held-out rows".into());
        }
        let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
        notes.push(format!(
            "{}: simulations of {horizon} steps on held-out spans err {:.3} times as much as persistence with them ({}), {:.3} times without; {LAGS} sets them",
            if chosen { "past rows are read" } else { "only the present row is read" },
            mean(&with),
            past.in_words(),
            mean(&without),
        ));
        solution.lags = Some(LagChoice { past: past.clone(), horizon, without, with, chosen, written, anew });
        Ok(solution)
    }

    /// Chooses hidden layers, among those of all rows and of the folds, and the ridge of the output layer by simulations of all rows, where the written network
    /// simulates them worse than every fold's network its held-out rows. Past rows are nearly collinear, and one-step errors do not tell such networks apart.
    /// Gives the error of the written model, and whether it is another one.
    fn steadied(
        &self,
        data: Data<'_, Task>,
        solution: &mut NetworkSolution,
        horizon: usize,
        (models, errors): (Vec<Model>, &[f64]),
        progress: &dyn Progress,
    ) -> Result<(f64, bool), Error> {
        let held = self.held(data, horizon)?;
        let starts = Starts::Even(held.rule().starts * held.rule().folds);
        let error = |model: &Model| -> Result<f64, Error> {
            let score = held.simulated(model, data.rows()?, &starts, &RolloutOptions::new(horizon))?;
            Ok(if score.ended > 0 { f64::INFINITY } else { score.share })
        };
        let mut least = error(&solution.model)?;
        if solution.selection.chosen == 0 || least <= errors.iter().copied().fold(0.0, f64::max) {
            return Ok((least, false));
        }
        let rows = self.rows(Data { task: &solution.task, ..data }, progress, false)?;
        let mut again = vec![solution.selection.fitted.clone()];
        for model in &models {
            again.extend(self.resolved(solution.selection.fitted.ridge, model, &rows, progress)?);
        }
        let mut anew = false;
        for mut fitted in again {
            for ridge in RIDGES {
                let Ok(output) = fitted.sums.solve(ridge) else { continue };
                (fitted.output, fitted.ridge) = (output, ridge);
                let mut model = solution.linear.model.clone();
                self.write(&mut model, &fitted, &rows);
                let error = error(&model)?;
                if error < least {
                    (least, solution.model, anew) = (error, model, true);
                }
            }
        }
        Ok((least, anew))
    }

    /// The hidden layers of a model with the output layer of these rows; `None` where the model has other inputs.
    fn resolved(
        &self,
        ridge: f64,
        model: &Model,
        rows: &Rows,
        progress: &dyn Progress,
    ) -> Result<Option<Fitted>, Error> {
        let Some(Basis::Network(network)) = model.latents.iter().find_map(|latent| latent.map.basis()) else {
            return Ok(None);
        };
        if network.inputs != rows.inputs {
            return Ok(None);
        }
        let hidden: Vec<usize> = network.layers.iter().map(|layer| layer.biases.len()).collect();
        let shape = rows.shape(&hidden, &self.options);
        let parameters = network.layers.iter().flat_map(|layer| layer.weights.iter().flatten().chain(&layer.biases));
        let [all, _] = rows.split(None);
        let mut units = Units::measured(&rows.table, &all)?;
        units.centre[..shape.inputs].copy_from_slice(&network.centre);
        units.scale[..shape.inputs].copy_from_slice(&network.scale);
        Ok(Some(solved(&shape, parameters.copied().collect(), ridge, (&rows.table, &all, units), progress)?))
    }

    fn held<'a>(&self, data: Data<'a, Task>, horizon: usize) -> Result<HeldOut<'a>, Error> {
        let smoothed = smoothed_rows(data.recipe.time.smoothed, data.step);
        HeldOut::new((data.rows()?, smoothed), RolloutRule::new(horizon), LAGS.to_string())
    }

    /// Steps of simulations, and their errors over those of persistence, of two models that are fitted to the other folds.
    fn simulated(
        &self,
        data: Data<'_, Task>,
        models: [&NetworkSolution; 2],
        progress: &dyn Progress,
    ) -> Result<Simulated, Error> {
        let mut held = self.held(data, 1)?;
        let horizon = held.far(USUAL_HORIZON);
        held.reach(horizon);
        let mut of_folds = [Vec::new(), Vec::new()];
        let errors = held.errors(progress, |train| {
            let of = |solution: &NetworkSolution| {
                Ok(self.again(Data { rows: Some(train), kept: None, ..data }, solution, progress)?.0)
            };
            let fitted: Vec<Model> = models.into_iter().map(of).collect::<Result<_, Error>>()?;
            of_folds.iter_mut().zip(&fitted).for_each(|(all, model)| all.push(model.clone()));
            Ok(fitted)
        })?;
        let errors = <[Vec<f64>; 2]>::try_from(errors).map_err(|_| Cancelled)?;
        Ok(Simulated { horizon, errors, models: of_folds })
    }
}
