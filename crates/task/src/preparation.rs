//! Columns of a recipe that `prepare` reads.

use fleetfoot_data::Column;
use fleetfoot_data::setting::{COLUMNS, MODEL, STATES_SECTION};
use fleetfoot_model::Role;
use fleetfoot_recipe::{Aliases, Derivative, Error, Recipe};

/// Columns of a recipe: its states and inputs, its other columns, and those in its equations and weights.
pub fn prepared<'a>(recipe: &'a Recipe, fields: &'a [Column]) -> Result<Aliases<'a>, Error> {
    let mut aliases = Aliases::of_recipe(recipe, fields)?;
    for name in recipe.columns.keys() {
        aliases.add(name, None, None, Role::Auxiliary, false, &COLUMNS.to_string())?;
    }
    let latents: Vec<String> = recipe.latents.keys().cloned().collect();
    aliases.hide(&recipe.parameters.keys().cloned().collect::<Vec<_>>());
    for (name, state) in &recipe.states {
        let place = STATES_SECTION.entry(name).to_string();
        let derivative = match &state.derivative {
            Some(Derivative::Text(text)) if !Derivative::is_word(text) => Some(text),
            _ => None,
        };
        for text in
            [derivative, state.known.as_ref(), state.equation.as_ref(), state.nominal.as_ref()].into_iter().flatten()
        {
            let expression = aliases.over_latents(text, &latents, &place)?;
            aliases.add_used(&expression, &latents, &place)?;
        }
    }
    for text in recipe.model.weight.iter().chain(recipe.model.partition_on.iter().flatten()) {
        aliases.over_aliases(text, &MODEL.to_string())?;
    }
    Ok(aliases)
}
