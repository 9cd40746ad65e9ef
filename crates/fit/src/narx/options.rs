//! Options of an autoregression: the settings of `[narx]`, checked once.

use fleetfoot_data::setting::{INPUTS, INPUTS_SECTION, LAGS, NARX, PARTITION, SELECT};
use fleetfoot_pwa::Specification;
use fleetfoot_recipe::{
    Criterion, Effort, GivenAs, Lags, NarxSection, NarxSelection, NarxTerms, Objective, Recipe, seed,
};
use fleetfoot_sparse::narx::NarxOrder;

use crate::{error::Error, radial};

/// Number of terms of an equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TermRule {
    /// As many, by forward regression.
    Count(usize),
    /// Chosen, at most as many.
    Auto(usize),
    /// All candidates.
    All,
}

impl TermRule {
    /// Returns true if the fit chooses the number of terms.
    pub(crate) fn is_free(self) -> bool {
        matches!(self, Self::Auto(_))
    }
}

/// Source of lags, degree and direct inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderRule {
    /// As given.
    Fixed(NarxOrder),
    /// The best up to this one.
    UpTo(NarxOrder),
    /// Missing parts are searched for, within an effort.
    Look(GivenOrder),
}

/// The parts of an order that the user gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GivenOrder {
    /// Past values of every output.
    pub outputs: Option<usize>,
    /// Past values of every input.
    pub inputs: Option<usize>,
    /// Total degree.
    pub degree: Option<usize>,
    /// True if inputs act at once (lag 0).
    pub direct: Option<bool>,
    /// Rows between two past values.
    pub every: Option<usize>,
}

impl GivenOrder {
    /// The order with the given parts, the rest from another.
    pub(crate) fn or(self, other: NarxOrder) -> NarxOrder {
        NarxOrder {
            outputs: self.outputs.unwrap_or(other.outputs),
            inputs: self.inputs.unwrap_or(other.inputs),
            degree: self.degree.unwrap_or(other.degree),
            direct: self.direct.unwrap_or(other.direct),
            every: self.every.unwrap_or(other.every),
        }
    }
}

/// Options of an autoregression.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct NarxOptions {
    /// Lags, degree, and whether inputs act at once.
    pub order: OrderRule,
    /// Effort of the search for orders.
    pub effort: Effort,
    /// Number of terms.
    pub terms: TermRule,
    /// Criterion of the choice.
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
    /// Objective of the coefficients.
    pub objective: Objective,
    /// Seconds over which the logs were smoothed before, where they were.
    pub(crate) smoothed: Option<f64>,
}

/// The order where nothing is given and nothing is looked for.
pub(crate) const USUAL: NarxOrder = NarxOrder { outputs: 2, inputs: 2, degree: 2, direct: false, every: 1 };
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
        radial::refuse(recipe, "fit narx")?;
        let section = &recipe.narx;
        let selection = section.select.unwrap_or_default();
        let terms = terms(section)?;
        let order = order(recipe, selection, terms)?;
        let partitions = match &recipe.model.partition {
            None => vec![Specification::Average],
            Some(text) => Specification::parse_list(text)?,
        };
        if partitions.contains(&Specification::Null) {
            return Err(Error::value(format!(
                "{given_partition}: a null model has no equations; it is printed beside the others in any case",
                given_partition = PARTITION.to("null")
            )));
        }
        let options = Self {
            order,
            effort: section.effort.unwrap_or_default(),
            terms,
            selection,
            folds: within("folds", section.folds.unwrap_or(FOLDS), 2, 1_000)?,
            decimate: within("decimate", section.decimate.unwrap_or(1), 1, 1_000_000)?,
            test_share: section.test_share.unwrap_or(0.0),
            partitions,
            seed: seed("narx", section.seed)?,
            starts: within("starts", section.starts.unwrap_or(1), 1, 1_000)?,
            objective: section.objective.unwrap_or_default(),
            smoothed: recipe.time.smoothed,
        };
        if !(0.0..1.0).contains(&options.test_share) {
            return Err(refused("test_share", options.test_share, "a share of the rows from 0 to less than 1"));
        }
        if options.starts > 1 && options.selection != NarxSelection::FreeRun {
            return Err(refused(
                "starts",
                options.starts,
                format!("1, or remove {SELECT}: clusterings are compared by free runs only"),
            ));
        }
        if options.partitions.len() > 1 && options.selection == NarxSelection::OneStep(Criterion::Ebic) {
            return Err(Error::conflict(format!(
                "{}: the EBIC compares the terms of one partition; name one, or choose by {given_select}",
                PARTITION.to(recipe.model.partition.as_deref().unwrap_or_default()),
                given_select = SELECT.to("bic")
            )));
        }
        Ok(options)
    }
}

