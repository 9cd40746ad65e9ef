//! Sums of equations in a statistic, from which `fit sindy` and `fit pwa` fit without the logs.
//!
//! Every partition of the recipe has separate sums, and so has the one region of all rows. So has `fit pwa` if it
//! measures a derivative otherwise than `fit sindy`, or over other functions. A pass over logs makes some choices
//! before it sums: the order of differences and the regions. They are frozen with the plan, so that the sums of other
//! logs can be added.

use fleetfoot_data::setting::{PARAMETERS, PARTITION};

use std::collections::BTreeSet;

use fleetfoot_data::{Canonical, Column, EpisodeId, Progress, Source};
use fleetfoot_library::{Binary, Expr, Node};
use fleetfoot_model::Partition;
use fleetfoot_pwa::Specification;
use fleetfoot_recipe::Recipe;
use fleetfoot_sums::system::{System, SystemPlan, SystemSums};
use fleetfoot_task::{EquationTask, SettledDifference, placeholder, specification};

use crate::error::Error;

/// The equations of a recipe, ready to be fitted in each of its partitions.
#[derive(Default, Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EquationStatistic {
    /// Difference formula of every fitted equation's derivative; `None` if it is no central difference.
    pub differences: Vec<Option<SettledDifference>>,
    /// The sums in one region, then those in the regions of every partition; then those that `fit pwa` needs beside them.
    pub groups: Vec<EquationGroup>,
}

/// The sums in the regions of one partition.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationGroup {
    /// Plan of the sums.
    pub plan: SystemPlan,
    /// The sums.
    pub sums: SystemSums,
}

impl EquationGroup {
    /// Of a plan without rows.
    pub fn empty(plan: SystemPlan) -> Self {
        Self { sums: plan.empty(), plan }
    }

    /// Its partition as users write it: `average`, `kmeans:5`.
    pub fn name(&self) -> &str {
        self.plan.system.partition.as_ref().map_or("average", |partition| &partition.specification)
    }
}

impl EquationStatistic {
    /// The recipe in one region.
    pub fn whole(recipe: &Recipe) -> Recipe {
        let mut whole = recipe.clone();
        whole.model.partition = None;
        whole
    }

    /// The recipe in one region, then in each of its partitions.
    pub fn recipes(recipe: &Recipe) -> Result<Vec<Recipe>, Error> {
        let mut all = vec![Self::whole(recipe)];
        for one in Specification::parse_list(recipe.model.partition.as_deref().unwrap_or("average"))
            .map_err(|error| Error::value(error.to_string()))?
        {
            if !matches!(one, Specification::Null | Specification::Average) {
                let mut first_recipe = all[0].clone();
                first_recipe.model.partition = Some(one.to_string());
                all.push(first_recipe);
            }
        }
        Ok(all)
    }

    /// The equations in one region, then in each partition of the recipe, which has its wildcards written out.
    ///
    /// # Errors
    /// A recipe that asks for absent fields, is no system of equations, or needs rows.
    pub fn tasks(recipe: &Recipe, fields: &[Column]) -> Result<Vec<EquationTask>, Error> {
        if let Some(name) = recipe.parameters.keys().next() {
            return Err(Error::needs_rows(format!(
                "{entry}: an estimate inside expressions needs the rows",
                entry = PARAMETERS.entry(name)
            )));
        }
        Self::recipes(recipe)?.iter().map(|recipe| EquationTask::resolve(recipe, fields).map_err(Error::from)).collect()
    }

    /// The sums that answer for a system, whatever the numbers of its partition, and where its functions stand in them: those with the fewest others, of equal
    /// ones the last, which were made although the earlier ones were there.
    pub fn covering(&self, system: &System) -> Option<(&EquationGroup, Vec<usize>)> {
        let covering = self.groups.iter().rev().filter_map(|group| Some((group, covers(&group.plan.system, system)?)));
        covering.min_by_key(|(group, _)| group.plan.system.functions.len())
    }

    /// The sums of some rows: a group each.
    pub fn sum_rows(&self, source: &dyn Source, progress: &dyn Progress) -> Result<Vec<SystemSums>, Error> {
        let plans: Vec<&SystemPlan> = self.groups.iter().map(|group| &group.plan).collect();
        Ok(SystemPlan::sum_all(&plans, source, progress)?)
    }

    /// Adds the sums of other rows.
    pub fn add(&mut self, sums: Vec<SystemSums>) -> Result<(), Error> {
        for (group, sums) in self.groups.iter_mut().zip(sums) {
            group.sums.merge(sums)?;
        }
        Ok(())
    }

    /// Adds the rows of another statistic of the same plan.
    pub fn merge(&mut self, other: Self) -> Result<(), Error> {
        self.add(other.groups.into_iter().map(|group| group.sums).collect())
    }

    /// The same plan with no rows.
    pub(crate) fn without_rows(&self) -> Self {
        let groups = self.groups.iter().map(|group| EquationGroup::empty(group.plan.clone())).collect();
        Self { differences: self.differences.clone(), groups }
    }

