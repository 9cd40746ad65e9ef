//! A model compiled to run free: states advanced by the equations, what follows from them computed, everything else taken from a recording.

use std::sync::Arc;

use fleetfoot_data::{Block, Halo, Progress, Source, nearest, packed, parallel_map};
use fleetfoot_library::{Expr, Leaf, UnknownColumn};
use fleetfoot_model::{Closed, Equation, Model, Role};

use crate::{
    Error, Method, Start, Step, Trajectory,
    affine::AffineKernel,
    angle::wrap,
    compiled::{Compiled, Latents},
    controller::{Controller, Driver},
    integrate::{Advance, typical_period},
    kernel::padded,
    window::{Window, read_windows},
};

/// Starts that one piece of parallel work simulates. A constant: results do not depend on it, only the memory in flight does.
pub(crate) const GROUP: usize = 32;

/// How to roll out.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RolloutOptions {
    /// Steps ahead, one a row.
    pub horizon: usize,
    /// How derivatives are integrated.
    pub method: Method,
    /// How long a step is.
    pub step: Step,
    /// A state this many training standard deviations away from where it started has diverged.
    pub divergence: f64,
    /// What becomes of a trajectory that leaves the training domain.
    pub outside: Outside,
    /// States whose Euclidean distance from the recording is told too; they share a unit.
    pub position: Vec<String>,
    /// Whether [`crate::rollout`] keeps the trajectories.
    pub keep: bool,
}

/// What becomes of a trajectory where a regressor is outside the range that its region saw in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outside {
    /// It goes on, and tells when it left ([`Trajectory::left_domain`]).
    #[default]
    Tell,
    /// It ends there.
    End,
    /// It goes on with the regressor held at the border of the range: an affine map is not followed to where nothing was seen. What is given instead of
    /// fitted, and the region, see the state itself.
    Hold,
}

impl RolloutOptions {
    /// Euler steps of the episode's median period, divergence at 1,000 standard deviations, leaving the training domain told, trajectories not kept.
    pub fn new(horizon: usize) -> Self {
        let (method, step, outside) = (Method::Euler, Step::Median, Outside::Tell);
        Self { horizon, method, step, divergence: 1e3, outside, position: Vec::new(), keep: false }
    }

    pub(crate) fn validate(&self) -> Result<(), Error> {
        match self.step {
            _ if self.horizon == 0 => Err(Error::NoHorizon),
            Step::Seconds(seconds) if !(seconds.is_finite() && seconds > 0.0) => Err(Error::BadStep(seconds)),
            _ => Ok(()),
        }
    }
}

/// A model compiled for rollouts.
///
/// Columns that follow from simulated states and from inputs are computed ([`Model::closed`]); of the recording it reads what is left
/// ([`Simulator::replayed`]), and the rows up to a start.
pub struct Simulator {
    /// As it was given.
    pub(crate) model: Model,
    /// Seconds of the steps that delays are counted in.
    pub(crate) period: f64,
    pub(crate) columns: Vec<String>,
    /// The states that equations advance, then the first-order lags of what is computed.
    pub(crate) states: Vec<State>,
    /// Columns that are computed, over the others.
    pub(crate) computed: Vec<(String, Expr)>,
    pub(crate) compiled: Compiled,
    /// Of every group of latents that has statistics.
    pub(crate) ranges: Vec<Ranges>,
    /// Index among the compiled partitions of the one whose regions are reported.
    pub(crate) reported: usize,
    /// Columns that are recorded and used, with the lags at which they are used: `(column, most, least)`.
    pub(crate) recorded: Vec<(usize, i32, i32)>,
    history: usize,
    ahead: usize,
    kernel: Option<AffineKernel>,
    pub(crate) driver: Option<Driver>,
    names: Vec<String>,
}

/// A state that an equation advances.
pub(crate) struct State {
    pub(crate) column: usize,
    pub(crate) advance: Advance,
    /// Standard deviation in training; NaN where unknown.
    pub(crate) deviation: f64,
    /// Index among the columns with role State, if it is one.
    pub(crate) order: Option<usize>,
}

/// Ranges of the regressors in use, per region.
pub(crate) struct Ranges {
    /// Index of the latents' group.
    pub(crate) group: usize,
    pub(crate) width: usize,
    pub(crate) low: Vec<f64>,
    pub(crate) high: Vec<f64>,
}

