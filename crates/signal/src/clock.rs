//! Stamps of a sensor that samples evenly, written by a computer that does not.

use crate::{SignalError, error::check_stamps, outliers::median};

/// Stamps, evened out.
#[derive(Debug, Clone, PartialEq)]
pub struct Dejittered {
    /// Stamps on the regression line, s.
    pub times: Vec<f64>,
    /// Seconds a sample.
    pub period: f64,
    /// Standard deviation of the period, from the residuals as if they were independent.
    pub period_deviation: f64,
    /// Standard deviation of the stamps about the line, s.
    pub jitter: f64,
    /// Correlation of neighbouring residuals. Near 0: jitter, which the line removes. Near 1: the clocks drift against each other, and a straight line is
    /// the wrong curve.
    pub correlation: f64,
    /// Rows before which samples are missing, and how many.
    pub gaps: Vec<(usize, u64)>,
}

/// The share of a stamp's distance from the phase that the phase follows.
const FOLLOW: f64 = 0.1;

/// Regresses stamps on the sample count. The count goes up by the periods, rounded, since where the clock stood at the stamp before: a phase that follows the stamps slowly, so that a
/// late stamp neither counts a sample that was none nor hides one. A jitter below half a period changes nothing, and gaps keep their length.
///
/// # Errors
/// Stamps that do not increase; fewer than three.
pub fn dejitter(times: &[f64]) -> Result<Dejittered, SignalError> {
    check_stamps(times)?;
    if times.len() < 3 {
        return Err(SignalError::TooFew { found: times.len(), needed: 3 });
    }
    Ok(regress(times, &counted(times).0))
}

/// The number of every one of two or more increasing stamps of what comes evenly but for gaps, and the period.
pub(crate) fn counted(times: &[f64]) -> (Vec<u64>, f64) {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut period = median(&mut steps).unwrap_or(0.0);
    let mut counts = counts(times, period);
    // A median step that is off by a thousandth miscounts a gap of five hundred samples; the line's own period does not.
    for _ in 0..4 {
        period = line(times, &counts).1;
        let again = self::counts(times, period);
        if again == counts {
            break;
        }
        counts = again;
    }
    (counts, period)
}

/// The number of every sample.
fn counts(times: &[f64], period: f64) -> Vec<u64> {
    let (mut count, mut phase) = (0, times[0]);
    let next = |&time: &f64| {
        let samples = ((time - phase) / period).round().max(1.0);
        phase += samples * period;
        phase += FOLLOW * (time - phase);
        count += samples as u64;
        count
    };
    let rest: Vec<u64> = times[1..].iter().map(next).collect();
    std::iter::once(0).chain(rest).collect()
}

/// The stamp of the middle count, seconds a count, the middle count, and the counts' sum of squares about it.
fn line(times: &[f64], counts: &[u64]) -> (f64, f64, f64, f64) {
    let n = times.len() as f64;
    let middle = counts.iter().map(|&count| count as f64).sum::<f64>() / n;
    // From the first stamp on, so that stamps of an epoch keep their digits.
    let mean = times.iter().map(|time| time - times[0]).sum::<f64>() / n;
    let (mut product, mut square) = (0.0, 0.0);
    for (time, &count) in times.iter().zip(counts) {
        let from = count as f64 - middle;
        product += from * (time - times[0] - mean);
        square += from * from;
    }
    (mean, product / square, middle, square)
}

fn regress(times: &[f64], counts: &[u64]) -> Dejittered {
    let (mean, period, middle, square) = line(times, counts);
    let on_line: Vec<f64> = counts.iter().map(|&count| mean + period * (count as f64 - middle)).collect();
    let residuals: Vec<f64> = times.iter().zip(&on_line).map(|(time, line)| time - times[0] - line).collect();
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let neighbours: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let jitter = (squares / (times.len() - 2) as f64).sqrt();
    let steps = counts.windows(2).enumerate();
    Dejittered {
        times: on_line.into_iter().map(|time| times[0] + time).collect(),
        period,
        period_deviation: jitter / square.sqrt(),
        jitter,
        correlation: if squares > 0.0 { neighbours / squares } else { 0.0 },
        gaps: steps
            .filter(|(_, pair)| pair[1] > pair[0] + 1)
            .map(|(row, pair)| (row + 1, pair[1] - pair[0] - 1))
            .collect(),
    }
}
