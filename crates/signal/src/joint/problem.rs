//! The readings of all runs, the present constants of the sensors, and the results of a pass over the readings.

use std::sync::{Mutex, PoisonError};

use fleetfoot_data::{Cancelled, Silent, checkpoint, parallel_map};
use nalgebra::{DMatrix, DVector};

use super::{
    FusedJoint, JointOptions, JointRun, JointSensorEstimate, JointStates, Quantity,
    derived::Pairs,
    events::{Events, Known, STATES, Seen, WANTED, between},
    result::smoothed,
    scale::Scale,
    start,
};
use crate::{
    Estimate, SignalError,
    fuse::{Prior, slack},
    spline::{filter::Posterior, smoother::Smoother},
};

/// By how much variances change at most between two rounds.
const GREATEST_CHANGE: f64 = 1e4;

/// The least variance of a sensor, in units of the one that it began with.
const LEAST: f64 = 1e-8;

/// The share of a constant's column that is left when the states have explained what they can, below which rounding is all that is left.
const DETERMINED: f64 = 1e-9;

/// Error text if the gate leaves too few readings.
const CONTRADICTED: &str = "more than half of the readings of a sensor lie beyond the gate around the motion of the other sensors: check clocks, signs and units, or state greater noise";

/// A change of a weight that is one.
const WEIGHT: f64 = 1e-3;

/// A constant that is sought.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sought {
    Delay(usize),
    Bias(usize),
}

impl Sought {
    fn sensor(self) -> usize {
        match self {
            Self::Delay(sensor) | Self::Bias(sensor) => sensor,
        }
    }
}

/// Sums over the residuals of a sensor, which estimate its noise.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    /// Squares over variances, and how much of them the states explain.
    squares: f64,
    taken: f64,
    /// Squares, and their redundancy, of the part that belongs to the estimated noise, without steps and windows.
    estimated: f64,
    redundancy: f64,
}

/// Result of a pass over a run.
pub(super) struct Pass {
    /// Residual of every reading, sensor by sensor.
    left: Vec<Vec<f64>>,
    /// Derivative of the readings by a delay, for sensors whose delay is sought.
    slopes: Vec<Vec<f64>>,
    shares: Vec<Share>,
    /// The least value of the objective.
    squares: f64,
    /// The states, and how sensors err together, where instants are among the events.
    smoothed: Option<(JointStates, Pairs)>,
}

/// The whole problem.
pub(super) struct Problem<'a> {
    runs: &'a [JointRun<'a>],
    options: &'a JointOptions,
    events: Vec<Events>,
    scale: Scale,
    known: Vec<Known>,
    variances: Vec<f64>,
    /// First values of the variances.
    first: Vec<f64>,
    density: f64,
    delays: Vec<f64>,
    biases: Vec<f64>,
    sought: Vec<Sought>,
    periods: Vec<f64>,
    /// For each run: true if its readings determine its states.
    determined: Vec<bool>,
    /// True if instants are among the events.
    has_wanted: bool,
}

