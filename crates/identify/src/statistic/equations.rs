//! The sums of equations in a statistic: what `fit sindy` and `fit pwa` fit without the logs.
//!
//! Every partition that the recipe names has sums of its own, and so has the one region of all rows; where `fit pwa` measures a derivative otherwise than
//! `fit sindy`, or over other functions, it has sums of its own too. What a pass over logs settles before it sums (the order
//! of differences, the regions) is frozen with the plan, so that the sums of other logs go with them.

use std::collections::BTreeSet;

use fleetfoot_data::{Column, EpisodeId, Progress, Source};
use fleetfoot_library::{Binary, Expr, Node};
use fleetfoot_model::{Partition, Role};
use fleetfoot_pwa::{Options, Problem, Specification};
use fleetfoot_sparse::system::{System, SystemPlan, SystemSums};

use super::{StatisticError, scan::refuse_text};
use crate::{
    Dataset, Error, PwaOptions, Recipe, Task,
    narx::Summed,
    sindy::{EquationTask, Frozen, SettledDifference, WeakForm, clustering, regions, specification},
};

/// The equations of a recipe, ready to be fitted in each of its partitions.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EquationStatistic {
    /// How the derivative of every fitted equation was settled; `None` where it is no central difference.
    pub differences: Vec<Option<SettledDifference>>,
    /// The sums in one region, then those in the regions of every partition; then those that `fit pwa` needs beside them.
    pub groups: Vec<EquationGroup>,
}

/// The sums in the regions of one partition.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationGroup {
    /// What was summed.
    pub plan: SystemPlan,
    /// The sums.
    pub sums: SystemSums,
}

impl EquationGroup {
    /// Of a plan without rows.
    pub(super) fn empty(plan: SystemPlan) -> Self {
        Self { sums: plan.empty(), plan }
    }

    /// Its partition as users write it: `average`, `kmeans:5`.
    pub fn name(&self) -> &str {
        self.plan.system.partition.as_ref().map_or("average", |partition| &partition.specification)
    }
}

impl EquationStatistic {
    /// The recipe in one region.
    pub(crate) fn whole(recipe: &Recipe) -> Recipe {
        let mut whole = recipe.clone();
        whole.model.partition = None;
        whole
    }

    /// The recipe in one region, then in each of its partitions.
    fn recipes(recipe: &Recipe) -> Result<Vec<Recipe>, Error> {
        let mut all = vec![Self::whole(recipe)];
        for one in Specification::parse_list(recipe.model.partition.as_deref().unwrap_or("average"))? {
            if !matches!(one, Specification::Null | Specification::Average) {
                let mut own = all[0].clone();
                own.model.partition = Some(one.to_string());
                all.push(own);
            }
        }
        Ok(all)
    }

    /// The equations in one region, then in each partition of the recipe, which has its wildcards written out.
    ///
    /// # Errors
    /// What the recipe asks for is not there, is no system of equations, or needs rows.
    pub(crate) fn tasks(recipe: &Recipe, fields: &[Column]) -> Result<Vec<EquationTask>, Error> {
        if let Some(name) = recipe.parameters.keys().next() {
            return Err(Error::needs_rows(format!(
                "[parameters] {name}: an estimate inside expressions needs the rows"
            )));
        }
        Self::recipes(recipe)?.iter().map(|recipe| EquationTask::resolve(recipe, fields)).collect()
    }

