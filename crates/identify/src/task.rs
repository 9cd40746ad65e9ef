//! A recipe resolved against the columns of a recording: aliases, the view they make, and the problem to identify.

use fleetfoot_data::{Column as DataColumn, ColumnKind, nearest};
use fleetfoot_library::{Expr, Library, Scope, central_difference};
use fleetfoot_model::{Column, Equation, Prediction, Role};
use fleetfoot_pwa::Problem;
use indexmap::IndexMap;

use crate::{
    Derivative, Error, Kind, Recipe, State, items,
    leak::{predicted, refuse_target_in_partition},
};

/// What a recipe means for a recording.
#[derive(Debug, Clone)]
pub struct Task {
    /// The problem to identify, over the aliases.
    pub problem: Problem,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub aliases: Vec<(DataColumn, Expr)>,
}

/// The aliases of a model or recipe while they are collected.
pub(crate) struct Aliases<'a> {
    pub(crate) fields: &'a [DataColumn],
    scope: Scope,
    pub(crate) columns: Vec<Column>,
    pub(crate) expressions: Vec<(DataColumn, Expr)>,
    pub(crate) texts: &'a IndexMap<String, String>,
    hidden: Vec<String>,
}

impl<'a> Aliases<'a> {
    fn new(fields: &'a [DataColumn], texts: &'a IndexMap<String, String>) -> Result<Self, Error> {
        let mut scope = Scope::new(fields.iter().map(|field| field.name.as_str()));
        scope.define_all(texts).map_err(|source| Error::Expression {
            place: format!("[columns] {}", source.alias().unwrap_or_default()),
            text: source.text().to_owned(),
            source,
        })?;
        Ok(Self { fields, scope, columns: Vec::new(), expressions: Vec::new(), texts, hidden: Vec::new() })
    }

    /// The aliases with the recipe's states and inputs among their columns.
    pub(crate) fn of_recipe(recipe: &'a Recipe, fields: &'a [DataColumn]) -> Result<Self, Error> {
        let mut aliases = Self::new(fields, &recipe.columns)?;
        for (name, state) in &recipe.states {
            let place = format!("[states] {name}");
            let angle = state.kind == Some(Kind::Angle);
            aliases.add(name, state.column.as_deref(), state.unit.as_deref(), Role::State, angle, &place)?;
        }
        for (name, input) in &recipe.inputs {
            let place = format!("[inputs] {name}");
            let input = input.table();
            let angle = input.kind == Some(Kind::Angle);
            let text = input.column.as_deref().filter(|text| *text != name.as_str());
            aliases.add(name, text, input.unit.as_deref(), Role::Input, angle, &place)?;
        }
        Ok(aliases)
    }

    /// Adds a column, or raises the role of one that is there.
    pub(crate) fn add(
        &mut self,
        name: &str,
        text: Option<&str>,
        unit: Option<&str>,
        role: Role,
        angle: bool,
        place: &str,
    ) -> Result<(), Error> {
        if let Some(column) = self.columns.iter_mut().find(|column| column.name == name) {
            if column.role == Role::Auxiliary {
                column.role = role;
                column.angle |= angle;
            }
            return Ok(());
        }
        let expression = match text {
            Some(text) => self.parse(text, place)?,
            None => self.scope.resolve(name).map_err(|_| self.unknown(name, place))?,
        };
        let source = match (text, self.texts.get(name)) {
            (Some(text), _) => text.to_owned(),
            // Aliases of aliases are written out, so that the model needs no other alias.
            (None, Some(_)) => expression.to_string(),
            (None, None) => Expr::column(name).to_string(),
        };
        let source = if text.is_some() { expression.to_string() } else { source };
        let field = expression.as_column().and_then(|name| self.fields.iter().find(|field| field.name == name));
        let unit = unit.map(str::to_owned).or_else(|| field.and_then(|field| field.unit.clone()));
        let kind = field.map_or(ColumnKind::Float, |field| field.kind.clone());
        self.columns.push(Column { name: name.to_owned(), source, unit: unit.clone(), role, angle });
        self.expressions.push((DataColumn { name: name.to_owned(), unit, kind }, expression));
        Ok(())
    }

    pub(crate) fn parse(&self, text: &str, place: &str) -> Result<Expr, Error> {
        if self.fields.iter().any(|field| field.name == text.trim()) {
            return Ok(Expr::column(text.trim()));
        }
        Expr::parse(text, &self.scope).map_err(|source| Error::Expression {
            place: place.to_owned(),
            text: text.to_owned(),
            source,
        })
    }

    /// Parses an expression over aliases and fields, adding what it speaks of as auxiliary columns; the result speaks of aliases alone.
    pub(crate) fn over_aliases(&mut self, text: &str, place: &str) -> Result<Expr, Error> {
        self.over_latents(text, &[], place)
    }

