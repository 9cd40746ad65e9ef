//! What needs to know when its rows were.

use fleetfoot_library::Expr;
use fleetfoot_model::{Equation, Model, Prediction};

/// Whether rows must have stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clock {
    /// For rates, and for whatever reads seconds.
    Needed,
    /// What is computed of a row needs that row, and the rows before it where there are lags.
    Dispensable,
}

/// A plain regression needs no clock; rates, and whatever reads seconds, do.
pub(super) fn clock<'a>(equations: &[Equation], expressions: impl Iterator<Item = &'a Expr>) -> Clock {
    let plain = |equation: &Equation| {
        equation.prediction == Prediction::Value
            && !equation.right.reads_clock()
            && !equation.target.as_ref().is_some_and(Expr::reads_clock)
    };
    let mut expressions = expressions;
    let timed = expressions.any(Expr::reads_clock);
    if !timed && equations.iter().all(plain) { Clock::Dispensable } else { Clock::Needed }
}

/// What a model needs, as [`clock`].
pub(super) fn clock_of_model(model: &Model) -> Clock {
    let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
    clock(&model.equations, model.libraries.iter().flatten().chain(partitions))
}
