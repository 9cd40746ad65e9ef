//! Rows of an episode, filtered, and the filter along them.

use fleetfoot_control::filter::{SwitchedFilter, Track};
use fleetfoot_data::Block;
use fleetfoot_library::Unary;

use super::resolved::Reading;

/// Consecutive rows of an episode, filtered.
#[derive(Debug, Clone)]
pub struct FilteredRows {
    episode: String,
    log_offset: i64,
    first: usize,
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
    /// At the last row: the deviation of every sensor, the factor on the process noise, and the number of steps so far
    /// whose inputs were missing.
    pub(super) last_deviations: Vec<f64>,
    pub(super) process: f64,
    pub(super) held_inputs: usize,
    /// Of these rows, those before the filter was lost ([`Track::is_lost`]).
    pub(super) known: usize,
}

/// A filter that goes along an episode, from one block of rows to the next.
pub(super) struct Follower<'a> {
    filter: &'a SwitchedFilter,
    readings: &'a Reading,
    episode: String,
    log_offset: i64,
    /// `None` before the first row.
    track: Option<Track>,
}

fn apart(a: f64, b: f64, angle: bool) -> f64 {
    if angle { Unary::Wrap.apply(a - b) } else { a - b }
}

impl<'a> Follower<'a> {
    /// Before the first row of an episode.
    pub(super) fn new(filter: &'a SwitchedFilter, readings: &'a Reading, episode: String, log_offset: i64) -> Self {
        Self { filter, readings, episode, log_offset, track: None }
    }

    /// Filters the next rows, which come with the one before them.
    pub(super) fn follow(&mut self, block: &Block) -> FilteredRows {
        let (filter, readings) = (self.filter, self.readings);
        let mut filtered_rows = FilteredRows::none(filter, readings, self, block);
        let seconds = block.seconds();
        let at = |column: usize, row: usize| block.column(column)[row];
        let read =
            |columns: &[usize], row: usize| -> Vec<f64> { columns.iter().map(|&column| at(column, row)).collect() };
        let deviations = |row: usize| -> Vec<f64> {
            readings.deviations.iter().map(|column| column.map_or(f64::NAN, |column| at(column, row))).collect()
        };
        for row in block.before..block.before + block.rows {
            let (measured, deviations) = (read(&readings.measured, row), deviations(row));
            let track = match &mut self.track {
                None => self.track.insert(filter.start(&measured, &deviations)),
                Some(track) => {
                    let passed = seconds[row] - seconds[row - 1];
                    filter.step(track, &read(&readings.inputs, row - 1), passed, &measured, &deviations);
                    track
                }
            };
            filtered_rows.push(filter, readings, track, &measured, &|column| at(column, row));
        }
        if let (Some(track), Some(last)) = (&self.track, (block.before + block.rows).checked_sub(1)) {
            let sensor = |((k, deviation), given): ((usize, f64), Option<f64>)| {
                given.unwrap_or(if deviation.is_finite() { deviation } else { track.estimated_deviation(filter, k) })
            };
            filtered_rows.last_deviations =
                deviations(last).into_iter().enumerate().zip(filter.deviations()).map(sensor).collect();
            (filtered_rows.process, filtered_rows.held_inputs) = (track.process(), track.held_inputs());
        }
        filtered_rows
    }
}

impl FilteredRows {
    /// Rows of which nothing is known yet.
    fn none(filter: &SwitchedFilter, readings: &Reading, of: &Follower<'_>, block: &Block) -> Self {
        let sensors = readings.measured.len();
        Self {
            episode: of.episode.clone(),
            log_offset: of.log_offset,
            first: block.first,
            stamps: block.stamps().to_vec(),
            states: filter.states().len(),
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
            known: 0,
        }
    }

    /// Bytes that the rows take.
    pub fn bytes(&self) -> usize {
        let columns = [
            &self.means,
            &self.deviations,
            &self.probabilities,
            &self.innovations,
            &self.innovation_deviations,
            &self.log_likelihood,
            &self.nis,
            &self.nees,
            &self.errors,
            &self.truths,
            &self.measured,
        ];
        8 * (self.stamps.len() + columns.iter().map(|column| column.len()).sum::<usize>())
    }

