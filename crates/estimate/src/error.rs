//! Errors of nonlinear estimation.

use fleetfoot_data::setting::{DEGREE, EVERY, LIBRARY, SMOOTH_STATES};
use fleetfoot_data::{Cancelled, Error};
use fleetfoot_library::{FilterError, UnknownColumn};

/// Why parameters cannot be estimated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EstimateError {
    /// A problem needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// Nothing to estimate.
    #[error("there are no parameters: name those that the models use, with an initial value each")]
    NoParameters,
    /// Two parameters of one name, or a parameter with the name of a column.
    #[error("the name `{name}` is taken by {by}: give the parameter another")]
    NameTaken {
        /// The name.
        name: String,
        /// Source of the name.
        by: &'static str,
    },
    /// A parameter that no model has.
    #[error("no model uses the parameter `{name}`: remove it, or correct its name in the models")]
    Unused {
        /// The parameter.
        name: String,
    },
    /// A parameter within a lag or a difference.
    #[error(
        "residual `{residual}` uses the parameter `{name}` at another row: parameters are constant; write `{name}` without a lag"
    )]
    Lagged {
        /// The residual.
        residual: String,
        /// The parameter.
        name: String,
    },
    /// An initial value that is not a number between the bounds.
    #[error(
        "the initial value of the parameter `{name}` is {initial}, and its bounds are {low} and {high}: choose a finite value between them"
    )]
    Initial {
        /// The parameter.
        name: String,
        /// Its initial value.
        initial: f64,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// Entries that are no symmetric matrix of the parameters.
    #[error(
        "limit `{name}`: give 1, 3, 6, 10, ... known parameters, the lower triangle of a symmetric matrix, and a finite bound"
    )]
    NoMatrix {
        /// The limit.
        name: String,
    },
    /// Initial values that do not keep a limit strictly.
    #[error(
        "limit `{name}`: the initial values are {beyond} beyond its bound, or at it: choose initial values whose eigenvalues lie strictly within the bound"
    )]
    Outside {
        /// The limit.
        name: String,
        /// By how much.
        beyond: f64,
    },
    /// A weight that is negative or not finite.
    #[error("the weight of residual `{residual}` is {weight}: give a finite weight, 0 or more")]
    Weight {
        /// The residual.
        residual: String,
        /// Its weight.
        weight: f64,
    },
    /// An option out of its range.
    #[error("{option} is {value}: {allowed}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// The allowed values, in words.
        allowed: &'static str,
    },
    /// A model has no finite value where the iteration begins.
    #[error(
        "a model or its derivative is not finite at the initial values, at row {} of episode {episode}: choose other initial values, or leave out such rows",
        row + 1
    )]
    NotFinite {
        /// The episode's name.
        episode: String,
        /// The first such row.
        row: usize,
    },
    /// Fewer numbers than parameters.
    #[error(
        "{residuals} residuals at complete rows do not determine {parameters} parameters: give more rows, or fewer parameters"
    )]
    TooFewRows {
        /// Residuals times rows.
        residuals: u64,
        /// Parameters.
        parameters: usize,
    },
    /// A simulation that diverges where the iteration begins.
    #[error(
        "the simulation from row {} of episode {episode} diverges at the initial values: choose other initial values, or shorter segments",
        row + 1
    )]
    Diverges {
        /// The episode's name.
        episode: String,
        /// The first row of the segment.
        row: usize,
    },
    /// Segments whose rows lack values.
    #[error("{}", no_segment(*segments))]
    NoSegment {
        /// Number of segments.
        segments: usize,
    },
    /// An output that is not among the states.
    #[error("the output `{name}` is no state that the equations advance: choose from {states}")]
    NoState {
        /// The given name.
        name: String,
        /// The states.
        states: String,
    },
    /// Gains of other outputs.
    #[error(
        "{gains} gains are given and {outputs} states are compared with their measurements: give one gain for each state"
    )]
    GainCount {
        /// Gains.
        gains: usize,
        /// Outputs.
        outputs: usize,
    },
    /// A delay that may take any time.
    #[error(
        "the memory of `{filter}` has no bound: give its parameters finite bounds, which tell how many earlier rows it needs"
    )]
    Delay {
        /// The delay.
        filter: String,
    },
    /// A target without functions.
    #[error("the target `{target}` has no candidate functions: name at least one")]
    NoFunctions {
        /// The target.
        target: String,
    },
    /// More products of coefficients than a simulation error is minimised over.
    #[error(
        "{count} products of the coefficients that one latent has in one region are too many for a fit by simulation error, which takes {most} at most: offer fewer candidates, or fit one step ahead (objective = \"one-step\")"
    )]
    TooManyCoefficients {
        /// Number of products.
        count: usize,
        /// The largest number allowed.
        most: usize,
    },
    /// A model whose equations look back: the rows of a grid would not be its own.
    #[error(
        "the model reads {rows} earlier rows, and only models without lags can follow a recording: fit derivatives or next values without lags"
    )]
    LooksBack {
        /// Number of rows.
        rows: usize,
    },
    /// A filter of simulated values, which are not recorded.
    #[error(
        "the model filters a simulated value (`{filter}`), and only models without such filters can follow a recording: fit without it"
    )]
    Filtered {
        /// The filter.
        filter: String,
    },
    /// Derivatives and next values in one model.
    #[error(
        "the model gives the derivative of `{derivative}` and the next value of `{next}`: fit all states to one kind of target"
    )]
    MixedSteps {
        /// A state whose derivative is given.
        derivative: String,
        /// One whose next value is.
        next: String,
    },
    /// A free input that the model does not have.
    #[error("`{name}` cannot be free, as it is no input of the model{near}; choose from {inputs}")]
    NoInput {
        /// The given name.
        name: String,
        /// The model's inputs.
        inputs: String,
        /// A similar name, as a suggestion.
        near: String,
    },
    /// A column that is not followed.
    #[error("`{name}` is neither a state that the equations advance nor a free input: choose from {columns}")]
    NotFollowed {
        /// The given name.
        name: String,
        /// The columns that are followed.
        columns: String,
    },
    /// Bounds in the wrong order.
    #[error("the bounds of `{name}` are {low} and {high}: write the lower bound first, and two different values")]
    Bounds {
        /// The column.
        name: String,
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// An episode that does not fit into memory.
    #[error(
        "episode {episode} has {rows} rows on the grid, and {most} fit into memory: follow every {every}th row ({given_every}), or split the log", given_every = EVERY.to(every)
    )]
    TooLong {
        /// The episode's name.
        episode: String,
        /// Its rows on the grid.
        rows: usize,
        /// Rows that fit.
        most: usize,
        /// A grid that fits.
        every: usize,
    },
    /// Recordings that do not fit into memory as a whole.
    #[error(
        "{rows} rows of {states} states are smoothed in memory, which has room for {most}: give fewer or shorter logs, or leave the states as they are ({given_smooth_states})", given_smooth_states = SMOOTH_STATES.to("off")
    )]
    TooManyRowsToSmooth {
        /// Rows of all episodes.
        rows: usize,
        /// States.
        states: usize,
        /// Rows that fit.
        most: usize,
    },
    /// More coefficients than states are smoothed with.
    #[error(
        "{count} candidates of all equations together are too many to smooth states with, which takes {most} at most: name fewer candidates ({LIBRARY}, {DEGREE}), or leave the states as they are ({given_smooth_states})", given_smooth_states = SMOOTH_STATES.to("off")
    )]
    TooManyToSmooth {
        /// Number of candidates.
        count: usize,
        /// The largest number allowed.
        most: usize,
    },
    /// A latent that is not a summand of one derivative.
    #[error(
        "`{latent}` is not added to a derivative: smoothing of states needs equations of known terms plus the unknown function"
    )]
    NotAdditive {
        /// The latent.
        latent: String,
    },
    /// An angle that leaves the turn in which it is recorded.
    #[error(
        "the angle `{state}` turns over in episode {episode}: smoothed angles are continuous, and candidates read them within one turn; leave the states as they are ({given_smooth_states})", given_smooth_states = SMOOTH_STATES.to("off")
    )]
    AngleTurns {
        /// The state.
        state: String,
        /// The episode.
        episode: String,
    },
    /// No episode has the needed columns.
    #[error(
        "none of {episodes} episodes can be followed: each lacks all values of one of {columns}, or has fewer than two rows of the grid"
    )]
    NothingToFollow {
        /// Number of episodes.
        episodes: usize,
        /// The columns that are followed.
        columns: String,
    },
    /// A model has no finite value along the recording.
    #[error(
        "the model or its derivative is not finite along episode {episode}: leave the episode out, or bound the divisors of the model"
    )]
    NotFollowable {
        /// The episode's name.
        episode: String,
    },
    /// The interior-point solver refuses a program.
    #[error("the interior-point solver refuses the program of a step: {reason}")]
    Program {
        /// The solver's message.
        reason: String,
    },
    /// The factorisation of the Jacobian failed.
    #[error("the derivatives are too large to be factored: choose other units or initial values")]
    Overflow,
    /// A model cannot be simulated on the source.
    #[error(transparent)]
    Dynamics(#[from] fleetfoot_dynamics::Error),
    /// The source has no such column.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// A filter that cannot be.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The source cannot be read.
    #[error(transparent)]
    Data(#[from] Error),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

fn no_segment(segments: usize) -> String {
    match segments {
        0 => "no episode has two rows, so nothing can be simulated: give longer logs, or look at their stamps (fleetfoot info)".to_owned(),
        1 => "the only segment lacks an initial state or an input: prepare the logs, or choose shorter segments".to_owned(),
        segments => format!(
            "all {segments} segments lack an initial state or an input: prepare the logs, or choose shorter segments"
        ),
    }
}
