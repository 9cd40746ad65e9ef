//! Every candidate fitted, simulated on the folds that did not train it, and compared: the smallest model within one standard error of the best.

use fleetfoot_data::{Progress, Stages, until_stopped};
use fleetfoot_dataset::{Logs, Part};
use fleetfoot_fit::{
    Error, FitReport, FitRequest, FoldSimulations, Method, Narx, Network, Parameters, Pwa, SimulatedFold, Simulations,
    Sindy, fit_and_simulate,
};
use fleetfoot_model::{Basis, Latent, Model};
use fleetfoot_report::words::ratio;
use serde::Serialize;

use crate::{
    budget::Budget,
    candidates::{DRIFT, Kind, LINEAR, MEAN, PERSISTENCE, Rows, Trial},
    horizon::HorizonChoice,
};

/// A candidate and its held-out errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Candidate {
    /// Name of the candidate.
    pub name: String,
    /// The command that fits it.
    pub method: String,
    /// Coefficients that are not zero.
    pub coefficients: usize,
    /// Error of its simulations over that of persistence, of every fold; infinite where a simulation diverged.
    pub folds: Vec<f64>,
    /// Geometric mean over the folds.
    pub error: Option<f64>,
    /// Its standard error.
    pub standard_error: Option<f64>,
    /// Simulations that ended early, and how many there were.
    pub ended: [usize; 2],
    /// Reason why there is no model, or why it cannot be chosen.
    pub reason: Option<String>,
}

/// A candidate that could be fitted.
pub(crate) struct Tried {
    pub(crate) model: Model,
    /// Rows of which it sees one.
    pub(crate) every: usize,
    /// Report of the fit.
    pub(crate) report: serde_json::Value,
    /// Errors of its simulations of every fold.
    pub(crate) folds: Vec<SimulatedFold>,
}

/// The candidates in the order of the list, the models of those that were fitted, and whether the work was stopped.
pub(crate) struct Ranking {
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) tried: Vec<Option<Tried>>,
    pub(crate) stopped: bool,
}

impl Ranking {
    /// Fits and simulates the candidates one after the other. A stop by the user ends it; finished candidates stay.
    pub(crate) fn new(
        (trials, rows): (&[Trial], &Rows),
        logs: &Logs,
        horizon: &HorizonChoice,
        progress: &dyn Progress,
    ) -> Self {
        let training = logs.only(Part::Training);
        let budget = Budget::of(trials, rows, &training);
        progress.expect(budget.work());
        let mut ranking = Self { candidates: Vec::new(), tried: Vec::new(), stopped: false };
        for (at, trial) in trials.iter().enumerate() {
            if let Some(reason) = budget.refusal(at) {
                ranking.add(trial, None, &[], Some(reason));
                continue;
            }
            let stages = Stages::new(progress, format!("{} ({} of {})", trial.name, at + 1, trials.len()));
            let simulations = Simulations { limit: ranking.limit(&trial.name), ..horizon.simulations(trial.every) };
            let result = until_stopped(|| fitted(trial, &training, &simulations, &stages));
            match result {
                Err(_) => ranking.stopped = true,
                Ok(Err(Error::Cancelled(_))) => ranking.stopped = true,
                Ok(Err(_)) if progress.cancelled() => ranking.stopped = true,
                Ok(Err(error)) => ranking.add(trial, None, &[], Some(error.to_string())),
                Ok(Ok((tried, FoldSimulations::HeldOut(folds)))) => {
                    let still = (trial.name == DRIFT).then(|| persistence(&tried, &folds));
                    ranking.add(trial, Some(tried), &folds, None);
                    if let Some((tried, folds)) = still {
                        ranking.add(&Trial { name: PERSISTENCE.into(), ..trial.clone() }, Some(tried), &folds, None);
                    }
                }
                Ok(Ok((tried, FoldSimulations::BeyondLimit(error)))) => {
                    let times = error / ranking.least().unwrap_or(f64::NAN);
                    let reason = match times.is_finite() {
                        true => {
                            format!(
                                "its error on training rows is {} times that of the best candidate before it",
                                ratio(times)
                            )
                        }
                        false => "simulations of its training rows diverge".to_owned(),
                    };
                    ranking.add(trial, Some(tried), &[], Some(reason));
                }
            }
            if ranking.stopped {
                break;
            }
        }
        ranking
    }

