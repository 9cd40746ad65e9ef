//! Mergeable statistics, the one reduction over rows, and the small solves.

// plan, keys, reduction
mod keys;
mod moments;
mod plan;
mod reduce;
pub use keys::{Fold, Key, MergeError, Stats};
pub use moments::Moments;
pub use plan::{Chunk, Grid, plan_hash};
pub use reduce::{TILE_ROWS, reduce};

// numerics
mod errors;
mod factor;
mod gram;
mod householder;
mod polynomial;
mod precondition;
mod separation;
mod solve;
mod square_root;
mod tile;
mod triangle;
pub use errors::{ErrorSum, ErrorSums};
pub use factor::Factor;
pub use gram::Gram;
pub use polynomial::{PolynomialError, PolynomialMoments, PolynomialPlan, PolynomialScratch};
pub use precondition::{Preconditioner, PreconditionerError};
pub use solve::{Solution, least_squares, ridge};
pub use square_root::SquareRoot;
