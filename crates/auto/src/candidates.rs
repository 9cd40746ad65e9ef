//! The models that are tried, from cheap to dear: a method and a recipe each.

use fleetfoot_recipe::{
    AutoSection, Derivative, Effort, GivenAs, Lags, ModelSection, NarxSection, PwaSection, Recipe, SmoothStates,
};

/// The method of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Pwa,
    Sindy,
    Narx,
    Parameters,
    Network,
}

/// A model to try.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) recipe: Recipe,
    /// Rows of which it sees one.
    pub(crate) every: usize,
}

/// The recipe with some columns in another form, and the name of that form.
#[derive(Debug, Clone)]
pub(crate) struct Variant {
    pub(crate) name: String,
    pub(crate) recipe: Recipe,
}

/// The name of the candidate whose states stay at their mean.
pub(crate) const MEAN: &str = "mean";
/// The name of the candidate whose states stay where they are: that of the mean rate without it.
pub(crate) const PERSISTENCE: &str = "persistence";
/// The name of the candidate whose states go on at their mean rate.
pub(crate) const DRIFT: &str = "mean rate";
/// The name of the linear model, whose errors stand beside those of the chosen one.
pub(crate) const LINEAR: &str = "linear";

/// Numbers of the training rows that decide which candidates are tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    /// Rows that train.
    pub(crate) training: usize,
    /// Columns of the regressors without lags: states and inputs, angles twice.
    pub(crate) columns: usize,
    /// Rows in front of every simulation.
    pub(crate) before: usize,
    /// True if rows have stamps, so that derivatives can be measured.
    pub(crate) clock: bool,
    /// Rows a second, where they can be made anew; `None` where they cannot.
    pub(crate) rate: Option<f64>,
    /// Rows of the shortest of the longest held-out parts.
    pub(crate) room: usize,
    /// Steps of the simulations.
    pub(crate) horizon: usize,
    /// The effort: it sets the number of candidates.
    pub(crate) effort: Effort,
    /// Differences from row to row of a state are mostly noise.
    pub(crate) noisy: bool,
}

/// The name of the network.
pub(crate) const NETWORK: &str = "network";
/// Training rows below which a network is not tried.
const ROWS_OF_NETWORK: usize = 500;

/// Candidate functions of a library at most, by effort.
fn most_functions(effort: Effort) -> usize {
    match effort {
        Effort::Low => 40,
        Effort::Normal => 70,
        Effort::High => 250,
    }
}

/// The list of candidates: those of the recipe, and then those of its variants.
pub(crate) fn candidates(recipe: &Recipe, variants: &[Variant], rows: &Rows) -> Vec<Trial> {
    let base = bare(recipe);
    let list = List { base: &base, rows: *rows, effort: rows.effort, every: 1, prefix: String::new() };
    let mut trials = vec![list.pwa(MEAN, "next", "null", 0, None), list.pwa(DRIFT, "delta", "null", 0, None)];
    trials.push(list.pwa(LINEAR, "delta", "average", 0, None));
    trials.extend(list.known(recipe));
    trials.extend(list.linear());
    trials.extend(list.regions());
    trials.extend(list.equations());
    trials.extend(list.autoregressions());
    for (every, rate) in steps(rows) {
        let mut base = base.clone();
        base.time.rate = Some(rate);
        let rows = Rows {
            training: rows.training / every,
            horizon: rows.horizon / every,
            before: rows.before.min(rows.room / every / 4),
            ..*rows
        };
        let prefix = format!("every {every} rows: ");
        trials.extend(List { base: &base, rows, effort: rows.effort, every, prefix }.some());
    }
    if base.time.rate.is_some() && base.time.base.is_none() {
        // Stamps may be those of arrival, and the rows even as they are.
        let mut base = base.clone();
        base.time.rate = None;
        let prefix = "rows as they come: ".to_owned();
        trials.extend(List { base: &base, rows: *rows, effort: rows.effort, every: 1, prefix }.some());
    }
    for variant in variants {
        let (base, prefix) = (bare(&variant.recipe), format!("{}: ", variant.name));
        trials.extend(List { base: &base, rows: *rows, effort: rows.effort, every: 1, prefix }.some());
    }
    // The dearest, and the hardest to read: last.
    trials.extend(list.network());
    trials
}

