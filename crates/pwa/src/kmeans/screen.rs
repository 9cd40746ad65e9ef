//! The screen: nearest centroids of a tile of rows in `f32`, with a proof or a doubt for every row.
//!
//! With `h = ||c||^2 / 2`, the nearest centroid has the least score `h - x.c` (half the squared distance less
//! `||x||^2 / 2`). The kernel computes all scores of a tile with fused multiply-adds. It keeps in registers the two
//! least of each row and the place of the least; no score reaches memory.
//!
//! A bound on the rounding proves the answer. With unit roundoff `u = 2^-24`, rounding occurs in `x` (towards zero:
//! `2 u`), in `c` and `h`, and in the `d` multiply-adds. It changes a score by at most `e (h + ||x|| ||c||)`,
//! `e = (d + 16) u`. This is at most `e (2 h + ||x||^2 / 2)`. The part `2 e h` of a centroid is taken off its `h`
//! beforehand. Then a computed score exceeds the true one by at most `e ||x||^2 / 2`. It falls short of it by at most
//! `4 e h + e ||x||^2 / 2`; one far centroid spoils only its own scores. If the gap between the two least scores is
//! larger than the sum of the two errors, the first is the nearest centroid, strictly. This holds also in the `f64`
//! arithmetic of [`squared_distance`](super::distance::squared_distance), whose error is accounted for. Otherwise the
//! row is in doubt, and the caller compares all centroids in `f64`.

use pulp::Simd;

use super::transpose::gather;

/// Rows of a tile.
pub(super) const TILE: usize = 64;

/// Centroids whose scores are accumulated together: with four vectors of rows they fill the 32 registers of AVX-512.
const GROUP: usize = 6;

/// Centroids beyond this could overflow `f32` scores. Rows need no such limit: their squared norm overflows first, and that is a doubt.
const LARGEST: f64 = 1e12;

/// Squared distances below it may have lost all digits to underflow.
const TINY: f32 = 1e-25;

/// Centroids laid out for the kernel.
#[derive(Debug, Clone)]
pub(super) struct Screen {
    dimensions: usize,
    /// Negated coordinates, group by group: for every dimension the group's centroids.
    negated: Vec<f32>,
    /// `h`, less its share of the error.
    half_norms: Vec<f32>,
    /// Centroids of each group: `GROUP` or one less, except when there are few.
    groups: Vec<usize>,
    /// The constant `e`.
    error: f32,
    /// True if the centroids fit `f32`; if not, every row is in doubt.
    safe: bool,
}

/// Working memory and results for one tile.
#[derive(Debug, Clone)]
pub(super) struct Tile {
    /// `d x TILE` coordinates about the origin, rows contiguous.
    x: Vec<Lane>,
    /// `||x||^2` of the rows.
    norms: Lane,
    first: Lane,
    second: Lane,
    /// The place of the least score.
    pub(super) label: LabelLane,
    /// At most the distance to the second-nearest centroid less that to the nearest, by a margin that `f64` cannot miss.
    pub(super) gap: Lane,
    /// Rows whose nearest centroid is not proven.
    pub(super) doubt: [bool; TILE],
}

/// One value for each row of a tile, aligned to cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Lane(pub(super) [f32; TILE]);

/// One label for each row of a tile.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct LabelLane(pub(super) [u32; TILE]);

impl Tile {
    pub(super) fn new(dimensions: usize) -> Self {
        let zero = Lane([0.0; TILE]);
        Self {
            x: vec![zero; dimensions],
            norms: zero,
            first: zero,
            second: zero,
            label: LabelLane([0; TILE]),
            gap: zero,
            doubt: [false; TILE],
        }
    }
}

impl Screen {
    /// Prepares `centroids` (k x d).
    pub(super) fn new(centroids: &[f64], dimensions: usize) -> Self {
        let clusters = centroids.len() / dimensions;
        let error = (dimensions as f32 + 16.0) * 2f32.powi(-24);
        let count = clusters.div_ceil(GROUP);
        let groups: Vec<usize> = (0..count).map(|g| clusters * (g + 1) / count - clusters * g / count).collect();
        let mut negated = Vec::with_capacity(centroids.len());
        let mut from = 0;
        for &members in &groups {
            let rows = &centroids[from * dimensions..(from + members) * dimensions];
            for j in 0..dimensions {
                negated.extend((0..members).map(|c| -rows[c * dimensions + j] as f32));
            }
            from += members;
        }
        let half_norms = centroids.chunks_exact(dimensions).map(|c| {
            let half = 0.5 * c.iter().map(|c| c * c).sum::<f64>();
            (half * (1.0 - 2.0 * f64::from(error))) as f32
        });
        let half_norms = half_norms.collect();
        let extent = centroids.iter().fold(0.0, |extent: f64, c| extent.max(c.abs()));
        // Beyond 100,000 dimensions the rounding bound itself would need care.
        let safe = extent < LARGEST && dimensions < 100_000;
        Self { dimensions, negated, half_norms, groups, error, safe }
    }

