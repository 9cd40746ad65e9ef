//! Multiple shooting: a recording cut into segments, each simulated from its measured beginning, with the errors' derivatives by the model's coefficients.
//!
//! The segments of an episode follow each other without gaps. The residuals of a segment of N steps, over the advanced
//! states s and the steps k, are
//!
//! ```text
//! r_ks = (y_ks - x_ks(theta)) / (sigma_s sqrt(N))
//! ```
//!
//! with sigma the standard deviation of the state in training: the units in which rollouts are scored. Every step of the horizon weighs the same.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_model::Model;

use crate::{
    Coefficient, End, Error, Method, NormalBlocks, Products, RolloutOptions, Simulator, Start, Step, Trajectory,
    kernel::LANES,
    products::Along,
    recursion::Stage,
    run::Run,
    sensitivity::{Path, Sensitivity, Tangents, retractions},
    state::State,
    trajectories::GROUP,
    window::Window,
};

/// Options of the simulated segments.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ShootingOptions {
    /// Steps of a segment, N.
    pub steps: usize,
    /// Integration method of derivatives.
    pub method: Method,
    /// Length of a step.
    pub step: Step,
    /// A state this many training standard deviations away from the start of its segment has diverged. The segment
    /// ends, and its last good state stands for the rest.
    pub divergence: f64,
}

impl ShootingOptions {
    /// Runge-Kutta steps of the episode's median period, so that coefficients of derivatives stay those of the equation; divergence at 10 standard deviations.
    pub fn new(steps: usize) -> Self {
        Self { steps, method: Method::Rk4, step: Step::Median, divergence: 10.0 }
    }

    pub(crate) fn rollout(&self) -> RolloutOptions {
        let mut options = RolloutOptions::new(self.steps);
        (options.method, options.step, options.divergence) = (self.method, self.step, self.divergence);
        options
    }
}

/// A model on the segments of a recording.
pub struct Shooting<'a> {
    source: &'a dyn Source,
    simulator: Simulator,
    sensitivity: Sensitivity,
    options: RolloutOptions,
    map: Vec<usize>,
    /// `1 / (sigma sqrt(N))` of every state; 0 where it does not count.
    scale: Vec<f64>,
}

/// Residuals of one segment, with their derivatives.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Segment {
    /// Numbers of the coefficients that move it, ascending.
    pub active: Vec<usize>,
    /// The residuals r (n); those of missing measurements are left out.
    pub residuals: Vec<f64>,
    /// Their derivatives, coefficient by coefficient (active x n).
    pub slopes: Vec<f64>,
    /// Sum of the squares of the measurements, in the units of the residuals.
    pub size: f64,
    /// True if the simulation ended early.
    pub ended: bool,
}

impl Segment {
    /// Returns true if all residuals and derivatives are finite.
    pub fn is_finite(&self) -> bool {
        self.residuals.iter().chain(&self.slopes).all(|value| value.is_finite())
    }
}

impl<'a> Shooting<'a> {
    /// Compiles a model for the segments of a source whose columns are the model's, and differentiates it with respect to `coefficients`.
    ///
    /// # Errors
    /// Those of [`Simulator::new`] and of the options; [`Error::SimulatedLag`]; [`Error::TooShort`] where no episode has a segment.
    pub fn new(
        model: &Model,
        source: &'a dyn Source,
        coefficients: &[Coefficient],
        options: &ShootingOptions,
    ) -> Result<Self, Error> {
        let options = options.rollout();
        options.validate()?;
        let simulator = Simulator::for_source(model, source, options.step)?;
        let needed = simulator.needed_rows(options.horizon);
        crate::Starts::Even(1).choose(source, options.horizon, needed.before, needed.after)?;
        let root = (options.horizon as f64).sqrt();
        let scale =
            |deviation: f64| if deviation > 0.0 && deviation.is_finite() { 1.0 / (deviation * root) } else { 0.0 };
        Ok(Self {
            sensitivity: Sensitivity::new(&simulator, coefficients)?,
            map: simulator.column_map(source)?,
            scale: simulator.states.iter().map(|state| scale(state.deviation)).collect(),
            source,
            simulator,
            options,
        })
    }

