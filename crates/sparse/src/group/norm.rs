//! The dual norm of one group: the least lambda at which its coefficients are zero.

use crate::kernel::norm;

/// The least lambda with `|(c - lambda l1)_+| <= lambda group`, for pushes c >= 0 and weights that are not both zero.
///
/// `(c - lambda l1)_+` is piecewise linear in lambda, so that the root is that of a quadratic once the number of its entries is known: exact, up to sorting
/// (the epsilon-norm of Burdakov 1988; Ndiaye, Fercoq, Gramfort, Salmon 2016, algorithm 1).
pub(super) fn critical(pushes: impl Iterator<Item = f64> + Clone, l1: f64, group: f64) -> f64 {
    let largest = pushes.clone().fold(0.0, f64::max);
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    if group == 0.0 {
        return largest / l1;
    }
    if l1 == 0.0 {
        return norm(pushes.map(|push| push.max(0.0))) / group;
    }
    let mut sorted: Vec<f64> = pushes.filter(|push| *push > 0.0).map(|push| push / largest).collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    // Mean of the k largest, and their squares about it: nothing cancels.
    let (mut mean, mut scatter) = (0.0, 0.0);
    for (at, &push) in sorted.iter().enumerate() {
        let k = (at + 1) as f64;
        let apart = push - mean;
        mean += apart / k;
        scatter += apart * (push - mean);
        let next = sorted.get(at + 1).copied().unwrap_or(0.0);
        if scatter + k * (mean - next).powi(2) >= (group / l1 * next).powi(2) {
            let square = scatter + k * mean * mean;
            let root = (group * group * square - k * l1 * l1 * scatter).max(0.0).sqrt();
            return largest * (square / (k * l1 * mean + root));
        }
    }
    // The last entry's `next` is zero, so that its condition holds.
    largest / l1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Left side less right side of the condition at lambda.
    fn left(pushes: &[f64], l1: f64, group: f64, lambda: f64) -> f64 {
        norm(pushes.iter().map(|push| (push - lambda * l1).max(0.0))) - lambda * group
    }

    #[test]
    fn root_matches_a_bisection() {
        let mut compared = 0;
        for seed in 0..200_u64 {
            let push = |k: u64| (((seed * 31 + k * 17) % 97) as f64 / 97.0).powi(3) * 10.0;
            let pushes: Vec<f64> = (0..1 + seed % 7).map(push).collect();
            for (l1, group) in [(0.3, 0.7), (1e-6, 2.0), (0.999, 1e-3), (0.5, 0.5), (2.0, 9.0), (0.0, 1.0), (1.0, 0.0)]
            {
                let threshold = critical(pushes.iter().copied(), l1, group);
                // Down to 1e9 over the 200th power of two.
                let (mut low, mut high) = (0.0, 1e9);
                for _ in 0..200 {
                    let middle = 0.5 * (low + high);
                    if left(&pushes, l1, group, middle) > 0.0 { low = middle } else { high = middle }
                }
                assert!(
                    (threshold - high).abs() <= 1e-12 * high + 1e-40,
                    "{pushes:?} {l1} {group}: {threshold} {high}"
                );
                compared += 1;
            }
        }
        assert_eq!(compared, 1400);
    }

    #[test]
    fn equal_pushes_do_not_cancel() {
        // sqrt(4) (1 - lambda/2) = lambda/2 has the root 4/3.
        let threshold = critical([1.0; 4].into_iter(), 0.5, 0.5);
        assert!((threshold - 4.0 / 3.0).abs() < 1e-15);
        assert_eq!(critical([0.0, -1.0].into_iter(), 0.5, 0.5), 0.0);
    }
}
