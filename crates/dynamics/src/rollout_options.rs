//! Options of rollouts.

use crate::{Error, Method, Step};

/// Options of rollouts.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RolloutOptions {
    /// Steps ahead, one a row.
    pub horizon: usize,
    /// Integration method of derivatives.
    pub method: Method,
    /// Length of a step.
    pub step: Step,
    /// A state this many training standard deviations away from where it started has diverged.
    pub divergence: f64,
    /// Treatment of a trajectory that leaves the training range.
    pub outside: Outside,
    /// States whose Euclidean distance from the recording is reported too; they share a unit.
    pub position: Vec<String>,
    /// True to keep the trajectories in [`crate::rollout`].
    pub keep: bool,
}

/// Treatment of a trajectory with a regressor outside the training range of its region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outside {
    /// It goes on, and notes the time when it left ([`Trajectory::left_domain`](crate::Trajectory::left_domain)).
    #[default]
    Tell,
    /// It ends there.
    End,
    /// It goes on with the regressor held at the border of the range: an affine map is not extrapolated. Given
    /// equations, and the choice of the region, read the state itself.
    Hold,
}

impl RolloutOptions {
    /// Runge-Kutta steps of the episode's median period, divergence at 1,000 standard deviations, leaving the training
    /// range noted, trajectories not kept.
    pub fn new(horizon: usize) -> Self {
        let (method, step, outside) = (Method::Rk4, Step::Median, Outside::Tell);
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
