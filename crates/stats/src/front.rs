//! What nothing as small beats.

/// Which of some models no other with as few coefficients beats: each is told by its number of coefficients and its error, which is not finite where it has none. Of equal ones the first stands for all.
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
