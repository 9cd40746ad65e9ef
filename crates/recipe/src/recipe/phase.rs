//! A phase along which regions are counted.

use std::{
    fmt::{self, Display, Formatter},
    str::FromStr,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Phase along which regions are counted, a quantity that repeats from stride to stride.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub enum PhaseColumn {
    /// `alpha_l`, `alpha_l:24`: a periodic column or expression, in so many bins.
    Cyclic {
        /// Column or expression.
        column: String,
        /// Number of equal bins of a period.
        bins: usize,
    },
    /// `labels:stance`: the values of a column.
    Labels(String),
}

/// Default and largest number of bins.
const BINS: usize = 12;
const MOST_BINS: usize = 360;

impl FromStr for PhaseColumn {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refused = || {
            format!(
                "phase = \"{text}\": write COLUMN, COLUMN:BINS with 2 to {MOST_BINS} bins, such as alpha_l:24, or labels:COLUMN"
            )
        };
        let named =
            |column: &str| Some(column.trim().to_owned()).filter(|column| !column.is_empty()).ok_or_else(refused);
        if let Some(column) = text.strip_prefix("labels:") {
            return Ok(Self::Labels(named(column)?));
        }
        // A colon may be part of a column's name if no number follows it.
        match text.rsplit_once(':').and_then(|(column, bins)| Some((column, bins.trim().parse::<i64>().ok()?))) {
            Some((column, bins)) => match usize::try_from(bins) {
                Ok(bins) if (2..=MOST_BINS).contains(&bins) => Ok(Self::Cyclic { column: named(column)?, bins }),
                _ => Err(refused()),
            },
            None => Ok(Self::Cyclic { column: named(text)?, bins: BINS }),
        }
    }
}

impl Display for PhaseColumn {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cyclic { column, bins } => write!(f, "{column}:{bins}"),
            Self::Labels(column) => write!(f, "labels:{column}"),
        }
    }
}

impl TryFrom<String> for PhaseColumn {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<PhaseColumn> for String {
    fn from(phase: PhaseColumn) -> Self {
        phase.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_written() {
        let cyclic = |column: &str, bins| PhaseColumn::Cyclic { column: column.into(), bins };
        for (text, expected, again) in [
            ("alpha_l", cyclic("alpha_l", 12), "alpha_l:12"),
            ("alpha_l:24", cyclic("alpha_l", 24), "alpha_l:24"),
            ("/gait:phase", cyclic("/gait:phase", 12), "/gait:phase:12"),
            ("wrap(a - b):2", cyclic("wrap(a - b)", 2), "wrap(a - b):2"),
            ("labels:stance", PhaseColumn::Labels("stance".into()), "labels:stance"),
        ] {
            let phase: PhaseColumn = text.parse().unwrap();
            assert_eq!((&phase, phase.to_string().as_str()), (&expected, again));
            assert_eq!(again.parse(), Ok(expected));
        }
        for text in ["", "q:1", "q:361", "q:-3", ":8", "labels:", "labels: "] {
            let error = text.parse::<PhaseColumn>().unwrap_err();
            assert!(error.contains("2 to 360 bins") && error.contains("labels:COLUMN"), "{error}");
        }
    }
}
