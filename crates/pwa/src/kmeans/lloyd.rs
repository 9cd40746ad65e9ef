//! Lloyd's iteration with Hamerly's bounds.
//!
//! Each row keeps an upper bound of the distance to its centroid and a lower bound of the distances to all others (Hamerly, "Making k-means even
//! faster", SDM 2010). When centroids move, the bounds move with them; a row whose upper bound stays below its lower bound,
//! or below half the distance from its centroid to the nearest other, keeps its label unseen. The others are packed
//! into tiles for the [screen](super::screen).
//!
//! Bounds are `f32` and every operation on them is rounded outwards, so a skipped row is a proven one: labels are those
//! of the plain algorithm bit for bit. Sums are exact ([`super::sums`]), so that it does not matter either who adds what and when.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

use fleetfoot_data::{Cancelled, Progress, Silent, parallel_map, thread_count};
use pulp::{Arch, Simd, WithSimd};

use super::{
    KMeansError, Points,
    distance::{nearest, squared_distance},
    points::CHUNK,
    screen::{Screen, TILE, Tile},
    sums::{Quanta, Sums},
    transpose::prefetch,
};

/// Factors that outweigh the rounding of the two operations before them.
const UP: f32 = 1.0 + 2.4e-7;
const DOWN: f32 = 1.0 - 2.4e-7;

/// Distances must differ by more than this to be different in `f64` whatever the rounding there...
const MARGIN: f32 = 1.0 + 1e-6;

/// ... and the larger must be far from underflow when squared.
const SMALLEST: f32 = 1e-12;

/// The state between iterations.
pub(super) struct Lloyd<'a> {
    points: &'a Points,
    chunks: Vec<Mutex<Rows>>,
    sums: Sums,
    /// k x d.
    pub(super) centroids: Vec<f64>,
    moves: Vec<Move>,
}

/// What is known of the rows of one chunk.
pub(super) struct Rows {
    pub(super) labels: Vec<u32>,
    upper: Vec<f32>,
    lower: Vec<f32>,
}

/// What a row of a cluster needs to know about the last update.
#[derive(Debug, Clone, Copy)]
struct Move {
    /// How far the centroid moved, at most.
    own: f32,
    /// How far any other moved, at most.
    others: f32,
    /// Half the distance to the nearest other centroid, at least.
    half_gap: f32,
}

/// The label of a row that has none yet.
const NONE: u32 = u32::MAX;

impl<'a> Lloyd<'a> {
    pub(super) fn new(points: &'a Points, centroids: Vec<f64>) -> Self {
        let d = points.dimensions();
        let clusters = centroids.len() / d;
        let chunks = (0..points.chunks()).map(|chunk| {
            let rows = points.chunk(chunk).len() / d;
            // An upper bound of infinity makes every row active.
            Mutex::new(Rows { labels: vec![NONE; rows], upper: vec![f32::INFINITY; rows], lower: vec![0.0; rows] })
        });
        let quanta = Quanta::new(points.rows(), points.largest());
        Self {
            points,
            chunks: chunks.collect(),
            sums: Sums::new(clusters, d, quanta),
            moves: vec![Move { own: 0.0, others: 0.0, half_gap: 0.0 }; clusters],
            centroids,
        }
    }

    /// Rows of each cluster.
    pub(super) fn counts(&self) -> &[i64] {
        self.sums.counts()
    }

