//! A controller along trajectories of a model that is simulated.

use std::sync::Arc;

use fleetfoot_library::{Program, Scratch};

use super::{Controller, ControllerState};
use crate::window::Window;

/// A controller, and where its columns are.
pub(crate) struct Driver {
    pub(crate) controller: Arc<dyn Controller>,
    pub(crate) reads: Vec<Read>,
    /// Driven columns of the model, each with the most rows back at which an equation uses it.
    pub(crate) drives: Vec<(usize, i32)>,
    pub(crate) names: Vec<String>,
}

/// Source of a value that the controller reads.
pub(crate) enum Read {
    /// An advanced state.
    State(usize),
    /// A column of the recording.
    Recorded(usize),
    /// A value computed from others at the same row.
    Computed(Program, Vec<Read>),
}

impl Driver {
    /// Returns true if the rows that the driven columns start from are finite.
    pub(crate) fn is_complete(&self, window: &Window<'_>) -> bool {
        let finite = |&(column, most): &(usize, i32)| {
            window.values(column, -i64::from(most), 1).iter().all(|value| value.is_finite())
        };
        self.drives.iter().all(finite)
    }

    /// The controller at the start of a trajectory.
    pub(crate) fn start<'a>(&'a self, window: &'a Window<'a>, horizon: usize) -> Drive<'a> {
        Drive {
            reads: self.reads.iter().map(|read| Seen::of(read, window, horizon)).collect(),
            state: self.controller.start(),
            seen: vec![0.0; self.reads.len()],
            inputs: self.drives.iter().map(|&(column, _)| window.values(column, 0, 1)[0]).collect(),
            given: Vec::with_capacity(horizon * self.drives.len()),
        }
    }
}

/// Values that a controller reads along a trajectory.
enum Seen<'a> {
    State(usize),
    /// From the start on.
    Recorded(&'a [f64]),
    Computed(&'a Program, Vec<Seen<'a>>),
}

impl<'a> Seen<'a> {
    fn of(read: &'a Read, window: &'a Window<'a>, horizon: usize) -> Self {
        match read {
            Read::State(state) => Self::State(*state),
            Read::Recorded(column) => Self::Recorded(window.values(*column, 0, horizon as i64)),
            Read::Computed(program, reads) => {
                Self::Computed(program, reads.iter().map(|read| Self::of(read, window, horizon)).collect())
            }
        }
    }

    /// The value in step `k`.
    #[inline]
    fn at(&self, k: usize, states: &dyn Fn(usize) -> f64) -> f64 {
        match self {
            Self::State(state) => states(*state),
            Self::Recorded(values) => values[k],
            Self::Computed(program, reads) => {
                let leaves: Vec<f64> = reads.iter().map(|read| read.at(k, states)).collect();
                let mut value = [0.0];
                program.evaluate_row(&leaves, &mut value, &mut Scratch::default());
                value[0]
            }
        }
    }
}

/// A controller on its way along a trajectory.
pub(crate) struct Drive<'a> {
    reads: Vec<Seen<'a>>,
    state: Box<dyn ControllerState>,
    seen: Vec<f64>,
    /// The inputs of the present step.
    pub(crate) inputs: Vec<f64>,
    /// Those of all steps so far.
    given: Vec<f64>,
}

impl Drive<'_> {
    /// Computes the inputs of step `k`, which begins at `seconds` with the values of `states`.
    #[inline]
    pub(crate) fn step(&mut self, k: usize, seconds: f64, states: impl Fn(usize) -> f64) {
        for (seen, read) in self.seen.iter_mut().zip(&self.reads) {
            *seen = read.at(k, &states);
        }
        self.state.control(seconds, &self.seen, &mut self.inputs);
        self.given.extend_from_slice(&self.inputs);
    }

    /// The inputs of the first `steps` steps, one step after the other.
    pub(crate) fn finish(mut self, steps: usize) -> Vec<f64> {
        self.given.truncate(steps * self.inputs.len());
        self.given
    }
}
