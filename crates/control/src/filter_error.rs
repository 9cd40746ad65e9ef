//! Why a model has no filter.

use fleetfoot_data::setting::{FILTER_SECTION, FIT_PWA, MEASURED, PARTITION};

/// Why a filter could not be made of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// Nothing is measured.
    #[error(
        "no state is measured: a filter needs at least one of {states}; give it with the deviation of its sensor (`x=0.01`) in `measured` of {FILTER_SECTION} of the recipe of the fit, or, to `filter`, by {MEASURED}"
    )]
    NotMeasured {
        /// Those that there are.
        states: String,
    },
    /// Transitions between regions were not counted.
    #[error(
        "the model has no counts of transitions, so its regions cannot switch by them: fit with {given_partition}, or let regions switch by the state", given_partition = PARTITION.to("refined:K | lattice:K | tree:DEPTH")
    )]
    NoTransitions,
    /// The correlation of residuals from row to row is not known.
    #[error(
        "the model has no autoregression of its residuals: they are white, or their targets span more than two rows, or {FIT_PWA} did not fit the model to logs; choose white noise, or fit with {FIT_PWA} to targets of one row (predict = \"next\", derivative = \"forward\")"
    )]
    NoCorrelation,
    /// The residuals of an equation are not known.
    #[error(
        "the model has no residuals of d({state})/dt or next({state}), which give the process noise: fit it with {FIT_PWA}, or import a network with the logs that trained it"
    )]
    NoResiduals {
        /// Name of the state of the equation.
        state: String,
    },
}
