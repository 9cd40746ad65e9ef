//! Models that are not worth having, said at once: what they predict of rows that did not train is no nearer than the mean, or than the row before.

use fleetfoot_data::setting::{FIT_NARX, LAGS};
use fleetfoot_model::{Model, Prediction};

use crate::baselines::TargetBaselines;

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

#[cfg(test)]
mod tests {
    use super::no_better;

    #[test]
    fn targets_that_the_mean_predicts_as_well_are_named() {
        let of = |shares: [f64; 2]| no_better("predicted", [("a".to_owned(), shares[0]), ("b".to_owned(), shares[1])]);
        assert_eq!((of([0.5, 0.99]), of([f64::NAN, 0.2])), (None, None));
        let said = of([0.5, 1.2]).unwrap_or_default();
        assert!(said.contains("by their mean: b (1.200 of the variance);"), "{said}");
        assert!(of([f64::INFINITY, 0.5]).is_some_and(|said| said.contains("a (inf")));
    }
}
