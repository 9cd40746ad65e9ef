//! The columns of a recipe that preparation reads, and those that it writes.

use fleetfoot_data::setting::STATES_SECTION;
use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_dataset::Error;
use fleetfoot_library::Expr;
use fleetfoot_model::{Column as ModelColumn, Role};
use fleetfoot_recipe::{Derivative, Input, InputTable, Recipe, State};
use fleetfoot_task::rate_unit;

use crate::options::{ChannelOptions, check_channels};

/// A column of the view, and its treatment.
pub(crate) struct Planned {
    pub(crate) name: String,
    pub(crate) angle: bool,
    pub(crate) unit: Option<String>,
    pub(crate) kind: ColumnKind,
    /// States and inputs alone are prepared.
    pub(crate) options: Option<ChannelOptions>,
}

impl Planned {
    /// Plans of the columns of a view.
    pub(crate) fn all(recipe: &Recipe, model: &[ModelColumn], view: &[Column]) -> Result<Vec<Self>, Error> {
        check_channels(recipe)?;
        let of_view = |column: &ModelColumn| view.iter().find(|viewed| viewed.name == column.name);
        let plan = |column: &ModelColumn| {
            let kind = of_view(column).map_or(ColumnKind::Float, |viewed| viewed.kind.clone());
            let is_channel = column.role != Role::Auxiliary && !matches!(kind, ColumnKind::Category(_));
            let is_state = column.role == Role::State;
            let options = is_channel.then(|| ChannelOptions::new(recipe, &column.name, is_state)).transpose()?;
            Ok(Self { name: column.name.clone(), angle: column.angle, unit: column.unit.clone(), kind, options })
        };
        model.iter().map(plan).collect()
    }

    /// Number of derivatives that are written beside the value.
    pub(crate) fn rates(&self) -> usize {
        self.options.map_or(0, |options| options.method.rates())
    }

    /// Returns true if standard deviations are written.
    pub(crate) fn has_deviations(&self) -> bool {
        self.options.is_some_and(|options| options.method.is_smoothing())
    }

    /// The names of the value and its derivatives.
    pub(crate) fn names(&self) -> Vec<String> {
        let suffixes = ["", "_dot", "_ddot"];
        (0..=self.rates()).map(|k| format!("{}{}", self.name, suffixes[k])).collect()
    }

    /// The units of the value and its derivatives.
    pub(crate) fn units(&self) -> Vec<Option<String>> {
        let next = |unit: &Option<String>| Some(unit.as_deref().map(rate_unit));
        std::iter::successors(Some(self.unit.clone()), next).take(self.rates() + 1).collect()
    }
}

/// A name as it stands in an expression.
pub(crate) fn quoted(name: &str) -> String {
    Expr::column(name).to_string()
}

/// The recipe of the written files, ready for `fit`.
pub(crate) fn written_recipe(read: &Recipe, planned: &[Planned], time: &str, smoothed: f64) -> Result<Recipe, Error> {
    let mut recipe = read.clone();
    recipe.columns.clear();
    recipe.join.clear();
    recipe.rename.clear();
    recipe.files.clear();
    recipe.channels.clear();
    recipe.clocks.clear();
    recipe.body = None;
    recipe.joint.clear();
    recipe.sensor.clear();
    recipe.prepare = Default::default();
    recipe.episodes.clear();
    recipe.time = fleetfoot_recipe::Time {
        column: Some(time.to_owned()),
        // A file is an episode.
        max_gap: Some(fleetfoot_recipe::Gap::Word("none".into())),
        smoothed: Some(smoothed).filter(|&seconds| seconds > 0.0),
        ..fleetfoot_recipe::Time::default()
    };
    recipe.pwa.purge = recipe.pwa.purge.map(|gap| gap.max(smoothed));
    recipe.states.clear();
    let differentiates = matches!(read.model.predict.as_deref(), None | Some("derivative"));
    for (name, state) in &read.states {
        let mut state = State { column: None, ..state.clone() };
        let plan = planned.iter().find(|candidate| candidate.name == *name);
        let names = plan.map(Planned::names).unwrap_or_default();
        let is_open = match &state.derivative {
            None => true,
            Some(Derivative::Text(word)) => word == "auto",
            Some(Derivative::Span(_)) => false,
        };
        let second_order = plan.and_then(|planned| planned.options).is_some_and(|options| options.second_order);
        if names.len() > 2 && second_order && state.known.is_none() {
            if read.states.contains_key(&names[1]) {
                let problem = format!(
                    "{}: its rate is measured; remove second_order from `{name}`",
                    STATES_SECTION.entry(&names[1])
                );
                return Err(Error::name_taken(&names[1], problem));
            }
            let rate = State {
                kind: None,
                known: None,
                unit: None,
                derivative: Some(Derivative::Text(quoted(&names[2]))),
                ..state.clone()
            };
            state = State {
                known: Some(quoted(&names[1])),
                kind: state.kind,
                unit: state.unit,
                regressor: state.regressor,
                ..State::default()
            };
            recipe.states.insert(name.clone(), state);
            recipe.states.insert(names[1].clone(), rate);
            continue;
        }
        if names.len() > 1 && is_open && differentiates && state.known.is_none() {
            state.derivative = Some(Derivative::Text(quoted(&names[1])));
        }
        recipe.states.insert(name.clone(), state);
    }
    for input in recipe.inputs.values_mut() {
        *input = Input::Table(InputTable { column: None, ..input.table() });
    }
    Ok(recipe)
}
