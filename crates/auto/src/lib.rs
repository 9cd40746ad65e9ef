//! From a log to a model, chosen among all methods and tested.
//!
//! [`auto`] drafts the missing parts of the recipe, makes even rows of scattered stamps, and keeps the last rows for a
//! test. It fits models of all methods to the others. It takes the smallest one whose simulations of held-out folds are
//! within one standard error of the best. The test rows then give its errors, beside persistence, the mean and the
//! linear model. The recipe that it used ([`Auto::recipe`]) gives the same result again.

mod budget;
mod candidates;
mod draft;
mod driven;
mod horizon;
mod late;
mod noise;
mod ranking;
mod rows;
mod stamps;
mod tested;
mod turning;
mod verdict;
mod writer;

use std::{fs, path::Path};

use candidates::Variant;
use candidates::{LINEAR, MEAN, Rows};
use fleetfoot_check::{Checked, check};
use fleetfoot_data::setting::{EFFORT, FIT_SINDY, HORIZON};
use fleetfoot_data::{Cancelled, Progress, Silent, Source, unstoppable};
use fleetfoot_dataset::{Dataset, Logs, Part};
use fleetfoot_dynamics::Estimate;
use fleetfoot_fit::{Error, RolloutRule, SimulatedFold, fold_room, is_known};
use fleetfoot_log::Cache;
use fleetfoot_model::Model;
use fleetfoot_recipe::{Kind, Recipe};
use ranking::Ranking;
use serde::{Serialize, Serializer};
use serde_json::Value;

pub use crate::{
    horizon::HorizonChoice,
    ranking::Candidate,
    rows::{Span, Split},
    writer::{AutoOutput, FILES},
};

/// A state on the test rows.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TestedState {
    /// The state.
    pub state: String,
    /// Its unit, where it is known.
    pub unit: Option<String>,
    /// Root of the mean squared error of the model's simulations, with the interval of 95 % of the errors on other rows of such logs; value, low and high in JSON.
    #[serde(serialize_with = "in_three")]
    pub rmse: Estimate,
    /// The same of the linear model, where there is one.
    pub linear: Option<f64>,
    /// The same of persistence.
    pub persistence: f64,
    /// The same of the mean of the training rows, where it could be simulated.
    pub mean: Option<f64>,
}

fn in_three<S: Serializer>(value: &Estimate, serializer: S) -> Result<S::Ok, S::Error> {
    [value.value, value.low, value.high].serialize(serializer)
}

/// A model, its recipe and its errors.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Auto {
    /// The chosen model.
    pub model: Model,
    /// The linear model, where it is another one.
    pub linear: Option<Model>,
    /// The recipe that gives the same again.
    pub recipe: Recipe,
    /// Findings of `check` in the logs; `None` if it could not read them.
    pub checked: Option<Checked>,
    /// The candidates, from cheap to dear.
    pub candidates: Vec<Candidate>,
    /// Index of the chosen candidate.
    pub chosen: usize,
    /// Steps of all simulations.
    pub horizon: HorizonChoice,
    /// The rows that train and those of the test.
    pub split: Split,
    /// Errors on the test rows.
    pub tested: Vec<TestedState>,
    /// Share of the simulations of the test that leave the training range.
    pub outside: f64,
    /// Share of them that diverge.
    pub diverged: f64,
    /// Warning above all else, if the model is of no use.
    pub warning: Option<String>,
    /// Sentences about the fit: model, errors, useful horizon, weak points, and the motion to record next.
    pub sentences: Vec<String>,
    /// Assumptions.
    pub notes: Vec<String>,
    /// The user stopped the work: the candidates are those that were done.
    pub stopped: bool,
    /// Rows of which the model sees one.
    every: usize,
    /// Report of the chosen model's fit.
    fit: Value,
}

