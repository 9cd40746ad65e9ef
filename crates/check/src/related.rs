//! Comparison of two channels: a delay, another unit, another axis, or the same signal.

use std::f64::consts::PI;

use fleetfoot_data::setting::{CLOCKS, COLUMNS};
use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_dataset::Error;

use crate::{
    Channel,
    channel::Channels,
    finding::{Fault, Finding},
    names::Words,
    sample::{Sample, Stretch},
};

/// Rows on either side by which a channel may be late.
const REACH: usize = 50;
/// Rows over which rates are smoothed before they are compared.
const SMOOTH: usize = 5;
/// Correlation from which on a channel is the rate of another.
const ALIKE: f64 = 0.95;
/// Factors between units, and how near to them is near.
const FACTORS: [(f64, &str); 4] = [
    (180.0 / PI, "degrees and radians"),
    (9.80665, "g and m/s^2"),
    (1.0 / 0.3048, "feet and metres"),
    (3.6, "km/h and m/s"),
];
const NEAR: f64 = 0.03;
/// Relative deviation from 1 within which a ratio agrees with the names.
const ONE: f64 = 0.1;
/// Largest ratio of the mismatch with a delay to that without one at which the delay counts.
const BETTER: f64 = 0.5;
/// Rows that must be there for a comparison.
const FEW: usize = 200;

/// One channel against the derivative of another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Match {
    /// Rows by which the rate is late.
    late: isize,
    /// Correlation there, and without a delay.
    best: f64,
    plain: f64,
    /// Rate over derivative.
    ratio: f64,
}

/// Findings about pairs of channels.
///
/// # Errors
/// The user stopped the work.
pub(crate) fn findings(
    channels: &[Channel],
    sums: &Channels,
    sample: &Sample,
    progress: &dyn Progress,
) -> Result<Vec<Finding>, Error> {
    let words: Vec<Words> = channels.iter().map(|channel| Words::of(&channel.column.name)).collect();
    let usable = |at: &usize| channels[*at].is_measured() && !sums.of(*at).is_dead();
    let usable: Vec<usize> = (0..channels.len()).filter(usable).collect();
    let mut findings = Vec::new();
    let rates = |&place: &usize| {
        let is_rate = |&rate: &usize| words[rate].is_rate_of(&words[place]);
        usable.iter().copied().filter(is_rate).map(|rate| (place, rate)).collect::<Vec<_>>()
    };
    let pairs: Vec<(usize, usize)> = usable.iter().flat_map(rates).collect();
    progress.stage("pairs of channels");
    let compared = parallel_map(pairs.len(), progress, |at| {
        let (place, rate) = pairs[at];
        let rate_match = compare(channels, sample, place, rate);
        Ok::<Option<Finding>, Error>(
            rate_match.and_then(|rate_match| of_rate(channels, sample, (place, rate), rate_match)),
        )
    })?;
    findings.extend(compared.into_iter().flatten());
    findings.extend(swapped(channels, &words, sample, &usable));
    findings.extend(duplicates(channels, sample, &usable));
    findings.extend(angles(channels, &words, sample, &usable));
    findings.extend(accelerations(channels, &words, sample, &usable));
    Ok(findings)
}

/// Finding about a channel whose name is that of another's rate.
fn of_rate(channels: &[Channel], sample: &Sample, (place, rate): (usize, usize), rate_match: Match) -> Option<Finding> {
    if rate_match.best.abs() < ALIKE {
        return None;
    }
    let (of, name) = (&channels[place].column.name, &channels[rate].column.name);
    let ratio = rate_match.ratio.abs();
    let factor = FACTORS
        .iter()
        .find(|(factor, _)| [*factor, 1.0 / factor].iter().any(|factor| (ratio / factor - 1.0).abs() < NEAR));
    if let Some((_, units)) = factor {
        return Some(Finding::new(
            Fault::Unit,
            name,
            (
                rate_match.ratio,
                format!("it is {:.4} times the derivative of `{of}`: {units} are mixed", rate_match.ratio),
            ),
            format!("in the recipe: {COLUMNS} with an expression that converts one of them, and its unit"),
        ));
    }
    if (ratio - 1.0).abs() > ONE {
        return None;
    }
    if rate_match.ratio < 0.0 {
        return Some(Finding::new(
            Fault::Sign,
            name,
            (
                rate_match.ratio,
                format!("it is {:.3} times the derivative of `{of}`: one of them has the wrong sign", rate_match.ratio),
            ),
            format!("in the recipe: {COLUMNS} with a minus before one of them"),
        ));
    }
    let better = 1.0 - rate_match.best.abs() < BETTER * (1.0 - rate_match.plain.abs());
    (rate_match.late != 0 && better).then(|| {
        let seconds = rate_match.late as f64 * sample.period();
        let (late, early) = if seconds > 0.0 { (name, of) } else { (of, name) };
        Finding::new(
            Fault::Delay,
            late,
            (
                seconds.abs(),
                format!("it lags by {:.4} s ({} rows) behind `{early}`", seconds.abs(), rate_match.late.abs()),
            ),
            format!(
                "in the recipe: {COLUMNS} with `lead({late}, {})`, or {CLOCKS} if another clock stamps it",
                rate_match.late.abs()
            ),
        )
    })
}

