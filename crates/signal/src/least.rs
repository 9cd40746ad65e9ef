//! The least value of a function of one number: a grid first, then parabolas between the neighbours of its best point.

use fleetfoot_data::parallel_all;

/// Points of the grid.
const POINTS: usize = 24;

/// Minimum of a function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Least {
    /// The argument.
    pub(crate) at: f64,
    /// True if the minimum is an end of the range: the least value may lie beyond.
    pub(crate) at_end: bool,
}

/// The points of the grid, in order.
fn grid(low: f64, high: f64) -> Vec<f64> {
    (0..POINTS).map(|i| low + (high - low) * i as f64 / (POINTS - 1) as f64).collect()
}

/// NaN counts as greater than anything.
fn comparable(y: f64) -> f64 {
    if y.is_nan() { f64::INFINITY } else { y }
}

/// The best point of a grid and its neighbours, or the end that is best.
fn about_best(points: &[f64], values: &[f64]) -> Result<[(f64, f64); 3], Least> {
    let best = (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    if best == 0 || best == values.len() - 1 {
        return Err(Least { at: points[best], at_end: true });
    }
    Ok([best - 1, best, best + 1].map(|i| (points[i], values[i])))
}

/// The minimum of `f` between `low` and `high`, to `width` of the argument. NaN counts as greater than anything.
///
/// The grid keeps the search out of local minima, which cross-validation has; its points are independent and go to all threads.
pub(crate) fn least(low: f64, high: f64, width: f64, f: impl Fn(f64) -> f64 + Sync) -> Least {
    let (points, value) = (grid(low, high), |x: f64| comparable(f(x)));
    let values = parallel_all(POINTS, |i| value(points[i]));
    match about_best(&points, &values) {
        Err(end) => end,
        Ok(known) => Least { at: parabolas(known, width, value), at_end: false },
    }
}

/// [`least`] of a function that takes several arguments at the price of one.
///
/// After the grid [`SIDES`] points go to either side of the vertex of the parabola through the three that are known: at steps that grow evenly from a sixteenth of `width` towards the ends of where the least lies, so that a parabola that
/// is nearly right ends the search, and one that is wrong leaves a part of what there was.
pub(crate) fn least_of_many(low: f64, high: f64, width: f64, f: impl Fn(&[f64]) -> Vec<f64>) -> Least {
    let all = |points: &[f64]| -> Vec<f64> { f(points).into_iter().map(comparable).collect() };
    let points = grid(low, high);
    let mut known = match about_best(&points, &all(&points)) {
        Err(end) => return end,
        Ok(known) => known,
    };
    loop {
        let [from, best, to] = known;
        let at = vertex(&known).unwrap_or(best.0);
        // Within so little the parabola is all that values tell.
        if to.0 - from.0 <= 8.0 * width {
            return Least { at, at_end: false };
        }
        let near = width / 16.0;
        let centre = at.clamp(from.0 + 2.0 * near, to.0 - 2.0 * near);
        let side = |end: f64| {
            let growth = ((end - centre).abs() / near).powf(1.0 / SIDES as f64);
            (0..SIDES).map(move |k| centre + (near * growth.powi(k as i32)).copysign(end - centre))
        };
        let mut points: Vec<f64> = side(from.0).chain(side(to.0)).collect();
        points.sort_by(f64::total_cmp);
        let mut evaluated: Vec<(f64, f64)> = points.iter().copied().zip(all(&points)).chain(known).collect();
        evaluated.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (points, values): (Vec<f64>, Vec<f64>) = evaluated.into_iter().unzip();
        // The ends are greater than what lies between.
        known = match about_best(&points, &values) {
            Err(end) => return Least { at_end: false, ..end },
            Ok(known) => known,
        };
    }
}

/// Points to either side of a vertex.
const SIDES: usize = 4;

/// Minimum of the parabola through three points, of which the middle one is least; `None` if values are infinite.
fn vertex([a, b, c]: &[(f64, f64); 3]) -> Option<f64> {
    let (left, right) = ((b.0 - a.0) * (b.1 - c.1), (b.0 - c.0) * (b.1 - a.1));
    let step = 0.5 * ((b.0 - a.0) * left - (b.0 - c.0) * right) / (left - right);
    step.is_finite().then_some(b.0 - step)
}

/// Parabolas through the three best points so far, golden sections where these do not halve the steps, to `width` (Brent, "Algorithms for Minimization without Derivatives", 1973, chapter 5). Of
/// the three points that are known, in order, the middle one is the least.
fn parabolas([low, middle, high]: [(f64, f64); 3], width: f64, f: impl Fn(f64) -> f64) -> f64 {
    let golden = 0.5 * (3.0 - 5.0_f64.sqrt());
    let near = 0.25 * width;
    let (mut from, mut to) = (low.0, high.0);
    let (mut best, [mut second, mut third]) = (middle, if low.1 < high.1 { [low, high] } else { [high, low] });
    let (mut step, mut before) = (to - from, to - from);
    loop {
        let centre = 0.5 * (from + to);
        if (best.0 - centre).abs() <= 2.0 * near - 0.5 * (to - from) {
            return best.0;
        }
        let r = (best.0 - second.0) * (best.1 - third.1);
        let q = (best.0 - third.0) * (best.1 - second.1);
        let p = (best.0 - third.0) * q - (best.0 - second.0) * r;
        let q = 2.0 * (r - q);
        let vertex = p / q;
        // Values that are infinite have no parabola: all of these are false then.
        let is_good = vertex.abs() < 0.5 * before.abs() && best.0 + vertex > from && best.0 + vertex < to;
        if is_good {
            (before, step) = (step, vertex);
            if best.0 + step - from < 2.0 * near || to - best.0 - step < 2.0 * near {
                step = near.copysign(centre - best.0);
            }
        } else {
            before = if best.0 >= centre { from - best.0 } else { to - best.0 };
            step = golden * before;
        }
        let at = best.0 + if step.abs() >= near { step } else { near.copysign(step) };
        let new = (at, f(at));
        let worse = if new.1 <= best.1 { best.0 } else { new.0 };
        if worse < best.0.max(new.0) {
            from = worse;
        } else {
            to = worse;
        }
        if new.1 <= best.1 {
            (best, second, third) = (new, best, second);
        } else if new.1 <= second.1 {
            (second, third) = (new, second);
        } else if new.1 <= third.1 {
            third = new;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deepest_of_two_valleys_is_chosen() {
        let f = |x: f64| (2.0 * x).cos() + 0.2 * (x - 4.0) * (x - 4.0);
        let minimum = least(0.0, 10.0, 1e-4, f);
        let fine = (0..=1_000_000).map(|i| f64::from(i) * 1e-5).min_by(|&a, &b| f(a).total_cmp(&f(b))).unwrap();
        assert!((minimum.at - fine).abs() < 1e-4 && !minimum.at_end, "{minimum:?} {fine}");
    }

    #[test]
    fn smooth_valleys_take_few_steps() {
        let steps = std::sync::atomic::AtomicUsize::new(0);
        let counted = |x: f64| {
            steps.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            (x - 0.345).powi(2) + 0.1 * (x - 0.345).powi(3)
        };
        assert!((least(-1.0, 2.0, 1e-4, counted).at - 0.345).abs() < 1e-4);
        assert!(steps.into_inner() < POINTS + 10);
        for limit in [0.2, 0.41, 0.6] {
            let cut = |x: f64| if x < limit { f64::NAN } else { x.floor() + (20.0 * x).rem_euclid(1.0) + x };
            let grid = (0..POINTS).map(|i| cut(i as f64 / (POINTS - 1) as f64)).fold(f64::INFINITY, f64::min);
            assert!(cut(least(0.0, 1.0, 1e-4, cut).at) <= grid, "{limit}");
        }
    }

    #[test]
    fn batched_points_find_the_same_minimum() {
        for (at, skew) in [(0.345, 0.1), (-0.71, 0.3), (1.9, -0.1), (0.0, 0.0)] {
            let rounds = std::sync::atomic::AtomicUsize::new(0);
            let valley = |x: f64| (x - at).powi(2) + skew * (x - at).powi(3);
            let minimum = least_of_many(-1.0, 2.0, 1e-4, |points| {
                rounds.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                points.iter().map(|x| valley(*x)).collect()
            });
            assert!((minimum.at - at).abs() < 1e-4 && !minimum.at_end, "{at}: {minimum:?}");
            // The grid, and two.
            assert!(rounds.into_inner() <= 3, "{at}");
        }
        // Steps, and values that are none: what is found is no greater than the grid's least.
        for limit in [0.2, 0.41, 0.6] {
            let cut = |x: f64| if x < limit { f64::NAN } else { x.floor() + (20.0 * x).rem_euclid(1.0) + x };
            let most = (0..POINTS).map(|i| cut(i as f64 / (POINTS - 1) as f64)).fold(f64::INFINITY, f64::min);
            let minimum = least_of_many(0.0, 1.0, 1e-4, |points| points.iter().map(|x| cut(*x)).collect());
            assert!(cut(minimum.at) <= most, "{limit}");
        }
        let line = |sign: f64| move |points: &[f64]| points.iter().map(|x| sign * x).collect::<Vec<f64>>();
        assert_eq!(least_of_many(1.0, 2.0, 1e-4, line(1.0)), Least { at: 1.0, at_end: true });
        assert_eq!(least_of_many(1.0, 2.0, 1e-4, line(-1.0)), Least { at: 2.0, at_end: true });
    }

    #[test]
    fn minimum_at_an_end_is_reported() {
        assert_eq!(least(1.0, 2.0, 1e-4, |x| x), Least { at: 1.0, at_end: true });
        assert_eq!(least(1.0, 2.0, 1e-4, |x| -x), Least { at: 2.0, at_end: true });
    }
}
