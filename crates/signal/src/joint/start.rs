//! First values of the noise of a joint's sensors: from a smoothing spline of each alone.

use super::{JointOptions, JointRecord, JointRun, JointSensor, Quantity, scale::Scale};
use crate::{Lambda, Record, Rejected, SignalError, Spline, Within, align, fuse::slack, reject, spline::median_step};

/// Readings that are enough to begin.
const ROWS: usize = 20_000;

/// Readings that a curve needs.
const FEWEST: usize = 5;

/// The share of what a sensor's readings span that is the least noise to begin with.
const LEAST: f64 = 1e-9;

/// Deviations off its curve at which a reading is no part of the begin.
const FAR: f64 = 6.0;

/// The share of a motion that two sensors must have in common to tell a delay.
const COMMON: f64 = 0.5;

/// Noise and motion of a sensor, from its readings alone.
#[derive(Debug, Clone, Copy)]
struct Alone {
    /// Deviation of a reading, steps aside.
    noise: f64,
    /// Density of the jerk, squared.
    density: f64,
}

/// The readings of the longest record of a sensor, so many at most.
fn longest<'a>(runs: &[JointRun<'a>], sensor: usize) -> JointRecord<'a> {
    let records = runs.iter().map(|run| run.records[sensor]);
    let most = records.reduce(|most, record| if record.times.len() > most.times.len() { record } else { most });
    most.map_or(JointRecord { times: &[], values: &[] }, |record| {
        let rows = record.times.len().min(ROWS);
        JointRecord { times: &record.times[..rows], values: &record.values[..rows] }
    })
}

/// Seconds between readings.
pub(super) fn period(runs: &[JointRun<'_>], sensor: usize) -> f64 {
    let record = longest(runs, sensor);
    if record.times.len() < 2 { f64::INFINITY } else { median_step(record.times) }
}

/// A sensor's curve by itself, without its gross errors.
fn curve(record: &JointRecord<'_>, quantity: Quantity) -> Result<Rejected, SignalError> {
    let spline = match quantity {
        Quantity::Position => Spline::Quintic,
        Quantity::Rate => Spline::Cubic,
    };
    reject(record.times, record.values, None, spline, Lambda::Likelihood, FAR)
}

/// Noise and motion of a sensor from its curve. Without a curve, the given noise; the density is then not used.
fn alone(record: &JointRecord<'_>, sensor: &JointSensor, curve: Option<&Rejected>) -> Alone {
    let Some(Rejected { smoothed, .. }) = curve else {
        return Alone { noise: sensor.noise.unwrap_or(1.0), density: 1.0 };
    };
    let ends = |best: fn(f64, f64) -> f64| record.values.iter().copied().reduce(best).unwrap_or(0.0);
    let (low, high) = (ends(f64::min), ends(f64::max));
    let (spread, step) = (smoothed.noise.powi(2), sensor.resolution.powi(2) / 12.0);
    let least = (LEAST * (high - low)).max(f64::EPSILON * high.abs().max(low.abs())).max(f64::MIN_POSITIVE.sqrt());
    let variance = (spread - step).max(1e-2 * step).max(least * least);
    let noise = sensor.noise.unwrap_or(variance.sqrt());
    Alone { noise, density: spread.max(noise * noise) / smoothed.lambda }
}

/// First values of a problem.
pub(super) struct Begin {
    /// Units.
    pub(super) scale: Scale,
    /// Variances of the sensors in these units.
    pub(super) variances: Vec<f64>,
    /// Density of the jerk in these units.
    pub(super) density: f64,
    /// Delays, s.
    pub(super) delays: Vec<f64>,
}

/// Begins with what each sensor says alone, and with the lags at which one shows what the other does.
pub(super) fn begin(runs: &[JointRun<'_>], options: &JointOptions) -> Result<Begin, SignalError> {
    let sensors = &options.sensors;
    let records: Vec<JointRecord<'_>> = (0..sensors.len()).map(|at| longest(runs, at)).collect();
    // A position is known to be there; the one that was read most often, of those whose delay is given, says how the joint moves.
    let readings = |sensor: usize| runs.iter().map(|run| run.records[sensor].values.len()).sum::<usize>();
    let rank = |sensor: usize| (sensors[sensor].delay.deviation == 0.0, readings(sensor));
    let positions = (0..sensors.len()).filter(|&at| sensors[at].quantity == Quantity::Position);
    let main = positions.reduce(|most, sensor| if rank(sensor) > rank(most) { sensor } else { most }).unwrap_or(0);
    // A curve is sought for noise, and that of the main sensor for the jerk and for delays; records that are too short for one are refused by it.
    let led = options.jerk.is_none() || sensors.iter().any(|sensor| sensor.delay.deviation > 0.0);
    let needs_curve =
        |at: usize| sensors[at].noise.is_none() || (at == main && led) || records[at].times.len() < FEWEST;
    let curve = |at: usize| needs_curve(at).then(|| curve(&records[at], sensors[at].quantity)).transpose();
    let curves: Vec<Option<Rejected>> = (0..sensors.len()).map(curve).collect::<Result<_, _>>()?;
    let alone: Vec<Alone> =
        (0..sensors.len()).map(|at| alone(&records[at], &sensors[at], curves[at].as_ref())).collect();
    let unit = (0..alone.len()).map(|sensor| period(runs, sensor)).fold(f64::INFINITY, f64::min);
    let values = records[main].values;
    let centre = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let scale = Scale { unit, centre, size: alone[main].noise };
    let density = options.jerk.map_or(alone[main].density, |jerk| jerk * jerk) / scale.density();
    let variance = |(alone, sensor): (&Alone, &JointSensor)| scale.scaled(sensor.quantity, alone.noise).powi(2);
    let variances = alone.iter().zip(sensors).map(variance).collect();
    let delay = |at: usize| match at == main || sensors[at].delay.deviation == 0.0 {
        true => sensors[at].delay.value,
        false => curves[main]
            .as_ref()
            .and_then(|curve| delay(&records, curve, sensors, [main, at]))
            .unwrap_or(sensors[at].delay.value),
    };
    Ok(Begin { scale, variances, density, delays: (0..sensors.len()).map(delay).collect() })
}

/// The delay at which a sensor shows what the main one does, where most of the motion is the same.
fn delay(
    records: &[JointRecord<'_>],
    curve: &Rejected,
    sensors: &[JointSensor],
    [main, other]: [usize; 2],
) -> Option<f64> {
    let values = match sensors[other].quantity {
        Quantity::Position => &curve.smoothed.derivatives[0],
        Quantity::Rate => &curve.smoothed.derivatives[1],
    };
    let middle = |sensor: &JointSensor| 0.5 * sensor.average;
    let (prior, shift) =
        (sensors[other].delay, sensors[main].delay.value + middle(&sensors[main]) - middle(&sensors[other]));
    let first = Record { times: records[main].times, values };
    let second = Record { times: records[other].times, values: records[other].values };
    let aligned = align(first, second, Within { about: prior.value - shift, reach: slack(&prior), skew: 0.0 }).ok()?;
    (aligned.unexplained < 1.0 - COMMON && !aligned.at_end).then_some(aligned.line.offset + shift)
}
