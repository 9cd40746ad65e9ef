//! Errors of predicting, scoring and rolling out.

use fleetfoot_data::Cancelled;
use fleetfoot_library::UnknownColumn;

/// Why a model could not be run on a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Rows could not be read, or the user stopped the work.
    #[error(transparent)]
    Data(#[from] fleetfoot_data::Error),
    /// An expression of the model reads a column that is not there.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// The parts of the model do not fit together.
    #[error("the model contradicts itself: {0}; fit it again")]
    Inconsistent(String),
    /// A model of given equations only.
    #[error(
        "all equations of the model are given and none is fitted, so there is nothing to score or predict one step ahead: look at its rollouts"
    )]
    NothingFitted,
    /// No equation advances a state.
    #[error(
        "no equation of the model advances a state ({equations}): a rollout needs the derivative, the next value or the difference of at least one column; fit with such a target"
    )]
    NothingToAdvance {
        /// The left sides that there are.
        equations: String,
    },
    /// Two equations for one state.
    #[error("two equations advance `{state}`, and a rollout needs exactly one: remove the other")]
    Contradiction {
        /// The state.
        state: String,
    },
    /// A right side reads a latent at another row.
    #[error(transparent)]
    LaggedLatent(#[from] fleetfoot_model::LaggedLatent),
    /// The model needs a simulated value before it is computed.
    #[error(
        "the model uses `{state}` {ahead} rows ahead; in a rollout that value is not known yet; fit with lags instead of leads"
    )]
    FutureState {
        /// The state.
        state: String,
        /// Rows ahead.
        ahead: i32,
    },
    /// The tangents of a first-order lag inside of a simulation are not known.
    #[error(
        "the model reads {column}, a first-order lag of a simulated value, and derivatives through it are not supported: fit it one step ahead (objective = \"one-step\"), or make the lag a measured column"
    )]
    SimulatedLag {
        /// The lag.
        column: String,
    },
    /// A column that follows from simulated ones cannot be computed in time.
    #[error(transparent)]
    Closed(#[from] fleetfoot_model::ClosedError),
    /// A reference that cannot be followed.
    #[error("the reference `{text}` {problem}")]
    Reference {
        /// The reference.
        text: String,
        /// The fault, as the end of a sentence.
        problem: String,
    },
    /// No episode is long enough for the horizon.
    #[error(
        "no episode is long enough: a rollout of {horizon} steps needs {needed} consecutive rows, the longest episode{} has {longest}; choose a shorter horizon",
        .episode.as_ref().map(|name| format!(" ({name})")).unwrap_or_default()
    )]
    TooShort {
        /// Requested steps.
        horizon: usize,
        /// Rows that they need, history included.
        needed: usize,
        /// Rows of the longest episode.
        longest: usize,
        /// Its name.
        episode: Option<String>,
    },
    /// A requested start that is not in the recording, or too near to a border.
    #[error(
        "a rollout cannot start at row {row} of episode {episode}: it needs {before} rows before and {after} after, the episode has {rows} rows"
    )]
    BadStart {
        /// The episode's name, or its number.
        episode: String,
        /// The row.
        row: usize,
        /// Rows of history needed.
        before: usize,
        /// Rows needed after the start.
        after: usize,
        /// Rows there are.
        rows: usize,
    },
    /// Every start has missing values.
    #[error(
        "all {starts} starts have missing values in the {needed} rows that they need; choose a shorter horizon or fill the gaps"
    )]
    MissingValues {
        /// Starts tried.
        starts: usize,
        /// Rows each needs.
        needed: usize,
    },
    /// Nowhere to begin a free run.
    #[error(
        "no row of {episodes} episodes can start a free run: it needs {needed} consecutive rows with all values, the longest episode has {longest}; fill the gaps, or give longer episodes"
    )]
    NoCompleteRow {
        /// Episodes tried.
        episodes: usize,
        /// Consecutive rows that the shortest run needs.
        needed: usize,
        /// Rows of the longest episode.
        longest: usize,
    },
    /// A plane that nothing can be projected onto.
    #[error("a plane cannot be made: {0}")]
    Plane(String),
    /// Nothing to simulate.
    #[error("the horizon is 0 steps; ask for at least one")]
    NoHorizon,
    /// A step that is not a positive number of seconds.
    #[error("a step of {0} s; the step must be a positive number of seconds")]
    BadStep(f64),
    /// The times of a simulation cannot be followed.
    #[error("t[{place}]: {problem}; give the times of the simulation in seconds, rising, the first one that of x0")]
    Times {
        /// Index among the times.
        place: usize,
        /// The problem there, in words.
        problem: String,
    },
    /// The times of a simulation are not a row apart, of a model that goes by rows.
    #[error(
        "t[{place}] comes {interval} s after the time before, and the rows of the model are {period} s apart: {reason}; give times that are {period} s apart and keep those that you want, or fit derivatives"
    )]
    OtherPeriod {
        /// Index among the times.
        place: usize,
        /// Seconds since the time before.
        interval: f64,
        /// Seconds from row to row.
        period: f64,
        /// Why the model goes by rows.
        reason: &'static str,
    },
    /// A controller does not fit the model.
    #[error("the controller's column `{column}` {problem}")]
    Controller {
        /// The column that it names.
        column: String,
        /// The problem with it, in words.
        problem: String,
    },
    /// A controller's parameter cannot be used.
    #[error("the controller's {0}")]
    Parameter(#[from] crate::parameter_error::ParameterError),
}

impl From<Cancelled> for Error {
    fn from(cancelled: Cancelled) -> Self {
        Error::Data(cancelled.into())
    }
}
