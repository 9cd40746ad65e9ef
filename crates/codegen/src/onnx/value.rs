//! Values of a graph.

use std::rc::Rc;

use super::{combination::Combination, tensor::Constant};

/// A dimension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dimension {
    /// Any number of rows.
    Rows,
    /// Steps of a window, the oldest first.
    Steps,
    /// Columns of a step, or units of a state.
    Columns,
    /// The only direction of a cell.
    Direction,
}

/// Values in steps: the window that a cell reads, or its states, of which only the last is known.
#[derive(Debug, Clone)]
pub(super) struct Sequence {
    /// The columns of all steps, step by step, or the last state.
    pub(super) value: Combination,
    pub(super) steps: usize,
    pub(super) is_state: bool,
    pub(super) dimensions: Vec<Dimension>,
}

impl Sequence {
    /// A window of so many steps.
    pub(super) fn window(value: Combination, steps: usize, dimensions: [Dimension; 3]) -> Self {
        Self { value, steps, is_state: false, dimensions: dimensions.to_vec() }
    }
}

/// A value of the graph.
#[derive(Debug, Clone)]
pub(super) enum Value {
    Constant(Rc<Constant>),
    Computed(Combination),
    /// Boxed, as it is rare.
    Sequence(Box<Sequence>),
}

impl Value {
    /// The numbers of a value that is no constant.
    pub(super) fn combination(&self) -> Option<&Combination> {
        match self {
            Self::Constant(_) => None,
            Self::Computed(value) => Some(value),
            Self::Sequence(sequence) => Some(&sequence.value),
        }
    }
}