/// Rows whose states are smoothed at most: six fits take hundreds of passes over them each.
pub(crate) fn smoothed_rows(effort: Effort) -> usize {
    match effort {
        Effort::Low => 0,
        Effort::Normal => 2_500,
        Effort::High => 20_000,
    }
}

/// Steps of simulations that a longer step leaves, at least: of the finer and of the coarser one that are tried.
const FINER: usize = 40;
const COARSER: usize = 15;

/// Longer steps: rows of which one is seen, and rows a second. Where neighbouring rows are nearly the same, a model of one row after the other learns little but noise.
fn steps(rows: &Rows) -> Vec<(usize, f64)> {
    let Some(rate) = rows.rate else { return Vec::new() };
    let longest = |left: usize| [20, 10, 5, 2].into_iter().find(|every| rows.horizon / every >= left);
    let wanted: &[usize] = if rows.effort == Effort::Low { &[FINER] } else { &[FINER, COARSER] };
    let mut intervals: Vec<usize> = wanted.iter().filter_map(|&left| longest(left)).collect();
    intervals.dedup();
    intervals.into_iter().map(|every| (every, rate / every as f64)).collect()
}

/// The recipe without the settings of candidates: the model's structure and the sections of methods stay unless a
/// candidate sets them.
fn bare(recipe: &Recipe) -> Recipe {
    let mut bare = recipe.clone();
    bare.auto = AutoSection::default();
    let (weight, partition_on) = (recipe.model.weight.clone(), recipe.model.partition_on.clone());
    bare.model = ModelSection { weight, partition_on, ..ModelSection::default() };
    bare
}

struct List<'a> {
    base: &'a Recipe,
    rows: Rows,
    effort: Effort,
    every: usize,
    /// Prefix of the names of the candidates.
    prefix: String,
}