/// Written part of a result: a second run from the written recipe gives the same.
#[derive(Serialize)]
struct Summary<'a> {
    warning: &'a Option<String>,
    sentences: &'a [String],
    chosen: &'a str,
    hash: String,
    horizon: &'a HorizonChoice,
    split: &'a Split,
    tested: &'a [TestedState],
    outside: f64,
    diverged: f64,
    candidates: &'a [Candidate],
    stopped: bool,
}

/// Result for programs.
#[derive(Serialize)]
struct AutoReport<'a> {
    #[serde(flatten)]
    summary: Summary<'a>,
    findings: &'a [fleetfoot_check::Finding],
    notes: &'a [String],
}

/// Finds a model of logs.
///
/// # Errors
/// Those of opening; no column that can be a state; rows that are too few; no candidate could be fitted. A stop by the user before the first candidate is done.
pub fn auto(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<Auto, Error> {
    // Every candidate, fold and simulation sees the rows that were opened first.
    let logs = &logs.into().kept();
    if logs.is_statistic() {
        return Err(Error::needs_rows("auto simulates rows, and a statistic has none: give logs".into()));
    }
    let mut notes = Vec::new();
    let recipe = stamps::named(recipe, logs, &mut notes, progress);
    let mut recipe = draft::drafted(&recipe, logs, &mut notes, progress)?;
    if is_known(&recipe) && recipe.parameters.is_empty() {
        return Err(Error::conflict(format!(
            "all states of the recipe are known, so there is nothing to fit; {FIT_SINDY} writes the model as it is"
        )));
    }
    progress.stage("check");
    let checked = check(&recipe, logs, progress)?;
    stamps::evened(&mut recipe, &checked, logs, &mut notes, progress)?;
    // Messages are decoded once: every candidate opens the logs.
    let kept_cache = recipe.cache.clone();
    let decoded =
        tempfile::tempdir().map_err(|source| fleetfoot_dataset::Error::Write { path: std::env::temp_dir(), source })?;
    if kept_cache.as_ref().is_none_or(|cache| cache.least_bytes > 0) {
        recipe.cache = Some(Cache { folder: decoded.path().to_owned(), least_bytes: 0 });
    }
    let outcome = Search { recipe: &recipe, logs, notes, checked };
    let mut outcome = outcome.run(progress)?;
    outcome.recipe.cache = kept_cache;
    let bytes = bytes_within(decoded.path());
    if bytes > 0 {
        outcome.notes.push(format!(
            "decoded messages took {:.1} MB of {} while this ran; they are deleted now",
            bytes as f64 * 1e-6,
            std::env::temp_dir().display()
        ));
    }
    Ok(outcome)
}

/// Bytes of the files in a folder; 0 of what cannot be read.
fn bytes_within(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let of = |entry: fs::DirEntry| match entry.metadata() {
        Ok(data) if data.is_dir() => bytes_within(&entry.path()),
        Ok(data) => data.len(),
        Err(_) => 0,
    };
    entries.map(of).sum()
}

/// Properties of the training rows, measured before the first fit.
struct Looked {
    horizon: HorizonChoice,
    rows: Rows,
    /// The recipe with inputs that act late moved, and with states as angles.
    variants: Vec<Variant>,
}

struct Search<'a> {
    recipe: &'a Recipe,
    logs: &'a Logs,
    notes: Vec<String>,
    checked: Checked,
}

