//! A recipe resolved to given equations with parameters.

use fleetfoot_data::Column as DataColumn;
use fleetfoot_data::setting::{
    COLUMNS, CONSTRAINTS, FIT_PARAMETERS, FIT_SINDY, FIT_SPARSE, INPUTS_SECTION, PARAMETERS, SEGMENT, STATES_SECTION,
};
use fleetfoot_estimate::{Affine, MatrixLimit, Residual};
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Aliases, Error, Recipe};
use fleetfoot_sparse::constrained::{Form, Limit, RowLimit};

use crate::{derivative, known::KnownTask, parameter::Parameter, structured::together};

/// Equations, parameters, and the residuals of the equations at every row.
#[derive(Debug, Clone)]
pub struct ParametersTask {
    /// The equations, over columns and parameters.
    pub known: KnownTask,
    /// The parameters, in the order of the recipe.
    pub parameters: Vec<Parameter>,
    /// Measured derivatives beside right sides, of the equations that have parameters.
    pub residuals: Vec<Residual>,
    /// Bounds of matrices of parameters.
    pub limits: Vec<MatrixLimit>,
}

impl ParametersTask {
    /// Resolves a recipe against the fields of a recording.
    pub fn resolve(recipe: &Recipe, fields: &[DataColumn]) -> Result<Self, Error> {
        refuse_other_sections(recipe)?;
        let mut aliases = Aliases::of_recipe(recipe, fields)?;
        let parameters = Parameter::all(recipe, &aliases)?;
        let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
        aliases.hide(&names);
        let mut measured = Vec::new();
        for (name, state) in &recipe.states {
            let angle = aliases.columns.iter().any(|column| column.name == *name && column.angle);
            let place = STATES_SECTION.entry(name).to_string();
            let x = Expr::column(name.as_str());
            measured.push(derivative::measured(state.derivative.as_ref(), &x, angle, &place, &mut aliases)?);
        }
        let limits = limits(recipe, &names, &mut aliases)?;
        let mut known = KnownTask::over(recipe, aliases)?;
        refuse_filters(&known, &names)?;
        let uses = |expr: &Expr, name: &str| expr.columns().iter().any(|column| **column == *name);
        if let Some(idle) =
            names.iter().find(|name| !known.equations.iter().any(|equation| uses(&equation.right, name)))
        {
            return Err(Error::unknown(
                idle,
                format!(
                    "{entry}: no equation reads it; remove it, or correct `known` of the states",
                    entry = PARAMETERS.entry(idle)
                ),
            ));
        }
        let mut residuals = Vec::new();
        for (equation, target) in known.equations.iter_mut().zip(measured) {
            // A rotation is not differentiated.
            let is_part = recipe.states.get(&equation.subject).is_some_and(|state| state.part.is_some());
            if !is_part && names.iter().any(|name| uses(&equation.right, name)) {
                let (name, model) = (equation.label(), equation.right.clone());
                residuals.push(Residual { name, target: target.clone(), model, weight: 1.0 });
                // Estimated targets are scored like fitted ones.
                equation.target = Some(target);
            }
        }
        Ok(Self { known, parameters, residuals, limits })
    }

    /// A parameter without a residual: no equation with it can be evaluated row by row.
    pub fn without_residual(&self) -> Option<&str> {
        let uses = |residual: &Residual, name: &str| residual.model.columns().iter().any(|column| **column == *name);
        let silent = |parameter: &&Parameter| !self.residuals.iter().any(|residual| uses(residual, &parameter.name));
        self.parameters.iter().find(silent).map(|parameter| parameter.name.as_str())
    }

    /// The parameters between their bounds; those that are fixed have no room.
    pub fn bounded(&self) -> Vec<fleetfoot_estimate::Parameter> {
        let of = |parameter: &Parameter| {
            let [least, most] = if parameter.fixed { [parameter.initial; 2] } else { parameter.bounds };
            fleetfoot_estimate::Parameter::new(&parameter.name, parameter.initial).between(least, most)
        };
        self.parameters.iter().map(of).collect()
    }

    /// An expression with these values of the parameters.
    pub fn insert(&self, expr: &Expr, values: &[f64]) -> Expr {
        let value = |name: &str| self.parameters.iter().position(|parameter| parameter.name == name);
        expr.substituted(|name| value(name).map(|at| Expr::number(values[at]))).simplified()
    }
}

