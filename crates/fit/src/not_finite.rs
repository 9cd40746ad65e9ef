//! Reasons why rows lack a value though all measurements are there: a division by zero, a root of a negative number,
//! overflow of f64.

use std::{ops::Range, path::PathBuf};

use fleetfoot_data::setting::{BASE, JOIN, MAX_GAP};
use fleetfoot_data::{Block, Column, Halo, Source};
use fleetfoot_dataset::{Dataset, Error as DatasetError};
use fleetfoot_library::{Binary, Expr, Node, View};
use fleetfoot_log::Format;
use fleetfoot_recipe::Cause;

use crate::error::Error;

/// Rows that are evaluated together, at most.
const ROWS: usize = 65_536;
const MOST_ROWS: usize = 1 << 21;
/// Values that are evaluated together: with many expressions fewer rows.
const VALUES: usize = 1 << 23;
/// Rows without a value in which one expression is evaluated, at most.
const MOST_TRIED: usize = 4096;
/// A note names a field that lacks more than one value in so many rows, and episodes of fewer rows on average.
const SHARE: usize = 10;
const FEW: usize = 10;
/// Expressions that a note names.
const MOST_TOLD: usize = 5;

/// Sentences about the aliases of a dataset, and functions of them, that have no finite value in a row though all their
/// columns do. Each sentence has the reason, and the first row and file.
///
/// # Errors
/// Those of reading.
pub(crate) fn explain(dataset: &Dataset, functions: impl IntoIterator<Item = Expr>) -> Result<Vec<String>, Error> {
    let aliases = dataset.aliases().iter().filter(|(_, expression)| expression.filters().is_empty());
    let aliases: Vec<(String, Expr)> = aliases
        .map(|(column, expression)| {
            let text = expression.to_string();
            let name = &column.name;
            (if text == *name { format!("`{name}`") } else { format!("`{name}` = `{text}`") }, expression.clone())
        })
        .collect();
    let view = dataset.view()?;
    let mut of_aliases: Vec<(String, Expr)> = Vec::new();
    for function in functions.into_iter().filter(|function| function.as_column().is_none()) {
        if !of_aliases.iter().any(|(_, known)| *known == function) {
            of_aliases.push((format!("`{function}`"), function));
        }
    }
    let mut notes = first_of_each(dataset.source(), &aliases)?;
    notes.extend(first_of_each(&view, &of_aliases)?);
    let more = notes.len().saturating_sub(MOST_TOLD);
    notes.truncate(MOST_TOLD);
    if more > 0 {
        notes.push(format!("{more} more expressions have no finite value in some rows"));
    }
    Ok(notes)
}

/// An error with a possible reason: rows that an expression has made useless.
pub(crate) fn with_reasons(error: Error, dataset: &Dataset, functions: impl IntoIterator<Item = Expr>) -> Error {
    match error {
        Error::Cancelled(_) | Error::Dataset(DatasetError::Data(_) | DatasetError::Log(_)) => error,
        error if error.is_memory() => error,
        error => {
            let mut reasons = if is_too_few(&error) { too_few(dataset).unwrap_or_default() } else { Vec::new() };
            reasons.extend(explain(dataset, functions).unwrap_or_default());
            if reasons.is_empty() {
                return error;
            }
            Error::WithReasons { error: Box::new(error), reasons: reasons.join("; ") }
        }
    }
}

/// Returns true if the error says that there are too few rows.
pub(crate) fn is_too_few(error: &Error) -> bool {
    match error {
        Error::Request(request) => matches!(request.cause, Cause::TooFewRows { .. }),
        Error::Identification(error) => matches!(error, fleetfoot_pwa::Error::TooFewRows { .. }),
        _ => false,
    }
}

/// Why rows are too few: the field that lacks most values, and episodes of a few rows.
///
/// # Errors
/// Those of reading.
pub(crate) fn too_few(dataset: &Dataset) -> Result<Vec<String>, Error> {
    let source = dataset.source();
    let (mut missing, mut rows) = (vec![0; source.columns().len()], 0);
    for (episode, info) in source.episodes().iter().enumerate() {
        for from in (0..info.rows).step_by(ROWS) {
            let range = from..(from + ROWS).min(info.rows).min(from + MOST_ROWS - rows);
            rows += range.len();
            let block = source.read(episode, range, Halo::default())?;
            for (count, column) in missing.iter_mut().zip(0..) {
                *count += block.core(column).iter().filter(|value| !value.is_finite()).count();
            }
        }
    }
    let mut notes = Vec::new();
    let worst = missing.iter().zip(source.columns()).max_by_key(|(count, _)| **count);
    if let Some((&count, column)) = worst.filter(|(count, _)| SHARE * **count >= rows.max(1)) {
        let name = &column.name;
        let is_log = |file: &PathBuf| file.is_dir() || Format::of(file).is_some_and(|format| format.is_log());
        let of_topics = source.episodes().iter().any(|episode| episode.file.as_ref().is_some_and(is_log));
        let mend = of_topics.then(|| {
            let topic = name.split(['.', '[']).next().unwrap_or(name);
            format!(
                ": its samples are too far apart for the rows; set how long a value stays valid (in the recipe, {JOIN} \"{name}\" = {{ max_gap = SECONDS }}), \
                 or use them as the rows ({})",
                BASE.to(topic)
            )
        });
        notes.push(format!("`{name}` is missing in {count} of {rows} rows{}", mend.unwrap_or_default()));
    }
    let episodes = source.episodes().len();
    if episodes > 1 && rows < FEW * episodes {
        notes.push(format!(
            "gaps cut the {rows} rows into {episodes} episodes: {given_max_gap} joins rows across shorter gaps",
            given_max_gap = MAX_GAP.to("SECONDS")
        ));
    }
    Ok(notes)
}

