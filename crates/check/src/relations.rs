//! Correlations of channels, and how far one follows another (Fig. 5.2 and 5.6 of *Towards Sim-to-Real via
//! Real-to-Sim*).

use fleetfoot_data::{Column, ColumnKind, Halo, Progress, Source, nearest, parallel_map};
use fleetfoot_dataset::{Dataset, Error, Logs};
use fleetfoot_recipe::Recipe;
use serde::Serialize;

/// Columns of a correlation matrix, at most: the work grows with their square.
const MOST: usize = 128;

/// Pearson correlations of the columns of logs.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Correlations {
    /// The columns.
    pub columns: Vec<String>,
    /// Correlation of each pair, over the rows where both have values; NaN for a column that does not move.
    pub matrix: Vec<Vec<f64>>,
    /// Rows read.
    pub rows: u64,
    /// Assumptions, and columns that were left out.
    pub notes: Vec<String>,
}

/// Differences between a reference and a response, by the rows by which the response is shifted.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct LagCurve {
    /// The reference.
    pub reference: String,
    /// The response.
    pub response: String,
    /// Seconds between rows.
    pub period: f64,
    /// One entry a shift, from the most negative.
    pub shifts: Vec<Shift>,
    /// Shift at which the mean absolute difference is least.
    pub nearest: i64,
    /// Shift at which the correlation is largest, by its size.
    pub alike: i64,
    /// Assumptions.
    pub notes: Vec<String>,
}

/// A response that is so many rows later than its reference.
#[derive(Debug, Clone, Copy, Serialize)]
#[non_exhaustive]
pub struct Shift {
    /// Rows: the reference at a row is compared with the response so many rows later.
    pub rows: i64,
    /// The same in seconds.
    pub seconds: f64,
    /// Pairs of rows.
    pub pairs: u64,
    /// Mean absolute difference.
    pub difference: f64,
    /// Standard deviation of the absolute difference.
    pub deviation: f64,
    /// Correlation.
    pub correlation: f64,
}

/// Sums of two values over rows, about fixed origins.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    rows: f64,
    sums: [f64; 2],
    squares: [f64; 2],
    product: f64,
}

