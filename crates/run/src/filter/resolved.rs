//! Settings of a filter, and the columns of the logs that it reads.

use fleetfoot_control::filter::{FilterOptions, Measured, NoiseColour, ProcessFactor, SwitchedFilter, Switching};
use fleetfoot_data::setting::{FILTER_SECTION, INITIAL, MEASURED};
use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_dynamics::Stepper;
use fleetfoot_fit::Error;
use fleetfoot_model::{Column, Model, Role};
use fleetfoot_recipe::{FilterNoise, FilterSection, FilterSwitching, Recipe, Settings, Tunable, items};

use crate::controller::source;

/// Settings, resolved on logs.
pub(super) struct ResolvedFilter {
    pub(super) filter: SwitchedFilter,
    pub(super) readings: Reading,
    pub(super) dataset: Dataset,
    pub(super) notes: Vec<String>,
}

/// Columns of the logs' view that a filter reads, as indices.
pub(crate) struct Reading {
    pub(super) inputs: Vec<usize>,
    /// Of every sensor.
    pub(super) measured: Vec<usize>,
    /// Of every sensor whose deviation is a column.
    pub(super) deviations: Vec<Option<usize>>,
    pub(super) truth: Vec<Truth>,
}

/// A state whose truth is known.
pub(super) struct Truth {
    pub(super) state: usize,
    pub(super) column: usize,
}

/// The filter by `[filter]` of a model, without logs: every sensor has a fixed deviation.
///
/// # Errors
/// Settings that cannot be read, sensors without a deviation, and those of [`SwitchedFilter::new`].
pub fn filter_of(model: &Model, section: &FilterSection) -> Result<SwitchedFilter, Error> {
    let recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    let settings = section.clone().over(recipe.filter);
    let measured = measured(settings.measured.as_deref())?;
    if let Some(open) = measured.iter().find(|sensor| sensor.deviation.is_none()) {
        return Err(Error::missing(format!(
            "{entry}: {} has no standard deviation, and there is no log to estimate it from: write measured = \"{}=0.01\"",
            open.state,
            open.state,
            entry = FILTER_SECTION.entry("measured")
        )));
    }
    Ok(SwitchedFilter::new(model, &options(&settings, measured)?)?)
}

/// Settings of `[filter]` about a model's states: checked, and in the fields of logs.
struct Signals<'a> {
    model: &'a Model,
    sensors: Vec<Measured>,
    /// Fields of measurements, if they differ from those of the training.
    fields: Vec<(String, String)>,
    truth: Vec<(String, String)>,
}

/// The columns that a filter reads of logs.
struct Columns<'a> {
    model: &'a Model,
    columns: Vec<Column>,
}

impl<'a> Signals<'a> {
    fn new(model: &'a Model, settings: &FilterSection, states: &[String]) -> Result<Self, Error> {
        let recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
        // An alias of the recipe, a field, or an expression over fields.
        let meant = |(state, name): (String, String)| (state, source(&recipe, &name));
        let signals = Self {
            model,
            sensors: measured(settings.measured.as_deref())?,
            fields: named("sensors", settings.sensors.as_deref())?.into_iter().map(meant).collect(),
            truth: named("truth", settings.truth.as_deref())?.into_iter().map(meant).collect(),
        };
        let all = (signals.sensors.iter().map(|sensor| ("measured", &sensor.state)))
            .chain(signals.fields.iter().map(|field| ("sensors", &field.0)))
            .chain(signals.truth.iter().map(|truth| ("truth", &truth.0)));
        for (of, state) in all {
            if !states.contains(state) {
                let problem = format!(
                    "{entry}: the model has no state `{state}`; there is {}",
                    states.join(", "),
                    entry = FILTER_SECTION.entry(of)
                );
                return Err(Error::unknown(state, problem));
            }
        }
        Ok(signals)
    }

    /// Field of a state's measurement.
    fn measurement(&self, state: &str) -> String {
        let configured = self.fields.iter().find(|(name, _)| name == state).map(|(_, field)| field.clone());
        let trained = || self.model.column(state).map(|at| self.model.columns[at].source.clone());
        configured.or_else(trained).unwrap_or_else(|| state.to_owned())
    }
}

