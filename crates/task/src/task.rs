//! A recipe resolved against the columns of a recording: the problem of `fit pwa`, and the parts of a recipe that every
//! fit reads.

use fleetfoot_data::setting::{
    FIT_PWA, FIT_SINDY, INPUTS, PARTITION, PARTITION_ON, PHASE, PREDICT, STATES, STATES_SECTION,
};
use fleetfoot_data::{Column as DataColumn, ColumnKind, nearest};
use fleetfoot_library::{Expr, Library, central_difference};
use fleetfoot_model::{Column, Equation, Prediction, Role};
use fleetfoot_pwa::{Phase, PhaseKind, Problem};
use fleetfoot_recipe::{Aliases, Error, Kind, Lags, PhaseColumn, Recipe, State, items, named_rotations};

use crate::{
    derivative::measured,
    leak::{predicted, refuse_target_in_partition},
};

/// A recipe resolved for a recording.
#[derive(Debug, Clone)]
pub struct Task {
    /// The problem to identify, over the aliases.
    pub problem: Problem,
    /// Variables of the library: states and inputs, angles as cosine and sine, and their past.
    pub variables: Vec<Expr>,
    /// The phase along which regions are counted, where the recipe names one.
    pub phase: Option<Phase>,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub aliases: Vec<(DataColumn, Expr)>,
}

/// Measured left side of an equation.
fn target(name: &str, angle: bool, prediction: Prediction) -> Expr {
    let x = Expr::column(name);
    let rise = &x.shifted(-1) - &x;
    match prediction {
        Prediction::Next if angle => &x + &rise.wrap(),
        Prediction::Next => x.shifted(-1),
        Prediction::Difference if angle => rise.wrap(),
        Prediction::Difference => rise,
        Prediction::Derivative => central_difference(&x, angle),
        Prediction::Value => x,
    }
}

impl Task {
    /// Resolves a recipe against the fields of a recording.
    pub fn resolve(recipe: &Recipe, fields: &[DataColumn], labels: &[String], step: f64) -> Result<Self, Error> {
        let mut aliases = Aliases::of_recipe(recipe, fields)?;
        let equations = equations(recipe, &mut aliases)?;
        let variables = variables(recipe, &aliases, &equations)?;
        let library = polynomials(recipe, &variables)?;
        let partition_columns = partition_columns(recipe, &equations, &mut aliases)?;
        for label in labels {
            aliases.add(label, None, None, Role::Auxiliary, false, &PARTITION.to("labels").to_string())?;
        }
        let labels: Vec<Expr> = labels.iter().map(|label| Expr::column(label.as_str())).collect();
        refuse_target_in_partition(&equations, &aliases, &labels)?;
        let weight = recipe.model.weight.as_deref().map(|text| aliases.over_aliases(text, "weight")).transpose()?;
        let phase = recipe.pwa.phase.as_ref().map(|phase| resolved(phase, &mut aliases)).transpose()?;
        let problem = Problem { columns: aliases.columns, library, equations, partition_columns, weight, step };
        Ok(Self { problem, variables, phase, aliases: aliases.expressions })
    }
}

/// The phase that `[pwa]` names, over the aliases: its period is known of angles.
fn resolved(phase: &PhaseColumn, aliases: &mut Aliases<'_>) -> Result<Phase, Error> {
    let (PhaseColumn::Cyclic { column: text, .. } | PhaseColumn::Labels(text)) = phase;
    let column = aliases.over_aliases(text, &PHASE.to_string())?;
    let definition = column.as_column().and_then(|name| aliases.columns.iter().find(|column| column.name == name));
    let is_angle = definition.is_some_and(|column| column.angle || column.unit.as_deref() == Some("rad"));
    let kind = match phase {
        PhaseColumn::Cyclic { bins, .. } => {
            PhaseKind::Cyclic { bins: *bins, period: is_angle.then_some(2.0 * std::f64::consts::PI) }
        }
        PhaseColumn::Labels(_) => PhaseKind::Labels(DataColumn::float(text.as_str())),
    };
    Ok(Phase { specification: phase.to_string(), column, kind })
}

