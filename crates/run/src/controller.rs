//! Controllers by name or from a file, bound to a model.

use std::{path::Path, sync::Arc};

use fleetfoot_control::controller::{Controller, TreadmillLoop};
use fleetfoot_data::nearest;
use fleetfoot_data::setting::{CONTROL_LQR, CONTROL_MPC, CONTROLLER};
use fleetfoot_dataset::Error as DatasetError;
use fleetfoot_fit::Error;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Model, Role};
use fleetfoot_recipe::{Error as RecipeError, Recipe};
use toml::{Table, Value};

use crate::ControllerFile;

/// Controllers that there are.
const KINDS: [&str; 1] = ["treadmill"];

/// A controller. `what` is its kind (`treadmill`), a TOML file with `kind` and its settings, a file that
/// [`crate::control_lqr`] or [`crate::control_mpc`] made, or the text of one. `settings` are `KEY=VALUE` and stand above those of a kind.
///
/// # Errors
/// A file that cannot be read or understood, an unknown kind or setting (with the nearest name), a value that cannot be used.
pub fn controller(what: &str, settings: &[String]) -> Result<Arc<dyn Controller>, Error> {
    if let Some(made) = made(what)? {
        return match settings {
            [] => Ok(Arc::new(made.law)),
            [setting, ..] => Err(refused(
                &short(what),
                format!("{setting}: a controller that was made for a model has no settings; make it again with others"),
            )),
        };
    }
    let mut table = if KINDS.contains(&what) { Table::new() } else { read(what)? };
    let kind = match table.remove("kind") {
        None if KINDS.contains(&what) => what.to_owned(),
        Some(Value::String(kind)) => kind,
        _ => return Err(refused(what, format!("`kind` is missing: write kind = \"{}\"", KINDS.join("\" or \"")))),
    };
    if !KINDS.contains(&kind.as_str()) {
        return Err(refused(what, format!("there is no controller `{kind}`; there is {}", KINDS.join(", "))));
    }
    for setting in settings {
        let Some((key, value)) = setting.split_once('=') else {
            return Err(refused(what, format!("`{setting}`: write KEY=VALUE, e.g. k_x=2 or yaw=heading")));
        };
        let (key, value) = (key.trim(), value.trim());
        let value = value.parse().map_or_else(|_| Value::String(value.to_owned()), Value::Float);
        table.insert(key.to_owned(), value);
    }
    let known = Table::try_from(TreadmillLoop::default()).map_err(|error| refused(what, error.to_string()))?;
    check_keys(&table, &known).map_err(|problem| refused(what, format!("{kind} {problem}")))?;
    let controller: TreadmillLoop =
        table.try_into().map_err(|error: toml::de::Error| refused(what, error.message().to_owned()))?;
    controller.validate().map_err(|error| refused(what, error.to_string()))?;
    Ok(Arc::new(controller))
}

/// The controller that was made for a model: `what` is its file, or the text of one.
///
/// # Errors
/// A `what` that is neither.
pub fn controller_file(what: &str) -> Result<ControllerFile, Error> {
    made(what)?.ok_or_else(|| refused(what, format!("no file that {CONTROL_LQR} or {CONTROL_MPC} made")))
}

/// The same; `None` where it is none, whatever else it may be.
///
/// # Errors
/// Those of [`ControllerFile::from_json`].
pub fn made_controller(path: &Path) -> Result<Option<ControllerFile>, Error> {
    // Unreadable files are reported by the reader of the other format.
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let marked = is_json(&text) && text.contains("\"fleetfoot_controller\"");
    marked.then(|| ControllerFile::from_json(&text, &path.display().to_string())).transpose()
}

