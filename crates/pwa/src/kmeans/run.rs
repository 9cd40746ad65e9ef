//! One run of Lloyd's iterations, with all its centroids and, on request, the numbers of each iteration.

use fleetfoot_data::Progress;

use super::{KMeansError, KMeansOptions, Points, lloyd::Lloyd, plus_plus};

/// One run from given centroids.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct KMeansRun {
    /// All centroids (k x d, row-major), those without rows where they were last.
    pub centroids: Vec<f64>,
    /// Rows of each cluster; rows of weight zero do not count.
    pub counts: Vec<u64>,
    /// Weighted sum of the squared distances of all rows to their nearest centroids.
    pub inertia: f64,
    /// Iterations made.
    pub iterations: usize,
    /// True if the labels, or the centroids up to the tolerance, stood still.
    pub converged: bool,
    /// Threshold of the sum of the squared shifts.
    pub threshold: f64,
    /// Every iteration, on request; else empty.
    pub history: Vec<KMeansStep>,
}

/// One iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KMeansStep {
    /// Inertia of the rows' new labels and the centroids before they moved.
    pub inertia: f64,
    /// Labels that changed.
    pub changed: usize,
    /// Sum of the squared shifts of the centroids.
    pub shift: f64,
}

/// Lloyd's iterations from `start` (k x d, row-major, standardised), as [`kmeans`](super::kmeans) makes them. Clusters without rows stay in the result.
///
/// With `history` the inertia of every iteration is computed; without it only the last one's.
///
/// # Errors
/// As [`kmeans`](super::kmeans).
pub fn kmeans_from(
    points: &Points,
    start: &[f64],
    options: &KMeansOptions,
    history: bool,
    progress: &dyn Progress,
) -> Result<KMeansRun, KMeansError> {
    super::check(points, options)?;
    super::check_start(points, start, options)?;
    iterate(points, start.to_vec(), options, history, progress)
}

/// Number of uniform random numbers that [`starting_centroids`] needs for `k` centroids.
pub fn plus_plus_draws(k: usize) -> usize {
    1 + k.saturating_sub(1) * plus_plus::trials(k)
}

/// k-means++ (greedy, as [`Start::PlusPlus`](super::Start)) from uniform numbers in [0, 1) of one's own: `k` rows as centroids (k x d, row-major).
///
/// The numbers are used as scikit-learn uses those of its generator, so that the same numbers give the same centroids there. If there are fewer
/// different rows than centroids, the first row fills the rest, as there.
///
/// # Errors
/// No rows; no clusters; a number of draws other than that of [`plus_plus_draws`]; cancelled.
pub fn starting_centroids(
    points: &Points,
    k: usize,
    draws: &[f64],
    progress: &dyn Progress,
) -> Result<Vec<f64>, KMeansError> {
    super::check(points, &KMeansOptions { k, ..KMeansOptions::default() })?;
    let (expected, count) = (plus_plus_draws(k), draws.len());
    if count != expected {
        return Err(KMeansError::Shape { what: "uniform numbers", expected, actual: count });
    }
    let mut centroids = plus_plus::plus_plus(points, k, |draw| draws[draw], progress)?;
    while centroids.len() < k * points.dimensions() {
        centroids.extend(points.row(0));
    }
    Ok(centroids)
}

