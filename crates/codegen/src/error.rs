//! Why a model cannot be exported.

use fleetfoot_library::UnknownColumn;

/// Why a model cannot be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The parts of the model do not fit together.
    #[error("the model contradicts itself: {0}; fit it again")]
    Inconsistent(String),
    /// An expression of the model reads a column that is not there.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// Nothing to compute.
    #[error("the model has no equation; fit one with a target")]
    NoEquations,
    /// Two equations for one state.
    #[error("two equations advance `{state}`; code needs exactly one")]
    Contradiction {
        /// The state.
        state: String,
    },
    /// A right side reads a latent at another row.
    #[error(transparent)]
    LaggedLatent(#[from] fleetfoot_model::LaggedLatent),
    /// A column that follows from the states cannot be computed in time.
    #[error(transparent)]
    Closed(#[from] fleetfoot_model::ClosedError),
    /// The model looks into the future.
    #[error(
        "the model reads `{column}` {ahead} rows ahead, which code on a robot cannot know (only a discrete model is given the inputs of its next row); fit with lags instead of leads"
    )]
    Ahead {
        /// The column.
        column: String,
        /// Rows ahead.
        ahead: u32,
    },
    /// A number that is not finite.
    #[error("a number of the model is {value} ({place}); fit it again without the column that causes it")]
    NotFinite {
        /// The value.
        value: f64,
        /// Its place.
        place: String,
    },
    /// A number that does not fit into 32 bits.
    #[error("{value:e} does not fit into 32 bits ({place}); export with double precision, or fit in other units")]
    TooLarge {
        /// The value.
        value: f64,
        /// Its place.
        place: String,
    },
    /// More regions than codes.
    #[error("the model has {regions} regions, and code has at most {most}; fit with fewer")]
    TooManyRegions {
        /// Regions of the model.
        regions: usize,
        /// The most there may be.
        most: usize,
    },
    /// A part of the model that a network of ONNX does not have.
    #[error("ONNX networks cannot have {part}; {remedy}")]
    Unwritable {
        /// The part.
        part: String,
        /// Advice: another model or another format.
        remedy: &'static str,
    },
    /// A step that is not positive.
    #[error("a step of {0} s; the step must be a positive number of seconds")]
    Step(f64),
    /// Nothing to discretise.
    #[error("the model predicts next values, so it has a step already; remove the step of the discretisation")]
    AlreadyDiscrete,
    /// A prefix that cannot begin an identifier.
    #[error("the prefix `{prefix}` {problem}; choose a word such as `drag`")]
    Prefix {
        /// The prefix.
        prefix: String,
        /// The problem with it, in words.
        problem: &'static str,
    },
}
