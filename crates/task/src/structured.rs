//! A recipe resolved to a structured sparse regression: latents, tasks that share them, and the model's equations.

mod latent;
mod limits;
mod right_side;

use fleetfoot_data::setting::{CONSTRAINTS, INPUTS_SECTION, LATENTS, STATES_SECTION, TASKS};
use fleetfoot_data::{Column as DataColumn, nearest};
use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, Prediction, Role};
use fleetfoot_recipe::{Aliases, Error, Recipe};
use fleetfoot_sparse::{
    Sign,
    constrained::{Form, RowLimit},
};
use fleetfoot_sums::structured::{Candidates, Regression, Task as RegressionTask, Term};
use latent::{Latent, prior};
pub(crate) use limits::together;
use right_side::linear;

use crate::{
    coefficients::{CoefficientLimit, Owner, coefficient_limits, consistent},
    task::{equations, library, state_equation},
};

/// A recipe resolved for a recording: the regression of `fit sparse`, and the model that will follow from it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct StructuredTask {
    /// Latents and tasks over the aliases; the priors stand behind the measured tasks.
    pub regression: Regression,
    /// Columns whose moments the model needs: the targets of its fitted equations, the states, then the functions of
    /// the latents by [`StructuredTask::moments`].
    pub also: Vec<Expr>,
    /// The model's equations, over its columns and the names of the latents.
    pub equations: Vec<Equation>,
    /// The model's columns.
    pub columns: Vec<Column>,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub aliases: Vec<(DataColumn, Expr)>,
    /// The error of every task that counts as one, if the recipe has it (tasks).
    pub scales: Vec<Option<f64>>,
    /// Weight of every task beside its scale: 1, of a prior lambda_t if the recipe has it (tasks).
    pub strengths: Vec<Option<f64>>,
    /// Penalty factor of every coefficient (p).
    pub penalties: Vec<f64>,
    /// Sign of every coefficient (p).
    pub signs: Vec<Sign>,
    /// Limits at every row of the training data: bounds of latents, then constraints between latents.
    pub limits: Vec<RowLimit>,
    /// Bounds of coefficients; the owners are the latents.
    pub coefficients: Vec<CoefficientLimit>,
    /// Source of the moments of every latent's functions (latents).
    pub moments: Vec<Moments>,
}

/// Source of the moments of a latent's candidate functions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moments {
    /// In a task's statistic, whose columns from `first` on are the functions times `factor`.
    Task {
        /// The task.
        task: usize,
        /// The first column.
        first: usize,
        /// Factor of the functions.
        factor: f64,
    },
    /// In the statistic of [`StructuredTask::also`], from this column on.
    Also(usize),
}

/// Parts of a task while a recipe is read.
struct Parts {
    latents: Vec<Latent>,
    /// Constraints between latents.
    limits: Vec<RowLimit>,
    coefficients: Vec<CoefficientLimit>,
    tasks: Vec<RegressionTask>,
    scales: Vec<Option<f64>>,
    equations: Vec<Equation>,
}

impl StructuredTask {
    /// Resolves a recipe against the fields of a recording.
    ///
    /// Without `[latents]` and `[tasks]` every fitted equation of the recipe is a task with a separate latent, over the
    /// polynomial library. Bounds of coefficients are then those of `fit sindy` alone.
    ///
    /// # Errors
    /// A recipe that names something that does not exist, is not linear in the latents, or contradicts itself.
    pub fn resolve(recipe: &Recipe, fields: &[DataColumn]) -> Result<Self, Error> {
        let mut aliases = Aliases::of_recipe(recipe, fields)?;
        let parts = match (recipe.latents.is_empty(), recipe.tasks.is_empty()) {
            (true, true) => {
                let together = recipe.constraints.iter().find(|(_, section)| section.coefficients.is_empty());
                if let Some((name, _)) = together {
                    return Err(Error::missing(format!(
                        "{entry}: it applies to latents, and the recipe has none; write the unknown functions in {LATENTS} and {TASKS}",
                        entry = CONSTRAINTS.entry(name)
                    )));
                }
                plain(recipe, &mut aliases)?
            }
            (false, true) => {
                return Err(Error::missing(format!(
                    "{LATENTS} without {TASKS}: write the equations in which the latents stand, for example `{TASKS}` with \
                     `along = {{ target = \"m*V_dot\", right = \"T - D\" }}`"
                )));
            }
            (true, false) => {
                return Err(Error::missing(format!(
                    "{TASKS} without {LATENTS}: write what the unknown functions on their right sides may be made of, for example \
                     `{LATENTS}` with `T = {{ of = [\"rho\", \"M\"], degree = 2 }}`"
                )));
            }
            (false, false) => shared(recipe, &mut aliases)?,
        };
        let latents: Vec<String> = recipe.latents.keys().cloned().collect();
        let weight = recipe.model.weight.as_deref();
        let weight = weight.map(|text| aliases.over_latents(text, &latents, "weight")).transpose()?;
        if let Some(weight) = &weight {
            right_side::without_latents(weight, &latents, "weight")?;
        }
        Ok(parts.finish(aliases, weight))
    }

