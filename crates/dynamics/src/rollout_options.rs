//! Options of rollouts.

use fleetfoot_model::Model;

use crate::{Error, Method, Reference, Step};

/// Options of the scores of paths, as text.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PathOptions {
    /// [`RolloutOptions::position`].
    pub position: Vec<String>,
    /// [`RolloutOptions::references`], in the form of [`Reference::parse`].
    pub references: Vec<String>,
    /// [`RolloutOptions::interval`]; `None`: 1.
    pub interval: Option<usize>,
    /// [`RolloutOptions::band`].
    pub band: Option<usize>,
}

impl PathOptions {
    /// Adds them to the options of a model's rollouts.
    ///
    /// # Errors
    /// Those of [`Reference::parse`].
    pub fn apply(&self, model: &Model, options: &mut RolloutOptions) -> Result<(), Error> {
        let names = || model.columns.iter().map(|column| column.name.as_str());
        options.position.clone_from(&self.position);
        options.references =
            self.references.iter().map(|text| Reference::parse(text, names())).collect::<Result<_, _>>()?;
        options.interval = self.interval.unwrap_or(1);
        options.band = self.band;
        Ok(())
    }
}

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
    /// Steps over which the relative growth of that distance is taken.
    pub interval: usize,
    /// Places by which dynamic time warping may shift a point; `None`: a tenth of the horizon.
    pub band: Option<usize>,
    /// States that follow a reference in the baseline of that name.
    pub references: Vec<Reference>,
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
        Self {
            horizon,
            method,
            step,
            divergence: 1e3,
            outside,
            position: Vec::new(),
            interval: 1,
            band: None,
            references: Vec::new(),
            keep: false,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), Error> {
        match self.step {
            _ if self.horizon == 0 => Err(Error::NoHorizon),
            Step::Seconds(seconds) if !(seconds.is_finite() && seconds > 0.0) => Err(Error::BadStep(seconds)),
            _ => Ok(()),
        }
    }
}
