//! Options of a piecewise-affine fit: the settings of `[pwa]` and the partitions of `[model]`, checked once.

use fleetfoot_data::setting::{
    CONSTRAINTS, CONTINUOUS, FIT_PARAMETERS, FIT_SINDY, FIT_SPARSE, HORIZON, OBJECTIVE, PASSIVE, PWA, SELECT, STABLE,
};
use fleetfoot_model::UnseenLabel;
use fleetfoot_pwa::{Options, Outside, Selection, Shrinkage, Specification};
use fleetfoot_recipe::{Objective, OutsideRanges, PartitionChoice, PwaSection, Recipe, Tunable, UnseenLabels, seed};

use crate::{
    error::Error,
    folds::smoothed_rows,
    rollout_choice::{RolloutRule, USUAL_HORIZON, open_spans},
};

/// Options of a piecewise-affine fit.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PwaOptions {
    /// Options of the identification. Its purge gap, in rows, follows from [`PwaOptions::purge`] once the sampling
    /// period is known.
    pub identification: Options,
    /// Gap between held-out and training rows, seconds; `None`: a tenth of a held-out span.
    pub purge: Option<f64>,
    /// Rule by which rollouts compare partitions and open spans; `None` without rollouts.
    pub rollouts: Option<RolloutRule>,
    /// Objective of the coefficients.
    pub objective: Objective,
    /// True to count regions along a phase, which the columns give ([`fleetfoot_task::Task::phase`]).
    pub(crate) phase: bool,
    /// Seconds over which the logs were smoothed before, where they were.
    smoothed: Option<f64>,
    /// True if the recipe names no partitions, so that those with enough rows are tried.
    pub(super) tried: bool,
}

/// Most folds.
const FOLDS: u16 = 100;

/// Default partitions for many rows: one more pass than one region takes, and a held-out error for each of the four.
pub(crate) const TRIED: &str = "average,kmeans:2,5,10";

/// Regions that fit the dynamics, which are tried beside [`TRIED`] where there are no more rows than [`FEW`]: to refine so few takes no time.
const REFINED: &str = "refined:2..5";
/// Rows that are few.
const FEW: u64 = 2_000;
/// Rows for every number of a map, of the partitions that are tried without being named.
const ROWS_A_NUMBER: u64 = 2;

impl PwaOptions {
    /// The partitions to compare on so many rows, with maps of so many numbers a target: those of the recipe; where it names none those that rows bear, and of few rows
    /// refined ones too.
    pub(crate) fn partitions(&self, rows: u64, numbers: usize) -> Vec<Specification> {
        let partitions = &self.identification.partitions;
        if !self.tried {
            return partitions.clone();
        }
        let refined = if rows <= FEW { Specification::parse_list(REFINED).unwrap_or_default() } else { Vec::new() };
        let borne = |partition: &Specification| {
            partition.clusters().is_none_or(|regions| (regions * numbers) as u64 * ROWS_A_NUMBER <= rows)
        };
        partitions.iter().cloned().chain(refined).filter(borne).collect()
    }

