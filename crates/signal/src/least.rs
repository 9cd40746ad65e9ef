//! The least value of a function of one number: a grid first, then golden sections between the neighbours of its best point.

use fleetfoot_data::parallel_all;

/// Points of the grid.
const POINTS: usize = 24;

/// Where a function is least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Least {
    /// The argument.
    pub(crate) at: f64,
    /// Whether it is an end of the range: the least value may lie beyond.
    pub(crate) at_end: bool,
}

/// Where `f` is least between `low` and `high`, to `width` of the argument. NaN counts as greater than anything.
///
/// The grid keeps the search out of local minima, which cross-validation has; its points are independent and go to all threads.
pub(crate) fn least(low: f64, high: f64, width: f64, f: impl Fn(f64) -> f64 + Sync) -> Least {
    let point = |i: usize| low + (high - low) * i as f64 / (POINTS - 1) as f64;
    let value = |x: f64| Some(f(x)).filter(|y| !y.is_nan()).unwrap_or(f64::INFINITY);
    let values = parallel_all(POINTS, |i| value(point(i)));
    let best = (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    if best == 0 || best == POINTS - 1 {
        return Least { at: point(best), at_end: true };
    }
    Least { at: golden(point(best - 1), point(best + 1), width, value), at_end: false }
}

/// Golden sections to `width` (Kiefer, "Sequential minimax search for a maximum", 1953).
pub(crate) fn golden(mut low: f64, mut high: f64, width: f64, f: impl Fn(f64) -> f64) -> f64 {
    let ratio = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    while high - low > width {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - ratio * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + ratio * (high - low);
            at_b = f(b);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_of_two_valleys_is_found() {
        let f = |x: f64| (2.0 * x).cos() + 0.2 * (x - 4.0) * (x - 4.0);
        let found = least(0.0, 10.0, 1e-4, f);
        let fine = (0..=1_000_000).map(|i| f64::from(i) * 1e-5).min_by(|&a, &b| f(a).total_cmp(&f(b))).unwrap();
        assert!((found.at - fine).abs() < 1e-4 && !found.at_end, "{found:?} {fine}");
    }

    #[test]
    fn an_end_is_told() {
        assert_eq!(least(1.0, 2.0, 1e-4, |x| x), Least { at: 1.0, at_end: true });
        assert_eq!(least(1.0, 2.0, 1e-4, |x| -x), Least { at: 2.0, at_end: true });
    }
}
