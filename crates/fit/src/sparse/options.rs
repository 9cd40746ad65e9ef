//! Options of a sparse regression: the settings of `[sparse]`, checked once.

use fleetfoot_data::Work;
use fleetfoot_data::setting::{BOLASSO, FOLDS, SPARSE, STABILITY};
use fleetfoot_recipe::{Criterion, GroupRule, SparseSection, seed};
use fleetfoot_sparse::bolasso::BootstrapUnit;

use crate::{error::Error, folds, folds::FoldRule};

/// Cost of a path of lambda, in factorisations of the size of the problem.
const OF_PATH: f64 = 2.5;

/// Source of lambda.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LambdaRule {
    /// Chosen by [`Criterion`].
    Auto,
    /// This value.
    Value(f64),
    /// This value over the root of the number of rows.
    OverRoot(f64),
}

/// Units that a bolasso resamples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resampled {
    /// Rows: needs a pass over the data.
    Rows,
    /// Chunks of the statistic, or episodes.
    Units(BootstrapUnit),
}

/// Options of a sparse regression.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseOptions {
    /// Source of lambda.
    pub lambda: LambdaRule,
    /// Criterion that chooses lambda.
    pub criterion: Criterion,
    /// Rule by which rows are held out.
    pub folds: FoldRule,
    /// Share of the absolute values in the penalty.
    pub l1_ratio: f64,
    /// Functions that enter together: then the rest of the penalty is the norms of the groups, else squares.
    pub groups: Option<GroupRule>,
    /// Penalty factors from a first fit.
    pub adaptive: bool,
    /// Units that a bolasso resamples, and the number of replicates.
    pub bolasso: Option<(Resampled, usize)>,
    /// Share of the replicates that must select a column.
    pub threshold: Option<f64>,
    /// Stability selection by half-samples.
    pub stability: bool,
    /// Penalise coefficients in raw units.
    pub unscaled: bool,
    /// Strength of the priors that name none.
    pub prior_strength: f64,
    /// Seed of everything random.
    pub seed: u64,
}

impl SparseOptions {
    /// Work of the choice of lambda among `coefficients` and of the replicates of a bolasso, without passes over rows.
    /// A path costs some factorisations. Measured against fits of 90 to 180 functions.
    pub fn work(&self, coefficients: usize, folds: usize) -> Work {
        let criterion = !matches!(self.criterion, Criterion::CrossValidation | Criterion::OneStandardError);
        let paths = folds + 1 + if criterion && self.lambda == LambdaRule::Auto { 12 } else { 0 };
        let replicates = self.bolasso.map_or(0, |(_, count)| count);
        Work {
            operations: (OF_PATH * paths as f64 + replicates as f64) * (coefficients as f64).powi(3),
            parts: folds.max(1),
            mend: format!("fewer functions or fewer folds ({given_folds}) make it shorter", given_folds = FOLDS.to(2)),
        }
    }

    /// [`SparseOptions::work`] before rows are read.
    pub fn planned_work(&self, coefficients: usize, episodes: Option<usize>) -> Work {
        self.work(coefficients, self.folds.expected(episodes))
    }

