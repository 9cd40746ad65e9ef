//! The join once more, by definition: every row looks at every sample. Slow, and written apart from the real one.

use crate::{MaxGap, join::JoinKind};

/// A sample of the test series: stamp, and the values x, qx, qy, qz, qw.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    pub stamp: i64,
    pub log_time: i64,
    pub values: [f64; 5],
}

pub(super) type Runs = Vec<Vec<Sample>>;

/// Median step, upper, over all runs; of uneven ones the mean, of bursts the median of the steps between them.
fn period(runs: &Runs) -> i64 {
    let mut steps: Vec<i64> =
        runs.iter().flat_map(|run| run.windows(2).map(|pair| pair[1].stamp - pair[0].stamp)).collect();
    steps.sort_unstable();
    let Some(&median) = steps.get(steps.len() / 2) else { return 0 };
    let mean_below = |most: f64| {
        let below: Vec<f64> = steps.iter().map(|&step| step as f64).filter(|&step| step <= most).collect();
        below.iter().sum::<f64>() / below.len() as f64
    };
    let mean = mean_below(50.0 * mean_below(f64::INFINITY));
    let longer = |least: i64| -> Vec<i64> {
        steps.iter().copied().filter(|&step| step > least && step as f64 <= 50.0 * mean).collect()
    };
    let (long, longest) = (longer(2 * median), longer(5 * median));
    if mean <= 2.0 * median as f64 || long.len() < 3 {
        median
    } else if mean <= 5.0 * median as f64 || longest.len() < 3 {
        mean as i64
    } else {
        (mean as i64).max(longest[longest.len() / 2])
    }
}

/// Nanoseconds; a large number for none.
pub(super) fn limit(runs: &Runs, gap: MaxGap) -> i64 {
    match gap {
        MaxGap::Auto => 5 * period(runs),
        MaxGap::Seconds(seconds) => (seconds * 1e9).round() as i64,
        MaxGap::Unlimited => i64::MAX,
    }
}

/// The run recorded along with `base`, one of `count` base runs.
pub(super) fn matching<'a>(runs: &'a Runs, base: &[Sample], count: usize, latched: bool) -> Option<&'a Vec<Sample>> {
    if count == 1 && runs.len() == 1 {
        return runs.first();
    }
    let log = |run: &[Sample]| {
        let times = || run.iter().map(|sample| sample.log_time);
        (times().min().unwrap(), times().max().unwrap())
    };
    let (from, to) = log(base);
    let overlaps: Vec<i64> = runs.iter().map(|run| log(run).1.min(to) - log(run).0.max(from)).collect();
    let most = overlaps.iter().copied().max()?;
    if most >= 0 {
        return runs.iter().zip(overlaps).find(|(_, overlap)| *overlap == most).map(|(run, _)| run);
    }
    runs.iter().rfind(|run| latched && log(run).1 < from)
}

/// Value at `stamp`: one number, or the rotation matrix of a quaternion, row by row; `None` without a value.
pub(super) fn value(run: &[Sample], stamp: i64, kind: JoinKind, limit: i64) -> Option<Vec<f64>> {
    let before = run.iter().filter(|sample| sample.stamp <= stamp).max_by_key(|sample| sample.stamp)?;
    let after = run.iter().filter(|sample| sample.stamp >= stamp).min_by_key(|sample| sample.stamp);
    if kind == JoinKind::Hold {
        let latched = limit == i64::MAX;
        let good = latched || (after.is_some() && stamp - before.stamp <= limit);
        return good.then(|| vec![before.values[0]]).filter(|value| !value[0].is_nan());
    }
    let after = after?;
    let apart = after.stamp - before.stamp;
    if apart > limit {
        return None;
    }
    let weight = if apart == 0 { 0.0 } else { (after.stamp - stamp) as f64 / apart as f64 };
    let weights = if apart == 0 { (1.0, 0.0) } else { (weight, (stamp - before.stamp) as f64 / apart as f64) };
    let (a, b) = (before.values, after.values);
    let looked_up = match kind {
        JoinKind::Linear => vec![a[0] * weights.0 + b[0] * weights.1],
        // The angle between two directions by their products.
        JoinKind::Angle => {
            let turn = (a[0].cos() * b[0].sin() - a[0].sin() * b[0].cos())
                .atan2(a[0].cos() * b[0].cos() + a[0].sin() * b[0].sin());
            vec![a[0] + weights.1 * turn]
        }
        _ => rotate_part(matrix(&a[1..])?, matrix(&b[1..])?, weights.1),
    };
    (!looked_up.iter().any(|value| value.is_nan())).then_some(looked_up)
}

/// The rotation matrix of x, y, z, w; `None` for the zero quaternion.
pub(super) fn matrix(q: &[f64]) -> Option<[[f64; 3]; 3]> {
    let s = q.iter().map(|c| c * c).sum::<f64>();
    if s.is_nan() || s <= 0.0 {
        return None;
    }
    let (x, y, z, w) = (q[0], q[1], q[2], q[3]);
    let k = 2.0 / s;
    Some([
        [1.0 - k * (y * y + z * z), k * (x * y - z * w), k * (x * z + y * w)],
        [k * (x * y + z * w), 1.0 - k * (x * x + z * z), k * (y * z - x * w)],
        [k * (x * z - y * w), k * (y * z + x * w), 1.0 - k * (x * x + y * y)],
    ])
}

fn times(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// A exp(part * log(A' B)), by Rodrigues.
fn rotate_part(a: [[f64; 3]; 3], b: [[f64; 3]; 3], part: f64) -> Vec<f64> {
    let transposed = std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]));
    let d = times(&transposed, &b);
    let skew = [d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]].map(|c| c / 2.0);
    let sine = skew.iter().map(|c| c * c).sum::<f64>().sqrt();
    let theta = sine.atan2((d[0][0] + d[1][1] + d[2][2] - 1.0) / 2.0);
    let axis = if sine > 0.0 { skew.map(|c| c / sine) } else { [0.0; 3] };
    let k = [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]];
    let kk = times(&k, &k);
    let (s, c) = ((part * theta).sin(), 1.0 - (part * theta).cos());
    let turn: [[f64; 3]; 3] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j) + s * k[i][j] + c * kk[i][j]));
    times(&a, &turn).concat()
}

/// Half a turn between two neighbours can go either way, and nearly half a turn is beyond the oracle's accuracy.
pub(super) fn ambiguous(run: &[Sample], stamp: i64, kind: JoinKind) -> bool {
    let before = run.iter().filter(|sample| sample.stamp <= stamp).max_by_key(|sample| sample.stamp);
    let after = run.iter().filter(|sample| sample.stamp >= stamp).min_by_key(|sample| sample.stamp);
    let (Some(before), Some(after)) = (before, after) else {
        return false;
    };
    let (a, b) = (before.values, after.values);
    match kind {
        JoinKind::Angle => (a[0] - b[0]).cos() < -1.0 + 1e-9,
        JoinKind::Slerp => {
            let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
            let (p, q) = (&a[1..], &b[1..]);
            product(p, q).abs() < 1e-3 * (product(p, p) * product(q, q)).sqrt()
        }
        _ => false,
    }
}
