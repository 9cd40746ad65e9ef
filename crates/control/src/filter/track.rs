//! A filter's memory along one recording.

use super::{Gaussian, ProcessFactor, SwitchedFilter, switched::Placing};
use fleetfoot_dynamics::geometry::Geometry;

/// First guess of a sensor's deviation, as a share of the state's typical size.
const GUESS: f64 = 0.1;
/// Rows that this guess counts for.
const GUESSED: f64 = 10.0;
/// Initial slope of the factor on the process noise, rows: it damps the first steps.
const FIRST_SLOPE: f64 = 20.0;
/// Limit of a row's effect on that factor, and on the deviation of a sensor, in expected squares: outliers are no
/// noise.
const MOST_OVER: f64 = 20.0;

/// State of a filter at a row.
pub struct Track {
    /// The probability of every region.
    weights: Vec<f64>,
    /// The states under every region.
    modes: Vec<Mode>,
    estimate: Gaussian,
    inputs: Vec<f64>,
    sensors: Vec<Sensor>,
    log_likelihood: f64,
    /// Squared innovations in their deviations, and how many there are.
    nis: f64,
    observed: usize,
    held_inputs: usize,
    process: Process,
    placing: Placing,
    lost: bool,
}

/// The factor on the process noise.
#[derive(Debug, Clone, Copy)]
struct Process {
    factor: f64,
    /// Derivative of the normalised innovations so far by the logarithm of the factor; `None`: the factor is given.
    slope: Option<f64>,
}

impl Process {
    /// A step of Newton's method towards the factor that makes normalised innovations consistent, with `over` the
    /// excess of their squares over their number (Robbins and Monro, "A stochastic approximation method", Ann. Math.
    /// Statist. 22, 1951). Gains fall as 2/k, not 1/k, so that the k-th row counts k times: the first ones were judged
    /// by a wrong factor.
    fn learn(&mut self, over: f64, slope: f64, sensors: f64) {
        if let Some(all) = &mut self.slope {
            *all += slope;
            self.factor *= (2.0 * over.min(MOST_OVER * sensors) / *all).exp();
        }
    }
}

/// The states under the hypothesis that they are in a region: a normal distribution, of which only the part inside
/// counts.
#[derive(Clone)]
struct Mode {
    state: Gaussian,
    /// Its points and their regions; empty where regions do not follow from the state.
    offsets: Vec<f64>,
    places: Vec<Option<usize>>,
}

/// State of a sensor.
#[derive(Debug, Clone, Copy, Default)]
struct Sensor {
    /// The innovation at the present row, NaN for none, and its variance.
    innovation: f64,
    variance: f64,
    /// The variance of its noise by the innovations so far, and their information about its logarithm.
    noise: Option<f64>,
    information: f64,
}

impl Sensor {
    /// The variance of the sensor's noise that is expected of the innovations so far, of a state of this size.
    fn expected_variance(&self, size: f64) -> f64 {
        self.noise.unwrap_or((GUESS * size).powi(2))
    }

    /// A step of Fisher's scoring towards the most likely variance of the noise. It was taken for `noise` when an
    /// innovation of the variance `all` was `off`. A square over its expectation is informative about the logarithm as
    /// far as noise is a share of it, so that rows with an uncertain state count next to nothing. Gains are four times
    /// those of a mean, so that a guess that was a hundred times too large is forgotten within some hundred rows.
    fn learn(&mut self, off: f64, noise: f64, all: f64) {
        let share = noise / all;
        self.information += share * share;
        let over = (off * off / all - 1.0).min(MOST_OVER);
        let next = noise * (4.0 * share * over / (GUESSED + self.information)).exp();
        self.noise = Some(next.max(f64::MIN_POSITIVE));
    }
}

impl Mode {
    fn new(filter: &SwitchedFilter, state: Gaussian, inputs: &[f64], placing: &Placing) -> Self {
        if !filter.by_state() {
            return Self { state, offsets: Vec::new(), places: Vec::new() };
        }
        let offsets = filter.offsets(&state);
        let places = filter.place(&state.mean, &offsets, inputs, placing);
        Self { state, offsets, places }
    }

