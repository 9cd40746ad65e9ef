//! How an autoregression is found: the words of `[narx]`, checked once.

use fleetfoot_pwa::Specification;
use fleetfoot_sparse::NarxOrder;

use crate::{Criterion, Error, NarxSection, NarxTerms, Recipe, sparse_fit::words};

/// How many terms an equation has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TermRule {
    /// As many, by forward regression.
    Count(usize),
    /// Chosen, at most as many.
    Auto(usize),
    /// All candidates.
    All,
}

/// What order, terms and partition are chosen by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NarxSelection {
    /// The error of simulations of spans that did not train.
    FreeRun,
    /// One-step errors.
    OneStep(Criterion),
}

/// How an autoregression is found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct NarxOptions {
    /// Lags and degree; the largest with [`NarxOptions::search`].
    pub order: NarxOrder,
    /// Whether inputs act at once.
    pub direct: bool,
    /// Whether smaller orders are tried.
    pub search: bool,
    /// Number of terms.
    pub terms: TermRule,
    /// What is chosen by.
    pub selection: NarxSelection,
    /// Spans of the training rows that are held out in turn.
    pub folds: usize,
    /// Every n-th row is kept.
    pub decimate: usize,
    /// Last share of every episode's rows that does not train.
    pub test_share: f64,
    /// Partitions to choose from.
    pub partitions: Vec<Specification>,
    /// Seed of k-means.
    pub seed: u64,
    /// Clusterings of every k to choose from, from this seed and the next ones.
    pub starts: usize,
}

const LAGS: usize = 2;
const DEGREE: usize = 2;
const FOLDS: usize = 5;
/// The most terms when none are given.
const MAX_TERMS: usize = 20;
const MAX_LAGS: usize = 1_000;

impl NarxOptions {
    /// Reads `[narx]`, and the degree and partitions of `[model]`.
    ///
    /// # Errors
    /// A word or number that is not allowed, with those that are.
    pub fn new(recipe: &Recipe) -> Result<Self, Error> {
        let section = &recipe.narx;
        let has_inputs = !recipe.inputs.is_empty();
        let order = NarxOrder {
            outputs: within("lags_out", section.lags_out.unwrap_or(LAGS), 0, MAX_LAGS)?,
            inputs: within("lags_in", section.lags_in.unwrap_or(if has_inputs { LAGS } else { 0 }), 0, MAX_LAGS)?,
            degree: within("degree", recipe.model.degree.map_or(DEGREE, |degree| degree as usize), 1, 20)?,
        };
        if section.lags_in.is_some_and(|lags| lags > 0) && !has_inputs {
            return Err(Error::Request(
                "[narx] lags_in: there are no inputs; name them (--inputs, or [inputs] of the recipe)".into(),
            ));
        }
        let direct = section.direct.unwrap_or(false);
        if order.outputs == 0 && order.inputs == 0 && !(direct && has_inputs) {
            return Err(Error::Request(
                "[narx] lags_out = 0 and lags_in = 0: nothing is left to predict from; give at least one lag".into(),
            ));
        }
        let partitions = match &recipe.model.partition {
            None => vec![Specification::Average],
            Some(text) => Specification::parse_list(text)?,
        };
        if partitions.contains(&Specification::Null) {
            return Err(Error::Request(
                "--partition null: a null model has no equations; it is printed beside the others in any case".into(),
            ));
        }
        let options = Self {
            order,
            direct,
            search: search(section)?,
            terms: terms(section)?,
            selection: selection(section)?,
            folds: within("folds", section.folds.unwrap_or(FOLDS), 2, 1_000)?,
            decimate: within("decimate", section.decimate.unwrap_or(1), 1, 1_000_000)?,
            test_share: section.test_share.unwrap_or(0.0),
            partitions,
            seed: section.seed.unwrap_or(0),
            starts: within("starts", section.starts.unwrap_or(1), 1, 1_000)?,
        };
        if !(0.0..1.0).contains(&options.test_share) {
            return Err(refused("test_share", options.test_share, "a share of the rows from 0 to less than 1"));
        }
        if options.starts > 1 && options.selection != NarxSelection::FreeRun {
            return Err(refused(
                "starts",
                options.starts,
                "1, or leave --select away: clusterings are compared by free runs only",
            ));
        }
        if options.partitions.len() > 1 && options.selection != NarxSelection::FreeRun {
            return Err(Error::Request(format!(
                "--partition {}: several partitions are compared by free runs only; name one, or leave --select away",
                recipe.model.partition.as_deref().unwrap_or_default()
            )));
        }
        Ok(options)
    }
}