    /// Freezes what is decided before the pass, from a sample of the rows and by clustering, and sums nothing yet.
    ///
    /// # Errors
    /// Those of reading and of clustering; texts in the columns.
    pub(super) fn freeze(
        (recipe, fields): (&Recipe, &[Column]),
        tasks: &[EquationTask],
        (dataset, chunk_rows): (&Dataset, Option<usize>),
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let view = dataset.view()?;
        let mut found = Self { differences: Vec::new(), groups: Vec::new() };
        for (recipe, task) in Self::recipes(recipe)?.iter().zip(tasks) {
            let read: Vec<Expr> = task.row_functions();
            let labels = specification(recipe)?.and_then(|one| one.label().map(Expr::column));
            refuse_text(read.iter().chain(&labels), &task.aliases, dataset.fields())?;
            let mut own: Vec<String> = task.narrowed_note().into_iter().collect();
            let frozen = Frozen::differentiated(task.clone(), &view, &mut own)?;
            let frozen = frozen.windowed(WeakForm::new(&recipe.sindy)?, &view, &mut own)?;
            let seed = recipe.sindy.seed.unwrap_or(0);
            let partition = frozen.partition(recipe, seed, dataset.step(), &view, &mut own, progress)?;
            let plan = SystemPlan::new(frozen.task.summed(partition), chunk_rows, &view)?;
            found.differences = frozen.task.settled_differences();
            found.groups.push(EquationGroup::empty(plan));
            own.retain(|note| !notes.contains(note));
            notes.append(&mut own);
        }
        for recipe in Self::recipes(recipe)? {
            // What `fit pwa` cannot read it will say itself.
            let Ok((problem, mut system)) = piecewise(&recipe, fields, dataset.step()) else { continue };
            let one = specification(&recipe)?;
            let Ok(PwaOptions { identification: own, .. }) = PwaOptions::new(&recipe) else { continue };
            let alike = one.is_none() || finds_alike(&own, &clustering(recipe.sindy.seed.unwrap_or(0)));
            if alike && found.covering(&system).is_some() {
                continue;
            }
            if let Some(one) = one {
                system.partition = Some(regions(&problem, one, own, &view, &mut Vec::new(), progress)?);
            }
            found.groups.push(EquationGroup::empty(SystemPlan::new(system, chunk_rows, &view)?));
        }
        for recipe in Self::recipes(recipe)? {
            let summed = match Summed::of(&recipe, fields) {
                Ok(Some(summed)) => summed,
                Ok(None) => break,
                Err(error) => {
                    notes.push(format!("`fit narx` will need the logs, the statistic has no sums for it: {error}"));
                    break;
                }
            };
            let mut system = summed.system();
            if let Some(one) = specification(&recipe)? {
                let problem = summed.problem(dataset.step());
                let how = clustering(summed.options.seed);
                system.partition = Some(regions(&problem, one, how, &view, &mut Vec::new(), progress)?);
            }
            found.groups.push(EquationGroup::empty(SystemPlan::new(system, chunk_rows, &view)?));
        }
        Ok(found)
    }

    /// Passes at most, and bytes about, of the sums of a recipe's equations over so many rows; zeros where there are none.
    pub(super) fn cost(recipe: &Recipe, fields: &[Column], rows: usize) -> (usize, usize) {
        let (Ok(recipes), Ok(tasks)) = (Self::recipes(recipe), Self::tasks(recipe, fields)) else { return (0, 0) };
        let bytes = |(recipe, task): (&Recipe, &EquationTask)| {
            let one = specification(recipe).ok().flatten();
            let regions = one.map_or(1, |one| one.clusters().unwrap_or(2));
            SystemPlan::memory(&task.system(), regions, rows)
        };
        let narx = |recipe: &Recipe| {
            let regions = specification(recipe).ok().flatten().map_or(1, |one| one.clusters().unwrap_or(2));
            let summed = Summed::of(recipe, fields).ok().flatten();
            summed.map(|summed| SystemPlan::memory(&summed.system(), regions, rows))
        };
        let of_narx: Vec<usize> = recipes.iter().filter_map(narx).collect();
        // Sums for `fit sindy`, beside them for `fit pwa`, and for `fit narx`; all cluster each partition.
        let methods = if of_narx.is_empty() { 2 } else { 3 };
        let passes = methods * recipes.len() + methods * (recipes.len() - 1);
        (passes, recipes.iter().zip(&tasks).map(bytes).chain(of_narx).sum())
    }

    /// The sums that answer for a system, whatever the numbers of its partition, and where its functions stand in them: those with the fewest others, of equal
    /// ones the last, which were made although the earlier ones were there.
    pub(crate) fn covering(&self, system: &System) -> Option<(&EquationGroup, Vec<usize>)> {
        let covering = self.groups.iter().rev().filter_map(|group| Some((group, covers(&group.plan.system, system)?)));
        covering.min_by_key(|(group, _)| group.plan.system.functions.len())
    }