/// The rate along one axis follows the place along another, and the other way round.
fn swapped(channels: &[Channel], words: &[Words], sample: &Sample, usable: &[usize]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let axis = |at: usize| words[at].axis();
    let is_rate = |rate: usize, place: usize| words[rate].is_rate_of(&words[place]);
    let strong = |place: usize, rate: usize| {
        compare(channels, sample, place, rate)
            .is_some_and(|rate_match| rate_match.best.abs() > ALIKE && (rate_match.ratio.abs() - 1.0).abs() < ONE)
    };
    for (at, &one) in usable.iter().enumerate() {
        for &other in &usable[at + 1..] {
            let (Some((first, mine)), Some((second, others))) = (axis(one), axis(other)) else { continue };
            if first == second || mine != others || words[one].rate || words[other].rate {
                continue;
            }
            let rate_of = |place: usize| usable.iter().copied().find(|&rate| is_rate(rate, place));
            let (Some(direct), Some(cross)) = (rate_of(one), rate_of(other)) else { continue };
            if !strong(one, direct) && !strong(other, cross) && strong(one, cross) && strong(other, direct) {
                let names = [direct, cross].map(|at| channels[at].column.name.as_str());
                findings.push(Finding::new(
                    Fault::SwappedAxes,
                    names[0],
                    (
                        1.0,
                        format!(
                            "it follows `{}`, and `{}` follows `{}`: two axes are exchanged",
                            channels[other].column.name, names[1], channels[one].column.name
                        ),
                    ),
                    format!("in the recipe: {COLUMNS} that give each its axis"),
                ));
            }
        }
    }
    findings
}

/// Channels with the same values.
fn duplicates(channels: &[Channel], sample: &Sample, usable: &[usize]) -> Vec<Finding> {
    let mut findings = Vec::new();
    // Without two rows of an episode there is nothing to compare.
    if sample.stretches.is_empty() {
        return findings;
    }
    for (at, &one) in usable.iter().enumerate() {
        let same = |&&other: &&usize| {
            let mut stretches = sample.stretches.iter();
            stretches.all(|stretch| stretch.columns[one] == stretch.columns[other])
        };
        if let Some(&other) = usable[at + 1..].iter().find(same) {
            findings.push(Finding::new(
                Fault::Duplicate,
                &channels[other].column.name,
                (1.0, format!("its values are those of `{}`", channels[one].column.name)),
                "leave one of them out: their coefficients cannot be separated",
            ));
        }
    }
    findings
}

/// Angles that jump by 360: degrees, where radians are meant.
fn angles(channels: &[Channel], words: &[Words], sample: &Sample, usable: &[usize]) -> Vec<Finding> {
    let is_angle = |at: &usize| (channels[*at].angle || words[*at].angle) && !words[*at].rate;
    let degrees = |unit: &str| unit.contains("deg") || unit.contains('°');
    let mut findings = Vec::new();
    for at in usable.iter().copied().filter(is_angle) {
        if channels[at].column.unit.as_deref().is_some_and(degrees) {
            continue;
        }
        let steps = sample.stretches.iter().flat_map(|stretch| stretch.columns[at].windows(2));
        let jumps = steps.filter(|pair| (300.0..=360.5).contains(&(pair[1] - pair[0]).abs())).count();
        let within = sample
            .stretches
            .iter()
            .flat_map(|stretch| &stretch.columns[at])
            .all(|value| value.is_nan() || value.abs() <= 361.0);
        if jumps > 0 && within {
            findings.push(Finding::new(
                Fault::Unit,
                &channels[at].column.name,
                (360.0, format!("it jumps by about 360 in {jumps} rows: it is in degrees")),
                format!("in the recipe: {COLUMNS} with `0.017453292519943295*` before it; angles are radians"),
            ));
        }
    }
    findings
}