    /// Screens the rows of `rows` (row-major) whose numbers stand in `chosen`, at most `TILE` of them. Results beyond `chosen.len()` mean nothing.
    #[inline(always)]
    pub(super) fn tile<S: Simd>(&self, simd: S, rows: &[f32], chosen: &[u32], tile: &mut Tile) {
        if !self.safe {
            tile.doubt = [true; TILE];
            return;
        }
        gather(rows, self.dimensions, chosen, &mut tile.x);
        if S::F32_LANES >= 16 {
            self.least::<S, 4>(simd, chosen.len(), tile);
        } else {
            self.least::<S, 2>(simd, chosen.len(), tile);
        }
        self.judge(tile);
    }

    /// Lower bounds of the squared distances of the chosen rows to every centroid, one `Lane` each.
    #[inline(always)]
    pub(super) fn lower_bounds<S: Simd>(
        &self,
        simd: S,
        rows: &[f32],
        chosen: &[u32],
        tile: &mut Tile,
        out: &mut [Lane],
    ) {
        if !self.safe {
            out.fill(Lane([f32::NEG_INFINITY; TILE]));
            return;
        }
        gather(rows, self.dimensions, chosen, &mut tile.x);
        if S::F32_LANES >= 16 {
            self.all::<S, 4>(simd, chosen.len(), tile, out);
        } else {
            self.all::<S, 2>(simd, chosen.len(), tile, out);
        }
        for lane in out {
            for (bound, norm) in lane.0.iter_mut().zip(&tile.norms.0) {
                *bound = self.below(*norm, *bound);
            }
        }
    }

    /// At most the squared distance that belongs to a score.
    #[inline(always)]
    fn below(&self, norm: f32, score: f32) -> f32 {
        (norm + 2.0 * (score - self.error * norm)) - (4.0 * self.error * norm + TINY)
    }

    /// Least scores of a tile; `P` vectors of rows at a time.
    #[inline(always)]
    fn least<S: Simd, const P: usize>(&self, simd: S, rows: usize, tile: &mut Tile) {
        for at in steps::<S, P>(rows) {
            let mut best = Best::<S, P> {
                first: [simd.splat_f32s(f32::INFINITY); P],
                second: [simd.splat_f32s(f32::INFINITY); P],
                label: [simd.splat_u32s(0); P],
            };
            self.walk(simd, &tile.x, at, &mut best);
            store::<S, P>(&mut tile.norms.0, at, norms(simd, &tile.x, at));
            store::<S, P>(&mut tile.first.0, at, best.first);
            store::<S, P>(&mut tile.second.0, at, best.second);
            let (out, _) = S::as_mut_simd_u32s(&mut tile.label.0[at..at + P * S::F32_LANES]);
            out.copy_from_slice(&best.label);
        }
    }

    /// All scores of a tile.
    #[inline(always)]
    fn all<S: Simd, const P: usize>(&self, simd: S, rows: usize, tile: &mut Tile, out: &mut [Lane]) {
        for at in steps::<S, P>(rows) {
            self.walk::<S, P>(simd, &tile.x, at, &mut Keep { out, at });
            store::<S, P>(&mut tile.norms.0, at, norms(simd, &tile.x, at));
        }
    }

    /// Scores of `P` vectors of rows, group by group.
    #[inline(always)]
    fn walk<S: Simd, const P: usize>(&self, simd: S, x: &[Lane], at: usize, taker: &mut impl Take<S, P>) {
        let (mut label, mut from) = (0, 0);
        for &members in &self.groups {
            let size = members * self.dimensions;
            let group = &self.negated[from..from + size];
            let half = &self.half_norms[label..label + members];
            match members {
                6 => taker.take(simd, label, scores::<S, P, 6>(simd, x, at, group, half)),
                5 => taker.take(simd, label, scores::<S, P, 5>(simd, x, at, group, half)),
                4 => taker.take(simd, label, scores::<S, P, 4>(simd, x, at, group, half)),
                3 => taker.take(simd, label, scores::<S, P, 3>(simd, x, at, group, half)),
                2 => taker.take(simd, label, scores::<S, P, 2>(simd, x, at, group, half)),
                _ => taker.take(simd, label, scores::<S, P, 1>(simd, x, at, group, half)),
            }
            label += members;
            from += size;
        }
    }

