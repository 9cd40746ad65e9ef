//! The interacting Kalman filters of a model's regions.

use std::cell::RefCell;

use faer::Mat;
use fleetfoot_data::packed;
use fleetfoot_dynamics::{
    Points, StepperWorkspace,
    geometry::{Component, Geometry, Shape, parts},
};
use fleetfoot_model::Model;
use fleetfoot_stats::Autoregression;

use super::{
    FilterColour, FilterError, FilterTables, Gaussian, StepMap,
    noise::{coloured_noise, described, white_noise},
    points::standard_points,
    step_noise::StepNoise,
};
use crate::{
    ControlError, Error,
    named::{find, finite},
    pieces::Pieces,
};

/// A step this near to the model's own is its own, a share of it.
const SAME_STEP: f64 = 1e-3;
/// Share of all regions alike that is mixed into the probabilities of transitions: an unseen transition is not
/// impossible.
pub(super) const FLOOR: f64 = 1e-3;
/// Regions less probable than this take no part in a step.
const LEAST: f64 = 1e-9;
/// More missing rows than this are not stepped over one by one.
const MOST_MISSING: f64 = 1e5;
/// Slopes that differ by less, relative to the largest, are the same: the submodel is affine.
const SAME_SLOPE: f64 = 1e-9;

/// Options of a filter.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilterOptions {
    /// Measured states, each once.
    pub measured: Vec<Measured>,
    /// Initial mean and standard deviation of states that the first row does not measure; the default is those of the
    /// training.
    pub initial: Vec<(String, f64, f64)>,
    /// The factor on the process noise, which is the residual covariance of the regions.
    pub process: ProcessFactor,
    /// Colour of the process noise: white, or correlated from row to row.
    pub noise: NoiseColour,
    /// Rule by which one region follows another.
    pub switching: Switching,
}

/// A state that is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Its name.
    pub state: String,
    /// The standard deviation of a measurement; `None`: given row by row, or estimated from the innovations so far.
    pub deviation: Option<f64>,
}

/// The factor on the covariances of the process noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProcessFactor {
    /// This one.
    Given(f64),
    /// By the innovations so far, where the deviations of all sensors are known; else 1.
    Estimated,
}

impl Default for ProcessFactor {
    fn default() -> Self {
        Self::Given(1.0)
    }
}

/// Colour of the process noise: white, or correlated from row to row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NoiseColour {
    /// Correlated if the residuals of the model are.
    #[default]
    FromResiduals,
    /// It does not.
    White,
    /// It does, by an autoregression of the residuals.
    Coloured,
}

/// Rule by which one region follows another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Switching {
    /// The region is where the state is: its probability is the mass that the state's distribution has there.
    #[default]
    State,
    /// By the transitions that were counted in training, wherever the state is.
    Transitions,
}

/// A filter for every region of a model, which exchange their estimates (interacting multiple models: Blom and
/// Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching coefficients", IEEE
/// Trans. Automatic Control 33, 1988).
///
/// The regions of a piecewise-affine model are functions of the state, and so are their transitions (as in Seah and
/// Hwang, "State estimation for stochastic linear hybrid systems with continuous-state-dependent transitions", IEEE
/// Trans. Aerospace and Electronic Systems 45, 2009). Here the hypothesis of a region is a normal distribution of which
/// only the part inside counts. A step carries its points along: those that cross a border go over to the region behind
/// it, with their moments. A measurement moves the distribution. The hypothesis becomes less probable by the factor by
/// which its part inside the region shrinks. Points are placed by the partition itself, whatever its rule.
///
/// It is immutable, and shared by all recordings; a [`Track`](super::Track) is the memory along one.
pub struct SwitchedFilter {
    pub(super) pieces: Pieces,
    /// Geometry of the states.
    pub(super) geometry: Geometry,
    /// Of every sensor: its state and its deviation.
    pub(super) sensors: Vec<(usize, Option<f64>)>,
    /// Mean and deviation of the states before the first row.
    pub(super) prior: (Vec<f64>, Vec<f64>),
    noise: Vec<StepNoise>,
    /// Autoregression of the whitened residuals, if they are correlated from row to row.
    colour: Option<Autoregression>,
    /// The steps of affine submodels, over the model's own period.
    steps: Option<Vec<StepMap>>,
    /// Points x states.
    points: Vec<f64>,
    /// Probabilities from region to region, if these switch independent of the state.
    transitions: Option<Vec<Vec<f64>>>,
    pub(super) process: ProcessFactor,
    period: f64,
}