    /// [`Aliases::over_aliases`] with latents beside the aliases; a latent hides a field of its name.
    pub(crate) fn over_latents(&mut self, text: &str, latents: &[String], place: &str) -> Result<Expr, Error> {
        let names = self.own_names(latents);
        let expression = if names.contains(&text.trim()) {
            Expr::column(text.trim())
        } else {
            Expr::parse(text, &Scope::new(&names)).map_err(|source| Error::Expression {
                place: place.to_owned(),
                text: text.to_owned(),
                source,
            })?
        };
        self.add_used(&expression, latents, place)?;
        Ok(expression)
    }

    /// The names that expressions over aliases may use.
    fn own_names<'b>(&'b self, latents: &'b [String]) -> Vec<&'b str> {
        self.texts
            .keys()
            .map(String::as_str)
            .chain(self.columns.iter().map(|column| column.name.as_str()))
            .chain(self.fields.iter().map(|field| field.name.as_str()))
            .chain(latents.iter().chain(&self.hidden).map(String::as_str))
            .collect()
    }

    /// The scope in which every alias stands for itself, with latents beside the aliases.
    pub(crate) fn own_scope(&self, latents: &[String]) -> Scope {
        Scope::new(self.own_names(latents))
    }

    /// Adds the columns that an expression over aliases and latents speaks of, as auxiliary ones.
    pub(crate) fn add_used(&mut self, expression: &Expr, latents: &[String], place: &str) -> Result<(), Error> {
        for name in expression.sources() {
            if !latents.iter().chain(&self.hidden).any(|hidden| **hidden == *name) {
                self.add(&name, None, None, Role::Auxiliary, false, place)?;
            }
        }
        Ok(())
    }

    /// Whether a name stands for a column already.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.own_names(&[]).contains(&name)
    }

    /// Lets these names stand in expressions without being columns: parameters, whose values are not known yet.
    pub(crate) fn hide(&mut self, names: &[String]) {
        self.hidden.extend_from_slice(names);
    }

    fn unknown(&self, name: &str, place: &str) -> Error {
        Error::UnknownColumn {
            place: place.to_owned(),
            name: name.to_owned(),
            candidates: nearest(name, self.scope.names()),
        }
    }
}

/// How the left side of an equation is measured.
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
        let library = library(recipe, &aliases, &equations)?;
        let partition_columns = partition_columns(recipe, &equations, &mut aliases)?;
        for label in labels {
            aliases.add(label, None, None, Role::Auxiliary, false, "--partition labels")?;
        }
        let labels: Vec<Expr> = labels.iter().map(|label| Expr::column(label.as_str())).collect();
        refuse_target_in_partition(&equations, &aliases, &labels)?;
        let weight = recipe.model.weight.as_deref().map(|text| aliases.over_aliases(text, "weight")).transpose()?;
        let problem = Problem { columns: aliases.columns, library, equations, partition_columns, weight, step };
        Ok(Self { problem, aliases: aliases.expressions })
    }
}

/// Given equations alone, and the columns that they speak of.
#[derive(Default)]
pub(crate) struct KnownTask {
    /// The model's columns.
    pub(crate) columns: Vec<Column>,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub(crate) aliases: Vec<(DataColumn, Expr)>,
    /// The equations.
    pub(crate) equations: Vec<Equation>,
}

impl KnownTask {
    /// Resolves a recipe in which every state is given.
    pub(crate) fn resolve(recipe: &Recipe, fields: &[DataColumn]) -> Result<Self, Error> {
        Self::over(recipe, Aliases::of_recipe(recipe, fields)?)
    }

    /// The equations over what the aliases know.
    pub(crate) fn over(recipe: &Recipe, mut aliases: Aliases<'_>) -> Result<Self, Error> {
        let mut equations = Vec::new();
        for (name, state) in &recipe.states {
            equations.push(state_equation(name, state, Prediction::Derivative, None, &mut aliases)?);
        }
        Ok(Self { columns: aliases.columns, aliases: aliases.expressions, equations })
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
                return Err(Error::name_taken(name, format!("--predict {predict}: `{name}` is named twice")));
            }
            equations.push(value_equation(name, aliases)?);
        }
        return Ok(equations);
    }
    if recipe.states.is_empty() {
        return Err(Error::missing(format!(
            "no states: to predict the {} of something, name the states in the recipe ([states]) or with --states; \
             for plain regression y = f(inputs) use --predict COLUMN",
            if predict == "derivative" { "derivative" } else { "next value" }
        )));
    }
    let mut equations = Vec::new();
    for (name, state) in &recipe.states {
        let unit = aliases.columns.iter().find(|column| column.name == *name).and_then(|column| column.unit.clone());
        equations.push(state_equation(name, state, prediction, unit, aliases)?);
    }
    if equations.iter().all(|equation| equation.target.is_none()) {
        return Err(Error::conflict(
            "all states are known: there is nothing to fit; leave `known` away from at least one, or write the model as it is with `fleetfoot fit pwa` or \
             `fit sindy`"
                .into(),
        ));
    }
    Ok(equations)
}

