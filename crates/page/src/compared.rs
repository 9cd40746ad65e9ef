//! Errors of simulations by which models are compared: those of states that all of them have, from the same rows on.

use fleetfoot_data::packed;
use fleetfoot_dynamics::{Baseline, Estimate, Horizon, HorizonScore};
use fleetfoot_model::{Model, Role};
use fleetfoot_report::words::series as listed;

use crate::Judged;

/// The models whose simulations are scored, and the quantity of the comparison.
pub(crate) struct Compared<'a> {
    pub(crate) models: Vec<(&'a str, &'a Horizon)>,
    /// The states of all, where the models have others beside them; else empty, and Mahalanobis scores are compared.
    pub(crate) shared: Vec<String>,
    /// Standard deviations of these, of the first model's training rows.
    deviations: Vec<f64>,
}

impl<'a> Compared<'a> {
    /// # Errors
    /// Why the simulations are not compared, for people.
    pub(crate) fn of(judged: &'a [Judged<'_>]) -> Option<Result<Self, String>> {
        let rolled: Vec<&Judged<'_>> = judged.iter().filter(|one| one.horizon().is_some_and(is_scored)).collect();
        let (first, others) = rolled.split_first()?;
        let models: Vec<(&str, &Horizon)> = rolled.iter().filter_map(|one| Some((one.name, one.horizon()?))).collect();
        let (_, horizon) = models[0];
        if let Some(other) = others.iter().find(|other| other.starts != first.starts) {
            return Some(Err(format!("{} and {} begin at other rows of these logs", first.name, other.name)));
        }
        if let Some((other, _)) = models.iter().find(|(_, other)| other.time.len() != horizon.time.len()) {
            return Some(Err(format!("{} and {other} go over other horizons", first.name)));
        }
        if models.iter().all(|(_, other)| other.states == horizon.states) {
            return Some(Ok(Self { models, shared: Vec::new(), deviations: Vec::new() }));
        }
        let known = |name: &String| deviation(first.model, name).filter(|deviation| *deviation > 0.0);
        let in_all = |name: &&String| models.iter().all(|(_, other)| other.states.contains(name));
        let (shared, deviations): (Vec<String>, Vec<f64>) =
            horizon.states.iter().filter(in_all).filter_map(|name| Some((name.clone(), known(name)?))).unzip();
        if shared.is_empty() {
            let states_of_models =
                models.iter().map(|(name, other)| format!("{name} has {}", listed(&other.states, 4)));
            return Some(Err(format!(
                "they have no state in common ({})",
                states_of_models.collect::<Vec<_>>().join("; ")
            )));
        }
        Some(Ok(Self { models, shared, deviations }))
    }

    /// The compared quantity, for people.
    pub(crate) fn quantity(&self) -> String {
        match self.shared.as_slice() {
            [] => "Mean Mahalanobis score".to_owned(),
            names => format!(
                "Error of {}, which all models have, in standard deviations of the training rows",
                listed(names, 4)
            ),
        }
    }

    /// The same as the name of an axis.
    pub(crate) fn axis(&self) -> String {
        match self.shared.as_slice() {
            [] => "Mahalanobis score of the simulated state".to_owned(),
            names => format!("error of {}, standard deviations", listed(names, 4)),
        }
    }

    /// The errors of every model by step.
    pub(crate) fn errors(&self) -> Vec<Vec<Estimate>> {
        self.models.iter().map(|(_, horizon)| self.of_score(&horizon.states, &horizon.model)).collect()
    }

    /// The same of the first model's baselines, which are those of all but for the null model.
    pub(crate) fn baselines(&self) -> Vec<(Baseline, Vec<Estimate>)> {
        let (_, first) = self.models[0];
        let same = |score: &&(Baseline, HorizonScore)| self.shared.is_empty() || score.0 != Baseline::Null;
        let of = |(baseline, score): &(Baseline, HorizonScore)| (*baseline, self.of_score(&first.states, score));
        first.baselines.iter().filter(same).map(of).collect()
    }

    fn of_score(&self, states: &[String], score: &HorizonScore) -> Vec<Estimate> {
        if self.shared.is_empty() {
            return score.mahalanobis.clone();
        }
        let places: Vec<usize> =
            self.shared.iter().filter_map(|name| states.iter().position(|state| state == name)).collect();
        let mean = |errors: &[f64]| {
            let relative = places.iter().zip(&self.deviations).map(|(&at, deviation)| (errors[at] / deviation).powi(2));
            (relative.sum::<f64>() / places.len() as f64).sqrt()
        };
        let estimate = |errors| Estimate { value: mean(errors), low: f64::NAN, high: f64::NAN };
        score.rmse.chunks(states.len().max(1)).map(estimate).collect()
    }
}

/// Returns true if any measurement can be compared with the simulations.
pub(crate) fn is_scored(horizon: &Horizon) -> bool {
    horizon.model.mahalanobis.iter().any(|score| score.value.is_finite())
}

/// The standard deviation of a state over the training rows, where it is known.
fn deviation(model: &Model, name: &str) -> Option<f64> {
    let states = model.columns.iter().filter(|column| column.role == Role::State);
    let at = states.map(|column| column.name.as_str()).position(|column| column == name)?;
    Some(model.training.state_covariance.get(packed(at, at))?.sqrt())
}