    /// Reads the settings of a recipe's `[sparse]`.
    ///
    /// # Errors
    /// A word or number that is not allowed; the message lists those that are.
    pub fn new(section: &SparseSection) -> Result<Self, Error> {
        let threshold = section.threshold;
        if let Some(value) = threshold.filter(|value| !(*value > 0.0 && *value <= 1.0)) {
            return Err(refused("threshold", value, "a share of the replicates above 0, at most 1"));
        }
        let groups = section.groups.as_ref().map(|words| GroupRule::new(words, "sparse")).transpose()?;
        let l1_ratio = section.l1_ratio.unwrap_or(if groups.is_some() { 0.0 } else { 1.0 });
        if groups.is_some() && !(0.0..=1.0).contains(&l1_ratio) {
            return Err(refused("l1_ratio", l1_ratio, "a share from 0 (the group lasso) to 1 (the lasso)"));
        }
        if groups.is_none() && !(l1_ratio > 0.0 && l1_ratio <= 1.0) {
            return Err(refused("l1_ratio", l1_ratio, "a share above 0, at most 1 (the lasso)"));
        }
        let prior_strength = section.prior_strength.unwrap_or(1.0);
        if !(prior_strength >= 0.0 && prior_strength.is_finite()) {
            return Err(refused("prior_strength", prior_strength, "a weight of zero or more"));
        }
        let bolasso = section.bolasso.as_deref().map(resampled).transpose()?;
        let stability = section.stability.unwrap_or(false);
        if stability && bolasso.is_some() {
            return Err(Error::conflict(format!(
                "{SPARSE} has both `bolasso` and `stability`; both choose the columns, so take one of them"
            )));
        }
        if groups.is_some() && (bolasso.is_some() || stability) {
            return Err(Error::conflict(format!(
                "{} with a bolasso or stability selection: their replicates are lassos; remove one of them",
                SPARSE.entry("groups")
            )));
        }
        if l1_ratio < 1.0 && (bolasso.is_some() || stability) {
            return Err(Error::conflict(format!(
                "{} below 1 with a bolasso or stability selection: their replicates are lassos; remove one of them",
                SPARSE.entry("l1_ratio")
            )));
        }
        let folds = section.folds.as_deref().unwrap_or("auto");
        Ok(Self {
            lambda: lambda(section.lambda.as_deref().unwrap_or("auto"))?,
            criterion: section.select.unwrap_or_default(),
            folds: folds::parse(folds).ok_or_else(|| refused("folds", folds, folds::WORDS))?,
            l1_ratio,
            groups,
            adaptive: section.adaptive.unwrap_or(false),
            bolasso,
            threshold,
            stability,
            unscaled: section.unscaled.unwrap_or(false),
            prior_strength,
            seed: seed("sparse", section.seed)?,
        })
    }
}

/// Entries that others leave without a meaning, for people.
pub(super) fn unused(section: &SparseSection, options: &SparseOptions) -> Vec<String> {
    let replicates = options.bolasso.is_some() || options.stability;
    let threshold = options.threshold.filter(|_| !replicates).map(|share| {
        format!(
            "{entry} is not used: it is the share of replicates that select a function, and there are none without a bolasso or stability selection ({BOLASSO}, {STABILITY})", entry = SPARSE.entry("threshold").is(share)
        )
    });
    let given = options.lambda != LambdaRule::Auto && section.select.is_some();
    let select = given.then(|| format!("{} is not used: lambda is given", SPARSE.entry("select")));
    threshold.into_iter().chain(select).collect()
}

fn refused(what: &str, value: impl std::fmt::Display, allowed: &str) -> Error {
    Error::value(format!("{entry}: write {allowed}", entry = SPARSE.entry(what).is(value)))
}

fn lambda(text: &str) -> Result<LambdaRule, Error> {
    let compact: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    if compact == "auto" {
        return Ok(LambdaRule::Auto);
    }
    let (number, rule): (&str, fn(f64) -> LambdaRule) = match compact.strip_suffix("/sqrt(n)") {
        Some(number) => (number, LambdaRule::OverRoot),
        None => (&compact, LambdaRule::Value),
    };
    match number.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(rule(value)),
        _ => Err(refused(
            "lambda",
            text,
            "auto, a number of zero or more, or a number over the root of the rows, `0.5/sqrt(n)`",
        )),
    }
}

