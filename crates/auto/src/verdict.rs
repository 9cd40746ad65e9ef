//! The five sentences: the fit, its errors, its useful horizon, its weak points, and the motion to record next.

use fleetfoot_data::setting::{INPUTS, STATES};
use fleetfoot_report::words::{count, number, ratio, seconds};

use crate::{
    Auto, EXACT, TestedState,
    candidates::LINEAR,
    late,
    rows::{Movement, Span},
};

/// The sentences of a result.
pub(crate) fn sentences(outcome: &Auto, movements: &[Movement], inputs: &[String]) -> Vec<String> {
    vec![fitted(outcome), good(outcome), span(outcome), weak(outcome), next(outcome, movements, inputs)]
}

/// Ratio to the error of the linear model from which a sentence names the difference.
const MARGIN: f64 = 1.1;

/// Warning above all else, if a result, or its simulation of some of several states, is of no use.
pub(crate) fn warning(outcome: &Auto, unbeaten: Option<&str>) -> Option<String> {
    let whole = of_all(outcome, unbeaten);
    let states = if outcome.tested.len() > 1 { of_states(&outcome.tested) } else { None };
    let warnings: Vec<String> = [whole, states].into_iter().flatten().collect();
    (!warnings.is_empty()).then(|| warnings.join("; "))
}

/// The states in which persistence errs less on the test rows: the mean over the states hides them.
fn of_states(tested: &[TestedState]) -> Option<String> {
    let worse = tested.iter().filter(|state| state.rmse.value > state.persistence).map(|state| {
        let times = state.rmse.value / state.persistence;
        match times.is_finite() {
            true => format!("`{}` ({} times)", state.state, ratio(times)),
            false => format!("`{}` (persistence has no error)", state.state),
        }
    });
    let worse: Vec<String> = worse.collect();
    (!worse.is_empty()).then(|| {
        format!(
            "persistence has a smaller test error than the model in {}: {}; do not predict with the model there; record longer, or name other states and inputs ({STATES}, {INPUTS})",
            count(worse.len(), "state"),
            worse.join(", ")
        )
    })
}

fn of_all(outcome: &Auto, unbeaten: Option<&str>) -> Option<String> {
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
    let defined: String = (outcome.model.columns.iter())
        .filter_map(|column| late::definition(column, &outcome.recipe))
        .map(|definition| format!("; `{definition}`"))
        .collect();
    format!(
        "Fitted: `{}` by `{}`, {} for {}{defined}.",
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
    let persistence = outcome.mean_of(|state| state.rmse.value / state.persistence).unwrap_or(f64::NAN);
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
    let state = match worst {
        None => String::new(),
        Some(worst) if of(worst) < EXACT => {
            format!("no state, all errors are below {} times those of persistence and the mean; ", ratio(EXACT))
        }
        Some(worst) => format!(
            "`{}` has the largest error beside persistence and the mean: {}{}, {} times the smaller of these; ",
            worst.state,
            number(worst.rmse.value),
            worst.unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default(),
            ratio(of(worst))
        ),
    };
    format!(
        "Weak: {state}{} % of the simulations leave the training range.",
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

#[cfg(test)]
mod tests {
    use fleetfoot_dynamics::Estimate;
    use fleetfoot_model::{Column, Model, Role, Training};
    use fleetfoot_recipe::Recipe;
    use serde_json::Value;

    use super::*;
    use crate::{Candidate, HorizonChoice, Split};

    /// A state of these errors: of the model, persistence and the linear model.
    fn tested(state: &str, [value, persistence, linear]: [f64; 3]) -> TestedState {
        let rmse = Estimate { value, low: 0.1 * value, high: 10.0 * value };
        TestedState {
            state: state.into(),
            unit: None,
            rmse,
            linear: Some(linear),
            persistence,
            mean: Some(persistence),
        }
    }

    fn outcome(tested: Vec<TestedState>) -> Auto {
        let span = || Span { rows: 100, episodes: 1, seconds: [0.0, 0.0] };
        let candidate = Candidate {
            name: "late".into(),
            method: "fit pwa".into(),
            coefficients: 4,
            folds: Vec::new(),
            error: None,
            standard_error: None,
            ended: [0, 0],
            reason: None,
        };
        Auto {
            model: Model::new("pwa", Vec::new(), 0.1, Training::default()),
            linear: None,
            recipe: Recipe::parse("[states]\nx = {}\n[inputs]\nu = {}\n", "test").unwrap(),
            checked: None,
            candidates: vec![candidate],
            chosen: 0,
            horizon: HorizonChoice { steps: 5, seconds: 0.5, correlation: 5, before: 2, room: 20 },
            split: Split { training: span(), test: span() },
            tested,
            outside: 0.0,
            diverged: 0.0,
            warning: None,
            sentences: Vec::new(),
            notes: Vec::new(),
            stopped: false,
            every: 1,
            fit: Value::Null,
        }
    }

    #[test]
    fn warnings_name_states_worse_than_persistence() {
        // The mean over the states is 0.8 times persistence.
        let states = vec![tested("x", [1.74, 1.0, 2.0]), tested("y", [0.6, 1.0, 2.0]), tested("z", [0.06, 1.0, 2.0])];
        let warned = warning(&outcome(states.clone()), None).unwrap();
        assert!(warned.contains("in 1 state: `x` (1.740 times)") && !warned.contains("`y`"), "{warned}");
        // A warning of the whole model does not hide them.
        let warned = warning(&outcome(states.clone()), Some("the mean")).unwrap();
        assert!(warned.starts_with("no model") && warned.contains("`x` (1.740 times)"), "{warned}");
        assert_eq!(warning(&outcome(states[1..].to_vec()), None), None);
        // Of one state the warning of the whole model says it once.
        let warned = warning(&outcome(states[..1].to_vec()), None).unwrap();
        assert!(warned.contains("1.740 times that of persistence") && !warned.contains("`x`"), "{warned}");
    }

    #[test]
    fn errors_of_exact_models_are_printed() {
        let exact = outcome(vec![tested("x", [3e-9, 1.0, 2.9e-9])]);
        let sentence = good(&exact);
        assert!(sentence.contains("have 3.0e-9 times") && sentence.contains("has 2.9e-9 times"), "{sentence}");
        assert_eq!(warning(&exact, None), None);
        let sentence = weak(&exact);
        assert!(sentence.contains("no state") && sentence.contains("below 1.0e-6 times"), "{sentence}");
        let sentence = weak(&outcome(vec![tested("x", [0.3, 1.0, 0.5])]));
        assert!(
            sentence.starts_with("Weak: `x` has the largest error") && sentence.contains("0.300 times"),
            "{sentence}"
        );
    }

    #[test]
    fn late_inputs_are_defined_once() {
        let mut late = outcome(Vec::new());
        late.model.columns = vec![
            Column::new("x", Role::State),
            Column { source: "lag(u, 12)".into(), ..Column::new("u_late", Role::Input) },
        ];
        assert!(fitted(&late).ends_with("for 0 states; `u_late = lag(u, 12)`."), "{}", fitted(&late));
        // A column of that name in the log is none.
        late.recipe = Recipe::parse("[states]\nx = {}\n[inputs]\nu_late = {}\n", "test").unwrap();
        assert!(fitted(&late).ends_with("for 0 states."), "{}", fitted(&late));
    }
}
