//! Measured derivatives of states.

use fleetfoot_data::setting::{FIT_PWA, FIT_SINDY};
use fleetfoot_library::{CentralDifference, Expr, Spacing, central_difference, mean_slope};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// Measured derivative of a state: `"central"` or `{ over = 20 }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a word, a field or an expression in quotes, or a table { over = ROWS }")]
pub enum Derivative {
    /// `auto`, `central`, `central4`, `central6`, `forward`, `backward`, or a field or expression.
    Text(String),
    /// The mean slope over a span.
    Span(SpanDerivative),
}

/// The mean slope over a span of rows ahead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpanDerivative {
    /// Number of rows ahead.
    pub over: Over,
}

/// Number of rows ahead that a mean slope reaches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number of rows, or \"auto\"")]
pub enum Over {
    /// Given number of rows.
    Rows(u32),
    /// `auto`: the number that rollouts of held-out spans choose.
    Word(String),
}

/// Largest span in rows: the wrapped steps of an angle are summed one by one.
const MOST_ROWS: u32 = 1000;

impl Derivative {
    /// Derivative of the text of a flag: `over:20`, `over:auto`, else as in a recipe.
    pub fn parse(text: &str) -> Self {
        let Some(over) = text.strip_prefix("over:").map(str::trim) else { return Self::Text(text.to_owned()) };
        let over = over.parse().map_or_else(|_| Over::Word(over.to_owned()), Over::Rows);
        Self::Span(SpanDerivative { over })
    }

    /// True for the word of a difference, false for a field or expression.
    pub fn is_word(text: &str) -> bool {
        ["auto", "central", "central4", "central6", "forward", "backward"].contains(&text)
    }

    /// Mean slope to `rows` rows ahead.
    pub fn over(rows: u32) -> Self {
        Self::Span(SpanDerivative { over: Over::Rows(rows) })
    }

    /// True for a span that rollouts choose.
    pub fn is_open(&self) -> bool {
        matches!(self, Self::Span(SpanDerivative { over: Over::Word(word) }) if word == "auto")
    }

    /// Central difference that a word names; the lowest order where the data choose it.
    pub fn central(derivative: Option<&Self>, of: &Expr, angle: bool) -> Option<CentralDifference> {
        let (reach, spacing) = match derivative {
            None => (1, Spacing::Even),
            Some(Self::Text(word)) => match word.as_str() {
                "auto" | "central" => (1, Spacing::Even),
                "central4" => (2, Spacing::Stamps),
                "central6" => (3, Spacing::Stamps),
                _ => return None,
            },
            Some(Self::Span(_)) => return None,
        };
        Some(CentralDifference { of: of.clone(), angle, reach, spacing })
    }

    /// True where the data choose the order of the central difference.
    pub fn is_any_order(derivative: Option<&Self>) -> bool {
        derivative.is_none_or(|derivative| matches!(derivative, Self::Text(word) if word == "auto"))
    }

    /// Derivative of a chosen span: a number of rows, or a central difference.
    pub fn settled(x: &Expr, angle: bool, over: Option<u32>) -> Expr {
        over.map_or_else(|| central_difference(x, angle), |rows| mean_slope(x, rows, angle))
    }
}

impl SpanDerivative {
    /// Rows of the span.
    ///
    /// # Errors
    /// A number out of range, or a span that is not chosen yet.
    pub fn rows(&self, place: &str) -> Result<u32, Error> {
        match &self.over {
            Over::Rows(rows) if (1..=MOST_ROWS).contains(rows) => Ok(*rows),
            Over::Rows(rows) => Err(Error::value(format!(
                "{place} derivative = {{ over = {rows} }}: write 1 to {MOST_ROWS} rows, or \"auto\""
            ))),
            Over::Word(word) if word == "auto" => Err(Error::value(format!(
                "{place} derivative = {{ over = \"auto\" }}: {FIT_PWA} and {FIT_SINDY} choose a span, from logs; write a number of rows here"
            ))),
            Over::Word(word) => Err(Error::value(format!(
                "{place} derivative = {{ over = \"{word}\" }}: write a number of rows, or \"auto\""
            ))),
        }
    }
}