    /// The targets of the model's fitted equations: the first columns of [`StructuredTask::also`].
    pub fn targets(&self) -> usize {
        self.equations.iter().filter(|equation| equation.target.is_some()).count()
    }

    /// All expressions that rows are evaluated for.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let regression = &self.regression;
        let functions = regression.latents.iter().flat_map(|latent| &latent.functions);
        let factors = regression.tasks.iter().flat_map(|task| task.terms.iter().map(|term| &term.coefficient));
        let targets = regression.tasks.iter().map(|task| &task.target);
        let limited = self.limits.iter().flat_map(|limit| &limit.forms);
        let limited = limited.flat_map(|form| form.terms.iter().map(|term| &term.coefficient).chain([&form.rest]));
        functions.chain(factors).chain(targets).chain(&regression.weight).chain(&self.also).chain(limited)
    }

    /// The model's states: the columns of [`StructuredTask::also`] behind the targets.
    pub fn states(&self) -> usize {
        self.columns.iter().filter(|column| column.role == Role::State).count()
    }
}

impl Parts {
    fn finish(self, aliases: Aliases<'_>, weight: Option<Expr>) -> StructuredTask {
        let mut tasks = self.tasks;
        let mut scales = self.scales;
        let mut strengths = vec![Some(1.0); tasks.len()];
        for (index, latent) in self.latents.iter().enumerate() {
            if let Some(prior) = &latent.prior {
                tasks.push(RegressionTask {
                    name: format!("prior of {}", latent.name),
                    target: prior.target.clone(),
                    terms: vec![Term { latent: index, coefficient: Expr::number(1.0) }],
                    prior: true,
                });
                scales.push(prior.scale);
                strengths.push(prior.strength);
            }
        }
        let mut penalties = Vec::new();
        for (index, latent) in self.latents.iter().enumerate() {
            // A constant that stands alone in an equation is its intercept: it is not penalised.
            let intercept = tasks
                .iter()
                .filter(|task| !task.prior)
                .flat_map(|task| &task.terms)
                .any(|term| term.latent == index && term.coefficient.as_number() == Some(1.0));
            penalties.extend(
                latent
                    .functions
                    .iter()
                    .map(|function| if intercept && function.as_number().is_some() { 0.0 } else { latent.penalty }),
            );
        }
        let signs = self.latents.iter().flat_map(|latent| vec![latent.sign; latent.functions.len()]).collect();
        let indexed = self.latents.iter().enumerate();
        let limits = indexed.flat_map(|(index, latent)| limits::of_latent(&latent.name, index, latent.bounds));
        let limits = limits.chain(self.limits).collect();
        let latents: Vec<Candidates> = self
            .latents
            .into_iter()
            .map(|latent| Candidates { name: latent.name, functions: latent.functions })
            .collect();
        let targets = self.equations.iter().filter_map(|equation| equation.target.clone());
        let states = aliases.columns.iter().filter(|column| column.role == Role::State);
        let mut also: Vec<Expr> = targets.chain(states.map(|column| Expr::column(column.name.as_str()))).collect();
        let regression = Regression { latents, tasks, weight };
        let moments = (0..regression.latents.len()).map(|latent| moments(&regression, latent, &mut also)).collect();
        StructuredTask {
            regression,
            also,
            equations: self.equations,
            columns: aliases.columns,
            aliases: aliases.expressions,
            scales,
            strengths,
            penalties,
            signs,
            limits,
            coefficients: self.coefficients,
            moments,
        }
    }
}

/// Source of the moments of a latent's functions; adds the functions to `also` if no task has them.
fn moments(regression: &Regression, latent: usize, also: &mut Vec<Expr>) -> Moments {
    for (task, regression_task) in regression.tasks.iter().enumerate() {
        let mut first = 0;
        for term in &regression_task.terms {
            match term.coefficient.as_number() {
                Some(factor) if term.latent == latent && factor != 0.0 => return Moments::Task { task, first, factor },
                _ => first += regression.latents[term.latent].functions.len(),
            }
        }
    }
    also.extend(regression.latents[latent].functions.iter().cloned());
    Moments::Also(also.len() - regression.latents[latent].functions.len())
}