impl<'a> Columns<'a> {
    /// Those of the model with these names.
    fn of(model: &'a Model, names: &[String]) -> Self {
        let columns = model.columns.iter().filter(|column| names.contains(&column.name)).cloned().collect();
        Self { model, columns }
    }

    /// One more, under a name that nothing has.
    fn add(&mut self, prefix: &str, state: &str, source: String) -> String {
        let mut name = format!("{prefix}_{state}");
        while self.model.column(&name).is_some() {
            name.push('_');
        }
        self.columns.push(Column {
            name: name.clone(),
            source,
            unit: None,
            role: Role::Auxiliary,
            angle: false,
            rotation: None,
        });
        name
    }
}

impl ResolvedFilter {
    pub(super) fn new(
        model: &Model,
        changes: &Recipe,
        settings: &FilterSection,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let stepper = Stepper::new(model)?;
        let states: Vec<String> = stepper.states().map(str::to_owned).collect();
        let inputs: Vec<String> = stepper.inputs().map(str::to_owned).collect();
        let mut signals = Signals::new(model, settings, &states)?;
        let recipe = Dataset::recipe_of_run(model, changes)?;
        if signals.sensors.is_empty() {
            let places: Vec<String> = states.iter().map(|state| signals.measurement(state)).collect();
            let there = Dataset::readable(&recipe, logs, &places)?;
            let all = states.iter().zip(there).filter(|(_, there)| *there);
            signals.sensors = all.map(|(state, _)| Measured { state: state.clone(), deviation: None }).collect();
        }
        let sensors = &signals.sensors;
        let names: Vec<String> =
            sensors.iter().map(|sensor| format!("{}_deviation", signals.measurement(&sensor.state))).collect();
        let there = Dataset::readable(&recipe, logs, &names)?;
        // Only the columns that the filter reads: other states may be missing.
        let mut columns = Columns::of(model, &inputs);
        let measured: Vec<String> = sensors
            .iter()
            .map(|sensor| columns.add("measured", &sensor.state, signals.measurement(&sensor.state)))
            .collect();
        let deviations: Vec<Option<String>> = (sensors.iter().zip(names).zip(there))
            .map(|((sensor, name), there)| {
                (there && sensor.deviation.is_none()).then(|| columns.add("deviation", &sensor.state, name))
            })
            .collect();
        let truth: Vec<String> =
            signals.truth.iter().map(|(state, field)| columns.add("true", state, field.clone())).collect();
        let dataset = Dataset::for_filter(model, &columns.columns, changes, logs, progress)?;
        let filter = SwitchedFilter::new(model, &options(settings, sensors.clone())?)?;
        let readings = {
            let view = dataset.view()?;
            let place = |name: &String| {
                let column_index = view.column_index(name);
                column_index
                    .ok_or_else(|| Error::unknown(name, format!("the logs have no {name}, which the filter reads")))
            };
            let truth = signals.truth.iter().zip(&truth).map(|((true_state, _), name)| {
                let state = states.iter().position(|state| state == true_state).unwrap_or(0);
                Ok::<_, Error>(Truth { state, column: place(name)? })
            });
            Reading {
                inputs: inputs.iter().map(place).collect::<Result<_, _>>()?,
                measured: measured.iter().map(place).collect::<Result<_, _>>()?,
                deviations: deviations
                    .iter()
                    .map(|deviation| deviation.as_ref().map(place).transpose())
                    .collect::<Result<_, _>>()?,
                truth: truth.collect::<Result<_, _>>()?,
            }
        };
        let notes = notes(&filter, sensors, &readings);
        Ok(Self { filter, readings, dataset, notes })
    }
}

