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
        /// Name of the signal that has the number.
        name: String,
        /// The number.
        value: f64,
        /// The allowed values, in words.
        allowed: &'static str,
    },
    /// Bounds that exclude the set point.
    #[error(
        "bounds: the set point {name} = {at} is not within {lowest} to {highest}: widen the bounds, or choose another set point"
    )]
    Excluded {
        /// The state.
        name: String,
        /// Its set point.
        at: f64,
        /// Its lowest value.
        lowest: f64,
        /// Its highest value.
        highest: f64,
    },
    /// The model looks back.
    #[error(
        "the model reads earlier rows or time, so its columns are not its whole state: fit without lags, filters and time(), with derivatives or next values of states"
    )]
    Memory,
    /// Derivatives beside differences.
    #[error(
        "some equations of the model give derivatives and others next values or differences: fit all states to one kind of target"
    )]
    Mixed,
    /// A rotation of which a part alone is named.
    #[error(
        "{of}: only some parts of the rotation {rotation} are named, and a rotation is given, kept or left free as a whole: name all its parts, or {rotation} itself (free, q, integral), or roll({rotation}), pitch({rotation}) and yaw({rotation}) (setpoint)"
    )]
    HalfRotation {
        /// The entry.
        of: &'static str,
        /// Its name.
        rotation: String,
    },
    /// Two partitions.
    #[error("the model has several partitions with more than one region each: fit all equations over one partition")]
    Partitions,
    /// Regions by label.
    #[error(
        "labels choose the regions of the model, and a controller has no labels: fit without labels, or one model per label"
    )]
    Labels,
    /// No input.
    #[error("the model has no input to drive: fit it with at least one input")]
    NoInputs,
    /// All states are free.
    #[error("all states are free, so no state is controlled: take at least one state out of free")]
    NoStates,
    /// Another period than the model's.
    #[error(
        "the period of the controller is {period} s, and the model predicts the next row, {step} s later: use a period of {step} s, or fit derivatives"
    )]
    Period {
        /// The requested period.
        period: f64,
        /// The model's.
        step: f64,
    },
    /// The period is not known.
    #[error("the model has no sampling period: give the period of the controller")]
    NoPeriod,
    /// The region of the set point cannot be kept there.
    #[error(
        "{place} cannot be kept at the set point: no input reaches {modes}; drive further inputs, or list states that need no control (free = \"...\")"
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
