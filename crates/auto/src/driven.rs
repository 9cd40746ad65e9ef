//! Columns that drive others and that nothing drives: inputs whose names and motion do not say so.
//!
//! The test is Granger's, of linear models of three rows: a column drives another one where its past tells of the other's next row what the other's past does not.

/// Rows that models look back.
const LAGS: usize = 3;
/// Share of what its own past leaves open of a column: it is driven where the pasts of all others tell more, and it drives another column that it tells more of.
const DRIVEN: f64 = 0.03;
const DRIVES: f64 = 0.08;
/// It drives others by so many times as much as it is driven.
const TIMES: f64 = 10.0;
/// Least share of a column's variance that its past leaves unexplained; below it other columns cannot be judged.
const OPEN: f64 = 1e-14;
/// Columns at most: beyond it pairs are many and rows few.
const MOST: usize = 40;
/// Rows for every function of the model of all columns, at least.
const ROWS: usize = 8;

/// The columns that drive others and that nothing drives; of a table of columns, each its values by episode. None where all or nothing would be one.
pub(crate) fn drivers(columns: &[&[Vec<f64>]]) -> Vec<usize> {
    let count = columns.len();
    if !(2..=MOST).contains(&count) {
        return Vec::new();
    }
    let (past, next) = regression(columns);
    let rows = next.first().map_or(0, Vec::len);
    if rows < ROWS * LAGS * count {
        return Vec::new();
    }
    let of = |column: usize| &past[column * LAGS..(column + 1) * LAGS];
    let left = |target: usize, pasts: &[&[Vec<f64>]]| {
        let regressors: Vec<&[f64]> =
            pasts.iter().flat_map(|rows_of_lag| rows_of_lag.iter().map(Vec::as_slice)).collect();
        rest(&next[target], &regressors) / (rows - regressors.len() - 1) as f64
    };
    let driving: Vec<usize> = (0..count)
        .filter(|&column| {
            let alone = left(column, &[of(column)]);
            let variance = next[column].iter().map(|value| value * value).sum::<f64>() / rows as f64;
            let driven = 1.0 - left(column, &[&past]) / alone;
            if !(alone > OPEN * variance && driven <= DRIVEN) {
                return false;
            }
            let drives = |other: usize| 1.0 - left(other, &[of(other), of(column)]) / left(other, &[of(other)]);
            let most = (0..count).filter(|&other| other != column).map(drives).fold(0.0, f64::max);
            most >= DRIVES && most >= TIMES * driven
        })
        .collect();
    if driving.len() == count { Vec::new() } else { driving }
}

/// The last rows of every column (value, slope, curvature) and its next row, about their means, of rows in which all are known.
fn regression(columns: &[&[Vec<f64>]]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let (mut past, mut next) = (vec![Vec::new(); LAGS * columns.len()], vec![Vec::new(); columns.len()]);
    let episodes = columns.iter().map(|episode_rows| episode_rows.len()).min().unwrap_or(0);
    for episode in 0..episodes {
        let rows = columns.iter().map(|episode_rows| episode_rows[episode].len()).min().unwrap_or(0);
        for row in LAGS..rows {
            let known = |episode_rows: &&[Vec<f64>]| {
                episode_rows[episode][row - LAGS..=row].iter().all(|value| value.is_finite())
            };
            if !columns.iter().all(known) {
                continue;
            }
            for (column, episode_rows) in columns.iter().enumerate() {
                let at = |back: usize| episode_rows[episode][row - back];
                next[column].push(at(0));
                past[LAGS * column].push(at(1));
                // Neighbouring rows are nearly the same: their differences are not.
                past[LAGS * column + 1].push(at(1) - at(2));
                past[LAGS * column + 2].push(at(1) - 2.0 * at(2) + at(3));
            }
        }
    }
    for values in past.iter_mut().chain(&mut next) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter_mut().for_each(|value| *value -= mean);
    }
    (past, next)
}

/// The sum of the squares that least squares leave of a target, by Gram and Schmidt (modified); columns that others make up are left out.
fn rest(target: &[f64], regressors: &[&[f64]]) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let without = |values: &mut [f64], basis: &[f64]| {
        let share = product(values, basis);
        values.iter_mut().zip(basis).for_each(|(value, basis_value)| *value -= share * basis_value);
    };
    let mut bases: Vec<Vec<f64>> = Vec::with_capacity(regressors.len());
    let mut target = target.to_vec();
    for column in regressors {
        let mut direction = column.to_vec();
        let before = product(&direction, &direction);
        bases.iter().for_each(|basis| without(&mut direction, basis));
        let after = product(&direction, &direction);
        if after.is_nan() || after <= 1e-12 * before {
            continue;
        }
        direction.iter_mut().for_each(|value| *value /= after.sqrt());
        without(&mut target, &direction);
        bases.push(direction);
    }
    product(&target, &target)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mass on a spring under a force that moves by itself, or that a controller computes from the speed.
    fn spring(feedback: f64) -> [Vec<Vec<f64>>; 3] {
        let (mut x, mut v, mut drive, mut seed) = (0.3f64, 0.0f64, 0.0f64, 5u64);
        let mut columns = [vec![Vec::new()], vec![Vec::new()], vec![Vec::new()]];
        for _ in 0..3000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            drive = 0.95 * drive + (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
            let force = drive - feedback * v;
            columns.iter_mut().zip([x, v, force]).for_each(|(column, value)| column[0].push(value));
            v += 0.02 * (2.0 * force - 0.5 * v - 3.0 * x);
            x += 0.02 * v;
        }
        columns
    }

    fn drivers_of(columns: &[Vec<Vec<f64>>]) -> Vec<usize> {
        drivers(&columns.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    #[test]
    fn undriven_force_is_an_input() {
        assert_eq!(drivers_of(&spring(0.0)), [2]);
        assert_eq!(drivers_of(&spring(8.0)), [] as [usize; 0], "a controller's force follows from the speed");
        assert_eq!(drivers_of(&spring(0.0)[..2]), [] as [usize; 0], "position and speed drive each other");
        assert_eq!(drivers_of(&spring(0.0)[..1]), [] as [usize; 0]);
    }
}
