//! Samples and rows that are not at the same stamps.

/// Samples and rows on one time axis.
#[derive(Debug, PartialEq)]
pub(crate) struct Merged {
    /// Seconds, rising.
    pub(crate) times: Vec<f64>,
    /// The samples; NaN at stamps that are a row's alone.
    pub(crate) values: Vec<f64>,
    /// Index of each row.
    pub(crate) rows: Vec<usize>,
}

/// Puts samples and rows together; both have rising stamps. A row at the stamp of a sample is that sample.
pub(crate) fn merged(times: &[f64], values: &[f64], rows: &[f64]) -> Merged {
    let mut all = Merged { times: Vec::new(), values: Vec::new(), rows: Vec::with_capacity(rows.len()) };
    let mut sample = 0;
    for &row in rows {
        while sample < times.len() && times[sample] <= row {
            all.times.push(times[sample]);
            all.values.push(values[sample]);
            sample += 1;
        }
        if all.times.last() != Some(&row) {
            all.times.push(row);
            all.values.push(f64::NAN);
        }
        all.rows.push(all.times.len() - 1);
    }
    all.times.extend_from_slice(&times[sample..]);
    all.values.extend_from_slice(&values[sample..]);
    all
}

/// Rows that have no sample at their stamp, and whose neighbours among the samples are more than `bridged` seconds
/// apart. Before the first sample and beyond the last one the first and the last row take the neighbour's place.
pub(crate) fn empty_rows(times: &[f64], values: &[f64], rows: &[f64], bridged: f64) -> Vec<usize> {
    let is_measured = |(_, value): &(&f64, &f64)| !value.is_nan();
    let measured: Vec<f64> = times.iter().zip(values).filter(is_measured).map(|(time, _)| *time).collect();
    let (Some(&first), Some(&last)) = (rows.first(), rows.last()) else { return Vec::new() };
    let mut after = 0;
    let mut is_empty = |time: f64| {
        while after < measured.len() && measured[after] <= time {
            after += 1;
        }
        let before = after.checked_sub(1).map(|before| measured[before]);
        let next = measured.get(after).copied();
        before != Some(time) && (measured.is_empty() || next.unwrap_or(last) - before.unwrap_or(first) > bridged)
    };
    (0..rows.len()).filter(|&row| is_empty(rows[row])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_and_rows_share_an_axis() {
        let all = merged(&[0.0, 1.0, 2.5], &[5.0, 6.0, 7.0], &[-1.0, 1.0, 1.5, 2.0]);
        assert_eq!(all.times, [-1.0, 0.0, 1.0, 1.5, 2.0, 2.5]);
        assert_eq!(all.rows, [0, 2, 3, 4]);
        let known: Vec<f64> = all.values.into_iter().filter(|value| !value.is_nan()).collect();
        assert_eq!(known, [5.0, 6.0, 7.0]);
    }

    #[test]
    fn rows_far_from_samples_are_empty() {
        let (times, values) = ([0.0, 1.0, 2.0, 6.0], [1.0, 1.0, f64::NAN, 1.0]);
        assert_eq!(empty_rows(&times, &values, &[-2.0, -0.5, 0.5, 3.0, 6.0, 6.5, 9.0], 1.5), [0, 1, 3, 5, 6]);
        assert_eq!(empty_rows(&times, &values, &[-0.5, 0.5, 6.0, 6.5], 1.5), [0_usize; 0]);
        assert_eq!(empty_rows(&times, &values, &times, 10.0), [0_usize; 0]);
        assert_eq!(empty_rows(&times, &values, &times, 1.5), [2]);
        assert_eq!(empty_rows(&[0.0], &[f64::NAN], &[0.0], 1.0), [0]);
    }
}