/// Memory of the partition at points.
pub(super) type Placing = RefCell<(Points, StepperWorkspace)>;

impl SwitchedFilter {
    /// Makes the filter of a model.
    ///
    /// # Errors
    /// [`Error::Control`]: names that the model has not, numbers that cannot be, a model that looks back or has several partitions; [`Error::Filter`]; those of
    /// [`fleetfoot_dynamics::Stepper::new`].
    pub fn new(model: &Model, options: &FilterOptions) -> Result<Self, Error> {
        let pieces = Pieces::new(model)?;
        let names: Vec<&String> = pieces.states.iter().collect();
        let mut sensors = Vec::new();
        for Measured { state, deviation } in &options.measured {
            if let Some(deviation) = *deviation {
                positive("measured", state, deviation)?;
            }
            sensors.push((find("measured", "state", state, &names)?, *deviation));
        }
        if sensors.is_empty() {
            return Err(FilterError::NotMeasured { states: pieces.states.join(", ") }.into());
        }
        if let ProcessFactor::Given(factor) = options.process {
            positive("process", "it", factor)?;
        }
        let n = pieces.states.len();
        let known = |s: usize| pieces.seen[s].map_or(0.0, |[mean, _]| mean);
        let mut prior: (Vec<f64>, Vec<f64>) = ((0..n).map(known).collect(), (0..n).map(|s| pieces.size(s)).collect());
        for (name, mean, deviation) in &options.initial {
            let state = find("initial", "state", name, &names)?;
            finite("initial", name, *mean)?;
            positive("initial", name, *deviation)?;
            (prior.0[state], prior.1[state]) = (*mean, *deviation);
        }
        let colour = colour(model, &pieces, options.noise)?;
        let time = colour.as_ref().map(Autoregression::correlation_time);
        let noise = (0..pieces.regions.len())
            .map(|region| match time {
                None => white_noise(model, &pieces, region),
                Some(time) => coloured_noise(model, &pieces, region, time),
            })
            .collect::<Result<Vec<_>, _>>()?;
        let transitions = match options.switching {
            Switching::State => None,
            Switching::Transitions => Some(transitions(model, &pieces)?),
        };
        let mut geometry = pieces.whole.geometry().clone();
        let behind = colour.as_ref().map_or(0, |colour| colour.targets() * colour.order());
        geometry.shapes.extend(std::iter::repeat_n(Shape::Line, behind));
        let mut filter = Self {
            geometry,
            sensors,
            prior,
            noise,
            colour,
            steps: None,
            points: standard_points(n),
            transitions,
            process: options.process,
            period: model.step,
            pieces,
        };
        if filter.is_affine() {
            let origin = (vec![0.0; n], vec![0.0; filter.pieces.inputs.len()]);
            let step = |region| filter.linearized(region, &origin.0, &origin.1, filter.period);
            filter.steps = Some((0..filter.regions()).map(step).collect());
        }
        Ok(filter)
    }

    /// The states, in the order of estimates.
    pub fn states(&self) -> &[String] {
        &self.pieces.states
    }

    /// Columns that are given at every row.
    pub fn inputs(&self) -> &[String] {
        &self.pieces.inputs
    }

    /// The state that each sensor measures.
    pub fn measured(&self) -> impl ExactSizeIterator<Item = usize> {
        self.sensors.iter().map(|&(state, _)| state)
    }