    /// The least error so far, as errors on training rows are counted: the mean over the folds.
    fn least(&self) -> Option<f64> {
        let usable = self.candidates.iter().filter(|candidate| candidate.error.is_some());
        usable.map(|candidate| sample_mean(&candidate.folds).0).min_by(f64::total_cmp)
    }

    /// The error on its training rows beyond which a candidate is given up; `None` for those that others are compared with.
    fn limit(&self, name: &str) -> Option<f64> {
        if [MEAN, DRIFT, LINEAR].contains(&name) {
            return None;
        }
        Some(GIVEN_UP * self.least()?)
    }

    fn add(&mut self, trial: &Trial, tried: Option<Tried>, folds: &[SimulatedFold], reason: Option<String>) {
        let errors: Vec<f64> = folds.iter().map(SimulatedFold::error).collect();
        let (ended, starts) = folds.iter().fold((0, 0), |(e, s), fold| (e + fold.ended, s + fold.starts));
        let diverged = (ended > 0).then(|| format!("{ended} of {starts} simulations diverge"));
        let (mean, spread) = mean_and_error(&errors);
        let finite = mean.is_finite();
        self.candidates.push(Candidate {
            name: trial.name.clone(),
            method: trial.kind.method().to_owned(),
            coefficients: tried.as_ref().map_or(0, |fitted| coefficients(&fitted.model)),
            error: finite.then_some(mean),
            standard_error: (finite && spread.is_finite()).then_some(spread),
            folds: errors,
            ended: [ended, starts],
            reason: reason.or(diverged),
        });
        self.tried.push(tried.map(|fitted| Tried { folds: folds.to_vec(), ..fitted }));
    }

