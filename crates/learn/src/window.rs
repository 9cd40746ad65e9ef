//! The rows that a recurrent cell runs over.

use std::ops::Range;

use crate::{Cell, Error, Units};

/// A cell and the inputs of its steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Window {
    /// The cell.
    pub cell: Cell,
    /// Inputs of every step, the oldest first: steps x columns, each an index among the inputs of the network.
    pub steps: Vec<Vec<usize>>,
}

/// Places of the numbers of a cell in the list of all.
pub(crate) struct Places {
    /// W, gates units x inputs.
    pub(crate) inputs: Range<usize>,
    /// R, gates units x units.
    pub(crate) states: Range<usize>,
    /// b, gates units.
    pub(crate) biases: Range<usize>,
    /// c, units; empty but for the GRU.
    pub(crate) state_biases: Range<usize>,
}

impl Places {
    pub(crate) fn new(window: &Window, units: usize) -> Self {
        let rows = window.cell.gates() * units;
        let inputs = 0..rows * window.columns();
        let states = inputs.end..inputs.end + rows * units;
        let biases = states.end..states.end + rows;
        let state_biases = biases.end..biases.end + if window.cell.has_state_bias() { units } else { 0 };
        Self { inputs, states, biases, state_biases }
    }
}

impl Window {
    /// Columns that a step reads.
    pub fn columns(&self) -> usize {
        self.steps.first().map_or(0, Vec::len)
    }

    /// Gives all steps of a column the centre and the scale of the last one: the cell has the same weights at every step.
    pub fn share(&self, units: &mut Units) {
        let Some(last) = self.steps.last() else { return };
        for step in &self.steps {
            for (&to, &from) in step.iter().zip(last) {
                units.centre[to] = units.centre[from];
                units.scale[to] = units.scale[from];
            }
        }
    }

    pub(crate) fn check(&self, inputs: usize, hidden: &[usize]) -> Result<(), Error> {
        let columns = self.columns();
        let fits = |step: &Vec<usize>| step.len() == columns && step.iter().all(|&input| input < inputs);
        match columns > 0 && self.steps.iter().all(fits) && hidden.len() == 1 {
            true => Ok(()),
            false => Err(Error::Shape(format!(
                "a cell over {} steps of {columns} columns of {inputs} inputs, with hidden layers of {hidden:?} units: it is one layer, and all steps have the same columns",
                self.steps.len()
            ))),
        }
    }
}