    /// Appends the rows that follow these in their episode.
    pub fn extend(&mut self, next: &Self) {
        self.stamps.extend(&next.stamps);
        let columns = [
            (&mut self.means, &next.means),
            (&mut self.deviations, &next.deviations),
            (&mut self.probabilities, &next.probabilities),
            (&mut self.innovations, &next.innovations),
            (&mut self.innovation_deviations, &next.innovation_deviations),
            (&mut self.log_likelihood, &next.log_likelihood),
            (&mut self.nis, &next.nis),
            (&mut self.nees, &next.nees),
            (&mut self.errors, &next.errors),
            (&mut self.truths, &next.truths),
            (&mut self.measured, &next.measured),
        ];
        columns.into_iter().for_each(|(column, next)| column.extend(next));
        self.known += next.known;
        self.last_deviations.clone_from(&next.last_deviations);
        (self.process, self.held_inputs) = (next.process, next.held_inputs);
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
        self.known += usize::from(!track.is_lost());
        self.means.extend(&estimate.mean);
        self.deviations.extend((0..n).map(|s| estimate.covariance[s * n + s].sqrt()));
        self.probabilities.extend(track.probabilities());
        let sensors: Vec<usize> = filter.measured().collect();
        self.measured.extend(filter.aligned(&sensors, measured, &estimate.mean));
        for k in 0..self.sensors {
            self.innovations.push(track.innovation(k));
            self.innovation_deviations.push(track.innovation_variance(k).sqrt());
        }
        self.log_likelihood.push(track.log_likelihood());
        let (nis, observed) = track.nis();
        self.nis.push(if observed == self.sensors { nis } else { f64::NAN });
        let truths: Vec<f64> = readings.truth.iter().map(|truth| at(truth.column)).collect();
        let states: Vec<usize> = readings.truth.iter().map(|truth| truth.state).collect();
        let truths = filter.aligned(&states, &truths, &estimate.mean);
        let errors: Vec<f64> =
            states.iter().zip(&truths).map(|(&s, &truth)| apart(estimate.mean[s], truth, filter.is_angle(s))).collect();
        self.nees.push(if states.is_empty() { f64::NAN } else { filter.square(estimate, &states, &truths) });
        self.errors.extend(errors);
        self.truths.extend(truths);
    }

    /// The episode's name.
    pub fn episode(&self) -> &str {
        &self.episode
    }

    /// Offset from the stamps to the times of the recording, nanoseconds.
    pub fn log_offset(&self) -> i64 {
        self.log_offset
    }

    /// The place of the first of these rows in its episode; 0 where it begins.
    pub fn first(&self) -> usize {
        self.first
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

    /// The logarithm of the probability density of each row's measurements.
    pub fn log_likelihood(&self) -> &[f64] {
        &self.log_likelihood
    }

    /// The region of a row that is most probable, the lowest of equals; none where the filter was lost.
    pub fn region(&self, row: usize) -> Option<usize> {
        let probabilities = &self.probabilities[row * self.regions..][..self.regions];
        let best = (1..self.regions)
            .fold(0, |best, region| if probabilities[region] > probabilities[best] { region } else { best });
        probabilities[best].is_finite().then_some(best)
    }

    /// Measurement of a sensor; NaN without one.
    pub fn measured(&self, row: usize, sensor: usize) -> f64 {
        self.measured[row * self.sensors + sensor]
    }

    /// An innovation in its deviation.
    pub(super) fn normalised(&self, row: usize, sensor: usize) -> f64 {
        let at = row * self.sensors + sensor;
        self.innovations[at] / self.innovation_deviations[at]
    }

    /// Estimate less truth.
    pub(super) fn error(&self, row: usize, truth: usize, angle: bool) -> f64 {
        apart(self.errors[row * self.errors.len() / self.rows() + truth], 0.0, angle)
    }

    /// Measurement less truth.
    pub(super) fn measured_error(&self, row: usize, truth: usize, sensor: usize, angle: bool) -> f64 {
        let true_value = self.truths[row * self.truths.len() / self.rows() + truth];
        apart(self.measured(row, sensor), true_value, angle)
    }
}