    /// Turns scores into gaps and doubts.
    #[inline(always)]
    fn judge(&self, tile: &mut Tile) {
        let e = self.error;
        let mut half = Lane([0.0; TILE]);
        for (half, label) in half.0.iter_mut().zip(&tile.label.0) {
            *half = self.half_norms[*label as usize];
        }
        for i in 0..TILE {
            let (norm, first, second) = (tile.norms.0[i], tile.first.0[i], tile.second.0[i]);
            // One per cent covers the rounding of `norm`, of `half` and of these lines.
            let excess = 1.01 * e * (4.0 * half.0[i] + norm) + TINY;
            let near = (norm + 2.0 * (first + excess)) + 2.0 * e * norm;
            let far = self.below(norm, second);
            tile.gap.0[i] = gap(near.max(0.0).sqrt(), far.max(0.0).sqrt());
            // NaN proves nothing.
            let proven = second - first > excess;
            tile.doubt[i] = !proven;
        }
    }
}

/// `far - near`, less a margin of parts in a million for the rounding before and here, and for underflow.
#[inline(always)]
pub(super) fn gap(near: f32, far: f32) -> f32 {
    far * (1.0 - 2e-6) - (near * (1.0 + 2e-6) + 1e-12)
}

/// Consumer of the scores of `C` centroids, the first of which is `label`, for `P` vectors of rows.
trait Take<S: Simd, const P: usize> {
    fn take<const C: usize>(&mut self, simd: S, label: usize, scores: [[S::f32s; P]; C]);
}

/// The two least scores and the place of the least, for `P` vectors of rows.
struct Best<S: Simd, const P: usize> {
    first: [S::f32s; P],
    second: [S::f32s; P],
    label: [S::u32s; P],
}

impl<S: Simd, const P: usize> Take<S, P> for Best<S, P> {
    #[inline(always)]
    fn take<const C: usize>(&mut self, simd: S, label: usize, scores: [[S::f32s; P]; C]) {
        for c in 0..C {
            let name = simd.splat_u32s((label + c) as u32);
            for p in 0..P {
                let score = scores[c][p];
                let better = simd.less_than_f32s(score, self.first[p]);
                self.label[p] = simd.select_u32s(better, name, self.label[p]);
                self.second[p] = simd.min_f32s(self.second[p], simd.max_f32s(self.first[p], score));
                self.first[p] = simd.min_f32s(self.first[p], score);
            }
        }
    }
}

/// Keeps all scores, one lane a centroid.
struct Keep<'a> {
    out: &'a mut [Lane],
    at: usize,
}

impl<S: Simd, const P: usize> Take<S, P> for Keep<'_> {
    #[inline(always)]
    fn take<const C: usize>(&mut self, _: S, label: usize, scores: [[S::f32s; P]; C]) {
        for c in 0..C {
            store::<S, P>(&mut self.out[label + c].0, self.at, scores[c]);
        }
    }
}

/// Starts of the vectors of rows. The last step overlaps nothing: a tile is a whole number of steps.
fn steps<S: Simd, const P: usize>(rows: usize) -> impl Iterator<Item = usize> {
    const { assert!(TILE.is_multiple_of(P * S::F32_LANES)) };
    (0..rows.min(TILE)).step_by(P * S::F32_LANES)
}

/// Scores of `P` vectors of rows and the `C` centroids of a group.
#[inline(always)]
fn scores<S: Simd, const P: usize, const C: usize>(
    simd: S,
    x: &[Lane],
    at: usize,
    group: &[f32],
    half: &[f32],
) -> [[S::f32s; P]; C] {
    let mut scores: [[S::f32s; P]; C] = std::array::from_fn(|c| [simd.splat_f32s(half[c]); P]);
    let (negated, _) = group.as_chunks::<C>();
    for (x, negated) in x.iter().zip(negated) {
        let x = vectors::<S, P>(&x.0, at);
        for c in 0..C {
            let coordinate = simd.splat_f32s(negated[c]);
            for p in 0..P {
                scores[c][p] = simd.mul_add_f32s(x[p], coordinate, scores[c][p]);
            }
        }
    }
    scores
}

/// Squared norms of `P` vectors of rows.
#[inline(always)]
fn norms<S: Simd, const P: usize>(simd: S, x: &[Lane], at: usize) -> [S::f32s; P] {
    let mut norms = [simd.splat_f32s(0.0); P];
    for x in x {
        let x = vectors::<S, P>(&x.0, at);
        for p in 0..P {
            norms[p] = simd.mul_add_f32s(x[p], x[p], norms[p]);
        }
    }
    norms
}

