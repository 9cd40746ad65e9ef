//! Goldens: what every method makes of small logs, to the last bit. They hold rebuilding: a coefficient that is another afterwards is named.

mod book;
mod logs;
mod narx;
mod pwa;
mod record;
mod recordings;
mod sindy;
mod sparse;

use fleetfoot::{Model, Recipe};

/// A recipe from its text.
fn recipe(text: &str) -> Recipe {
    Recipe::parse(text, "the recipe of a golden").unwrap()
}

/// Holds that the recipe which a model carries makes the same model, to the byte.
fn refits(name: &str, model: &Model, fit: impl Fn(&Recipe) -> Model) {
    let again = fit(&recipe(&model.training.recipe));
    assert!(
        again.to_json() == model.to_json(),
        "{name}: its own recipe makes another model:\n{}",
        model.training.recipe
    );
}
