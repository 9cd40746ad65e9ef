//! Forward sensitivities: how a trajectory of a model moves with the model's coefficients.
//!
//! The tangent S_k = d x_k / d theta of the states after k steps follows the trajectory of the simulator, by the
//! derivatives of the very step that made it. For a step x_{k+1} = factor x_k + gain f(x_k, x_{k-1}, ..., theta),
//!
//! ```text
//! S_{k+1} = factor S_k + gain (sum_l df/dx_{k-l} S_{k-l} + df/dtheta),    S_k = 0 for k <= 0
//! ```
//!
//! and stage by stage for the Runge-Kutta method. A filter of gains K, x_k+ = x_k + K (y_k - x_k), steps from x_k+ and
//! its tangents, S_k+ = (I - K) S_k. The derivative by a gain adds its error, (y_k - x_k)_i. Regions are those of the
//! trajectory: within them the model is smooth, and the effect of crossing a border a little earlier is left out.

use std::collections::HashMap;

use fleetfoot_library::Leaf;
use fleetfoot_model::{Closed, Equation, Model};

use crate::{
    Error, Method, Simulator, Trajectory,
    compiled::{Latents, Workspace},
    geometry::Group,
    kernel::padded,
    recursion::{NONE, Places, Recursion, Stage},
    run::Run,
    slopes::{Reading, Slopes},
    state::{State, advanced_states},
    window::Window,
};

/// A fitted number of a model: a coefficient, or a constant, of a latent in one region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Coefficient {
    /// The region, of the latent's partition.
    pub region: usize,
    /// Index of the latent.
    pub latent: usize,
    /// Index of the feature of the latent: a function of its library, or behind those one of its basis; `None` for the constant.
    pub function: Option<usize>,
}

impl Coefficient {
    /// The numbers of a model that are not zero, by region.
    pub fn support(model: &Model) -> Vec<Self> {
        let mut support = Self::all(model);
        support.retain(|coefficient| coefficient.value(model) != 0.0);
        support
    }

    /// The numbers of a model, by region.
    pub fn all(model: &Model) -> Vec<Self> {
        let mut coefficients = Vec::new();
        for (latent, latent_map) in model.latents.iter().enumerate() {
            for region in 0..latent_map.map.regions() {
                coefficients.push(Self { region, latent, function: None });
                coefficients.extend((0..latent_map.map.features()).map(|j| Self { region, latent, function: Some(j) }));
            }
        }
        coefficients.sort_unstable();
        coefficients
    }

    /// Its value in a model.
    pub fn value(self, model: &Model) -> f64 {
        let map = &model.latents[self.latent].map;
        self.function.map_or_else(|| map.constant(self.region), |j| map.coefficient(self.region, j))
    }

    /// Gives it a value in a model.
    pub fn set(self, model: &mut Model, value: f64) {
        model.latents[self.latent].map.set(self.region, self.function, value);
    }
}

/// The derivatives that tangents are made of, compiled for a simulator.
pub(crate) struct Sensitivity {
    slopes: Slopes,
    pub(crate) places: Places,
}

/// The tangents of one trajectory.
pub(crate) struct Tangents {
    /// Numbers of the coefficients that it met, ascending.
    pub(crate) active: Vec<usize>,
    /// The gains: the states where the run has some, else 0.
    gains: usize,
    /// Active coefficients, gains and, where the beginning may move, the states, padded.
    pub(crate) width: usize,
    /// (steps + 1) x states x width.
    pub(crate) values: Vec<f64>,
}

impl Tangents {
    /// The tangents of a state after so many steps.
    pub(crate) fn of(&self, step: usize, state: usize, states: usize) -> &[f64] {
        &self.values[(step * states + state) * self.width..][..self.active.len()]
    }

    /// Derivatives of a state by the gains after `step` steps; empty if the run has no gains.
    pub(crate) fn by_gains(&self, step: usize, state: usize, states: usize) -> &[f64] {
        &self.values[(step * states + state) * self.width + self.active.len()..][..self.gains]
    }

    /// Derivatives of a state by the states at the beginning, after `step` steps; for tangents made with them.
    pub(crate) fn by_beginning(&self, step: usize, state: usize, states: usize) -> &[f64] {
        &self.values[(step * states + state) * self.width + self.active.len() + self.gains..][..states]
    }
}