/// Accelerations whose length is that of gravity in g.
fn accelerations(channels: &[Channel], words: &[Words], sample: &Sample, usable: &[usize]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let with = |first: usize, wanted: usize| {
        let (_, axis_name) = words[first].axis()?;
        usable
            .iter()
            .copied()
            .find(|&at| words[at].axis().is_some_and(|(axis, others)| axis == wanted && others == axis_name))
    };
    for &x in usable.iter().filter(|&&at| words[at].acceleration && words[at].axis().is_some_and(|(axis, _)| axis == 0))
    {
        let (Some(y), Some(z)) = (with(x, 1), with(x, 2)) else { continue };
        let in_g = |unit: &str| unit.trim() == "g";
        if channels[x].column.unit.as_deref().is_some_and(in_g) {
            continue;
        }
        let mut lengths: Vec<f64> = sample
            .stretches
            .iter()
            .flat_map(|stretch| {
                (0..stretch.time.len())
                    .map(|row| [x, y, z].map(|at| stretch.columns[at][row].powi(2)).iter().sum::<f64>().sqrt())
            })
            .filter(|length| length.is_finite())
            .collect();
        if lengths.len() < FEW {
            continue;
        }
        let middle = lengths.len() / 2;
        let median = *lengths.select_nth_unstable_by(middle, f64::total_cmp).1;
        if (0.9..1.1).contains(&median) {
            findings.push(Finding::new(
                Fault::Unit,
                &channels[x].column.name,
                (median, format!("the length of the three accelerations is {median:.3} in the median: they are in g")),
                format!("in the recipe: {COLUMNS} with `9.80665*` before each"),
            ));
        }
    }
    findings
}

/// A rate against the derivative of a place, over all stretches; `None` where there are too few rows, or nothing moves.
fn compare(channels: &[Channel], sample: &Sample, place: usize, rate: usize) -> Option<Match> {
    let signals: Vec<(Vec<f64>, Vec<f64>)> = sample
        .stretches
        .iter()
        .map(|stretch| (smoothed(&derivative(stretch, place, channels[place].angle)), smoothed(&stretch.columns[rate])))
        .collect();
    let at = |late: isize| correlation(&signals, late);
    let plain = at(0)?;
    let reach = REACH as isize;
    let best = (-reach..=reach).filter_map(|late| Some((late, at(late)?))).max_by(|a, b| {
        // Of delays that are alike the least.
        a.1.0.abs().total_cmp(&b.1.0.abs()).then(b.0.abs().cmp(&a.0.abs()))
    })?;
    let (late, (correlation, ratio)) = best;
    Some(Match { late, best: correlation, plain: plain.0, ratio })
}

/// Central differences; of an angle those of the shorter way round.
fn derivative(stretch: &Stretch, channel: usize, angle: bool) -> Vec<f64> {
    let (time, values) = (&stretch.time, &stretch.columns[channel]);
    let mut slopes = vec![f64::NAN; values.len()];
    for row in 1..values.len().saturating_sub(1) {
        let mut rise = values[row + 1] - values[row - 1];
        if angle {
            rise -= 2.0 * PI * (rise / (2.0 * PI)).round();
        }
        let span = time[row + 1] - time[row - 1];
        slopes[row] = if span > 0.0 { rise / span } else { f64::NAN };
    }
    slopes
}

/// Means of so many rows.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let half = SMOOTH / 2;
    let mean = |row: usize| {
        let part = values.get(row.checked_sub(half)?..=row + half)?;
        Some(part.iter().sum::<f64>() / part.len() as f64)
    };
    (0..values.len()).map(|row| mean(row).unwrap_or(f64::NAN)).collect()
}

