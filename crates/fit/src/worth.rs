//! Models that are not worth having, said at once: what they predict of rows that did not train is no nearer than the mean, or than the row before.

use fleetfoot_data::setting::{FIT_NARX, LAGS};
use fleetfoot_model::{Model, Prediction};

use fleetfoot_report::words::ratio;

use crate::{baselines::TargetBaselines, by_time::ByTime};

/// Commands that find what is wrong where nothing is predicted.
pub(crate) const NEXT: &str =
    "`fleetfoot check` looks for faults in the log, `fleetfoot auto` for lags, regions and longer steps";

/// A note on the targets whose held-out squared error is that of their mean or more, each with its ratio. `None` if all
/// are predicted better. `what`: the compared quantity, `simulated` or `predicted`.
pub(crate) fn no_better(what: &str, targets: impl IntoIterator<Item = (String, f64)>) -> Option<String> {
    let poor: Vec<String> = targets
        .into_iter()
        .filter(|(_, share)| *share >= 1.0)
        .map(|(name, share)| format!("{name} ({share:.3} of the variance)"))
        .collect();
    (!poor.is_empty())
        .then(|| format!("held-out rows are {what} no better than by their mean: {}; {NEXT}", poor.join(", ")))
}

/// A note on the next and present values that the row before predicts better than a model does on rows that did not train, by root mean squared errors; `held_out` are those of the
/// model, by the left sides of its equations. Of derivatives and differences the row before is one that was measured just now, and no model has it.
pub(crate) fn worse_than_persistence(
    model: &Model,
    held_out: impl IntoIterator<Item = (String, f64)>,
    baselines: &[TargetBaselines],
) -> Option<String> {
    let is_value = |name: &str| {
        let equation = model.fitted().find(|equation| equation.label() == name);
        equation.is_some_and(|equation| matches!(equation.prediction, Prediction::Next | Prediction::Value))
    };
    let worse = |(name, error): (String, f64)| {
        let before = baselines.iter().find(|baseline| baseline.target == name)?.persistence_rmse;
        (is_value(&name) && before < error).then(|| format!("{name} ({before:.3e} against {error:.3e})"))
    };
    let worse: Vec<String> = held_out.into_iter().filter_map(worse).collect();
    (!worse.is_empty()).then(|| {
        format!(
            "persistence (the previous row) has a lower one-step error on held-out rows than the model: {}; add earlier rows ({LAGS}), or try {FIT_NARX}",
            worse.join(", ")
        )
    })
}

/// The last sentence of a fit: held-out errors over those of the mean (roots of the shares of the variance), the
/// worse of the folds and of the last rows. `None` without a held-out error.
pub(crate) fn verdict(
    what: &str,
    targets: impl IntoIterator<Item = (String, f64)>,
    by_time: Option<&ByTime>,
) -> Option<String> {
    let last = |name: &str| by_time.into_iter().flat_map(|errors| &errors.targets).find(|error| error.target == name);
    let worse = |(name, share): (String, f64)| {
        let share = last(&name).map_or(share, |error| share.max(error.share));
        // Of rounding errors R2 may be above 1; an unknown share stays unknown.
        (name, if share < 0.0 { 0.0 } else { share.sqrt() })
    };
    let known = |(_, error): &(String, f64)| !error.is_nan();
    let mut errors: Vec<(String, f64)> = targets.into_iter().map(worse).filter(known).collect();
    errors.sort_by(|a, b| a.1.total_cmp(&b.1));
    let word = |(name, error): &(String, f64)| format!("{} ({name})", ratio(*error));
    let range = match errors.as_slice() {
        [] => return None,
        [one] => word(one),
        [least, .., most] => format!("{} to {}", word(least), word(most)),
    };
    let poor: Vec<&str> = errors.iter().filter(|(_, error)| *error >= 1.0).map(|(name, _)| name.as_str()).collect();
    let judged = match poor.as_slice() {
        [] => String::new(),
        poor => format!("; no better than the mean in {}", poor.join(", ")),
    };
    Some(format!(
        "Verdict: rows that did not train are {what} with an error of {range} times that of the mean{judged}."
    ))
}

#[cfg(test)]
mod tests {
    use super::{no_better, verdict};

    #[test]
    fn verdict_names_the_least_and_the_largest_error() {
        let of = |shares: &[(&str, f64)]| verdict("predicted", shares.iter().map(|&(n, s)| (n.to_owned(), s)), None);
        assert_eq!((of(&[]), of(&[("a", f64::NAN)])), (None, None));
        let one = of(&[("a", 0.25)]).unwrap_or_default();
        assert_eq!(
            one,
            "Verdict: rows that did not train are predicted with an error of 0.500 (a) times that of the mean."
        );
        let three = of(&[("a", 0.25), ("b", 1.44), ("c", 0.01)]).unwrap_or_default();
        assert!(
            three.contains("0.100 (c) to 1.200 (b)") && three.ends_with("no better than the mean in b."),
            "{three}"
        );
    }

    #[test]
    fn targets_without_gain_are_named() {
        let of = |shares: [f64; 2]| no_better("predicted", [("a".to_owned(), shares[0]), ("b".to_owned(), shares[1])]);
        assert_eq!((of([0.5, 0.99]), of([f64::NAN, 0.2])), (None, None));
        let note = of([0.5, 1.2]).unwrap_or_default();
        assert!(note.contains("by their mean: b (1.200 of the variance);"), "{note}");
        assert!(of([f64::INFINITY, 0.5]).is_some_and(|note| note.contains("a (inf")));
    }
}
