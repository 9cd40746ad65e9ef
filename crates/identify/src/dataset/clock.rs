//! What needs to know when its rows were.

use fleetfoot_library::Expr;
use fleetfoot_model::{Equation, Model, Prediction};

/// Whether rows must have stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clock {
    /// For rates, and for whatever reads seconds.
    Needed,
    /// For what is computed of rows alone.
    Dispensable {
        /// Whether it is computed of neighbouring rows too, by lags.
        ordered: bool,
    },
}

/// A plain regression needs no clock; rates, and whatever reads seconds, do.
pub(crate) fn clock<'a>(equations: &'a [Equation], expressions: impl Iterator<Item = &'a Expr>) -> Clock {
    let (mut timed, mut ordered) = (false, false);
    let targets = equations.iter().filter_map(|equation| equation.target.as_ref());
    for expression in expressions.chain(targets).chain(equations.iter().map(|equation| &equation.right)) {
        timed |= expression.reads_clock();
        ordered |= expression.reads_other_rows();
    }
    let plain = equations.iter().all(|equation| equation.prediction == Prediction::Value);
    if plain && !timed { Clock::Dispensable { ordered } } else { Clock::Needed }
}

/// What a model needs, as [`clock`].
pub(crate) fn clock_of_model(model: &Model) -> Clock {
    let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
    clock(&model.equations, model.libraries.iter().flatten().chain(partitions))
}