impl List<'_> {
    fn trial(&self, name: impl Into<String>, kind: Kind, change: impl FnOnce(&mut Recipe)) -> Trial {
        let mut recipe = self.base.clone();
        change(&mut recipe);
        Trial { name: format!("{}{}", self.prefix, name.into()), kind, recipe, every: self.every }
    }

    fn pwa(&self, name: impl Into<String>, predict: &str, partition: &str, lags: u32, over: Option<u32>) -> Trial {
        self.trial(name, Kind::Pwa, |recipe| {
            recipe.model.predict = Some(predict.into());
            recipe.model.partition = Some(partition.into());
            recipe.model.lags = (lags > 0).then(|| Lags::rows(lags));
            recipe.pwa.folds.get_or_insert(5);
            mean_slopes(recipe, over);
        })
    }

    /// Lags that rows and the effort bear.
    fn lags(&self) -> Vec<u32> {
        let wanted: &[u32] = match self.effort {
            Effort::Low => &[2],
            Effort::Normal => &[1, 2, 5, 10],
            Effort::High => &[1, 2, 3, 5, 10, 20],
        };
        let fits = |lags: &&u32| {
            let functions = self.rows.columns * (**lags as usize + 1);
            (**lags as usize) < self.rows.before && functions <= 400 && 4 * functions < self.rows.training
        };
        wanted.iter().filter(fits).copied().collect()
    }

    /// Mean slopes that derivatives may be, rows.
    fn spans(&self) -> Vec<u32> {
        let wanted: &[u32] = match self.effort {
            Effort::Low => &[10],
            Effort::Normal => &[5, 20],
            Effort::High => &[2, 5, 10, 20, 50],
        };
        wanted.iter().filter(|over| (**over as usize) <= 2 * self.rows.horizon).copied().collect()
    }

    fn linear(&self) -> Vec<Trial> {
        let mut trials = Vec::new();
        let lagged = |lags: u32| self.pwa(format!("linear, {lags} lags"), "delta", "average", lags, None);
        trials.extend(self.lags().into_iter().map(lagged));
        if self.rows.clock {
            trials.push(self.pwa("linear derivative", "derivative", "average", 0, None));
            let over = |rows: u32| {
                self.pwa(format!("linear derivative over {rows} rows"), "derivative", "average", 0, Some(rows))
            };
            trials.extend(self.spans().into_iter().map(over));
        }
        trials
    }

    fn regions(&self) -> Vec<Trial> {
        let wanted: &[&str] = match self.effort {
            Effort::Low => &["refined:2..3"],
            Effort::Normal => &["kmeans:2", "kmeans:5", "kmeans:10", "refined:2..5", "tree:2..4"],
            Effort::High => &["kmeans:2", "kmeans:5", "kmeans:10", "kmeans:20", "refined:2..10", "tree:2..6"],
        };
        if self.rows.training < 20 * (self.rows.columns + 1) {
            return Vec::new();
        }
        let mut trials: Vec<Trial> =
            wanted.iter().map(|&regions| self.pwa(format!("regions {regions}"), "delta", regions, 0, None)).collect();
        if self.effort != Effort::Low {
            let most = most_functions(self.effort) / 2;
            let lagged =
                |lags: u32| self.pwa(format!("regions refined:2..5, {lags} lags"), "delta", "refined:2..5", lags, None);
            let fits = |lags: &u32| [2, 5].contains(lags) && self.rows.columns * (*lags as usize + 1) <= most;
            trials.extend(self.lags().into_iter().filter(fits).map(lagged));
            if self.rows.clock {
                let over = |rows: u32| {
                    let name = format!("regions refined:2..5, derivative over {rows} rows");
                    self.pwa(name, "derivative", "refined:2..5", 0, Some(rows))
                };
                trials.extend(self.spans().into_iter().map(over));
            }
        }
        trials
    }

    fn equations(&self) -> Vec<Trial> {
        let degrees: &[u32] = match self.effort {
            Effort::Low => &[2],
            _ => &[1, 2, 3],
        };
        let has_library = !self.base.library.functions.is_empty() || self.base.library.radial.is_some();
        let degrees: Vec<u32> = if has_library { vec![1] } else { degrees.to_vec() };
        let mut trials = Vec::new();
        for degree in degrees {
            if !has_library && monomials(self.rows.columns, degree as usize) > most_functions(self.effort) {
                continue;
            }
            let what = if has_library { "of the recipe's library".into() } else { format!("of degree {degree}") };
            let of = |name: String, predict: &str, over: Option<u32>| {
                self.trial(name, Kind::Sindy, |recipe| {
                    recipe.model.predict = Some(predict.into());
                    recipe.model.degree = (!has_library).then_some(degree);
                    mean_slopes(recipe, over);
                    recipe.sindy.folds.get_or_insert_with(|| "5".into());
                    // Hundreds of passes over the rows.
                    if self.effort != Effort::High {
                        recipe.sindy.smooth_states.get_or_insert(SmoothStates::Off);
                    }
                })
            };
            trials.push(of(format!("difference equations {what}"), "delta", None));
            if self.rows.clock {
                trials.push(of(format!("equations {what}"), "derivative", None));
                // Fitted to smoothed rows, of every fold its own, and simulated against those that were measured.
                let rows = smoothed_rows(self.effort);
                if self.rows.noisy && (has_library || degree == 2) && self.rows.training <= rows {
                    trials.push(self.smoothed(format!("equations {what}, smoothed states"), has_library, degree));
                }
                if self.effort != Effort::Low && degree < 3 {
                    let over = |rows: u32| of(format!("equations {what}, over {rows} rows"), "derivative", Some(rows));
                    trials.extend(self.spans().into_iter().map(over));
                }
            }
        }
        trials
    }

    /// Equations found in turn with the states, which are smoothed under them.
    fn smoothed(&self, name: String, has_library: bool, degree: u32) -> Trial {
        self.trial(name, Kind::Sindy, |recipe| {
            recipe.model.predict = Some("derivative".into());
            recipe.model.degree = (!has_library).then_some(degree);
            recipe.sindy.folds.get_or_insert_with(|| "5".into());
            recipe.sindy.smooth_states.get_or_insert(SmoothStates::On);
        })
    }

    fn autoregressions(&self) -> Vec<Trial> {
        if self.base.states.values().any(|state| state.known.is_some() || state.equation.is_some()) {
            return Vec::new();
        }
        let linear = |lags: usize| {
            self.trial(format!("linear autoregression, {lags} lags"), Kind::Narx, |recipe| {
                recipe.narx = NarxSection {
                    lags_out: Some(lags),
                    lags_in: (!self.base.inputs.is_empty()).then_some(lags),
                    order: Some(GivenAs::Fixed),
                    ..recipe.narx.clone()
                };
                recipe.model.degree = Some(1);
            })
        };
        let most = self.rows.before.saturating_sub(1);
        let lags: &[usize] = if self.effort == Effort::Low { &[4] } else { &[4, 10] };
        let mut trials: Vec<Trial> = lags.iter().filter(|lags| **lags <= most).map(|&lags| linear(lags)).collect();
        let effort = match self.effort {
            Effort::Low => return trials,
            Effort::Normal => Effort::Low,
            Effort::High => Effort::Normal,
        };
        if self.base.states.len() <= 8 {
            trials.push(self.trial("autoregression", Kind::Narx, |recipe| recipe.narx.effort = Some(effort)));
        }
        trials
    }

    /// A network of the states, the inputs and their past rows, whose size its fit chooses.
    fn network(&self) -> Option<Trial> {
        let effort = match self.effort {
            Effort::Low => return None,
            Effort::Normal => Effort::Low,
            Effort::High => Effort::Normal,
        };
        let given = self.base.states.values().any(|state| state.equation.is_some());
        (!given && self.rows.training >= ROWS_OF_NETWORK)
            .then(|| self.trial(NETWORK, Kind::Network, |recipe| recipe.network.effort = Some(effort)))
    }

    /// The candidates at a longer step, with delayed inputs, and of rows at their recorded stamps.
    fn some(&self) -> Vec<Trial> {
        let mut trials = vec![self.pwa(LINEAR, "delta", "average", 0, None)];
        let lagged = |lags: u32| self.pwa(format!("linear, {lags} lags"), "delta", "average", lags, None);
        trials.extend(self.lags().into_iter().filter(|lags| *lags != 1).map(lagged));
        if self.effort != Effort::Low {
            trials.extend(self.regions().into_iter().filter(|trial| !trial.name.contains("derivative")));
        }
        trials.extend(
            self.equations()
                .into_iter()
                .filter(|trial| !trial.name.contains("over") && !trial.name.contains("smoothed")),
        );
        trials.extend(self.autoregressions());
        trials
    }

    /// Physics that the recipe gives, and the model that its sections describe.
    fn known(&self, recipe: &Recipe) -> Vec<Trial> {
        let mut trials = Vec::new();
        if !recipe.parameters.is_empty() {
            trials.push(self.trial("parameters of the recipe's equations", Kind::Parameters, |_| {}));
        }
        let section = &recipe.model;
        if section.predict.is_some()
            || section.degree.is_some()
            || section.lags.is_some()
            || section.partition.is_some()
        {
            trials
                .push(self.trial("as the recipe says", Kind::Pwa, |trial_recipe| trial_recipe.model = section.clone()));
        }
        if recipe.pwa != PwaSection::default() && trials.is_empty() {
            trials.push(self.trial("as the recipe says", Kind::Pwa, |_| {}));
        }
        trials
    }
}