impl Sensitivity {
    /// Differentiates a simulator's equations with respect to its states and to `coefficients`.
    ///
    /// # Errors
    /// [`Error::SimulatedLag`] for a model that reads first-order lags of simulated values.
    pub(crate) fn new(simulator: &Simulator, coefficients: &[Coefficient]) -> Result<Self, Error> {
        let Closed { model, lags, .. } = &simulator.model.closed(simulator.period, &[])?;
        if let Some(lag) = lags.first() {
            return Err(Error::SimulatedLag { column: model.columns[lag.column].name.clone() });
        }
        let (_, equations) = advanced_states(model)?;
        let readings = readings(simulator);
        let sides: Vec<Option<&Equation>> = equations.into_iter().map(Some).collect();
        let place = |column: usize| simulator.states.iter().position(|state| state.column == column).unwrap_or(0);
        let number: HashMap<Coefficient, u32> = coefficients.iter().copied().zip(0..).collect();
        let slopes = Slopes::new(model, &simulator.compiled, &sides, &readings)?;
        let places = Places {
            variables: readings.iter().map(|&(column, lag)| (place(column), lag as usize)).collect(),
            readers: slopes.readers(),
            coefficients: simulator.compiled.groups.iter().map(|group| places(group, &number)).collect(),
        };
        Ok(Self { slopes, places })
    }

    /// The tangents along a trajectory of the simulator. With `beginning`, also by the initial states (dx_0 / dx_0 =
    /// I).
    pub(crate) fn along(
        &self,
        simulator: &Simulator,
        run: &Run<'_>,
        trajectory: &Trajectory,
        method: Method,
        beginning: bool,
    ) -> Tangents {
        let path = Path::new(simulator, run, trajectory);
        let stages = self.stages(&path, run, method);
        let active = self.active(simulator, &stages);
        let mut local = vec![NONE; active.last().map_or(0, |last| last + 1)];
        active.iter().zip(0..).for_each(|(&number, at)| local[number] = at);
        let (states, gains) = (simulator.states.len(), run.gains.len());
        let width = padded(active.len() + gains + if beginning { states } else { 0 });
        let mut values = vec![0.0; (trajectory.steps() + 1) * states * width];
        if beginning {
            (0..states).for_each(|state| values[state * width + active.len() + gains + state] = 1.0);
        }
        let mut recursion = Recursion::new(&self.places, simulator, &local, (active.len(), width));
        let size = states * width;
        let mut corrected = vec![0.0; if gains > 0 { trajectory.steps() * size } else { 0 }];
        for k in 0..trajectory.steps() {
            let (past, next) = values.split_at_mut((k + 1) * size);
            let mut from = &*past;
            if gains > 0 {
                let row = &mut corrected[k * size..(k + 1) * size];
                row.copy_from_slice(&past[k * size..]);
                correct(simulator, run, (k, trajectory.state(k)), active.len(), row);
                from = &corrected[..(k + 1) * size];
            }
            recursion.step(&stages, k, run.step(k), from, &mut next[..size]);
            retract(
                &simulator.geometry.groups,
                &retractions(&path, &stages, (k, run.step(k))),
                width,
                &mut next[..size],
            );
        }
        Tangents { active, gains, width, values }
    }

    /// Evaluates the model's derivatives at all rows of a trajectory at once, stage by stage.
    pub(crate) fn stages(&self, path: &Path<'_>, run: &Run<'_>, method: Method) -> Vec<Stage> {
        let continuous = path.simulator.states.iter().any(|state| state.advance.continuous);
        let plan: &[(f64, f64)] = match method {
            Method::Rk4 if continuous => &[(0.0, 1.0 / 6.0), (0.5, 2.0 / 6.0), (0.5, 2.0 / 6.0), (1.0, 1.0 / 6.0)],
            _ => &[(0.0, 1.0)],
        };
        let mut stages: Vec<Stage> = Vec::with_capacity(plan.len());
        for &(fraction, weight) in plan {
            let offset: Vec<f64> = (0..path.rows).map(|k| fraction * run.step(k)).collect();
            let moved = stages.last().map(|before| path.moved(&offset, before));
            stages.push(self.stage(path, moved.as_deref(), offset, weight));
        }
        stages
    }