    /// Assigns every row to its nearest centroid, the first of equally near ones; how many labels changed.
    pub(super) fn assign(&mut self, progress: &dyn Progress) -> Result<usize, Cancelled> {
        let d = self.points.dimensions();
        let screen = Screen::new(&self.centroids, d);
        let quanta = self.sums.quanta();
        let clusters = self.moves.len();
        let next = AtomicUsize::new(0);
        let arch = Arch::new();
        // Workers take chunks as they come: the sums are exact, so their order does not matter.
        let parts = parallel_map(thread_count().min(self.chunks.len()), &Silent, |_| {
            let mut sums = Sums::new(clusters, d, quanta);
            let mut scratch = Scratch { tile: Tile::new(d), active: Vec::with_capacity(CHUNK) };
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
                    moves: &self.moves,
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
        // The bounds are up to date with these centroids.
        self.moves.fill(Move { own: 0.0, others: 0.0, half_gap: 0.0 });
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
        self.moves = moves(&squared, &self.centroids, d);
        Ok(squared.iter().sum())
    }

    /// Moves the rows that are farthest from their centroids into the empty clusters of `sums`: one each, as single members.
    fn relocate(&self, sums: &mut Sums, progress: &dyn Progress) -> Result<(), KMeansError> {
        let empty: Vec<usize> = (0..self.moves.len()).filter(|&cluster| sums.counts()[cluster] == 0).collect();
        // Farthest first, of equally far ones the first row; those that must stay may be one for each full cluster.
        let wanted = self.moves.len();
        let farthest = self.map_chunks(progress, |rows, state| {
            let distances = self.distances(rows, &state.labels).into_iter().zip(&state.labels).enumerate();
            let mut far: Vec<(f64, usize, u32)> = distances.map(|(row, (distance, label))| (distance, row, *label)).collect();
            far.retain(|(distance, ..)| *distance > 0.0);
            far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            far.truncate(wanted);
            far
        })?;
        let numbered = farthest.into_iter().enumerate();
        let mut far: Vec<(f64, usize, u32)> =
            numbered.flat_map(|(chunk, far)| far.into_iter().map(move |(distance, row, label)| (distance, chunk * CHUNK + row, label))).collect();
        far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut empty = empty.into_iter();
        let mut cluster = empty.next();
        for (_, row, label) in far {
            let Some(target) = cluster else { break };
            // The last row of a cluster stays: taking it would only move the hole.
            if sums.counts()[label as usize] > 1 {
                let row = self.points.row(row);
                sums.subtract(label as usize, row);
                sums.add(target, row);
                cluster = empty.next();
            }
        }
        Ok(())
    }

    /// Sum of the squared distances of all rows to their centroids, in the order of the rows, chunk by chunk.
    pub(super) fn inertia(&self, progress: &dyn Progress) -> Result<f64, Cancelled> {
        let parts = self.map_chunks(progress, |rows, state| self.distances(rows, &state.labels).iter().sum::<f64>())?;
        Ok(parts.iter().sum())
    }

    /// Squared distances of rows to the centroids of their labels.
    fn distances(&self, rows: &[f64], labels: &[u32]) -> Vec<f64> {
        struct Distances<'a>(&'a [f64], &'a [u32], &'a [f64], usize);
        impl WithSimd for Distances<'_> {
            type Output = Vec<f64>;
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> Vec<f64> {
                let Self(rows, labels, centroids, d) = self;
                let mut distances = vec![0.0; labels.len()];
                for ((row, &label), distance) in rows.chunks_exact(d).zip(labels).zip(&mut distances) {
                    *distance = squared_distance(row, &centroids[label as usize * d..][..d]);
                }
                distances
            }
        }
        Arch::new().dispatch(Distances(rows, labels, &self.centroids, self.points.dimensions()))
    }

    fn map_chunks<R: Send>(&self, progress: &dyn Progress, work: impl Fn(&[f64], &Rows) -> R + Sync) -> Result<Vec<R>, Cancelled> {
        parallel_map(self.chunks.len(), &Silent, |chunk| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let state = self.chunks[chunk].lock().unwrap_or_else(PoisonError::into_inner);
            Ok(work(self.points.chunk(chunk), &state))
        })
    }
}

/// The next chunk that nobody has taken.
pub(super) fn claim<'a, T>(next: &AtomicUsize, chunks: &'a [T]) -> Option<(usize, &'a T)> {
    let chunk = next.fetch_add(1, Ordering::Relaxed);
    chunks.get(chunk).map(|state| (chunk, state))
}