/// Sets the mean slope over so many rows as the derivative of every state without a derivative in the recipe.
fn mean_slopes(recipe: &mut Recipe, over: Option<u32>) {
    let Some(rows) = over else { return };
    for state in recipe.states.values_mut().filter(|state| state.derivative.is_none() && state.known.is_none()) {
        state.derivative = Some(Derivative::over(rows));
    }
}

/// Monomials of so many variables up to a degree.
fn monomials(variables: usize, degree: usize) -> usize {
    (1..=degree).fold(1usize, |count, k| count.saturating_mul(variables + k) / k)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str, rows: Rows) -> Vec<String> {
        let recipe = Recipe::parse(text, "test").unwrap();
        candidates(&recipe, &[], &rows).into_iter().map(|trial| trial.name).collect()
    }

    const ROWS: Rows = Rows {
        training: 10_000,
        columns: 3,
        before: 20,
        clock: true,
        rate: None,
        room: 200,
        horizon: 40,
        effort: Effort::Normal,
        noisy: false,
    };

    #[test]
    fn candidates_follow_from_rows_and_effort() {
        let all = names("[states]\nx = {}\n", ROWS);
        assert_eq!(all[..3], [MEAN, DRIFT, LINEAR]);
        for name in ["linear, 10 lags", "equations of degree 2", "regions kmeans:5", "autoregression"] {
            assert!(all.iter().any(|trial| trial == name), "{name}: {all:?}");
        }
        assert_eq!(all.last().map(String::as_str), Some(NETWORK), "the dearest comes last");
        let low = names("[states]\nx = {}\n", Rows { effort: Effort::Low, ..ROWS });
        assert!(!low.iter().any(|name| name == NETWORK));
        assert!(low.len() < all.len() / 2);
        // Without a clock there are no derivatives, with few rows no regions.
        let few = names("[states]\nx = {}\n", Rows { training: 50, clock: false, before: 4, ..ROWS });
        assert!(few.iter().all(|name| !name.contains("derivative") && !name.starts_with("regions")), "{few:?}");
        assert!(few.iter().all(|name| !name.contains("10 lags") && name != NETWORK), "{few:?}");
        let smoothed = |rows: Rows| {
            names("[states]\nx = {}\n", rows).iter().filter(|name| name.contains("smoothed states")).count()
        };
        let noisy = Rows { noisy: true, training: 2_000, ..ROWS };
        assert_eq!([noisy, Rows { noisy: false, ..noisy }, Rows { training: 3_000, ..noisy }].map(smoothed), [1, 0, 0]);
        assert_eq!(smoothed(Rows { training: 3_000, effort: Effort::High, ..noisy }), 1);
        let known = names("[states]\nx = { equation = \"a*x\" }\n[parameters]\na = { initial = 1.0 }\n", ROWS);
        assert!(
            known.iter().any(|trial| trial.starts_with("parameters"))
                && !known.iter().any(|trial| trial.contains("auto"))
        );
    }

    #[test]
    fn slow_states_add_longer_steps() {
        let of = |horizon: usize, effort| steps(&Rows { rate: Some(100.0), horizon, effort, ..ROWS });
        assert_eq!(of(500, Effort::Normal), [(10, 10.0), (20, 5.0)]);
        assert_eq!((of(100, Effort::Low), of(29, Effort::Normal)), (vec![(2, 50.0)], Vec::new()));
        let all = names("[states]\nx = {}\n", Rows { rate: Some(100.0), horizon: 500, room: 2000, ..ROWS });
        assert!(all.iter().any(|trial| trial == "every 10 rows: equations of degree 2"), "{all:?}");
    }

    #[test]
    fn numbers_of_monomials_are_binomial() {
        assert_eq!(monomials(3, 2), 10);
        assert_eq!(monomials(10, 3), 286);
    }
}