impl Task {
    /// The phase over the columns of the opened logs, which have the names of labels; text counts as labels.
    pub fn phase_in(&self, columns: &[DataColumn]) -> Option<Phase> {
        let mut phase = self.phase.clone()?;
        let definition = phase.column.as_column().and_then(|name| columns.iter().find(|column| column.name == name));
        if let Some(column) = definition {
            let is_text = matches!(column.kind, ColumnKind::Category(_));
            if let (PhaseKind::Cyclic { .. }, true) = (&phase.kind, is_text) {
                phase.specification = format!("labels:{}", column.name);
            }
            if is_text || matches!(phase.kind, PhaseKind::Labels(_)) {
                phase.kind = PhaseKind::Labels(column.clone());
            }
        }
        Some(phase)
    }
}

/// The equations that the recipe asks for.
pub(crate) fn equations(recipe: &Recipe, aliases: &mut Aliases<'_>) -> Result<Vec<Equation>, Error> {
    let predict = recipe.model.predict.as_deref().unwrap_or("derivative");
    let prediction = match predict {
        "derivative" => Prediction::Derivative,
        "next" => Prediction::Next,
        "delta" | "difference" => Prediction::Difference,
        _ => Prediction::Value,
    };
    if prediction == Prediction::Value {
        // A column may have commas in its name.
        let names = if aliases.has(predict) { vec![predict.to_owned()] } else { items(predict) };
        let mut equations: Vec<Equation> = Vec::new();
        for name in names.iter().map(|name| name.trim_matches('`')) {
            if equations.iter().any(|equation| equation.subject == name) {
                return Err(Error::name_taken(
                    name,
                    format!("{given_predict}: `{name}` is named twice", given_predict = PREDICT.to(predict)),
                ));
            }
            equations.push(value_equation(name, aliases).map_err(|error| with_words(error, predict))?);
        }
        return Ok(equations);
    }
    if recipe.states.is_empty() {
        return Err(Error::missing(format!(
            "no states: to predict the {} of something, name the states in the recipe ({STATES_SECTION}) or with {STATES}; \
             for plain regression y = f(inputs) use {given_predict}",
            if predict == "derivative" { "derivative" } else { "next value" },
            given_predict = PREDICT.to("COLUMN")
        )));
    }
    let mut equations = Vec::new();
    for (name, state) in &recipe.states {
        let unit = aliases.columns.iter().find(|column| column.name == *name).and_then(|column| column.unit.clone());
        equations.push(state_equation(name, state, prediction, unit, aliases)?);
    }
    if equations.iter().all(|equation| equation.target.is_none()) {
        return Err(Error::conflict(format!(
            "all states are known: there is nothing to fit; remove `known` from at least one, or write the model as it is with {FIT_PWA} or \
             {FIT_SINDY}"
        )));
    }
    Ok(equations)
}

/// Words that `predict` takes beside columns.
const WORDS: [&str; 4] = ["derivative", "next", "delta", "difference"];

/// The error of a column that does not exist, with the word that may have been meant.
fn with_words(error: Error, predict: &str) -> Error {
    match error {
        Error::UnknownColumn { place, name, candidates } if name == predict => {
            let words = nearest(predict, WORDS);
            Error::UnknownColumn { place, name, candidates: words.into_iter().chain(candidates).collect() }
        }
        other => other,
    }
}

/// Plain regression of a column.
fn value_equation(name: &str, aliases: &mut Aliases<'_>) -> Result<Equation, Error> {
    aliases.add(name, None, None, Role::Auxiliary, false, &PREDICT.to_string())?;
    let unit = aliases.columns.iter().find(|column| column.name == name).and_then(|column| column.unit.clone());
    Ok(Equation {
        subject: name.to_owned(),
        prediction: Prediction::Value,
        right: Expr::column(format!("f_{name}")),
        target: Some(Expr::column(name)),
        unit,
    })
}

/// The unit of a rate of change.
pub fn rate_unit(unit: &str) -> String {
    match unit.strip_suffix("/s") {
        Some(base) => format!("{base}/s^2"),
        None => format!("{unit}/s"),
    }
}

pub(crate) fn state_equation(
    name: &str,
    state: &State,
    prediction: Prediction,
    unit: Option<String>,
    aliases: &mut Aliases<'_>,
) -> Result<Equation, Error> {
    let angle = state.kind == Some(Kind::Angle);
    let place = STATES_SECTION.entry(name).to_string();
    if let Some(known) = &state.known {
        let right = aliases.over_aliases(known, &place)?;
        return Ok(Equation {
            subject: name.to_owned(),
            prediction: Prediction::Derivative,
            right,
            target: None,
            unit: None,
        });
    }
    let x = Expr::column(name);
    let left = match prediction {
        Prediction::Derivative => measured(state.derivative.as_ref(), &x, angle, &place, aliases)?,
        other => target(name, angle, other),
    };
    let unit = unit.map(|unit| if prediction == Prediction::Derivative { rate_unit(&unit) } else { unit });
    Ok(Equation {
        subject: name.to_owned(),
        prediction,
        right: Expr::column(format!("f_{name}")),
        target: Some(left),
        unit,
    })
}