impl Ranges {
    /// Puts what is outside of a region's range on its border; what is not a number stays so.
    #[inline(always)]
    pub(crate) fn hold(&self, region: usize, functions: &mut [f64]) {
        let own = region * self.width..(region + 1) * self.width;
        for ((value, &low), &high) in functions.iter_mut().zip(&self.low[own.clone()]).zip(&self.high[own]) {
            if *value < low {
                *value = low;
            } else if *value > high {
                *value = high;
            }
        }
    }
}

impl Simulator {
    /// Compiles the equations that advance a state, for steps of the model's sampling period.
    ///
    /// # Errors
    /// [`Error::NothingToAdvance`], [`Error::Contradiction`], [`Error::FutureState`], [`Error::Closed`], [`Error::LaggedLatent`],
    /// [`Error::UnknownColumn`], [`Error::Inconsistent`].
    pub fn new(model: &Model) -> Result<Self, Error> {
        Self::compile(model, model.step, &[])
    }

    /// [`Simulator::new`] for steps of a recording: of delays inside of the model they are so many (of first-order lags the steps are those made).
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn for_source(model: &Model, source: &dyn Source, step: Step) -> Result<Self, Error> {
        let period = match step {
            Step::Seconds(seconds) => seconds,
            Step::Median | Step::Stamps => typical_period(source).unwrap_or(model.step),
        };
        Self::compile(model, period, &[])
    }

    /// Compiles for steps of `period` seconds; the columns in `driven` are computed by a controller.
    fn compile(own: &Model, period: f64, driven: &[String]) -> Result<Self, Error> {
        own.validate().map_err(Error::Inconsistent)?;
        let Closed { model, lags, computed, .. } = &own.closed(period, driven)?;
        let (mut states, mut equations) = advanced_states(model)?;
        let names = states.iter().map(|state| model.columns[state.column].name.clone()).collect();
        states.extend(lags.iter().map(|lag| State {
            column: lag.column,
            advance: Advance::lag(lag.constant),
            deviation: f64::NAN,
            order: None,
        }));
        equations.extend(lags.iter().map(|lag| &lag.equation));
        let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let compiled = Compiled::new(model, &columns, &equations, None)?;
        let ranges = (0..compiled.groups.len()).filter_map(|group| ranges(model, &compiled, group)).collect();
        let first = model.latents.first().and_then(|latent| {
            let partition = |group: &Latents| compiled.partitions[group.regions].partition;
            compiled.groups.iter().find(|group| group.library == latent.library && partition(group) == latent.partition)
        });
        let reported = first.map_or(0, |group| group.regions);
        let mut simulator = Self {
            model: own.clone(),
            period,
            columns: model.columns.iter().map(|column| column.name.clone()).collect(),
            names,
            computed: computed.clone(),
            recorded: Vec::new(),
            history: 0,
            ahead: 0,
            kernel: None,
            driver: None,
            ranges,
            reported,
            states,
            compiled,
        };
        simulator.find_reach()?;
        simulator.kernel = AffineKernel::new(model, &simulator, &equations);
        Ok(simulator)
    }

    /// How far back and ahead the equations look.
    fn find_reach(&mut self) -> Result<(), Error> {
        let count = self.columns.len();
        let mut reach: Vec<Option<(i32, i32)>> = vec![None; count];
        for leaf in self.compiled.functions.leaves().iter().chain(self.compiled.rights.leaves()) {
            let (column, lag) = match *leaf {
                Leaf::Column { column, lag } if column < count => (Some(column), lag),
                Leaf::Column { .. } => continue,
                Leaf::Time { lag } => (None, lag),
            };
            self.history = self.history.max(usize::try_from(lag).unwrap_or(0));
            self.ahead = self.ahead.max(usize::try_from(-i64::from(lag)).unwrap_or(0));
            let Some(column) = column else { continue };
            if lag < 0 && self.states.iter().any(|state| state.column == column) {
                return Err(Error::FutureState { state: self.columns[column].clone(), ahead: lag.saturating_neg() });
            }
            let (most, least) = reach[column].unwrap_or((lag, lag));
            reach[column] = Some((most.max(lag), least.min(lag)));
        }
        let advanced = |column: usize| self.states.iter().any(|state| state.column == column);
        self.recorded = (0..count)
            .filter(|&column| !advanced(column))
            .filter_map(|column| reach[column].map(|(most, least)| (column, most, least)))
            .collect();
        Ok(())
    }

