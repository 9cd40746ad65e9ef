//! Flags over a recipe: what the command line says stands above it.

use fleetfoot::{
    Derivative, Error, Gap, Input, InputTable, Kind, Recipe,
    log::{Cache, Stamp},
};

use super::is_replaced;
use crate::args::{ChannelArgs, RecipeArgs, StampArg, TimeArgs};

/// The recipe with all flags applied.
pub(crate) fn recipe(arguments: &RecipeArgs) -> Result<Recipe, Error> {
    let mut recipe = arguments.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), Recipe::read)?;
    for text in &arguments.alias {
        let (name, expression) = pair("--alias", text)?;
        recipe.columns.insert(name, expression);
    }
    for state in arguments.states.iter().flat_map(|list| &list.0) {
        recipe.states.entry(state.clone()).or_default();
    }
    for input in arguments.inputs.iter().flat_map(|list| &list.0) {
        recipe.inputs.entry(input.clone()).or_insert_with(|| Input::Table(InputTable::default()));
    }
    for angle in arguments.angles.iter().flat_map(|list| &list.0) {
        if let Some(state) = recipe.states.get_mut(angle) {
            state.kind = Some(Kind::Angle);
        } else if let Some(input) = recipe.inputs.get_mut(angle) {
            *input = Input::Table(InputTable { kind: Some(Kind::Angle), ..input.table() });
        } else {
            return Err(Error::unknown(angle, format!("--angles {angle}: it is neither a state nor an input")));
        }
    }
    for text in &arguments.derivative {
        let (name, form) = pair("--derivative", text)?;
        let Some(state) = recipe.states.get_mut(&name) else {
            return Err(Error::unknown(&name, format!("--derivative {text}: `{name}` is not a state")));
        };
        state.derivative = Some(Derivative::parse(&form));
    }
    let model = &mut recipe.model;
    model.predict = arguments.predict.clone().or(model.predict.take());
    model.degree = arguments.degree.or(model.degree);
    recipe.library.radial = arguments.radial.or(recipe.library.radial);
    let model = &mut recipe.model;
    model.weight = arguments.weight.clone().or(model.weight.take());
    if let Some(lags) = arguments.lags {
        model.lags = Some(lags);
        (recipe.narx.lags_out, recipe.narx.lags_in) = (None, None);
    }
    apply_time(&mut recipe, &arguments.time)?;
    Ok(recipe)
}

pub(crate) fn apply_time(recipe: &mut Recipe, time: &TimeArgs) -> Result<(), Error> {
    if let Some(column) = &time.time {
        recipe.time.column = Some(column.clone());
        recipe.time.unit = time.time_unit.clone();
        recipe.time.dt = None;
    }
    if let Some(dt) = time.dt {
        recipe.time.dt = Some(dt);
        recipe.time.column = None;
    }
    if let Some(gap) = &time.max_gap {
        recipe.time.max_gap = Some(gap.parse().map_or_else(|_| Gap::Word(gap.clone()), Gap::Seconds));
    }
    recipe.time.only = time.only.clone().or(recipe.time.only.take());
    apply_channels(recipe, &time.channels)
}

fn apply_channels(recipe: &mut Recipe, channels: &ChannelArgs) -> Result<(), Error> {
    if let Some(stamp) = channels.stamp {
        let stamp = match stamp {
            StampArg::Header => Stamp::Header,
            StampArg::Log => Stamp::Log,
            StampArg::Publish => Stamp::Publish,
        };
        recipe.time.stamp = Some(stamp.name().to_owned());
    }
    if channels.base.is_some() || channels.rate.is_some() {
        recipe.time.base = channels.base.clone();
        recipe.time.rate = channels.rate;
    }
    for text in &channels.rename {
        let (ours, file) = pair("--rename", text)?;
        recipe.rename.insert(ours, file);
    }
    Ok(())
}

/// Cache of decoded columns: the user's folder, else one beside the model if the logs are large.
pub(crate) fn cache(channels: &ChannelArgs, model: &std::path::Path) -> Option<Cache> {
    match &channels.cache {
        _ if channels.no_cache => None,
        // Beside a device or a pipe is no place for files.
        None if model.exists() && !is_replaced(model) => None,
        Some(folder) => Some(Cache { folder: folder.clone(), least_bytes: 0 }),
        None => Some(Cache { folder: model.with_file_name(".fleetfoot-cache"), least_bytes: 64 << 20 }),
    }
}

pub(crate) fn pair(flag: &str, text: &str) -> Result<(String, String), Error> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err(Error::value(format!("{flag} {text}: write NAME=VALUE"))),
    }
}

/// Steps of the rollouts that choose open spans; refused where none is open.
pub(crate) fn horizon(recipe: &Recipe, steps: Option<u32>) -> Result<Option<usize>, Error> {
    let open = recipe.states.values().any(|state| state.derivative.as_ref().is_some_and(Derivative::is_open));
    match steps {
        Some(steps) if !open => Err(Error::conflict(format!(
            "--horizon {steps}: only a choice by rollouts uses it; add --derivative STATE=over:auto, or leave --horizon out"
        ))),
        _ => Ok(steps.map(|steps| steps as usize)),
    }
}
