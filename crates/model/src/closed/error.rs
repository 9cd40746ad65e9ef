//! Reasons why a model cannot be simulated.

/// Reason why a model cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ClosedError {
    /// A column would be needed before its sources are known.
    #[error(
        "`{column}` = {definition} looks at `{state}` {ahead} row{} ahead, which a simulation does not know yet; use earlier rows of it (for example `lag({column}, {ahead})`), \
         or fit without it", if *.ahead == 1 { "" } else { "s" }
    )]
    Ahead {
        /// The column.
        column: String,
        /// Its definition.
        definition: String,
        /// The simulated column that it reads.
        state: String,
        /// Rows ahead.
        ahead: i32,
    },
    /// A filter without a recursion, or with a constant that is no number.
    #[error(
        "`{filter}` of simulated values cannot be simulated: lags (`lag1`) and delays (`delay`) of a number of seconds can; fit without it"
    )]
    Filter {
        /// The filter.
        filter: String,
    },
    /// A delay of no number of rows.
    #[error(
        "`{filter}`: at steps of {step} s the delay is not a number of rows up to a million; give a delay and a sampling period that go together"
    )]
    Delay {
        /// The filter.
        filter: String,
        /// The step, seconds.
        step: f64,
    },
}