    /// The deviation of each sensor, where it was given.
    pub fn deviations(&self) -> impl ExactSizeIterator<Item = Option<f64>> {
        self.sensors.iter().map(|&(_, deviation)| deviation)
    }

    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.pieces.regions.len()
    }

    /// The names of the regions.
    pub fn region_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.pieces.regions.iter().map(|piece| piece.name.as_str())
    }

    /// Returns true if errors of a state are taken within half a turn.
    pub fn is_angle(&self, state: usize) -> bool {
        self.geometry.shapes[state] == Shape::Circle
    }

    /// Values of some states, each rotation written as near to `mean` (states) as it can be.
    pub fn aligned(&self, states: &[usize], values: &[f64], mean: &[f64]) -> Vec<f64> {
        if self.geometry.groups.is_empty() { values.to_vec() } else { self.geometry.aligned(states, values, mean) }
    }

    /// Components of the reported errors when `states` have true values: states, and rotations of which all parts are
    /// there.
    fn components_of(&self, states: &[usize]) -> Vec<Component> {
        let there = |state: usize| states.contains(&state);
        let counts = |component: &Component| match *component {
            Component::State(state) => there(state),
            Component::Group(group) => self.geometry.groups[group].places.iter().all(|&place| there(place)),
        };
        self.geometry.components().into_iter().filter(counts).collect()
    }

    /// Degrees of freedom of errors of some states: three for a rotation all of whose parts are among them, none for
    /// one that lacks some.
    pub fn freedom(&self, states: &[usize]) -> usize {
        if self.geometry.groups.is_empty() {
            return states.len();
        }
        parts(&self.components_of(states)).last().map_or(0, |last| last.end)
    }

    /// The squared Mahalanobis distance of an estimate from true values of some states ([`Gaussian::square`]), a rotation's error being its rotation vector.
    pub fn square(&self, estimate: &Gaussian, states: &[usize], truths: &[f64]) -> f64 {
        let n = estimate.mean.len();
        let truth = |state: usize| states.iter().position(|&known| known == state).map_or(f64::NAN, |at| truths[at]);
        if self.geometry.groups.is_empty() {
            let error = |&state: &usize| self.geometry.difference(state, |s| estimate.mean[s], truth);
            return estimate.square(states, &states.iter().map(error).collect::<Vec<_>>());
        }
        let components = self.components_of(states);
        let mut errors = Vec::new();
        for component in &components {
            match *component {
                Component::State(state) => errors.push(self.geometry.difference(state, |s| estimate.mean[s], truth)),
                Component::Group(group) => {
                    errors.extend(self.geometry.groups[group].rotation(|s| estimate.mean[s], truth));
                }
            }
        }
        let packed_entries =
            self.geometry.covariance(&components, |i, j| estimate.covariance[i * n + j], |s| estimate.mean[s]);
        let d = errors.len();
        let covariance = (0..d * d).map(|at| packed_entries[packed(at / d, at % d)]).collect();
        let apart = Gaussian { mean: vec![0.0; d], covariance };
        apart.square(&(0..d).collect::<Vec<_>>(), &errors)
    }

    /// Measurements of the sensors, written as near to a mean as possible.
    pub(super) fn aligned_sensors(&self, measured: &[f64], mean: &[f64]) -> Vec<f64> {
        self.aligned(&self.sensors.iter().map(|&(state, _)| state).collect::<Vec<_>>(), measured, mean)
    }

    /// The mean and the deviation of a state before anything is measured.
    pub fn prior(&self, state: usize) -> [f64; 2] {
        [self.prior.0[state], self.prior.1[state]]
    }

    /// Returns true if the training mean of a state is known, as a start before it is measured.
    pub fn has_mean(&self, state: usize) -> bool {
        self.pieces.seen[state].is_some()
    }

    /// The steps of the regions over the model's period, their noise without the factor, if every submodel is affine.
    /// Else they are linearised about the present mean, step by step.
    pub fn steps(&self) -> Option<&[StepMap]> {
        self.steps.as_deref()
    }

    /// The autoregression of whitened residuals in the process noise; `None` if it is white.
    pub fn colour(&self) -> Option<&Autoregression> {
        self.colour.as_ref()
    }

    /// Points that stand for the standard normal distribution (points x states).
    pub fn points(&self) -> &[f64] {
        &self.points
    }

    /// Probabilities from region to region, where these do not follow from the state.
    pub fn transitions(&self) -> Option<&[Vec<f64>]> {
        self.transitions.as_deref()
    }

    /// Seconds of a step of the model.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// The numbers of the filter, of which code is made; `None` where a submodel is not affine or a sensor has no deviation. A factor on the
    /// process noise that is to be found is 1.
    pub fn tables(&self) -> Option<FilterTables> {
        let steps = self.steps.as_ref()?;
        let factor = if let ProcessFactor::Given(factor) = self.process { factor } else { 1.0 };
        let all = |of: &dyn Fn(&StepMap) -> Vec<f64>| steps.iter().map(of).collect();
        Some(FilterTables {
            states: self.states().to_vec(),
            angles: (0..self.states().len()).map(|state| self.is_angle(state)).collect(),
            inputs: self.inputs().to_vec(),
            regions: self.region_names().map(str::to_owned).collect(),
            a: all(&|step| step.a.clone()),
            b: all(&|step| step.b.clone()),
            c: all(&|step| step.c.clone()),
            q: all(&|step| step.q.iter().map(|entry| factor * entry).collect()),
            colour: self.colour.as_ref().map(|colour| FilterColour {
                s: all(&|step| step.s.iter().map(|entry| factor.sqrt() * entry).collect()),
                coefficients: colour.coefficients.clone(),
                innovation: colour.innovation.clone(),
                stationary: colour.stationary.clone(),
            }),
            sensors: self.sensors.iter().map(|&(state, variance)| Some((state, variance?))).collect::<Option<_>>()?,
            prior: (0..self.states().len()).map(|state| self.prior(state)).collect(),
            points: self.points.clone(),
            transitions: self.transitions.clone(),
            regions_read_inputs: self.regions_read_inputs(),
            period: self.period,
        })
    }

    /// Memory of [`Self::place`].
    pub(super) fn placing(&self) -> Placing {
        RefCell::new((self.pieces.whole.points(self.points.len() / self.states().len()), StepperWorkspace::default()))
    }

    /// The points of a distribution, as offsets from its mean (points x states).
    pub(super) fn offsets(&self, state: &Gaussian) -> Vec<f64> {
        let n = self.states().len();
        let lower = state.factor(n);
        let mut offsets = vec![0.0; self.points.len()];
        for (offset, point) in offsets.chunks_exact_mut(n).zip(self.points.chunks_exact(n)) {
            for s in 0..n {
                for k in 0..=s {
                    offset[s] += lower[s * n + k] * point[k];
                }
            }
        }
        offsets
    }

    /// The region of every point; `None` where none holds.
    pub(super) fn place(&self, mean: &[f64], offsets: &[f64], inputs: &[f64], placing: &Placing) -> Vec<Option<usize>> {
        let n = self.states().len();
        let (points, workspace) = &mut *placing.borrow_mut();
        for s in 0..n {
            let column = points.column_mut(self.pieces.whole.state_column(s), 0);
            for (value, offset) in column.iter_mut().zip(offsets.chunks_exact(n)) {
                let moved = mean[s] + offset[s];
                *value = self.geometry.wrapped(s, moved);
            }
        }
        for (i, &input) in inputs.iter().enumerate() {
            points.column_mut(self.pieces.whole.input_column(i), 0).fill(input);
        }
        self.pieces.whole.evaluate(points, workspace);
        let regions = self.pieces.whole.regions(workspace).iter();
        regions.map(|&region| Some(region as usize).filter(|&region| region < self.regions())).collect()
    }

    /// Returns true if the partition reads inputs.
    pub(super) fn regions_read_inputs(&self) -> bool {
        let Some(partition) = self.pieces.partition else { return false };
        let columns = &self.pieces.whole.model().partitions[partition].columns;
        columns
            .iter()
            .any(|column| column.columns().iter().any(|name| self.inputs().iter().any(|input| **input == **name)))
    }

    /// Returns true if regions follow from the state.
    pub(super) fn by_state(&self) -> bool {
        self.transitions.is_none() && self.regions() > 1
    }

    /// The step of a region about a mean.
    fn region_step(&self, region: usize, mean: &[f64], inputs: &[f64], seconds: f64) -> StepMap {
        match &self.steps {
            Some(steps) if self.is_model_period(seconds) => steps[region].clone(),
            _ => self.linearized(region, mean, inputs, seconds),
        }
    }

    /// A distribution one step on, in a region.
    pub(super) fn stepped(
        &self,
        region: usize,
        state: &Gaussian,
        inputs: &[f64],
        seconds: f64,
        factor: f64,
    ) -> Gaussian {
        let step = self.region_step(region, &state.mean[..self.states().len()], inputs, seconds);
        match &self.colour {
            None => state.predicted(&step, inputs, factor, &self.geometry),
            Some(colour) => state.coloured(&step, inputs, factor, colour, &self.geometry),
        }
    }

    /// Returns true if a step has the model's period; steps of discrete models always have.
    fn is_model_period(&self, seconds: f64) -> bool {
        !self.pieces.continuous || (seconds / self.period - 1.0).abs() <= SAME_STEP
    }

    /// Steps that lead to a row so many seconds later: as many as there are periods, where rows between are missing.
    pub(super) fn steps_over(&self, seconds: f64) -> usize {
        let periods = (seconds / self.period).round();
        if !periods.is_finite() { 1 } else { periods.clamp(1.0, MOST_MISSING) as usize }
    }

    fn linearized(&self, region: usize, mean: &[f64], inputs: &[f64], seconds: f64) -> StepMap {
        let affine = self.pieces.regions[region].linearized(mean, inputs);
        match self.pieces.continuous {
            true => StepMap::continuous(&affine, &self.noise[region], seconds),
            false => StepMap::discrete(&affine, &self.noise[region]),
        }
    }

    /// Returns true if every submodel has the same slopes at all points.
    fn is_affine(&self) -> bool {
        let (n, all) = (self.states().len(), self.states().len() + self.inputs().len());
        let point = |turn: usize| -> Vec<f64> {
            let of = |v: usize| {
                let [mean, _] = self.pieces.seen[v].unwrap_or([0.0, 1.0]);
                // Anywhere: no two coordinates alike, and none of them special.
                mean + self.pieces.size(v) * (1.3 * turn as f64 + 0.7 * v as f64 + 0.1).sin() * turn as f64
            };
            (0..all).map(of).collect()
        };
        self.pieces.regions.iter().all(|piece| {
            let slopes = |at: &[f64]| piece.linearized(&at[..n], &at[n..]);
            let first = slopes(&vec![0.0; all]);
            let largest = |m: &Mat<f64>| m.col_iter().flat_map(|c| c.iter()).fold(0.0f64, |a, v| a.max(v.abs()));
            let size = largest(&first.a).max(largest(&first.b));
            let finite = size.is_finite() && first.c.iter().all(|value| value.is_finite());
            finite
                && (0..3).all(|turn| {
                    let other = slopes(&point(turn));
                    let off = largest(&(&other.a - &first.a)).max(largest(&(&other.b - &first.b)));
                    off <= SAME_SLOPE * size
                })
        })
    }

    /// Regions that are probable enough to count, with their shares of one.
    pub(super) fn likely(&self, probabilities: &mut [f64]) {
        probabilities.iter_mut().filter(|probability| **probability < LEAST).for_each(|probability| *probability = 0.0);
        let all: f64 = probabilities.iter().sum();
        probabilities.iter_mut().for_each(|probability| *probability /= all);
    }
}

