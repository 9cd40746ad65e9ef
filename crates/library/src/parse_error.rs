//! Parse errors: the place, the problem and the remedy.

use std::fmt;

use fleetfoot_data::{did_you_mean, nearest};

use crate::limits::{MAX_DEPTH, MAX_FUNCTIONS, MAX_SIZE, MAX_TEXT};

/// Why and where a text is not an expression.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParseError {
    detail: Box<Detail>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Detail {
    text: String,
    position: usize,
    alias: Option<String>,
    kind: ParseErrorKind,
}

/// Causes of a [`ParseError`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseErrorKind {
    /// Something else should stand here.
    #[error("expected {expected}, found {actual}")]
    Expected {
        /// Syntax that is valid at this position.
        expected: &'static str,
        /// Text at this position.
        actual: String,
    },
    /// A name that is neither a column nor an alias.
    #[error("unknown column or alias `{name}`{}{}", did_you_mean(nearest), topic_hint(name))]
    UnknownName {
        /// The name.
        name: String,
        /// Names that resemble it.
        nearest: Vec<String>,
    },
    /// A function that does not exist.
    #[error("unknown function `{name}`{}", did_you_mean(nearest))]
    UnknownFunction {
        /// The name.
        name: String,
        /// Names that resemble it.
        nearest: Vec<String>,
    },
    /// The wrong number of arguments.
    #[error("`{function}` takes {expected} argument(s), here it has {actual}")]
    Arguments {
        /// The function.
        function: String,
        /// Number of arguments that the function takes.
        expected: usize,
        /// Number of arguments in the text.
        actual: usize,
    },
    /// The constant of a filter that is not one.
    #[error("the second argument of `{function}` does not change with time: write it with numbers and parameters")]
    NotConstant {
        /// The filter.
        function: &'static str,
    },
    /// A filter whose definition is too long for a name.
    #[error(
        "this `{function}` is too large: filters nest at most 8 levels deep, and have at most {} bytes, aliases written out",
        crate::Filter::MAX_NAME
    )]
    FilterTooLarge {
        /// The filter.
        function: &'static str,
    },
    /// A vector or a quaternion whose components are not there.
    #[error(
        "`{prefix}` has no components {components} (as `.x`, `_x` or `x` behind the name){}",
        did_you_mean(nearest)
    )]
    NoComponents {
        /// The common beginning of the names.
        prefix: String,
        /// The components that are needed.
        components: String,
        /// Names that resemble its first component.
        nearest: Vec<String>,
    },
    /// An alias that is defined by itself.
    #[error("the alias `{name}` is defined by itself, directly or through others")]
    Circular {
        /// The alias.
        name: String,
    },
    /// Too many parentheses, signs or exponents inside each other.
    #[error("nested more than {MAX_DEPTH} levels deep")]
    TooDeep,
    /// Too much text, or too large an expression once the aliases are written out.
    #[error(
        "too long: an expression may have {MAX_TEXT} bytes and, with its aliases written out, {MAX_SIZE} terms and operations"
    )]
    TooLarge,
    /// A library beyond [`MAX_FUNCTIONS`] candidate functions.
    #[error(
        "this library has {} candidate functions, at most {MAX_FUNCTIONS} are possible; lower the degree or the number of lags, or \
         name fewer variables",
        functions.map_or("more than 2^64".to_owned(), |functions| functions.to_string())
    )]
    TooManyFunctions {
        /// Number of functions in the library; `None` if it exceeds 64 bits.
        functions: Option<usize>,
    },
    /// A candidate function that is zero or not a number everywhere.
    #[error("this is {value} everywhere, which is no candidate function")]
    NoFunction {
        /// Value to which the candidate simplifies.
        value: String,
    },
    /// A library of the variables where there are none.
    #[error("there are no variables for this library to range over; name some, as in `poly(2, [x, y])`")]
    NoVariables,
}

impl ParseError {
    pub(crate) fn new(text: &str, position: usize, kind: ParseErrorKind) -> Self {
        Self { detail: Box::new(Detail { text: text.to_owned(), position, alias: None, kind }) }
    }

    /// The byte of the text where the parser stopped.
    pub fn position(&self) -> usize {
        self.detail.position
    }

    /// Cause of the error.
    pub fn kind(&self) -> &ParseErrorKind {
        &self.detail.kind
    }

    /// The whole text.
    pub fn text(&self) -> &str {
        &self.detail.text
    }

    /// The alias whose text it is, if any.
    pub fn alias(&self) -> Option<&str> {
        self.detail.alias.as_deref()
    }

    /// With these names too among those that an unknown one may have meant.
    pub(crate) fn with_names(mut self, names: &[&str]) -> Self {
        use ParseErrorKind::{UnknownFunction, UnknownName};
        if let UnknownName { name, nearest: known } | UnknownFunction { name, nearest: known } = &mut self.detail.kind {
            let before = std::mem::take(known);
            *known = nearest(name, before.iter().map(String::as_str).chain(names.iter().copied()));
        }
        self
    }

    pub(crate) fn in_alias(mut self, alias: String) -> Self {
        self.detail.alias = Some(alias);
        self
    }
}

impl std::error::Error for ParseError {}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Detail { text, position, alias, kind } = &*self.detail;
        let (before, after) = text.split_at(*position);
        let column = before.chars().count();
        // A long text is shown around the place.
        let skipped = column.saturating_sub(40);
        let shown: String = before.chars().skip(skipped).chain(after.chars().take(40)).collect();
        let (head, tail) =
            (if skipped > 0 { "..." } else { "" }, if after.chars().nth(40).is_some() { "..." } else { "" });
        match alias {
            Some(alias) => write!(f, "in the alias `{alias}` = `{head}{shown}{tail}`")?,
            None => write!(f, "in `{head}{shown}{tail}`")?,
        }
        write!(f, ", character {}: {kind}", column + 1)
    }
}

fn topic_hint(name: &str) -> &'static str {
    if name.starts_with('/') && name[1..].contains(['/', '-']) {
        "; after a topic's field, `-` and `/` need a space in front to be operators"
    } else {
        ""
    }
}
