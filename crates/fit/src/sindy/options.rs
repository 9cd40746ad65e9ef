//! Options of an equation fit: the settings of `[sindy]`, checked once.

use fleetfoot_data::setting::{
    self, CONSTRAINTS, FIT_SPARSE, FRONT, GROUPS, INCLUSION, LIBRARY, SINDY, TERMS, THRESHOLD,
};
use fleetfoot_recipe::{
    Criterion, GroupRule, Normalize, Objective, Recipe, SindyOptimizer, SindySection, SmoothStates, Tunable, seed,
};
use fleetfoot_sparse::{
    bolasso::BootstrapUnit,
    threshold::{Scaling, Stlsq},
};
use fleetfoot_task::WeakForm;

use crate::{error::Error, folds, folds::FoldRule};

/// Part of the problem that an ensemble varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ensemble {
    /// Chunks or episodes, drawn with replacement.
    Units(BootstrapUnit),
    /// Candidate functions, a share of them left out.
    Library,
}

/// Options of an equation fit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SindyOptions {
    /// The optimiser.
    pub optimizer: SindyOptimizer,
    /// The threshold; `None`: chosen by [`SindyOptions::criterion`].
    pub threshold: Option<f64>,
    /// Weight of the squared coefficients in STLSQ.
    pub ridge: f64,
    /// Units of the coefficients that thresholds and ridge see.
    pub scaling: Scaling,
    /// Regressions of STLSQ at most.
    pub max_iterations: usize,
    /// Forward regression's own choice of the number of terms: the weight of a term.
    pub kappa: Option<f64>,
    /// Number of terms of every equation, where it is given.
    pub terms: Option<usize>,
    /// Criterion of the choice.
    pub criterion: Criterion,
    /// Rule by which rows are held out.
    pub folds: FoldRule,
    /// The part that an ensemble varies, and the number of members.
    pub ensemble: Option<(Ensemble, usize)>,
    /// Share of the members that must have a term.
    pub inclusion: f64,
    /// Functions that enter together, of the group lasso.
    pub groups: GroupRule,
    /// Share of the absolute values in its penalty.
    pub l1_ratio: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Objective of the coefficients.
    pub objective: Objective,
    /// Setting of state smoothing under the equations.
    pub smooth_states: SmoothStates,
}

/// Ridge weight when a threshold is given and none is: pysindy's.
const RIDGE: f64 = 0.05;

/// Share of the members of an ensemble that must have a term, when none is given.
const USUAL_INCLUSION: f64 = 0.6;

impl SindyOptions {
    /// Reads the words of a recipe's `[sindy]`.
    ///
    /// # Errors
    /// A word or number that is not allowed, with those that are.
    pub fn new(section: &SindySection) -> Result<Self, Error> {
        WeakForm::new(section)?;
        let optimizer = section.optimizer.unwrap_or_default();
        let threshold = match &section.threshold {
            None => None,
            Some(Tunable::Word(word)) if word == "auto" => None,
            Some(Tunable::Number(value)) if *value >= 0.0 && value.is_finite() => Some(*value),
            Some(Tunable::Number(value)) => {
                return Err(refused("threshold", value, "auto, or a number of zero or more"));
            }
            Some(Tunable::Word(word)) => return Err(refused("threshold", word, "auto, or a number of zero or more")),
        };
        // A given threshold is one of stlsq, and groups are those of the group lasso.
        let optimizer = match (optimizer, threshold) {
            (SindyOptimizer::Auto, _) if section.groups.is_some() => SindyOptimizer::GroupLasso,
            (SindyOptimizer::Auto, Some(_)) => SindyOptimizer::Stlsq,
            (optimizer, _) => optimizer,
        };
        let groups = groups(section, optimizer)?;
        if let (Some(value), false) = (threshold, optimizer.thresholds()) {
            return Err(Error::conflict(format!(
                "{entry}: {} has no threshold; take stlsq or sr3, or set the number of terms (`terms`)",
                optimizer.name(),
                entry = SINDY.entry("threshold").is(value)
            )));
        }
        let terms = section.terms;
        if let (Some(_), Some(count)) = (threshold, terms) {
            return Err(Error::conflict(format!(
                "{SINDY} has both `threshold` and `terms = {count}`; each sets the number of terms of an equation, so remove one of them"
            )));
        }
        if terms == Some(0) {
            return Err(refused("terms", 0, "a number from 1 on"));
        }
        let ridge = section.ridge.unwrap_or(if threshold.is_some() { RIDGE } else { 0.0 });
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(refused("ridge", ridge, "a weight of zero or more"));
        }
        let inclusion = section.inclusion.unwrap_or(USUAL_INCLUSION);
        if !(inclusion > 0.0 && inclusion <= 1.0) {
            return Err(refused("inclusion", inclusion, "a share of the members above 0, at most 1"));
        }
        if let (Some(value), None) = (section.inclusion, &section.ensemble) {
            return Err(Error::conflict(format!(
                "{entry}: there is no ensemble whose members could agree; add `ensemble = \"chunks:100\"`",
                entry = SINDY.entry("inclusion").is(value)
            )));
        }
        let folds = section.folds.as_deref().unwrap_or("auto");
        Ok(Self {
            optimizer,
            threshold,
            ridge,
            scaling: scaling(section.normalize.as_ref(), threshold.is_none())?,
            max_iterations: max_iterations(section, optimizer)?,
            kappa: kappa(section, optimizer)?,
            terms,
            criterion: section.select.unwrap_or_default(),
            folds: folds::parse(folds).ok_or_else(|| refused("folds", folds, folds::WORDS))?,
            ensemble: section.ensemble.as_deref().map(ensemble).transpose()?,
            inclusion,
            groups,
            l1_ratio: section.l1_ratio.unwrap_or(0.0),
            seed: seed("sindy", section.seed)?,
            objective: section.objective.unwrap_or_default(),
            smooth_states: smooth_states(section)?,
        })
    }
}