impl Search<'_> {
    fn run(mut self, progress: &dyn Progress) -> Result<Auto, Error> {
        let Self { recipe, logs, .. } = self;
        let Looked { horizon, rows, variants } = self.look(progress)?;
        let trials = candidates::candidates(recipe, &variants, &rows);
        let ranking = Ranking::new((&trials, &rows), logs, &horizon, progress);
        match ranking.stopped {
            true if ranking.candidates.is_empty() => Err(Cancelled.into()),
            // Finished candidates are tested and kept, whether the user waits or not.
            true => unstoppable(|| self.chosen(ranking, horizon, &Silent)),
            false => self.chosen(ranking, horizon, progress),
        }
    }

    /// Measures the properties of the training rows that candidates need.
    fn look(&mut self, progress: &dyn Progress) -> Result<Looked, Error> {
        let training = self.logs.only(Part::Training);
        let dataset = Dataset::for_columns(self.recipe, None, training, progress)?;
        let unsaid: Vec<String> = dataset.notes().iter().filter(|note| !self.notes.contains(note)).cloned().collect();
        self.notes.extend(unsaid);
        let view = dataset.view()?;
        let folds = RolloutRule::new(1).folds;
        let room = fold_room(&view, folds, self.recipe.time.smoothed, dataset.step())?;
        let place = |name: &str| view.columns().iter().position(|column| column.name == name);
        let states: Vec<(usize, bool)> = (self.recipe.states.iter())
            .filter_map(|(name, state)| Some((place(name)?, state.kind == Some(Kind::Angle))))
            .collect();
        let given = self.recipe.auto.horizon;
        let horizon = HorizonChoice::of(&view, &states, room, (given, dataset.step()))?.ok_or_else(|| {
            let shorter = match HorizonChoice::longest(room) {
                0 => String::new(),
                steps => format!(", or simulate fewer steps ({})", HORIZON.to(steps)),
            };
            Error::too_few_rows(
                view.rows() as u64,
                0,
                format!(
                    "{} training rows are too few to simulate held-out parts of them ({folds} folds, the longest part has {room} rows); give longer logs{shorter}",
                    view.rows()
                ),
            )
        })?;
        let noisy = dataset.step() > 0.0 && self.noisy(&view, &states)?;
        let angles = states.iter().filter(|(_, angle)| *angle).count();
        let columns = view.columns().len() + angles;
        let time = &self.recipe.time;
        let rows = Rows {
            training: view.rows(),
            columns,
            before: horizon.before,
            clock: dataset.step() > 0.0,
            rate: (dataset.step() > 0.0 && time.dt.is_none() && time.base.is_none())
                .then(|| time.rate.unwrap_or(1.0 / dataset.step())),
            room,
            horizon: horizon.steps,
            effort: self.recipe.auto.effort.unwrap_or_default(),
            noisy,
        };
        let late = late::moved(self.recipe, &self.logs.only(Part::Training), horizon.before, progress)?;
        let turning = turning::turning(self.recipe, &view)?;
        Ok(Looked { horizon, rows, variants: turning.into_iter().chain(late).collect() })
    }

    /// Returns true if the derivative of a state is mostly noise, and adds a note.
    fn noisy(&mut self, view: &dyn Source, states: &[(usize, bool)]) -> Result<bool, Error> {
        let mut noisy: Vec<String> = Vec::new();
        for &(place, _) in states.iter().filter(|(_, angle)| !angle) {
            let share = noise::share(view, place)?;
            if share > noise::MOSTLY {
                noisy.push(format!("`{}` ({:.0} %)", view.columns()[place].name, 100.0 * share));
            }
        }
        if !noisy.is_empty() {
            let tried = match view.rows() <= candidates::smoothed_rows(self.recipe.auto.effort.unwrap_or_default()) {
                true => {
                    "equations of smoothed states are tried too, and simulated against the measured rows".to_owned()
                }
                false => format!(
                    "this effort does not smooth {} rows; {} smooths up to 20,000",
                    view.rows(),
                    EFFORT.to("high")
                ),
            };
            self.notes.push(format!("differences from row to row are mostly noise: {}; {tried}", noisy.join(", ")));
        }
        Ok(!noisy.is_empty())
    }

    /// The chosen candidate on the test rows.
    fn chosen(self, mut ranking: Ranking, horizon: HorizonChoice, progress: &dyn Progress) -> Result<Auto, Error> {
        let Some(chosen) = ranking.chosen() else { return Err(without(&ranking)) };
        let unbeaten = ranking.unbeaten(chosen);
        let place = |name: &str| ranking.candidates.iter().position(|candidate| candidate.name == name);
        let (linear, mean) = (place(LINEAR), place(MEAN));
        let changes = Recipe { cache: self.recipe.cache.clone(), ..Recipe::default() };
        let test = |at: Option<usize>| {
            let candidate = ranking.tried[at?].as_ref()?;
            tested::simulated(&candidate.model, &changes, self.logs, &horizon.at_every(candidate.every), progress).ok()
        };
        progress.stage("test");
        let Some(candidate) = &ranking.tried[chosen] else { return Err(without(&ranking)) };
        let simulated =
            tested::simulated(&candidate.model, &changes, self.logs, &horizon.at_every(candidate.every), progress)?;
        let (beside_linear, beside_mean) = (test(linear), test(mean));
        let of = |other: &Option<tested::Simulated>, state: &String| {
            let other = other.as_ref()?;
            let place = other.states.iter().position(|name| name == state)?;
            Some(other.rmse(place).value)
        };
        let model = &candidate.model;
        let unit = |state: &String| {
            model.columns.iter().find(|column| column.name == *state).and_then(|column| column.unit.clone())
        };
        let states = simulated.states.iter().enumerate().map(|(at, state)| TestedState {
            state: state.clone(),
            unit: unit(state),
            rmse: simulated.interval(at, &of_folds(&candidate.folds, state)),
            linear: of(&beside_linear, state),
            persistence: simulated.persistence(at).value,
            mean: of(&beside_mean, state),
        });
        let tested = states.collect();
        let (split, movements) = rows::look(self.recipe, self.logs, progress)?;
        let linear =
            linear.filter(|at| *at != chosen).and_then(|at| ranking.tried[at].take()).map(|candidate| candidate.model);
        let Some(candidate) = ranking.tried[chosen].take() else { return Err(without(&ranking)) };
        let share = |count: usize| count as f64 / simulated.starts.max(1) as f64;
        let mut outcome = Auto {
            model: candidate.model,
            linear,
            recipe: self.recipe.clone(),
            checked: Some(self.checked),
            candidates: ranking.candidates,
            chosen,
            horizon,
            split,
            tested,
            outside: share(simulated.outside),
            diverged: share(simulated.ended),
            warning: None,
            sentences: Vec::new(),
            notes: self.notes,
            stopped: ranking.stopped,
            every: candidate.every,
            fit: candidate.report,
        };
        let inputs: Vec<String> = self.recipe.inputs.keys().cloned().collect();
        outcome.warning = verdict::warning(&outcome, unbeaten);
        outcome.sentences = verdict::sentences(&outcome, &movements, &inputs);
        Ok(outcome)
    }
}

