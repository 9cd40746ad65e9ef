//! Why a model has no regulator.

/// Why a regulator could not be made for a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// A name that is not there.
    #[error("{of}: the model has no {kind} `{name}`; {hint}")]
    Unknown {
        /// The setting: `q`, `setpoint`.
        of: &'static str,
        /// State, input or either.
        kind: &'static str,
        /// The name.
        name: String,
        /// The nearest names, or all of them.
        hint: String,
    },
    /// A number that cannot be used.
    #[error("{of}: {name} = {value}: must be {allowed}")]
    Value {
        /// The setting.
        of: &'static str,
        /// Whose number it is.
        name: String,
        /// The number.
        value: f64,
        /// The allowed values, in words.
        allowed: &'static str,
    },
    /// The model looks back.
    #[error(
        "the model looks at earlier rows or at time, so that its state is more than its columns: fit without lags, filters and time(), with derivatives or the next values of states"
    )]
    Memory,
    /// Derivatives beside differences.
    #[error("some equations of the model give derivatives and others next values or differences: fit all states alike")]
    Mixed,
    /// A rotation of which a part alone is named.
    #[error(
        "{of}: a rotation is given, kept or left free as a whole: name all parts of {rotation}, or {rotation} itself (free, q, integral), or roll({rotation}), pitch({rotation}) and yaw({rotation}) (setpoint)"
    )]
    HalfRotation {
        /// The entry.
        of: &'static str,
        /// Its name.
        rotation: String,
    },
    /// Two partitions.
    #[error("the model has several partitions with more than one region each: fit all equations over one")]
    Partitions,
    /// Regions by label.
    #[error(
        "the regions of the model follow from labels, of which a controller knows none: fit without labels, or one model a label"
    )]
    Labels,
    /// No input.
    #[error("the model has no input that could be driven: fit with inputs")]
    NoInputs,
    /// All states are free.
    #[error("no state is left to be kept: all of them are free")]
    NoStates,
    /// Another period than the model's.
    #[error(
        "a period of {period} s: the model gives the next row, {step} s later, and nothing between or beyond; fit derivatives for other periods"
    )]
    Period {
        /// The requested period.
        period: f64,
        /// The model's.
        step: f64,
    },
    /// The period is not known.
    #[error("the model does not know its sampling period: give the period of the controller")]
    NoPeriod,
    /// The region of the set point cannot be kept there.
    #[error(
        "{place} cannot be kept at the set point: no input reaches {modes}; drive further inputs, or leave what need not be kept out (free = \"...\")"
    )]
    NotStabilisable {
        /// A region, or the model.
        place: String,
        /// Modes in words.
        modes: String,
    },
    /// Riccati's equation has no solution that can be used.
    #[error(
        "{place}: the Riccati equation has no solution that can be trusted ({problem}); weigh states and inputs less unevenly"
    )]
    Riccati {
        /// A region, or the model.
        place: String,
        /// The problem, in words.
        problem: String,
    },
}