    /// Reads `[pwa]`, the partitions of `[model]`, and whether the recipe leaves a span open.
    ///
    /// # Errors
    /// A number that is not allowed, with those that are; a partition that cannot be understood.
    pub fn new(recipe: &Recipe) -> Result<Self, Error> {
        if let Some(name) = recipe.constraints.keys().next() {
            return Err(Error::conflict(format!(
                "{entry}: {FIT_SINDY}, {FIT_SPARSE} and {FIT_PARAMETERS} keep constraints; remove {CONSTRAINTS}, or bound the maps of regions by {STABLE} and {PASSIVE}",
                entry = CONSTRAINTS.entry(name)
            )));
        }
        let section = &recipe.pwa;
        let mut options = Options::default();
        options.folds = checked("folds", section.folds.unwrap_or(options.folds), |&n| n <= FOLDS, "0 to 100")?;
        // Without held-out rows, more regions always fit the training rows better.
        let unsaid = if options.folds > 1 || section.select.is_some() { TRIED } else { "average" };
        options.partitions = Specification::parse_list(recipe.model.partition.as_deref().unwrap_or(unsaid))?;
        options.selection = match section.select {
            Some(PartitionChoice::Bic) => Selection::Bic,
            // By rollouts it is settled before it is asked for.
            None | Some(PartitionChoice::Cv | PartitionChoice::Rollout) => Selection::CrossValidation,
        };
        options.shrinkage = section.shrinkage.as_ref().map_or(Ok(options.shrinkage), shrinkage)?;
        let is_bound = |bound: &f64| *bound > 0.0 && bound.is_finite();
        let stable = section.stable.map(|bound| checked("stable", bound, is_bound, "a bound above 0, such as 1"));
        options.stability = stable.transpose()?;
        options.ports = section.passive.iter().flat_map(|ports| &ports.0).map(port).collect();
        options.unseen = match section.unseen_labels {
            None | Some(UnseenLabels::Refuse) => UnseenLabel::Refuse,
            Some(UnseenLabels::Pool) => UnseenLabel::Pool,
        };
        options.outside = match section.outside {
            None | Some(OutsideRanges::Average) => Outside::Average,
            Some(OutsideRanges::Hold) => Outside::Hold,
            Some(OutsideRanges::Extrapolate) => Outside::Extrapolate,
        };
        options.seed = seed("pwa", section.seed)?;
        let from_one = |what, number: Option<usize>, default| {
            checked(what, number.unwrap_or(default), |&number| number > 0, "a number from 1 on")
        };
        options.restarts = from_one("restarts", section.restarts, options.restarts)?;
        options.iterations = from_one("iterations", section.iterations, options.iterations)?;
        options.tsqr = section.tsqr.unwrap_or(options.tsqr);
        options.continuous = section.continuous.unwrap_or(options.continuous);
        let simulated = section.objective.filter(|objective| *objective != Objective::OneStep);
        if let (true, Some(objective)) = (options.continuous, simulated) {
            return Err(Error::conflict(format!(
                "{CONTINUOUS} with {given_objective}: simulations move the maps of regions apart; remove one of them",
                given_objective = OBJECTIVE.to(objective)
            )));
        }
        if let (true, Some(ports)) = (options.continuous, &section.passive) {
            return Err(Error::conflict(format!(
                "{CONTINUOUS} with {given_passive}: maps that are bounded region by region do not meet at borders; remove one of them",
                given_passive = PASSIVE.to(ports)
            )));
        }
        if let (true, Some(bound)) = (options.continuous, options.stability) {
            return Err(Error::conflict(format!(
                "{CONTINUOUS} with {given_stable}: maps that are bounded region by region do not meet at borders; remove one of them",
                given_stable = STABLE.to(bound)
            )));
        }
        if let Some(mebibytes) = section.memory {
            let is_size = |&size: &f64| size > 0.0 && size.is_finite();
            let mebibytes = checked("memory", mebibytes, is_size, "a number of MiB above 0")?;
            options.memory = (mebibytes * f64::from(1 << 20)) as usize;
        }
        let is_gap = |gap: &f64| *gap >= 0.0 && gap.is_finite();
        let purge = section.purge.map(|gap| checked("purge", gap, is_gap, "seconds, zero or more")).transpose()?;
        Ok(Self {
            identification: options,
            purge,
            rollouts: rollouts(section, recipe)?,
            objective: section.objective.unwrap_or_default(),
            phase: section.phase.is_some(),
            smoothed: recipe.time.smoothed,
            tried: recipe.model.partition.is_none() && unsaid == TRIED,
        })
    }

    /// The columns that partitions need beside the recipe's.
    pub(crate) fn labels(&self) -> Vec<String> {
        self.identification.partitions.iter().filter_map(|partition| partition.label().map(str::to_owned)).collect()
    }

    /// Options of the identification for rows that are `step` seconds apart; `step` is 0 without a clock.
    pub(crate) fn of_step(&self, step: f64) -> Options {
        let mut options = self.identification.clone();
        if let (Some(seconds), true) = (self.purge, step > 0.0) {
            options.purge = Some((seconds / step).ceil() as usize);
        }
        options.smoothed = smoothed_rows(self.smoothed, step);
        options
    }
}

