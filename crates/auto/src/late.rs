//! Inputs that act late, by the correlation of a state's innovations with the inputs of earlier rows.

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Error;
use fleetfoot_recipe::{Input, InputTable, Recipe};

/// Delays that the models of every candidate have already.
const USUAL: usize = 2;
/// The least correlation of a late input, and how much larger it must be than that of one in time.
const LEAST: f64 = 0.1;
const LARGER: f64 = 1.2;
/// Rows that are read.
const ROWS: usize = 50_000;

/// A recipe whose late inputs are moved, and the delays in rows by the name of the input.
pub(crate) type Moved = (Recipe, Vec<(String, usize)>);

/// The recipe with its late inputs moved, and the delays in rows by the name of the input. A delay is at most `most`
/// rows: those in front of every simulation. `None` if no input is late.
///
/// # Errors
/// Those of reading.
pub(crate) fn moved(recipe: &Recipe, rows: &dyn Source, most: usize) -> Result<Option<Moved>, Error> {
    let place = |name: &String| rows.columns().iter().position(|column| column.name == *name);
    let states: Vec<usize> = recipe.states.keys().filter_map(place).collect();
    let mut late: Vec<(String, usize)> = Vec::new();
    for name in recipe.inputs.keys() {
        let Some(input) = place(name) else { continue };
        let delays = states.iter().map(|&state| delay(rows, [state, input], most)).collect::<Result<Vec<_>, _>>()?;
        // That of the state which the input moves most.
        let strongest = delays.into_iter().flatten().max_by(|a, b| a.1.total_cmp(&b.1));
        late.extend(strongest.filter(|(rows, _)| *rows > USUAL).map(|(rows, _)| (name.clone(), rows)));
    }
    if late.is_empty() {
        return Ok(None);
    }
    let mut found = recipe.clone();
    for (name, rows) in &late {
        let Some(input) = found.inputs.shift_remove(name) else { continue };
        let table = input.table();
        let of = table.column.clone().unwrap_or_else(|| format!("`{name}`"));
        // A model of the next row reads the input of this one, which is a row late already.
        let column = Some(format!("lag({of}, {})", rows - 1));
        found.inputs.insert(format!("{name}_late"), Input::Table(InputTable { column, ..table }));
    }
    Ok(Some((found, late)))
}

/// By how many rows a state follows an input late, and the correlation there; `None` where it is in time, or does not follow.
fn delay(rows: &dyn Source, [state, input]: [usize; 2], most: usize) -> Result<Option<(usize, f64)>, Error> {
    // Sums over rows of the correlation at every delay: rows, u, e, u^2, e^2, u e.
    let mut sums = vec![[0.0f64; 6]; most + 2];
    let mut left = ROWS;
    for (at, episode) in rows.episodes().iter().enumerate() {
        let count = episode.rows.min(left);
        left -= count;
        let block = rows.read(at, 0..count, Halo::default())?;
        let (x, u) = (block.core(state), block.core(input));
        let rest = innovations(x);
        for (delay, sums) in sums.iter_mut().enumerate() {
            for (e, u) in rest.iter().skip(delay).zip(u) {
                if (e * u).is_finite() {
                    let terms = [1.0, *u, *e, u * u, e * e, u * e];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                }
            }
        }
    }
    let correlation = |[n, u, e, uu, ee, ue]: [f64; 6]| {
        let both = (uu / n - (u / n).powi(2)) * (ee / n - (e / n).powi(2));
        if both > 0.0 { ((ue / n - u / n * (e / n)) / both.sqrt()).abs() } else { 0.0 }
    };
    let found: Vec<f64> = sums.into_iter().map(correlation).collect();
    let usual = found.iter().take(USUAL + 1).copied().fold(0.0, f64::max);
    let best = (0..found.len()).max_by(|&a, &b| found[a].total_cmp(&found[b]).then(b.cmp(&a))).unwrap_or(0);
    // At the end of the list there is no peak: a tone has one every period.
    Ok((best <= most && found[best] > LEAST && found[best] > LARGER * usual).then_some((best, found[best])))
}

/// Innovations of each row by least squares on the two rows before; NaN for the first two.
fn innovations(x: &[f64]) -> Vec<f64> {
    let count = x.iter().filter(|x| x.is_finite()).count().max(1) as f64;
    let mean = x.iter().filter(|x| x.is_finite()).sum::<f64>() / count;
    let at = |row: usize, back: usize| x[row - back] - mean;
    // Normal equations of x(k) on x(k-1) and x(k-2).
    let mut sums = [0.0; 5];
    for row in 2..x.len() {
        let (now, one, two) = (at(row, 0), at(row, 1), at(row, 2));
        let terms = [one * one, one * two, two * two, now * one, now * two];
        if terms.iter().all(|term| term.is_finite()) {
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
    }
    let [aa, ab, bb, ya, yb] = sums;
    let determinant = aa * bb - ab * ab;
    let (a, b) = match determinant > 1e-12 * aa * bb {
        true => ((ya * bb - yb * ab) / determinant, (yb * aa - ya * ab) / determinant),
        false if aa > 0.0 => (ya / aa, 0.0),
        false => (0.0, 0.0),
    };
    let of = |row: usize| if row < 2 { f64::NAN } else { at(row, 0) - a * at(row, 1) - b * at(row, 2) };
    (0..x.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    fn found(late: usize) -> Option<Vec<(String, usize)>> {
        let u: Vec<f64> =
            (0..3000).map(|row| (0.37 * f64::from(row / 7 * 7)).sin() + (0.11 * f64::from(row)).cos()).collect();
        let mut y = vec![0.0; 3000];
        for row in 1..3000usize {
            y[row] = 0.9 * y[row - 1] + 0.1 * row.checked_sub(late).map_or(0.0, |at| u[at]);
        }
        let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
        source.push_uniform("a", 0.01, vec![y, u]);
        let recipe = Recipe::parse("[states]\ny = {}\n[inputs]\nu = {}\n", "test").unwrap();
        let (moved, late) = moved(&recipe, &source, 30).unwrap()?;
        let (rows, column) = (late[0].1, moved.inputs["u_late"].table().column);
        assert_eq!(column, Some(format!("lag(`u`, {})", rows - 1)));
        Some(late)
    }

    #[test]
    fn a_late_input_is_found_and_one_in_time_is_none() {
        assert_eq!(found(17), Some(vec![("u".to_owned(), 17)]));
        assert_eq!(found(1), None);
    }
}