/// Controller in a text of JSON, or in a file of it; `None` for other files.
fn made(what: &str) -> Result<Option<ControllerFile>, Error> {
    if is_json(what) {
        return ControllerFile::from_json(what, "the controller").map(Some);
    }
    let path = Path::new(what);
    let text = if path.is_file() { std::fs::read_to_string(path).unwrap_or_default() } else { String::new() };
    is_json(&text).then(|| ControllerFile::from_json(&text, what)).transpose()
}

fn is_json(text: &str) -> bool {
    text.trim_start().starts_with('{')
}

/// Name of a controller in messages.
fn short(what: &str) -> String {
    if is_json(what) { "the controller".to_owned() } else { what.to_owned() }
}

/// Checks the settings against the names of the default ones.
fn check_keys(table: &Table, known: &Table) -> Result<(), String> {
    for (key, value) in table {
        let Some(default) = known.get(key) else {
            let names = || known.keys().map(String::as_str);
            let similar = nearest(key, names());
            let hint = match similar.as_slice() {
                [] => format!("there is {}", names().collect::<Vec<_>>().join(", ")),
                similar => format!("did you mean {}?", similar.join(", ")),
            };
            return Err(format!("has no setting `{key}`; {hint}"));
        };
        let number = matches!(value, Value::Float(_) | Value::Integer(_));
        match default {
            Value::Float(_) if !number => return Err(format!("{key} = {value}: must be a number")),
            // The belt's speed alone may be either.
            Value::String(_) if key != "speed" && !value.is_str() => {
                return Err(format!("{key} = {value}: must be the name of a column"));
            }
            _ => {}
        }
    }
    Ok(())
}

fn read(path: &str) -> Result<Table, Error> {
    if !Path::new(path).is_file() {
        let problem = format!(
            "neither a controller ({}) nor a TOML file nor one that {CONTROL_LQR} or {CONTROL_MPC} made",
            KINDS.join(", ")
        );
        return Err(refused(path, problem));
    }
    let text = std::fs::read_to_string(path).map_err(|error| refused(path, error.to_string()))?;
    text.parse().map_err(|error: toml::de::Error| refused(path, error.to_string()))
}

fn refused(what: &str, problem: String) -> Error {
    Error::value(format!("{given_controller}: {problem}", given_controller = CONTROLLER.to(what)))
}

/// The model with a column for every name that the controller reads: an alias of the model's recipe, a field of the
/// log, or an expression over these.
pub(crate) fn with_columns(model: &Model, controller: &dyn Controller) -> Result<Model, Error> {
    let mut model = model.clone();
    let recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    for name in controller.reads() {
        if model.column(&name).is_none() {
            let source = source(&recipe, &name);
            model.columns.push(Column {
                name,
                source,
                unit: None,
                role: Role::Auxiliary,
                angle: false,
                rotation: None,
            });
        }
    }
    Ok(model)
}

/// Expression of a name in the fields of the log.
pub(crate) fn source(recipe: &Recipe, name: &str) -> String {
    let mut scope = Scope::open();
    let aliased = scope.define_all(&recipe.columns).ok().and_then(|()| Expr::parse(name, &scope).ok());
    match aliased {
        Some(expression) if recipe.columns.contains_key(name) => expression.to_string(),
        _ => name.to_owned(),
    }
}

/// An error about a column that only the controller needs, worded as the controller's.
pub(crate) fn explained(error: DatasetError, model: &Model) -> Error {
    let missing = |place: String| {
        let name = place.strip_prefix("column ").and_then(|rest| rest.strip_suffix(" of the model"));
        match name {
            Some(name) if model.column(name).is_none() => format!("a column of {CONTROLLER}"),
            _ => place,
        }
    };
    match error {
        DatasetError::Recipe(RecipeError::Expression { place, text, source }) => {
            RecipeError::Expression { place: missing(place), text, source }.into()
        }
        DatasetError::Recipe(RecipeError::UnknownColumn { place, name, candidates }) => {
            RecipeError::UnknownColumn { place: missing(place), name, candidates }.into()
        }
        other => other.into(),
    }
}
