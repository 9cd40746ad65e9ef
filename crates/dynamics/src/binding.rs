//! A controller bound to the columns of a model that is simulated.

use std::sync::Arc;

use fleetfoot_data::nearest;
use fleetfoot_library::{Leaf, Program};

use crate::{
    Error, Simulator,
    controller::{Controller, Driver, Read},
};

impl Driver {
    /// Binds the names, and takes the driven columns out of those read from the recording.
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
}

/// Index of a column that the controller names.
fn find(simulator: &Simulator, name: &str) -> Result<usize, Error> {
    let columns = &simulator.columns;
    columns.iter().position(|known| known == name).ok_or_else(|| {
        let similar = nearest(name, columns.iter().map(String::as_str));
        let hint = if similar.is_empty() { columns.join(", ") } else { similar.join(", ") };
        let problem = format!("is no column of the model; did you mean {hint}?");
        Error::Controller { column: name.to_owned(), problem }
    })
}

/// Source of a column's values while a trajectory is simulated.
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