    /// The sums of some rows: a group each.
    pub(super) fn sum_rows(&self, source: &dyn Source, progress: &dyn Progress) -> Result<Vec<SystemSums>, Error> {
        let plans: Vec<&SystemPlan> = self.groups.iter().map(|group| &group.plan).collect();
        Ok(SystemPlan::sum_all(&plans, source, progress)?)
    }

    /// Adds the sums of other rows.
    pub(super) fn add(&mut self, sums: Vec<SystemSums>) -> Result<(), Error> {
        for (group, sums) in self.groups.iter_mut().zip(sums) {
            group.sums.merge(sums)?;
        }
        Ok(())
    }

    /// Adds the rows of another statistic of the same plan.
    pub(super) fn merge(&mut self, other: Self) -> Result<(), Error> {
        self.add(other.groups.into_iter().map(|group| group.sums).collect())
    }

    /// The same plan with no rows.
    pub(super) fn without_rows(&self) -> Self {
        let groups = self.groups.iter().map(|group| EquationGroup::empty(group.plan.clone())).collect();
        Self { differences: self.differences.clone(), groups }
    }

    /// Keeps the episodes that are wanted.
    pub(super) fn retain(&mut self, wanted: impl Fn(EpisodeId) -> bool) {
        self.groups.iter_mut().for_each(|group| group.sums.retain(&wanted));
    }

    /// Joins the chunks of every episode.
    pub(super) fn compact(&mut self) {
        self.groups.iter_mut().for_each(|group| group.sums.compact());
    }

    /// Hash of the plans.
    pub(super) fn hash(&self) -> String {
        let mut text = format!("{:?}\n", self.differences);
        self.groups.iter().for_each(|group| text.push_str(&format!("{}\n", group.plan.hash())));
        blake3::hash(text.as_bytes()).to_hex()[..32].to_owned()
    }

    /// The plans for people: one line a fact, those that groups share once.
    pub(super) fn text(&self) -> String {
        once(self.groups.iter().map(|group| group.plan.text()))
    }

    /// What [`EquationStatistic::text`] would say of another recipe with the differences and chunks of this one; `scanned` is the recipe of this one, with its
    /// fields.
    ///
    /// # Errors
    /// Those of [`EquationStatistic::tasks`].
    pub(super) fn text_of(
        &self,
        (recipe, fields): (&Recipe, &[Column]),
        (scanned, scanned_fields): (&Recipe, &[Column]),
    ) -> Result<String, Error> {
        let raw = EquationTask::resolve(&Self::whole(scanned), scanned_fields)?;
        let mut systems: Vec<System> = Vec::new();
        let recipes = Self::recipes(recipe)?;
        for (recipe, task) in recipes.iter().zip(Self::tasks(recipe, fields)?) {
            let mut task = task.differentiated_like(&raw, &self.differences);
            task.windows = WeakForm::new(&recipe.sindy)?.like(self.groups.first());
            systems.push(task.summed(placeholder(specification(recipe)?.as_ref(), &task.partition_columns)));
        }
        for recipe in &recipes {
            let Ok((_, system)) = piecewise(recipe, fields, 0.0) else { continue };
            if !systems.iter().any(|held| covers(held, &system).is_some()) {
                systems.push(system);
            }
        }
        for recipe in &recipes {
            let Ok(Some(summed)) = Summed::of(recipe, fields) else { break };
            let partition = placeholder(specification(recipe)?.as_ref(), summed.partition_columns());
            systems.push(System { partition, ..summed.system() });
        }
        // What has no counterpart has no chunks to compare either.
        let chunk_rows = |at: usize| self.groups.get(at).map_or(0, |group| group.plan.chunk_rows);
        Ok(once(systems.iter().enumerate().map(|(at, system)| SystemPlan::text_of(system, chunk_rows(at)))))
    }