impl<'a> Problem<'a> {
    pub(super) fn new(runs: &'a [JointRun<'a>], options: &'a JointOptions) -> Result<Self, SignalError> {
        let positions = |run: &JointRun<'_>, is: &dyn Fn(&[f64]) -> bool| {
            let positions =
                run.records.iter().zip(&options.sensors).filter(|(_, sensor)| sensor.quantity == Quantity::Position);
            positions.map(|(record, _)| record.values).any(is)
        };
        let read = runs.iter().any(|run| positions(run, &|values| values.len() > 2));
        if read && !runs.iter().any(|run| positions(run, &|values| values.windows(2).any(|two| two[0] != two[1]))) {
            return Err(SignalError::NotFused {
                problem: "the positions of the joint are all the same, so neither noise nor motion can be estimated: leave the joint out, or give other channels",
            });
        }
        let start::Begin { scale, variances, density, delays } = start::begin(runs, options)?;
        let sensors = &options.sensors;
        let sought = (0..sensors.len()).filter(|&at| sensors[at].delay.deviation > 0.0).map(Sought::Delay);
        let biases = (0..sensors.len()).filter(|&at| sensors[at].bias.deviation > 0.0).map(Sought::Bias);
        let mut problem = Self {
            runs,
            options,
            events: runs.iter().map(|run| Events::new(run, sensors)).collect(),
            scale,
            known: Vec::new(),
            first: variances.clone(),
            variances,
            density,
            sought: sought.chain(biases).collect(),
            delays,
            biases: sensors.iter().map(|sensor| sensor.bias.value).collect(),
            periods: (0..sensors.len()).map(|sensor| start::period(runs, sensor)).collect(),
            determined: Vec::new(),
            has_wanted: false,
        };
        problem.know();
        // Without free constants, the first pass over the readings may be all there is to do.
        let given = problem.sought.is_empty() && options.jerk.is_some();
        problem.sort(given && sensors.iter().all(|sensor| sensor.noise.is_some()));
        problem.determined = (0..runs.len()).map(|run| problem.smoother(run, None).is_determined()).collect();
        if !problem.determined.contains(&true) {
            return Err(SignalError::NotFused {
                problem: if read {
                    "positions do not determine the motion of the joint: leave out impossibly large readings, or give another density of the jerk"
                } else {
                    "no record of positions has three readings: give longer records, or other channels"
                },
            });
        }
        Ok(problem)
    }

    /// The sensors as they are thought to be now.
    fn know(&mut self) {
        let sensor = |at: usize| {
            let settings = &self.options.sensors[at];
            Known::new(settings, &self.scale, self.variances[at], self.density, self.delays[at], self.biases[at])
        };
        self.known = (0..self.variances.len()).map(sensor).collect();
    }

    fn sort(&mut self, wanted: bool) {
        self.has_wanted = wanted;
        for (events, run) in self.events.iter_mut().zip(self.runs) {
            events.sort(run, &self.known, wanted);
        }
    }

    fn seen<'b>(&'b self, run: usize, column: Option<&'b [Vec<f64>]>) -> Seen<'b> {
        Seen { run: &self.runs[run], events: &self.events[run], known: &self.known, scale: &self.scale, column }
    }

    fn smoother<'b>(&'b self, run: usize, column: Option<&'b [Vec<f64>]>) -> Smoother<Seen<'b>, STATES> {
        Smoother::new(self.seen(run, column), self.density.recip())
    }

    /// The runs whose states are told.
    fn determined_runs(&self) -> Vec<usize> {
        (0..self.runs.len()).filter(|&run| self.determined[run]).collect()
    }

    /// Works on `count` parts, in any order, and hands back what each gives in theirs.
    fn each<T: Send>(&self, count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
        match parallel_map(count, &Silent, |at| Ok::<_, Cancelled>(work(at))) {
            Ok(results) => results,
            // A stop was set: the whole work ends here.
            Err(_) => {
                checkpoint();
                Vec::new()
            }
        }
    }

    /// Smooths all runs.
    pub(super) fn passes(&self) -> Result<Vec<Pass>, SignalError> {
        let runs = self.determined_runs();
        // The gate may have left out all that tells where the joint is.
        if runs.iter().any(|&run| !self.smoother(run, None).is_determined()) {
            return Err(SignalError::NotFused { problem: CONTRADICTED });
        }
        let passes = self.each(runs.len(), |at| self.pass(runs[at]));
        if passes.iter().any(|pass| !pass.squares.is_finite()) {
            return Err(SignalError::NotFused {
                problem: "squares of the residuals overflow: leave out impossibly large readings",
            });
        }
        Ok(passes)
    }

    fn pass(&self, run: usize) -> Pass {
        checkpoint();
        let records = &self.runs[run].records;
        let seen = self.seen(run, None);
        let empty = |is: &dyn Fn(usize) -> bool| -> Vec<Vec<f64>> {
            (0..records.len()).map(|at| if is(at) { vec![0.0; records[at].values.len()] } else { Vec::new() }).collect()
        };
        let mut pass = Pass {
            left: empty(&|_| true),
            slopes: empty(&|sensor| self.sought.contains(&Sought::Delay(sensor))),
            shares: vec![Share::default(); records.len()],
            squares: 0.0,
            smoothed: None,
        };
        let mut states = self.has_wanted.then(|| self.blank_states(run));
        pass.squares = self.smoother(run, None).smooth(|at, state| {
            if let Some(states) = &mut states {
                self.tell(run, at, state, states);
            }
            let event = seen.events.order[at];
            if event.sensor == WANTED {
                return;
            }
            let (sensor, row) = (usize::from(event.sensor), event.row as usize);
            let left = seen.left(sensor, row, &state.mean);
            pass.left[sensor][row] = left;
            let known = &seen.known[sensor];
            if let Some(slope) = pass.slopes[sensor].get_mut(row) {
                *slope = known.rate(&state.mean);
            }
            if let Some((_, _, variance)) = seen.reading(at) {
                let taken = between(&known.slopes, &state.covariance, &known.slopes) / variance;
                let (square, redundancy) = (left * left / variance, known.variance / seen.variance(sensor, row));
                let share = &mut pass.shares[sensor];
                share.squares += square;
                share.taken += taken;
                share.estimated += square * redundancy;
                share.redundancy += (1.0 - taken) * redundancy;
            }
        });
        pass.smoothed = states;
        pass
    }

    /// No states yet, nor pairs.
    fn blank_states(&self, run: usize) -> (JointStates, Pairs) {
        (self.unknown(&self.runs[run]), Pairs::new(self.periods.clone()))
    }

    /// Takes the state of an event.
    #[inline]
    fn tell(&self, run: usize, at: usize, state: &Posterior<STATES>, (states, pairs): &mut (JointStates, Pairs)) {
        let seen = self.seen(run, None);
        let event = seen.events.order[at];
        if event.sensor == WANTED {
            for k in 0..STATES {
                states.derivatives[k][event.row as usize] = state.mean[k];
                states.deviations[k][event.row as usize] = state.covariance[k][k];
            }
        } else if self.variances.len() > 1
            && let Some((sensor, row, _)) = seen.reading(at)
        {
            pairs.add(&seen, [sensor, row], seen.left(sensor, row, &state.mean), state);
        }
    }

    /// Derivative of the readings of a run by a constant, sensor by sensor.
    fn column(&self, run: usize, pass: &Pass, sought: Sought) -> Vec<Vec<f64>> {
        let records = &self.runs[run].records;
        let of = |sensor: usize| match sought {
            Sought::Delay(delayed) if delayed == sensor => pass.slopes[sensor].iter().map(|slope| -slope).collect(),
            Sought::Bias(biased) if biased == sensor => vec![1.0; records[sensor].values.len()],
            _ => Vec::new(),
        };
        (0..records.len()).map(of).collect()
    }

    /// A unit of a constant, in s or in the unit of its sensor.
    fn unit(&self, sought: Sought) -> f64 {
        match sought {
            Sought::Delay(_) => self.scale.unit,
            Sought::Bias(sensor) => self.scale.back(self.options.sensors[sensor].quantity),
        }
    }

    fn prior(&self, sought: Sought) -> (Prior<f64>, f64) {
        match sought {
            Sought::Delay(sensor) => (self.options.sensors[sensor].delay, self.delays[sensor]),
            Sought::Bias(sensor) => (self.options.sensors[sensor].bias, self.biases[sensor]),
        }
    }

    /// The step of the constants to the least of the linearised problem, and their covariance, in their units.
    fn border(&self, passes: &[Pass]) -> Result<(DVector<f64>, DMatrix<f64>), SignalError> {
        let (count, runs) = (self.sought.len(), self.determined_runs());
        let rows =
            self.each(count * runs.len(), |at| self.border_row(runs[at / count], &passes[at / count], at % count));
        let (mut normal, mut right) = (DMatrix::<f64>::zeros(count, count), DVector::<f64>::zeros(count));
        let mut whole = DVector::<f64>::zeros(count);
        for (at, row) in rows.iter().enumerate() {
            let v = at % count;
            for (u, product) in row.products.iter().enumerate() {
                normal[(u, v)] += 0.5 * product;
                normal[(v, u)] += 0.5 * product;
            }
            right[v] += row.right;
            whole[v] += row.whole;
        }
        for (at, &sought) in self.sought.iter().enumerate() {
            let (prior, value) = self.prior(sought);
            if prior.deviation.is_finite() {
                let unit = self.unit(sought) / prior.deviation;
                normal[(at, at)] += unit * unit;
                whole[at] += unit * unit;
                right[at] += unit * (prior.value - value) / prior.deviation;
            }
        }
        let undetermined = SignalError::NotFused {
            problem: "the motion does not determine all unknowns: give delay or bias, or a record with more motion",
        };
        let Some(root) = normal.cholesky() else { return Err(undetermined) };
        let l = root.l();
        if !(0..count).all(|at| l[(at, at)].powi(2) > DETERMINED * whole[at]) {
            return Err(undetermined);
        }
        Ok((root.solve(&right), root.inverse()))
    }

    fn border_row(&self, run: usize, pass: &Pass, v: usize) -> BorderRow {
        checkpoint();
        let column = self.column(run, pass, self.sought[v]);
        let seen = self.seen(run, Some(&column));
        let mut row = BorderRow { products: vec![0.0; self.sought.len()], right: 0.0, whole: 0.0 };
        self.smoother(run, Some(&column)).smooth(|at, state| {
            let Some((sensor, reading, variance)) = seen.reading(at) else { return };
            let left = seen.left(sensor, reading, &state.mean) / variance;
            for (u, &sought) in self.sought.iter().enumerate().filter(|(_, sought)| sought.sensor() == sensor) {
                let slope = match sought {
                    Sought::Delay(_) => -pass.slopes[sensor][reading],
                    Sought::Bias(_) => 1.0,
                };
                row.products[u] += slope * left;
                if u == v {
                    row.right += slope * pass.left[sensor][reading] / variance;
                    row.whole += slope * slope / variance;
                }
            }
        });
        row
    }

    /// Moves delays and biases to where they are thought to be. The greatest step, in deviations.
    pub(super) fn move_constants(&mut self, passes: &[Pass]) -> Result<f64, SignalError> {
        if self.sought.is_empty() {
            return Ok(0.0);
        }
        let (step, covariance) = self.border(passes)?;
        let mut most: f64 = 0.0;
        for (at, &sought) in self.sought.clone().iter().enumerate() {
            let moved = step[at] * self.unit(sought);
            most = most.max(step[at].abs() / covariance[(at, at)].sqrt());
            match sought {
                Sought::Bias(sensor) => self.biases[sensor] += moved,
                Sought::Delay(sensor) => {
                    let prior = self.options.sensors[sensor].delay;
                    let (low, high) = (prior.value - slack(&prior), prior.value + slack(&prior));
                    self.delays[sensor] = (self.delays[sensor] + moved).clamp(low, high);
                }
            }
        }
        self.know();
        self.sort(false);
        Ok(most)
    }

    /// Takes the noise for what residuals say it is. The greatest ratio of a variance to the one before.
    pub(super) fn take_noise(&mut self, passes: &[Pass]) -> f64 {
        let mut change: f64 = 1.0;
        let mut take = |variance: &mut f64, squares: f64, redundancy: f64, least: f64| {
            if redundancy < 1.0 || squares <= 0.0 {
                return;
            }
            let ratio = (squares / redundancy).clamp(1.0 / GREATEST_CHANGE, GREATEST_CHANGE).max(least / *variance);
            *variance *= ratio;
            change = change.max(ratio).max(ratio.recip());
        };
        let sum = |of: &dyn Fn(&Pass) -> f64| passes.iter().map(of).sum::<f64>();
        for (sensor, _) in self.options.sensors.iter().enumerate().filter(|(_, sensor)| sensor.noise.is_none()) {
            let squares = sum(&|pass| pass.shares[sensor].estimated);
            let redundancy = sum(&|pass| pass.shares[sensor].redundancy);
            take(&mut self.variances[sensor], squares, redundancy, LEAST * self.first[sensor]);
        }
        if self.options.jerk.is_none() {
            // The rest of the objective belongs to the jerk; readings that determine states determine it.
            let of_readings = |pass: &Pass| pass.shares.iter().map(|share| share.squares).sum::<f64>();
            let squares = sum(&|pass| pass.squares - of_readings(pass));
            let taken = |pass: &Pass| pass.shares.iter().map(|share| share.taken).sum::<f64>();
            let redundancy = sum(&|pass| taken(pass) - STATES as f64);
            take(&mut self.density, squares, redundancy, 0.0);
        }
        self.know();
        change
    }

    /// Weighs readings by what was left of them, and chooses those beyond the gate, which are left out, where that is `gated`: else that choice stays. Whether anything changed.
    pub(super) fn weigh(&mut self, passes: &[Pass], gated: bool) -> bool {
        let mut changed = false;
        for (&run, pass) in self.determined_runs().iter().zip(passes) {
            for (sensor, left) in pass.left.iter().enumerate() {
                for (row, left) in left.iter().enumerate() {
                    let square = left * left / self.seen(run, None).variance(sensor, row);
                    let (weight, gate) = (self.options.loss.of(square, 1.0).1, self.options.gate);
                    let slot = &mut self.events[run].weights[sensor][row];
                    let outside = if gated { gate > 0.0 && square > gate * gate } else { *slot == 0.0 };
                    let weight = if outside { 0.0 } else { weight };
                    changed |= (weight - *slot).abs() > WEIGHT;
                    *slot = weight;
                }
            }
        }
        changed
    }

    /// Reads the answer from a problem that came to rest, and from what the last pass over the readings left where nothing changed since.
    pub(super) fn fused(
        mut self,
        rounds: usize,
        converged: bool,
        last: Option<Vec<Pass>>,
    ) -> Result<FusedJoint, SignalError> {
        if self.is_far() {
            return Err(SignalError::NotFused {
                problem: "the stamps of two sensors of the joint differ by more than three deviations of the delay, or 0.1 s: correct the clocks first ([clocks.NAME] of a recipe), or give a better delay",
            });
        }
        self.is_rarely_used()?;
        let mut passes = last.map_or_else(|| self.passes(), Ok)?;
        let covariance = match self.sought.is_empty() {
            true => DMatrix::zeros(0, 0),
            false => self.border(&passes)?.1,
        };
        // Of a long record this is as much as all readings, and is not asked for any more.
        passes.iter_mut().for_each(|pass| pass.left = Vec::new());
        if !self.has_wanted {
            self.sort(true);
        }
        let determined = self.determined_runs();
        let taken: Vec<Mutex<Option<_>>> = passes.iter_mut().map(|pass| Mutex::new(pass.smoothed.take())).collect();
        let smoothed = self.each(determined.len(), |at| {
            let before = taken[at].lock().unwrap_or_else(PoisonError::into_inner).take();
            self.states(determined[at], &passes[at], before, &covariance)
        });
        let mut pairs = Pairs::new(self.periods.clone());
        let mut runs: Vec<Option<JointStates>> = vec![None; self.runs.len()];
        for (&run, (states, run_pairs)) in determined.iter().zip(smoothed) {
            runs[run] = Some(states);
            pairs.merge(&run_pairs);
        }
        let or_unknown = |(states, run): (Option<JointStates>, _)| states.unwrap_or_else(|| self.unknown(run));
        let runs = runs.into_iter().zip(self.runs).map(or_unknown).collect();
        let smoothed = self.smoothed();
        let sensors = (0..self.variances.len()).map(|at| self.estimate(at, &covariance)).collect();
        let jerk = (self.density * self.scale.density()).sqrt();
        Ok(FusedJoint { runs, jerk, sensors, correlations: pairs.correlations(), rounds, converged, smoothed })
    }

    fn is_far(&self) -> bool {
        self.options.sensors.iter().zip(&self.delays).any(|(sensor, delay)| {
            let (prior, off) = (sensor.delay, (delay - sensor.delay.value).abs());
            prior.deviation > 0.0 && off >= slack(&prior)
        })
    }

    /// Refuses a sensor if most of its readings were left out: it then measures no motion of this joint.
    fn is_rarely_used(&self) -> Result<(), SignalError> {
        let rare = |sensor: usize| {
            let weights = || self.events.iter().flat_map(|events| &events.weights[sensor]);
            2 * weights().filter(|weight| **weight > 0.0).count() < weights().count()
        };
        match (0..self.variances.len()).any(rare) {
            false => Ok(()),
            true => Err(SignalError::NotFused { problem: CONTRADICTED }),
        }
    }

    fn unknown(&self, run: &JointRun<'_>) -> JointStates {
        let none = || std::array::from_fn(|_| vec![f64::NAN; run.at.len()]);
        JointStates { derivatives: none(), deviations: none(), rejected: vec![Vec::new(); run.records.len()] }
    }

    /// The states of a run at the instants that are wanted, and how its sensors err together, from what a pass told of both where there was one.
    fn states(
        &self,
        run: usize,
        pass: &Pass,
        smoothed: Option<(JointStates, Pairs)>,
        covariance: &DMatrix<f64>,
    ) -> (JointStates, Pairs) {
        checkpoint();
        let (mut states, pairs) = smoothed.unwrap_or_else(|| {
            let mut states = self.blank_states(run);
            self.smoother(run, None).smooth(|at, state| self.tell(run, at, state, &mut states));
            states
        });
        if self.options.estimate == Estimate::Filter {
            let rejected = std::mem::take(&mut states.rejected);
            states = JointStates { rejected, ..self.unknown(&self.runs[run]) };
            self.wanted(run, None, |row, state| {
                for k in 0..STATES {
                    states.derivatives[k][row] = state.mean[k];
                    states.deviations[k][row] = state.covariance[k][k];
                }
            });
        }
        self.add_border(run, pass, covariance, &mut states);
        for k in 0..STATES {
            let (unit, centre) = (self.scale.derivative(k), if k == 0 { self.scale.centre } else { 0.0 });
            states.derivatives[k].iter_mut().for_each(|value| *value = *value * unit + centre);
            states.deviations[k].iter_mut().for_each(|variance| *variance = variance.sqrt() * unit);
        }
        for (sensor, weights) in self.events[run].weights.iter().enumerate() {
            states.rejected[sensor] = (0..weights.len()).filter(|&row| weights[row] == 0.0).collect();
        }
        (states, pairs)
    }

    /// Adds to the variances what is not known of the constants: the squares of what the smoother makes of each column of the root of their covariance.
    fn add_border(&self, run: usize, pass: &Pass, covariance: &DMatrix<f64>, states: &mut JointStates) {
        let Some(root) = covariance.clone().cholesky().map(|root| root.l()) else { return };
        for k in 0..self.sought.len() {
            let mut column: Vec<Vec<f64>> = vec![Vec::new(); self.variances.len()];
            for (u, &sought) in self.sought.iter().enumerate() {
                let slopes = self.column(run, pass, sought);
                for (sum, slope) in column.iter_mut().zip(slopes) {
                    sum.resize(sum.len().max(slope.len()), 0.0);
                    sum.iter_mut().zip(slope).for_each(|(sum, slope)| *sum += root[(u, k)] * slope);
                }
            }
            self.wanted(run, Some(&column), |row, state| {
                for k in 0..STATES {
                    states.deviations[k][row] += state.mean[k] * state.mean[k];
                }
            });
        }
    }

    /// Hands out the states of the instants that are wanted, as they are to be told.
    fn wanted(&self, run: usize, column: Option<&[Vec<f64>]>, mut emit: impl FnMut(usize, &Posterior<STATES>)) {
        let order = &self.events[run].order;
        let emit = |at: usize, state: &Posterior<STATES>| {
            if order[at].sensor == WANTED {
                emit(order[at].row as usize, state);
            }
        };
        let smoother = self.smoother(run, column);
        match self.options.estimate {
            Estimate::Smoother => {
                smoother.smooth(emit);
            }
            Estimate::Filter => smoother.filter(emit),
        }
    }

    fn estimate(&self, sensor: usize, covariance: &DMatrix<f64>) -> JointSensorEstimate {
        let settings = &self.options.sensors[sensor];
        let deviation = |sought: Sought| {
            let at = self.sought.iter().position(|parameter| *parameter == sought);
            at.map_or(0.0, |at| covariance[(at, at)].sqrt() * self.unit(sought))
        };
        JointSensorEstimate {
            noise: settings.noise.unwrap_or(self.variances[sensor].sqrt() * self.scale.back(settings.quantity)),
            alone: self.first[sensor].sqrt() * self.scale.back(settings.quantity),
            delay: Prior { value: self.delays[sensor], deviation: deviation(Sought::Delay(sensor)) },
            bias: Prior { value: self.biases[sensor], deviation: deviation(Sought::Bias(sensor)) },
            readings: self.runs.iter().map(|run| run.records[sensor].values.len()).sum(),
        }
    }

    /// Seconds after which states share a hundredth of a reading, from how often what is read.
    fn smoothed(&self) -> f64 {
        let mut densities = [0.0; 2];
        for (sensor, known) in self.known.iter().enumerate() {
            let at = usize::from(known.slopes[0] == 0.0);
            densities[at] += self.scale.unit / self.periods[sensor] / (known.variance + known.step + known.beyond);
        }
        smoothed(densities[0], densities[1], self.density) * self.scale.unit
    }
}

/// Products of a constant's column with itself and with the others.
struct BorderRow {
    products: Vec<f64>,
    right: f64,
    whole: f64,
}