/// Every fitted equation is a task with a separate latent and a free constant.
fn plain(recipe: &Recipe, aliases: &mut Aliases<'_>) -> Result<Parts, Error> {
    if let Some((name, _)) = recipe.states.iter().find(|(_, state)| state.equation.is_some()) {
        return Err(Error::conflict(format!(
            "{entry} equation: it needs {LATENTS} and {TASKS}; without them remove `equation`, and the state is a sum of functions",
            entry = STATES_SECTION.entry(name)
        )));
    }
    let equations = equations(recipe, aliases)?;
    let mut functions = vec![Expr::number(1.0)];
    functions.extend(library(recipe, aliases, &equations)?);
    let (mut latents, mut tasks) = (Vec::new(), Vec::new());
    for equation in equations.iter() {
        let Some(target) = &equation.target else { continue };
        let name = equation.right.as_column().map_or_else(|| equation.right.to_string(), str::to_owned);
        tasks.push(RegressionTask {
            name: equation.label(),
            target: target.clone(),
            terms: vec![Term { latent: latents.len(), coefficient: Expr::number(1.0) }],
            prior: false,
        });
        latents.push(Latent::plain(name, functions.clone()));
    }
    let scales = vec![None; tasks.len()];
    Ok(Parts { latents, limits: Vec::new(), coefficients: Vec::new(), tasks, scales, equations })
}

/// The latents, tasks and equations that the recipe writes out.
fn shared(recipe: &Recipe, aliases: &mut Aliases<'_>) -> Result<Parts, Error> {
    let names: Vec<String> = recipe.latents.keys().cloned().collect();
    for name in &names {
        if aliases.texts.contains_key(name) || aliases.columns.iter().any(|column| column.name == *name) {
            return Err(Error::name_taken(
                name,
                format!(
                    "{entry}: a column has this name too; rename the latent or the column, so that equations can tell them apart",
                    entry = LATENTS.entry(name)
                ),
            ));
        }
    }
    let mut latents = Vec::new();
    for (name, section) in &recipe.latents {
        latents.push(Latent::resolve(name, section, &names, aliases)?);
    }
    let (mut tasks, mut scales) = (Vec::new(), Vec::new());
    let mut sides = Vec::new();
    for (name, section) in &recipe.tasks {
        let place = TASKS.entry(name).to_string();
        let target = aliases.over_latents(&section.target, &names, &format!("{place} target"))?;
        right_side::without_latents(&target, &names, &format!("{place} target"))?;
        let right = aliases.over_latents(&section.right, &names, &format!("{place} right"))?;
        let Form { terms, rest } = linear(&right, &names, &format!("{place} right"), &section.right, "latent")?;
        if terms.is_empty() {
            return Err(no_latent(&place, &right, &names));
        }
        let moved = if rest.as_number() == Some(0.0) { target.clone() } else { (&target - &rest).simplified() };
        scales.push(scale(section.scale, &moved, &place)?);
        tasks.push(RegressionTask { name: name.clone(), target: moved, terms, prior: false });
        sides.push((name.clone(), section.target.clone(), target, right));
    }
    for (index, name) in names.iter().enumerate() {
        if !tasks.iter().any(|task| task.terms.iter().any(|term| term.latent == index)) {
            return Err(Error::conflict(format!(
                "{entry}: no task has it on its right side; add it to one in {TASKS}, or remove it",
                entry = LATENTS.entry(name)
            )));
        }
    }
    let equations = if recipe.states.values().any(|state| state.equation.is_some()) {
        state_equations(recipe, aliases, &names)?
    } else {
        task_equations(recipe, aliases, &sides)?
    };
    for (latent, section) in latents.iter_mut().zip(recipe.latents.values()) {
        latent.prior = prior(recipe, section, &latent.name, &names, aliases)?;
    }
    let limits = limits::together(recipe, &names, "latent", aliases)?;
    let coefficients = coefficients(recipe, &latents, &names, aliases)?;
    Ok(Parts { latents, limits, coefficients, tasks, scales, equations })
}

/// Bounds of the coefficients of latents.
fn coefficients(
    recipe: &Recipe,
    latents: &[Latent],
    names: &[String],
    aliases: &mut Aliases<'_>,
) -> Result<Vec<CoefficientLimit>, Error> {
    let owner = |latent: &Latent| Owner {
        names: vec![latent.name.clone()],
        functions: latent.functions.iter().cloned().map(Some).collect(),
    };
    let owners: Vec<Owner> = latents.iter().map(owner).collect();
    let mut limits = Vec::new();
    for (name, section) in &recipe.constraints {
        limits.extend(coefficient_limits(name, section, &owners, names, aliases)?);
    }
    consistent(limits)
}

