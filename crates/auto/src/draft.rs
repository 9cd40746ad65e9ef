//! States, inputs and angles that a recipe does not name, found by the names of columns and by their motion.

use crate::driven;
use fleetfoot_check::name_words;
use fleetfoot_data::setting::{INFO, INIT, INPUTS, STATES};
use fleetfoot_data::{ColumnKind, Halo, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_fit::Error;
use fleetfoot_log::{FileInfo, inspect_together};
use fleetfoot_recipe::{Input, InputTable, Kind, Recipe, State, draft_of_odometry, draft_of_topics, is_named_angle};

/// Rows of an episode, and episodes, that are read.
const ROWS: usize = 20_000;
const EPISODES: usize = 8;
/// Words in the names of inputs.
const INPUT_NAMES: [&str; 36] = [
    "u",
    "in",
    "input",
    "inputs",
    "cmd",
    "command",
    "commanded",
    "control",
    "ctrl",
    "voltage",
    "volt",
    "volts",
    "torque",
    "tau",
    "force",
    "throttle",
    "pwm",
    "motor",
    "motors",
    "valve",
    "steer",
    "steering",
    "brake",
    "setpoint",
    "sp",
    "ref",
    "reference",
    "desired",
    "des",
    "duty",
    "pump",
    "heater",
    "actuator",
    "servo",
    "elevator",
    "aileron",
];
/// Words of inputs, whatever stands beside them: `cmd_vel`.
const COMMANDS: [&str; 9] =
    ["cmd", "command", "commanded", "setpoint", "ref", "reference", "desired", "input", "inputs"];
/// Words that mark a measurement among the names of inputs: `motor_speed`.
const MEASURED: [&str; 12] = [
    "measured",
    "meas",
    "actual",
    "position",
    "pos",
    "velocity",
    "vel",
    "speed",
    "angle",
    "temperature",
    "temp",
    "rate",
];
/// Words of labels and counters.
const LABELS: [&str; 12] =
    ["region", "mode", "id", "label", "index", "seq", "count", "counter", "class", "flag", "status", "episode"];
/// An input is held from row to row in this share of the rows, and moves by so many standard deviations where it moves.
const HELD: f64 = 0.6;
const STEP: f64 = 0.05;
/// A column of whole numbers with fewer values is a label.
const VALUES: usize = 10;

/// The part that a column plays in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    State { angle: bool },
    Input,
    LeftOut(&'static str),
}

/// The recipe with states and inputs, and notes on them. A recipe with states stays unchanged.
///
/// # Errors
/// Those of opening; no column that can be a state.
pub(crate) fn drafted(
    recipe: &Recipe,
    logs: &Logs,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Recipe, Error> {
    if !recipe.states.is_empty() {
        return Ok(recipe.clone());
    }
    let infos = inspect_together(&logs.files(), false, progress).map_err(fleetfoot_dataset::Error::from)?;
    let mut draft = match infos
        .first()
        .and_then(|info| draft_of_topics(recipe, info).or_else(|| draft_of_odometry(info)))
    {
        Some(draft) => merged(recipe, draft),
        None if infos.iter().any(|info| !info.topics.is_empty()) => {
            return Err(Error::missing(format!(
                "these logs have no odometry, joints or attitude that a draft recognises: {INIT} lists their fields; name states and inputs there (-c), or with {STATES} and {INPUTS}"
            )));
        }
        None => of_table(recipe, logs, &infos, notes, progress)?,
    };
    draft.cache.clone_from(&recipe.cache);
    if draft.states.is_empty() {
        return Err(Error::missing(format!(
            "no column of these logs looks like a state; name the states with {STATES}, or in a recipe (-c): {INFO} lists the columns"
        )));
    }
    let names = |names: Vec<&String>| names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    notes
        .push(format!("states by names and motion: {}; {STATES} chooses others", names(draft.states.keys().collect())));
    notes.push(match draft.inputs.is_empty() {
        true => format!(
            "no column looks like an input, so the model has none; {INPUTS} names the columns that drive the machine"
        ),
        false => format!("inputs: {}; {INPUTS} chooses others", names(draft.inputs.keys().collect())),
    });
    Ok(draft)
}

/// Merges a recipe over a draft.
fn merged(recipe: &Recipe, draft: Recipe) -> Recipe {
    let mut merged_recipe = recipe.clone();
    merged_recipe.states = draft.states;
    for (name, column) in draft.columns {
        merged_recipe.columns.entry(name).or_insert(column);
    }
    for (name, input) in draft.inputs {
        merged_recipe.inputs.entry(name).or_insert(input);
    }
    merged_recipe.states.retain(|name, _| !merged_recipe.inputs.contains_key(name));
    merged_recipe
}

fn of_table(
    recipe: &Recipe,
    logs: &Logs,
    infos: &[FileInfo],
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Recipe, Error> {
    let open = Recipe { inputs: Default::default(), ..recipe.clone() };
    let dataset = Dataset::for_columns(&open, None, logs, progress)?;
    let view = dataset.view()?;
    let clocks: Vec<&str> = infos.iter().filter_map(|info| Some(info.clock.as_ref()?.column.as_str())).collect();
    let mut columns: Vec<Vec<Vec<f64>>> = vec![Vec::new(); view.columns().len()];
    for (at, episode) in view.episodes().iter().enumerate().take(EPISODES) {
        let block = view.read(at, 0..episode.rows.min(ROWS), Halo::default())?;
        columns.iter_mut().enumerate().for_each(|(place, target)| target.push(block.core(place).to_vec()));
    }
    let mut draft = recipe.clone();
    let mut left_out: Vec<String> = Vec::new();
    let mut states: Vec<(String, usize)> = Vec::new();
    for (place, column) in view.columns().iter().enumerate() {
        let name = &column.name;
        if recipe.inputs.contains_key(name) || recipe.time.column.as_ref() == Some(name) {
            continue;
        }
        let part = match &column.kind {
            ColumnKind::Category(_) => Part::LeftOut("text"),
            _ if clocks.contains(&name.as_str()) => continue,
            _ if columns[..place].contains(&columns[place]) => Part::LeftOut("the same as another column"),
            kind => part(name, *kind != ColumnKind::Float, &columns[place]),
        };
        match part {
            Part::State { angle } => {
                let kind = angle.then_some(Kind::Angle);
                if !angle {
                    states.push((name.clone(), place));
                }
                draft.states.insert(name.clone(), State { kind, ..State::default() });
            }
            // Columns that are named as inputs by hand make the other columns states.
            Part::Input if recipe.inputs.is_empty() => {
                draft.inputs.insert(name.clone(), Input::Table(InputTable::default()));
            }
            Part::Input => {
                left_out.push(format!("`{name}` (an input by its name or motion, but other inputs are named)"))
            }
            Part::LeftOut(why) => left_out.push(format!("`{name}` ({why})")),
        }
    }
    if draft.inputs.is_empty() {
        let values: Vec<&[Vec<f64>]> = states.iter().map(|(_, place)| columns[*place].as_slice()).collect();
        for at in driven::drivers(&values) {
            let name = &states[at].0;
            draft.states.shift_remove(name);
            draft.inputs.insert(name.clone(), Input::Table(InputTable::default()));
            notes.push(format!(
                "`{name}` is an input: its past predicts other columns, and their past does not predict it; {STATES} makes it a state"
            ));
        }
    }
    if !left_out.is_empty() {
        notes.push(format!("left out: {}", left_out.join(", ")));
    }
    Ok(draft)
}

/// The part of a column, by its name and its values in every episode.
pub(crate) fn part(name: &str, whole: bool, episodes: &[Vec<f64>]) -> Part {
    let values = || episodes.iter().flatten().copied().filter(|value| value.is_finite());
    let count = values().count() as f64;
    if count == 0.0 {
        return Part::LeftOut("no values");
    }
    let mean = values().sum::<f64>() / count;
    let deviation = (values().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
    let (least, most) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if least == most {
        return Part::LeftOut("constant");
    }
    let words = name_words(name);
    let has = |list: &[&str]| words.iter().any(|word| list.contains(&word.as_str()));
    if has(&LABELS) {
        return Part::LeftOut("a label or a counter by its name");
    }
    let mut steps: Vec<f64> = episodes
        .iter()
        .flat_map(|episode| episode.windows(2).map(|pair| pair[1] - pair[0]))
        .filter(|step| step.is_finite())
        .collect();
    if !steps.is_empty() && is_clock(&steps) {
        return Part::LeftOut("a clock or a counter: it grows evenly");
    }
    let numbered_motor = words.first().is_some_and(|word| word == "m") && words.len() == 2;
    if has(&COMMANDS) || (has(&INPUT_NAMES) || numbered_motor) && !has(&MEASURED) {
        return Part::Input;
    }
    let total = steps.len().max(1) as f64;
    let turns = steps.iter().filter(|step| (step.abs() - 2.0 * std::f64::consts::PI).abs() < 0.5).count();
    steps.retain(|step| *step != 0.0);
    let held = 1.0 - steps.len() as f64 / total;
    if whole && distinct(values()) < VALUES {
        return Part::LeftOut("few whole numbers: a label");
    }
    if held > HELD && !steps.is_empty() {
        let middle = steps.len() / 2;
        let typical = steps.select_nth_unstable_by(middle, |a, b| a.abs().total_cmp(&b.abs())).1.abs();
        if typical > STEP * deviation {
            return Part::Input;
        }
    }
    let round = std::f64::consts::PI * 2.0 + 1e-3;
    let angle = most - least <= round && (turns > 0 || is_named_angle(name) && most - least > round / 2.0);
    Part::State { angle }
}

/// Steps that are all positive and nearly equal.
fn is_clock(steps: &[f64]) -> bool {
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let spread = (steps.iter().map(|step| (step - mean).powi(2)).sum::<f64>() / steps.len() as f64).sqrt();
    mean > 0.0 && steps.iter().all(|step| *step > 0.0) && spread < 1e-3 * mean
}

/// Number of distinct values, up to [`VALUES`].
fn distinct(values: impl Iterator<Item = f64>) -> usize {
    let mut seen: Vec<f64> = Vec::new();
    for value in values {
        if !seen.contains(&value) {
            seen.push(value);
            if seen.len() >= VALUES {
                break;
            }
        }
    }
    seen.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, value: impl Fn(f64) -> f64) -> Part {
        part(name, false, &[(0..2000).map(|row| value(f64::from(row))).collect()])
    }

    #[test]
    fn names_and_motion_decide_column_roles() {
        let wave = |row: f64| (0.02 * row).sin();
        assert_eq!(of("velocity", wave), Part::State { angle: false });
        for name in ["u", "u1", "cmd_vel_x_input", "motorVoltage", "steering", "m2"] {
            assert_eq!(of(name, wave), Part::Input, "{name}");
        }
        assert_eq!(of("motor_speed", wave), Part::State { angle: false });
        // Held for twenty rows, then another value.
        assert_eq!(of("q", |row| (1.7 * (row / 20.0).floor()).sin()), Part::Input);
        // An encoder of coarse steps is held, too, and steps are small.
        assert_eq!(of("q", |row| (40.0 * (0.002 * row).sin()).round() / 40.0), Part::State { angle: false });
        assert_eq!(
            of("yaw", |row| (0.01 * row + 3.0).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI),
            Part::State { angle: true }
        );
        assert_eq!(of("a", |_| 2.0), Part::LeftOut("constant"));
        assert!(matches!(of("k", |row| 0.5 * row), Part::LeftOut(_)));
        assert!(matches!(of("region", wave), Part::LeftOut(_)));
    }
}
