//! The unit of stamps that their size alone tells, and rows at even stamps, where those of the log scatter.

use fleetfoot_check::{Checked, Fault};
use fleetfoot_data::Progress;
use fleetfoot_data::setting::RATE;
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_fit::Error;
use fleetfoot_log::{ClockInfo, inspect_together};
use fleetfoot_recipe::Recipe;

/// The recipe with the clock's column and unit, if the size of the stamps alone tells the unit, and a note on it. A
/// recipe that names the unit stays, and logs that cannot be inspected are reported when they are opened.
pub(crate) fn named(recipe: &Recipe, logs: &Logs, notes: &mut Vec<String>, progress: &dyn Progress) -> Recipe {
    let mut recipe = recipe.clone();
    let time = &mut recipe.time;
    if time.unit.is_some() || time.dt.is_some() {
        return recipe;
    }
    let infos = inspect_together(&logs.files(), false, progress).unwrap_or_default();
    // All logs of a call have one clock in a recipe. One in two columns cannot be named.
    let clocks: Option<Vec<&ClockInfo>> = infos.iter().map(|info| info.clock.as_ref()).collect();
    let Some([clock, others @ ..]) = clocks.as_deref() else { return recipe };
    let same = |other: &&ClockInfo| other.column == clock.column && other.unit == clock.unit && other.beside.is_none();
    let is_other = time.column.as_ref().is_some_and(|column| *column != clock.column);
    if let (Some(unit), Some(assumed), None) = (clock.unit, &clock.assumed, &clock.beside)
        && others.iter().all(same)
        && !is_other
    {
        (time.column, time.unit) = (Some(clock.column.clone()), Some(unit.symbol().to_owned()));
        notes.push(assumed.clone());
    }
    recipe
}

/// Gives the recipe a rate if stamps jitter, come in bursts, or rows are missing between others: models of one step
/// after another need even rows.
///
/// # Errors
/// Those of opening.
pub(crate) fn evened(
    recipe: &mut Recipe,
    checked: &Checked,
    logs: &Logs,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(), Error> {
    let uneven = |fault: Fault| matches!(fault, Fault::Jitter | Fault::Bursts | Fault::Dropped);
    let Some(finding) = checked.findings.iter().find(|finding| uneven(finding.fault)) else { return Ok(()) };
    if recipe.time.rate.is_some() || recipe.time.base.is_some() || recipe.time.dt.is_some() {
        return Ok(());
    }
    let dataset = Dataset::for_columns(recipe, None, logs, progress)?;
    let (rows, nanoseconds) = dataset.episodes().iter().fold((0usize, 0i64), |(rows, span), episode| {
        (rows + episode.rows.saturating_sub(1), span + (episode.end - episode.start))
    });
    if rows == 0 || nanoseconds <= 0 {
        return Ok(());
    }
    let mean = rows as f64 / (nanoseconds as f64 * 1e-9);
    // Of missing rows the mean rate is too low, of bursts the median period tells nothing.
    let rate = match finding.fault {
        Fault::Bursts => mean,
        _ if checked.period > 0.0 => 1.0 / checked.period,
        _ => mean,
    };
    let rate = three_digits(rate);
    recipe.time.rate = Some(rate);
    notes.push(format!("{}: rows are made at {rate} Hz; {RATE} chooses another", finding.what));
    Ok(())
}

/// A number rounded to three digits.
fn three_digits(value: f64) -> f64 {
    let scale = 10f64.powi(2 - value.log10().floor() as i32);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_round() {
        assert_eq!([99.97, 0.012_345, 1234.5].map(three_digits), [100.0, 0.0123, 1230.0]);
    }
}