fn no_latent(place: &str, right: &Expr, names: &[String]) -> Error {
    let near = right.columns().iter().flat_map(|column| nearest(column, names.iter().map(String::as_str))).next();
    Error::value(format!(
        "{place} right: `{right}` has no latent{}; the latents are {}",
        near.map_or_else(String::new, |name| format!(" (did you mean `{name}`?)")),
        names.join(", ")
    ))
}

fn scale(scale: Option<f64>, target: &Expr, place: &str) -> Result<Option<f64>, Error> {
    match scale {
        Some(value) if value > 0.0 && value.is_finite() => Ok(scale),
        Some(value) => {
            Err(Error::value(format!("{place} scale = {value}: write a positive error in units of the target")))
        }
        None if target.as_number().is_some() => Err(Error::missing(format!(
            "{place}: the target is constant, so the size of an error is unknown; add `scale`, the error that counts as one, in its units"
        ))),
        None => Ok(None),
    }
}

/// Equations of the states, over columns and latents.
fn state_equations(recipe: &Recipe, aliases: &mut Aliases<'_>, names: &[String]) -> Result<Vec<Equation>, Error> {
    let prediction = match recipe.model.predict.as_deref().unwrap_or("derivative") {
        "derivative" => Prediction::Derivative,
        "next" => Prediction::Next,
        "delta" | "difference" => Prediction::Difference,
        other => {
            return Err(Error::conflict(format!(
                "predict = \"{other}\": equations of {STATES_SECTION} give a derivative, next value or delta; remove `equation` to predict a column"
            )));
        }
    };
    let mut equations = Vec::new();
    for (name, state) in &recipe.states {
        let place = STATES_SECTION.entry(name).to_string();
        let unit = aliases.columns.iter().find(|column| column.name == *name).and_then(|column| column.unit.clone());
        match (&state.equation, &state.known) {
            (Some(_), Some(_)) => {
                return Err(Error::conflict(format!(
                    "{place}: it has both `equation` and `known`; remove one of them"
                )));
            }
            (None, None) => {
                return Err(Error::missing(format!(
                    "{place}: other states have an equation and this one has none; add `equation` (over columns and latents) or `known`, \
                     or make it one of {INPUTS_SECTION}"
                )));
            }
            (None, Some(_)) => equations.push(state_equation(name, state, prediction, unit, aliases)?),
            (Some(text), None) => {
                let mut equation = state_equation(name, state, prediction, unit, aliases)?;
                let right = aliases.over_latents(text, names, &format!("{place} equation"))?;
                if !right.columns().iter().any(|column| names.iter().any(|name| **name == **column)) {
                    return Err(Error::conflict(format!(
                        "{place} equation: `{right}` has no latent; write it as `known`, which is given and not fitted"
                    )));
                }
                equation.right = right;
                equations.push(equation);
            }
        }
    }
    Ok(equations)
}

/// One equation a task, on a column of its name that is its target; a constant target has nothing to predict.
fn task_equations(
    recipe: &Recipe,
    aliases: &mut Aliases<'_>,
    sides: &[(String, String, Expr, Expr)],
) -> Result<Vec<Equation>, Error> {
    // Without equations nothing advances the states.
    for column in aliases.columns.iter_mut().filter(|column| column.role == Role::State) {
        column.role = Role::Input;
    }
    let mut equations = Vec::new();
    for (name, text, target, right) in sides {
        if target.as_number().is_some() {
            continue;
        }
        let taken = aliases.texts.contains_key(name)
            || aliases.columns.iter().any(|column| column.name == *name)
            || recipe.latents.contains_key(name);
        if taken {
            return Err(Error::name_taken(
                name,
                format!("{entry}: a column or latent has this name too; rename the task", entry = TASKS.entry(name)),
            ));
        }
        aliases.add(name, Some(text), None, Role::Auxiliary, false, &format!("{} target", TASKS.entry(name)))?;
        equations.push(Equation {
            subject: name.clone(),
            prediction: Prediction::Value,
            right: right.clone(),
            target: Some(Expr::column(name.as_str())),
            unit: None,
        });
    }
    if equations.is_empty() {
        return Err(Error::missing(format!(
            "{TASKS}: all targets are constant, so there is nothing to predict; give a state an `equation`"
        )));
    }
    Ok(equations)
}

#[cfg(test)]
mod tests;