    /// Rows that a segment needs in front of its first and behind it.
    pub fn halo(&self) -> Halo {
        self.simulator.needed_rows(self.options.horizon)
    }

    /// Takes the segments that begin in some core rows of a block of an episode, in order. Returns the number left out
    /// because a value that they need is missing.
    pub fn segments(&self, episode: usize, block: &Block, rows: Range<usize>, mut take: impl FnMut(Segment)) -> u64 {
        self.each(episode, block, (rows, 1), |window, trajectory| take(self.segment(window, trajectory)))
    }

    /// Adds these segments, or one of `every` so many, to products of their derivatives J: to `J'r`, or to `J'J v` for
    /// a direction v of the coefficients. That takes some five to eleven times the simulation, for any number of
    /// coefficients. Segments with numbers that are not finite are left out, and clear [`Products::finite`].
    pub fn products(
        &self,
        episode: usize,
        block: &Block,
        (rows, every): (Range<usize>, usize),
        direction: Option<&[f64]>,
        into: &mut Products,
    ) -> u64 {
        self.each(episode, block, (rows, every), |window, trajectory| self.product(window, trajectory, direction, into))
    }

    /// Adds the recorded rows of these segments to the normal matrix of one step.
    pub fn normal(&self, episode: usize, block: &Block, rows: Range<usize>, into: &mut NormalBlocks) {
        self.each(episode, block, (rows, 1), |window, simulated| {
            let run = Run::new(self.source, window, &self.options);
            let measured = |step: i64| {
                let of = |state: &State| window.values(state.column, step, step + 1)[0];
                self.simulator.states.iter().map(of).collect::<Vec<f64>>()
            };
            let recorded = Trajectory {
                states: (0..=self.options.horizon as i64).flat_map(measured).collect(),
                regions: vec![0; self.options.horizon],
                ..simulated.clone()
            };
            let path = Path::new(&self.simulator, &run, &recorded);
            let stages = self.sensitivity.stages(&path, &run, Method::Euler);
            let seconds: Vec<f64> = (0..self.options.horizon).map(|k| run.step(k)).collect();
            let along = self.along(&stages, &seconds);
            (0..seconds.len()).for_each(|k| along.normal(k, &self.scale, into));
        });
    }