    /// Forces the path that evaluates any expression, also where the faster one for affine models would do. The results are the same.
    pub fn general(mut self) -> Self {
        self.kernel = None;
        self
    }

    /// Closes the loop: inputs come from a controller that sees the simulated states, instead of from the recording.
    ///
    /// A driven input is taken from the recording up to the start, where lagged terms and latencies reach back to it.
    ///
    /// # Errors
    /// [`Error::Parameter`]; [`Error::Controller`] for columns that the model does not have, that are advanced states, or that the controller also
    /// reads; [`Error::FutureState`] where the model looks ahead at a driven input.
    pub fn driven_by(self, controller: Arc<dyn Controller>) -> Result<Self, Error> {
        let mut simulator = Self::compile(&self.model, self.period, &controller.drives())?;
        if self.kernel.is_none() {
            simulator.kernel = None;
        }
        simulator.driver = Some(Driver::bind(controller, &mut simulator)?);
        Ok(simulator)
    }

    /// Inputs that a controller drives, in the order of [`Trajectory::inputs`].
    pub fn driven_inputs(&self) -> &[String] {
        self.driver.as_ref().map_or(&[], |driver| &driver.names)
    }

    /// Whether the model runs on the fast path for piecewise-affine models.
    pub fn is_affine(&self) -> bool {
        self.kernel.is_some()
    }

    /// The states that are advanced, in the order of the model's columns.
    pub fn states(&self) -> &[String] {
        &self.names
    }

    /// The states that are told, in the order of [`Simulator::states`]; lags come behind them.
    pub(crate) fn shown(&self) -> &[State] {
        &self.states[..self.names.len()]
    }

    /// Columns whose values after a start come from the recording, in the order of the model's columns: inputs that nothing drives, states without an
    /// equation, whatever else does not follow from what is simulated.
    pub fn replayed(&self) -> Vec<String> {
        let mut columns: Vec<usize> = self.recorded.iter().map(|&(column, ..)| column).collect();
        columns.sort_unstable();
        columns.into_iter().map(|column| self.columns[column].clone()).collect()
    }

    /// Rows needed before and after a start for a rollout of `horizon` steps.
    ///
    /// At least one row before: the constant-velocity baseline looks at it.
    pub fn needed_rows(&self, horizon: usize) -> Halo {
        Halo { before: self.history.max(1), after: horizon.max((horizon + self.ahead).saturating_sub(1)) }
    }

    pub(crate) fn history(&self) -> usize {
        self.history
    }

    pub(crate) fn ahead(&self) -> usize {
        self.ahead
    }