impl SindyOptions {
    /// The same where coefficients have bounds.
    ///
    /// # Errors
    /// An option that cannot keep bounds.
    pub(super) fn within(mut self, recipe: &Recipe) -> Result<Self, Error> {
        let Some(name) = recipe.constraints.keys().next() else { return Ok(self) };
        let refused = |what: String| {
            Err(Error::conflict(format!("{entry}, and {what}; remove one of them", entry = CONSTRAINTS.entry(name))))
        };
        match self.optimizer {
            SindyOptimizer::Auto | SindyOptimizer::Stlsq | SindyOptimizer::Ssr | SindyOptimizer::LeastSquares => {}
            other => {
                return refused(format!(
                    "optimizer = {}: auto, stlsq, ssr and ols keep bounds of coefficients",
                    other.name()
                ));
            }
        }
        if self.objective != Objective::OneStep {
            return refused(format!(
                "objective = \"{}\": coefficients fitted to simulations have no bounds",
                self.objective
            ));
        }
        match self.smooth_states {
            SmoothStates::On => {
                refused("smooth_states = on: states are smoothed under equations without bounds".into())
            }
            // Unasked, what is asked for is not overruled.
            SmoothStates::Auto | SmoothStates::Off => {
                self.smooth_states = SmoothStates::Off;
                Ok(self)
            }
        }
    }

    /// Method of the term selection, for people.
    pub(super) fn method_in_words(&self) -> String {
        let units = match self.scaling {
            Scaling::Share => "shares of the target",
            Scaling::Length => "coefficients of columns of length 1",
            _ => "physical coefficients",
        };
        match (self.optimizer.thresholds(), self.threshold) {
            (true, None) if self.optimizer == SindyOptimizer::Auto => {
                format!("stlsq, thresholds on {units}, and backward elimination")
            }
            (true, Some(threshold)) => format!("{}, threshold {threshold} on {units}", self.optimizer.name()),
            (true, None) => format!("{}, thresholds on {units}", self.optimizer.name()),
            (false, _) if self.optimizer == SindyOptimizer::GroupLasso => {
                format!("{}, {}", self.optimizer.name(), self.groups.in_words())
            }
            (false, _) => self.optimizer.name().to_owned(),
        }
    }

    /// Criterion of the number of terms, for people. `folds`: rule by which rows were held out.
    pub(super) fn choice_in_words(&self, folds: Option<&str>) -> String {
        if let Some(kappa) = self.kappa {
            let weight = if kappa > 0.0 { format!(", kappa = {kappa}") } else { String::new() };
            let most = self.terms.map_or_else(String::new, |terms| format!(", of at most {terms} terms an equation"));
            return format!("the model before the term with the least error reduction ratio{weight}{most}");
        }
        if let Some(terms) = self.terms {
            return format!("at most {terms} terms an equation, as asked for");
        }
        if self.threshold.is_some() || self.optimizer == SindyOptimizer::LeastSquares {
            return match folds {
                None => "nothing was chosen, no rows were held out".to_owned(),
                Some(folds) => format!("nothing was chosen; held-out errors of {folds}"),
            };
        }
        let rule = match self.criterion {
            Criterion::OneStandardError | Criterion::CrossValidation if folds.is_none() => {
                return "least BIC, because no rows could be held out".to_owned();
            }
            Criterion::OneStandardError => "fewest terms within one standard error of the least held-out error",
            Criterion::CrossValidation => "least held-out error",
            Criterion::Aic => "least AIC",
            Criterion::Bic => "least BIC",
            Criterion::Ebic => "least EBIC",
        };
        format!("{rule}{}", folds.map_or_else(String::new, |folds| format!("; {folds}")))
    }

