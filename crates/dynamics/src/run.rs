//! One rollout to be done.

use fleetfoot_data::{Block, Source};

use crate::{Outside, RolloutOptions, Start, Step, geometry::Geometry, state::State, window::Window};

/// One rollout to be done: its window, and the time of its steps.
pub(crate) struct Run<'a> {
    pub(crate) window: &'a Window<'a>,
    /// Seconds from the start, horizon + 1 values.
    pub(crate) time: Vec<f64>,
    pub(crate) start: Start,
    pub(crate) horizon: usize,
    /// [`RolloutOptions::divergence`].
    pub(crate) divergence: f64,
    /// True to end the run at the border of the training range.
    pub(crate) ends_outside: bool,
    /// The states where it begins, in the order of [`Simulator::states`](crate::Simulator::states); the recorded ones where none are given.
    pub(crate) beginning: Option<&'a [f64]>,
    /// For every state, the share of its innovation by which it is corrected before the next step: a filter of constant
    /// gain. Empty for a simulation without corrections.
    pub(crate) gains: &'a [f64],
    /// True if all steps are `time[1]` long.
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

    /// Measured minus simulated, of a state at a step; NaN without a measurement. That of an angle is in (-pi, pi]; of
    /// a rotation the measured one is written as near to the simulated one as it can be.
    pub(crate) fn error(
        &self,
        of: (&[State], &Geometry),
        place: usize,
        step: usize,
        simulated: impl Fn(usize) -> f64,
    ) -> f64 {
        let measured = |s: usize| self.window.values(of.0[s].column, step as i64, step as i64 + 1)[0];
        of.1.difference(place, measured, simulated)
    }

    /// The state from which the next step is made: the simulated one, moved towards its measurement if there are gains
    /// and a measurement.
    pub(crate) fn corrected(
        &self,
        of: (&[State], &Geometry),
        place: usize,
        step: usize,
        simulated: impl Fn(usize) -> f64,
    ) -> f64 {
        let value = simulated(place);
        let Some(&gain) = self.gains.get(place) else { return value };
        let error = self.error(of, place, step, simulated);
        if error.is_finite() { gain.mul_add(error, value) } else { value }
    }

    pub(crate) fn block(&self) -> &Block {
        self.window.block
    }
}
