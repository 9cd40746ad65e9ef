//! The names that a recipe or a model gives to recorded fields.

use fleetfoot_data::setting::{COLUMNS, INPUTS_SECTION, STATES_SECTION};
use fleetfoot_data::{Column as DataColumn, ColumnKind, nearest};
use fleetfoot_library::{Expr, ParseErrorKind, Quaternion, Scope, Unit};
use fleetfoot_model::{Column, Role};
use indexmap::IndexMap;

use crate::{
    attitude::named_rotations,
    error::Error,
    recipe::{Kind, Recipe},
};

/// The aliases of a model or recipe while they are collected.
pub struct Aliases<'a> {
    /// Fields of the logs.
    pub fields: &'a [DataColumn],
    scope: Scope,
    /// The columns named so far.
    pub columns: Vec<Column>,
    /// The expression over fields that each column is.
    pub expressions: Vec<(DataColumn, Expr)>,
    /// The aliases of `[columns]` as they are written.
    pub texts: &'a IndexMap<String, String>,
    hidden: Vec<String>,
    /// The rotations among the states.
    rotations: Vec<(String, Quaternion)>,
}

impl<'a> Aliases<'a> {
    fn new(fields: &'a [DataColumn], texts: &'a IndexMap<String, String>) -> Result<Self, Error> {
        let mut scope = Scope::new(fields.iter().map(|field| field.name.as_str()));
        scope.define_all(texts).map_err(|source| Error::Expression {
            place: COLUMNS.entry(source.alias().unwrap_or_default()).to_string(),
            text: source.text().to_owned(),
            source,
        })?;
        Ok(Self {
            fields,
            scope,
            columns: Vec::new(),
            expressions: Vec::new(),
            texts,
            hidden: Vec::new(),
            rotations: Vec::new(),
        })
    }

    /// The aliases with the recipe's states and inputs among their columns.
    pub fn of_recipe(recipe: &'a Recipe, fields: &'a [DataColumn]) -> Result<Self, Error> {
        let mut aliases = Self::new(fields, &recipe.columns)?;
        for (name, state) in &recipe.states {
            let place = STATES_SECTION.entry(name).to_string();
            let angle = state.kind == Some(Kind::Angle);
            aliases.add(name, state.column.as_deref(), state.unit.as_deref(), Role::State, angle, &place)?;
            if let (Some(part), Some(column)) = (state.rotation_part(), aliases.columns.last_mut()) {
                column.rotation = Some(part);
            }
        }
        aliases.rotations = named_rotations(&aliases.columns);
        for (name, input) in &recipe.inputs {
            let place = INPUTS_SECTION.entry(name).to_string();
            let input = input.table();
            if input.kind.and_then(Kind::rotation).is_some() {
                return Err(Error::value(format!(
                    "{place} kind: only states are rotations; expressions such as `rotate(q, vec(0, 0, 1)).x` read a recorded one as it is"
                )));
            }
            let angle = input.kind == Some(Kind::Angle);
            let text = input.column.as_deref().filter(|text| *text != name.as_str());
            aliases.add(name, text, input.unit.as_deref(), Role::Input, angle, &place)?;
        }
        Ok(aliases)
    }

    /// Adds a column, or raises the role of one that is there.
    pub fn add(
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
        // Units of a file are the file's; units that a person writes are deliberate.
        if let Some(text) = unit.filter(|text| field.is_none_or(|field| field.unit.as_deref() != Some(*text))) {
            Unit::parse(text).map_err(|error| Error::value(format!("{place} unit = \"{text}\": {error}")))?;
        }
        let unit = unit.map(str::to_owned).or_else(|| field.and_then(|field| field.unit.clone()));
        let kind = field.map_or(ColumnKind::Float, |field| field.kind.clone());
        self.columns.push(Column { name: name.to_owned(), source, unit: unit.clone(), role, angle, rotation: None });
        self.expressions.push((DataColumn { name: name.to_owned(), unit, kind }, expression));
        Ok(())
    }