    /// Keeps the episodes that are wanted.
    pub fn retain(&mut self, wanted: impl Fn(EpisodeId) -> bool) {
        self.groups.iter_mut().for_each(|group| group.sums.retain(&wanted));
    }

    /// Joins the chunks of every episode.
    pub fn compact(&mut self) {
        self.groups.iter_mut().for_each(|group| group.sums.compact());
    }

    /// Hash of the plans.
    pub(crate) fn hash(&self) -> String {
        let mut canonical = Canonical::default();
        canonical.count(self.differences.len() as u64);
        for difference in &self.differences {
            canonical.tag(difference.is_some().into());
            difference.iter().for_each(|settled| settled.encode(&mut canonical));
        }
        canonical.count(self.groups.len() as u64);
        self.groups.iter().for_each(|group| canonical.text(&group.plan.hash()));
        blake3::hash(canonical.as_bytes()).to_hex()[..32].to_owned()
    }

    /// The plans for people: one line a fact, those that groups share once.
    pub fn text(&self) -> String {
        once(self.groups.iter().map(|group| group.plan.text()))
    }

    /// The sums in the regions that a recipe asks for, which looks at `on`.
    ///
    /// # Errors
    /// Regions that were not summed.
    pub fn of(&self, recipe: &Recipe, on: &[Expr]) -> Result<&EquationGroup, Error> {
        let wanted = placeholder(specification(recipe)?.as_ref(), on);
        // Those of the equations come first.
        let partition =
            self.groups.iter().find(|group| looks(group.plan.system.partition.as_ref()) == looks(wanted.as_ref()));
        partition.ok_or_else(|| {
            let of = |group: &EquationGroup| in_words(group.plan.system.partition.as_ref());
            let known: BTreeSet<String> = self.groups.iter().map(of).collect();
            Error::other_statistic(format!(
                "{PARTITION} {}: the statistic has the regions of {}; name one of these, scan again with this {PARTITION} and what it looks at, or give the logs",
                in_words(wanted.as_ref()),
                known.into_iter().collect::<Vec<_>>().join(", ")
            ))
        })
    }

    /// Checks that all sums belong to the plans and to these episodes.
    pub(crate) fn check(&self, known: impl Fn(EpisodeId) -> bool) -> Result<(), &'static str> {
        let fits = |group: &EquationGroup| {
            group.sums.are_of(&group.plan) && group.sums.episodes.keys().all(|&episode| known(episode))
        };
        if self.groups.is_empty() || !self.groups.iter().all(fits) {
            return Err("the sums of the equations are not those of their plan");
        }
        // Those of `fit sindy` come first.
        let targets = self.groups[0].plan.system.targets.len();
        if targets == self.differences.len() {
            Ok(())
        } else {
            Err("the equations have other differences than left sides")
        }
    }
}

/// Features that distinguish partitions before they have numbers: the specification and the columns.
fn looks(partition: Option<&Partition>) -> Option<(&str, &[Expr])> {
    partition.map(|partition| (partition.specification.as_str(), partition.columns.as_slice()))
}

/// A partition for people: `average`, `kmeans:5 over x, v`.
fn in_words(partition: Option<&Partition>) -> String {
    let Some(partition) = partition else { return "average".to_owned() };
    let columns: Vec<String> = partition.columns.iter().map(Expr::to_string).collect();
    format!("{} over {}", partition.specification, columns.join(", "))
}

/// For each function of the wanted system, its index in the held one, whose sums can replace a scan. The numbers of the
/// partition do not matter. `None` if the held sums do not cover the wanted system.
///
/// The other functions of the held system are products of the wanted ones, so that the same rows are complete.
pub fn covers(held: &System, wanted: &System) -> Option<Vec<usize>> {
    let same = (&held.targets, &held.weight, &held.also, &held.weak)
        == (&wanted.targets, &wanted.weight, &wanted.also, &wanted.weak);
    if !same || looks(held.partition.as_ref()) != looks(wanted.partition.as_ref()) {
        return None;
    }
    if !held.functions.iter().all(|function| is_product(function, &wanted.functions)) {
        return None;
    }
    wanted.functions.iter().map(|function| held.functions.iter().position(|known| known == function)).collect()
}

/// Returns true if an expression is one of the factors, or a product of powers of them.
fn is_product(expression: &Expr, factors: &[Expr]) -> bool {
    factors.contains(expression)
        || match expression.node() {
            Node::Binary(Binary::Mul, a, b) => is_product(a, factors) && is_product(b, factors),
            Node::Power(base, exponent) => *exponent > 0 && is_product(base, factors),
            _ => false,
        }
}

/// Lines in their order, each where it comes first.
pub fn once(texts: impl Iterator<Item = String>) -> String {
    let mut seen = BTreeSet::new();
    let mut text = String::new();
    for one in texts {
        for line in one.lines().filter(|line| seen.insert((*line).to_owned())) {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}