impl Pair {
    fn add(&mut self, a: f64, b: f64) {
        if a.is_finite() && b.is_finite() {
            self.rows += 1.0;
            self.sums = [self.sums[0] + a, self.sums[1] + b];
            self.squares = [a.mul_add(a, self.squares[0]), b.mul_add(b, self.squares[1])];
            self.product = a.mul_add(b, self.product);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.rows += other.rows;
        self.sums = [self.sums[0] + other.sums[0], self.sums[1] + other.sums[1]];
        self.squares = [self.squares[0] + other.squares[0], self.squares[1] + other.squares[1]];
        self.product += other.product;
    }

    fn correlation(&self) -> f64 {
        let about = |square: f64, a: f64, b: f64| square - a * b / self.rows;
        let [a, b] = self.sums;
        let (left, right) = (about(self.squares[0], a, a), about(self.squares[1], b, b));
        // Beneath it there is rounding alone.
        let moves = left > 1e-12 * self.squares[0] && right > 1e-12 * self.squares[1];
        if moves { (about(self.product, a, b) / (left * right).sqrt()).clamp(-1.0, 1.0) } else { f64::NAN }
    }
}

/// Correlations of all pairs of columns, in one pass over the rows; `columns`: those that are named, else all numbers.
///
/// # Errors
/// An unknown column. Those of the recipe and of reading.
pub fn correlations(
    recipe: &Recipe,
    columns: Option<&[String]>,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Correlations, Error> {
    let dataset = Dataset::for_columns(recipe, None, logs, progress)?;
    let view = dataset.view()?;
    let mut notes = dataset.notes().to_vec();
    let is_number = |column: &&Column| column.kind == ColumnKind::Float;
    let named: Vec<String> = match columns {
        Some(named) => named.to_vec(),
        None => view.columns().iter().filter(is_number).map(|column| column.name.clone()).collect(),
    };
    let mut places = named.iter().map(|name| place(&view, name)).collect::<Result<Vec<_>, _>>()?;
    if places.len() > MOST {
        notes.push(format!("the first {MOST} of {} columns are compared; name others", places.len()));
        places.truncate(MOST);
    }
    let count = places.len();
    progress.stage("correlation");
    // The first value of a column is its origin: sums of squares then have digits for what moves.
    let mut origins = vec![f64::NAN; count];
    let mut pairs = vec![Pair::default(); count * count];
    let mut rows = 0;
    for (episode, info) in view.episodes().iter().enumerate() {
        for first in (0..info.rows).step_by(BLOCK) {
            let block = view.read(episode, first..(first + BLOCK).min(info.rows), Halo::default())?;
            rows += block.rows as u64;
            let values: Vec<&[f64]> = places.iter().map(|&place| block.core(place)).collect();
            for (origin, column) in origins.iter_mut().zip(&values) {
                if origin.is_nan() {
                    *origin = column.iter().copied().find(|value| value.is_finite()).unwrap_or(f64::NAN);
                }
            }
            let of_row = |i: usize| {
                let mut sums = vec![Pair::default(); count];
                for (j, sum) in sums.iter_mut().enumerate().skip(i) {
                    let both = values[i].iter().zip(values[j]);
                    both.for_each(|(a, b)| sum.add(a - origins[i], b - origins[j]));
                }
                Ok::<_, Error>(sums)
            };
            let sums = parallel_map(count, progress, of_row)?;
            pairs.iter_mut().zip(sums.iter().flatten()).for_each(|(pair, other)| pair.merge(other));
        }
    }
    let value = |i: usize, j: usize| pairs[i.min(j) * count + i.max(j)].correlation();
    Ok(Correlations {
        columns: places.iter().map(|&place| view.columns()[place].name.clone()).collect(),
        matrix: (0..count).map(|i| (0..count).map(|j| value(i, j)).collect()).collect(),
        rows,
        notes,
    })
}

/// Rows that are read at once.
const BLOCK: usize = 65_536;

/// Lag curve: differences between a response and its reference at shifts of up to `reach` rows either way, within episodes.
///
/// # Errors
/// An unknown column, or episodes that are shorter than the reach. Those of the recipe and of reading.
pub fn lag_curve(
    recipe: &Recipe,
    [reference, response]: [&str; 2],
    reach: usize,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<LagCurve, Error> {
    let names = [reference.to_owned(), response.to_owned()];
    let dataset = Dataset::for_columns(recipe, Some(&names), logs, progress)?;
    let view = dataset.view()?;
    let places = [place(&view, reference)?, place(&view, response)?];
    let longest = view.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    if longest < reach + 2 {
        let message = format!(
            "the longest episode has {longest} rows, and a shift of {reach} rows is to be compared; give fewer"
        );
        return Err(Error::too_few_rows(longest as u64, reach as u64 + 2, message));
    }
    progress.stage("lags");
    let shifts = 2 * reach + 1;
    let mut sums = vec![(Pair::default(), Pair::default()); shifts];
    let mut origins = None;
    for (episode, info) in view.episodes().iter().enumerate() {
        let block = view.read(episode, 0..info.rows, Halo::default())?;
        let [a, b] = places.map(|place| block.core(place));
        let first = |column: &[f64]| column.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
        let [from, to] = *origins.get_or_insert([first(a), first(b)]);
        let of_shift = |at: usize| {
            // Rows by which the response is later.
            let later = at as i64 - reach as i64;
            let (ahead, behind) = (later.max(0) as usize, (-later).max(0) as usize);
            let (a, b) = (a.get(behind..).unwrap_or_default(), b.get(ahead..).unwrap_or_default());
            let (mut both, mut differences) = (Pair::default(), Pair::default());
            for (a, b) in a.iter().zip(b) {
                both.add(a - from, b - to);
                differences.add((b - a).abs(), 0.0);
            }
            Ok::<_, Error>((both, differences))
        };
        let episode_sums = parallel_map(shifts, progress, of_shift)?;
        for (sum, other) in sums.iter_mut().zip(&episode_sums) {
            sum.0.merge(&other.0);
            sum.1.merge(&other.1);
        }
    }
    let period = dataset.step();
    let shifts: Vec<Shift> = sums
        .iter()
        .enumerate()
        .map(|(at, (both, differences))| {
            let rows = at as i64 - reach as i64;
            let difference = differences.sums[0] / differences.rows;
            let square = differences.squares[0] / differences.rows - difference * difference;
            Shift {
                rows,
                seconds: rows as f64 * period,
                pairs: both.rows as u64,
                difference,
                deviation: square.max(0.0).sqrt(),
                correlation: both.correlation(),
            }
        })
        .collect();
    // The shift of least size among equal ones.
    let best = |value: &dyn Fn(&Shift) -> f64| {
        let known = shifts.iter().filter(|shift| value(shift).is_finite());
        known
            .min_by(|a, b| value(a).total_cmp(&value(b)).then(a.rows.abs().cmp(&b.rows.abs())))
            .map_or(0, |shift| shift.rows)
    };
    let (closest, alike) = (best(&|shift| shift.difference), best(&|shift| -shift.correlation.abs()));
    let mut notes = dataset.notes().to_vec();
    if [closest, alike].iter().any(|shift| shift.unsigned_abs() as usize == reach) {
        notes.push(format!(
            "the best shift is the largest one, {reach} rows: the lag may be longer; compare larger shifts"
        ));
    }
    Ok(LagCurve {
        nearest: closest,
        alike,
        reference: reference.to_owned(),
        response: response.to_owned(),
        period,
        shifts,
        notes,
    })
}

/// Place of a column in the rows.
fn place(view: &dyn Source, name: &str) -> Result<usize, Error> {
    view.columns().iter().position(|column| column.name == name).ok_or_else(|| {
        let names = view.columns().iter().map(|column| column.name.as_str());
        let similar = nearest(name, names);
        let hint = if similar.is_empty() { String::new() } else { format!("; did you mean {}?", similar.join(", ")) };
        Error::unknown(name, format!("there is no column `{name}` in these logs{hint}"))
    })
}