    /// Remedies for an equation without terms, for people: options of this fit.
    pub(super) fn mend_of_no_terms(&self) -> String {
        match (self.threshold, self.terms, self.ensemble) {
            (Some(_), ..) => format!("lower the threshold ({THRESHOLD}), or offer other candidates ({LIBRARY})"),
            (None, Some(_), _) => format!("allow more terms ({TERMS}), or offer other candidates ({LIBRARY})"),
            (None, None, Some(_)) => {
                format!(
                    "too few members of the ensemble agree on any: lower {INCLUSION}, or offer other candidates ({LIBRARY})"
                )
            }
            (None, None, None) => {
                format!(
                    "the selection rule kept no candidate ({FRONT} shows the models of other sizes): offer others ({LIBRARY}), or set the number of terms ({TERMS})"
                )
            }
        }
    }

    /// The part that an ensemble varied, for people.
    pub(super) fn ensemble_in_words(&self) -> Option<String> {
        let (what, members) = self.ensemble?;
        let what = match what {
            Ensemble::Units(BootstrapUnit::Episode) => "resamples of episodes",
            Ensemble::Units(_) => "resamples of chunks",
            Ensemble::Library => "libraries without a fifth of the candidates",
        };
        Some(format!("terms in {:.0} % of {members} {what}", 100.0 * self.inclusion))
    }
}

fn scaling(normalize: Option<&Normalize>, automatic: bool) -> Result<Scaling, Error> {
    match normalize {
        Some(Normalize::Word(word)) if word == "length" => Ok(Scaling::Length),
        Some(Normalize::Word(word)) => Err(refused(
            "normalize",
            word,
            &format!("{}, {} or {}", setting::value("true"), setting::value("false"), setting::value("\"length\"")),
        )),
        Some(Normalize::Choice(share)) => Ok(if *share { Scaling::Share } else { Scaling::Physical }),
        None => Ok(if automatic { Scaling::Share } else { Scaling::Physical }),
    }
}

fn max_iterations(section: &SindySection, optimizer: SindyOptimizer) -> Result<usize, Error> {
    match section.max_iterations {
        None => Ok(Stlsq::default().max_iterations),
        Some(0) => Err(refused("max_iterations", 0, "a number from 1 on")),
        Some(most) if optimizer == SindyOptimizer::Stlsq => Ok(most),
        Some(most) => Err(Error::conflict(format!(
            "{entry}: it applies to the regressions of stlsq, and the optimizer is {}; remove it",
            optimizer.name(),
            entry = SINDY.entry("max_iterations").is(most)
        ))),
    }
}

fn kappa(section: &SindySection, optimizer: SindyOptimizer) -> Result<Option<f64>, Error> {
    match section.kappa {
        Some(kappa) if !(kappa >= 0.0 && kappa.is_finite()) => Err(refused("kappa", kappa, "a weight of zero or more")),
        Some(kappa) if optimizer != SindyOptimizer::Frols => Err(Error::conflict(format!(
            "{entry}: it weighs the terms of frols, and the optimizer is {}; remove it",
            optimizer.name(),
            entry = SINDY.entry("kappa").is(kappa)
        ))),
        kappa => Ok(kappa),
    }
}

/// Groups of terms that enter together. Refuses settings of the group lasso for other optimisers.
fn groups(section: &SindySection, optimizer: SindyOptimizer) -> Result<GroupRule, Error> {
    let given = [("groups", section.groups.is_some()), ("l1_ratio", section.l1_ratio.is_some())];
    if let Some((what, _)) = given.iter().find(|(_, given)| *given && optimizer != SindyOptimizer::GroupLasso) {
        return Err(Error::conflict(format!(
            "{entry}: it belongs to group-lasso, and the optimizer is {}; remove it",
            optimizer.name(),
            entry = SINDY.entry(what)
        )));
    }
    if let Some(value) = section.l1_ratio.filter(|value| !(0.0..=1.0).contains(value)) {
        return Err(refused("l1_ratio", value, "a share from 0 (the group lasso) to 1 (the lasso)"));
    }
    match section.groups.as_ref().map(|words| GroupRule::new(words, "sindy")).transpose()? {
        None => Ok(GroupRule::Signal),
        Some(GroupRule::Term) => Err(Error::value(format!(
            "{entry}: every equation selects its terms separately; {fit_sparse_command} fits all equations together, \
             so that a function is in all of them or in none",
            fit_sparse_command = FIT_SPARSE.with(GROUPS.to("term")),
            entry = SINDY.entry("groups").is("term")
        ))),
        Some(groups) => Ok(groups),
    }
}