    fn each(
        &self,
        episode: usize,
        block: &Block,
        (rows, every): (Range<usize>, usize),
        mut take: impl FnMut(&Window<'_>, &Trajectory),
    ) -> u64 {
        let (halo, horizon) = (self.halo(), self.options.horizon);
        let total = self.source.episodes()[episode].rows;
        let begins = |row: &usize| {
            *row >= halo.before && (row - halo.before).is_multiple_of(horizon * every) && row + halo.after < total
        };
        let starts: Vec<Start> = (block.first + rows.start..block.first + rows.end)
            .filter(begins)
            .map(|row| Start { episode, row })
            .collect();
        let mut missing = 0;
        for starts in starts.chunks(GROUP) {
            let windows: Vec<Window<'_>> = starts.iter().map(|&start| Window::new(block, start, &self.map)).collect();
            let complete: Vec<&Window<'_>> =
                windows.iter().filter(|window| self.simulator.is_complete(window, horizon)).collect();
            missing += (windows.len() - complete.len()) as u64;
            let done = self.simulator.simulate(self.source, &complete, &self.options);
            complete.iter().zip(&done).for_each(|(window, trajectory)| take(window, trajectory));
        }
        missing
    }

    fn segment(&self, window: &Window<'_>, trajectory: &Trajectory) -> Segment {
        let run = Run::new(self.source, window, &self.options);
        let tangents = self.sensitivity.along(&self.simulator, &run, trajectory, self.options.method, false);
        let cells = self.cells(window);
        let mut segment = Segment { ended: trajectory.end != End::Horizon, ..Segment::default() };
        for cell in &cells {
            segment.residuals.push(self.residual(&run, cell, trajectory));
            segment.size += (self.scale[cell.1] * cell.2).powi(2);
        }
        segment.slopes = self.slopes(&cells, &tangents, trajectory.steps());
        segment.active = tangents.active;
        segment
    }

    /// Residual of a cell.
    fn residual(&self, run: &Run<'_>, &(step, state, _): &(usize, usize, f64), trajectory: &Trajectory) -> f64 {
        self.scale[state] * run.error(self.simulator.moved(), state, step, |s| trajectory.state(step)[s])
    }

    fn along<'b>(&'b self, stages: &'b [Stage], seconds: &'b [f64]) -> Along<'b> {
        Along { simulator: &self.simulator, places: &self.sensitivity.places, stages, seconds, retractions: Vec::new() }
    }

    fn product(&self, window: &Window<'_>, trajectory: &Trajectory, direction: Option<&[f64]>, into: &mut Products) {
        let run = Run::new(self.source, window, &self.options);
        let path = Path::new(&self.simulator, &run, trajectory);
        let stages = self.sensitivity.stages(&path, &run, self.options.method);
        let (steps, states) = (trajectory.steps(), self.scale.len());
        let seconds: Vec<f64> = (0..steps).map(|k| run.step(k)).collect();
        let brought_back = |k: usize| retractions(&path, &stages, (k, seconds[k]));
        let along = Along { retractions: (0..steps).map(brought_back).collect(), ..self.along(&stages, &seconds) };
        let tangent = direction.map(|direction| along.forward(direction));
        let cells = self.cells(window);
        // A segment that ended early has its last good state.
        let place = |&(step, state, _): &(usize, usize, f64)| step.min(steps) * states + state;
        let value = |cell: &(usize, usize, f64)| match &tangent {
            Some(tangent) => -self.scale[cell.1] * tangent[place(cell)],
            None => self.residual(&run, cell, trajectory),
        };
        let (mut weights, mut square) = (vec![0.0; (steps + 1) * states], 0.0);
        for cell in &cells {
            let value = value(cell);
            square += value * value;
            weights[place(cell)] -= self.scale[cell.1] * value;
        }
        // A weight that is finite may meet a derivative that is not.
        let slopes_are_finite = || stages.iter().all(|stage| stage.slopes.total.iter().all(|slope| slope.is_finite()));
        if !square.is_finite() || !slopes_are_finite() {
            into.finite = false;
            return;
        }
        along.back(&mut weights, &mut into.back);
        into.square += square;
        into.size += cells.iter().map(|cell| (self.scale[cell.1] * cell.2).powi(2)).sum::<f64>();
        into.residuals += cells.len() as u64;
        into.segments += 1;
        into.ended += u64::from(trajectory.end != End::Horizon);
    }

    /// Compared cells: step, state, measured value.
    fn cells(&self, window: &Window<'_>) -> Vec<(usize, usize, f64)> {
        let horizon = self.options.horizon;
        let counts = (0..self.scale.len()).filter(|&state| self.scale[state] > 0.0);
        let cells = counts.flat_map(|state| {
            let measured = window.values(self.simulator.states[state].column, 0, horizon as i64 + 1);
            (1..=horizon).map(move |step| (step, state, measured[step]))
        });
        cells.filter(|cell| cell.2.is_finite()).collect()
    }

    /// The residuals' derivatives; where a segment ended early its last good state stands, and that state's derivatives.
    fn slopes(&self, cells: &[(usize, usize, f64)], tangents: &Tangents, steps: usize) -> Vec<f64> {
        let (count, length) = (tangents.active.len(), cells.len());
        let mut slopes = vec![0.0; count * length];
        // A few columns at a time: what is written stays in the first cache.
        for first in (0..count).step_by(LANES) {
            let range = first..(first + LANES).min(count);
            let columns = &mut slopes[range.start * length..range.end * length];
            for (at, &(step, state, _)) in cells.iter().enumerate() {
                let tangent = &tangents.of(step.min(steps), state, self.scale.len())[range.clone()];
                let scale = -self.scale[state];
                for (number, value) in tangent.iter().enumerate() {
                    columns[number * length + at] = scale * value;
                }
            }
        }
        slopes
    }
}
