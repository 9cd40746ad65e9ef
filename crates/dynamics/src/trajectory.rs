//! Trajectory of a rollout.

use crate::Start;

/// End of a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// At the horizon.
    Horizon,
    /// A state became infinite, not a number, or went too far from its start.
    Diverged,
    /// The row's label was not seen in training: no region applies.
    NoRegion,
    /// A regressor was outside the range that its region saw in training ([`Outside::End`](crate::Outside::End)).
    LeftDomain,
}

impl End {
    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Horizon => "horizon",
            Self::Diverged => "diverged",
            Self::NoRegion => "no region",
            Self::LeftDomain => "left domain",
        }
    }
}

/// One free run of a model.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Trajectory {
    /// Start of the rollout.
    pub start: Start,
    /// Seconds since the start, one value a state vector.
    pub time: Vec<f64>,
    /// State vectors, one after the other, the first as recorded; angles in (-pi, pi].
    pub states: Vec<f64>,
    /// Inputs that a controller gave, one vector a step in the order of [`Simulator::driven_inputs`](crate::Simulator::driven_inputs); empty in an open loop.
    pub inputs: Vec<f64>,
    /// The region that each step used (in the first latent's partition); one value less than there are state vectors.
    pub regions: Vec<u32>,
    /// End of the rollout. After an early end the last state vector is the last good one.
    pub end: End,
    /// The first step at which a regressor was outside the range that its region saw in training.
    pub left_domain: Option<usize>,
}

impl Trajectory {
    /// Steps made.
    pub fn steps(&self) -> usize {
        self.regions.len()
    }

    /// The state vector after `step` steps; after an early end, the last good one.
    pub fn state(&self, step: usize) -> &[f64] {
        let width = self.states.len() / (self.steps() + 1);
        let step = step.min(self.steps());
        &self.states[step * width..(step + 1) * width]
    }
}