    /// The share of the distribution that lies in a region: half a point where none does, as its tail does.
    fn mass(&self, region: usize) -> f64 {
        if self.places.is_empty() {
            return 1.0;
        }
        let inside = self.places.iter().filter(|place| **place == Some(region)).count() as f64;
        inside.max(0.5) / self.places.len() as f64
    }

    /// Part of the distribution inside a test, as a normal distribution; the whole if all points or none are inside.
    fn part(&self, inside: &dyn Fn(usize) -> bool, geometry: &Geometry) -> Gaussian {
        let n = self.offsets.len().checked_div(self.places.len()).unwrap_or(0);
        let count = (0..self.places.len()).filter(|&point| inside(point)).count();
        if count == 0 || count == self.places.len() {
            return self.state.clone();
        }
        let offsets = self.offsets.chunks_exact(n).enumerate().filter(|(point, _)| inside(*point));
        self.state.around(n, count, offsets.map(|(_, offset)| offset), geometry)
    }

    /// Result of a step from a region: probabilities and states by the regions to which its points moved; `before` are
    /// their regions before. The part that stays is the whole, unchanged.
    fn crossed(&self, from: usize, before: &[Option<usize>], geometry: &Geometry) -> Vec<(usize, f64, Gaussian)> {
        let began = |point: usize| before[point] == Some(from);
        // If no point lies in the region, all points count.
        let any = (0..before.len()).any(began);
        let counts = |point: usize| !any || began(point);
        let all = (0..before.len()).filter(|&point| counts(point)).count() as f64;
        let mut regions: Vec<usize> =
            (0..before.len()).filter(|&point| counts(point)).map(|point| self.places[point].unwrap_or(from)).collect();
        regions.sort_unstable();
        regions.dedup();
        let part = |region: usize| {
            let here = |point: usize| counts(point) && self.places[point].unwrap_or(from) == region;
            let share = (0..before.len()).filter(|&point| here(point)).count() as f64 / all;
            let state = if region == from { self.state.clone() } else { self.part(&here, geometry) };
            (region, share, state)
        };
        regions.into_iter().map(part).collect()
    }
}

impl SwitchedFilter {
    /// Begins at a row: measured states at their measurements, the others at their prior.
    ///
    /// `measured` and `deviations` have a number a sensor; NaN: missing, and not given.
    pub fn start(&self, measured: &[f64], deviations: &[f64]) -> Track {
        Track::new(self, measured, deviations)
    }

    /// Passes to the next row, `seconds` later. `inputs` are those of the row before, held until then (NaN: unchanged);
    /// `measured` and `deviations` are those of the new row.
    pub fn step(&self, track: &mut Track, inputs: &[f64], seconds: f64, measured: &[f64], deviations: &[f64]) {
        track.advance(self, inputs, seconds, measured, deviations);
    }
}

impl Track {
    fn new(filter: &SwitchedFilter, measured: &[f64], deviations: &[f64]) -> Self {
        let (mut mean, mut spread) = filter.prior.clone();
        let blank = Sensor { innovation: f64::NAN, variance: f64::NAN, ..Sensor::default() };
        let count = filter.regions();
        let known = |(sensor, deviation): (&(usize, Option<f64>), &f64)| sensor.1.is_some() || deviation.is_finite();
        let known = filter.sensors.iter().zip(deviations).all(known);
        let mut begun = Self {
            weights: vec![1.0 / count as f64; count],
            modes: Vec::new(),
            estimate: Gaussian { mean: Vec::new(), covariance: Vec::new() },
            inputs: vec![0.0; filter.inputs().len()],
            sensors: vec![blank; filter.sensors.len()],
            log_likelihood: 0.0,
            nis: 0.0,
            observed: 0,
            held_inputs: 0,
            process: Process {
                factor: if let ProcessFactor::Given(factor) = filter.process { factor } else { 1.0 },
                slope: (filter.process == ProcessFactor::Estimated && known).then_some(FIRST_SLOPE),
            },
            placing: filter.placing(),
            lost: false,
        };
        for (k, &(state, _)) in filter.sensors.iter().enumerate() {
            if measured[k].is_finite() {
                (mean[state], spread[state]) = (measured[k], begun.variance(filter, k, deviations[k]).sqrt());
            }
        }
        filter.geometry.begin(&mut mean);
        begun.estimate = Gaussian::independent(mean, &spread);
        let state = match filter.colour() {
            None => begun.estimate.clone(),
            Some(colour) => begun.estimate.clone().with_residuals(colour),
        };
        let whole = Mode::new(filter, state, &begun.inputs, &begun.placing);
        if filter.by_state() {
            let inside = |region: usize| whole.places.iter().filter(|place| **place == Some(region)).count() as f64;
            let shares: Vec<f64> = (0..count).map(inside).collect();
            let all: f64 = shares.iter().sum();
            if all > 0.0 {
                begun.weights = shares.iter().map(|share| share / all).collect();
            }
        }
        begun.modes = vec![whole; count];
        if !begun.estimate.is_finite() {
            begun.lose();
        }
        begun
    }

