//! Lloyd's iteration: assign rows to centroids, move centroids to the means of their rows.
//!
//! An assignment visits the chunks in parallel ([`super::step`]) and changes the sums by the rows whose label changed.
//! The sums are exact ([`super::sums`]), so that the order of the additions does not matter.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

use fleetfoot_data::{Cancelled, Progress, Silent, parallel_map, thread_count};
use pulp::{Simd, WithSimd};

use super::{
    KMeansError, Points,
    distance::squared_distance,
    points::{CHUNK, ChunkRows},
    screen::Screen,
    step::{Rows, Scratch, Step},
    sums::{Quanta, Sums},
};

/// The state between iterations.
pub(super) struct Lloyd<'a> {
    points: &'a Points,
    chunks: Vec<Mutex<Rows>>,
    sums: Sums,
    /// k x d.
    pub(super) centroids: Vec<f64>,
    /// By how much the gaps of the rows of each cluster may have shrunk since the last assignment.
    shrinkage: Vec<f32>,
}

impl<'a> Lloyd<'a> {
    pub(super) fn new(points: &'a Points, centroids: Vec<f64>) -> Self {
        let d = points.dimensions();
        let clusters = centroids.len() / d;
        let chunks = (0..points.chunks()).map(|chunk| Mutex::new(Rows::new(points.chunk(chunk).rows())));
        let sums = match points.weights() {
            None => Sums::new(clusters, d, Quanta::new(points.rows(), points.largest())),
            Some(weights) => {
                let largest = weights.iter().fold(0.0, |largest: f64, &weight| largest.max(weight));
                let quanta = Quanta::new(points.rows(), points.largest() * largest);
                Sums::weighted(clusters, d, quanta, Quanta::new(points.rows(), largest))
            }
        };
        Self { points, chunks: chunks.collect(), sums, shrinkage: vec![0.0; clusters], centroids }
    }

    /// Rows of each cluster.
    pub(super) fn counts(&self) -> &[i64] {
        self.sums.counts()
    }

    /// Assigns every row to its nearest centroid, the first of equally near ones; how many labels changed.
    pub(super) fn assign(&mut self, progress: &dyn Progress) -> Result<usize, Cancelled> {
        let d = self.points.dimensions();
        let screen = Screen::new(&self.centroids, d);
        let next = AtomicUsize::new(0);
        let arch = fleetfoot_data::arch();
        // Workers take chunks as they come: the sums are exact, so their order does not matter.
        let parts = parallel_map(thread_count().min(self.chunks.len()), &Silent, |_| {
            let mut sums = self.sums.emptied();
            let mut scratch = Scratch::new(d);
            let mut changed = 0;
            while let Some((chunk, state)) = claim(&next, &self.chunks) {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
                changed += arch.dispatch(Step {
                    rows: self.points.chunk(chunk),
                    dimensions: d,
                    centroids: &self.centroids,
                    screen: &screen,
                    shrinkage: &self.shrinkage,
                    state: &mut state,
                    sums: &mut sums,
                    scratch: &mut scratch,
                });
            }
            Ok((sums, changed))
        })?;
        let mut changed = 0;
        for (sums, part) in parts {
            self.sums.merge(&sums);
            changed += part;
        }
        // The gaps are up to date with these centroids.
        self.shrinkage.fill(0.0);
        Ok(changed)
    }

    /// Moves every centroid to the mean of its rows; the sum of the squared shifts.
    pub(super) fn update(&mut self, progress: &dyn Progress) -> Result<f64, KMeansError> {
        let d = self.points.dimensions();
        let mut centroids = self.centroids.clone();
        if self.counts().contains(&0) {
            let mut sums = self.sums.clone();
            self.relocate(&mut sums, progress)?;
            sums.means(&mut centroids);
        } else {
            self.sums.means(&mut centroids);
        }
        let pairs = self.centroids.chunks_exact(d).zip(centroids.chunks_exact(d));
        let squared: Vec<f64> = pairs.map(|(old, new)| squared_distance(old, new)).collect();
        self.centroids = centroids;
        self.shrinkage = shrinkage(&squared);
        Ok(squared.iter().sum())
    }