/// Plain regression of a column.
fn value_equation(name: &str, aliases: &mut Aliases<'_>) -> Result<Equation, Error> {
    aliases.add(name, None, None, Role::Auxiliary, false, "--predict")?;
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
pub(crate) fn rate_unit(unit: &str) -> String {
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
    let place = format!("[states] {name}");
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
    let measured = match prediction {
        Prediction::Derivative => Derivative::measured(state.derivative.as_ref(), &x, angle, &place, aliases)?,
        other => target(name, angle, other),
    };
    let unit = unit.map(|unit| if prediction == Prediction::Derivative { rate_unit(&unit) } else { unit });
    Ok(Equation {
        subject: name.to_owned(),
        prediction,
        right: Expr::column(format!("f_{name}")),
        target: Some(measured),
        unit,
    })
}

/// An angle stands as its cosine and sine.
pub(crate) fn seen(column: &Column) -> Vec<Expr> {
    let x = Expr::column(column.name.as_str());
    if column.angle { vec![x.cos(), x.sin()] } else { vec![x] }
}

pub(crate) fn library(recipe: &Recipe, aliases: &Aliases<'_>, equations: &[Equation]) -> Result<Vec<Expr>, Error> {
    let variables = variables(recipe, aliases, equations)?;
    Ok(Library::polynomial(&variables, recipe.model.degree.unwrap_or(1).max(1))?.functions().to_vec())
}

/// What libraries range over: states and inputs (angles as cosine and sine), and their past where the recipe asks for it.
pub(crate) fn variables(recipe: &Recipe, aliases: &Aliases<'_>, equations: &[Equation]) -> Result<Vec<Expr>, Error> {
    let regressor = |name: &str| recipe.states.get(name).is_none_or(|state| state.regressor != Some(false));
    let present: Vec<Expr> = aliases
        .columns
        .iter()
        .filter(|column| {
            column.role != Role::Auxiliary && regressor(&column.name) && !predicted(equations, &column.name)
        })
        .flat_map(seen)
        .collect();
    let lags: Vec<i32> = (0..=recipe.model.lags.unwrap_or(0) as i32).collect();
    let mut variables = Library::with_lags(&present, &lags).functions().to_vec();
    // The past of what is predicted is a fair regressor; its present is not.
    if lags.len() > 1 {
        for equation in equations.iter().filter(|equation| equation.prediction == Prediction::Value) {
            variables.extend(lags[1..].iter().map(|&lag| Expr::column(equation.subject.as_str()).shifted(lag)));
        }
    }
    if variables.is_empty() {
        return Err(Error::missing("no regressors: name states or inputs (--states, --inputs, or the recipe)".into()));
    }
    Ok(variables)
}

/// What partitions look at: what the recipe says, else the states, else the inputs; never what is predicted.
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
            .flat_map(seen)
            .collect();
        let inputs = || aliases.columns.iter().filter(|column| column.role == Role::Input).flat_map(seen).collect();
        return Ok(if states.is_empty() { inputs() } else { states });
    };
    let mut columns = Vec::new();
    for text in on {
        let expression = aliases.over_aliases(text, "--partition-on")?;
        let column = expression.as_column().and_then(|name| aliases.columns.iter().find(|column| column.name == name));
        columns.extend(column.map_or_else(|| vec![expression.clone()], seen));
    }
    refuse_target_in_partition(equations, aliases, &columns)?;
    Ok(columns)
}

/// The view of a recording that a model needs: its columns, by the expressions that it remembers.
pub(crate) fn aliases_of_model(columns: &[Column], fields: &[DataColumn]) -> Result<Vec<(DataColumn, Expr)>, Error> {
    let scope = Scope::new(fields.iter().map(|field| field.name.as_str()));
    columns
        .iter()
        .map(|column| {
            let expression = Expr::parse(&column.source, &scope).map_err(|source| Error::Expression {
                place: format!("column {} of the model", column.name),
                text: column.source.clone(),
                source,
            })?;
            let field = expression.as_column().and_then(|name| fields.iter().find(|field| field.name == name));
            let kind = field.map_or(ColumnKind::Float, |field| field.kind.clone());
            Ok((DataColumn { name: column.name.clone(), unit: column.unit.clone(), kind }, expression))
        })
        .collect()
}