/// Note about settings of states that maps of regions do not use.
pub(super) fn unused(recipe: &Recipe) -> Option<String> {
    let has =
        |state: &fleetfoot_recipe::State| state.nominal.is_some() || state.library.is_some() || !state.fixed.is_empty();
    let names: Vec<&str> =
        recipe.states.iter().filter(|(_, state)| has(state)).map(|(name, _)| name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "`nominal`, `library` and `fixed` of {} are not used here: they belong to {FIT_SINDY}",
            names.join(", ")
        )
    })
}

/// Rule by which rollouts compare partitions and open spans; `None` without rollouts.
fn rollouts(section: &PwaSection, recipe: &Recipe) -> Result<Option<RolloutRule>, Error> {
    let compared = section.select == Some(PartitionChoice::Rollout) || !open_spans(recipe).is_empty();
    match (section.horizon, compared) {
        (None, false) => Ok(None),
        (Some(steps), false) => Err(Error::conflict(format!(
            "{entry} ({given_horizon}): nothing is chosen by rollouts; add select = \"rollout\" ({given_select}), or remove it",
            given_horizon = HORIZON.to(steps),
            given_select = SELECT.to("rollout"),
            entry = PWA.entry("horizon").is(steps)
        ))),
        (steps, true) => {
            let steps =
                checked("horizon", steps.map_or(USUAL_HORIZON, |steps| steps as usize), |&n| n > 0, "steps from 1 on")?;
            Ok(Some(RolloutRule::new(steps)))
        }
    }
}

fn shrinkage(given: &Tunable) -> Result<Shrinkage, Error> {
    match given {
        Tunable::Word(word) if word == "auto" => Ok(Shrinkage::Auto),
        Tunable::Word(word) if word == "none" => Ok(Shrinkage::Rows(0.0)),
        Tunable::Number(rows) if *rows >= 0.0 && rows.is_finite() => Ok(Shrinkage::Rows(*rows)),
        other => Err(refused("shrinkage", other, "a number of rows, zero or more, none, or auto")),
    }
}

fn checked<T: std::fmt::Display>(
    what: &str,
    value: T,
    is_allowed: impl Fn(&T) -> bool,
    allowed: &str,
) -> Result<T, Error> {
    if is_allowed(&value) { Ok(value) } else { Err(refused(what, value, allowed)) }
}

fn refused(what: &str, value: impl std::fmt::Display, allowed: &str) -> Error {
    Error::value(format!("{entry}: write {allowed}", entry = PWA.entry(what).is(value)))
}