fn search(section: &NarxSection) -> Result<bool, Error> {
    match section.order.as_deref() {
        None | Some("fixed") => Ok(false),
        Some("auto") => Ok(true),
        Some(other) => Err(refused("order", other, "fixed or auto")),
    }
}

fn terms(section: &NarxSection) -> Result<TermRule, Error> {
    let most = within("max_terms", section.max_terms.unwrap_or(MAX_TERMS), 1, 10_000)?;
    match &section.terms {
        None => Ok(TermRule::Auto(most)),
        Some(NarxTerms::Word(word)) if word == "auto" => Ok(TermRule::Auto(most)),
        Some(NarxTerms::Word(word)) if word == "all" => Ok(TermRule::All),
        Some(NarxTerms::Number(count)) if *count > 0 => Ok(TermRule::Count(*count)),
        Some(NarxTerms::Number(count)) => Err(refused("terms", count, "auto, all, or a number from 1 on")),
        Some(NarxTerms::Word(word)) => Err(refused("terms", word, "auto, all, or a number from 1 on")),
    }
}

fn selection(section: &NarxSection) -> Result<NarxSelection, Error> {
    match section.select.as_deref() {
        None | Some("free-run") => Ok(NarxSelection::FreeRun),
        Some(word) => words::criterion(word)
            .map(NarxSelection::OneStep)
            .ok_or_else(|| refused("select", word, "free-run, one-se, cv, aic, bic or ebic")),
    }
}

fn within(what: &str, value: usize, least: usize, most: usize) -> Result<usize, Error> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(refused(what, value, format!("a number from {least} to {most}")))
    }
}

fn refused(what: &str, value: impl std::fmt::Display, allowed: impl std::fmt::Display) -> Error {
    Error::Request(format!("[narx] {what} = {value}: write {allowed}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str) -> Result<NarxOptions, String> {
        let recipe = Recipe::parse(text, "test").map_err(|error| error.to_string())?;
        NarxOptions::new(&recipe).map_err(|error| error.to_string())
    }

    #[test]
    fn words_are_read() {
        let default = options("[states]\ny = {}\n[inputs]\nu = \"u\"\n").unwrap();
        assert_eq!(default.order, NarxOrder { outputs: 2, inputs: 2, degree: 2 });
        assert_eq!(
            (default.selection, default.terms, default.search),
            (NarxSelection::FreeRun, TermRule::Auto(20), false)
        );
        let text = "[narx]\nlags_out = 3\nterms = 15\norder = \"auto\"\nselect = \"bic\"\n[model]\ndegree = 3\npartition = \"kmeans:4\"";
        let given = options(text).unwrap();
        assert_eq!(given.order, NarxOrder { outputs: 3, inputs: 0, degree: 3 });
        assert_eq!(given.selection, NarxSelection::OneStep(Criterion::Bic));
        assert_eq!((given.terms, given.search), (TermRule::Count(15), true));
        assert_eq!(given.partitions, [Specification::KMeans(4)]);
    }

    #[test]
    fn what_is_not_allowed_is_said_with_what_is() {
        for (text, parts) in [
            ("[narx]\nlags_out = 0", &["nothing is left", "lag"][..]),
            ("[narx]\nlags_in = 2", &["no inputs", "--inputs"]),
            ("[narx]\nterms = 0", &["terms = 0", "from 1 on"]),
            ("[narx]\nterms = \"many\"", &["terms = many", "auto"]),
            ("[narx]\norder = \"best\"", &["order = best", "auto"]),
            ("[narx]\nselect = \"r2\"", &["select = r2", "free-run"]),
            ("[narx]\nfolds = 1", &["folds = 1", "2 to"]),
            ("[narx]\nstarts = 3\nselect = \"bic\"", &["starts = 3", "free runs only"]),
            ("[narx]\ndecimate = 0", &["decimate = 0", "1 to"]),
            ("[narx]\ntest_share = 1.0", &["test_share = 1", "less than 1"]),
            ("[narx]\nlag_out = 1", &["lag_out", "lags_out"]),
            ("[model]\npartition = \"null\"", &["null model"]),
            ("[narx]\nselect = \"cv\"\n[model]\npartition = \"kmeans:2,3\"", &["free runs only"]),
        ] {
            let message = options(text).expect_err(text);
            assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
        }
    }
}
