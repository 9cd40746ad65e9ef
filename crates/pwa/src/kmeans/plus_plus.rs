//! Starting centroids: greedy k-means++.
//!
//! Arthur and Vassilvitskii, "k-means++: the advantages of careful seeding" (SODA 2007). Each next centroid is a row
//! drawn with a probability proportional to its squared distance to the nearest centroid so far. The greedy variant, as
//! in scikit-learn, draws `2 + ln k` candidates and keeps the one that leaves the least sum of squared distances.
//!
//! A candidate matters only to the rows that are nearer to it than to any centroid, and those become few. A row is
//! skipped if its centroid is more than twice as far from every candidate as from the row (triangle inequality). The
//! others are screened in `f32`, and those that remain are computed in `f64`. The skipped rows would have changed
//! nothing, not a bit.

use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetfoot_data::{Cancelled, Progress, Silent, parallel_map};
use pulp::{Simd, WithSimd};

use super::{
    Points,
    distance::squared_distance,
    points::{CHUNK, ChunkRows},
    screen::{Lane, Screen, TILE, Tile},
    transpose::prefetch,
};

/// Columns of one round; each is a bit of a mask.
const MOST: usize = 64;

/// The nearest centroid of each row of a chunk and the squared distance to it.
struct Closest {
    label: Vec<u32>,
    squared: Vec<f64>,
}

/// Result of a round in a chunk.
struct RoundResult {
    /// Sum of the squared distances to the nearest centroids.
    total: f64,
    /// By how much each candidate would lessen it.
    gains: Vec<f64>,
}

/// Candidates for each centroid but the first.
pub(super) fn trials(clusters: usize) -> usize {
    (2 + (clusters.max(1) as f64).ln() as usize).min(MOST - 1)
}

/// At most `clusters` different rows as centroids (row-major); fewer if there are fewer different rows.
///
/// `draw` gives the uniform numbers: 0 for the first centroid, then one for each candidate of each further one.
pub(super) fn plus_plus(
    points: &Points,
    clusters: usize,
    draw: impl Fn(usize) -> f64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Cancelled> {
    let d = points.dimensions();
    let trials = trials(clusters);
    let first = match points.weights() {
        None => (draw(0) * points.rows() as f64) as usize,
        Some(weights) => pass(weights, draw(0) * weights.iter().sum::<f64>()).0,
    };
    let mut centroids = points.row(first.min(points.rows() - 1));
    let chunks: Vec<Mutex<Closest>> = (0..points.chunks())
        .map(|chunk| {
            let rows = points.chunk(chunk).rows();
            Mutex::new(Closest { label: vec![0; rows], squared: vec![f64::INFINITY; rows] })
        })
        .collect();
    let rounds = Round::new(&centroids, d, &[]).run(points, &chunks, progress)?;
    let mut totals: Vec<f64> = rounds.iter().map(|round| round.total).collect();
    for cluster in 1..clusters {
        let total: f64 = totals.iter().sum();
        // Every row is a centroid already.
        if total <= 0.0 {
            break;
        }
        let renew = Round::new(&centroids, d, &[]);
        let mut candidates = Vec::with_capacity(trials * d);
        for trial in 0..trials {
            let (chunk, rest) = pass(&totals, draw((cluster - 1) * trials + trial + 1) * total);
            let mut closest = lock(&chunks[chunk]);
            renew.chunk(points.chunk(chunk), &mut closest);
            let row = match points.chunk(chunk).weights {
                None => pass(&closest.squared, rest).0,
                Some(weights) => {
                    let weighted: Vec<f64> = closest.squared.iter().zip(weights).map(|(a, b)| a * b).collect();
                    pass(&weighted, rest).0
                }
            };
            candidates.extend(points.row(chunk * CHUNK + row));
        }
        let rounds = Round::new(&centroids, d, &candidates).run(points, &chunks, progress)?;
        let gains: Vec<f64> = (0..trials).map(|trial| rounds.iter().map(|round| round.gains[trial]).sum()).collect();
        // The most gained is the least left; of equal ones the first.
        let best = (1..trials).fold(0, |best, trial| if gains[trial] > gains[best] { trial } else { best });
        centroids.extend_from_slice(&candidates[best * d..(best + 1) * d]);
        totals = left(points, &chunks, &rounds, best, &Round::new(&centroids, d, &[]));
    }
    Ok(centroids)
}

/// Index at which the running sum passes `target`, and the rest of the target there. If rounding carries it past the
/// end: the last value that counts.
fn pass(values: &[f64], mut target: f64) -> (usize, f64) {
    for (i, value) in values.iter().enumerate() {
        if target < *value {
            return (i, target);
        }
        target -= value;
    }
    (values.iter().rposition(|value| *value > 0.0).unwrap_or(0), f64::INFINITY)
}

/// The sums of the chunks when candidate `best` is a centroid.
fn left(
    points: &Points,
    chunks: &[Mutex<Closest>],
    rounds: &[RoundResult],
    best: usize,
    renew: &Round<'_>,
) -> Vec<f64> {
    let one = |(chunk, round): (usize, &RoundResult)| {
        let rest = round.total - round.gains[best];
        // A difference that lost its digits could be positive where nothing is left.
        if rest > 1e-6 * round.total { rest } else { renew.chunk(points.chunk(chunk), &mut lock(&chunks[chunk])).total }
    };
    rounds.iter().enumerate().map(one).collect()
}

fn lock(closest: &Mutex<Closest>) -> MutexGuard<'_, Closest> {
    closest.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The newest centroid, which rows may join, and candidates, which they may only consider. Joining again changes nothing.
struct Round<'a> {
    dimensions: usize,
    /// The newest centroid's number.
    newest: u32,
    candidates: &'a [f64],
    /// The newest centroid, then the candidates.
    columns: Vec<f64>,
    screen: Screen,
    /// Rows of each centroid that are nearer to it than this (squared) have nothing to gain.
    reach: Vec<f64>,
}

