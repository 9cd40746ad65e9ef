//! Check that a model fits the sampling period of the rows.

use std::{collections::HashSet, path::Path};

use fleetfoot_data::setting::RATE;
use fleetfoot_data::{Column, Episode};
use fleetfoot_library::{Expr, Node};
use fleetfoot_model::{Model, Prediction};

use crate::{
    dataset::{Dataset, of_most},
    error::{Error, short},
};

/// Periods that differ by less of the model's are one: clocks drift, and stamps are rounded.
const TOLERANCE: f64 = 0.1;

/// The files that did not train a model, each with the period of most of its rows.
fn of_files<'a>(dataset: &'a Dataset, model: &Model) -> Vec<(&'a Path, f64)> {
    let trained: HashSet<String> = dataset.in_sample(model).into_iter().collect();
    let mut files: Vec<(&Path, Vec<&Episode>)> = Vec::new();
    for (at, episode) in
        dataset.episodes().iter().enumerate().filter(|(_, each_episode)| !trained.contains(&each_episode.name))
    {
        let path = dataset.origin(at);
        match files.last_mut().filter(|(last, _)| *last == path) {
            Some((_, episodes)) => episodes.push(episode),
            None => files.push((path, vec![episode])),
        }
    }
    files.into_iter().map(|(path, episodes)| (path, of_most(episodes))).collect()
}

/// Refuses rows of another period than a model that advances row by row was fitted on; a note for models of derivatives, which hold for any. Every
/// `every`-th row of the dataset, which sees the model's columns, is used.
///
/// # Errors
/// [`Error::OtherPeriod`].
pub(crate) fn check(model: &Model, dataset: &Dataset, every: usize) -> Result<Option<String>, Error> {
    let expected = model.step;
    let step_of = |seconds: f64| seconds * every as f64;
    let other =
        |(_, seconds): &(&Path, f64)| *seconds > 0.0 && (step_of(*seconds) - expected).abs() > TOLERANCE * expected;
    let first = of_files(dataset, model).into_iter().find(other);
    let Some((path, seconds)) = first.filter(|_| expected > 0.0) else { return Ok(None) };
    let period = step_of(seconds);
    if by_rows(model, dataset.aliases()) {
        return Err(Error::OtherPeriod { path: path.into(), period, expected, mend: mend(period, expected) });
    }
    Ok(Some(format!(
        "{}: its rows are {} s apart, those that the model was fitted on {} s; a model of derivatives holds for both, but measured derivatives and steps of \
         integration are as coarse as the rows",
        path.display(),
        short(period),
        short(expected)
    )))
}

fn mend(row_step: f64, expected: f64) -> String {
    let times = (expected / row_step).round();
    let thin = if times >= 2.0 && (expected / row_step - times).abs() < TOLERANCE * times {
        format!("keep every {times}th row, ")
    } else {
        String::new()
    };
    format!(
        "{thin}resample the log to {} s ({}), or fit a model on logs of this rate",
        short(expected),
        RATE.to(short(1.0 / expected))
    )
}

/// Returns true if the model's meaning depends on the sampling period: it predicts the next row, or reads other rows by
/// their number.
fn by_rows(model: &Model, aliases: &[(Column, Expr)]) -> bool {
    let steps = |prediction| matches!(prediction, Prediction::Next | Prediction::Difference);
    let fitted = model.fitted().any(|equation| steps(equation.prediction));
    let expressions = model
        .libraries
        .iter()
        .flatten()
        .chain(model.partitions.iter().flat_map(|partition| &partition.columns))
        .chain(aliases.iter().map(|(_, expression)| expression));
    fitted || expressions.into_iter().any(reads_other_rows)
}

/// Other rows than the present one, without the time between them: differences by the stamps hold for any period.
fn reads_other_rows(expression: &Expr) -> bool {
    let (mut other, mut time) = (false, false);
    expression.fold(|part, _: &[()]| match part.node() {
        Node::Column { lag, .. } => other |= *lag != 0,
        Node::Time { .. } => time = true,
        _ => {}
    });
    other && !time
}