/// Assumptions.
fn notes(filter: &SwitchedFilter, sensors: &[Measured], readings: &Reading) -> Vec<String> {
    let mut notes = Vec::new();
    let names = |wanted: &dyn Fn(usize) -> bool| -> Vec<&str> {
        (0..sensors.len()).filter(|&k| wanted(k)).map(|k| sensors[k].state.as_str()).collect()
    };
    let by_column = names(&|k| readings.deviations[k].is_some());
    if !by_column.is_empty() {
        notes.push(format!(
            "the deviations of {} are those of the log's columns; smoothed states share the errors of their neighbours, which the filter takes for independent",
            by_column.join(", ")
        ));
    }
    let names = names(&|k| readings.deviations[k].is_none() && sensors[k].deviation.is_none());
    if !names.is_empty() {
        notes.push(format!(
            "the deviations of {} are estimated from the innovations so far; write them if they are known ({})",
            names.join(", "),
            MEASURED.to(format_args!("{}=0.01", names[0]))
        ));
    }
    let open = |&s: &usize| !filter.has_mean(s) && filter.measured().all(|state| state != s);
    let open: Vec<String> = (0..filter.states().len()).filter(open).map(|s| filter.states()[s].clone()).collect();
    if !open.is_empty() {
        let list = open.join(", ");
        notes.push(format!(
            "{list} begin at 0, because no measurement and no training row gives a start: {}",
            INITIAL.to(format_args!("{}=MEAN:DEVIATION", open[0]))
        ));
    }
    notes
}

fn options(settings: &FilterSection, measured: Vec<Measured>) -> Result<FilterOptions, Error> {
    let initial = list(settings.initial.as_deref()).into_iter().map(|item| {
        let parsed = item.rsplit_once('=').and_then(|(name, value)| {
            let (mean, deviation) = value.split_once(':')?;
            Some((name.trim().to_owned(), mean.trim().parse().ok()?, deviation.trim().parse().ok()?))
        });
        parsed.ok_or_else(|| {
            Error::value(format!(
                "{entry}: write STATE=MEAN:DEVIATION, several separated by commas",
                entry = FILTER_SECTION.entry("initial").is(item)
            ))
        })
    });
    Ok(FilterOptions {
        measured,
        initial: initial.collect::<Result<_, _>>()?,
        process: match &settings.process {
            None => ProcessFactor::default(),
            Some(Tunable::Number(factor)) => ProcessFactor::Given(*factor),
            Some(Tunable::Word(word)) if word == "auto" => ProcessFactor::Estimated,
            Some(word) => {
                return Err(Error::value(format!(
                    "{entry}: write a number, or \"auto\"",
                    entry = FILTER_SECTION.entry("process").is(word)
                )));
            }
        },
        noise: match settings.noise.unwrap_or_default() {
            FilterNoise::Auto => NoiseColour::FromResiduals,
            FilterNoise::White => NoiseColour::White,
            FilterNoise::Coloured => NoiseColour::Coloured,
        },
        switching: match settings.switching.unwrap_or_default() {
            FilterSwitching::State => Switching::State,
            FilterSwitching::Transitions => Switching::Transitions,
        },
    })
}

/// The items of an entry; an empty text has none.
fn list(text: Option<&str>) -> Vec<String> {
    text.filter(|text| !text.trim().is_empty()).map(items).unwrap_or_default()
}

/// `x=0.01,v`.
fn measured(text: Option<&str>) -> Result<Vec<Measured>, Error> {
    let one = |item: String| match item.split_once('=') {
        None => Ok(Measured { state: item.trim().to_owned(), deviation: None }),
        Some(_) => {
            let (state, deviation) = crate::control::pair(&FILTER_SECTION.entry("measured").to_string(), &item)?;
            Ok(Measured { state, deviation: Some(deviation) })
        }
    };
    list(text).into_iter().map(one).collect()
}

/// `x=/truth.x`.
fn named(entry: &str, text: Option<&str>) -> Result<Vec<(String, String)>, Error> {
    let one = |item: String| match item.split_once('=') {
        Some((state, field)) => Ok((state.trim().to_owned(), field.trim().to_owned())),
        None => Err(Error::value(format!(
            "{entry}: write STATE=FIELD, several separated by commas",
            entry = FILTER_SECTION.entry(entry).is(item)
        ))),
    };
    list(text).into_iter().map(one).collect()
}
