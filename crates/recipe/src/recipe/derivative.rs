//! How the derivative of a state is measured.

use fleetfoot_data::setting::{FIT_PWA, FIT_SINDY};
use fleetfoot_library::{CentralDifference, Expr, Spacing, central_difference, mean_slope};
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// How the derivative of a state is measured: `"central"` or `{ over = 20 }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a word, a field or an expression in quotes, or a table { over = ROWS }")]
pub enum Derivative {
    /// `auto`, `central`, `central4`, `central6`, `forward`, `backward`, or a field or expression.
    Text(String),
    /// The mean slope over a span.
    Span(SpanDerivative),
}

/// The mean slope over a span of rows ahead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpanDerivative {
    /// How many rows ahead.
    pub over: Over,
}

/// How many rows ahead a mean slope reaches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number of rows, or \"auto\"")]
pub enum Over {
    /// So many.
    Rows(u32),
    /// `auto`: chosen by rollouts of held-out spans.
    Word(String),
}

/// Rows that a span may have: the wrapped steps of an angle are summed one by one.
const MOST_ROWS: u32 = 1000;

impl Derivative {
    /// What the text of a flag says: `over:20`, `over:auto`, else as in a recipe.
    pub fn parse(text: &str) -> Self {
        let Some(over) = text.strip_prefix("over:").map(str::trim) else { return Self::Text(text.to_owned()) };
        let over = over.parse().map_or_else(|_| Over::Word(over.to_owned()), Over::Rows);
        Self::Span(SpanDerivative { over })
    }

    /// Whether a text is a word for a difference, and no field or expression.
    pub fn is_word(text: &str) -> bool {
        ["auto", "central", "central4", "central6", "forward", "backward"].contains(&text)
    }

    /// The mean slope to so many rows ahead.
    pub fn over(rows: u32) -> Self {
        Self::Span(SpanDerivative { over: Over::Rows(rows) })
    }

    /// Whether its span is to be chosen by rollouts.
    pub fn is_open(&self) -> bool {
        matches!(self, Self::Span(SpanDerivative { over: Over::Word(word) }) if word == "auto")
    }

    /// The difference that a word names, where it names a central one; of several orders the lowest until the data are seen.
    pub fn central(said: Option<&Self>, of: &Expr, angle: bool) -> Option<CentralDifference> {
        let (reach, spacing) = match said {
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

    /// Whether the data may choose the order of the central difference.
    pub fn is_any_order(said: Option<&Self>) -> bool {
        said.is_none_or(|said| matches!(said, Self::Text(word) if word == "auto"))
    }

    /// What an open span stands for once it is settled: so many rows, or a central difference.
    pub fn settled(x: &Expr, angle: bool, over: Option<u32>) -> Expr {
        over.map_or_else(|| central_difference(x, angle), |rows| mean_slope(x, rows, angle))
    }
}

impl SpanDerivative {
    /// How many rows the span has.
    ///
    /// # Errors
    /// A number out of range, or an open span.
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
