//! Recipes from Python values.

use fleetfoot::{Recipe, Time};
use pyo3::prelude::*;

use crate::error::{Kind, of_engine};

/// A recipe as TOML, checked, with the values given beside it. These are the name of the clock's column and the unit of
/// its numbers, or a period in seconds; and the rows in use.
///
/// `text` is TOML, or JSON of the same shape; `origin` names it in messages. TOML that is not changed comes back as it is.
#[pyfunction]
#[pyo3(signature = (text, origin = "the recipe", is_json = false, clock = None, unit = None, dt = None, only = None))]
pub(crate) fn recipe(
    text: &str,
    origin: &str,
    is_json: bool,
    clock: Option<String>,
    unit: Option<String>,
    dt: Option<f64>,
    only: Option<String>,
) -> PyResult<String> {
    let mut recipe =
        if is_json { Recipe::from_json(text, origin) } else { Recipe::parse(text, origin) }.map_err(of_engine)?;
    if let Some(dt) = dt
        && !(dt > 0.0 && dt.is_finite())
    {
        return Err(Kind::Option.error(format!("dt = {dt}: the sampling period must be positive")));
    }
    if !is_json && clock.is_none() && dt.is_none() && only.is_none() {
        return Ok(text.to_owned());
    }
    if clock.is_some() || dt.is_some() {
        recipe.time = Time { column: clock, unit, dt, ..recipe.time };
    }
    recipe.time.only = only.or(recipe.time.only);
    Ok(recipe.to_toml())
}

/// A recipe from JSON.
pub(crate) fn of_json(text: &str) -> PyResult<Recipe> {
    Recipe::from_json(text, "the arguments").map_err(of_engine)
}
