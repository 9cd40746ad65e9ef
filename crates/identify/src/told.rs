//! Parts of reports that programs are told otherwise than they are kept.

use fleetfoot_data::Work;
use fleetfoot_sparse::{Certificate, narx::NarxOrder};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

/// A part of a report as a tree of values.
pub(crate) fn value(told: impl Serialize) -> Value {
    serde_json::to_value(told).expect("keys of reports are text, and nothing else can fail in memory")
}

/// Numbers of a report that is read again: one that is none was told as `null`.
pub(crate) fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    Ok(Vec::<Option<f64>>::deserialize(deserializer)?.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}

/// The same of one number.
pub(crate) fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

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

/// The decoded columns of robots' logs: their bytes, and whether the cache has them already.
pub(crate) fn decoded<S: Serializer>(decoded: &Option<(u64, bool)>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Told {
        decoded_bytes: Option<u64>,
        cached: Option<bool>,
    }
    let told = Told { decoded_bytes: decoded.map(|(bytes, _)| bytes), cached: decoded.map(|(_, cached)| cached) };
    told.serialize(serializer)
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
    struct Told {
        kkt: f64,
        gap: f64,
        objective: f64,
    }
    Told { kkt: certificate.kkt, gap: certificate.gap, objective: certificate.objective }.serialize(serializer)
}

/// The coefficient that changes most, and its change.
pub(crate) fn largest_change<S: Serializer>(change: &Option<(String, f64)>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Told<'a> {
        coefficient: &'a str,
        standard_errors: f64,
    }
    let told = change.as_ref().map(|(coefficient, errors)| Told { coefficient, standard_errors: *errors });
    told.serialize(serializer)
}
