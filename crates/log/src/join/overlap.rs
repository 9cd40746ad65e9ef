//! Pairing of the runs of two series, and the error when none overlap.

use crate::{
    Error,
    join::{Run, Series},
};

/// Runs that are compared with a run of the base at most. Log times that rise leave two or three; only a damaged file has more.
const CANDIDATES: usize = 4096;

/// The runs of a series by their log times.
///
/// Stamps do not tell which runs of two series belong together: a simulation that restarts begins at zero each time. The log times do.
pub(super) struct LogTimes<'a> {
    runs: &'a [Run],
    /// Latest end of a run and of all before it: rises.
    latest_end: Vec<i64>,
    /// Earliest start of a run and of all after it: rises.
    earliest_start: Vec<i64>,
}

impl<'a> LogTimes<'a> {
    pub(super) fn new(series: &'a Series) -> Self {
        let running = |values: &mut dyn Iterator<Item = i64>, better: fn(i64, i64) -> i64| {
            let mut best = None;
            values.map(|value| *best.insert(best.map_or(value, |best| better(best, value)))).collect::<Vec<i64>>()
        };
        let runs = &series.runs;
        let latest_end = running(&mut runs.iter().map(|run| run.log_end), i64::max);
        let mut earliest_start = running(&mut runs.iter().rev().map(|run| run.log_start), i64::min);
        earliest_start.reverse();
        Self { runs, latest_end, earliest_start }
    }

    /// The run whose log times overlap most with those of `run`, of equals the first.
    ///
    /// A latched run may also have been recorded before: then it is the last earlier one. `alone`: the base has no
    /// other run. If this series has none either, there is no choice, whatever the log times are.
    pub(super) fn matching(&self, run: &Run, alone: bool, latched: bool) -> Option<usize> {
        if alone && self.runs.len() == 1 {
            return Some(0);
        }
        let from = self.latest_end.partition_point(|&end| end < run.log_start);
        let to = self.earliest_start.partition_point(|&start| start <= run.log_end);
        let mut best: Option<(usize, i128)> = None;
        for (place, other) in self.runs.iter().enumerate().take(to).skip(from).take(CANDIDATES) {
            let overlap = i128::from(other.log_end.min(run.log_end)) - i128::from(other.log_start.max(run.log_start));
            // A run of one sample has a log time and no duration: an overlap of zero counts.
            if overlap >= best.map_or(0, |(_, most)| most + 1) {
                best = Some((place, overlap));
            }
        }
        best.map(|(place, _)| place).or(if latched { from.checked_sub(1) } else { None })
    }
}

/// First and last of the stamps that two matching runs share; the last is before the first when they share none.
pub(super) fn shared(run: &Run, other: &Run, latched: bool) -> (i64, i64) {
    (run.start.max(other.start), if latched { run.end } else { run.end.min(other.end) })
}

/// Two series without a moment in common.
pub(super) fn no_overlap(first: &Series, second: &Series) -> Error {
    let stamps = |series: &Series| range(series, |run| (run.start, run.end));
    let log_times = |series: &Series| range(series, |run| (run.log_start, run.log_end));
    let apart = |(a, b): ((i64, i64), (i64, i64))| a.1 < b.0 || b.1 < a.0;
    let (by_stamp, by_log) = ((stamps(first), stamps(second)), (log_times(first), log_times(second)));
    // When the clocks agree as a whole, it is the recording that does not.
    let (what, (first_range, second_range)) =
        if !apart(by_stamp) && apart(by_log) { ("log times", by_log) } else { ("stamps", by_stamp) };
    Error::NoOverlap {
        path: first.source.clone(),
        what,
        first: first.name.clone(),
        second: second.name.clone(),
        ranges: Box::new([first_range, second_range]),
    }
}

fn range(series: &Series, of: impl Fn(&Run) -> (i64, i64)) -> (i64, i64) {
    let ranges = || series.runs.iter().map(&of);
    (ranges().map(|range| range.0).min().unwrap_or(0), ranges().map(|range| range.1).max().unwrap_or(0))
}
