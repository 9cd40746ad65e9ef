//! Sums over filtered rows, which do not grow with them.

use fleetfoot_control::filter::{Consistency, SwitchedFilter};
use fleetfoot_data::EpisodeId;
use fleetfoot_data::setting::{MAX_GAP, TIME_SECTION};

use super::{
    DeviationFrom, SensorReport, TruthReport,
    resolved::{self, Reading},
    row::FilteredRows,
};

/// Measurements that repeat the one before in more than this share of rows are those of a slower sensor, held.
const HELD: f64 = 0.5;

/// Sums over episodes, whose rows come in order, some at a time.
pub(super) struct Sums {
    sensors: Vec<Sensor>,
    nis: Consistency,
    nees: Consistency,
    /// Of every truth: squared errors and how many, of estimates and of measurements.
    errors: Vec<[f64; 4]>,
    log_likelihood: f64,
    /// Of every episode, the factor on the process noise at its end.
    process: Vec<f64>,
    held: u64,
    /// Rows from which on a filter was lost, and the first of them: its episode, its number from 1.
    lost: u64,
    first_lost: Option<(String, usize)>,
    lost_episodes: usize,
    /// Sums of the present episode so far; `None` before its first row.
    episode: Option<Along>,
}

/// Sums of a sensor.
struct Sensor {
    squares: Consistency,
    /// Of normalised innovations: products of neighbours, squares, pairs.
    neighbours: [f64; 3],
    /// Of every episode, the deviation at its end.
    deviations: Vec<f64>,
    /// Rows that repeat the measurement of the row before, and rows that follow one.
    repeated: [u64; 2],
}

/// An episode up to a row.
struct Along {
    log_likelihood: f64,
    process: f64,
    held: u64,
    lost: bool,
    sensors: Vec<Last>,
}

/// A sensor at the last row so far: normalised innovation, measurement, deviation.
#[derive(Clone, Copy)]
struct Last {
    normalised: f64,
    measured: f64,
    deviation: f64,
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

impl Sensor {
    fn new() -> Self {
        Self { squares: Consistency::new(1), neighbours: [0.0; 3], deviations: Vec::new(), repeated: [0; 2] }
    }

    /// A row behind another one.
    fn pair(&mut self, before: &Last, present: &Last) {
        if before.normalised.is_finite() && present.normalised.is_finite() {
            let [products, squares, pairs] = self.neighbours;
            self.neighbours = [
                products + before.normalised * present.normalised,
                squares + 0.5 * (before.normalised * before.normalised + present.normalised * present.normalised),
                pairs + 1.0,
            ];
        }
        if before.measured.is_finite() && present.measured.is_finite() {
            let [repeated, pairs] = self.repeated;
            self.repeated = [repeated + u64::from(before.measured == present.measured), pairs + 1];
        }
    }
}

impl Sums {
    pub(super) fn new(filter: &SwitchedFilter, readings: &Reading) -> Self {
        let sensors = filter.measured().len();
        Self {
            sensors: (0..sensors).map(|_| Sensor::new()).collect(),
            nis: Consistency::new(sensors),
            nees: Consistency::new(filter.freedom(&readings.truth.iter().map(|truth| truth.state).collect::<Vec<_>>())),
            errors: vec![[0.0; 4]; readings.truth.len()],
            log_likelihood: 0.0,
            process: Vec::new(),
            held: 0,
            lost: 0,
            first_lost: None,
            lost_episodes: 0,
            episode: None,
        }
    }

    /// Adds rows of an episode that follow those before.
    pub(super) fn add(&mut self, episode: EpisodeId, filter: &SwitchedFilter, readings: &Reading, rows: &FilteredRows) {
        let unknown = Last { normalised: f64::NAN, measured: f64::NAN, deviation: f64::NAN };
        let begun = || Along {
            log_likelihood: 0.0,
            process: 0.0,
            held: 0,
            lost: false,
            sensors: vec![unknown; rows.last_deviations.len()],
        };
        let along = self.episode.get_or_insert_with(begun);
        for (k, (sums, last)) in self.sensors.iter_mut().zip(&mut along.sensors).enumerate() {
            for row in 0..rows.rows() {
                let (normalised, measured) = (rows.normalised(row, k), rows.measured(row, k));
                let present = Last { normalised, measured, deviation: rows.last_deviations[k] };
                sums.pair(last, &present);
                *last = present;
            }
            sums.squares.add(episode, (0..rows.rows()).map(|row| rows.normalised(row, k).powi(2)));
        }
        rows.log_likelihood()[..rows.known].iter().for_each(|log_likelihood| along.log_likelihood += log_likelihood);
        self.lost += (rows.rows() - rows.known) as u64;
        if rows.known < rows.rows() && !along.lost {
            along.lost = true;
            self.lost_episodes += 1;
            self.first_lost.get_or_insert_with(|| (rows.episode().to_owned(), rows.first() + rows.known + 1));
        }
        (along.process, along.held) = (rows.process, rows.held_inputs as u64);
        self.nis.add(episode, rows.nis.iter().copied());
        self.nees.add(episode, rows.nees.iter().copied());
        for (t, truth) in readings.truth.iter().enumerate() {
            let measured = filter.measured().position(|state| state == truth.state);
            for row in 0..rows.rows() {
                let error = rows.error(row, t, filter.is_angle(truth.state));
                if error.is_finite() {
                    self.errors[t][0] += error * error;
                    self.errors[t][1] += 1.0;
                }
                let off = measured.map_or(f64::NAN, |k| rows.measured_error(row, t, k, filter.is_angle(truth.state)));
                if off.is_finite() {
                    self.errors[t][2] += off * off;
                    self.errors[t][3] += 1.0;
                }
            }
        }
    }

