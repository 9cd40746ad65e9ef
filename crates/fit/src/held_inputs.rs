//! Note on inputs that step from row to row beside derivatives by central differences.
//!
//! A central difference is about the mean slope over the rows beside it. An input that steps between two of these rows
//! has another mean there than its value in the row, so that least squares pull its coefficients towards zero.

use fleetfoot_data::setting::{OBJECTIVE, PREDICT};
use fleetfoot_data::{Halo, Source};
use fleetfoot_library::CentralDifference;
use fleetfoot_model::{Model, Role};

use crate::error::Error;

/// Rows that are looked at, at most.
const ROWS: usize = 50_000;
/// Rows that tell it at least.
const FEWEST: usize = 20;
/// Share of the rows that repeat the value before, from which on an input is held.
const HELD: f64 = 0.3;
/// Squared steps over the variance of an input: at least, if it is held.
const STEPS_OF_HELD: f64 = 0.005;
/// And if no value repeats, so that noise of a measured input is no step.
const STEPS: f64 = 0.5;
/// Squared second differences over those of two rows apart: 0 for a smooth curve, 1 for steps, 3 for white noise.
const BENT: f64 = 0.5;

/// The note, if a fitted equation of the model has a central difference and an input steps.
///
/// # Errors
/// Those of reading.
pub(crate) fn note(model: &Model, rows: &dyn Source) -> Result<Option<String>, Error> {
    let is_central = |target| CentralDifference::recognised(target).is_some();
    if !model.fitted().filter_map(|equation| equation.target.as_ref()).any(is_central) {
        return Ok(None);
    }
    let mut stepping = Vec::new();
    for input in model.columns.iter().filter(|column| column.role == Role::Input) {
        if let Some(column) = rows.column_index(&input.name)
            && steps(rows, column)?
        {
            stepping.push(format!("`{}`", input.name));
        }
    }
    let (named, verb) = (stepping.join(", "), if stepping.len() == 1 { "steps" } else { "step" });
    Ok((!stepping.is_empty()).then(|| {
        format!(
            "{named} {verb} between rows, and central differences straddle the steps: coefficients are biased towards zero, the more the shorter a value is held; {delta} or {simulated} has no such bias",
            delta = PREDICT.to("delta"),
            simulated = OBJECTIVE.to("steps:20"),
        )
    }))
}

/// Returns true if a column is held and steps, or changes at random in every row.
fn steps(rows: &dyn Source, column: usize) -> Result<bool, Error> {
    let (mut count, mut repeats, mut left) = (0.0, 0.0, ROWS);
    let (mut sum, mut squares, mut first, mut apart, mut second) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (at, episode) in rows.episodes().iter().enumerate() {
        let counted = episode.rows.min(left);
        left -= counted;
        let block = rows.read(at, 0..counted, Halo::default())?;
        for x in block.core(column).windows(3).filter(|x| x.iter().all(|x| x.is_finite())) {
            count += 1.0;
            repeats += f64::from(u8::from(x[2] == x[1]));
            sum += x[2];
            squares += x[2] * x[2];
            first += (x[2] - x[1]).powi(2);
            apart += (x[2] - x[0]).powi(2);
            second += (x[2] - 2.0 * x[1] + x[0]).powi(2);
        }
    }
    let variance = squares / count - (sum / count).powi(2);
    let least = if repeats > HELD * count { STEPS_OF_HELD } else { STEPS };
    Ok(count >= FEWEST as f64 && second > BENT * apart && first > least * variance * count && apart > 0.0)
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    fn steps_of(value: impl FnMut(usize) -> f64) -> bool {
        let mut source = MemorySource::new(vec![Column::float("u")]);
        source.push_uniform("a", 0.01, vec![(0..2000).map(value).collect()]);
        steps(&source, 0).unwrap()
    }

    fn random(at: usize) -> f64 {
        (fleetfoot_data::mix(at as u64) >> 11) as f64 * 2.0_f64.powi(-53) - 0.5
    }

    #[test]
    fn held_and_white_inputs_step() {
        for held in [1, 2, 5, 17, 100] {
            assert!(steps_of(|row| random(row / held)), "held for {held} rows");
        }
        assert!(steps_of(|row| f64::from(u8::from(row / 40 % 2 == 0))), "a square wave");
    }

    #[test]
    fn smooth_inputs_do_not_step() {
        let wave = |row: usize| (0.02 * row as f64).sin();
        assert!(!steps_of(wave), "a sine");
        assert!(!steps_of(|row| wave(row) + 0.05 * random(row)), "a measured sine");
        assert!(!steps_of(|row| (wave(row) * 100.0).round() / 100.0), "a quantised sine");
        assert!(!steps_of(|_| 1.0), "a constant");
    }
}