/// A port of the recipe as the estimator has it.
fn port(port: &fleetfoot_recipe::Port) -> fleetfoot_pwa::Port {
    fleetfoot_pwa::Port { input: port.input.clone(), output: port.output.clone(), shortage: port.shortage }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str) -> Result<PwaOptions, String> {
        let recipe = Recipe::parse(text, "test").map_err(|error| error.to_string())?;
        PwaOptions::new(&recipe).map_err(|error| error.to_string())
    }

    #[test]
    fn constraints_are_refused_and_unused_keys_reported() {
        let refused =
            options("[constraints]\ndamping = { coefficients = { v = [\"v\"] }, at_most = 0.0 }\n").unwrap_err();
        assert!(refused.contains("[constraints] damping") && refused.contains("--stable"), "{refused}");
        let recipe = Recipe::parse("[states]\nx = {}\nv = { nominal = \"3*u\" }\nw = { fixed = [\"u\"] }\n", "test");
        assert!(unused(&recipe.unwrap()).unwrap().contains("`fixed` of v, w are not used"));
        assert_eq!(unused(&Recipe::parse("[states]\nx = {}\n", "test").unwrap()), None);
    }

    #[test]
    fn words_are_read() {
        let default = options("").unwrap();
        let mut defaults = Options::default();
        assert_eq!(options("[pwa]\nfolds = 0\n").unwrap().identification.partitions, defaults.partitions);
        defaults.partitions = Specification::parse_list(TRIED).unwrap();
        // The library alone follows each map everywhere; a fit of a recipe does not.
        defaults.outside = Outside::Average;
        assert_eq!(
            options("[pwa]\nfolds = 0\nselect = \"bic\"\n").unwrap().identification.partitions,
            defaults.partitions
        );
        assert_eq!(format!("{:?}", default.identification), format!("{defaults:?}"), "what is not said is the default");
        assert_eq!((default.purge, default.rollouts), (None, None));
        let text = "[pwa]\nselect = \"bic\"\nfolds = 4\npurge = 0.25\nshrinkage = \"auto\"\nunseen_labels = \"pool\"\nseed = 3\nrestarts = 2\n\
                    iterations = 9\nmemory = 0.5\ntsqr = true\nstable = 0.99\n[model]\npartition = \"average,kmeans:4\"\n";
        let given = options(text).unwrap();
        let identification = &given.identification;
        assert_eq!(
            (identification.selection, identification.folds, identification.shrinkage),
            (Selection::Bic, 4, Shrinkage::Auto)
        );
        assert_eq!((identification.unseen, identification.seed, identification.restarts), (UnseenLabel::Pool, 3, 2));
        assert_eq!((identification.iterations, identification.memory, identification.tsqr), (9, 512 << 10, true));
        assert_eq!(identification.stability, Some(0.99));
        assert_eq!(identification.partitions, [Specification::Average, Specification::KMeans(4)]);
        assert_eq!((given.of_step(0.01).purge, given.of_step(0.0).purge), (Some(25), None));
        assert_eq!(options("[pwa]\nshrinkage = 10").unwrap().identification.shrinkage, Shrinkage::Rows(10.0));
    }

    #[test]
    fn rollouts_run_if_chosen_or_if_the_span_is_open() {
        let of = |text: &str| options(text).unwrap().rollouts.map(|rule| rule.horizon);
        assert_eq!(of("[pwa]\nselect = \"rollout\""), Some(USUAL_HORIZON));
        assert_eq!(of("[pwa]\nhorizon = 20\n[states]\nv = { derivative = { over = \"auto\" } }"), Some(20));
        assert_eq!(of("[states]\nv = { derivative = { over = 5 } }"), None);
    }

    #[test]
    fn refused_options_are_named_with_the_alternatives() {
        for (text, parts) in [
            ("[pwa]\nfolds = 101", ["folds = 101", "0..=100"]),
            ("[pwa]\nselect = \"best\"", ["select = \"best\"", "`rollout`"]),
            ("[pwa]\nunseen_labels = \"guess\"", ["unseen_labels = \"guess\"", "`pool`"]),
            ("[pwa]\npurge = -1.0", ["purge = -1", "zero or more"]),
            ("[pwa]\nshrinkage = \"much\"", ["shrinkage = much", "auto"]),
            ("[pwa]\nshrinkage = -2.0", ["shrinkage = -2", "zero or more"]),
            ("[pwa]\nrestarts = 0", ["restarts = 0", "from 1 on"]),
            ("[pwa]\niterations = 0", ["iterations = 0", "from 1 on"]),
            ("[pwa]\nmemory = 0.0", ["memory = 0", "above 0"]),
            ("[pwa]\nhorizon = 20", ["horizon = 20", "--select rollout"]),
            ("[pwa]\nhorizon = 0\nselect = \"rollout\"", ["horizon = 0", "from 1 on"]),
            ("[pwa]\nfold = 3", ["fold", "folds"]),
            ("[pwa]\nstable = 1.0\ncontinuous = true", ["stable=1", "do not meet"]),
            ("[pwa]\npassive = \"f:v\"\ncontinuous = true", ["passive f:v", "do not meet"]),
            ("[pwa]\nstable = 0.0", ["stable = 0", "above 0"]),
            ("[model]\npartition = \"kmeens:3\"", ["kmeens:3", "kmeans:10"]),
        ] {
            let message = options(text).expect_err(text);
            assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
        }
        let mut recipe = Recipe::default();
        recipe.pwa.seed = Some(u64::MAX);
        assert!(PwaOptions::new(&recipe).unwrap_err().to_string().contains("seed = 18446744073709551615"));
    }
}