/// Order rule of a recipe: the given parts, and a search or the defaults for the others.
fn order(recipe: &Recipe, selection: NarxSelection, terms: TermRule) -> Result<OrderRule, Error> {
    let section = &recipe.narx;
    let has_inputs = !recipe.inputs.is_empty();
    if section.lags_in.is_some_and(|lags| lags > 0) && !has_inputs {
        return Err(Error::missing(format!(
            "{entry}: there are no inputs; name them ({INPUTS}, or {INPUTS_SECTION} of the recipe)",
            entry = NARX.entry("lags_in")
        )));
    }
    let past = recipe.model.lags.map(|lags| Past::new(lags, section, has_inputs)).transpose()?;
    let lags = |what, value: Option<usize>| value.map(|lags| within(what, lags, 0, MAX_LAGS)).transpose();
    let degree = recipe.model.degree.map(|degree| within("degree", degree as usize, 1, 20)).transpose()?;
    let additive = !recipe.library.functions.is_empty();
    if let Some(degree) = degree.filter(|_| additive) {
        return Err(refused(
            "degree",
            degree,
            "no degree beside a library: its functions are added up, not multiplied",
        ));
    }
    let given = GivenOrder {
        outputs: past.map_or_else(|| lags("lags_out", section.lags_out), |past| Ok(Some(past.values)))?,
        inputs: match past {
            _ if !has_inputs => Some(0),
            Some(past) => Some(past.values),
            None => lags("lags_in", section.lags_in)?,
        },
        every: past.map(|past| past.every),
        degree: if additive { Some(1) } else { degree },
        // A caller who sets the lags of inputs has also set how inputs act.
        direct: if has_inputs {
            section.direct.or(section.lags_in.or(past.map(|past| past.values)).map(|_| false))
        } else {
            Some(false)
        },
    };
    if given.outputs == Some(0) && given.inputs == Some(0) && given.direct == Some(false) {
        return Err(Error::value(format!(
            "{entry} and lags_in = 0: nothing is left to predict from; give at least one lag",
            entry = NARX.entry("lags_out").is(0)
        )));
    }
    let all = given.or(USUAL);
    let whole = given.outputs.is_some() && given.inputs.is_some() && given.degree.is_some() && given.direct.is_some();
    Ok(match section.order {
        Some(GivenAs::Fixed) => OrderRule::Fixed(all),
        Some(GivenAs::Auto) => OrderRule::UpTo(all),
        // Criteria of one-step errors compare orders that are named.
        None if selection != NarxSelection::FreeRun => OrderRule::Fixed(all),
        None if whole && !matches!(terms, TermRule::Auto(_)) => OrderRule::Fixed(all),
        None => OrderRule::Look(given),
    })
}

/// Past rows of outputs and inputs, counted as in all methods: the present row, which predicts the next, and those
/// before it.
#[derive(Clone, Copy)]
struct Past {
    values: usize,
    every: usize,
}

impl Past {
    fn new(lags: Lags, section: &NarxSection, has_inputs: bool) -> Result<Self, Error> {
        let entries = [("lags_out", section.lags_out), ("lags_in", section.lags_in)];
        if let Some((entry, _)) = entries.iter().find(|(_, value)| value.is_some()) {
            return Err(Error::conflict(format!(
                "{} and {given_lags}: both set the number of earlier rows; remove one. {LAGS} counts the rows before the present one, of outputs{}",
                NARX.entry(entry),
                if has_inputs { " and inputs" } else { "" },
                given_lags = LAGS.to(lags)
            )));
        }
        let every = lags.steps().next().map_or(1, |first| first as usize);
        let values = 1 + lags.steps().count();
        Ok(Self { values: within("lags", values, 1, MAX_LAGS)?, every })
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

fn within(what: &str, value: usize, least: usize, most: usize) -> Result<usize, Error> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(refused(what, value, format!("a number from {least} to {most}")))
    }
}