impl<'a> Round<'a> {
    fn new(centroids: &[f64], dimensions: usize, candidates: &'a [f64]) -> Self {
        let newest = centroids.len() / dimensions - 1;
        let columns = [&centroids[newest * dimensions..], candidates].concat();
        let reach = centroids.chunks_exact(dimensions).enumerate().map(|(label, centroid)| {
            let others = if label == newest { candidates } else { &columns };
            let near =
                others.chunks_exact(dimensions).map(|c| squared_distance(centroid, c)).fold(f64::INFINITY, f64::min);
            // Half the distance, and less by what rounding may hide.
            0.25 * near * (1.0 - 1e-9)
        });
        let reach = reach.collect();
        Self {
            dimensions,
            newest: newest as u32,
            candidates,
            screen: Screen::new(&columns, dimensions),
            columns,
            reach,
        }
    }

    fn run(
        &self,
        points: &Points,
        chunks: &[Mutex<Closest>],
        progress: &dyn Progress,
    ) -> Result<Vec<RoundResult>, Cancelled> {
        parallel_map(chunks.len(), &Silent, |chunk| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            Ok(self.chunk(points.chunk(chunk), &mut lock(&chunks[chunk])))
        })
    }

    fn chunk(&self, rows: ChunkRows<'_>, closest: &mut Closest) -> RoundResult {
        fleetfoot_data::arch().dispatch(Visit { round: self, rows, closest })
    }
}

/// One round over one chunk.
struct Visit<'a> {
    round: &'a Round<'a>,
    rows: ChunkRows<'a>,
    closest: &'a mut Closest,
}

impl WithSimd for Visit<'_> {
    type Output = RoundResult;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> RoundResult {
        let d = self.round.dimensions;
        let columns = self.round.columns.len() / d;
        let mut gains = vec![0.0; columns - 1];
        let mut tile = Tile::new(d);
        let mut bounds = vec![Lane([0.0; TILE]); columns];
        let mut x = vec![0.0; d];
        let active = self.activate();
        // Hits wait for one tile, while the low parts of their rows come from memory.
        let (mut ready, mut fresh) = (Vec::with_capacity(TILE), Vec::with_capacity(TILE));
        let mut tiles = active.chunks(TILE).peekable();
        while let Some(chosen) = tiles.next() {
            if let Some(next) = tiles.peek() {
                prefetch(self.rows.high, d, next);
            }
            self.round.screen.lower_bounds(simd, self.rows.high, chosen, &mut tile, &mut bounds);
            for (&row, mask) in chosen.iter().zip(self.hits(chosen, &bounds)) {
                if mask != 0 {
                    prefetch(self.rows.low, d, &[row]);
                    fresh.push((row, mask));
                }
            }
            self.consider(&mut ready, &mut x, &mut gains);
            std::mem::swap(&mut ready, &mut fresh);
        }
        self.consider(&mut ready, &mut x, &mut gains);
        let squared = &self.closest.squared;
        let total = match self.rows.weights {
            None => sum(squared),
            Some(weights) => sum(&squared.iter().zip(weights).map(|(a, b)| a * b).collect::<Vec<_>>()),
        };
        RoundResult { total, gains }
    }
}