    /// The index of the smallest model whose errors are within one standard error of those of the best, fold by fold,
    /// or within a twentieth.
    pub(crate) fn chosen(&self) -> Option<usize> {
        let usable: Vec<usize> = (0..self.candidates.len()).filter(|&at| self.candidates[at].error.is_some()).collect();
        let error = |at: usize| self.candidates[at].error.unwrap_or(f64::INFINITY);
        let best = usable.iter().copied().min_by(|&a, &b| error(a).total_cmp(&error(b)))?;
        let folds = |at: usize| &self.candidates[at].folds;
        let alike = |&at: &usize| !is_better(folds(best), folds(at)) || error(at) <= ALIKE * error(best);
        let key = |at: usize| (self.candidates[at].coefficients, error(at));
        let still = usable.iter().copied().find(|&at| self.candidates[at].name == PERSISTENCE);
        let models = usable.into_iter().filter(|at| Some(*at) != still);
        let smallest = models.filter(alike).min_by(|&a, &b| {
            let (a, b) = (key(a), key(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        // It has the fewest coefficients of all, and is taken only where nothing errs less.
        match (smallest, still) {
            (Some(smallest), Some(still)) if error(smallest) >= error(still) => Some(still),
            (smallest, still) => smallest.or(still),
        }
    }

    /// Name of a baseline that the chosen model does not beat by more than the standard error; `None` if it beats all.
    pub(crate) fn unbeaten(&self, chosen: usize) -> Option<&'static str> {
        let candidate = &self.candidates[chosen];
        if candidate.name == MEAN {
            return Some("the mean");
        }
        let still = vec![1.0; candidate.folds.len()];
        if [DRIFT, PERSISTENCE].contains(&candidate.name.as_str()) || !is_better(&candidate.folds, &still) {
            return Some("persistence");
        }
        let mean = self.candidates.iter().find(|other| other.name == MEAN && other.error.is_some())?;
        (!is_better(&candidate.folds, &mean.folds)).then_some("the mean")
    }
}

/// Beyond so many times the least error a model is given up before it is fitted to the folds.
const GIVEN_UP: f64 = 2.0;

/// Errors that differ by less are alike, however sure the difference is: a person reads the smaller model.
const ALIKE: f64 = 1.05;

/// Returns true if errors are lower than others, fold by fold, by more than one standard error of the difference of
/// their logarithms.
fn is_better(folds: &[f64], others: &[f64]) -> bool {
    let ratios: Vec<f64> = others.iter().zip(folds).map(|(other, fold)| logarithm(*other) - logarithm(*fold)).collect();
    let (mean, spread) = sample_mean(&ratios);
    mean > 0.0 && (mean > spread || !spread.is_finite())
}

/// Geometric mean of ratios and its standard error; NaN of none, and of one. A fold whose rows hardly move, or lie
/// outside of what the others saw, has a ratio many times that of the others, and counts as one fold.
fn mean_and_error(ratios: &[f64]) -> (f64, f64) {
    let (mean, spread) = sample_mean(&ratios.iter().copied().map(logarithm).collect::<Vec<_>>());
    (mean.exp(), mean.exp() * spread)
}

/// Logarithm of a ratio; ratios of rounding errors are alike.
fn logarithm(ratio: f64) -> f64 {
    ratio.max(1e-12).ln()
}

/// Mean and its standard error; NaN of none, and of one.
fn sample_mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// The model whose states stay where they are, and its errors: those of persistence.
fn persistence(drift: &Tried, folds: &[SimulatedFold]) -> (Tried, Vec<SimulatedFold>) {
    let mut model = drift.model.clone();
    for map in model.latents.iter_mut().filter_map(Latent::affine_mut) {
        map.constants.fill(0.0);
    }
    let mut report = drift.report.clone();
    report["hash"] = model.hash().into();
    let still = |fold: &SimulatedFold| SimulatedFold { model: fold.persistence.clone(), ended: 0, ..fold.clone() };
    (Tried { model, every: drift.every, report, folds: Vec::new() }, folds.iter().map(still).collect())
}

/// Coefficients of a model that are not zero, and the numbers of its hidden layers.
fn coefficients(model: &Model) -> usize {
    let mut networks: Vec<Basis> = Vec::new();
    for basis in model.latents.iter().filter_map(|latent| latent.map.basis()) {
        if !networks.contains(&basis) {
            networks.push(basis);
        }
    }
    let hidden = networks.iter().map(|basis| match basis {
        Basis::Network(network) => network.numbers(),
        Basis::Recurrent(cell) => cell.numbers(),
        Basis::Gaussian(_) => 0,
    });
    model.latents.iter().map(|latent| latent.map.parameters()).sum::<usize>() + hidden.sum::<usize>()
}

fn fitted(
    trial: &Trial,
    logs: &Logs,
    simulations: &Simulations,
    progress: &dyn Progress,
) -> Result<(Tried, FoldSimulations), Error> {
    match trial.kind {
        Kind::Pwa => of::<Pwa>(trial, logs, simulations, progress),
        Kind::Sindy => of::<Sindy>(trial, logs, simulations, progress),
        Kind::Narx => of::<Narx>(trial, logs, simulations, progress),
        Kind::Parameters => of::<Parameters>(trial, logs, simulations, progress),
        Kind::Network => {
            let (tried, folds) = of::<Network>(trial, logs, simulations, progress)?;
            match tried.model.latents.iter().any(|latent| latent.map.basis().is_some()) {
                true => Ok((tried, folds)),
                false => {
                    Err(Error::undetermined("no network predicts held-out rows better than a linear model".into()))
                }
            }
        }
    }
}

fn of<M: Method>(
    trial: &Trial,
    logs: &Logs,
    simulations: &Simulations,
    progress: &dyn Progress,
) -> Result<(Tried, FoldSimulations), Error> {
    let (fitted, folds) = fit_and_simulate::<M>(&trial.recipe, &FitRequest::default(), logs, simulations, progress)?;
    let mut report = fitted.report.to_json();
    report["hash"] = fitted.model.hash().into();
    Ok((Tried { model: fitted.model, every: trial.every, report, folds: Vec::new() }, folds))
}

impl Kind {
    fn method(self) -> &'static str {
        match self {
            Self::Pwa => "fit pwa",
            Self::Sindy => "fit sindy",
            Self::Narx => "fit narx",
            Self::Parameters => "fit parameters",
            Self::Network => "fit network",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(name: &str, coefficients: usize, folds: &[f64]) -> Candidate {
        let (mean, spread) = mean_and_error(folds);
        Candidate {
            name: name.into(),
            method: "fit pwa".into(),
            coefficients,
            error: mean.is_finite().then_some(mean),
            standard_error: Some(spread),
            folds: folds.to_vec(),
            ended: [0, 10],
            reason: None,
        }
    }

    #[test]
    fn smallest_model_within_one_error_is_chosen() {
        let ranking = |candidates: Vec<Candidate>| Ranking { candidates, tried: Vec::new(), stopped: false };
        let ranked = ranking(vec![
            candidate(MEAN, 1, &[0.9, 0.8, 1.0]),
            candidate("linear", 4, &[0.5, 0.41, 0.6]),
            candidate("regions", 20, &[0.49, 0.42, 0.59]),
            candidate("diverges", 2, &[0.1, f64::INFINITY, 0.1]),
        ]);
        assert_eq!(ranked.chosen(), Some(1));
        assert_eq!(ranked.unbeaten(1), None);
        // Folds differ much, but in every one the larger model is better by as much.
        let ranked =
            ranking(vec![candidate("linear", 4, &[0.5, 0.3, 0.9]), candidate("regions", 20, &[0.4, 0.21, 0.79])]);
        assert_eq!(ranked.chosen(), Some(1));
        let ranked = ranking(vec![candidate(MEAN, 1, &[0.7, 0.72, 0.71]), candidate("linear", 4, &[0.71, 0.7, 0.73])]);
        assert_eq!(
            (ranked.chosen(), ranked.unbeaten(0), ranked.unbeaten(1)),
            (Some(0), Some("the mean"), Some("the mean"))
        );
        let ranked =
            ranking(vec![candidate("linear", 4, &[0.6, 1.9, 0.5]), candidate("regions", 20, &[0.5, 0.52, 0.51])]);
        assert_eq!(ranked.chosen(), Some(1), "errors that scatter are not near");
        assert_eq!((ranked.limit("regions"), ranked.limit(LINEAR)), (Some(2.0 * (0.5 + 0.52 + 0.51) / 3.0), None));
        let still = || candidate(PERSISTENCE, 0, &[1.0, 1.0, 1.0]);
        let ranked = ranking(vec![still(), candidate("linear", 4, &[1.1, 0.9, 1.2])]);
        assert_eq!((ranked.chosen(), ranked.unbeaten(0)), (Some(0), Some("persistence")));
        let ranked = ranking(vec![still(), candidate("linear", 4, &[1.1, 0.6, 0.9])]);
        assert_eq!(ranked.chosen(), Some(1));
        let ranked = ranking(vec![candidate("linear", 4, &[1.1, 0.9, 1.2])]);
        assert_eq!((ranked.chosen(), ranked.unbeaten(0)), (Some(0), Some("persistence")));
        assert_eq!(ranking(vec![candidate("a", 1, &[f64::INFINITY; 2])]).chosen(), None);
    }
}
