//! Differences of two paths: distance, direction, growth of the distance, and time warping (section 7.1 of *Towards
//! Sim-to-Real via Real-to-Sim*).
//!
//! A path is a slice of points, each of `width` coordinates of one unit, at the same instants for both paths.

use fleetfoot_stats::Estimate;

/// Scores of simulated paths beside the recorded ones.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PathScores {
    /// Mean cosine of the angle between the increments of both paths, by step ([`alignment`]).
    pub alignment: Vec<Estimate>,
    /// Mean over the steps of a rollout.
    pub average_alignment: Estimate,
    /// Relative growth of the distance over [`RolloutOptions::interval`](crate::RolloutOptions::interval) steps
    /// ([`propagated_error`]).
    pub propagated_error: Estimate,
    /// Distance of dynamic time warping within [`RolloutOptions::band`](crate::RolloutOptions::band) ([`warping_distance`]).
    pub warping_distance: Estimate,
}

/// Cosine of the angle between two increments. A path that rests while the other moves has 0; `None` where both rest.
pub fn alignment(a: &[f64], b: &[f64]) -> Option<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (size_a, size_b) = (dot(a, a).sqrt(), dot(b, b).sqrt());
    match (size_a > 0.0, size_b > 0.0) {
        (true, true) => Some((dot(a, b) / size_a / size_b).clamp(-1.0, 1.0)),
        (false, false) if size_a == 0.0 && size_b == 0.0 => None,
        _ if size_a.is_nan() || size_b.is_nan() => None,
        _ => Some(0.0),
    }
}

/// Mean of `(d[i + interval] - d[i]) / d[i]` over the instants with `d[i] > 0`; `None` without one. Both paths begin at
/// the same point, where the ratio does not exist.
pub fn propagated_error(distances: &[f64], interval: usize) -> Option<f64> {
    let pairs = distances.iter().zip(distances.get(interval..)?);
    let ratios: Vec<f64> = pairs
        .filter(|(now, _)| **now > 0.0)
        .map(|(now, later)| (later - now) / now)
        .filter(|r| r.is_finite())
        .collect();
    (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64)
}

/// Distance of dynamic time warping: the root of the least sum of squared distances over all monotone alignments of the
/// points that shift no point by more than `band` places (Sakoe and Chiba). `None` for an empty path or a value that is
/// not finite. Time grows with the length times the band.
pub fn warping_distance(a: &[f64], b: &[f64], width: usize, band: usize) -> Option<f64> {
    let (rows, columns) = (a.len() / width.max(1), b.len() / width.max(1));
    if rows == 0 || columns == 0 || a.iter().chain(b).any(|value| !value.is_finite()) {
        return None;
    }
    // Without this the last points cannot meet.
    let band = band.max(rows.abs_diff(columns));
    let mut before = vec![f64::INFINITY; columns + 1];
    let mut now = before.clone();
    before[0] = 0.0;
    for (i, point) in a.chunks_exact(width).enumerate() {
        now.fill(f64::INFINITY);
        for j in i.saturating_sub(band)..columns.min(i.saturating_add(band).saturating_add(1)) {
            let other = &b[j * width..(j + 1) * width];
            let square: f64 = point.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum();
            now[j + 1] = square + before[j].min(before[j + 1]).min(now[j]);
        }
        std::mem::swap(&mut before, &mut now);
    }
    Some(before[columns].sqrt())
}

#[cfg(test)]
mod tests {
    use super::{alignment, propagated_error, warping_distance};

    #[test]
    fn metrics_of_two_paths_follow_their_definitions() {
        assert_eq!(alignment(&[3.0, 0.0], &[0.0, 2.0]), Some(0.0));
        assert!((alignment(&[1.0, 1.0], &[-2.0, -2.0]).unwrap() + 1.0).abs() < 1e-15);
        assert_eq!(alignment(&[0.0, 0.0], &[0.0, 2.0]), Some(0.0));
        assert_eq!(alignment(&[0.0, 0.0], &[0.0, 0.0]), None);
        assert_eq!(propagated_error(&[0.0, 1.0, 2.0, 6.0], 1), Some(1.5));
        assert_eq!(propagated_error(&[0.0, 1.0, 2.0, 6.0], 2), Some(5.0));
        assert_eq!(propagated_error(&[0.0, 1.0], 4), None);
        // A ramp one sample late: all points but the last meet their equals.
        let (a, b) = ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 2.0]);
        assert_eq!(warping_distance(&a, &b, 1, 0), Some(3.0f64.sqrt()));
        assert_eq!(warping_distance(&a, &b, 1, 1), Some(1.0));
        assert_eq!(warping_distance(&a, &[f64::NAN], 1, 1), None);
    }
}