#[inline(always)]
fn vectors<S: Simd, const P: usize>(lane: &[f32; TILE], at: usize) -> [S::f32s; P] {
    let (values, _) = S::as_simd_f32s(&lane[at..at + P * S::F32_LANES]);
    std::array::from_fn(|p| values[p])
}

#[inline(always)]
fn store<S: Simd, const P: usize>(lane: &mut [f32; TILE], at: usize, values: [S::f32s; P]) {
    let (out, _) = S::as_mut_simd_f32s(&mut lane[at..at + P * S::F32_LANES]);
    out.copy_from_slice(&values);
}

#[cfg(test)]
mod tests {
    use super::super::{
        distance::{nearest, squared_distance},
        random::uniform,
    };
    use super::*;
    use pulp::{Scalar, WithSimd};

    struct Run<'a>(&'a Screen, &'a [f32], &'a [u32], &'a mut Tile, &'a mut [Lane]);

    impl WithSimd for Run<'_> {
        type Output = ();
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(screen, rows, chosen, tile, bounds) = self;
            screen.lower_bounds(simd, rows, chosen, tile, bounds);
            screen.tile(simd, rows, chosen, tile);
        }
    }

    /// Checks the screen's claims about `count` rows, in the arithmetic of any vector length; returns the number of
    /// doubts.
    fn check(rows: &[f64], d: usize, centroids: &[f64], run: impl Fn(Run<'_>)) -> usize {
        let k = centroids.len() / d;
        // As the rows of `Points`: rounded towards zero.
        let towards_zero = |x: &f64| {
            let near = *x as f32;
            if f64::from(near).abs() > x.abs() { f32::from_bits(near.to_bits() - 1) } else { near }
        };
        let high: Vec<f32> = rows.iter().map(towards_zero).collect();
        let screen = Screen::new(centroids, d);
        let chosen: Vec<u32> = (0..(rows.len() / d) as u32).collect();
        let mut doubts = 0;
        for chosen in chosen.chunks(TILE) {
            let (mut tile, mut bounds) = (Tile::new(d), vec![Lane([0.0; TILE]); k]);
            run(Run(&screen, &high, chosen, &mut tile, &mut bounds));
            for (i, &row) in chosen.iter().enumerate() {
                let x = &rows[row as usize * d..][..d];
                for (c, bound) in centroids.chunks(d).zip(&bounds) {
                    assert!(f64::from(bound.0[i]) <= squared_distance(x, c));
                }
                if tile.doubt[i] {
                    doubts += 1;
                    continue;
                }
                let nearest = nearest(x, centroids);
                assert_eq!(tile.label.0[i], nearest.label);
                let gap = f64::from(tile.gap.0[i]);
                assert!(k == 1 || gap < nearest.second.sqrt() - nearest.first.sqrt(), "{gap} {nearest:?}");
            }
        }
        doubts
    }

    #[test]
    fn screened_labels_are_right_and_few_rows_stay_open() {
        for (d, k, offset) in [(1, 1, 0.0), (3, 7, 0.0), (16, 50, 0.0), (19, 13, 3.0), (40, 6, 1.0), (5, 9, 1e4)] {
            let value = |i: usize| offset + 4.0 * uniform(3, d as u64, i as u64) - 2.0;
            let rows: Vec<f64> = (0..1000 * d).map(value).collect();
            let mut centroids: Vec<f64> = (0..k * d).map(|i| value(1_000_000 + i)).collect();
            // One far centroid must not spoil the others; one in two places is a tie.
            if k > 8 {
                centroids[2 * d..3 * d].fill(1e7);
                centroids.copy_within(4 * d..5 * d, 6 * d);
            }
            let ties = (0..1000)
                .map(|i| nearest(&rows[i * d..][..d], &centroids))
                .filter(|nearest| nearest.first == nearest.second)
                .count();
            let open = [
                check(&rows, d, &centroids, |run| run.with_simd(Scalar::new())),
                check(&rows, d, &centroids, |run| fleetfoot_data::arch().dispatch(run)),
            ];
            #[cfg(target_arch = "x86_64")]
            if let Some(simd) = pulp::x86::V3::try_new() {
                check(&rows, d, &centroids, |run| Simd::vectorize(simd, run));
            }
            if offset < 10.0 {
                assert!(open.iter().all(|open| *open <= ties + 5), "d {d} k {k}: {open:?} open, {ties} ties");
            }
        }
    }
}
