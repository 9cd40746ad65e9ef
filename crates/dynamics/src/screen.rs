//! Screen for the highest of many linear scores, in single precision. A certain answer is also the winner of the exact
//! scores.
//!
//! Single precision takes half the memory and half the instructions. Its rounding has a bound. A winner that leads by
//! more is the winner of the exact scores; the caller settles a smaller lead. So no result depends on the precision of
//! the screen.

use pulp::{Simd, bytemuck};

use crate::aligned::Aligned;

/// Single-precision values of the widest vector.
const WIDE: usize = 16;

/// Beyond this size of a score single precision could overflow on the way.
const LARGEST: f64 = 1e30;

/// `w_i . z + b_i` of cells i, in single precision, one vector lane a cell.
pub(crate) struct Screen {
    width: usize,
    /// Columns x width.
    weights: Singles,
    /// Width; minus infinity in the padding.
    offsets: Singles,
    /// Per cell, width: `1 / |w_i - w_j|`.
    nearness: Singles,
    /// 0, 1, 2, ...
    indices: Singles,
    largest_weight: f64,
    largest_offset: f64,
}

/// Single-precision values that start on a cache line.
pub(crate) struct Singles(Aligned);

impl Singles {
    pub(crate) fn new(length: usize, value: f32) -> Self {
        let mut singles = Self(Aligned::new(length.div_ceil(2), 0.0));
        singles.values_mut().fill(value);
        singles
    }

    #[inline(always)]
    fn values(&self) -> &[f32] {
        bytemuck::cast_slice(&self.0)
    }

    #[inline(always)]
    fn values_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// Memory of a search.
pub(crate) struct Screened {
    z: Singles,
    scores: Singles,
    /// The cell of the highest score, and that score.
    pub(crate) cell: usize,
    top: f32,
}

impl Screen {
    /// Rows of weights, each of so many columns. `alike(i, j)`: it does not matter which of the two cells wins.
    pub(crate) fn new(
        weights: &[Vec<f64>],
        offsets: &[f64],
        columns: usize,
        alike: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let count = offsets.len();
        let width = count.next_multiple_of(WIDE);
        let length = |row: &[f64]| row.iter().map(|w| w * w).sum::<f64>().sqrt();
        let mut screen = Self {
            width,
            weights: Singles::new(columns * width, 0.0),
            offsets: Singles::new(width, f32::NEG_INFINITY),
            nearness: Singles::new(count * width, 1.0),
            indices: Singles::new(width, 0.0),
            largest_weight: weights.iter().map(|row| length(row)).fold(0.0, f64::max),
            largest_offset: offsets.iter().fold(0.0, |a: f64, b| a.max(b.abs())),
        };
        for (i, index) in screen.indices.values_mut().iter_mut().enumerate() {
            *index = i as f32;
        }
        for (i, row) in weights.iter().enumerate() {
            screen.offsets.values_mut()[i] = offsets[i] as f32;
            for (column, &weight) in row.iter().enumerate() {
                screen.weights.values_mut()[column * width + i] = weight as f32;
            }
            for (j, other) in weights.iter().enumerate() {
                let apart: Vec<f64> = row.iter().zip(other).map(|(a, b)| a - b).collect();
                // The cell itself is no rival; of two that are alike, a lead is far from any border, and none is for the exact scores.
                screen.nearness.values_mut()[i * width + j] = match length(&apart) {
                    _ if i == j => f32::NEG_INFINITY,
                    _ if alike(i, j) => 1e30,
                    d => (1.0 / d).min(1e30) as f32,
                };
            }
        }
        screen
    }

    /// Memory for searches in so many columns.
    pub(crate) fn memory(&self, columns: usize) -> Screened {
        Screened {
            z: Singles::new(columns.next_multiple_of(WIDE), 0.0),
            scores: Singles::new(self.width, 0.0),
            cell: 0,
            top: 0.0,
        }
    }

