//! The rows of an episode, filtered.

use fleetfoot_data::Block;
use fleetfoot_dynamics::filter::{SwitchedFilter, Track};
use fleetfoot_library::Unary;

use super::asked::Reading;

/// An episode, filtered.
#[derive(Debug, Clone)]
pub struct FilteredRows {
    episode: String,
    stamps: Vec<i64>,
    states: usize,
    sensors: usize,
    regions: usize,
    /// Rows x states.
    means: Vec<f64>,
    deviations: Vec<f64>,
    /// Rows x regions.
    probabilities: Vec<f64>,
    /// Rows x sensors.
    innovations: Vec<f64>,
    innovation_deviations: Vec<f64>,
    pub(super) log_likelihood: Vec<f64>,
    /// NaN where not all sensors measured.
    pub(super) nis: Vec<f64>,
    /// NaN where the truth is not known.
    pub(super) nees: Vec<f64>,
    /// Rows x truths: estimate less truth, and the truth.
    errors: Vec<f64>,
    truths: Vec<f64>,
    /// Rows x sensors.
    measured: Vec<f64>,
    /// The deviation of every sensor at the last row.
    pub(super) last_deviations: Vec<f64>,
    pub(super) process: f64,
    pub(super) held_inputs: usize,
}

fn apart(a: f64, b: f64, angle: bool) -> f64 {
    if angle { Unary::Wrap.apply(a - b) } else { a - b }
}

impl FilteredRows {
    /// Bytes that a row of an episode takes, read from so many columns.
    pub(super) fn bytes_of_row(filter: &SwitchedFilter, readings: &Reading, columns: usize) -> usize {
        let (states, sensors) = (filter.states().len(), readings.measured.len());
        // The stamp and three numbers of the row itself.
        let numbers = 4 + 2 * states + filter.regions() + 3 * sensors + 2 * readings.truth.len();
        size_of::<f64>() * (numbers + columns)
    }

    pub(super) fn new(filter: &SwitchedFilter, readings: &Reading, episode: String, block: &Block) -> Self {
        let (states, sensors) = (filter.states().len(), readings.measured.len());
        let mut found = Self {
            episode,
            stamps: block.stamps().to_vec(),
            states,
            sensors,
            regions: filter.regions(),
            means: Vec::new(),
            deviations: Vec::new(),
            probabilities: Vec::new(),
            innovations: Vec::new(),
            innovation_deviations: Vec::new(),
            log_likelihood: Vec::new(),
            nis: Vec::new(),
            nees: Vec::new(),
            errors: Vec::new(),
            truths: Vec::new(),
            measured: Vec::new(),
            last_deviations: vec![f64::NAN; sensors],
            process: f64::NAN,
            held_inputs: 0,
        };
        let seconds = block.seconds();
        let at = |column: usize, row: usize| block.core(column)[row];
        let told = |row: usize| -> Vec<f64> {
            readings.deviations.iter().map(|column| column.map_or(f64::NAN, |column| at(column, row))).collect()
        };
        let read =
            |columns: &[usize], row: usize| -> Vec<f64> { columns.iter().map(|&column| at(column, row)).collect() };
        let mut track: Option<Track> = None;
        for row in 0..block.rows {
            let (measured, deviations) = (read(&readings.measured, row), told(row));
            match &mut track {
                None => track = Some(filter.start(&measured, &deviations)),
                Some(track) => {
                    let passed = seconds[block.before + row] - seconds[block.before + row - 1];
                    filter.step(track, &read(&readings.inputs, row - 1), passed, &measured, &deviations);
                }
            }
            if let Some(track) = &track {
                found.push(filter, readings, track, &measured, &|column| at(column, row));
                for (k, last) in found.last_deviations.iter_mut().enumerate() {
                    let own = if deviations[k].is_finite() { deviations[k] } else { track.found_deviation(filter, k) };
                    *last = filter.deviations().nth(k).flatten().unwrap_or(own);
                }
            }
        }
        if let Some(track) = track {
            (found.process, found.held_inputs) = (track.process(), track.held_inputs());
        }
        found
    }

    fn push(
        &mut self,
        filter: &SwitchedFilter,
        readings: &Reading,
        track: &Track,
        measured: &[f64],
        at: &dyn Fn(usize) -> f64,
    ) {
        let (estimate, n) = (track.estimate(), self.states);
        self.means.extend(&estimate.mean);
        self.deviations.extend((0..n).map(|s| estimate.covariance[s * n + s].sqrt()));
        self.probabilities.extend(track.probabilities());
        self.measured.extend(measured);
        for k in 0..self.sensors {
            self.innovations.push(track.innovation(k));
            self.innovation_deviations.push(track.innovation_variance(k).sqrt());
        }
        self.log_likelihood.push(track.log_likelihood());
        let (nis, observed) = track.nis();
        self.nis.push(if observed == self.sensors { nis } else { f64::NAN });
        let truths: Vec<f64> = readings.truth.iter().map(|truth| at(truth.column)).collect();
        let states: Vec<usize> = readings.truth.iter().map(|truth| truth.state).collect();
        let errors: Vec<f64> =
            states.iter().zip(&truths).map(|(&s, &truth)| apart(estimate.mean[s], truth, filter.is_angle(s))).collect();
        self.nees.push(if states.is_empty() { f64::NAN } else { estimate.square(&states, &errors) });
        self.errors.extend(errors);
        self.truths.extend(truths);
    }

    /// The episode's name.
    pub fn episode(&self) -> &str {
        &self.episode
    }

    /// Stamps of the rows, nanoseconds.
    pub fn stamps(&self) -> &[i64] {
        &self.stamps
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.stamps.len()
    }

    /// Means of the states, rows x states.
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Their standard deviations, rows x states.
    pub fn deviations(&self) -> &[f64] {
        &self.deviations
    }

    /// Probabilities of the regions, rows x regions.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// Measured less predicted, rows x sensors; NaN where nothing was measured.
    pub fn innovations(&self) -> &[f64] {
        &self.innovations
    }

    /// The deviations that innovations were expected to have, rows x sensors.
    pub fn innovation_deviations(&self) -> &[f64] {
        &self.innovation_deviations
    }

    /// The logarithm of the probability density of what each row measured.
    pub fn log_likelihood(&self) -> &[f64] {
        &self.log_likelihood
    }

    /// The region of a row that is most probable, the lowest of equals.
    pub fn region(&self, row: usize) -> usize {
        let own = &self.probabilities[row * self.regions..][..self.regions];
        (1..self.regions).fold(0, |best, region| if own[region] > own[best] { region } else { best })
    }

    /// Rows at which a sensor says what it said at the row before, and rows that follow one that it measured.
    pub(super) fn repeated(&self, sensor: usize) -> [u64; 2] {
        let own: Vec<f64> = self.measured.iter().skip(sensor).step_by(self.sensors).copied().collect();
        let pairs = || own.windows(2).filter(|pair| pair.iter().all(|value| value.is_finite()));
        [pairs().filter(|pair| pair[0] == pair[1]).count() as u64, pairs().count() as u64]
    }

    /// Estimate less truth.
    pub(super) fn error(&self, row: usize, truth: usize, angle: bool) -> f64 {
        apart(self.errors[row * self.errors.len() / self.rows() + truth], 0.0, angle)
    }

    /// Measurement less truth.
    pub(super) fn measured_error(&self, row: usize, truth: usize, sensor: usize, angle: bool) -> f64 {
        apart(
            self.measured[row * self.sensors + sensor],
            self.truths[row * self.truths.len() / self.rows() + truth],
            angle,
        )
    }
}
