//! Pareto front of models by size and error.

/// For each model, given as (number of coefficients, error): true if every other model with as few or fewer
/// coefficients has a larger error. A model whose error is not finite is never on the front. Of equal models only the
/// first is.
pub fn front(models: &[(usize, f64)]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..models.len()).filter(|&at| models[at].1.is_finite()).collect();
    order.sort_by(|&a, &b| {
        let ((size, error), (other_size, other_error)) = (models[a], models[b]);
        size.cmp(&other_size).then(error.total_cmp(&other_error)).then(a.cmp(&b))
    });
    let (mut least, mut on) = (f64::INFINITY, vec![false; models.len()]);
    for at in order {
        on[at] = models[at].1 < least;
        least = least.min(models[at].1);
    }
    on
}
