//! A controller bound to the columns of a model that is simulated.

use std::sync::Arc;

use fleetfoot_library::nearest;

use super::{Controller, ControllerState};
use crate::{Error, Simulator, window::Window};

/// A controller, and where its columns are.
pub(crate) struct Driver {
    controller: Arc<dyn Controller>,
    reads: Vec<Read>,
    /// Driven columns of the model, each with the most rows back at which an equation uses it.
    pub(crate) drives: Vec<(usize, i32)>,
    pub(crate) names: Vec<String>,
}

/// Where a value that the controller looks at comes from.
#[derive(Clone, Copy)]
enum Read {
    /// An advanced state.
    State(usize),
    /// A column of the recording.
    Recorded(usize),
}

impl Driver {
    /// Binds the names, and takes the driven columns out of what is read from the recording.
    pub(crate) fn bind(controller: Arc<dyn Controller>, simulator: &mut Simulator) -> Result<Self, Error> {
        controller.validate()?;
        let (names, mut drives) = (controller.drives(), Vec::new());
        for name in &names {
            let column = find(simulator, name)?;
            let refused = |problem: &str| Error::Controller { column: name.clone(), problem: problem.to_owned() };
            if simulator.states.iter().any(|state| state.column == column) {
                return Err(refused("is a state that an equation of the model advances; a controller drives inputs"));
            }
            if drives.iter().any(|&(driven, _)| driven == column) {
                return Err(refused("is driven twice"));
            }
            let recorded = simulator.recorded.iter().position(|&(known, ..)| known == column);
            let (_, most, least) = recorded.map_or((column, 0, 0), |index| simulator.recorded.remove(index));
            if least < 0 {
                return Err(Error::FutureState { state: name.clone(), ahead: least.saturating_neg() });
            }
            drives.push((column, most));
        }
        let mut reads = Vec::new();
        for name in controller.reads() {
            let column = find(simulator, &name)?;
            if drives.iter().any(|&(driven, _)| driven == column) {
                let problem = "is read by the controller that drives it".to_owned();
                return Err(Error::Controller { column: name, problem });
            }
            reads.push(match simulator.states.iter().position(|state| state.column == column) {
                Some(state) => Read::State(state),
                None => {
                    read_present(&mut simulator.recorded, column);
                    Read::Recorded(column)
                }
            });
        }
        Ok(Self { controller, reads, drives, names })
    }

    /// Whether the rows that the driven columns start from are finite.
    pub(crate) fn is_complete(&self, window: &Window<'_>) -> bool {
        let finite = |&(column, most): &(usize, i32)| {
            window.values(column, -i64::from(most), 1).iter().all(|value| value.is_finite())
        };
        self.drives.iter().all(finite)
    }

    /// The controller at the start of a trajectory.
    pub(crate) fn start<'a>(&'a self, window: &'a Window<'a>, horizon: usize) -> Drive<'a> {
        let columns = self.reads.iter().map(|read| match *read {
            Read::State(_) => &[],
            Read::Recorded(column) => window.values(column, 0, horizon as i64),
        });
        Drive {
            reads: &self.reads,
            recorded: columns.collect(),
            state: self.controller.start(),
            seen: vec![0.0; self.reads.len()],
            inputs: self.drives.iter().map(|&(column, _)| window.values(column, 0, 1)[0]).collect(),
            given: Vec::with_capacity(horizon * self.drives.len()),
        }
    }
}

/// Index of a column that the controller speaks of.
fn find(simulator: &Simulator, name: &str) -> Result<usize, Error> {
    let columns = &simulator.columns;
    columns.iter().position(|known| known == name).ok_or_else(|| {
        let similar = nearest(name, columns.iter().map(String::as_str));
        let hint = if similar.is_empty() { columns.join(", ") } else { similar.join(", ") };
        let problem = format!("is no column of the model; did you mean {hint}?");
        Error::Controller { column: name.to_owned(), problem }
    })
}

/// Makes sure that a column is read at the present row.
fn read_present(recorded: &mut Vec<(usize, i32, i32)>, column: usize) {
    match recorded.iter_mut().find(|(known, ..)| *known == column) {
        Some((_, most, least)) => (*most, *least) = ((*most).max(0), (*least).min(0)),
        None => recorded.push((column, 0, 0)),
    }
}

/// A controller on its way along a trajectory.
pub(crate) struct Drive<'a> {
    reads: &'a [Read],
    /// Per read: the recorded column from the start on; empty for a state.
    recorded: Vec<&'a [f64]>,
    state: Box<dyn ControllerState>,
    seen: Vec<f64>,
    /// The inputs of the present step.
    pub(crate) inputs: Vec<f64>,
    /// Those of all steps so far.
    given: Vec<f64>,
}

impl Drive<'_> {
    /// Computes the inputs of step `k`, which begins at `seconds` in the state that `states` tells.
    #[inline]
    pub(crate) fn step(&mut self, k: usize, seconds: f64, states: impl Fn(usize) -> f64) {
        for ((seen, read), recorded) in self.seen.iter_mut().zip(self.reads).zip(&self.recorded) {
            *seen = match *read {
                Read::State(state) => states(state),
                Read::Recorded(_) => recorded[k],
            };
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
