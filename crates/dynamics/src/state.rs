//! The states that the equations of a model advance.

use fleetfoot_data::packed;
use fleetfoot_model::{Equation, FirstOrderLag, Model, Role};

use crate::{Error, integrate::Advance};

/// A state that an equation advances.
pub(crate) struct State {
    pub(crate) column: usize,
    pub(crate) advance: Advance,
    /// Standard deviation in training; NaN where unknown.
    pub(crate) deviation: f64,
    /// Index among the columns with role State, if it is one.
    pub(crate) order: Option<usize>,
    /// True if it cannot go far: an angle, or a part of a rotation.
    pub(crate) bounded: bool,
}

/// A state whose standard deviation in training is at most this share of its value did not move: the rest is rounding.
const STILL: f64 = 1e-9;

impl State {
    /// Largest distance of the state from its start. A state that did not move in training has no limit.
    pub(crate) fn limit(&self, divergence: f64, start: f64) -> f64 {
        let limit = divergence * self.deviation;
        let moved = self.deviation > STILL * start.abs();
        if moved && limit > 0.0 && limit.is_finite() && !self.bounded { limit } else { f64::MAX }
    }

    /// A first-order lag of computed values.
    pub(crate) fn of_lag(lag: &FirstOrderLag) -> Self {
        Self {
            column: lag.column,
            advance: Advance::lag(lag.constant),
            deviation: f64::NAN,
            order: None,
            bounded: false,
        }
    }

    /// Typical size: its standard deviation in training; 1 if that is unknown or zero.
    pub(crate) fn size(&self) -> f64 {
        if self.deviation.is_finite() && self.deviation > 0.0 { self.deviation } else { 1.0 }
    }
}

/// Index of a column among those with role State, if it is one.
fn state_order(model: &Model, column: usize) -> Option<usize> {
    let is_state = |column: &usize| model.columns[*column].role == Role::State;
    is_state(&column).then(|| (0..column).filter(is_state).count())
}

/// Standard deviation of a state in training; NaN where it is not known.
fn training_deviation(model: &Model, column: usize) -> f64 {
    let variance = state_order(model, column).and_then(|i| model.training.state_covariance.get(packed(i, i)));
    variance.map_or(f64::NAN, |variance| variance.sqrt())
}

/// The states that equations advance, in the order of the columns, and their equations.
pub(crate) fn advanced(model: &Model) -> Result<(Vec<State>, Vec<&Equation>), Error> {
    let (mut states, mut equations) = (Vec::new(), Vec::new());
    for (index, column) in model.columns.iter().enumerate() {
        let mut advances = model.equations.iter().filter_map(|equation| {
            let advance = Advance::new(equation.prediction, column.angle)?;
            (equation.subject == column.name).then_some((equation, advance))
        });
        let Some((equation, advance)) = advances.next() else { continue };
        if advances.next().is_some() {
            return Err(Error::Contradiction { state: column.name.clone() });
        }
        let (order, deviation) = (state_order(model, index), training_deviation(model, index));
        let bounded = column.angle || column.rotation.is_some();
        states.push(State { column: index, advance, deviation, order, bounded });
        equations.push(equation);
    }
    Ok((states, equations))
}

/// As [`advanced`], at least one.
pub(crate) fn advanced_states(model: &Model) -> Result<(Vec<State>, Vec<&Equation>), Error> {
    let (states, equations) = advanced(model)?;
    if states.is_empty() { Err(nothing_to_advance(model)) } else { Ok((states, equations)) }
}

/// [`Error::NothingToAdvance`] of a model no equation of which advances a state.
pub fn nothing_to_advance(model: &Model) -> Error {
    let equations = model.equations.iter().map(Equation::label).collect::<Vec<_>>().join(", ");
    Error::NothingToAdvance { equations }
}