    /// An expression over fields and aliases; `place` is where it stands, for messages.
    ///
    /// # Errors
    /// [`Error::Expression`].
    pub fn parse(&self, text: &str, place: &str) -> Result<Expr, Error> {
        if self.fields.iter().any(|field| field.name == text.trim()) {
            return Ok(Expr::column(text.trim()));
        }
        Expr::parse(text, &self.scope).map_err(|source| Error::Expression {
            place: place.to_owned(),
            text: text.to_owned(),
            source,
        })
    }

    /// Parses an expression over aliases and fields, adding its names as auxiliary columns; the result is over aliases
    /// alone.
    pub fn over_aliases(&mut self, text: &str, place: &str) -> Result<Expr, Error> {
        self.over_latents(text, &[], place)
    }

    /// [`Aliases::over_aliases`] with latents beside the aliases; a latent hides a field of its name.
    pub fn over_latents(&mut self, text: &str, latents: &[String], place: &str) -> Result<Expr, Error> {
        let names = self.visible_names(latents);
        let expression = if names.contains(&text.trim()) {
            Expr::column(text.trim())
        } else {
            Expr::parse(text, &self.scope_of(&names)).map_err(|source| Error::Expression {
                place: place.to_owned(),
                text: text.to_owned(),
                source,
            })?
        };
        self.add_used(&expression, latents, place)?;
        Ok(expression)
    }

    /// The names that expressions over aliases may use.
    fn visible_names<'b>(&'b self, latents: &'b [String]) -> Vec<&'b str> {
        self.texts
            .keys()
            .map(String::as_str)
            .chain(self.columns.iter().map(|column| column.name.as_str()))
            .chain(self.fields.iter().map(|field| field.name.as_str()))
            .chain(latents.iter().chain(&self.hidden).map(String::as_str))
            .collect()
    }

    /// The scope in which every alias stands for itself, with latents beside the aliases.
    pub fn alias_scope(&self, latents: &[String]) -> Scope {
        self.scope_of(&self.visible_names(latents))
    }

    /// These names, and the rotations.
    fn scope_of(&self, names: &[&str]) -> Scope {
        let mut scope = Scope::new(names);
        for (name, rotation) in &self.rotations {
            scope.define_rotation(name.as_str(), rotation.clone());
        }
        scope
    }

    /// Adds the columns of an expression over aliases and latents, as auxiliary ones.
    pub fn add_used(&mut self, expression: &Expr, latents: &[String], place: &str) -> Result<(), Error> {
        for name in expression.sources() {
            if !latents.iter().chain(&self.hidden).any(|hidden| **hidden == *name) {
                self.add(&name, None, None, Role::Auxiliary, false, place)?;
            }
        }
        Ok(())
    }

    /// Returns true if a name stands for a column already.
    pub fn has(&self, name: &str) -> bool {
        self.visible_names(&[]).contains(&name)
    }

    /// Lets these names stand in expressions without being columns: parameters, whose values are not known yet.
    pub fn hide(&mut self, names: &[String]) {
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

/// The view of a recording that a model needs: its columns, by the expressions that it remembers.
pub fn aliases_of_model(columns: &[Column], fields: &[DataColumn]) -> Result<Vec<(DataColumn, Expr)>, Error> {
    let scope = Scope::new(fields.iter().map(|field| field.name.as_str()));
    columns
        .iter()
        .map(|column| {
            let place = format!("column {} of the model", column.name);
            let expression = Expr::parse(&column.source, &scope).map_err(|source| match source.kind() {
                // A mark under a name that stands alone says nothing.
                ParseErrorKind::UnknownName { name, nearest, .. } if *name == column.source.trim_matches('`') => {
                    Error::UnknownColumn { place, name: name.clone(), candidates: nearest.clone() }
                }
                _ => Error::Expression { place, text: column.source.clone(), source },
            })?;
            let field = expression.as_column().and_then(|name| fields.iter().find(|field| field.name == name));
            let kind = field.map_or(ColumnKind::Float, |field| field.kind.clone());
            Ok((DataColumn { name: column.name.clone(), unit: column.unit.clone(), kind }, expression))
        })
        .collect()
}