    fn stage(&self, path: &Path<'_>, moved: Option<&[Vec<f64>]>, offset: Vec<f64>, weight: f64) -> Stage {
        let compiled = &path.simulator.compiled;
        let times = path.times(&offset);
        let leaf = |leaf: Leaf| path.leaf(leaf, moved, &times);
        let mut workspace = Workspace::default();
        compiled.evaluate(path.rows, &leaf, &mut workspace);
        let slopes = self.slopes.evaluate(compiled, path.rows, &leaf, &workspace);
        Stage { slopes, workspace, offset, weight }
    }

    /// Numbers of the coefficients of the regions that were met.
    fn active(&self, simulator: &Simulator, stages: &[Stage]) -> Vec<usize> {
        let mut active = Vec::new();
        for (group, places) in simulator.compiled.groups.iter().zip(&self.places.coefficients) {
            let length = (group.features.len() + 1) * group.width;
            let mut met: Vec<u32> = stages
                .iter()
                .filter_map(|stage| stage.workspace.regions.get(group.regions))
                .flatten()
                .copied()
                .collect();
            met.sort_unstable();
            met.dedup();
            for numbers in met.iter().filter_map(|&region| places.get(region as usize * length..)?.get(..length)) {
                active.extend(numbers.iter().filter(|&&number| number != NONE).map(|&number| number as usize));
            }
        }
        active.sort_unstable();
        active
    }
}

/// Turns the tangents of the states at a step into those of the corrected ones; the gains stand behind so many coefficients.
fn correct(
    simulator: &Simulator,
    run: &Run<'_>,
    (step, simulated): (usize, &[f64]),
    coefficients: usize,
    tangents: &mut [f64],
) {
    let width = tangents.len() / simulator.states.len();
    for (s, tangent) in tangents.chunks_exact_mut(width).enumerate() {
        let error = run.error(simulator.moved(), s, step, |s| simulated[s]);
        if error.is_finite() {
            tangent.iter_mut().for_each(|value| *value *= 1.0 - run.gains[s]);
            tangent[coefficients + s] += error;
        }
    }
}

/// The derivatives of the retractions after step `k`: for every rotation a matrix by rows.
pub(crate) fn retractions(path: &Path<'_>, stages: &[Stage], (k, seconds): (usize, f64)) -> Vec<Vec<f64>> {
    let of_group = |group: &Group| {
        let made = |place: usize| {
            let slope: f64 = stages
                .iter()
                .map(|stage| {
                    let weight = if stages.len() > 1 { stage.weight } else { 1.0 };
                    weight * stage.workspace.outputs[place * stage.workspace.stride + k]
                })
                .sum();
            seconds.mul_add(slope, path.states[place][path.simulator.history() + k])
        };
        group.kind.retraction_derivative(&group.of(made))
    };
    path.simulator.geometry.groups.iter().map(of_group).collect()
}

/// Turns the tangents of a step into those of the retracted rotations.
fn retract(groups: &[Group], retractions: &[Vec<f64>], width: usize, tangents: &mut [f64]) {
    for (group, matrix) in groups.iter().zip(retractions) {
        let before: Vec<f64> =
            group.places.iter().flat_map(|&place| tangents[place * width..][..width].to_vec()).collect();
        for (row, &place) in matrix.chunks_exact(group.places.len()).zip(&group.places) {
            for (column, value) in tangents[place * width..][..width].iter_mut().enumerate() {
                *value = row.iter().enumerate().map(|(part, factor)| factor * before[part * width + column]).sum();
            }
        }
    }
}

/// The states, and the rows back, that a simulator's equations read.
fn readings(simulator: &Simulator) -> Vec<Reading> {
    let leaves = simulator.compiled.functions.leaves().iter().chain(simulator.compiled.rights.leaves());
    let of_state = |leaf: &Leaf| match *leaf {
        Leaf::Column { column, lag } if simulator.states.iter().any(|state| state.column == column) => {
            Some((column, lag))
        }
        _ => None,
    };
    let mut readings: Vec<Reading> = leaves.filter_map(of_state).collect();
    readings.sort_unstable();
    readings.dedup();
    readings
}