/// Shifts and gaps, rounded outwards, from the squared shifts and the new centroids.
fn moves(squared: &[f64], centroids: &[f64], d: usize) -> Vec<Move> {
    // Zero stays zero; a part in a million covers all rounding here.
    let shifts: Vec<f32> = squared.iter().map(|squared| (squared.sqrt() * (1.0 + 1e-6)) as f32).collect();
    let largest = (0..shifts.len()).max_by(|&a, &b| shifts[a].total_cmp(&shifts[b])).unwrap_or(0);
    let other = shifts.iter().enumerate().filter(|(k, _)| *k != largest).map(|(_, shift)| *shift).fold(0.0, f32::max);
    let mut gaps = vec![f64::INFINITY; shifts.len()];
    for a in 0..gaps.len() {
        for b in 0..a {
            let gap = squared_distance(&centroids[a * d..][..d], &centroids[b * d..][..d]);
            gaps[a] = gaps[a].min(gap);
            gaps[b] = gaps[b].min(gap);
        }
    }
    let one = |k: usize| Move {
        own: shifts[k],
        others: if k == largest { other } else { shifts[largest] },
        half_gap: (0.5 * gaps[k].sqrt() * (1.0 - 1e-6)) as f32,
    };
    (0..gaps.len()).map(one).collect()
}

/// Working memory of a worker.
struct Scratch {
    tile: Tile,
    active: Vec<u32>,
}

/// One assignment of one chunk.
struct Step<'a> {
    rows: &'a [f64],
    dimensions: usize,
    centroids: &'a [f64],
    screen: &'a Screen,
    moves: &'a [Move],
    state: &'a mut Rows,
    sums: &'a mut Sums,
    scratch: &'a mut Scratch,
}

impl WithSimd for Step<'_> {
    /// Labels that changed.
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> usize {
        self.activate();
        let mut changed = 0;
        let active = std::mem::take(&mut self.scratch.active);
        let mut tiles = active.chunks(TILE).peekable();
        while let Some(chosen) = tiles.next() {
            if let Some(next) = tiles.peek() {
                prefetch(self.rows, self.dimensions, next);
            }
            self.screen.tile(simd, self.rows, chosen, &mut self.scratch.tile);
            for (i, &row) in chosen.iter().enumerate() {
                changed += self.settle(i, row as usize);
            }
        }
        self.scratch.active = active;
        changed
    }
}

impl Step<'_> {
    /// Moves the bounds and lists the rows that they do not decide.
    #[inline(always)]
    fn activate(&mut self) {
        let Rows { labels, upper, lower } = &mut *self.state;
        let moves = self.moves;
        let active = &mut self.scratch.active;
        active.clear();
        active.resize(labels.len() + 1, 0);
        let slots = active.as_mut_slice();
        let mut count = 0;
        if labels.first() == Some(&NONE) {
            // The first assignment of these rows.
            count = labels.len();
            slots.iter_mut().enumerate().for_each(|(row, slot)| *slot = row as u32);
        } else {
            for (row, ((label, upper), lower)) in labels.iter().zip(upper).zip(lower).enumerate() {
                let step = moves[*label as usize];
                *upper = (*upper + step.own) * UP;
                *lower = (*lower - step.others) * DOWN;
                slots[count] = row as u32;
                count += usize::from(*upper * MARGIN + SMALLEST >= lower.max(step.half_gap));
            }
        }
        active.truncate(count);
    }

    /// Takes over what the screen found for row `i` of the tile; 1 if its label changed.
    #[inline(always)]
    fn settle(&mut self, i: usize, row: usize) -> usize {
        let d = self.dimensions;
        let tile = &self.scratch.tile;
        let (mut label, mut upper, mut lower) = (tile.label.0[i], tile.upper.0[i], tile.lower.0[i]);
        let x = &self.rows[row * d..(row + 1) * d];
        if tile.doubt[i] {
            let found = nearest(x, self.centroids);
            label = found.label;
            upper = (found.first.sqrt() * (1.0 + 1e-6)) as f32;
            lower = (found.second.sqrt() * (1.0 - 1e-6)).min(f64::from(f32::MAX)) as f32;
        }
        let old = std::mem::replace(&mut self.state.labels[row], label);
        self.state.upper[row] = upper;
        self.state.lower[row] = lower;
        if old == label {
            return 0;
        }
        if old != NONE {
            self.sums.subtract(old as usize, x);
        }
        self.sums.add(label as usize, x);
        1
    }
}