/// An error over that of persistence below which a model is exact: such errors compare as equal.
const EXACT: f64 = 1e-6;

/// Errors of a state in every fold.
fn of_folds(folds: &[SimulatedFold], state: &str) -> Vec<f64> {
    let of = |fold: &SimulatedFold| Some(fold.model[fold.states.iter().position(|name| name == state)?]);
    folds.iter().filter_map(of).collect()
}

/// No candidate that could be chosen, with the first reason.
fn without(ranking: &Ranking) -> Error {
    let reason = ranking
        .candidates
        .iter()
        .find_map(|candidate| Some(format!("`{}`: {}", candidate.name, candidate.reason.as_ref()?)));
    Error::undetermined(format!(
        "none of {} models could be fitted and simulated; {}",
        ranking.candidates.len(),
        reason.unwrap_or_default()
    ))
}

impl Auto {
    /// Error of the model over another one, mean over the states in which both are known. Errors of rounding are alike:
    /// those below [`EXACT`] times that of persistence.
    fn mean_ratio(&self, other: impl Fn(&TestedState) -> f64) -> Option<f64> {
        self.mean_of(|state| {
            let least = EXACT * state.persistence;
            let at_least = |error: f64| if error < least { least } else { error };
            at_least(state.rmse.value) / at_least(other(state))
        })
    }

