//! The five sentences: the fit, its errors, its useful horizon, its weak points, and the motion to record next.

use fleetfoot_data::setting::{INPUTS, STATES};
use fleetfoot_report::words::{count, number, ratio, seconds};

use crate::{
    Auto, TestedState,
    candidates::LINEAR,
    rows::{Movement, Span},
};

/// The sentences of a result.
pub(crate) fn sentences(outcome: &Auto, movements: &[Movement], inputs: &[String]) -> Vec<String> {
    vec![fitted(outcome), good(outcome), span(outcome), weak(outcome), next(outcome, movements, inputs)]
}

/// Ratio to the error of the linear model from which a sentence names the difference.
const MARGIN: f64 = 1.1;

/// Warning above all else, if a result is of no use.
pub(crate) fn warning(outcome: &Auto, unbeaten: Option<&str>) -> Option<String> {
    if let Some(unbeaten) = unbeaten {
        return Some(format!(
            "no model has a held-out error below that of {unbeaten} by more than the standard error, so the written model predicts no better; record more motion, or name other states and inputs ({STATES}, {INPUTS})"
        ));
    }
    type Other = fn(&TestedState) -> f64;
    let worse = |other: Other, limit: f64| outcome.mean_ratio(other).filter(|ratio| *ratio > limit);
    let names: [(&str, f64, Other); 3] = [
        ("persistence", 1.0, |state| state.persistence),
        ("the mean", 1.0, |state| state.mean.unwrap_or(f64::NAN)),
        ("the linear model", MARGIN, |state| state.linear.unwrap_or(f64::NAN)),
    ];
    names.into_iter().find_map(|(name, limit, other)| {
        worse(other, limit).map(|times| {
            format!(
                "the test error of the model is {} times that of {name}: the test rows differ from the rows that chose it; record longer",
                ratio(times)
            )
        })
    })
}

fn fitted(outcome: &Auto) -> String {
    let chosen = &outcome.candidates[outcome.chosen];
    format!(
        "Fitted: `{}` by `{}`, {} for {}.",
        chosen.name,
        chosen.method,
        count(chosen.coefficients, "coefficient"),
        count(outcome.tested.len(), "state")
    )
}

fn good(outcome: &Auto) -> String {
    let horizon = &outcome.horizon;
    let over = match horizon.seconds > 0.0 {
        true => format!("{} ({})", count(horizon.steps, "step"), seconds(horizon.seconds)),
        false => count(horizon.steps, "step"),
    };
    let persistence = outcome.mean_ratio(|state| state.persistence).unwrap_or(f64::NAN);
    let linear = match outcome.mean_of(|state| state.linear.unwrap_or(f64::NAN) / state.persistence) {
        _ if outcome.candidates[outcome.chosen].name == LINEAR => " It is the linear model.".to_owned(),
        Some(linear) => format!(" The linear model has {} times the error of persistence.", ratio(linear)),
        None => String::new(),
    };
    format!(
        "How good: simulations of {over} on the test rows have {} times the error of persistence, in the mean over the states.{linear}",
        ratio(persistence)
    )
}

fn span(outcome: &Auto) -> String {
    let part = |span: &Span| {
        let rows = format!("{} of {}", count(span.rows, "row"), count(span.episodes, "episode"));
        match span.seconds[1] > span.seconds[0] {
            true => format!("{rows}, {} to {} s", number(span.seconds[0]), number(span.seconds[1])),
            false => rows,
        }
    };
    format!("Training: {}. Test: {}.", part(&outcome.split.training), part(&outcome.split.test))
}

fn weak(outcome: &Auto) -> String {
    let of = |tested: &TestedState| {
        let least = [tested.persistence, tested.mean.unwrap_or(f64::NAN)].into_iter().fold(f64::INFINITY, f64::min);
        tested.rmse.value / least
    };
    let worst = outcome.tested.iter().filter(|tested| of(tested).is_finite()).max_by(|a, b| of(a).total_cmp(&of(b)));
    let state = worst.map_or_else(String::new, |worst_state| {
        let unit = worst_state.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        format!(
            "`{}` has the largest error beside persistence and the mean: {}{unit}, {} times the smaller of these",
            worst_state.state,
            number(worst_state.rmse.value),
            ratio(of(worst_state))
        )
    });
    format!(
        "Weak: {state}; {} % of the simulations leave the training range.",
        number((1000.0 * outcome.outside).round() / 10.0)
    )
}

/// A share of moving rows below which an input is hardly excited.
const STILL: f64 = 0.02;

fn next(outcome: &Auto, movements: &[Movement], inputs: &[String]) -> String {
    let is_input = |movement: &&Movement| inputs.contains(&movement.name);
    let farthest = movements
        .iter()
        .map(|movement| (movement.beyond(), movement))
        .filter(|(share, _)| *share > 0.02)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let stillest = movements.iter().filter(is_input).min_by(|a, b| a.moves.total_cmp(&b.moves));
    if let Some((_, movement)) = farthest {
        let unit = movement.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        return format!(
            "Record next: more of `{}` beyond {} to {}{unit}; the test went from {} to {}.",
            movement.name,
            number(movement.training[0]),
            number(movement.training[1]),
            number(movement.test[0]),
            number(movement.test[1])
        );
    }
    match stillest {
        None => "Record next: the inputs that drive the machine; these logs name none.".into(),
        Some(movement) if movement.moves < STILL => format!(
            "Record next: more changes of `{}`, which moves in {} % of the rows.",
            movement.name,
            number((1000.0 * movement.moves).round() / 10.0)
        ),
        Some(_) => format!(
            "Record next: other speeds and amplitudes; the training covers the range of the test, {} rows of it.",
            outcome.split.training.rows
        ),
    }
}