/// Regressors of a column. An angle stands as its cosine and sine, a rotation, once, as the nine entries of its matrix:
/// they do not depend on its representation.
pub fn seen(column: &Column, all: &[Column]) -> Vec<Expr> {
    let x = Expr::column(column.name.as_str());
    match &column.rotation {
        Some(rotation) if rotation.part == 0 => {
            let named = named_rotations(all);
            let rotation = named.iter().find(|(name, _)| *name == rotation.group);
            rotation.map_or_else(Vec::new, |(_, rotation)| rotation.rotation_matrix().into_iter().flatten().collect())
        }
        Some(_) => Vec::new(),
        None if column.angle => vec![x.cos(), x.sin()],
        None => vec![x],
    }
}

pub(crate) fn library(recipe: &Recipe, aliases: &Aliases<'_>, equations: &[Equation]) -> Result<Vec<Expr>, Error> {
    polynomials(recipe, &variables(recipe, aliases, equations)?)
}

fn polynomials(recipe: &Recipe, variables: &[Expr]) -> Result<Vec<Expr>, Error> {
    Ok(Library::polynomial(variables, recipe.model.degree.unwrap_or(1).max(1))?.functions().to_vec())
}

/// Variables of the libraries: states and inputs (angles as cosine and sine), and their past if the recipe has lags.
pub(crate) fn variables(recipe: &Recipe, aliases: &Aliases<'_>, equations: &[Equation]) -> Result<Vec<Expr>, Error> {
    let regressor = |name: &str| recipe.states.get(name).is_none_or(|state| state.regressor != Some(false));
    let present: Vec<Expr> = aliases
        .columns
        .iter()
        .filter(|column| {
            column.role != Role::Auxiliary && regressor(&column.name) && !predicted(equations, &column.name)
        })
        .flat_map(|column| seen(column, &aliases.columns))
        .collect();
    let lags: Vec<i32> = std::iter::once(0).chain(recipe.model.lags.into_iter().flat_map(Lags::steps)).collect();
    let mut variables = Library::with_lags(&present, &lags).functions().to_vec();
    // The past of what is predicted is a fair regressor; its present is not.
    if lags.len() > 1 {
        for equation in equations.iter().filter(|equation| equation.prediction == Prediction::Value) {
            variables.extend(lags[1..].iter().map(|&lag| Expr::column(equation.subject.as_str()).shifted(lag)));
        }
    }
    if variables.is_empty() {
        return Err(Error::missing(format!(
            "no regressors: name states or inputs ({STATES}, {INPUTS}, or the recipe)"
        )));
    }
    Ok(variables)
}

/// Partition columns: those of the recipe, else the states, else the inputs; never the predicted value.
pub(crate) fn partition_columns(
    recipe: &Recipe,
    equations: &[Equation],
    aliases: &mut Aliases<'_>,
) -> Result<Vec<Expr>, Error> {
    let Some(on) = &recipe.model.partition_on else {
        let regressor = |name: &str| {
            recipe.states.get(name).is_some_and(|state| state.regressor != Some(false)) && !predicted(equations, name)
        };
        let states: Vec<Expr> = aliases
            .columns
            .iter()
            .filter(|column| column.role == Role::State && regressor(&column.name))
            .flat_map(|column| seen(column, &aliases.columns))
            .collect();
        let inputs = || {
            let inputs = aliases.columns.iter().filter(|column| column.role == Role::Input);
            inputs.flat_map(|column| seen(column, &aliases.columns)).collect()
        };
        return Ok(if states.is_empty() { inputs() } else { states });
    };
    let mut columns = Vec::new();
    for text in on {
        let expression = aliases.over_aliases(text, &PARTITION_ON.to_string())?;
        let column = expression.as_column().and_then(|name| aliases.columns.iter().find(|column| column.name == name));
        columns.extend(column.map_or_else(|| vec![expression.clone()], |column| seen(column, &aliases.columns)));
    }
    refuse_target_in_partition(equations, aliases, &columns)?;
    Ok(columns)
}
