//! k-means: exact Lloyd iterations, fast, with an answer that depends on the data alone.
//!
//! The objective is the inertia, `sum_i min_k ||z_i - c_k||^2` over standardised rows `z`. One iteration assigns every
//! row to its nearest centroid (the first of equally near ones). It then moves every centroid to the mean of its rows
//! (Lloyd, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 1982). Three things make it fast and change
//! nothing in the result:
//!
//! - bounds on the distances skip rows whose label cannot change ([`step`]);
//! - the rest are screened in `f32`, and those within the rounding error are decided in `f64` ([`screen`]);
//! - sums of rows are exact, so only rows that change their cluster need be added and subtracted ([`sums`]).
//!
//! Labels, centroids and counts are the same bits on any number of threads, for any split of the rows into blocks and on any
//! instruction set.

mod assigner;
mod distance;
mod frame;
mod lloyd;
mod plus_plus;
mod points;
mod random;
mod rows;
mod run;
mod screen;
mod step;
mod sums;
#[cfg(test)]
mod tests;
mod transpose;

pub use assigner::Assigner;
pub use points::Points;
pub use rows::{Assigned, KMeansRows, Units, assign_rows, distances_to};
pub use run::{KMeansRun, KMeansStep, kmeans_from, plus_plus_draws, starting_centroids};

use fleetfoot_data::{Cancelled, Progress};

/// Starting centroids.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    /// Greedy k-means++, `restarts` times (at least once); the result with the lowest inertia counts, of equal ones the first.
    PlusPlus {
        /// Names the random numbers.
        seed: u64,
        /// Independent starts.
        restarts: usize,
    },
    /// These (k x d, row-major, standardised).
    Centroids(&'a [f64]),
}

/// Options of k-means.
#[derive(Debug, Clone, Copy)]
pub struct KMeansOptions {
    /// Clusters wanted, k.
    pub k: usize,
    /// Iterations at most; 0 leaves the centroids where they start.
    pub max_iterations: usize,
    /// Stop when the squared shifts of all centroids sum up to at most this times the mean variance of the columns
    /// (scikit-learn's `tol`). With 0 it runs to a fixed point.
    pub tolerance: f64,
}

impl Default for KMeansOptions {
    fn default() -> Self {
        Self { k: 8, max_iterations: 100, tolerance: 1e-4 }
    }
}

/// The result.
#[derive(Debug, Clone, PartialEq)]
pub struct KMeans {
    /// Centroids, row-major: k x d, or fewer rows than k where fewer clusters have members.
    pub centroids: Vec<f64>,
    /// Rows nearest to each centroid; never zero.
    pub counts: Vec<u64>,
    /// Sum of the squared distances of all rows to their nearest centroids.
    pub inertia: f64,
    /// Iterations made.
    pub iterations: usize,
    /// True if the labels, or the centroids up to the tolerance, stood still.
    pub converged: bool,
}

