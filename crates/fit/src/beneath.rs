//! The recipe of a fit of a statistic: the fit's settings above the recipe of the scan.

use fleetfoot_dataset::condition::refuse_other_rows;
use fleetfoot_recipe::{ModelSection, Recipe};

use crate::error::Error;

/// The recipe with that of the scan beneath, if it names nothing to predict. Its settings of the fit stay above; the
/// rows are those of the scan.
///
/// # Errors
/// Another condition for rows.
pub(crate) fn beneath(recipe: &Recipe, scanned: &Recipe) -> Result<Recipe, Error> {
    refuse_other_rows(recipe, scanned)?;
    if !recipe.states.is_empty() || recipe.model.predict.is_some() {
        let mut whole = recipe.clone();
        whole.time.only.clone_from(&scanned.time.only);
        return Ok(whole);
    }
    let mut whole = scanned.clone();
    whole.override_all(recipe);
    if recipe.library != Default::default() {
        whole.library = recipe.library.clone();
    }
    if !recipe.constraints.is_empty() {
        whole.constraints.clone_from(&recipe.constraints);
    }
    let ModelSection { predict: _, degree, lags, weight, partition, partition_on } = recipe.model.clone();
    let below = &mut whole.model;
    (below.degree, below.lags) = (degree.or(below.degree), lags.or(below.lags));
    below.weight = weight.or(below.weight.take());
    below.partition = partition.or(below.partition.take());
    below.partition_on = partition_on.or(below.partition_on.take());
    Ok(whole)
}
