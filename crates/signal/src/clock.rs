//! Stamps of a sensor that samples evenly, written unevenly by a computer.

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

/// Stamps, the own one among them, whose median must confirm a gap before samples are counted as missing: few follow gaps close together, many see through stamps that are late by a period and more.
const CONFIRMED_BY: [usize; 4] = [5, 9, 17, 33];

/// Stamps before and behind a gap whose medians tell its length in the end.
const LOOKED_AT: usize = 17;

/// Regresses stamps on the sample count. The count goes up by the periods, rounded, since where the clock stood at the stamp before: a phase that follows the stamps slowly. Where a stamp is late by more
/// than half a period, the stamps behind it tell whether samples are missing, as a gap moves all of them and a delay one. How many are asked is what leaves the least of the stamps' squares about the line: one
/// stamp a hundred that is late by three periods, or a jitter of a third of a period all along, are no missing samples then, and gaps keep their length.
///
/// # Errors
/// Stamps that do not increase; fewer than three.
pub fn dejitter(times: &[f64]) -> Result<Dejittered, SignalError> {
    check_stamps(times)?;
    if times.len() < 3 {
        return Err(SignalError::TooFew { count: times.len(), needed: 3 });
    }
    Ok(regress(times, &counted(times).0))
}

/// The number of every one of two or more increasing stamps of what comes evenly but for gaps, and the period.
pub(crate) fn counted(times: &[f64]) -> (Vec<u64>, f64) {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let step = median(&mut steps).unwrap_or(0.0);
    let mut best = counted_by(times, step, 1);
    // No sample is missing: there is nothing to be confirmed.
    if best.0.last().is_some_and(|&last| last + 1 == times.len() as u64) {
        return best;
    }
    let mut least = squares(times, &best.0);
    for confirmed_by in CONFIRMED_BY {
        let candidate = looked_at(times, counted_by(times, step, confirmed_by));
        let squares = squares(times, &candidate.0);
        if squares < least {
            (best, least) = (candidate, squares);
        }
    }
    best
}

/// The numbers by a period that is near the truth, and the period that they make.
fn counted_by(times: &[f64], step: f64, confirmed_by: usize) -> (Vec<u64>, f64) {
    let mut period = step;
    let mut counts = counts(times, period, confirmed_by);
    // A median step that is off by a thousandth miscounts a gap of five hundred samples; the line's own period does not.
    for _ in 0..4 {
        period = line(times, &counts).1;
        let again = self::counts(times, period, confirmed_by);
        if again == counts {
            break;
        }
        counts = again;
    }
    (counts, period)
}

/// The numbers, with every gap as long as the stamps before and behind it are off each other by their medians: a late stamp just before a gap, or two of them close together, are counted for one otherwise.
fn looked_at(times: &[f64], (mut counts, mut period): (Vec<u64>, f64)) -> (Vec<u64>, f64) {
    for _ in 0..2 {
        let off = |row: usize| times[row] - times[0] - period * counts[row] as f64;
        let middle = |rows: std::ops::Range<usize>| median(&mut rows.map(off).collect::<Vec<_>>()).unwrap_or(0.0);
        let (mut count, mut again) = (0, vec![0; counts.len()]);
        for row in 1..counts.len() {
            let mut samples = counts[row] - counts[row - 1];
            if samples > 1 {
                let apart =
                    middle(row..(row + LOOKED_AT).min(times.len())) - middle(row.saturating_sub(LOOKED_AT)..row);
                samples = (samples as f64 + (apart / period).round()).max(1.0) as u64;
            }
            count += samples;
            again[row] = count;
        }
        if again == counts {
            break;
        }
        counts = again;
        period = line(times, &counts).1;
    }
    (counts, period)
}

/// The number of every sample; a gap is one if the median of so many stamps from it on says so, too.
fn counts(times: &[f64], period: f64, confirmed_by: usize) -> Vec<u64> {
    let (mut count, mut phase) = (0, times[0]);
    let mut ahead = Vec::with_capacity(confirmed_by);
    let next = |row: usize| {
        let mut samples = ((times[row] - phase) / period).round().max(1.0);
        if samples > 1.0 && confirmed_by > 1 {
            let rows = &times[row..(row + confirmed_by).min(times.len())];
            ahead.clear();
            ahead.extend(rows.iter().zip(0_u32..).map(|(time, later)| (time - phase) / period - f64::from(later)));
            samples = median(&mut ahead).map_or(samples, |ahead| samples.min(ahead.round().max(1.0)));
        }
        phase += samples * period;
        phase += FOLLOW * (times[row] - phase);
        count += samples as u64;
        count
    };
    let rest: Vec<u64> = (1..times.len()).map(next).collect();
    std::iter::once(0).chain(rest).collect()
}

/// The sum of the squares of stamps about the line through their counts.
fn squares(times: &[f64], counts: &[u64]) -> f64 {
    let (mean, period, middle, _) = line(times, counts);
    let off = |(time, count): (&f64, &u64)| time - times[0] - mean - period * (*count as f64 - middle);
    times.iter().zip(counts).map(|row| off(row).powi(2)).sum()
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