fn refused(what: &str, value: impl std::fmt::Display, allowed: &str) -> Error {
    Error::value(format!("{entry}: write {allowed}", entry = SINDY.entry(what).is(value)))
}

fn ensemble(text: &str) -> Result<(Ensemble, usize), Error> {
    let allowed =
        "chunks, episodes or library, with the number of members after a colon where it is not 100: `episodes:1000`";
    let (what, count) = match text.split_once(':') {
        None => (text, Some(100)),
        Some((what, count)) => (what, count.parse().ok().filter(|count: &usize| (2..=100_000).contains(count))),
    };
    let what = match what {
        "chunks" => Ensemble::Units(BootstrapUnit::Chunk),
        "episodes" => Ensemble::Units(BootstrapUnit::Episode),
        "library" => Ensemble::Library,
        "rows" => {
            return Err(Error::value(format!(
                "{entry}: neighbouring rows of a log are not independent, and a resample of rows would need a pass each; \
                 resample `chunks` or `episodes`",
                entry = SINDY.entry("ensemble").is(text)
            )));
        }
        _ => return Err(refused("ensemble", text, allowed)),
    };
    count.map(|count| (what, count)).ok_or_else(|| refused("ensemble", text, allowed))
}

/// Reads `smooth_states` of `[sindy]`.
///
/// # Errors
/// Another entry that it would overrule.
fn smooth_states(section: &SindySection) -> Result<SmoothStates, Error> {
    let choice = section.smooth_states.unwrap_or_default();
    match overruled(section) {
        None => Ok(choice),
        Some(_) if choice == SmoothStates::Auto => Ok(SmoothStates::Off),
        Some(setting) if choice == SmoothStates::On => Err(Error::conflict(format!(
            "{entry}, and {setting}: terms are selected together with the smoothed states, by the residuals of the measurements; remove one of them",
            entry = SINDY.entry("smooth_states").is("on")
        ))),
        Some(_) => Ok(choice),
    }
}