fn refused(what: &str, value: impl std::fmt::Display, allowed: impl std::fmt::Display) -> Error {
    Error::value(format!("{entry}: write {allowed}", entry = NARX.entry(what).is(value)))
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
        assert_eq!(default.order, OrderRule::Look(GivenOrder::default()));
        assert_eq!(
            (default.selection, default.terms, default.effort),
            (NarxSelection::FreeRun, TermRule::Auto(20), Effort::Normal)
        );
        let text = "[narx]\nlags_out = 3\nterms = 15\norder = \"auto\"\nselect = \"bic\"\n[model]\ndegree = 3\npartition = \"kmeans:4\"";
        let given = options(text).unwrap();
        assert_eq!(
            given.order,
            OrderRule::UpTo(NarxOrder { outputs: 3, inputs: 0, degree: 3, direct: false, every: 1 })
        );
        assert_eq!(given.selection, NarxSelection::OneStep(Criterion::Bic));
        assert_eq!(given.terms, TermRule::Count(15));
        assert_eq!(given.partitions, [Specification::KMeans(4)]);
    }

    #[test]
    fn given_orders_are_not_searched() {
        let order = |text: &str| options(&format!("{text}\n[inputs]\nu = \"u\"\n")).unwrap().order;
        let given = GivenOrder { outputs: Some(3), degree: Some(1), ..GivenOrder::default() };
        assert_eq!(order("[narx]\nlags_out = 3\n[model]\ndegree = 1"), OrderRule::Look(given));
        // The lags of the inputs say how they act.
        let given = GivenOrder { inputs: Some(2), direct: Some(false), ..GivenOrder::default() };
        assert_eq!(order("[narx]\nlags_in = 2"), OrderRule::Look(given));
        let all = NarxOrder { outputs: 1, inputs: 2, degree: 3, direct: true, every: 1 };
        // Every fifth of the last fifty rows beside the present one, which is one row before what is told.
        let gleaned = order("[model]\nlags = { last = 50, every = 5 }");
        let given = GivenOrder {
            outputs: Some(11),
            inputs: Some(11),
            direct: Some(false),
            every: Some(5),
            ..GivenOrder::default()
        };
        assert_eq!(gleaned, OrderRule::Look(given));
        assert_eq!(given.or(USUAL).reach(), 51);
        let text = "[narx]\nlags_out = 1\nlags_in = 2\ndirect = true\nterms = 5\n[model]\ndegree = 3";
        assert_eq!(order(text), OrderRule::Fixed(all));
        assert_eq!(order("[narx]\nselect = \"bic\""), OrderRule::Fixed(USUAL));
        assert_eq!(order("[narx]\norder = \"fixed\""), OrderRule::Fixed(USUAL));
        let text = "[library]\nfunctions = [\"y\", \"u^2\"]";
        assert_eq!(order(text), OrderRule::Look(GivenOrder { degree: Some(1), ..GivenOrder::default() }));
    }

    #[test]
    fn refused_options_are_named_with_the_alternatives() {
        for (text, parts) in [
            ("[narx]\nlags_out = 0", &["nothing is left", "lag"][..]),
            ("[narx]\nlags_out = 2\n[model]\nlags = 3", &["lags_out and --lags 3", "remove one"]),
            ("[model]\nlags = 5000", &["lags = 5001", "1000"]),
            ("[narx]\nlags_in = 2", &["no inputs", "--inputs"]),
            ("[narx]\nterms = 0", &["terms = 0", "from 1 on"]),
            ("[narx]\nterms = \"many\"", &["terms = many", "auto"]),
            ("[narx]\norder = \"best\"", &["order = \"best\"", "`auto`"]),
            ("[narx]\nselect = \"r2\"", &["select = \"r2\"", "free-run"]),
            ("[narx]\neffort = \"all\"", &["effort = \"all\"", "`normal`"]),
            ("[library]\nfunctions = [\"u\"]\n[model]\ndegree = 2", &["degree = 2", "added up"]),
            ("[narx]\nfolds = 1", &["folds = 1", "2 to"]),
            ("[narx]\nstarts = 3\nselect = \"bic\"", &["starts = 3", "free runs only"]),
            ("[narx]\ndecimate = 0", &["decimate = 0", "1 to"]),
            ("[narx]\ntest_share = 1.0", &["test_share = 1", "less than 1"]),
            ("[narx]\nlag_out = 1", &["lag_out", "lags_out"]),
            ("[model]\npartition = \"null\"", &["null model"]),
            ("[narx]\nselect = \"ebic\"\n[model]\npartition = \"kmeans:2,3\"", &["EBIC", "--select bic"]),
        ] {
            let message = options(text).expect_err(text);
            assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
        }
    }
}
