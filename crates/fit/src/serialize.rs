//! Parts of reports that are written otherwise than they are kept.

use fleetfoot_data::Work;
use fleetfoot_sparse::{Certificate, narx::NarxOrder};
use serde::{Serialize, Serializer};

/// Rows that were left out: at borders, incomplete ones and, where there are regions, those that none took.
pub(crate) fn left_out<S: Serializer>(rows: &[u64], serializer: S) -> Result<S::Ok, S::Error> {
    let keys = ["rows_at_border", "rows_incomplete", "rows_unassigned"];
    serializer.collect_map(keys.iter().zip(rows))
}

/// Functions and their coefficients along something.
#[derive(Serialize)]
pub(crate) struct Along<'a> {
    function: &'a str,
    coefficients: &'a [f64],
}

pub(crate) fn functions(functions: &[(String, Vec<f64>)]) -> Vec<Along<'_>> {
    functions.iter().map(|(function, coefficients)| Along { function, coefficients }).collect()
}

pub(crate) fn along<S: Serializer>(along: &[(String, Vec<f64>)], serializer: S) -> Result<S::Ok, S::Error> {
    functions(along).serialize(serializer)
}

/// Multiplications that lie ahead.
pub(crate) fn operations<S: Serializer>(work: &Work, serializer: S) -> Result<S::Ok, S::Error> {
    work.operations.serialize(serializer)
}

#[derive(Serialize)]
pub(crate) struct Order {
    lags_out: usize,
    lags_in: usize,
    /// Rows between past values, where these do not follow one another.
    #[serde(skip_serializing_if = "Option::is_none")]
    every: Option<usize>,
    degree: usize,
}

impl From<NarxOrder> for Order {
    fn from(order: NarxOrder) -> Self {
        let every = (order.every > 1).then_some(order.every);
        Self { lags_out: order.outputs, lags_in: order.inputs, every, degree: order.degree }
    }
}

/// The order of a model that was tried, and beside it whether inputs act at once.
pub(crate) fn tried_order<S: Serializer>(order: &NarxOrder, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Tried {
        order: Order,
        direct: bool,
    }
    Tried { order: (*order).into(), direct: order.direct }.serialize(serializer)
}

pub(crate) fn certificate<S: Serializer>(certificate: &Certificate, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Content {
        kkt: f64,
        gap: f64,
        objective: f64,
    }
    Content { kkt: certificate.kkt, gap: certificate.gap, objective: certificate.objective }.serialize(serializer)
}

/// The coefficient that changes most, and its change.
pub(crate) fn largest_change<S: Serializer>(change: &Option<(String, f64)>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Content<'a> {
        coefficient: &'a str,
        standard_errors: f64,
    }
    let changed = change.as_ref().map(|(coefficient, errors)| Content { coefficient, standard_errors: *errors });
    changed.serialize(serializer)
}