/// For every expression over the columns of a source that has no finite value where it could, a sentence about the first such row.
fn first_of_each(source: &dyn Source, expressions: &[(String, Expr)]) -> Result<Vec<String>, Error> {
    let columns: Vec<(Column, Expr)> =
        expressions.iter().map(|(label, expression)| (Column::float(label), expression.clone())).collect();
    let seen = View::new(source, &columns)?;
    let mut notes: Vec<Option<String>> = vec![None; expressions.len()];
    let mut tried = vec![0; expressions.len()];
    let mut left = MOST_ROWS;
    let rows = (VALUES / expressions.len().max(1)).clamp(1, ROWS);
    for (episode, info) in source.episodes().iter().enumerate() {
        for from in (0..info.rows).step_by(rows) {
            let range = from..(from + rows).min(info.rows).min(from + left);
            left -= range.len();
            let values = seen.read(episode, range.clone(), Halo::default())?;
            for (at, (label, expression)) in expressions.iter().enumerate() {
                let open = notes[at].is_none() && tried[at] < MOST_TRIED;
                if !open || values.core(at).iter().all(|value| value.is_finite()) {
                    continue;
                }
                let block = source.read(episode, range.clone(), halo(expression))?;
                let lacking = (0..block.rows).filter(|&row| !values.core(at)[row].is_finite());
                let reason = lacking.take(MOST_TRIED - tried[at]).inspect(|_| tried[at] += 1).find_map(|row| {
                    let reason = reason(expression, source, &block, row)?;
                    Some(format!("{label} is {reason} in row {} of {}", block.first + row + 1, info.name))
                });
                notes[at] = reason;
            }
            if left == 0 {
                break;
            }
        }
    }
    Ok(notes.into_iter().flatten().collect())
}

/// The neighbours that an expression reads.
fn halo(expression: &Expr) -> Halo {
    let (back, ahead) = expression.reach();
    Halo { before: back as usize, after: ahead as usize }
}

/// Reason why an expression is not finite at a row whose values are. `None` if a value is missing or lies beyond the
/// episode.
fn reason(expression: &Expr, source: &dyn Source, block: &Block, row: usize) -> Option<String> {
    let rows: Range<i64> = 0..block.time.len() as i64;
    let place = |lag: i32| {
        let at = (block.before + row) as i64 - i64::from(lag);
        rows.contains(&at).then_some(at as usize)
    };
    let seconds = block.seconds();
    let mut reason = None;
    let mut missing = false;
    expression.fold(|part, arguments: &[f64]| {
        let value = match part.node() {
            Node::Column { name, lag } => {
                let column = source.column_index(name);
                place(*lag).zip(column).map_or(f64::NAN, |(at, column)| block.column(column)[at])
            }
            Node::Time { lag } => place(*lag).map_or(f64::NAN, |at| seconds[at]),
            Node::Number(value) => *value,
            Node::Unary(function, _) => function.apply(arguments[0]),
            Node::Binary(function, ..) => function.apply(arguments[0], arguments[1]),
            Node::Power(_, exponent) => arguments[0].powi(*exponent),
        };
        let is_leaf = arguments.is_empty();
        missing |= is_leaf && value.is_nan();
        if reason.is_none() && !value.is_finite() && arguments.iter().all(|argument| argument.is_finite()) {
            reason = Some(happened(part, arguments, value));
        }
        value
    });
    reason.filter(|_| !missing)
}

fn happened(part: &Expr, arguments: &[f64], value: f64) -> String {
    let by_zero = match part.node() {
        Node::Binary(Binary::Div, ..) => arguments[1] == 0.0,
        Node::Power(_, exponent) => *exponent < 0 && arguments[0] == 0.0,
        _ => false,
    };
    let what = if value.is_nan() { "no number" } else { "infinite" };
    let at: Vec<String> = arguments.iter().map(f64::to_string).collect();
    match (by_zero, part.as_column()) {
        (_, Some(_)) => format!("{what} in the log"),
        (true, _) => format!("{what} (`{part}` divides by zero)"),
        _ if value.is_nan() => format!("{what} (`{part}` has no value at {})", at.join(" and ")),
        _ => format!("{what} (`{part}` is beyond 1.8e308)"),
    }
}