impl Visit<'_> {
    /// Rows that are not out of reach.
    #[inline(always)]
    fn activate(&self) -> Vec<u32> {
        let reach = self.round.reach.as_slice();
        let mut active = vec![0; self.closest.label.len() + 1];
        let mut count = 0;
        for (row, (label, squared)) in self.closest.label.iter().zip(&self.closest.squared).enumerate() {
            active[count] = row as u32;
            let beyond = *squared < reach[*label as usize];
            count += usize::from(!beyond);
        }
        active.truncate(count);
        active
    }

    /// For each row of a tile a mask of the columns that may be nearer than its present centroid.
    #[inline(always)]
    fn hits(&self, chosen: &[u32], bounds: &[Lane]) -> [u64; TILE] {
        let mut limits = [0.0; TILE];
        for (limit, &row) in limits.iter_mut().zip(chosen) {
            *limit = self.closest.squared[row as usize] as f32 * (1.0 + 1e-6);
        }
        let mut hits = [0; TILE];
        for (column, bound) in bounds.iter().enumerate() {
            for i in 0..TILE {
                // NaN may be nearer.
                let farther = bound.0[i] > limits[i];
                hits[i] |= u64::from(!farther) << column;
            }
        }
        hits
    }

    /// Lets rows join the newest centroid, and adds their gains from the candidates.
    #[inline(always)]
    fn consider(&mut self, hits: &mut Vec<(u32, u64)>, x: &mut [f64], gains: &mut [f64]) {
        let (round, d) = (self.round, self.round.dimensions);
        for (row, mask) in hits.drain(..) {
            let row = row as usize;
            self.rows.copy(row, x);
            let weight = self.rows.weight(row);
            let mut current = self.closest.squared[row];
            if mask & 1 == 1 {
                let squared = squared_distance(x, &round.columns[..d]);
                if squared < current {
                    current = squared;
                    self.closest.squared[row] = squared;
                    self.closest.label[row] = round.newest;
                }
            }
            let mut mask = mask >> 1;
            while mask != 0 {
                let candidate = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let squared = squared_distance(x, &round.candidates[candidate * d..][..d]);
                if squared < current {
                    gains[candidate] += weight * (current - squared);
                }
            }
        }
    }
}

/// The sum in a fixed order, eight partial sums wide.
#[inline(always)]
fn sum(values: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (chunks, rest) = values.as_chunks::<8>();
    for chunk in chunks {
        for lane in 0..8 {
            sums[lane] += chunk[lane];
        }
    }
    sums.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kmeans::random::uniform;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn rounds_give_the_result_of_all_distances(
            n in 1usize..5000, d in 1usize..18, clusters in 1usize..12, spread in prop::sample::select(vec![0.01, 1.0, 30.0]), seed in any::<u64>(),
        ) {
            // Groups of rows, some of them the same row many times.
            let value = |i: usize, j: usize| {
                let group = uniform(seed, (i % 9) as u64, j as u64) * spread;
                if i.is_multiple_of(4) { group } else { group + uniform(seed, 1000 + i as u64, j as u64) }
            };
            let columns: Vec<Vec<f64>> = (0..d).map(|j| (0..n).map(|i| value(i, j)).collect()).collect();
            let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let points = Points::from_columns(&columns, &vec![0.0; d], &vec![1.0; d]).unwrap();
            let chunks: Vec<Mutex<Closest>> = (0..points.chunks())
                .map(|chunk| {
                    let rows = points.chunk(chunk).rows();
                    Mutex::new(Closest { label: vec![0; rows], squared: vec![f64::INFINITY; rows] })
                })
                .collect();
            let at = |draw: usize| points.row((uniform(seed, 7, draw as u64) * n as f64) as usize);
            let mut centroids = Vec::new();
            for cluster in 0..clusters {
                centroids.extend(at(cluster));
                let candidates: Vec<f64> = (0..3).flat_map(|trial| at(100 + 3 * cluster + trial)).collect();
                let rounds = Round::new(&centroids, d, &candidates).run(&points, &chunks, &Silent).unwrap();
                let plain: Vec<f64> = (0..n)
                    .map(|i| centroids.chunks(d).map(|c| squared_distance(&points.row(i), c)).fold(f64::INFINITY, f64::min))
                    .collect();
                for i in 0..n {
                    prop_assert_eq!(lock(&chunks[i / CHUNK]).squared[i % CHUNK], plain[i]);
                }
                let total: f64 = plain.iter().sum();
                let ours: f64 = rounds.iter().map(|round| round.total).sum();
                prop_assert!((ours - total).abs() <= 1e-12 * total);
                for (trial, candidate) in candidates.chunks(d).enumerate() {
                    let gain: f64 = (0..n).map(|i| (plain[i] - squared_distance(&points.row(i), candidate)).max(0.0)).sum();
                    let ours: f64 = rounds.iter().map(|round| round.gains[trial]).sum();
                    prop_assert!((ours - gain).abs() <= 1e-12 * (gain + total));
                }
            }
        }
    }
}
