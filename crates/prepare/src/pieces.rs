//! The pieces of an episode: its ends cut off, ended where a channel is out of bounds.

use std::ops::Range;

/// Rows that stay, in pieces, and those that end them.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Pieces {
    /// Rows cut off at the ends.
    pub(crate) clipped: usize,
    /// Rows out of bounds.
    pub(crate) outside: Vec<usize>,
    /// Rows of pieces that are too short.
    pub(crate) too_short: Vec<usize>,
    pub(crate) pieces: Vec<Range<usize>>,
}

/// The rows of an episode, `times` in s, that are `clip` seconds and more from its ends. They come in runs of `least`
/// rows or more on which no channel is out of its bounds.
pub(crate) fn pieces(times: &[f64], channels: &[(&[f64], [f64; 2])], clip: f64, least: usize) -> Pieces {
    let (Some(&first), Some(&last)) = (times.first(), times.last()) else { return Pieces::default() };
    let from = times.partition_point(|&time| time < first + clip);
    let to = times.partition_point(|&time| time <= last - clip).max(from);
    let mut pieces = Pieces { clipped: times.len() - (to - from), ..Pieces::default() };
    // A value that is missing is not out of bounds.
    let is_outside =
        |row: &usize| channels.iter().any(|(values, [low, high])| values[*row] < *low || values[*row] > *high);
    pieces.outside = (from..to).filter(is_outside).collect();
    let mut start = from;
    for end in pieces.outside.iter().copied().chain([to]) {
        if end - start >= least {
            pieces.pieces.push(start..end);
        } else {
            pieces.too_short.extend(start..end);
        }
        start = (end + 1).min(to);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_cut_and_rows_out_of_bounds_end_pieces() {
        let times: Vec<f64> = (0..20).map(f64::from).collect();
        let mut values = vec![0.0; 20];
        (values[3], values[8], values[10]) = (f64::NAN, 5.0, -5.0);
        let result = pieces(&times, &[(&values, [-1.0, 1.0])], 2.0, 3);
        let expected = Pieces { clipped: 4, outside: vec![8, 10], too_short: vec![9], pieces: vec![2..8, 11..18] };
        assert_eq!(result, expected);
        let all = pieces(&times, &[], 0.0, 2);
        assert_eq!((all.pieces.first(), all.clipped), (Some(&(0..20)), 0));
        assert_eq!(pieces(&times, &[], 30.0, 2).clipped, 20);
        assert_eq!(pieces(&[], &[], 0.0, 2), Pieces::default());
    }
}
