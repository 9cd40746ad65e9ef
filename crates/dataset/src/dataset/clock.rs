//! Requirements of a computation on its rows: time stamps, and the columns that it reads as numbers.

use std::{collections::BTreeSet, sync::Arc};

use fleetfoot_library::Expr;
use fleetfoot_model::{Equation, Model, Prediction, Rule};

/// Need for stamps of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clock {
    /// For rates, and for expressions that read seconds.
    Needed,
    /// For computations on rows alone.
    Dispensable {
        /// True if the computation also reads neighbouring rows, by lags.
        ordered: bool,
    },
}

/// Requirements of expressions on the rows of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reads {
    /// Need for stamps of the rows.
    pub(crate) clock: Clock,
    /// The columns that are read as numbers; states and inputs are, whether they stand here or not.
    pub(crate) numbers: BTreeSet<Arc<str>>,
}

impl Reads {
    /// Columns as they are, beside their stamps: text may be among them.
    pub(crate) fn columns() -> Self {
        Self { clock: Clock::Needed, numbers: BTreeSet::new() }
    }

    /// These columns as numbers, beside their stamps.
    pub(crate) fn numbers<'a>(names: impl IntoIterator<Item = &'a String>) -> Self {
        Self { clock: Clock::Needed, numbers: names.into_iter().map(|name| Arc::from(name.as_str())).collect() }
    }
}

/// A plain regression needs no clock; rates, and whatever reads seconds, do.
pub(crate) fn reads<'a>(equations: &'a [Equation], expressions: impl Iterator<Item = &'a Expr>) -> Reads {
    let (mut timed, mut ordered) = (false, false);
    let mut numbers = BTreeSet::new();
    let targets = equations.iter().filter_map(|equation| equation.target.as_ref());
    for expression in expressions.chain(targets).chain(equations.iter().map(|equation| &equation.right)) {
        timed |= expression.reads_clock();
        ordered |= expression.reads_other_rows();
        numbers.extend(expression.sources());
    }
    let plain = equations.iter().all(|equation| equation.prediction == Prediction::Value);
    let clock = if plain && !timed { Clock::Dispensable { ordered } } else { Clock::Needed };
    Reads { clock, numbers }
}

/// The requirements of a model on its logs.
pub fn reads_of_model(model: &Model) -> Reads {
    let places = model.partitions.iter().filter(|partition| !matches!(partition.rule, Rule::Labels { .. }));
    let partitions = places.flat_map(|partition| &partition.columns);
    reads(&model.equations, model.libraries.iter().flatten().chain(partitions))
}
