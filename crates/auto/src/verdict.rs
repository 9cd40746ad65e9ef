//! The five sentences: the fit, its errors, its useful horizon, its weak points, and the motion to record next.

use fleetfoot_data::setting::{INPUTS, STATES};
use fleetfoot_report::words::{count, number, ratio, seconds};

use crate::{
    Auto, TestedState,
    candidates::LINEAR,
    rows::{Movement, Span},
};

/// The sentences of a result.
pub(crate) fn sentences(found: &Auto, movements: &[Movement], inputs: &[String]) -> Vec<String> {
    vec![fitted(found), good(found), span(found), weak(found), next(found, movements, inputs)]
}

/// Ratio to the error of the linear model from which a sentence names the difference.
const MARGIN: f64 = 1.1;

/// Warning above all else, if a result is of no use.
pub(crate) fn warning(found: &Auto, unbeaten: Option<&str>) -> Option<String> {
    if let Some(unbeaten) = unbeaten {
        return Some(format!(
            "no model has a held-out error below that of {unbeaten} by more than the standard error, so the written model predicts no better; record more motion, or name other states and inputs ({STATES}, {INPUTS})"
        ));
    }
    type Other = fn(&TestedState) -> f64;
    let worse = |other: Other, limit: f64| found.mean_ratio(other).filter(|ratio| *ratio > limit);
    let names: [(&str, f64, Other); 3] = [
        ("persistence", 1.0, |own| own.persistence),
        ("the mean", 1.0, |own| own.mean.unwrap_or(f64::NAN)),
        ("the linear model", MARGIN, |own| own.linear.unwrap_or(f64::NAN)),
    ];
    names.into_iter().find_map(|(name, limit, other)| {
        worse(other, limit).map(|own| {
            format!(
                "the test error of the model is {} times that of {name}: the test rows differ from the rows that chose it; record longer",
                ratio(own)
            )
        })
    })
}

fn fitted(found: &Auto) -> String {
    let chosen = &found.candidates[found.chosen];
    format!(
        "Fitted: `{}` by `{}`, {} for {}.",
        chosen.name,
        chosen.method,
        count(chosen.coefficients, "coefficient"),
        count(found.tested.len(), "state")
    )
}

fn good(found: &Auto) -> String {
    let horizon = &found.horizon;
    let over = match horizon.seconds > 0.0 {
        true => format!("{} ({})", count(horizon.steps, "step"), seconds(horizon.seconds)),
        false => count(horizon.steps, "step"),
    };
    let persistence = found.mean_ratio(|own| own.persistence).unwrap_or(f64::NAN);
    let linear = match found.mean_of(|own| own.linear.unwrap_or(f64::NAN) / own.persistence) {
        _ if found.candidates[found.chosen].name == LINEAR => " It is the linear model.".to_owned(),
        Some(linear) => format!(" The linear model has {} times the error of persistence.", ratio(linear)),
        None => String::new(),
    };
    format!(
        "How good: simulations of {over} on the test rows have {} times the error of persistence, in the mean over the states.{linear}",
        ratio(persistence)
    )
}

fn span(found: &Auto) -> String {
    let part = |span: &Span| {
        let rows = format!("{} of {}", count(span.rows, "row"), count(span.episodes, "episode"));
        match span.seconds[1] > span.seconds[0] {
            true => format!("{rows}, {} to {} s", number(span.seconds[0]), number(span.seconds[1])),
            false => rows,
        }
    };
    format!("Training: {}. Test: {}.", part(&found.split.training), part(&found.split.test))
}

fn weak(found: &Auto) -> String {
    let of = |own: &TestedState| {
        let least = [own.persistence, own.mean.unwrap_or(f64::NAN)].into_iter().fold(f64::INFINITY, f64::min);
        own.rmse.value / least
    };
    let worst = found.tested.iter().filter(|own| of(own).is_finite()).max_by(|a, b| of(a).total_cmp(&of(b)));
    let state = worst.map_or_else(String::new, |own| {
        let unit = own.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        format!(
            "`{}` has the largest error beside persistence and the mean: {}{unit}, {} times the smaller of these",
            own.state,
            number(own.rmse.value),
            ratio(of(own))
        )
    });
    format!(
        "Weak: {state}; {} % of the simulations leave the training range.",
        number((1000.0 * found.outside).round() / 10.0)
    )
}

/// A share of moving rows below which an input is hardly excited.
const STILL: f64 = 0.02;

fn next(found: &Auto, movements: &[Movement], inputs: &[String]) -> String {
    let is_input = |own: &&Movement| inputs.contains(&own.name);
    let farthest = movements
        .iter()
        .map(|own| (own.beyond(), own))
        .filter(|(share, _)| *share > 0.02)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let stillest = movements.iter().filter(is_input).min_by(|a, b| a.moves.total_cmp(&b.moves));
    if let Some((_, own)) = farthest {
        let unit = own.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        return format!(
            "Record next: more of `{}` beyond {} to {}{unit}; the test went from {} to {}.",
            own.name,
            number(own.training[0]),
            number(own.training[1]),
            number(own.test[0]),
            number(own.test[1])
        );
    }
    match stillest {
        None => "Record next: the inputs that drive the machine; these logs name none.".into(),
        Some(own) if own.moves < STILL => format!(
            "Record next: more changes of `{}`, which moves in {} % of the rows.",
            own.name,
            number((1000.0 * own.moves).round() / 10.0)
        ),
        Some(_) => format!(
            "Record next: other speeds and amplitudes; the training covers the range of the test, {} rows of it.",
            found.split.training.rows
        ),
    }
}