    /// True once the filter has ended: its probabilities, means or covariances overflowed, as in an unstable region without measurements. Estimates,
    /// probabilities and innovations are NaN from that row on.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// The states, and their covariance.
    pub fn estimate(&self) -> &Gaussian {
        &self.estimate
    }

    /// The probability of every region, with the inputs of the step that led to the row.
    pub fn probabilities(&self) -> &[f64] {
        &self.weights
    }

    /// Measured less predicted, a number a sensor; NaN where nothing was measured.
    pub fn innovation(&self, sensor: usize) -> f64 {
        self.sensors[sensor].innovation
    }

    /// The variance that this innovation was expected to have.
    pub fn innovation_variance(&self, sensor: usize) -> f64 {
        self.sensors[sensor].variance
    }

    /// The logarithm of the probability density of the row's measurements, given all rows before.
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// The normalised innovation squared, and its degrees of freedom: the sensors that measured.
    pub fn nis(&self) -> (f64, usize) {
        (self.nis, self.observed)
    }

    /// The deviation that a sensor without a given one was found to have so far.
    pub fn estimated_deviation(&self, filter: &SwitchedFilter, sensor: usize) -> f64 {
        self.sensors[sensor].expected_variance(filter.prior.1[filter.sensors[sensor].0]).sqrt()
    }

    /// Steps for which inputs were missing and held.
    pub fn held_inputs(&self) -> usize {
        self.held_inputs
    }

    /// The factor on the process noise: as given, or found so far.
    pub fn process(&self) -> f64 {
        self.process.factor
    }

    /// The variance of a measurement: given with it, or that of its sensor, or estimated so far.
    fn variance(&self, filter: &SwitchedFilter, sensor: usize, row_deviation: f64) -> f64 {
        let (state, deviation) = filter.sensors[sensor];
        let row_deviation = Some(row_deviation).filter(|deviation| deviation.is_finite() && *deviation > 0.0);
        match row_deviation.or(deviation) {
            Some(deviation) => deviation * deviation,
            None => self.sensors[sensor].expected_variance(filter.prior.1[state]),
        }
    }

    fn advance(&mut self, filter: &SwitchedFilter, inputs: &[f64], seconds: f64, measured: &[f64], deviations: &[f64]) {
        if self.lost {
            return;
        }
        let learned = (self.sensors.clone(), self.process);
        self.take_inputs(filter, inputs);
        let steps = filter.steps_over(seconds);
        for _ in 0..steps {
            match filter.transitions() {
                Some(transitions) if filter.regions() > 1 => self.switch(filter, transitions),
                _ => {}
            }
            self.predict(filter, seconds / steps as f64);
        }
        if !self.active().is_empty() {
            self.observe(filter, measured, deviations);
        }
        match self.mixture(filter) {
            Some(estimate) => self.estimate = estimate,
            None => {
                (self.sensors, self.process) = learned;
                self.lose();
            }
        }
    }

    /// The states over all regions; none where no probability or no distribution is finite.
    fn mixture(&self, filter: &SwitchedFilter) -> Option<Gaussian> {
        let active = self.active();
        if active.is_empty() || !self.weights.iter().all(|weight| weight.is_finite()) {
            return None;
        }
        let inside = |region: usize| {
            let mode = &self.modes[region];
            mode.part(&|point| mode.places[point] == Some(region), &filter.geometry)
        };
        let parts: Vec<Gaussian> = active.iter().map(|&region| inside(region)).collect();
        let parts: Vec<(f64, &Gaussian)> = active.iter().map(|&region| self.weights[region]).zip(&parts).collect();
        let all = Gaussian::mixture(&parts, &filter.geometry);
        all.is_finite().then(|| all.leading(filter.states().len()))
    }