    /// First stage: the scores at `z`.
    #[inline(always)]
    pub(crate) fn score<S: Simd>(&self, simd: S, z: &[f64], memory: &mut Screened) {
        let Screened { z: narrow, scores, .. } = memory;
        let narrow = &mut narrow.values_mut()[..z.len()];
        for (narrow, &z) in narrow.iter_mut().zip(z) {
            *narrow = z as f32;
        }
        let (weights, offsets) = (S::as_simd_f32s(self.weights.values()).0, S::as_simd_f32s(self.offsets.values()).0);
        let scores = S::as_mut_simd_f32s(scores.values_mut()).0;
        let mut from = 0;
        // As many sums side by side as keep the adder busy.
        while from + 4 <= offsets.len() {
            scores_of::<S, 4>(simd, weights, offsets, narrow, from, scores);
            from += 4;
        }
        while from < offsets.len() {
            scores_of::<S, 1>(simd, weights, offsets, narrow, from, scores);
            from += 1;
        }
    }

    /// Second stage: the highest score.
    #[inline(always)]
    pub(crate) fn choose<S: Simd>(&self, simd: S, memory: &mut Screened) {
        let scores = S::as_simd_f32s(memory.scores.values()).0;
        let mut best = simd.splat_f32s(f32::NEG_INFINITY);
        for &score in scores {
            best = simd.max_f32s(score, best);
        }
        let top = simd.reduce_max_f32s(best);
        let (all, mut winner) = (simd.splat_f32s(top), simd.splat_f32s(f32::INFINITY));
        for (&score, &index) in scores.iter().zip(S::as_simd_f32s(self.indices.values()).0) {
            let matching = simd.select_f32s(simd.greater_than_or_equal_f32s(score, all), index, winner);
            winner = simd.min_f32s(matching, winner);
        }
        (memory.top, memory.cell) = (top, simd.reduce_min_f32s(winner) as u32 as usize);
    }

