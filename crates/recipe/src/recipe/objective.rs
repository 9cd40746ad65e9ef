//! Objective of the coefficients: one step, or simulations of several steps.

use std::{
    fmt::{self, Display, Formatter},
    str::FromStr,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Objective that the coefficients minimise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub enum Objective {
    /// `one-step`: the targets of every row, by linear least squares.
    #[default]
    OneStep,
    /// `steps:20`: simulations of so many steps, from the coefficients of one step.
    Steps(u32),
    /// `free-run`: simulations as long as the held-out rows allow.
    FreeRun,
}

/// Largest number of steps of a segment.
pub const MOST_STEPS: u32 = 100_000;

impl FromStr for Objective {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "one-step" => return Ok(Self::OneStep),
            "free-run" => return Ok(Self::FreeRun),
            _ => {}
        }
        let steps = text.strip_prefix("steps:").and_then(|steps| steps.trim().parse().ok());
        let steps = steps.filter(|steps| (1..=MOST_STEPS).contains(steps)).map(Self::Steps);
        steps.ok_or_else(|| {
            format!("objective = \"{text}\": write one-step, free-run, or steps:N with 1 to {MOST_STEPS} steps, such as steps:20")
        })
    }
}

impl Display for Objective {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::OneStep => f.write_str("one-step"),
            Self::Steps(steps) => write!(f, "steps:{steps}"),
            Self::FreeRun => f.write_str("free-run"),
        }
    }
}

impl TryFrom<String> for Objective {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<Objective> for String {
    fn from(objective: Objective) -> Self {
        objective.to_string()
    }
}