    /// Ends the filter: nothing is known from here on but the noise that was found before.
    fn lose(&mut self) {
        self.lost = true;
        self.estimate.mean.fill(f64::NAN);
        self.estimate.covariance.fill(f64::NAN);
        self.weights.fill(f64::NAN);
        for sensor in &mut self.sensors {
            (sensor.innovation, sensor.variance) = (f64::NAN, f64::NAN);
        }
        (self.log_likelihood, self.nis, self.observed) = (f64::NAN, f64::NAN, 0);
    }

    /// The regions that count.
    fn active(&self) -> Vec<usize> {
        (0..self.weights.len()).filter(|&region| self.weights[region] > 0.0).collect()
    }

    /// The inputs of the step that begins; if the regions depend on them, the state changes its region with them.
    fn take_inputs(&mut self, filter: &SwitchedFilter, inputs: &[f64]) {
        let (mut held, mut changed) = (false, false);
        for (held_input, &input) in self.inputs.iter_mut().zip(inputs) {
            held |= !input.is_finite();
            if input.is_finite() {
                changed |= *held_input != input;
                *held_input = input;
            }
        }
        self.held_inputs += usize::from(held);
        if !(changed && filter.by_state() && filter.regions_read_inputs()) {
            return;
        }
        let moved = self.active().into_iter().map(|region| {
            let mut mode = self.modes[region].clone();
            let before = std::mem::take(&mut mode.places);
            mode.places = filter.place(&mode.state.mean, &mode.offsets, &self.inputs, &self.placing);
            (region, mode, before)
        });
        let moved: Vec<(usize, Mode, Vec<Option<usize>>)> = moved.collect();
        self.join(filter, moved);
    }

    /// One region follows another, wherever the state is.
    fn switch(&mut self, filter: &SwitchedFilter, transitions: &[Vec<f64>]) {
        let active = self.active();
        let to = |to: usize| {
            let share = |&from: &usize| (self.weights[from] * transitions[from][to], &self.modes[from].state);
            active.iter().map(share).collect::<Vec<_>>()
        };
        let next: Vec<(f64, Gaussian)> =
            (0..self.weights.len()).map(|region| mixed(&to(region), &filter.geometry)).collect();
        self.set(filter, next);
    }

    /// The step of every region, and the parts that cross a border by it.
    fn predict(&mut self, filter: &SwitchedFilter, seconds: f64) {
        let mut moved: Vec<(usize, Mode, Vec<Option<usize>>)> = Vec::new();
        let active = self.active();
        for &region in &active {
            let mode = &self.modes[region];
            let state = filter.stepped(region, &mode.state, &self.inputs, seconds, self.process.factor);
            if state.is_finite() {
                moved.push((region, Mode::new(filter, state, &self.inputs, &self.placing), mode.places.clone()));
            } else {
                // As wide as this, it foresees no measurement: others are infinitely more likely.
                self.weights[region] = 0.0;
            }
        }
        if moved.len() < active.len() {
            filter.likely(&mut self.weights);
        }
        if filter.by_state() {
            self.join(filter, moved);
        } else {
            moved.into_iter().for_each(|(region, mode, _)| self.modes[region] = mode);
        }
    }

    /// Joins in every region the part that stayed there and the parts that came.
    fn join(&mut self, filter: &SwitchedFilter, moved: Vec<(usize, Mode, Vec<Option<usize>>)>) {
        let mut parts: Vec<Vec<(f64, Gaussian)>> = vec![Vec::new(); self.weights.len()];
        let mut stayed = true;
        for (from, mode, before) in &moved {
            for (to, share, state) in mode.crossed(*from, before, &filter.geometry) {
                stayed &= to == *from;
                parts[to].push((self.weights[*from] * share, state));
            }
        }
        if stayed {
            moved.into_iter().for_each(|(region, mode, _)| self.modes[region] = mode);
            return;
        }
        let of = |parts: &Vec<(f64, Gaussian)>| {
            let parts: Vec<(f64, &Gaussian)> = parts.iter().map(|(share, state)| (*share, state)).collect();
            mixed(&parts, &filter.geometry)
        };
        let next = parts.iter().map(of).collect();
        self.set(filter, next);
    }

