//! States that follow their references at once: the ideal that a simulation is compared with (section 7.2 of *Towards
//! Sim-to-Real via Real-to-Sim*).

use fleetfoot_library::{Expr, Scope};

use crate::Error;

/// A state, or its rate, that equals an expression of recorded columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// The state.
    pub state: String,
    /// True if the expression is the state's rate per second.
    pub rate: bool,
    /// Value at a row, which the state has at the next row.
    pub value: Expr,
}

impl Reference {
    /// Reads `state=expression`, or `d(state)/dt=expression` for a rate, over the columns `names`.
    ///
    /// # Errors
    /// [`Error::Reference`].
    pub fn parse<'a>(text: &str, names: impl Iterator<Item = &'a str>) -> Result<Self, Error> {
        let refused = |problem: String| Error::Reference { text: text.to_owned(), problem };
        let (left, right) =
            text.split_once('=').ok_or_else(|| refused("has no `=`: type STATE=EXPRESSION".to_owned()))?;
        let left = left.trim();
        let rated = left.strip_prefix("d(").and_then(|rest| rest.strip_suffix(")/dt"));
        let value = Expr::parse(right, &Scope::new(names)).map_err(|error| refused(error.to_string()))?;
        Ok(Self { state: rated.unwrap_or(left).trim().to_owned(), rate: rated.is_some(), value })
    }
}