/// Refuses filters in the equations: a simulation has no past of its states to filter, and their constants are no
/// numbers of the equations.
fn refuse_filters(known: &KnownTask, names: &[String]) -> Result<(), Error> {
    for equation in &known.equations {
        let Some(filter) = equation.right.filters().into_iter().next() else { continue };
        let (place, text) = (format!("{} known", STATES_SECTION.entry(&equation.subject)), filter.to_string());
        let constants = filter.constant.columns();
        return Err(Error::conflict(
            match names.iter().find(|name| constants.iter().any(|constant| **constant == ***name)) {
                Some(name) => format!(
                    "{place}: `{text}` has the parameter `{name}` inside a filter, and fit parameters estimates numbers outside of filters alone: estimate `{name}` with \
                 {FIT_SINDY} (library = \"{text}\"), then write its number into {COLUMNS}"
                ),
                None => format!(
                    "{place}: `{text}` is computed from the rows of the log and no column yet: write `filtered = \"{text}\"` into {COLUMNS}, make `filtered` one of {INPUTS_SECTION}, \
                 write `filtered` here, and give {SEGMENT}: the first rows have no value of a filter, and a segment that begins there is left out"
                ),
            },
        ));
    }
    Ok(())
}

/// `[constraints]`, over the parameters alone.
fn limits(recipe: &Recipe, names: &[String], aliases: &mut Aliases<'_>) -> Result<Vec<MatrixLimit>, Error> {
    if let Some((name, _)) = recipe.constraints.iter().find(|(_, section)| !section.coefficients.is_empty()) {
        return Err(Error::conflict(format!(
            "{entry} coefficients: only {FIT_SPARSE} and {FIT_SINDY} have coefficients; give the parameter `bounds` in {PARAMETERS}",
            entry = CONSTRAINTS.entry(name)
        )));
    }
    let limits = together(recipe, names, "parameter", aliases)?;
    limits.iter().map(|limit| matrix(limit, names)).collect()
}

fn matrix(limit: &RowLimit, names: &[String]) -> Result<MatrixLimit, Error> {
    let affine = |form: &Form| -> Option<Affine> {
        let coefficient = |term: &fleetfoot_sums::structured::Term| Some((term.latent, term.coefficient.as_number()?));
        let coefficients = form.terms.iter().map(coefficient).collect::<Option<_>>()?;
        Some(Affine { constant: form.rest.as_number()?, coefficients })
    };
    let entries: Option<Vec<Affine>> = limit.forms.iter().map(affine).collect();
    let entries = entries.ok_or_else(|| {
        Error::value(format!(
            "{}: it reads columns, and only an expression of parameters can be kept at every row; the parameters are {}",
            CONSTRAINTS.entry(&limit.name),
            names.join(", ")
        ))
    })?;
    let bound = limit.bound.as_number().unwrap_or(f64::NAN);
    Ok(MatrixLimit { name: limit.name.clone(), entries, at_least: limit.side == Limit::AtLeast, bound })
}

fn refuse_other_sections(recipe: &Recipe) -> Result<(), Error> {
    if recipe.parameters.is_empty() {
        return Err(Error::missing(format!(
            "there is nothing to estimate: name the unknown numbers in {PARAMETERS}, for example `mass = {{ initial = 90.0 }}`"
        )));
    }
    if recipe.states.is_empty() {
        return Err(Error::missing(format!(
            "no states: write the equations of {STATES_SECTION}, for example `v = {{ known = \"(gain*u - friction*v)/mass\" }}`"
        )));
    }
    if let Some((name, _)) = recipe.states.iter().find(|(_, state)| state.known.is_none()) {
        return Err(Error::missing(format!(
            "{entry}: fit parameters needs the equation of every state; write `known = \"...\"`, over columns and parameters",
            entry = STATES_SECTION.entry(name)
        )));
    }
    if recipe.model.weight.is_some() {
        return Err(Error::conflict(
            "weight: fit parameters weighs every measurement by the noise that it estimates; remove it".into(),
        ));
    }
    match recipe.model.predict.as_deref() {
        None | Some("derivative") => Ok(()),
        Some(other) => Err(Error::conflict(format!(
            "predict = \"{other}\": the equations of {FIT_PARAMETERS} are derivatives; remove it"
        ))),
    }
}