fn places(group: &Latents, number: &HashMap<Coefficient, u32>) -> Vec<u32> {
    let regions = group.constants.len() / group.width;
    let functions = || std::iter::once(None).chain(group.features.iter().copied().map(Some));
    let mut places = Vec::with_capacity(regions * (group.features.len() + 1) * group.width);
    for region in 0..regions {
        for function in functions() {
            let of = |&latent: &usize| number.get(&Coefficient { region, latent, function }).copied().unwrap_or(NONE);
            places.extend(group.slots.iter().map(of).chain(std::iter::repeat(NONE)).take(group.width));
        }
    }
    places
}

/// Values that the equations read at the rows of a trajectory.
pub(crate) struct Path<'a> {
    simulator: &'a Simulator,
    window: &'a Window<'a>,
    /// Rows from which a step was made.
    rows: usize,
    /// For every state, the recorded values in front of the start and those of the trajectory from which its steps were made.
    states: Vec<Vec<f64>>,
}

impl<'a> Path<'a> {
    pub(crate) fn new(simulator: &'a Simulator, run: &Run<'a>, trajectory: &Trajectory) -> Self {
        let (window, rows, back) = (run.window, trajectory.steps(), simulator.history() as i64);
        let of_state = |(place, state): (usize, &State)| {
            let before = window.values(state.column, -back, 0).iter().copied();
            let from = |k: usize| run.corrected(simulator.moved(), place, k, |s| trajectory.state(k)[s]);
            before.chain((0..rows).map(from)).collect()
        };
        Self { simulator, window, rows, states: simulator.states.iter().enumerate().map(of_state).collect() }
    }

    /// The states of a stage: those of the rows, moved by the slopes of the stage before.
    fn moved(&self, offset: &[f64], before: &Stage) -> Vec<Vec<f64>> {
        let history = self.simulator.history();
        let of_state = |(place, state): (usize, &State)| {
            let slopes = &before.workspace.outputs[place * before.workspace.stride..][..self.rows];
            let values = self.states[place][history..].iter().zip(slopes).zip(offset);
            let gain = f64::from(u8::from(state.advance.continuous));
            values.map(|((&x, &slope), &offset)| if gain == 0.0 { x } else { offset.mul_add(slope, x) }).collect()
        };
        self.simulator.states.iter().enumerate().map(of_state).collect()
    }

    /// Seconds since the start of the episode at every row, for the lags at which the equations read the clock.
    fn times(&self, offset: &[f64]) -> Vec<(i32, Vec<f64>)> {
        let compiled = &self.simulator.compiled;
        let leaves = compiled.functions.leaves().iter().chain(compiled.rights.leaves());
        let lags = leaves.filter_map(|leaf| if let Leaf::Time { lag } = *leaf { Some(lag) } else { None });
        let block = self.window.block;
        let at = |lag: i32, k: usize| {
            let stamp = block.time[(self.window.at as i64 + k as i64 - i64::from(lag)) as usize];
            (stamp - block.start) as f64 * 1e-9 + offset[k]
        };
        lags.map(|lag| (lag, (0..self.rows).map(|k| at(lag, k)).collect())).collect()
    }

    fn leaf<'b>(&'b self, leaf: Leaf, moved: Option<&'b [Vec<f64>]>, times: &'b [(i32, Vec<f64>)]) -> &'b [f64] {
        match leaf {
            // A derivative reads the clock where the expression does.
            Leaf::Time { lag } => times.iter().find(|(known, _)| *known == lag).map_or(&[], |(_, times)| times),
            Leaf::Column { column, lag } => {
                let state = self.simulator.states.iter().position(|state| state.column == column);
                match (state, moved) {
                    (Some(state), Some(moved)) if lag == 0 => &moved[state],
                    (Some(state), _) => {
                        &self.states[state][self.simulator.history() - lag.unsigned_abs() as usize..][..self.rows]
                    }
                    (None, _) => self.window.values(column, -i64::from(lag), self.rows as i64 - i64::from(lag)),
                }
            }
        }
    }
}
