//! Starting centroids: greedy k-means++.
//!
//! Arthur and Vassilvitskii, "k-means++: the advantages of careful seeding" (SODA 2007): each next centroid is a row drawn with a probability proportional
//! to its squared distance to the nearest centroid so far. The greedy variant, as in scikit-learn, draws `2 + ln k` candidates
//! and keeps the one that leaves the least sum of squared distances.

use std::sync::{Mutex, PoisonError};

use fleetfoot_data::{Cancelled, Progress, Silent, parallel_map};
use pulp::{Arch, Simd, WithSimd};

use super::{Points, distance::squared_distance, points::{CHUNK, ChunkRows}, random::uniform};

/// Squared distances of a chunk's rows to the nearest of the first `seen` centroids.
struct Closest {
    seen: usize,
    squared: Vec<f64>,
}

/// At most `clusters` different rows as centroids (row-major); fewer if there are fewer different rows.
pub(super) fn plus_plus(
    points: &Points,
    clusters: usize,
    seed: u64,
    restart: u64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Cancelled> {
    let d = points.dimensions();
    let trials = 2 + (clusters as f64).ln() as usize;
    let first = (uniform(seed, restart, 0) * points.rows() as f64) as usize;
    let mut centroids = points.row(first.min(points.rows() - 1));
    let chunks: Vec<Mutex<Closest>> = (0..points.chunks())
        .map(|chunk| Mutex::new(Closest { seen: 0, squared: vec![f64::INFINITY; points.chunk(chunk).rows()] }))
        .collect();
    let mut sums = potentials(points, &chunks, &centroids, &[], progress)?;
    for cluster in 1..clusters {
        let total: f64 = sums.iter().map(|sums| sums[0]).sum();
        // Every row is a centroid already.
        if total <= 0.0 {
            break;
        }
        let mut candidates = Vec::with_capacity(trials * d);
        for trial in 0..trials {
            let draw = ((cluster - 1) * trials + trial + 1) as u64;
            let row = draw_row(points, &chunks, &centroids, &sums, uniform(seed, restart, draw) * total);
            candidates.extend_from_slice(&points.row(row));
        }
        let tried = potentials(points, &chunks, &centroids, &candidates, progress)?;
        let totals: Vec<f64> = (0..trials).map(|trial| tried.iter().map(|sums| sums[trial]).sum()).collect();
        let best = (0..trials).min_by(|&a, &b| totals[a].total_cmp(&totals[b])).unwrap_or(0);
        centroids.extend_from_slice(&candidates[best * d..(best + 1) * d]);
        sums = tried.into_iter().map(|sums| vec![sums[best]]).collect();
    }
    Ok(centroids)
}

/// The row at which the running sum of squared distances passes `target`.
fn draw_row(points: &Points, chunks: &[Mutex<Closest>], centroids: &[f64], sums: &[Vec<f64>], mut target: f64) -> usize {
    // Rounding may carry the target past the end: then the last row that can be drawn.
    let mut chosen = sums.iter().rposition(|sums| sums[0] > 0.0).unwrap_or(0);
    for (chunk, sums) in sums.iter().enumerate() {
        if target < sums[0] {
            chosen = chunk;
            break;
        }
        target -= sums[0];
    }
    let mut closest = chunks[chosen].lock().unwrap_or_else(PoisonError::into_inner);
    Arch::new().dispatch(Pass { rows: points.chunk(chosen), d: points.dimensions(), centroids, candidates: &[], closest: &mut closest });
    let mut row = closest.squared.iter().rposition(|squared| *squared > 0.0).unwrap_or(0);
    for (i, squared) in closest.squared.iter().enumerate() {
        if target < *squared {
            row = i;
            break;
        }
        target -= squared;
    }
    chosen * CHUNK + row
}

/// For each chunk and each candidate the sum of squared distances if it became a centroid; without candidates, the sum as it is.
fn potentials(
    points: &Points,
    chunks: &[Mutex<Closest>],
    centroids: &[f64],
    candidates: &[f64],
    progress: &dyn Progress,
) -> Result<Vec<Vec<f64>>, Cancelled> {
    let arch = Arch::new();
    parallel_map(chunks.len(), &Silent, |chunk| {
        if progress.cancelled() {
            return Err(Cancelled);
        }
        let mut closest = chunks[chunk].lock().unwrap_or_else(PoisonError::into_inner);
        Ok(arch.dispatch(Pass { rows: points.chunk(chunk), d: points.dimensions(), centroids, candidates, closest: &mut closest }))
    })
}

struct Pass<'a> {
    rows: ChunkRows<'a>,
    d: usize,
    centroids: &'a [f64],
    candidates: &'a [f64],
    closest: &'a mut Closest,
}

impl WithSimd for Pass<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f64> {
        let fresh = &self.centroids[self.closest.seen * self.d..];
        self.closest.seen = self.centroids.len() / self.d;
        let mut sums = vec![0.0; (self.candidates.len() / self.d).max(1)];
        let row = &mut vec![0.0; self.d];
        for (i, closest) in self.closest.squared.iter_mut().enumerate() {
            self.rows.copy(i, row);
            for centroid in fresh.chunks_exact(self.d) {
                *closest = closest.min(squared_distance(row, centroid));
            }
            if self.candidates.is_empty() {
                sums[0] += *closest;
            }
            for (sum, candidate) in sums.iter_mut().zip(self.candidates.chunks_exact(self.d)) {
                *sum += closest.min(squared_distance(row, candidate));
            }
        }
        sums
    }
}
