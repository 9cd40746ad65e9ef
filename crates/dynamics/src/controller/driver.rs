//! A controller bound to the columns of a model that is simulated.

use std::sync::Arc;

use fleetfoot_data::nearest;
use fleetfoot_library::{Leaf, Program, Scratch};

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
enum Read {
    /// An advanced state.
    State(usize),
    /// A column of the recording.
    Recorded(usize),
    /// What follows from these at the same row.
    Computed(Program, Vec<Read>),
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
            reads.push(read(simulator, &drives, column)?);
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
        Drive {
            reads: self.reads.iter().map(|read| Seen::of(read, window, horizon)).collect(),
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

/// Where the values of a column come from while a trajectory is simulated.
fn read(simulator: &mut Simulator, drives: &[(usize, i32)], column: usize) -> Result<Read, Error> {
    if let Some(state) = simulator.states.iter().position(|state| state.column == column) {
        return Ok(Read::State(state));
    }
    let name = simulator.columns[column].clone();
    let Some((_, definition)) = simulator.computed.iter().find(|(computed, _)| *computed == name) else {
        read_present(&mut simulator.recorded, column);
        return Ok(Read::Recorded(column));
    };
    let refused = |problem: &str| Error::Controller {
        column: name.clone(),
        problem: format!(
            "is {definition}, which {problem}; let the controller read states and inputs that it does not drive"
        ),
    };
    let columns: Vec<&str> = simulator.columns.iter().map(String::as_str).collect();
    let program = Program::compile(std::slice::from_ref(definition), &columns)?;
    let mut leaves = Vec::new();
    for leaf in program.leaves() {
        match *leaf {
            Leaf::Column { column, lag: 0 } if drives.iter().all(|&(driven, _)| driven != column) => {
                leaves.push(column)
            }
            Leaf::Column { lag: 0, .. } => return Err(refused("has an input that the controller drives")),
            _ => return Err(refused("looks at other rows or at time")),
        }
    }
    let reads = leaves.into_iter().map(|column| read(simulator, drives, column)).collect::<Result<_, _>>()?;
    Ok(Read::Computed(program, reads))
}

/// Makes sure that a column is read at the present row.
fn read_present(recorded: &mut Vec<(usize, i32, i32)>, column: usize) {
    match recorded.iter_mut().find(|(known, ..)| *known == column) {
        Some((_, most, least)) => (*most, *least) = ((*most).max(0), (*least).min(0)),
        None => recorded.push((column, 0, 0)),
    }
}

/// What a controller looks at along a trajectory.
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
    /// Computes the inputs of step `k`, which begins at `seconds` in the state that `states` tells.
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