    /// Rolls the model out from every start; `None` for a start whose rows have missing values.
    ///
    /// The source's columns are the model's, in any order. Same bits on any number of threads and for any grouping of starts.
    ///
    /// # Errors
    /// Of reading, of a start that does not fit ([`Starts::choose`](crate::Starts::choose) gives such that do), and of the options.
    pub fn trajectories(
        &self,
        source: &dyn Source,
        starts: &[Start],
        options: &RolloutOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Option<Trajectory>>, Error> {
        options.validate()?;
        let needed = self.needed_rows(options.horizon);
        let starts = crate::Starts::At(starts.to_vec()).choose(source, options.horizon, needed.before, needed.after)?;
        let map = self.column_map(source)?;
        let groups = parallel_map(starts.len().div_ceil(GROUP), progress, |group| -> Result<_, Error> {
            let starts = &starts[group * GROUP..((group + 1) * GROUP).min(starts.len())];
            let blocks = read_windows(source, starts, needed)?;
            let windows: Vec<Window<'_>> = blocks.windows(starts, &map);
            let usable: Vec<bool> = windows.iter().map(|window| self.is_complete(window, options.horizon)).collect();
            let chosen: Vec<&Window<'_>> = windows.iter().zip(&usable).filter(|(_, ok)| **ok).map(|(w, _)| w).collect();
            let mut done = self.simulate(source, &chosen, options).into_iter();
            Ok(usable.iter().map(|&ok| if ok { done.next() } else { None }).collect::<Vec<_>>())
        })?;
        Ok(groups.into_iter().flatten().collect())
    }

    /// Simulates complete windows.
    pub(crate) fn simulate(
        &self,
        source: &dyn Source,
        windows: &[&Window<'_>],
        options: &RolloutOptions,
    ) -> Vec<Trajectory> {
        let runs: Vec<Run<'_>> = windows.iter().map(|window| Run::new(source, window, options)).collect();
        match &self.kernel {
            // The kernel's slots are not held.
            Some(kernel) if options.outside != Outside::Hold => kernel.simulate(self, &runs, options.method),
            _ => crate::general::simulate(self, &runs, options),
        }
    }

    /// Seconds from a start after each step, horizon + 1 values.
    pub(crate) fn times(&self, source: &dyn Source, window: &Window<'_>, options: &RolloutOptions) -> Vec<f64> {
        Run::new(source, window, options).time
    }

    /// The source's index of each column of the model; of a column that neither a state nor an equation needs, `usize::MAX` if absent.
    pub(crate) fn column_map(&self, source: &dyn Source) -> Result<Vec<usize>, Error> {
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let needed = |column: usize| {
            self.states.iter().any(|state| state.column == column)
                || self.recorded.iter().any(|r| r.0 == column)
                || self.driver.as_ref().is_some_and(|driver| driver.drives.iter().any(|d| d.0 == column))
        };
        let mut map = Vec::with_capacity(self.columns.len());
        for (column, name) in self.columns.iter().enumerate() {
            match names.iter().position(|known| known == name) {
                Some(index) => map.push(index),
                None if !needed(column) => map.push(usize::MAX),
                None => {
                    let nearest = nearest(name, names.iter().copied());
                    return Err(UnknownColumn { name: name.clone(), nearest }.into());
                }
            }
        }
        Ok(map)
    }

    /// Whether everything that a rollout reads is finite.
    pub(crate) fn is_complete(&self, window: &Window<'_>, horizon: usize) -> bool {
        let back = self.history.max(1) as i64;
        let finite = |column: usize, from: i64, to: i64| window.values(column, from, to).iter().all(|v| v.is_finite());
        self.states.iter().all(|state| finite(state.column, -back, 1))
            && self
                .recorded
                .iter()
                .all(|&(column, most, least)| finite(column, -i64::from(most), horizon as i64 - i64::from(least)))
            && self.driver.as_ref().is_none_or(|driver| driver.is_complete(window))
    }
}

/// A state whose standard deviation in training is this share of its value did not move: what is left is rounding.
const STILL: f64 = 1e-9;

impl State {
    /// How far from its start the state may go. A state that did not move in training does not say what is far.
    pub(crate) fn limit(&self, divergence: f64, start: f64) -> f64 {
        let limit = divergence * self.deviation;
        let moved = self.deviation > STILL * start.abs();
        if moved && limit > 0.0 && limit.is_finite() && !self.advance.angle { limit } else { f64::MAX }
    }
}

/// One rollout to be done: its window, and the time of its steps.
pub(crate) struct Run<'a> {
    pub(crate) window: &'a Window<'a>,
    /// Seconds from the start, horizon + 1 values.
    pub(crate) time: Vec<f64>,
    pub(crate) start: Start,
    pub(crate) horizon: usize,
    /// [`RolloutOptions::divergence`].
    pub(crate) divergence: f64,
    /// Whether it ends where it leaves the training domain.
    pub(crate) ends_outside: bool,
    /// The states where it begins, in the order of [`Simulator::states`]; the recorded ones where none are given.
    pub(crate) beginning: Option<&'a [f64]>,
    /// Of every state, the share of what its measurement differs by that it is moved by before the next step: a filter of constant gain. None for a simulation that
    /// sees no measurement.
    pub(crate) gains: &'a [f64],
    /// Whether all steps are `time[1]` long.
    uniform: bool,
}

impl<'a> Run<'a> {
    pub(crate) fn new(source: &dyn Source, window: &'a Window<'a>, options: &RolloutOptions) -> Self {
        let start = window.start;
        let uniform = |seconds: f64| (0..=options.horizon).map(|k| k as f64 * seconds).collect();
        let time = match options.step {
            Step::Seconds(seconds) => uniform(seconds),
            Step::Median => uniform(source.episodes()[start.episode].period),
            Step::Stamps => {
                let stamps: &[i64] = &window.block.time[window.at..];
                stamps[..=options.horizon].iter().map(|&stamp| (stamp - stamps[0]) as f64 * 1e-9).collect()
            }
        };
        let uniform = options.step != Step::Stamps;
        let (horizon, divergence, ends_outside) =
            (options.horizon, options.divergence, options.outside == Outside::End);
        Self { window, time, start, horizon, divergence, ends_outside, beginning: None, gains: &[], uniform }
    }