    /// Last stage: how far z may move until another cell than [`Screened::cell`] may win, positive; `None` where it is not certain that this one wins. `size` is
    /// `|z|`.
    #[inline(always)]
    pub(crate) fn free<S: Simd>(&self, simd: S, memory: &Screened, size: f64) -> Option<f64> {
        // |w . z + b| of any cell, anywhere within the largest radius that is allowed, 1 + |z|.
        let reach = self.largest_offset + self.largest_weight * (2.0 * size + 1.0);
        if reach.is_nan() || reach > LARGEST {
            return None;
        }
        // Of either score: its inputs are rounded, and every term of its sum.
        let terms = (memory.z.values().len() + 4) as f64;
        let rounding = 2.0 * terms * f64::from(f32::EPSILON) * reach + f64::from(f32::MIN_POSITIVE);
        let nearness = self.nearness.values().get(memory.cell * self.width..)?.get(..self.width)?;
        let (all, rounding) = (simd.splat_f32s(memory.top), simd.splat_f32s(rounding as f32));
        let mut least = simd.splat_f32s(f32::INFINITY);
        let scores = S::as_simd_f32s(memory.scores.values()).0;
        for (&score, &nearness) in scores.iter().zip(S::as_simd_f32s(nearness).0) {
            let lead = simd.sub_f32s(simd.sub_f32s(all, score), rounding);
            least = simd.min_f32s(simd.mul_f32s(lead, nearness), least);
        }
        // The radius itself is computed to a few parts in 1e7.
        let free = f64::from(simd.reduce_min_f32s(least)) * (1.0 - 1e-6);
        (free > 0.0).then_some(free)
    }
}

/// `V` vectors of scores.
#[inline(always)]
fn scores_of<S: Simd, const V: usize>(
    simd: S,
    weights: &[S::f32s],
    offsets: &[S::f32s],
    z: &[f32],
    from: usize,
    out: &mut [S::f32s],
) {
    let mut sums = [simd.splat_f32s(0.0); V];
    sums.copy_from_slice(&offsets[from..from + V]);
    for (&z, row) in z.iter().zip(weights.chunks_exact(offsets.len())) {
        let (z, row) = (simd.splat_f32s(z), &row[from..from + V]);
        for v in 0..V {
            sums[v] = simd.mul_add_f32s(row[v], z, sums[v]);
        }
    }
    out[from..from + V].copy_from_slice(&sums);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use pulp::WithSimd;

    /// A search at z by the screen alone: the cell and how far it goes, where that is certain.
    struct Search<'a>(&'a Screen, &'a [f64]);

    impl WithSimd for Search<'_> {
        type Output = Option<(usize, f64)>;

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let Self(screen, z) = self;
            let mut memory = screen.memory(z.len());
            screen.score(simd, z, &mut memory);
            screen.choose(simd, &mut memory);
            let size = z.iter().map(|z| z * z).sum::<f64>().sqrt();
            screen.free(simd, &memory, size).map(|free| (memory.cell, free))
        }
    }

    fn scores(weights: &[Vec<f64>], offsets: &[f64], z: &[f64]) -> Vec<f64> {
        let score = |(row, offset): (&Vec<f64>, &f64)| row.iter().zip(z).map(|(w, z)| w * z).sum::<f64>() + offset;
        weights.iter().zip(offsets).map(score).collect()
    }

    fn winner(scores: &[f64]) -> usize {
        (0..scores.len()).fold(0, |best, i| if scores[i] > scores[best] { i } else { best })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// A certain answer holds for the exact scores, here and within its free radius towards any rival. A doubtful
        /// row has no answer.
        #[test]
        fn certain_choices_equal_the_exact_choice(
            columns in 1usize..20,
            cells in prop::collection::vec((prop::collection::vec(-3.0f64..3.0, 20), -4.0f64..4.0), 1..70),
            z in prop::collection::vec(-2.0f64..2.0, 20),
            (tie, magnitude) in (any::<bool>(), -3i32..9),
        ) {
            let weights: Vec<Vec<f64>> = cells.iter().map(|cell| cell.0[..columns].to_vec()).collect();
            let z: Vec<f64> = z[..columns].iter().map(|z| z * 10f64.powi(magnitude)).collect();
            let mut offsets: Vec<f64> = cells.iter().map(|cell| cell.1).collect();
            let exact = scores(&weights, &offsets, &z);
            let first = winner(&exact);
            if tie && cells.len() > 1 {
                // Another cell comes within a rounding of single precision.
                let rival = (first + 1) % cells.len();
                offsets[rival] += exact[first] - exact[rival] + 1e-9 * (1.0 + exact[first].abs());
            }
            let screen = Screen::new(&weights, &offsets, columns, |_, _| false);
            let screened = Search(&screen, &z).with_simd(pulp::Scalar);
            let wide = fleetfoot_data::arch().dispatch(Search(&screen, &z));
            prop_assert_eq!(screened, wide, "every sum is the same chain on any machine");
            let Some((cell, free)) = screened else { return Ok(()) };
            prop_assert!(free > 0.0 && !(tie && cells.len() > 1));
            prop_assert_eq!(cell, winner(&scores(&weights, &offsets, &z)));
            for rival in (0..weights.len()).filter(|&rival| rival != cell && free < 1e6) {
                let apart: Vec<f64> = weights[rival].iter().zip(&weights[cell]).map(|(a, b)| a - b).collect();
                let length = apart.iter().map(|a| a * a).sum::<f64>().sqrt();
                let moved: Vec<f64> = z.iter().zip(&apart).map(|(z, a)| z + 0.999 * free * a / length).collect();
                let moved = scores(&weights, &offsets, &moved);
                prop_assert!(moved[cell] >= moved[rival] - 1e-12 * (1.0 + moved[cell].abs()));
            }
        }
    }

    /// A value that is not a number, or too large for single precision, has no answer.
    #[test]
    fn overflowing_scores_are_left_to_the_exact_search() {
        let screen = Screen::new(&[vec![1.0], vec![-1.0]], &[0.0, 0.0], 1, |_, _| false);
        for z in [f64::NAN, f64::INFINITY, 1e31, 0.0] {
            assert_eq!(Search(&screen, &[z]).with_simd(pulp::Scalar), None);
        }
        let (cell, free) = Search(&screen, &[-2.0]).with_simd(pulp::Scalar).unwrap();
        assert!(cell == 1 && free < 2.0 && free > 1.99);
    }
}
