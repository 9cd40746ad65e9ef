//! Quantities of a running hexapod that no model has as a column, as expressions over its log.

use std::path::PathBuf;

use fleetfoot_data::Progress;
use fleetfoot_dataset::Dataset;
use fleetfoot_fit::Error;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Model, Role, Training};
use fleetfoot_recipe::{Error as RecipeError, Recipe};

/// A column of the logs by an expression over the names of a recipe.
pub(super) fn column(recipe: &Recipe, name: &str, text: &str, unit: &str, angle: bool) -> Result<Column, Error> {
    let refused = |source| RecipeError::Expression { place: name.to_owned(), text: text.to_owned(), source };
    let mut scope = Scope::open();
    scope.define_all(&recipe.columns).map_err(refused)?;
    let expression = Expr::parse(text, &scope).map_err(refused)?;
    Ok(Column {
        name: name.to_owned(),
        source: expression.to_string(),
        unit: Some(unit.to_owned()),
        role: Role::Auxiliary,
        angle,
        rotation: None,
    })
}

/// A model without equations: its columns are all that it has.
pub(super) fn columns_only(recipe: &Recipe, method: &str, columns: Vec<Column>) -> Model {
    Model::new(method, columns, 0.0, Training { recipe: recipe.to_toml(), ..Training::default() })
}

/// Opens logs for the columns of a model.
pub(super) fn open(model: &Model, files: &[PathBuf], progress: &dyn Progress) -> Result<Dataset, Error> {
    Ok(Dataset::for_model(model, &Recipe::default(), files, progress)?)
}
