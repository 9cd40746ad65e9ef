//! Why a model has no filter.

use fleetfoot_data::setting::{FILTER_SECTION, FIT_PWA, MEASURED, PARTITION};

/// Why a filter could not be made of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// Nothing is measured.
    #[error(
        "no state is measured: a filter needs at least one of {states}; say it and the deviation of its sensor, `x=0.01`, in `measured` of {FILTER_SECTION} of the recipe that the model is fitted by, or, to `filter`, by {MEASURED}"
    )]
    NotMeasured {
        /// Those that there are.
        states: String,
    },
    /// Transitions between regions were not counted.
    #[error(
        "no transitions were counted for this model, so that regions cannot switch by them: fit with {given_partition}, or let them switch by the state", given_partition = PARTITION.to("refined:K | lattice:K | tree:DEPTH")
    )]
    NoTransitions,
    /// The correlation of residuals from row to row is not known.
    #[error(
        "the model does not know how its residuals hang on those of the rows before: they are white, or their targets are measured over more than two rows, whose neighbours share them, or the model is not one that {FIT_PWA} made of logs; let the noise be white, or fit it with {FIT_PWA} to targets of one row (predict = \"next\", derivative = \"forward\")"
    )]
    NoCorrelation,
    /// The residuals of an equation are not known.
    #[error(
        "the model does not know the residuals of d({state})/dt or next({state}), which are the process noise; fit with {FIT_PWA}"
    )]
    NoResiduals {
        /// Whose equation it is.
        state: String,
    },
}