    /// Moves the rows that are farthest from their centroids into the empty clusters of `sums`: one each, as single members.
    fn relocate(&self, sums: &mut Sums, progress: &dyn Progress) -> Result<(), KMeansError> {
        let empty: Vec<usize> = (0..self.shrinkage.len()).filter(|&cluster| sums.counts()[cluster] == 0).collect();
        // Farthest first, of equally far ones the first row; those that must stay may be one for each full cluster.
        let wanted = self.shrinkage.len();
        let farthest = self.map_chunks(progress, |rows, state| {
            let distances = self.distances(rows, &state.labels).into_iter().zip(&state.labels).enumerate();
            let mut far: Vec<(f64, usize, u32)> =
                distances.map(|(row, (distance, label))| (distance, row, *label)).collect();
            far.retain(|&(distance, row, _)| distance > 0.0 && rows.weight(row) > 0.0);
            far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            far.truncate(wanted);
            far
        })?;
        let numbered = farthest.into_iter().enumerate();
        let mut far: Vec<(f64, usize, u32)> = numbered
            .flat_map(|(chunk, far)| {
                far.into_iter().map(move |(distance, row, label)| (distance, chunk * CHUNK + row, label))
            })
            .collect();
        far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut empty = empty.into_iter();
        let mut cluster = empty.next();
        for (_, row, label) in far {
            let Some(target) = cluster else { break };
            // The last row of a cluster stays: taking it would only move the hole.
            if sums.counts()[label as usize] > 1 {
                let weight = self.points.weights().map(|weights| weights[row]);
                sums.transfer(Some(label as usize), target, &mut self.points.row(row), weight);
                cluster = empty.next();
            }
        }
        Ok(())
    }

    /// Weighted sum of the squared distances of all rows to their centroids, in the order of the rows, chunk by chunk.
    pub(super) fn inertia(&self, progress: &dyn Progress) -> Result<f64, Cancelled> {
        let parts = self.map_chunks(progress, |rows, state| {
            let distances = self.distances(rows, &state.labels);
            match rows.weights {
                None => distances.iter().sum::<f64>(),
                Some(weights) => distances.iter().zip(weights).map(|(distance, weight)| distance * weight).sum(),
            }
        })?;
        Ok(parts.iter().sum())
    }

    /// Squared distances of rows to the centroids of their labels.
    fn distances(&self, rows: ChunkRows<'_>, labels: &[u32]) -> Vec<f64> {
        struct Distances<'a>(ChunkRows<'a>, &'a [u32], &'a [f64], usize);
        impl WithSimd for Distances<'_> {
            type Output = Vec<f64>;
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> Vec<f64> {
                let Self(rows, labels, centroids, d) = self;
                let mut x = vec![0.0; d];
                let mut distance = |(row, &label): (usize, &u32)| {
                    rows.copy(row, &mut x);
                    squared_distance(&x, &centroids[label as usize * d..][..d])
                };
                let mut distances = vec![0.0; labels.len()];
                for (row, out) in labels.iter().enumerate().zip(&mut distances) {
                    *out = distance(row);
                }
                distances
            }
        }
        fleetfoot_data::arch().dispatch(Distances(rows, labels, &self.centroids, self.points.dimensions()))
    }

    fn map_chunks<R: Send>(
        &self,
        progress: &dyn Progress,
        work: impl Fn(ChunkRows<'_>, &Rows) -> R + Sync,
    ) -> Result<Vec<R>, Cancelled> {
        parallel_map(self.chunks.len(), &Silent, |chunk| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let state = self.chunks[chunk].lock().unwrap_or_else(PoisonError::into_inner);
            Ok(work(self.points.chunk(chunk), &state))
        })
    }
}

/// The next chunk that no thread has taken.
fn claim<'a, T>(next: &AtomicUsize, chunks: &'a [T]) -> Option<(usize, &'a T)> {
    let chunk = next.fetch_add(1, Ordering::Relaxed);
    chunks.get(chunk).map(|state| (chunk, state))
}

/// The shift of each centroid and the largest of the others' together, rounded upwards, from the squared shifts.
fn shrinkage(squared: &[f64]) -> Vec<f32> {
    // Zero stays zero; a part in a million covers all rounding here.
    let shifts: Vec<f32> = squared.iter().map(|squared| (squared.sqrt() * (1.0 + 1e-6)) as f32).collect();
    let largest = (0..shifts.len()).max_by(|&a, &b| shifts[a].total_cmp(&shifts[b])).unwrap_or(0);
    let second = shifts.iter().enumerate().filter(|(k, _)| *k != largest).map(|(_, shift)| *shift).fold(0.0, f32::max);
    let others = |k: usize| {
        if k == largest { second } else { shifts[largest] }
    };
    shifts.iter().enumerate().map(|(k, shift)| (shift + others(k)) * (1.0 + 1e-6)).collect()
}
