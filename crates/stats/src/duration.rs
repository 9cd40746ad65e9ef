//! How long so many operations take on this machine: a regression is timed, once.

use std::{sync::OnceLock, time::Instant};

use faer::Mat;

use crate::Factor;

/// Rows and columns of the regression that is timed.
const ROWS: usize = 512;
const COLUMNS: usize = 48;

/// The many factorisations of a fit take longer, an operation, than one of many rows: they are small, and memory is moved between them. (Fits of 90 to 180 candidates.)
const SMALL: f64 = 3.0;

/// Of several runs the fastest is the machine's own speed.
const RUNS: usize = 3;

/// Seconds that `operations` multiplications of dense factorisations take on one thread, about. The first call measures for some milliseconds. Never for a result: it is
/// another one in every run.
pub fn expected_seconds(operations: f64) -> f64 {
    static SECONDS: OnceLock<f64> = OnceLock::new();
    operations * SECONDS.get_or_init(seconds_of_one)
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
}
