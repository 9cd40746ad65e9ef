//! Note on models of no use: their held-out predictions are no nearer than the mean.

/// A note on the targets whose held-out squared error is that of their mean or more, each with its ratio. `None` if all
/// are predicted better. `what`: the compared quantity, `simulated` or `predicted`.
pub(crate) fn no_better(what: &str, targets: impl IntoIterator<Item = (String, f64)>) -> Option<String> {
    let poor: Vec<String> = targets
        .into_iter()
        .filter(|(_, share)| *share >= 1.0)
        .map(|(name, share)| format!("{name} ({share:.3} of the variance)"))
        .collect();
    (!poor.is_empty()).then(|| {
        format!(
            "rows that did not train are {what} no better than by their mean: {}; `fleetfoot check` looks for faults in the log, `fleetfoot auto` for lags, regions and longer steps",
            poor.join(", ")
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