/// Correlation of a derivative with a rate so many rows later, and the ratio of their deviations with its sign.
fn correlation(signals: &[(Vec<f64>, Vec<f64>)], late: isize) -> Option<(f64, f64)> {
    let mut sums = [0.0; 6];
    for (derivative, rate) in signals {
        let (from, to) = (late.unsigned_abs().min(derivative.len()), derivative.len());
        let (first, second) = match late >= 0 {
            true => (&derivative[..to - from], &rate[from..]),
            false => (&derivative[from..], &rate[..to - from]),
        };
        for (d, r) in first.iter().zip(second) {
            if d.is_finite() && r.is_finite() {
                let terms = [1.0, *d, *r, d * d, r * r, d * r];
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
        }
    }
    let [n, d, r, dd, rr, dr] = sums;
    if n < FEW as f64 {
        return None;
    }
    let (of_d, of_r, both) = (dd / n - (d / n).powi(2), rr / n - (r / n).powi(2), dr / n - d / n * (r / n));
    if !(of_d > 0.0 && of_r > 0.0) {
        return None;
    }
    let correlation = both / (of_d * of_r).sqrt();
    // Through noise on both sides the ratio of deviations says more than the slope of either.
    Some((correlation, correlation.signum() * (of_r / of_d).sqrt()))
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Column;

    use super::*;
    use crate::Part;

    const STEP: f64 = 0.01;

    /// A place and its rate, of some tones.
    fn moving(row: f64) -> [f64; 2] {
        let t = STEP * row;
        let tones = [(1.0, 0.7), (0.4, 2.3), (0.2, 5.1)];
        let place = tones.iter().map(|(size, pace)| size * (pace * t).sin()).sum();
        [place, tones.iter().map(|(size, pace)| size * pace * (pace * t).cos()).sum()]
    }

    fn faults(names: [&str; 2], of: impl Fn(usize) -> [f64; 2]) -> Vec<(Fault, f64)> {
        let rows: Vec<[f64; 2]> = (0..4000).map(of).collect();
        let columns = (0..2).map(|at| rows.iter().map(|row| row[at]).collect()).collect();
        let time = (0..rows.len()).map(|row| STEP * row as f64).collect();
        let sample = Sample { stretches: vec![Stretch { time, columns }] };
        let channels =
            names.map(|name| Channel { column: Column::float(name), place: 0, part: Part::State, angle: false });
        let findings =
            compare(&channels, &sample, 0, 1).and_then(|findings| of_rate(&channels, &sample, (0, 1), findings));
        findings.iter().map(|finding| (finding.fault, finding.value)).collect()
    }

    #[test]
    fn duplicates_need_rows_to_compare() {
        let channels =
            ["a", "b"].map(|name| Channel { column: Column::float(name), place: 0, part: Part::Open, angle: false });
        let of = |columns: Vec<Vec<f64>>| Sample { stretches: vec![Stretch { time: vec![0.0, STEP], columns }] };
        let same = of(vec![vec![1.0, 2.0], vec![1.0, 2.0]]);
        assert_eq!(duplicates(&channels, &same, &[0, 1])[0].fault, Fault::Duplicate);
        assert_eq!(duplicates(&channels, &of(vec![vec![1.0, 2.0], vec![1.0, 2.5]]), &[0, 1]), []);
        assert_eq!(duplicates(&channels, &Sample { stretches: Vec::new() }, &[0, 1]), []);
    }

    #[test]
    fn delays_units_and_signs_are_detected() {
        let names = ["yaw", "yaw_rate"];
        assert_eq!(faults(names, |row| moving(row as f64)), []);
        let late = faults(names, |row| [moving(row as f64)[0], moving(row as f64 - 2.0)[1]]);
        assert!(late.len() == 1 && late[0].0 == Fault::Delay && (late[0].1 - 0.02).abs() < 1e-9, "{late:?}");
        let degrees = faults(names, |row| [moving(row as f64)[0], moving(row as f64)[1] * 180.0 / PI]);
        assert!(degrees.len() == 1 && degrees[0].0 == Fault::Unit && (degrees[0].1 - 57.3).abs() < 0.1, "{degrees:?}");
        let turned = faults(names, |row| [moving(row as f64)[0], -moving(row as f64)[1]]);
        assert!(turned.len() == 1 && turned[0].0 == Fault::Sign, "{turned:?}");
    }
}