    /// Ends an episode.
    pub(super) fn close(&mut self) {
        let Some(along) = self.episode.take() else { return };
        self.log_likelihood += along.log_likelihood;
        self.process.push(along.process);
        self.held += along.held;
        self.sensors.iter_mut().zip(along.sensors).for_each(|(sums, last)| sums.deviations.push(last.deviation));
    }

    /// The mean of the episodes' last factors on the process noise.
    pub(super) fn process(&self) -> f64 {
        mean(&self.process)
    }

    pub(super) fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    pub(super) fn nis(&self) -> &Consistency {
        &self.nis
    }

    pub(super) fn nees(&self) -> &Consistency {
        &self.nees
    }

    /// Steps whose inputs were missing.
    pub(super) fn held(&self) -> u64 {
        self.held
    }

    /// Rows that no filter was left for.
    pub(super) fn lost(&self) -> u64 {
        self.lost
    }

    /// A note of episodes whose filter was lost.
    pub(super) fn lost_filters(&self) -> Option<String> {
        let (episode, row) = self.first_lost.as_ref()?;
        let more = match self.lost_episodes - 1 {
            0 => String::new(),
            more => format!(", and those of {more} other episodes end too"),
        };
        Some(format!(
            "{episode}: the filter ends before row {row}{more}: the covariance of its states is not finite, as in an unstable region without measurements; the {} rows from there on have no estimate: measure more states, or end episodes at gaps ({MAX_GAP})",
            self.lost
        ))
    }

    /// A note of the sensors that are slower than the rows.
    pub(super) fn held_sensors(&self, filter: &SwitchedFilter) -> Option<String> {
        let slow = |(state, sensor): (usize, &Sensor)| {
            let [repeated, pairs] = sensor.repeated;
            (repeated as f64 > HELD * pairs as f64).then(|| filter.states()[state].clone())
        };
        let slow: Vec<String> = filter.measured().zip(&self.sensors).filter_map(slow).collect();
        (!slow.is_empty()).then(|| {
            format!(
                "{}: most measurements repeat the previous one, as if a slow sensor is held between its samples; each repeat counts as a new measurement: make its topic the base of the rows ({entry})",
                slow.join(", "), entry = TIME_SECTION.entry("base")
            )
        })
    }

    pub(super) fn sensors(&self, filter: &SwitchedFilter, readings: &Reading) -> Vec<SensorReport> {
        let given: Vec<Option<f64>> = filter.deviations().collect();
        let sensor = |(k, state): (usize, usize)| {
            let sensor = &self.sensors[k];
            let [products, squares, pairs] = sensor.neighbours;
            let column = readings.deviations[k].is_some();
            SensorReport {
                state: filter.states()[state].clone(),
                deviation: given[k].unwrap_or_else(|| mean(&sensor.deviations)),
                deviation_from: match given[k] {
                    Some(_) => DeviationFrom::Given,
                    None if column => DeviationFrom::Column,
                    None => DeviationFrom::Innovations,
                },
                rows: sensor.squares.rows(),
                share: sensor.squares.share(),
                correlation: products / squares,
                white: 1.96 / pairs.sqrt(),
            }
        };
        filter.measured().enumerate().map(sensor).collect()
    }

    pub(super) fn truth(&self, filter: &SwitchedFilter, readings: &Reading) -> Vec<TruthReport> {
        let report = |(truth, &[squares, rows, off, readings]): (&resolved::Truth, &[f64; 4])| TruthReport {
            state: filter.states()[truth.state].clone(),
            rmse: (squares / rows).sqrt(),
            measured_rmse: (readings > 0.0).then(|| (off / readings).sqrt()),
        };
        readings.truth.iter().zip(&self.errors).map(report).collect()
    }
}
