//! Goldens: what every method makes of small logs, to the last bit. They hold rebuilding: a coefficient that is another afterwards is named.

mod book;
mod found;
mod logs;
mod narx;
mod pwa;
mod recordings;
mod sindy;
mod sparse;

use fleetfoot::Recipe;

/// A recipe from its text.
fn recipe(text: &str) -> Recipe {
    Recipe::parse(text, "the recipe of a golden").unwrap()
}
