//! Inputs that act late, as columns of a recipe.

use fleetfoot_data::Progress;
use fleetfoot_dataset::Logs;
use fleetfoot_fit::{Error, late_inputs};
use fleetfoot_model::Column;
use fleetfoot_recipe::{Input, InputTable, Recipe};

use crate::candidates::Variant;

/// Delay in rows that the models of every candidate have already.
const USUAL: usize = 2;
/// End of the name of an input that is moved.
const LATE: &str = "_late";

/// A moved input of a model and the column that it is, as an equation; `None` of other columns.
pub(crate) fn definition(column: &Column, recipe: &Recipe) -> Option<String> {
    let input = column.name.strip_suffix(LATE)?;
    recipe.inputs.contains_key(input).then(|| format!("{} = {}", column.name, column.source))
}

/// The recipe with its late inputs moved; its name says by how many rows, as its columns do. A delay is at most `most` rows: those in front
/// of every simulation. `None` if no input is late.
///
/// # Errors
/// Those of reading.
pub(crate) fn moved(
    recipe: &Recipe,
    logs: &Logs,
    most: usize,
    progress: &dyn Progress,
) -> Result<Option<Variant>, Error> {
    let mut late = late_inputs(recipe, logs, [USUAL, most], progress)?;
    if late.is_empty() {
        return Ok(None);
    }
    // A model of the next row reads the input of this one, which is a row late already.
    late.iter_mut().for_each(|(_, rows)| *rows -= 1);
    let mut moved = recipe.clone();
    for (name, rows) in &late {
        let Some(input) = moved.inputs.shift_remove(name) else { continue };
        let table = input.table();
        let of = table.column.clone().unwrap_or_else(|| format!("`{name}`"));
        let column = Some(format!("lag({of}, {rows})"));
        moved.inputs.insert(format!("{name}{LATE}"), Input::Table(InputTable { column, ..table }));
    }
    let delays: Vec<String> = late.iter().map(|(name, rows)| format!("{name} {rows}")).collect();
    Ok(Some(Variant { name: format!("late by rows ({})", delays.join(", ")), recipe: moved }))
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use fleetfoot_data::Silent;

    use super::*;

    /// The late input of `y(k) = 0.9 y(k-1) + 0.1 u(k-late)`: the name of the recipe, and the column.
    fn late(state: &str, late: usize, u: impl Fn(usize) -> f64) -> Option<[String; 2]> {
        let folder = tempfile::tempdir().unwrap();
        let (mut text, mut y) = ("y,u\n".to_owned(), 0.0);
        for row in 0..3000usize {
            y = 0.9 * y + row.checked_sub(late).map_or(0.0, |row| 0.1 * u(row));
            writeln!(text, "{y},{}", u(row)).unwrap();
        }
        let file = folder.path().join("a.csv");
        std::fs::write(&file, text).unwrap();
        let text = format!("[states]\ny = {state}\n[inputs]\nu = {{}}\n[time]\ndt = 0.01\n");
        let recipe = Recipe::parse(&text, "test").unwrap();
        let Variant { name, recipe } = moved(&recipe, &Logs::from(&[file][..]), 30, &Silent).unwrap()?;
        Some([name, recipe.inputs["u_late"].table().column.unwrap()])
    }

    #[test]
    fn only_late_inputs_are_moved() {
        let held = |row: usize| (0.37 * (row / 7 * 7) as f64).sin() + (0.11 * row as f64).cos();
        // An angle is seen as its cosine and its sine.
        for state in ["{}", "{ kind = \"angle\" }"] {
            let moved = Some(["late by rows (u 16)".to_owned(), "lag(`u`, 16)".to_owned()]);
            assert_eq!(late(state, 17, held), moved, "{state}");
            assert_eq!(late(state, 1, held), None, "{state}");
        }
    }

    /// A tone has the same value again after every period: the past of the state explains it.
    #[test]
    fn a_tone_in_time_is_not_late() {
        assert_eq!(late("{}", 1, |row| (0.02 * row as f64).sin() + 0.3), None);
    }
}