/// The iterations on checked input.
pub(super) fn iterate(
    points: &Points,
    start: Vec<f64>,
    options: &KMeansOptions,
    history: bool,
    progress: &dyn Progress,
) -> Result<KMeansRun, KMeansError> {
    let mut lloyd = Lloyd::new(points, start);
    let threshold = if options.tolerance > 0.0 { options.tolerance * points.mean_variance(progress)? } else { 0.0 };
    let mut steps = Vec::new();
    let (mut iterations, mut converged) = (0, false);
    while iterations < options.max_iterations && !converged {
        let changed = lloyd.assign(progress)?;
        let inertia = if history { lloyd.inertia(progress)? } else { f64::NAN };
        let shift = lloyd.update(progress)?;
        iterations += 1;
        converged = changed == 0 || shift <= threshold;
        if history {
            steps.push(KMeansStep { inertia, changed, shift });
        }
        progress.advance(1, options.max_iterations);
    }
    // The centroids moved since the rows were assigned.
    lloyd.assign(progress)?;
    let inertia = lloyd.inertia(progress)?;
    let counts = lloyd.counts().iter().map(|&count| count as u64).collect();
    Ok(KMeansRun { centroids: lloyd.centroids, counts, inertia, iterations, converged, threshold, history: steps })
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Silent;

    use super::*;
    use crate::kmeans::{Start, distance::squared_distance, kmeans, random::uniform};

    fn rows(n: usize) -> Vec<[f64; 2]> {
        let value = |i: usize, j: u64| 3.0 * uniform(5, (i % 4) as u64, j) + uniform(6, i as u64, j);
        (0..n).map(|i| [value(i, 0), value(i, 1)]).collect()
    }

    fn points(rows: &[[f64; 2]]) -> Points {
        let column = |j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
        Points::from_columns(&[&column(0), &column(1)], &[0.0; 2], &[1.0; 2]).unwrap()
    }

    /// The greedy k-means++ as it is written down, with weights.
    fn plain(rows: &[[f64; 2]], weights: &[f64], k: usize, draws: &[f64]) -> Vec<f64> {
        let at = |values: &[f64], target: f64| {
            let mut sum = 0.0;
            let passed = |value: &f64| {
                sum += value;
                sum > target
            };
            values.iter().position(passed).unwrap()
        };
        let total: f64 = weights.iter().sum();
        let mut centroids = rows[at(weights, draws[0] * total)].to_vec();
        let mut squared: Vec<f64> = rows.iter().map(|row| squared_distance(row, &centroids)).collect();
        let trials = (plus_plus_draws(k) - 1) / (k - 1);
        for round in draws[1..].chunks(trials) {
            let weighted: Vec<f64> = squared.iter().zip(weights).map(|(a, b)| a * b).collect();
            let total: f64 = weighted.iter().sum();
            let left = |row: usize| -> Vec<f64> {
                squared.iter().zip(rows).map(|(old, x)| old.min(squared_distance(x, &rows[row]))).collect()
            };
            let cost = |row: usize| left(row).iter().zip(weights).map(|(a, b)| a * b).sum::<f64>();
            let candidates = round.iter().map(|draw| at(&weighted, draw * total));
            let best = candidates.min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap();
            squared = left(best);
            centroids.extend(rows[best]);
        }
        centroids
    }

    #[test]
    fn draws_match_the_written_algorithm() {
        let rows = rows(9_000);
        let weights: Vec<f64> =
            (0..rows.len()).map(|i| if i % 3 == 0 { 0.0 } else { uniform(7, i as u64, 0) }).collect();
        for k in [2, 5, 11] {
            let draws: Vec<f64> = (0..plus_plus_draws(k)).map(|i| uniform(8, k as u64, i as u64)).collect();
            let mut points = points(&rows);
            let centroids = starting_centroids(&points, k, &draws, &Silent).unwrap();
            assert_eq!(centroids, plain(&rows, &vec![1.0; rows.len()], k, &draws));
            points.weigh(weights.clone()).unwrap();
            let starting_centroids = starting_centroids(&points, k, &draws, &Silent).unwrap();
            assert_eq!(starting_centroids, plain(&rows, &weights, k, &draws));
        }
        assert!(starting_centroids(&points(&rows), 3, &[0.5; 4], &Silent).is_err());
    }

    #[test]
    fn empty_clusters_keep_their_centroid_and_the_history_is_reported() {
        let rows = [[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        let points = points(&rows);
        let options = KMeansOptions { k: 5, ..KMeansOptions::default() };
        let start: Vec<f64> = rows.iter().flatten().copied().collect();
        let run = kmeans_from(&points, &start, &options, true, &Silent).unwrap();
        assert_eq!((run.centroids, run.counts, run.iterations), (start.clone(), vec![1, 2, 0, 1, 1], 1));
        assert_eq!(run.history, [KMeansStep { inertia: 0.0, changed: 5, shift: 0.0 }]);
        assert_eq!(kmeans(&points, Start::Centroids(&start), &options, &Silent).unwrap().counts, [1, 2, 1, 1]);
        let draws = vec![0.3; plus_plus_draws(6)];
        let start = starting_centroids(&points, 6, &draws, &Silent).unwrap();
        assert_eq!(start.len(), 12);
        assert_eq!(start[8..], [0.0; 4]);
    }

    #[test]
    fn inertia_falls_to_the_last_value() {
        let points = points(&rows(5_000));
        let start: Vec<f64> = (0..6).flat_map(|i| points.row(i)).collect();
        let options = KMeansOptions { k: 6, max_iterations: 100, tolerance: 0.0 };
        let run = kmeans_from(&points, &start, &options, true, &Silent).unwrap();
        assert!(run.converged && run.history.len() == run.iterations && run.iterations > 4);
        assert!(run.history.windows(2).all(|pair| pair[1].inertia <= pair[0].inertia * (1.0 + 1e-15)));
        assert_eq!(run.history.last().unwrap().inertia, run.inertia);
    }
}
