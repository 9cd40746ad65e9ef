//! Multiple shooting: a recording cut into segments, each simulated from its measured beginning, with the errors' derivatives by the model's coefficients.
//!
//! The segments of an episode follow each other: where one ends the next begins. What a segment of N steps leaves, over the advanced states s and the steps k,
//! is
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
    Coefficient, End, Error, Method, RolloutOptions, Simulator, Start, Step, Trajectory,
    kernel::LANES,
    run::Run,
    sensitivity::{Sensitivity, Tangents},
    trajectories::GROUP,
    window::Window,
};

/// How segments are simulated.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ShootingOptions {
    /// Steps of a segment, N.
    pub steps: usize,
    /// How derivatives are integrated.
    pub method: Method,
    /// How long a step is.
    pub step: Step,
    /// A state this many training standard deviations away from where its segment began has diverged: the segment ends, and its last good state stands for the
    /// rest.
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

/// What one segment leaves.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Segment {
    /// Numbers of the coefficients that move it, ascending.
    pub active: Vec<usize>,
    /// The residuals r (n); those of missing measurements are left out.
    pub residuals: Vec<f64>,
    /// Their derivatives, coefficient by coefficient (active x n).
    pub slopes: Vec<f64>,
    /// Sum of the squares of what is measured, in the units of the residuals.
    pub size: f64,
    /// Whether it ended early.
    pub ended: bool,
}

impl Segment {
    /// Whether all of it is finite.
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

    /// The segments that begin in some core rows of a block of an episode, in order; tells how many were left out because a value that they need is missing.
    pub fn segments(&self, episode: usize, block: &Block, rows: Range<usize>, mut take: impl FnMut(Segment)) -> u64 {
        let (halo, horizon) = (self.halo(), self.options.horizon);
        let total = self.source.episodes()[episode].rows;
        let begins = |row: &usize| {
            *row >= halo.before && (row - halo.before).is_multiple_of(horizon) && row + halo.after < total
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
            complete.iter().zip(&done).for_each(|(window, trajectory)| take(self.segment(window, trajectory)));
        }
        missing
    }

    fn segment(&self, window: &Window<'_>, trajectory: &Trajectory) -> Segment {
        let run = Run::new(self.source, window, &self.options);
        let tangents = self.sensitivity.along(&self.simulator, &run, trajectory, self.options.method, false);
        let cells = self.cells(window);
        let mut segment = Segment { ended: trajectory.end != End::Horizon, ..Segment::default() };
        for &(step, state, measured) in &cells {
            let scale = self.scale[state];
            let error = run.error(self.simulator.moved(), state, step, |s| trajectory.state(step)[s]);
            segment.residuals.push(scale * error);
            segment.size += (scale * measured).powi(2);
        }
        segment.slopes = self.slopes(&cells, &tangents, trajectory.steps());
        segment.active = tangents.active;
        segment
    }

    /// What is compared: step, state, measured value.
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
            let own = first..(first + LANES).min(count);
            let columns = &mut slopes[own.start * length..own.end * length];
            for (at, &(step, state, _)) in cells.iter().enumerate() {
                let tangent = &tangents.of(step.min(steps), state, self.scale.len())[own.clone()];
                let scale = -self.scale[state];
                for (number, value) in tangent.iter().enumerate() {
                    columns[number * length + at] = scale * value;
                }
            }
        }
        slopes
    }
}