/// The autoregression of the residuals, on request and if there is one.
fn colour(model: &Model, pieces: &Pieces, colour_choice: NoiseColour) -> Result<Option<Autoregression>, FilterError> {
    let known = described(model, pieces).and_then(|(partition, _)| partition.correlation.as_ref());
    let autoregression = || {
        let known = known.filter(|colour| colour.targets() == model.fitted().count())?;
        Autoregression::yule_walker(&known.autocovariances(), known.targets())
    };
    match colour_choice {
        NoiseColour::White => Ok(None),
        NoiseColour::FromResiduals => Ok(autoregression()),
        NoiseColour::Coloured => autoregression().map(Some).ok_or(FilterError::NoCorrelation),
    }
}

/// Refuses a value that is not a positive number.
fn positive(of: &'static str, name: &str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    let allowed = "a positive number";
    Err(ControlError::Value { of, name: name.to_owned(), value, allowed }.into())
}

/// Probabilities from region to region by the counts of the training, with a share of all alike.
fn transitions(model: &Model, pieces: &Pieces) -> Result<Vec<Vec<f64>>, FilterError> {
    let count = pieces.regions.len();
    if count == 1 {
        return Ok(vec![vec![1.0]]);
    }
    let counted = pieces.partition.and_then(|index| model.partitions[index].transitions.as_ref());
    let counted = counted.ok_or(FilterError::NoTransitions)?;
    let alike = 1.0 / count as f64;
    let share = |from: usize, to: usize| {
        let counted_share = counted.probability(from, to);
        if counted_share.is_finite() { (1.0 - FLOOR) * counted_share + FLOOR * alike } else { alike }
    };
    Ok((0..count).map(|from| (0..count).map(|to| share(from, to)).collect()).collect())
}