/// Why rows could not be clustered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KMeansError {
    /// The rows need more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// Nothing to measure distances in.
    #[error("no columns to cluster on")]
    NoColumns,
    /// Nothing to cluster.
    #[error("no rows to cluster")]
    NoRows,
    /// The request has no clusters.
    #[error("k-means needs at least one cluster")]
    NoClusters,
    /// Slices that do not fit together.
    #[error("{expected} {what} expected, {actual} found")]
    Shape {
        /// Name of the counted items.
        what: &'static str,
        /// Required number.
        expected: usize,
        /// Actual number.
        actual: usize,
    },
    /// A column cannot be standardised.
    #[error(
        "column {} cannot be standardised with centre {centre} and scale {scale}: both must be finite, the scale positive",
        column + 1
    )]
    Scale {
        /// Index of the column, from 0.
        column: usize,
        /// Its centre.
        centre: f64,
        /// Its scale.
        scale: f64,
    },
    /// A value that has no place in a sum of squares.
    #[error(
        "row {}, column {}: {value} cannot be clustered (missing, infinite or beyond 1e30 when standardised); drop the row",
        row + 1,
        column + 1
    )]
    Value {
        /// Index of the row, from 0.
        row: usize,
        /// Index of the column, from 0.
        column: usize,
        /// The value, in the unit of the column.
        value: f64,
    },
    /// A weight that is negative, too large or not finite.
    #[error("row {}: its weight is {value}; weights are finite, not negative and at most 1e30", row + 1)]
    Weight {
        /// Index of the row, from 0.
        row: usize,
        /// Its weight.
        value: f64,
    },
    /// Nothing that counts.
    #[error("all weights are zero: no row counts")]
    NoWeight,
    /// A starting centroid that is nowhere.
    #[error("coordinate {} of starting centroid {} is {value}", column + 1, cluster + 1)]
    Centroid {
        /// Index of the centroid, from 0.
        cluster: usize,
        /// Index of the coordinate, from 0.
        column: usize,
        /// Its value.
        value: f64,
    },
    /// The tolerance is not a number that can be compared with.
    #[error("tolerance {0}: must be zero or positive")]
    Tolerance(f64),
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Clusters the rows of `points`.
///
/// A cluster that loses all its rows is restarted from the row that is farthest from its centroid, as in scikit-learn.
/// Several such clusters restart from the farthest rows in turn, never from the only row of a cluster. If there are
/// fewer different rows than clusters, the result has fewer centroids. `progress` advances by iterations.
///
/// # Errors
/// No rows, no clusters, starting centroids of a wrong number or not finite, a tolerance that is negative or NaN; cancelled.
pub fn kmeans(
    points: &Points,
    start: Start<'_>,
    options: &KMeansOptions,
    progress: &dyn Progress,
) -> Result<KMeans, KMeansError> {
    check(points, options)?;
    match start {
        Start::Centroids(centroids) => {
            check_start(points, centroids, options)?;
            iterate(points, centroids.to_vec(), options, progress)
        }
        Start::PlusPlus { seed, restarts } => {
            let run = |restart: u64| {
                let draw = |draw: usize| random::uniform(seed, restart, draw as u64);
                let centroids = plus_plus::plus_plus(points, options.k, draw, progress)?;
                iterate(points, centroids, options, progress)
            };
            let mut best = run(0)?;
            for restart in 1..restarts as u64 {
                let other = run(restart)?;
                if other.inertia < best.inertia {
                    best = other;
                }
            }
            Ok(best)
        }
    }
}

/// Lloyd's iterations from a start to the end.
fn iterate(
    points: &Points,
    start: Vec<f64>,
    options: &KMeansOptions,
    progress: &dyn Progress,
) -> Result<KMeans, KMeansError> {
    let run::KMeansRun { centroids, counts, inertia, iterations, converged, .. } =
        run::iterate(points, start, options, false, progress)?;
    let members = || counts.iter().zip(centroids.chunks_exact(points.dimensions())).filter(|&(&count, _)| count > 0);
    let centroids = members().flat_map(|(_, centroid)| centroid).copied().collect();
    let counts = members().map(|(&count, _)| count).collect();
    Ok(KMeans { centroids, counts, inertia, iterations, converged })
}

/// Refuses points that cannot be clustered.
fn check(points: &Points, options: &KMeansOptions) -> Result<(), KMeansError> {
    if points.rows() == 0 {
        return Err(KMeansError::NoRows);
    }
    if options.k == 0 {
        return Err(KMeansError::NoClusters);
    }
    if options.tolerance.is_nan() || options.tolerance < 0.0 {
        return Err(KMeansError::Tolerance(options.tolerance));
    }
    Ok(())
}

/// Refuses starting centroids of another number or shape.
fn check_start(points: &Points, centroids: &[f64], options: &KMeansOptions) -> Result<(), KMeansError> {
    let expected = options.k * points.dimensions();
    if centroids.len() != expected {
        let count = centroids.len();
        return Err(KMeansError::Shape { what: "coordinates of starting centroids", expected, actual: count });
    }
    check_centroids(centroids, points.dimensions())
}

/// Refuses centroids that have no place or no shape.
fn check_centroids(centroids: &[f64], dimensions: usize) -> Result<(), KMeansError> {
    if dimensions == 0 {
        return Err(KMeansError::NoColumns);
    }
    if centroids.is_empty() {
        return Err(KMeansError::NoClusters);
    }
    if !centroids.len().is_multiple_of(dimensions) {
        let expected = centroids.len().next_multiple_of(dimensions);
        return Err(KMeansError::Shape { what: "coordinates of centroids", expected, actual: centroids.len() });
    }
    let fits = |value: &f64| value.abs() <= points::LARGEST;
    match centroids.iter().position(|value| !fits(value)) {
        Some(at) => {
            Err(KMeansError::Centroid { cluster: at / dimensions, column: at % dimensions, value: centroids[at] })
        }
        None => Ok(()),
    }
}
