//! Errors of signals and of their processing.

/// Why a signal cannot be smoothed, filtered or aligned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// Arrays of different lengths.
    #[error("{what} has {count} values, the stamps are {expected}: give one for every stamp")]
    Length {
        /// Name of the array.
        what: &'static str,
        /// Its length.
        count: usize,
        /// The number of stamps.
        expected: usize,
    },
    /// Too few values that are numbers.
    #[error(
        "{count} measured values; {needed} or more are needed: take a longer record, or one with fewer values missing"
    )]
    TooFew {
        /// Number of measured values.
        count: usize,
        /// Number of values needed.
        needed: usize,
    },
    /// A stamp that does not come after the one before it.
    #[error(
        "stamp {row} is {time} s, the one before it {before} s: stamps must increase; sort the rows, and keep one row of each stamp"
    )]
    Stamp {
        /// The row.
        row: usize,
        /// Its stamp.
        time: f64,
        /// The stamp before.
        before: f64,
    },
    /// A weight that is negative or not finite.
    #[error(
        "the weight of row {} is {weight}: give a finite weight, 0 or more (0 for a value that does not count)",
        row + 1
    )]
    Weight {
        /// The row.
        row: usize,
        /// Its weight.
        weight: f64,
    },
    /// A value that is not finite where all must be.
    #[error(
        "the value of row {} is {value}: this filter needs every value; fill the gap, or smooth by a spline",
        row + 1
    )]
    NotFinite {
        /// The row.
        row: usize,
        /// Its value.
        value: f64,
    },
    /// A number out of its range.
    #[error("{what} = {value}: {expected}")]
    Parameter {
        /// Its name.
        what: &'static str,
        /// Value that was given.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A signal that is shorter than a filter needs.
    #[error("{rows} rows; {what} needs more than {needed}: take a longer record, or a shorter filter")]
    TooShort {
        /// Filter that needs more rows.
        what: &'static str,
        /// Number of rows.
        rows: usize,
        /// Number of rows that the filter must exceed.
        needed: usize,
    },
    /// An attitude that is no rotation.
    #[error(
        "the attitude of row {} is zero, and a quaternion must have the norm 1: leave out rows at which the body was not seen",
        row + 1
    )]
    Attitude {
        /// The row.
        row: usize,
    },
    /// Sensors that cannot be fused.
    #[error("{problem}")]
    NotFused {
        /// Why, and what to do.
        problem: &'static str,
    },
    /// A wave that is stated to be even, and is not.
    #[error(
        "the edges of the wave are not evenly spaced within their stamps: even out the stamps (dejitter), leave out edges that one sensor missed, or do not state the wave as even"
    )]
    UnevenWave,
    /// Two records that share too little time, or too little motion, to be aligned.
    #[error("the records cannot be aligned: {problem}; give records that share more time and motion")]
    NotAligned {
        /// Reason why the signals cannot be aligned.
        problem: &'static str,
    },
}

/// Refuses a number outside of what it may be.
pub(crate) fn check(holds: bool, what: &'static str, value: f64, expected: &'static str) -> Result<(), SignalError> {
    if holds { Ok(()) } else { Err(SignalError::Parameter { what, value, expected }) }
}

/// Refuses values that are not finite.
pub(crate) fn check_finite(values: &[f64]) -> Result<(), SignalError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(row) => Err(SignalError::NotFinite { row, value: values[row] }),
        None => Ok(()),
    }
}

/// Refuses stamps that do not increase.
pub(crate) fn check_stamps(times: &[f64]) -> Result<(), SignalError> {
    let bad = times.windows(2).position(|pair| pair[1].partial_cmp(&pair[0]) != Some(std::cmp::Ordering::Greater));
    match bad {
        Some(row) => Err(SignalError::Stamp { row: row + 1, time: times[row + 1], before: times[row] }),
        None => Ok(()),
    }
}

/// Refuses a list that has another length than the stamps.
pub(crate) fn length(what: &'static str, count: usize, expected: usize) -> Result<(), SignalError> {
    if count == expected { Ok(()) } else { Err(SignalError::Length { what, count, expected }) }
}

/// Refuses values that are infinite; NaN is a value that is missing.
pub(crate) fn check_infinite(values: &[f64]) -> Result<(), SignalError> {
    match values.iter().position(|value| value.is_infinite()) {
        Some(row) => Err(SignalError::NotFinite { row, value: values[row] }),
        None => Ok(()),
    }
}

/// Refuses stamps that do not increase, weights that are negative or not finite, values that are infinite, and lists of different lengths.
pub(crate) fn check_channel(times: &[f64], values: &[f64], weights: Option<&[f64]>) -> Result<(), SignalError> {
    length("the channel", values.len(), times.len())?;
    length("the list of weights", weights.map_or(times.len(), <[f64]>::len), times.len())?;
    check_stamps(times)?;
    let bad = |weights: &&[f64]| weights.iter().position(|weight| !(weight.is_finite() && *weight >= 0.0));
    if let Some((weights, row)) = weights.and_then(|weights| Some((weights, bad(&weights)?))) {
        return Err(SignalError::Weight { row, weight: weights[row] });
    }
    check_infinite(values)
}
