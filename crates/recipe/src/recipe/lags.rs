//! Past rows beside the present one.

use std::{fmt, str::FromStr};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Past rows of every state and input beside the present one: the last L, or every k-th of the last L: k, 2k, ... up to
/// L (*Towards Sim-to-Real via Real-to-Sim*, 5.2.5, data gleaning). The second form reaches as far back with a k-th of
/// the regressors.
///
/// In a recipe `3` or `{ last = 50, every = 5 }`; as a flag and as an argument of Python `3` or `50:5`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Written", into = "Written")]
pub struct Lags {
    last: u32,
    every: u32,
}

/// Written form in a recipe.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number of rows, or { last = 50, every = 5 }")]
enum Written {
    Rows(u32),
    Gleaned(Gleaned),
    Text(String),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Gleaned {
    last: u32,
    every: u32,
}

/// Largest number of rows to look back.
const MOST: u32 = 1_000_000;

impl Lags {
    /// The last `last` rows.
    pub fn rows(last: u32) -> Self {
        Self { last, every: 1 }
    }

    /// Every `every`-th of the `last` rows.
    ///
    /// # Errors
    /// An empty selection, or too many rows.
    pub fn gleaned(last: u32, every: u32) -> Result<Self, String> {
        if every == 0 || last < every {
            return Err(format!(
                "lags: every {every}-th of the last {last} rows selects no row; write an interval from 1 to their number, as in {{ last = 50, every = 5 }}, or 50:5"
            ));
        }
        if last > MOST {
            return Err(format!("lags: {last} rows; write {MOST} at most"));
        }
        Ok(Self { last, every })
    }

    /// Numbers of rows back, ascending, without the present row.
    pub fn steps(self) -> impl Iterator<Item = i32> {
        (1..=self.last / self.every).map(move |step| (step * self.every) as i32)
    }
}

impl TryFrom<Written> for Lags {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        match written {
            Written::Rows(last) if last > MOST => Self::gleaned(last, 1),
            Written::Rows(last) => Ok(Self::rows(last)),
            Written::Gleaned(Gleaned { last, every }) => Self::gleaned(last, every),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<Lags> for Written {
    fn from(lags: Lags) -> Self {
        match lags.every {
            1 => Self::Rows(lags.last),
            every => Self::Gleaned(Gleaned { last: lags.last, every }),
        }
    }
}

impl FromStr for Lags {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            let wrong = |_| {
                format!("lags: `{text}` is not a number of rows; write one, as in 3, or every 5th of the last 50, 50:5")
            };
            text.trim().parse::<u32>().map_err(wrong)
        };
        match text.split_once(':') {
            Some((last, every)) => Self::gleaned(number(last)?, number(every)?),
            None => Written::Rows(number(text)?).try_into(),
        }
    }
}

impl fmt::Display for Lags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.every {
            1 => write!(f, "{}", self.last),
            every => write!(f, "{}:{every}", self.last),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Recipe;

    #[test]
    fn every_way_of_writing_is_one_meaning() {
        let of =
            |text: &str| Recipe::parse(&format!("[model]\nlags = {text}\n"), "test").map(|recipe| recipe.model.lags);
        let gleaned = Lags::gleaned(50, 20).unwrap();
        assert_eq!(gleaned.steps().collect::<Vec<_>>(), [20, 40]);
        for text in ["{ last = 50, every = 20 }", "\"50:20\"", "\" 50 : 20\""] {
            assert_eq!(of(text).unwrap(), Some(gleaned), "{text}");
        }
        assert_eq!((of("3").unwrap(), of("\"3:1\"").unwrap()), (Some(Lags::rows(3)), Some(Lags::rows(3))));
        assert_eq!(Lags::rows(0).steps().count(), 0);
        for lags in [gleaned, Lags::rows(4)] {
            assert_eq!(lags.to_string().parse(), Ok(lags));
            let recipe =
                Recipe { model: crate::ModelSection { lags: Some(lags), ..Default::default() }, ..Recipe::default() };
            assert_eq!(Recipe::parse(&recipe.to_toml(), "again").unwrap(), recipe);
        }
        for (text, word) in [
            ("{ last = 5, every = 0 }", "50:5"),
            ("{ last = 5, every = 6 }", "no row"),
            ("{ last = 5 }", "every"),
            ("\"5:x\"", "`x`"),
            ("2000000", "1000000"),
        ] {
            let message = of(text).unwrap_err().to_string();
            assert!(message.contains(word), "{text}: {message}");
        }
    }
}
