//! How to roll out.

use crate::{Error, Method, Step};

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
    /// It goes on, and tells when it left ([`Trajectory::left_domain`](crate::Trajectory::left_domain)).
    #[default]
    Tell,
    /// It ends there.
    End,
    /// It goes on with the regressor held at the border of the range: an affine map is not followed to where nothing was seen. What is given instead of
    /// fitted, and the region, see the state itself.
    Hold,
}

impl RolloutOptions {
    /// Runge-Kutta steps of the episode's median period, divergence at 1,000 standard deviations, leaving the training domain told, trajectories not kept.
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