    /// Takes over probabilities and states by region; improbable ones are dropped.
    fn set(&mut self, filter: &SwitchedFilter, next: Vec<(f64, Gaussian)>) {
        self.weights.iter_mut().zip(&next).for_each(|(weight, (share, _))| *weight = *share);
        filter.likely(&mut self.weights);
        for (region, (_, state)) in next.into_iter().enumerate() {
            if self.weights[region] > 0.0 {
                self.modes[region] = Mode::new(filter, state, &self.inputs, &self.placing);
            }
        }
    }

    /// Takes in a row's measurements.
    fn observe(&mut self, filter: &SwitchedFilter, measured: &[f64], deviations: &[f64]) {
        let active = self.active();
        let parts: Vec<(f64, &Gaussian)> =
            active.iter().map(|&region| (self.weights[region], &self.modes[region].state)).collect();
        let mut whole = Gaussian::mixture(&parts, &filter.geometry);
        let prior = whole.clone();
        let n = prior.mean.len();
        (self.nis, self.observed, self.log_likelihood) = (0.0, 0, 0.0);
        let (mut logarithms, mut slope) = (vec![0.0; self.weights.len()], 0.0);
        let mut states: Vec<Gaussian> = active.iter().map(|&region| self.modes[region].state.clone()).collect();
        let known = filter.aligned_sensors(measured, &prior.mean);
        let known_by: Vec<Vec<f64>> =
            states.iter().map(|state| filter.aligned_sensors(measured, &state.mean)).collect();
        for (k, &(state, _)) in filter.sensors.iter().enumerate() {
            (self.sensors[k].innovation, self.sensors[k].variance) = (f64::NAN, f64::NAN);
            if !measured[k].is_finite() {
                continue;
            }
            let variance = self.variance(filter, k, deviations[k]);
            let [innovation, spread] = whole.observe(state, known[k], variance, &filter.geometry);
            self.nis += innovation * innovation / spread;
            self.observed += 1;
            slope += 1.0 - variance / spread;
            for ((distribution, known), &region) in states.iter_mut().zip(&known_by).zip(&active) {
                let [innovation, spread] = distribution.observe(state, known[k], variance, &filter.geometry);
                logarithms[region] -= 0.5 * (innovation * innovation / spread + (std::f64::consts::TAU * spread).ln());
            }
            let off = filter.geometry.wrapped(state, known[k] - prior.mean[state]);
            let expected = prior.covariance[state * n + state];
            let learns = filter.sensors[k].1.is_none() && !(deviations[k].is_finite() && deviations[k] > 0.0);
            let sensor = &mut self.sensors[k];
            (sensor.innovation, sensor.variance) = (off, expected + variance);
            if learns {
                sensor.learn(off, variance, expected + variance);
            }
        }
        if self.observed == 0 {
            return;
        }
        for state in &mut states {
            filter.geometry.retract_distribution(&mut state.mean, &mut state.covariance);
        }
        let sensors = self.observed as f64;
        self.process.learn(self.nis - sensors, slope, sensors);
        for (state, &region) in states.into_iter().zip(&active) {
            let before = self.modes[region].mass(region);
            self.modes[region] = Mode::new(filter, state, &self.inputs, &self.placing);
            // Only what lies in the region has foreseen the measurement.
            logarithms[region] += (self.modes[region].mass(region) / before).ln();
            if logarithms[region].is_nan() || !self.modes[region].state.is_finite() {
                logarithms[region] = f64::NEG_INFINITY;
            }
        }
        let largest = active.iter().map(|&region| logarithms[region]).fold(f64::NEG_INFINITY, f64::max);
        active.iter().for_each(|&region| self.weights[region] *= (logarithms[region] - largest).exp());
        let all: f64 = self.weights.iter().sum();
        self.log_likelihood = largest + all.ln();
        filter.likely(&mut self.weights);
    }
}

/// The sum of shares, and the normal distribution with the moments of their mixture.
fn mixed(parts: &[(f64, &Gaussian)], geometry: &Geometry) -> (f64, Gaussian) {
    let all: f64 = parts.iter().map(|(share, _)| share).sum();
    let parts: Vec<(f64, &Gaussian)> = parts.iter().map(|(share, state)| (share / all, *state)).collect();
    (all, Gaussian::mixture(&parts, geometry))
}