    /// Length of a step, seconds.
    #[inline(always)]
    pub(crate) fn step(&self, k: usize) -> f64 {
        // A uniform step is not a difference of rounded products.
        if self.uniform { self.time[1] } else { self.time[k + 1] - self.time[k] }
    }

    /// Measured less simulated, of a state at a step; NaN where nothing was measured. That of an angle is in (-pi, pi].
    pub(crate) fn error(&self, state: &State, step: usize, simulated: f64) -> f64 {
        let error = self.window.values(state.column, step as i64, step as i64 + 1)[0] - simulated;
        if state.advance.angle { wrap(error) } else { error }
    }

    /// The state from which the next step is made: what was simulated, moved towards its measurement where there are gains, and a measurement.
    pub(crate) fn corrected(&self, (place, state): (usize, &State), step: usize, simulated: f64) -> f64 {
        let Some(&gain) = self.gains.get(place) else { return simulated };
        let error = self.error(state, step, simulated);
        if error.is_finite() { gain.mul_add(error, simulated) } else { simulated }
    }

    pub(crate) fn block(&self) -> &Block {
        self.window.block
    }
}

/// Index of a column among those with role State, if it is one.
fn state_order(model: &Model, column: usize) -> Option<usize> {
    let is_state = |column: &usize| model.columns[*column].role == Role::State;
    is_state(&column).then(|| (0..column).filter(is_state).count())
}

/// Standard deviation of a state in training; NaN where it is not known.
pub(crate) fn training_deviation(model: &Model, column: usize) -> f64 {
    let variance = state_order(model, column).and_then(|i| model.training.state_covariance.get(packed(i, i)));
    variance.map_or(f64::NAN, |variance| variance.sqrt())
}

/// The states that equations advance, in the order of the columns, and their equations.
pub(crate) fn advanced_states(model: &Model) -> Result<(Vec<State>, Vec<&Equation>), Error> {
    let (mut states, mut equations) = (Vec::new(), Vec::new());
    for (index, column) in model.columns.iter().enumerate() {
        let mut own = model.equations.iter().filter_map(|equation| {
            let advance = Advance::new(equation.prediction, column.angle)?;
            (equation.subject == column.name).then_some((equation, advance))
        });
        let Some((equation, advance)) = own.next() else {
            continue;
        };
        if own.next().is_some() {
            return Err(Error::Contradiction { state: column.name.clone() });
        }
        let (order, deviation) = (state_order(model, index), training_deviation(model, index));
        states.push(State { column: index, advance, deviation, order });
        equations.push(equation);
    }
    if states.is_empty() {
        let equations = model.equations.iter().map(Equation::label).collect::<Vec<_>>().join(", ");
        return Err(Error::NothingToAdvance { equations });
    }
    Ok((states, equations))
}

/// The ranges of the regressors of a group of latents; `None` where its partition has no statistics of them.
fn ranges(model: &Model, compiled: &Compiled, group: usize) -> Option<Ranges> {
    let partition = compiled.partitions[compiled.groups[group].regions].partition;
    let functions = model.libraries[compiled.groups[group].library].len();
    if model.partitions[partition].regions.iter().any(|region| region.range.len() != functions) {
        return None;
    }
    let kept = &compiled.groups[group].kept;
    let width = padded(kept.len());
    let bounds = |end: usize, pad: f64| -> Vec<f64> {
        let regions = &model.partitions[partition].regions;
        regions
            .iter()
            .flat_map(|region| {
                kept.iter().map(|&j| region.range[j][end]).chain(std::iter::repeat(pad)).take(width).collect::<Vec<_>>()
            })
            .collect()
    };
    Some(Ranges { group, width, low: bounds(0, f64::NEG_INFINITY), high: bounds(1, f64::INFINITY) })
}
