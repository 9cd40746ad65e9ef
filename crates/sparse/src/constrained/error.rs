//! Errors of constraints.

use fleetfoot_data::{Cancelled, Error};
use fleetfoot_library::UnknownColumn;

use crate::SparseError;

/// Why a constrained fit has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConstrainedError {
    /// The problem or a strength is not valid.
    #[error(transparent)]
    Sparse(#[from] SparseError),
    /// The problem is known by its Gram matrix.
    #[error(
        "constrained fits need the square-root form: assemble the problem from the tasks' R factors, not from a Gram matrix"
    )]
    NotSquareRoot,
    /// A coefficient that does not exist.
    #[error("constraint `{name}` is about coefficient {coefficient}; there are {coefficients}, counted from 0")]
    NoSuchCoefficient {
        /// The constraint.
        name: String,
        /// The coefficient.
        coefficient: usize,
        /// Number of coefficients.
        coefficients: usize,
    },
    /// A constraint holds NaN or an infinity.
    #[error("constraint `{name}` has a number that is not finite: leave out a side without a bound")]
    NotFinite {
        /// The constraint.
        name: String,
    },
    /// Bounds between which nothing lies.
    #[error("{name} cannot lie between {low} and {high}: the first is the lower bound, and infinities are open ends")]
    Bounds {
        /// The coefficient.
        name: String,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// No coefficients satisfy all constraints.
    #[error("no coefficients satisfy these constraints together: {}; loosen one of them", constraints.join(", "))]
    Infeasible {
        /// Names of constraints that contradict each other, none of which can be left out of the contradiction.
        constraints: Vec<String>,
    },
    /// The decomposition or the interior-point solver refused the problem.
    #[error("the convex program cannot be solved ({reason}): look for huge or tiny numbers among the constraints")]
    Program {
        /// Reason, in the words of the solver.
        reason: String,
    },
    /// Entries that are not the lower triangle of a matrix.
    #[error("limit `{name}` has {entries} forms: the lower triangle of a symmetric matrix has 1, 3, 6, 10, ...")]
    NoMatrix {
        /// The limit.
        name: String,
        /// Number of entries.
        entries: usize,
    },
    /// A limit that says something else at every row, and no rows.
    #[error("limit `{name}` differs from row to row: give the rows")]
    NeedsRows {
        /// The limit.
        name: String,
    },
    /// A limit on a latent that does not exist.
    #[error("a limit is set on latent {latent}; the regression has {latents}, counted from 0")]
    NoSuchLatent {
        /// The latent.
        latent: usize,
        /// Number of latents.
        latents: usize,
    },
    /// The source has no such column.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// The source cannot be read.
    #[error(transparent)]
    Data(#[from] Error),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
