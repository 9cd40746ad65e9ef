//! The assignment of one chunk, with Hamerly's bounds.
//!
//! Each row keeps a gap: at most the distance to its second-nearest centroid less that to its nearest (the difference
//! of the two bounds of Hamerly, "Making k-means even faster", SDM 2010). When centroids move, the gap shrinks by the
//! shift of the row's centroid and the largest shift of the others. A row whose gap stays positive keeps its label
//! unseen. The others are packed into tiles for the [screen](super::screen). Hamerly's second test, half the distance
//! to the next centroid, decided nothing more in our measurements.
//!
//! Gaps are `f32` and every operation on them is rounded downwards, so a skipped row is a proven one. Labels are those
//! of the plain algorithm bit for bit.

use pulp::{Simd, WithSimd};

use super::{
    distance::nearest,
    points::{CHUNK, ChunkRows},
    screen::{Screen, TILE, Tile, gap},
    sums::Sums,
    transpose::prefetch,
};

/// Outweighs the rounding of a subtraction and of its own multiplication.
const DOWN: f32 = 1.0 - 2.4e-7;

/// State of the rows of one chunk: labels, and gaps to the second centroid.
pub(super) struct Rows {
    pub(super) labels: Vec<u32>,
    gaps: Vec<f32>,
}

impl Rows {
    /// Nothing is known yet.
    pub(super) fn new(rows: usize) -> Self {
        Self { labels: vec![NONE; rows], gaps: vec![0.0; rows] }
    }
}

/// The label of a row that has none yet.
const NONE: u32 = u32::MAX;

/// Working memory of a worker.
pub(super) struct Scratch {
    tile: Tile,
    active: Vec<u32>,
    /// Rows whose label changed, and the labels they had.
    changed: Vec<(u32, u32)>,
    x: Vec<f64>,
}

impl Scratch {
    pub(super) fn new(dimensions: usize) -> Self {
        let (active, changed) = (Vec::with_capacity(CHUNK + 1), Vec::with_capacity(CHUNK));
        Self { tile: Tile::new(dimensions), active, changed, x: vec![0.0; dimensions] }
    }
}

/// One assignment of one chunk.
pub(super) struct Step<'a> {
    pub(super) rows: ChunkRows<'a>,
    pub(super) dimensions: usize,
    pub(super) centroids: &'a [f64],
    pub(super) screen: &'a Screen,
    /// By how much the gaps of the rows of each cluster may have shrunk.
    pub(super) shrinkage: &'a [f32],
    pub(super) state: &'a mut Rows,
    /// Takes the changes.
    pub(super) sums: &'a mut Sums,
    pub(super) scratch: &'a mut Scratch,
}

impl WithSimd for Step<'_> {
    /// Labels that changed.
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> usize {
        self.activate();
        self.scratch.changed.clear();
        let active = std::mem::take(&mut self.scratch.active);
        let mut tiles = active.chunks(TILE).peekable();
        while let Some(chosen) = tiles.next() {
            if let Some(next) = tiles.peek() {
                prefetch(self.rows.high, self.dimensions, next);
            }
            self.screen.tile(simd, self.rows.high, chosen, &mut self.scratch.tile);
            self.settle(chosen);
        }
        self.scratch.active = active;
        self.transfer();
        self.scratch.changed.len()
    }
}

impl Step<'_> {
    /// Shrinks the gaps and lists the rows that they do not decide.
    #[inline(always)]
    fn activate(&mut self) {
        let Rows { labels, gaps } = &mut *self.state;
        let shrinkage = self.shrinkage;
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
            for (row, (label, gap)) in labels.iter().zip(gaps).enumerate() {
                *gap = (*gap - shrinkage[*label as usize]) * DOWN;
                slots[count] = row as u32;
                let decided = *gap > 0.0;
                count += usize::from(!decided);
            }
        }
        active.truncate(count);
    }

    /// Takes over the screen's results for the rows of a tile, and lists those whose label changed.
    #[inline(always)]
    fn settle(&mut self, chosen: &[u32]) {
        let Scratch { tile, changed, x, .. } = &mut *self.scratch;
        let Rows { labels, gaps } = &mut *self.state;
        for (i, &row) in chosen.iter().enumerate() {
            let (mut label, mut between) = (tile.label.0[i], tile.gap.0[i]);
            if tile.doubt[i] {
                self.rows.copy(row as usize, x);
                let nearest = nearest(x, self.centroids);
                label = nearest.label;
                // A single centroid has no second.
                between = gap(nearest.first.sqrt() as f32, nearest.second.sqrt().min(f64::from(f32::MAX)) as f32);
            }
            gaps[row as usize] = between;
            let old = std::mem::replace(&mut labels[row as usize], label);
            if old != label {
                changed.push((row, old));
            }
        }
    }

    /// Moves the rows whose label changed from sum to sum.
    #[inline(always)]
    fn transfer(&mut self) {
        /// Distance of prefetching, in rows.
        const AHEAD: usize = 12;
        let Scratch { changed, x, .. } = &mut *self.scratch;
        for (i, &(row, old)) in changed.iter().enumerate() {
            if let Some(&(next, _)) = changed.get(i + AHEAD) {
                prefetch(self.rows.low, self.dimensions, &[next]);
                prefetch(self.rows.high, self.dimensions, &[next]);
            }
            self.rows.copy(row as usize, x);
            let from = (old != NONE).then_some(old as usize);
            let weight = self.rows.weights.map(|weights| weights[row as usize]);
            self.sums.transfer(from, self.state.labels[row as usize] as usize, x, weight);
        }
    }
}
