//! Expected duration of a count of operations on this machine, from one timed regression.

use std::{sync::OnceLock, time::Instant};

use faer::Mat;
use fleetfoot_data::{Work, thread_count};

use crate::Factor;

/// Rows and columns of the regression that is timed.
const ROWS: usize = 512;
const COLUMNS: usize = 48;

/// The many factorisations of a fit take longer, an operation, than one of many rows: they are small, and memory is moved between them. (Fits of 90 to 180 candidates.)
const SMALL: f64 = 3.0;

/// Seconds that a person waits without wondering.
const PATIENCE: f64 = 10.0;

/// Less than this takes no such time on any machine, and none is measured.
const LEAST_OPERATIONS: f64 = 1e8;

/// Of several runs the fastest is the machine's own speed.
const RUNS: usize = 3;

/// Seconds that `operations` multiplications of dense factorisations take on one thread, about. The first call measures for some milliseconds. Never for a result: it is
/// another one in every run.
pub fn expected_seconds(operations: f64) -> f64 {
    static SECONDS: OnceLock<f64> = OnceLock::new();
    operations * SECONDS.get_or_init(seconds_of_one)
}

/// About how long work takes on this machine, and what makes it shorter, where a person would wonder.
pub fn long_work(work: Work) -> Option<String> {
    if work.operations < LEAST_OPERATIONS {
        return None;
    }
    let threads = thread_count().clamp(1, work.parts.max(1));
    let seconds = expected_seconds(work.operations) / threads as f64;
    (seconds > PATIENCE).then(|| format!("this takes about {}; {}", duration_in_words(seconds), work.mend))
}

/// A duration in words, to about one digit.
pub fn duration_in_words(seconds: f64) -> String {
    let rounded = |value: f64, word: &str| {
        let unit = 10_f64.powf(value.log10().floor());
        let value = if value < 10.0 { value.round() } else { (value / unit).round() * unit };
        format!("{value:.0} {word}{}", if value == 1.0 { "" } else { "s" })
    };
    match seconds {
        _ if seconds < 60.0 => rounded(seconds, "second"),
        _ if seconds < 3600.0 => rounded(seconds / 60.0, "minute"),
        _ if seconds < 48.0 * 3600.0 => rounded(seconds / 3600.0, "hour"),
        _ => rounded(seconds / 86_400.0, "day"),
    }
}

fn seconds_of_one() -> f64 {
    let rows = Mat::from_fn(ROWS, COLUMNS, |i, j| (((i + 1) * (2 * j + 3)) as f64 * 0.37).sin());
    let run = || {
        let begin = Instant::now();
        let mut factor = Factor::new(COLUMNS - 1, 1);
        factor.push(rows.as_ref(), None);
        std::hint::black_box(&factor);
        begin.elapsed().as_secs_f64()
    };
    let fastest = (0..RUNS).map(|_| run()).fold(f64::INFINITY, f64::min);
    SMALL * fastest / (ROWS * COLUMNS * COLUMNS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_operations_take_longer() {
        let second = expected_seconds(1e9);
        assert!(second > 1e-3 && second < 1e3, "{second}");
        assert_eq!(expected_seconds(2e9), 2.0 * second);
    }

    #[test]
    fn only_long_work_is_estimated() {
        let work = |operations| Work { operations, parts: 3, mend: "fewer folds make it shorter".to_owned() };
        assert_eq!(long_work(work(1e6)), None);
        let note = long_work(work(1e14)).unwrap();
        assert!(note.starts_with("this takes about ") && note.ends_with("; fewer folds make it shorter"), "{note}");
        let words = [12.0, 58.0, 70.0, 640.0, 5000.0, 1e5, 1e6].map(duration_in_words);
        assert_eq!(words, ["10 seconds", "60 seconds", "1 minute", "10 minutes", "1 hour", "30 hours", "10 days"]);
    }
}
