//! Means of a channel over windows about its stamps.

/// The mean of the channel over `width` seconds about every stamp, as straight lines join its measured values; NaN where nothing was measured, and where the window reaches beyond the record or over a
/// gap that is twice as wide.
pub(crate) fn means(times: &[f64], values: &[f64], width: f64) -> Vec<f64> {
    let measured: Vec<(f64, f64)> =
        times.iter().copied().zip(values.iter().copied()).filter(|(_, value)| !value.is_nan()).collect();
    let mut out = vec![f64::NAN; times.len()];
    let Some(&(last, _)) = measured.last() else { return out };
    let mut integral = vec![0.0; measured.len()];
    for (k, pair) in measured.windows(2).enumerate() {
        let [(from, a), (to, b)] = [pair[0], pair[1]];
        integral[k + 1] = integral[k] + 0.5 * (a + b) * (to - from);
    }
    // The integral up to t within the piece behind `k`.
    let up_to = |t: f64, k: usize| {
        let ((from, a), (to, b)) = (measured[k], measured[k + 1]);
        let share = (t - from) / (to - from);
        integral[k] + (t - from) * (a + 0.5 * share * (b - a))
    };
    let piece = |t: f64, k: &mut usize| {
        while *k + 2 < measured.len() && measured[*k + 1].0 <= t {
            *k += 1;
        }
        *k
    };
    let (mut low, mut high, mut gap, mut seen) = (0, 0, f64::NEG_INFINITY, 0);
    for (out, (&t, value)) in out.iter_mut().zip(times.iter().zip(values)) {
        let (from, to) = (t - 0.5 * width, t + 0.5 * width);
        if value.is_nan() || from < measured[0].0 || to > last || measured.len() < 2 {
            continue;
        }
        let (first, end) = (piece(from, &mut low), piece(to, &mut high));
        for k in seen..=end {
            if measured[k + 1].0 - measured[k].0 >= 2.0 * width {
                gap = measured[k + 1].0;
            }
        }
        seen = end;
        if from >= gap {
            *out = (up_to(to, end) - up_to(from, first)) / width;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Straight lines: of t^2 between stamps of 0.1 the mean over w is t^2 + w^2/12, and what joining by lines adds.
    #[test]
    fn means_of_a_parabola() {
        let times: Vec<f64> = (0..50).map(|row| 0.1 * f64::from(row)).collect();
        let values: Vec<f64> = times.iter().map(|t| t * t).collect();
        let averaged = means(&times, &values, 0.4);
        assert!(averaged[..2].iter().chain(&averaged[48..]).all(|mean| mean.is_nan()));
        for (t, mean) in times.iter().zip(&averaged).skip(2).take(46) {
            assert!((mean - (t * t + 0.16 / 12.0 + 0.01 / 6.0)).abs() < 1e-12, "{t} {mean}");
        }
    }

    #[test]
    fn windows_do_not_reach_over_gaps() {
        let times: Vec<f64> = (0..40).map(|row| 0.1 * f64::from(row) + if row < 20 { 0.0 } else { 1.0 }).collect();
        let mut values = vec![2.0; 40];
        values[10] = f64::NAN;
        let averaged = means(&times, &values, 0.25);
        let missing: Vec<usize> = (0..40).filter(|&row| averaged[row].is_nan()).collect();
        // Both ends, the row that was not measured (0.2 s are no gap), and both sides of the gap.
        assert_eq!(missing, [0, 1, 10, 18, 19, 20, 21, 38, 39]);
        assert!(averaged.iter().filter(|mean| !mean.is_nan()).all(|mean| (mean - 2.0).abs() < 1e-12));
        assert!(means(&times, &[f64::NAN; 40], 0.25).iter().all(|mean| mean.is_nan()));
    }
}