/// Name of another setting that fixes the terms.
fn overruled(section: &SindySection) -> Option<&'static str> {
    let settings = [
        (section.terms.is_some(), "terms"),
        (section.threshold.is_some(), "threshold"),
        (section.ensemble.is_some(), "ensemble"),
        (section.groups.is_some(), "groups"),
        (section.select.is_some(), "select"),
        (section.optimizer.is_some_and(|optimizer| optimizer != SindyOptimizer::Auto), "an optimizer"),
        (section.objective.is_some_and(|objective| objective != Objective::OneStep), "an objective of simulations"),
    ];
    settings.into_iter().find(|(is_set, _)| *is_set).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str) -> Result<SindyOptions, String> {
        let section: SindySection = toml::from_str(text).map_err(|error| error.to_string())?;
        SindyOptions::new(&section).map_err(|error| error.to_string())
    }

    #[test]
    fn words_are_read() {
        let default = options("").unwrap();
        assert_eq!(
            (default.optimizer, default.threshold, default.scaling),
            (SindyOptimizer::Auto, None, Scaling::Share)
        );
        assert_eq!((default.criterion, default.folds), (Criterion::OneStandardError, FoldRule::Auto));
        let physical = options("threshold = 0.1").unwrap();
        assert_eq!((physical.threshold, physical.scaling, physical.ridge), (Some(0.1), Scaling::Physical, 0.05));
        assert_eq!(options("threshold = \"auto\"").unwrap().threshold, None);
        let drawn = options("ensemble = \"episodes:50\"\ninclusion = 0.9").unwrap();
        assert_eq!(drawn.ensemble, Some((Ensemble::Units(BootstrapUnit::Episode), 50)));
        assert_eq!(options("ensemble = \"library\"").unwrap().ensemble, Some((Ensemble::Library, 100)));
        assert_eq!(options("optimizer = \"frols\"\nterms = 3").unwrap().terms, Some(3));
        let peer = options("threshold = 0.1\nnormalize = \"length\"\nmax_iterations = 1").unwrap();
        assert_eq!((peer.scaling, peer.max_iterations), (Scaling::Length, 1));
        let grouped = options("groups = \"signal\"").unwrap();
        assert_eq!((grouped.optimizer, grouped.groups), (SindyOptimizer::GroupLasso, GroupRule::Signal));
        let sparse = options("optimizer = \"group-lasso\"\nl1_ratio = 0.2").unwrap();
        assert_eq!(
            (sparse.l1_ratio, sparse.method_in_words()),
            (0.2, "group-lasso, the functions of a signal together".into())
        );
        assert_eq!(options("optimizer = \"frols\"\nkappa = 0.1").unwrap().kappa, Some(0.1));
        // An explicit choice of terms is not overruled.
        assert_eq!(default.smooth_states, SmoothStates::Auto);
        assert_eq!(options("terms = 3").unwrap().smooth_states, SmoothStates::Off);
        assert_eq!(options("select = \"bic\"\nsmooth_states = \"auto\"").unwrap().smooth_states, SmoothStates::Off);
    }

    #[test]
    fn an_automatic_threshold_is_not_to_be_lowered() {
        let mend = |text: &str| options(text).unwrap().mend_of_no_terms();
        assert!(mend("threshold = 0.5").contains("lower the threshold"));
        for (text, option) in [
            ("", "--terms"),
            ("optimizer = \"lasso\"", "--terms"),
            ("ensemble = \"chunks:50\"", "--inclusion"),
            ("terms = 1", "--terms"),
        ] {
            assert!(mend(text).contains(option) && !mend(text).contains("threshold"), "{text}: {}", mend(text));
        }
    }

    #[test]
    fn refused_options_are_named_with_the_alternatives() {
        for (text, parts) in [
            ("optimizer = \"lars\"", ["lars", "`frols`"]),
            ("threshold = -1.0", ["threshold = -1", "zero or more"]),
            ("threshold = \"small\"", ["threshold = small", "auto"]),
            ("threshold = 0.1\noptimizer = \"frols\"", ["frols has no threshold", "terms"]),
            ("threshold = 0.1\nterms = 3", ["both", "remove one"]),
            ("terms = 0", ["terms = 0", "from 1 on"]),
            ("weak = 8", ["weak = 8", "from 9 on"]),
            ("weak = 20.5", ["weak = 20.5", "a number of rows"]),
            ("weak = \"long\"", ["weak = long", "auto, off"]),
            ("smooth_states = \"on\"\nterms = 3", ["smooth_states = on, and terms", "remove one"]),
            ("smooth_states = \"often\"", ["often", "`auto`"]),
            ("ridge = -0.1", ["ridge = -0.1", "zero or more"]),
            ("select = \"r2\"", ["r2", "`one-se`"]),
            ("folds = \"1\"", ["folds = 1", "from 2 on"]),
            ("ensemble = \"days\"", ["ensemble = days", "episodes:1000"]),
            ("ensemble = \"chunks:1\"", ["ensemble = chunks:1", "episodes:1000"]),
            ("ensemble = \"rows:100\"", ["ensemble = rows:100", "chunks"]),
            ("ensemble = \"chunks\"\ninclusion = 1.5", ["inclusion = 1.5", "at most 1"]),
            ("inclusion = 0.5", ["no ensemble", "chunks:100"]),
            ("normalize = \"long\"", ["normalize = long", "length"]),
            ("max_iterations = 0", ["max_iterations = 0", "from 1 on"]),
            ("max_iterations = 5\noptimizer = \"frols\"", ["max_iterations = 5", "frols"]),
            ("kappa = 0.1", ["kappa = 0.1", "the optimizer is auto"]),
            ("kappa = -0.1\noptimizer = \"frols\"", ["kappa = -0.1", "zero or more"]),
            ("groups = \"signal\"\noptimizer = \"lasso\"", ["groups: it belongs to group-lasso", "lasso"]),
            ("l1_ratio = 0.5", ["l1_ratio: it belongs to group-lasso", "auto"]),
            ("groups = \"term\"", ["groups = term", "fit sparse"]),
            ("groups = \"legs\"", ["groups = legs", "signal"]),
            ("groups = \"signal\"\nl1_ratio = 2.0", ["l1_ratio = 2", "from 0"]),
            ("groups = \"signal\"\nthreshold = 0.1", ["group-lasso has no threshold", "terms"]),
        ] {
            let message = options(text).expect_err(text);
            assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
        }
    }
}