fn resampled(text: &str) -> Result<(Resampled, usize), Error> {
    let allowed =
        "rows, chunks or episodes, with the number of replicates after a colon where it is not 128: `episodes:1000`";
    let (what, count) = match text.split_once(':') {
        None => (text, Some(128)),
        Some((what, count)) => (what, count.parse().ok().filter(|&count: &usize| (1..=100_000).contains(&count))),
    };
    let what = match what {
        "rows" => Resampled::Rows,
        "chunks" => Resampled::Units(BootstrapUnit::Chunk),
        "episodes" => Resampled::Units(BootstrapUnit::Episode),
        _ => return Err(refused("bolasso", text, allowed)),
    };
    count.map(|count| (what, count)).ok_or_else(|| refused("bolasso", text, allowed))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str) -> Result<SparseOptions, String> {
        let section: SparseSection = toml::from_str(text).map_err(|error| error.to_string())?;
        SparseOptions::new(&section).map_err(|error| error.to_string())
    }

    #[test]
    fn words_are_read() {
        let default = options("").unwrap();
        assert_eq!((default.lambda, default.criterion), (LambdaRule::Auto, Criterion::OneStandardError));
        assert_eq!((default.folds, default.bolasso), (FoldRule::Auto, None));
        assert_eq!(options("lambda = \"0.5 / sqrt(n)\"").unwrap().lambda, LambdaRule::OverRoot(0.5));
        assert_eq!(options("lambda = \"1e-3\"").unwrap().lambda, LambdaRule::Value(1e-3));
        assert_eq!(options("folds = \"splits:30\"").unwrap().folds, FoldRule::Splits(30));
        let grouped = options("groups = \"signal\"").unwrap();
        assert_eq!((grouped.groups, grouped.l1_ratio, default.l1_ratio), (Some(GroupRule::Signal), 0.0, 1.0));
        assert_eq!(options("bolasso = \"rows\"").unwrap().bolasso, Some((Resampled::Rows, 128)));
        let episodes = Resampled::Units(BootstrapUnit::Episode);
        assert_eq!(options("bolasso = \"episodes:1000\"").unwrap().bolasso, Some((episodes, 1000)));
    }

    #[test]
    fn options_without_effect_are_reported() {
        let notes = |text: &str| {
            let section: SparseSection = toml::from_str(text).unwrap();
            unused(&section, &SparseOptions::new(&section).unwrap())
        };
        assert!(notes("threshold = 0.9")[0].contains("threshold = 0.9 is not used"));
        assert!(notes("select = \"bic\"\nlambda = \"0.1\"")[0].contains("select is not used"));
        for text in [
            "",
            "threshold = 0.9\nbolasso = \"rows\"",
            "threshold = 0.9\nstability = true",
            "select = \"bic\"",
            "lambda = \"0.1\"",
        ] {
            assert!(notes(text).is_empty(), "{text}");
        }
    }

    #[test]
    fn refused_options_are_named_with_the_alternatives() {
        for (text, parts) in [
            ("lambda = \"big\"", ["lambda = big", "auto"]),
            ("lambda = \"-1\"", ["lambda = -1", "zero or more"]),
            ("select = \"r2\"", ["r2", "`one-se`"]),
            ("folds = \"1\"", ["folds = 1", "from 2 on"]),
            ("folds = \"splits:x\"", ["folds = splits:x", "splits:30"]),
            ("bolasso = \"days\"", ["bolasso = days", "episodes"]),
            ("bolasso = \"rows:0\"", ["bolasso = rows:0", "replicates"]),
            ("threshold = 1.5", ["threshold = 1.5", "at most 1"]),
            ("l1_ratio = 0.0", ["l1_ratio = 0", "above 0"]),
            ("prior_strength = -1.0", ["prior_strength = -1", "zero or more"]),
            ("bolasso = \"rows\"\nstability = true", ["both", "one of them"]),
            ("bolasso = \"rows\"\nl1_ratio = 0.5", ["l1_ratio below 1", "lassos"]),
            ("bolasso = \"rows\"\ngroups = \"signal\"", ["groups with a bolasso", "lassos"]),
            ("groups = \"leg\"", ["groups = leg", "signal, term"]),
            ("groups = \"signal\"\nl1_ratio = -0.1", ["l1_ratio = -0.1", "group lasso"]),
        ] {
            let message = options(text).expect_err(text);
            assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
        }
    }
}