    /// The mean over the states with a known value.
    fn mean_of(&self, value: impl Fn(&TestedState) -> f64) -> Option<f64> {
        let known: Vec<f64> = self.tested.iter().map(value).filter(|value| value.is_finite()).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    fn summary(&self) -> Summary<'_> {
        Summary {
            warning: &self.warning,
            sentences: &self.sentences,
            chosen: &self.candidates[self.chosen].name,
            hash: self.model.hash(),
            horizon: &self.horizon,
            split: &self.split,
            tested: &self.tested,
            outside: self.outside,
            diverged: self.diverged,
            candidates: &self.candidates,
            stopped: self.stopped,
        }
    }

    /// All of it, as `auto --json` prints it.
    pub fn to_json(&self) -> Value {
        let findings = self.checked.as_ref().map_or(&[][..], |checked| &checked.findings);
        fleetfoot_dataset::json::value(AutoReport { summary: self.summary(), findings, notes: &self.notes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidates::NETWORK;

    /// A cart on a spring, pushed by a held force, on a stiff contact where it leaves the middle (`stiff`); t, x, v, u.
    fn cart(stiff: f64) -> String {
        let (mut x, mut v, mut u, mut text) = (0.3f64, 0.0f64, 0.0f64, String::from("t,x,v,u\n"));
        let draw = |key: u64| (fleetfoot_data::mix(key) >> 11) as f64 * 2f64.powi(-52) - 1.0;
        for row in 0..1_500u64 {
            if row % 20 == 0 {
                u = 5.0 * draw(row);
            }
            let noise = [1, 2].map(|column| 1e-4 * draw(10 * row + 100_000 + column));
            text += &format!("{:.2},{:.6},{:.6},{u:.6}\n", 0.02 * row as f64, x + noise[0], v + noise[1]);
            for _ in 0..20 {
                let pull = u - 4.0 * x - stiff * (8.0 * x).tanh() - 0.6 * v;
                (x, v) = (x + 1e-3 * v, v + 1e-3 * pull);
            }
        }
        text
    }

    /// The linear model and the network, the only candidates.
    fn ranked(stiff: f64) -> Ranking {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        fs::write(&path, cart(stiff)).unwrap();
        let recipe = Recipe::parse("[states]\nx = {}\nv = {}\n[inputs]\nu = {}\n", "test").unwrap();
        let logs = Logs::from(&[path]).kept();
        let checked = check(&recipe, &logs, &Silent).unwrap();
        let mut search = Search { recipe: &recipe, logs: &logs, notes: Vec::new(), checked };
        let Looked { horizon, rows, .. } = search.look(&Silent).unwrap();
        let mut trials = candidates::candidates(&recipe, &[], &rows);
        trials.retain(|trial| [MEAN, LINEAR, "linear, 2 lags", NETWORK].contains(&trial.name.as_str()));
        Ranking::new((&trials, &rows), &logs, &horizon, &Silent)
    }

    #[test]
    fn network_is_chosen_only_for_nonlinear_logs() {
        let ranking = ranked(4.0);
        let names: Vec<_> =
            ranking.candidates.iter().map(|candidate| (&candidate.name, candidate.error, &candidate.reason)).collect();
        let chosen = &ranking.candidates[ranking.chosen().unwrap()];
        assert!(chosen.name == NETWORK && chosen.method == "fit network", "{names:?}");
        // Hidden layers count: a network is never the small model.
        assert!(chosen.coefficients > 40, "{chosen:?}");
        let ranking = ranked(0.0);
        let names: Vec<_> =
            ranking.candidates.iter().map(|candidate| (&candidate.name, candidate.error, &candidate.reason)).collect();
        assert!(ranking.candidates[ranking.chosen().unwrap()].name.starts_with(LINEAR), "{names:?}");
    }
}