    /// The sums in the regions that a recipe asks for, which looks at `on`.
    ///
    /// # Errors
    /// Regions that were not summed.
    pub(crate) fn of(&self, recipe: &Recipe, on: &[Expr]) -> Result<&EquationGroup, Error> {
        let wanted = placeholder(specification(recipe)?.as_ref(), on);
        // Those of the equations come first.
        let found =
            self.groups.iter().find(|group| looks(group.plan.system.partition.as_ref()) == looks(wanted.as_ref()));
        found.ok_or_else(|| {
            let of = |group: &EquationGroup| in_words(group.plan.system.partition.as_ref());
            let known: BTreeSet<String> = self.groups.iter().map(of).collect();
            Error::other_statistic(format!(
                "--partition {}: the statistic has the regions of {}; name one of these, scan again with this --partition and what it looks at, or give the logs",
                in_words(wanted.as_ref()),
                known.into_iter().collect::<Vec<_>>().join(", ")
            ))
        })
    }

    /// Whether all sums are of the plans, and of these episodes.
    pub(super) fn check(&self, known: impl Fn(EpisodeId) -> bool) -> Result<(), &'static str> {
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

/// A partition before it has numbers: its name, and what it looks at. `None` is the one region of all rows.
pub(crate) fn placeholder(one: Option<&Specification>, on: &[Expr]) -> Option<Partition> {
    let one = one.filter(|one| !matches!(one, Specification::Null | Specification::Average))?;
    Some(Partition {
        specification: one.to_string(),
        columns: on.iter().cloned().chain(one.label().map(Expr::column)).collect(),
        ..Partition::whole()
    })
}

/// What tells partitions apart before they have numbers.
fn looks(partition: Option<&Partition>) -> Option<(&str, &[Expr])> {
    partition.map(|partition| (partition.specification.as_str(), partition.columns.as_slice()))
}

/// A partition for people: `average`, `kmeans:5 over x, v`.
fn in_words(partition: Option<&Partition>) -> String {
    let Some(partition) = partition else { return "average".to_owned() };
    let columns: Vec<String> = partition.columns.iter().map(Expr::to_string).collect();
    format!("{} over {}", partition.specification, columns.join(", "))
}

/// What `fit pwa` is to identify in the one partition of a recipe, and the system that answers for it.
///
/// # Errors
/// What the recipe asks for is not there.
pub(crate) fn piecewise(recipe: &Recipe, fields: &[Column], step: f64) -> Result<(Problem, System), Error> {
    let labels: Vec<String> = specification(recipe)?.iter().filter_map(|one| one.label().map(str::to_owned)).collect();
    let problem = Task::resolve(recipe, fields, &labels, step)?.problem;
    let targets: Vec<Expr> = problem.equations.iter().filter_map(|equation| equation.target.clone()).collect();
    let states = problem.columns.iter().filter(|column| column.role == Role::State);
    let states = states.map(|column| Expr::column(column.name.as_str()));
    let system = System {
        also: targets.iter().cloned().chain(states).collect(),
        weight: problem.weight.clone(),
        partition: placeholder(specification(recipe)?.as_ref(), &problem.partition_columns),
        ..System::new(problem.library.clone(), targets)
    };
    Ok((problem, system))
}

/// Whether two ways to find regions of the same rows find the same.
fn finds_alike(one: &Options, other: &Options) -> bool {
    (one.seed, one.restarts, one.iterations, one.memory) == (other.seed, other.restarts, other.iterations, other.memory)
}

/// Where the functions of a system stand in another whose sums answer for it, whatever the numbers of its partition; `None` where they do not.
///
/// What the other has beside them are products of them, so that the same rows are complete.
fn covers(held: &System, wanted: &System) -> Option<Vec<usize>> {
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

/// Whether an expression is one of some factors, or a product of powers of them.
fn is_product(expression: &Expr, factors: &[Expr]) -> bool {
    factors.contains(expression)
        || match expression.node() {
            Node::Binary(Binary::Mul, a, b) => is_product(a, factors) && is_product(b, factors),
            Node::Power(base, exponent) => *exponent > 0 && is_product(base, factors),
            _ => false,
        }
}

/// Lines in their order, each where it comes first.
fn once(texts: impl Iterator<Item = String>) -> String {
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

/// Why the equations of a recipe are not summed, for people.
pub(super) fn unserved(error: &Error) -> String {
    format!("`fit sindy` will need the logs, the statistic has no sums for it: {error}")
}

/// Expressions that cannot be kept in a file.
pub(super) fn refuse_unprintable(statistic: &EquationStatistic) -> Result<(), StatisticError> {
    statistic.record().map(|_| ())
}
