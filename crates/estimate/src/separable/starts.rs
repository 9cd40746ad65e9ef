//! Points spread between the bounds of parameters.

use crate::Parameter;

/// Bounds further apart than this are filled evenly in the logarithm.
const DECADE: f64 = 10.0;

/// The initial values, and `count` points between the bounds: even for one parameter. For several they follow the
/// additive recurrence with the generalised golden ratio (Roberts, The unreasonable effectiveness of quasirandom
/// sequences, 2018). Parameters without finite bounds, or without room between them, stay.
pub(super) fn points(parameters: &[Parameter], count: usize) -> Vec<Vec<f64>> {
    let initial: Vec<f64> = parameters.iter().map(|parameter| parameter.initial).collect();
    let moving = |parameter: &Parameter| {
        let [low, high] = parameter.bounds;
        low.is_finite() && high.is_finite() && low < high
    };
    let free: Vec<usize> = (0..parameters.len()).filter(|&j| moving(&parameters[j])).collect();
    let mut points = vec![initial.clone()];
    if free.is_empty() {
        return points;
    }
    let ratio = golden(free.len());
    for k in 0..count {
        let mut point = initial.clone();
        for (place, &j) in free.iter().enumerate() {
            let share = if free.len() == 1 {
                (k as f64 + 0.5) / count as f64
            } else {
                (0.5 + (k + 1) as f64 * ratio.powi(-(place as i32 + 1))).fract()
            };
            point[j] = between(parameters[j].bounds, share);
        }
        points.push(point);
    }
    points
}

fn between([low, high]: [f64; 2], share: f64) -> f64 {
    let value =
        if low > 0.0 && high / low >= DECADE { low * (high / low).powf(share) } else { low + share * (high - low) };
    value.clamp(low, high)
}

/// The positive root of `x^(d+1) = x + 1`.
fn golden(d: usize) -> f64 {
    let mut x = 2.0_f64;
    // A contraction: every turn takes at least half of the distance.
    for _ in 0..64 {
        x = (1.0 + x).powf(1.0 / (d as f64 + 1.0));
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_fill_the_bounds_evenly() {
        assert!((golden(1) - 1.618_033_988_749_895).abs() < 1e-14 && (golden(2) - 1.324_717_957_244_746).abs() < 1e-14);
        let lag = [Parameter::new("tau", 0.05).between(0.01, 1.0)];
        let points_of_lag = points(&lag, 4);
        assert_eq!(points_of_lag[0], [0.05]);
        for pair in points_of_lag[1..].windows(2) {
            assert!((pair[1][0] / pair[0][0] - 100_f64.powf(0.25)).abs() < 1e-12);
        }
        let box_of = [
            Parameter::new("a", 0.0).between(-1.0, 1.0),
            Parameter::new("b", 7.0),
            Parameter::new("c", 0.1).between(0.0, 4.0),
        ];
        let spread = points(&box_of, 64);
        assert!(spread.iter().all(|p| p[0].abs() <= 1.0 && p[1] == 7.0 && (0.0..=4.0).contains(&p[2])));
        // As many in every quarter, up to what a sequence of low discrepancy misses.
        for (left, below) in [(true, true), (true, false), (false, true), (false, false)] {
            let count = spread[1..].iter().filter(|p| (p[0] < 0.0) == left && (p[2] < 2.0) == below).count();
            assert!((14..=18).contains(&count), "{count}");
        }
        assert_eq!(points(&[Parameter::new("free", 1.0)], 9).len(), 1);
    }
}
