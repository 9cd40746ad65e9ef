//! Scores of regions in single precision: twice as many regions a vector, and most searches need no better.
//!
//! The region of a search must be the one that double precision finds. Where the best score leads every other by more than single precision
//! can be wrong, it is; the rare searches near a border of two regions are done again in double precision.

use pulp::Simd;

use crate::{aligned::Aligned, kernel::load};

/// Scores are padded to a multiple of this many.
const LANES: usize = 16;

/// Sums beyond this size are left to double precision: below it, nothing overflows.
const LARGEST: f64 = 1e30;

/// `argmax_i (w_i . z + b_i)` in single precision, one vector lane a region.
pub(crate) struct Rough {
    width: usize,
    /// Columns x width.
    weights: Aligned<f32>,
    /// Width; minus infinity in the padding.
    offsets: Aligned<f32>,
    /// Per region, width: `1 / |w_i - w_j|`; minus infinity for the region itself.
    nearness: Aligned<f32>,
}

impl Rough {
    /// From the same tables in double precision, of `width` values a row.
    pub(crate) fn new(weights: &[f64], offsets: &[f64], nearness: &[f64], width: usize) -> Self {
        let wide = width.next_multiple_of(LANES);
        let table = |rows: &[f64], pad: f32| {
            let mut table = Aligned::new(rows.len() / width * wide, pad);
            for (to, from) in table.chunks_exact_mut(wide).zip(rows.chunks_exact(width)) {
                for (to, &from) in to.iter_mut().zip(from) {
                    *to = from as f32;
                }
            }
            table
        };
        let mut rough = Self {
            width: wide,
            weights: table(weights, 0.0),
            offsets: table(offsets, f32::NEG_INFINITY),
            nearness: table(nearness, 1.0),
        };
        for value in rough.nearness.iter_mut() {
            *value = value.min(LARGEST as f32);
        }
        rough
    }

    /// Padded number of regions.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// All scores at `z`.
    #[inline(always)]
    pub(crate) fn score(&self, z: &[f32], scores: &mut [f32]) {
        let mut from = 0;
        while from < self.width {
            from += match (self.width - from) / LANES {
                1 => self.panel::<LANES>(z, from, scores),
                2 => self.panel::<{ 2 * LANES }>(z, from, scores),
                3 => self.panel::<{ 3 * LANES }>(z, from, scores),
                _ => self.panel::<{ 4 * LANES }>(z, from, scores),
            };
        }
    }

    #[inline(always)]
    fn panel<const N: usize>(&self, z: &[f32], from: usize, scores: &mut [f32]) -> usize {
        let mut sum = load::<f32, N>(&self.offsets[from..]);
        for (row, &z) in self.weights.chunks_exact(self.width).zip(z) {
            let row = load::<f32, N>(&row[from..]);
            for i in 0..N {
                sum[i] = row[i].mul_add(z, sum[i]);
            }
        }
        scores[from..from + N].copy_from_slice(&sum);
        N
    }

    /// The best region, and a lower bound of the distance to the nearest place where another one is as good.
    ///
    /// `reach` bounds `|b_i| + |w_i| |z|` for every region, `terms` is 4 more than the number of columns. `None` where the best is not certain.
    #[inline(always)]
    pub(crate) fn best<S: Simd>(&self, simd: S, scores: &[f32], terms: f64, reach: f64) -> Option<(usize, f64)> {
        if reach.is_nan() || reach >= LARGEST {
            return None;
        }
        // Each of two scores is wrong by at most (columns + 3) 2^-24 reach: the roundings of w, z and b, and of the sums. Twice that
        // is a quarter of this, whose rest covers the few roundings below, and those of double precision, with plenty to spare.
        let rounding = 4.0 * terms * (f64::from(f32::EPSILON) * reach + f64::from(f32::MIN_POSITIVE) * (1.0 + reach));
        let scores = S::as_simd_f32s(scores).0;
        let mut best = simd.splat_f32s(f32::NEG_INFINITY);
        for &score in scores {
            best = simd.max_f32s(score, best);
        }
        let top = simd.splat_f32s(simd.reduce_max_f32s(best));
        let mut winner = 0;
        for (v, &score) in scores.iter().enumerate() {
            let lane = simd.first_true_m32s(simd.greater_than_or_equal_f32s(score, top));
            winner = if lane < S::F32_LANES { v * S::F32_LANES + lane } else { winner };
        }
        let nearness = S::as_simd_f32s(self.nearness.get(winner * self.width..(winner + 1) * self.width)?).0;
        let (rounding, mut least) = (simd.splat_f32s(rounding as f32), simd.splat_f32s(f32::INFINITY));
        for (&score, &factor) in scores.iter().zip(nearness) {
            let lead = simd.mul_f32s(simd.sub_f32s(simd.sub_f32s(top, score), rounding), factor);
            least = simd.min_f32s(lead, least);
        }
        // The product and the factor are rounded too.
        let free = f64::from(simd.reduce_min_f32s(least)) * (1.0 - 1e-6);
        (free > 0.0).then_some((winner, free))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::WithSimd;

    struct Best<'a>(&'a Rough, &'a [f32], f64, f64);

    impl WithSimd for Best<'_> {
        type Output = Option<(usize, f64)>;
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            self.0.best(simd, self.1, self.2, self.3)
        }
    }

    /// Best regions of one column: w_i = i, b_i = -i^2 / 2, the nearest whole number.
    fn nearest(count: usize, z: f64) -> Option<(usize, f64)> {
        let width = count.next_multiple_of(8);
        let mut weights = vec![0.0; width];
        let mut offsets = vec![f64::NEG_INFINITY; width];
        let mut nearness = vec![1.0; count * width];
        for i in 0..count {
            (weights[i], offsets[i]) = (i as f64, -0.5 * (i * i) as f64);
            for j in 0..count {
                nearness[i * width + j] = if i == j { f64::NEG_INFINITY } else { 1.0 / (i as f64 - j as f64).abs() };
            }
        }
        let rough = Rough::new(&weights, &offsets, &nearness, width);
        let mut scores = Aligned::new(rough.width(), 0.0);
        rough.score(&[z as f32], &mut scores);
        let n = count as f64;
        let reach = n * n / 2.0 + n * z.abs();
        let best = Best(&rough, &scores, 5.0, reach);
        let scalar = Best(&rough, &scores, 5.0, reach).with_simd(pulp::Scalar);
        let wide = pulp::Arch::new().dispatch(best);
        assert_eq!(scalar, wide);
        wide
    }

    #[test]
    fn finds_the_best_and_how_far_it_holds() {
        for count in [1, 7, 8, 9, 50, 64, 65, 131] {
            for region in [0, count / 2, count - 1] {
                let (found, free) = nearest(count, region as f64 + 0.2).unwrap();
                assert_eq!(found, region);
                let border = if region + 1 < count { 0.3 } else { 0.7 };
                assert!(free <= border || count == 1, "{free}");
                assert!(free > border - 0.1, "{free}");
            }
        }
    }

    #[test]
    fn leaves_doubts_to_double_precision() {
        assert_eq!(nearest(50, 20.5), None);
        assert_eq!(nearest(50, 20.500_001), None);
        assert_eq!(nearest(50, f64::NAN), None);
        assert_eq!(nearest(50, f64::INFINITY), None);
        assert_eq!(nearest(50, 1e35), None);
    }
}
