//! Small kernels beside those of [`fleetfoot_stats::kernel`]. They are inlined into the callers' [`pulp::WithSimd::with_simd`], so that they use the widest vectors of the machine.
//! (A closure would not do: nothing forces the compiler to inline it into the function that has the wide vectors.)
//!
//! Every element is computed by the same chain of fused multiply-adds on every machine, whatever its neighbours. The
//! same bits follow from any vector width, any batch and any tile.

pub(crate) use fleetfoot_stats::kernel::{LANES, affine, load, padded};
use pulp::Simd;

/// Copies values of a padded length, a vector at a time.
#[inline(always)]
pub(crate) fn copy<S: Simd>(from: &[f64], to: &mut [f64]) {
    for (to, from) in S::as_mut_simd_f64s(to).0.iter_mut().zip(S::as_simd_f64s(from).0) {
        *to = *from;
    }
}

/// The largest value and the lowest index that holds it; no value is NaN. `indices` are 0, 1, 2, ..., of the values' padded length.
#[inline(always)]
pub(crate) fn argmax<S: Simd>(simd: S, values: &[f64], indices: &[f64]) -> (f64, usize) {
    let values = S::as_simd_f64s(values).0;
    let mut best = simd.splat_f64s(f64::NEG_INFINITY);
    for &v in values {
        best = simd.max_f64s(v, best);
    }
    let top = simd.reduce_max_f64s(best);
    let (all, mut winner) = (simd.splat_f64s(top), simd.splat_f64s(f64::INFINITY));
    for (&v, &index) in values.iter().zip(S::as_simd_f64s(indices).0) {
        let matching = simd.select_f64s(simd.greater_than_or_equal_f64s(v, all), index, winner);
        winner = simd.min_f64s(matching, winner);
    }
    (top, simd.reduce_min_f64s(winner) as usize)
}

/// `sum_i ((values[i] - reference[i]) * scale[i])^2`, all of one padded length; the rounding depends on the machine.
#[inline(always)]
pub(crate) fn scaled_square<S: Simd>(simd: S, values: &[f64], reference: &[f64], scale: &[f64]) -> f64 {
    let (values, reference) = (S::as_simd_f64s(values).0, S::as_simd_f64s(reference).0);
    let mut sum = simd.splat_f64s(0.0);
    for ((&v, &r), &s) in values.iter().zip(reference).zip(S::as_simd_f64s(scale).0) {
        let d = simd.mul_f64s(simd.sub_f64s(v, r), s);
        sum = simd.mul_add_f64s(d, d, sum);
    }
    simd.reduce_sum_f64s(sum)
}

/// Returns true if every value lies within its bounds; a NaN does not. All slices have one padded length.
#[inline(always)]
pub(crate) fn within<S: Simd>(simd: S, values: &[f64], low: &[f64], high: &[f64]) -> bool {
    let (low, high) = (S::as_simd_f64s(low).0, S::as_simd_f64s(high).0);
    let yes = simd.less_than_or_equal_f64s(simd.splat_f64s(0.0), simd.splat_f64s(0.0));
    let mut inside = yes;
    for ((&v, &l), &h) in S::as_simd_f64s(values).0.iter().zip(low).zip(high) {
        inside = simd.and_m64s(inside, simd.less_than_or_equal_f64s(l, v));
        inside = simd.and_m64s(inside, simd.less_than_or_equal_f64s(v, h));
    }
    simd.first_true_m64s(simd.xor_m64s(inside, yes)) == S::F64_LANES
}

/// Lanes with `|values - reference| <= limit`; a NaN is nowhere near. (Not by an absolute value, which is a call:
/// nothing inlines it here.)
#[inline(always)]
pub(crate) fn is_near<S: Simd>(simd: S, values: S::f64s, reference: S::f64s, limit: S::f64s) -> S::m64s {
    let above = simd.less_than_or_equal_f64s(simd.sub_f64s(values, reference), limit);
    simd.and_m64s(above, simd.less_than_or_equal_f64s(simd.sub_f64s(reference, values), limit))
}

/// [`crate::integrate::advance`], a vector at a time.
#[inline(always)]
pub(crate) fn advance_all<S: Simd>(simd: S, keep: S::f64s, gain: S::f64s, x: S::f64s, f: S::f64s) -> S::f64s {
    simd.mul_add_f64s(gain, f, simd.mul_f64s(keep, x))
}

/// `out = (values - centre) / scale`, all of one padded length. Gives the sum of the squares, rounded as the machine likes.
#[inline(always)]
pub(crate) fn standardise<S: Simd>(simd: S, values: &[f64], centre: &[f64], scale: &[f64], out: &mut [f64]) -> f64 {
    let mut sum = simd.splat_f64s(0.0);
    let (values, centre, scale) = (S::as_simd_f64s(values).0, S::as_simd_f64s(centre).0, S::as_simd_f64s(scale).0);
    for (((o, &v), &c), &s) in S::as_mut_simd_f64s(out).0.iter_mut().zip(values).zip(centre).zip(scale) {
        *o = simd.div_f64s(simd.sub_f64s(v, c), s);
        sum = simd.mul_add_f64s(*o, *o, sum);
    }
    simd.reduce_sum_f64s(sum)
}

/// [`standardise`] by the inverses of the scales, which is a rounding off and takes no division.
#[inline(always)]
pub(crate) fn standardise_by<S: Simd>(
    simd: S,
    values: &[f64],
    centre: &[f64],
    inverse: &[f64],
    out: &mut [f64],
) -> f64 {
    let mut sum = simd.splat_f64s(0.0);
    let (values, centre, inverse) = (S::as_simd_f64s(values).0, S::as_simd_f64s(centre).0, S::as_simd_f64s(inverse).0);
    for (((o, &v), &c), &i) in S::as_mut_simd_f64s(out).0.iter_mut().zip(values).zip(centre).zip(inverse) {
        *o = simd.mul_f64s(simd.sub_f64s(v, c), i);
        sum = simd.mul_add_f64s(*o, *o, sum);
    }
    simd.reduce_sum_f64s(sum)
}

/// `min_i (top - values[i] - rounding) * factors[i]`.
#[inline(always)]
pub(crate) fn smallest_lead<S: Simd>(simd: S, top: f64, rounding: f64, values: &[f64], factors: &[f64]) -> f64 {
    let (top, rounding) = (simd.splat_f64s(top), simd.splat_f64s(rounding));
    let mut least = simd.splat_f64s(f64::INFINITY);
    for (&v, &f) in S::as_simd_f64s(values).0.iter().zip(S::as_simd_f64s(factors).0) {
        let lead = simd.mul_f64s(simd.sub_f64s(simd.sub_f64s(top, v), rounding), f);
        least = simd.min_f64s(lead, least);
    }
    simd.reduce_min_f64s(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::WithSimd;

    #[test]
    fn bounds_distances_and_leads() {
        struct Checks;
        impl pulp::WithSimd for Checks {
            type Output = ();
            fn with_simd<S: Simd>(self, simd: S) {
                let indices: Vec<f64> = (0..56).map(f64::from).collect();
                let values: Vec<f64> = (0..56).map(|i| if i % 11 == 9 { 5.0 } else { f64::from(-i) }).collect();
                assert_eq!(argmax(simd, &values, &indices), (5.0, 9));
                assert_eq!(argmax(simd, &[3.0; 24], &indices[..24]), (3.0, 0));
                let mut one = [f64::NEG_INFINITY; 24];
                one[17] = 2.0;
                assert_eq!(argmax(simd, &one, &indices[..24]), (2.0, 17));
                let (low, high) = ([-1.0; 16], [1.0; 16]);
                let mut values = [0.5; 16];
                assert!(within(simd, &values, &low, &high));
                values[9] = f64::NAN;
                assert!(!within(simd, &values, &low, &high));
                values[9] = 1.5;
                assert!(!within(simd, &values, &low, &high));
                let near = |value: f64, limit: f64| {
                    let [value, reference, limit] = [value, 0.5, limit].map(|number| simd.splat_f64s(number));
                    simd.first_true_m64s(is_near(simd, value, reference, limit)) == 0
                };
                assert!(near(1.5, 1.0) && near(-0.5, 1.0) && near(1.5, f64::MAX));
                assert!(!near(1.5, 0.9) && !near(-0.5, 0.9) && !near(f64::NAN, f64::MAX));
                assert_eq!(scaled_square(simd, &values, &[0.5; 16], &[2.0; 16]), 4.0);
                let mut out = [0.0; 16];
                assert_eq!(standardise(simd, &values, &[0.5; 16], &[0.5; 16], &mut out), 4.0);
                assert_eq!((out[8], out[9]), (0.0, 2.0));
                let mut by = [0.0; 16];
                assert_eq!(standardise_by(simd, &values, &[0.5; 16], &[2.0; 16], &mut by), 4.0);
                assert_eq!(by, out);
                assert_eq!(smallest_lead(simd, 3.0, 0.5, &out, &[2.0; 16]), 1.0);
            }
        }
        Checks.with_simd(pulp::Scalar);
        fleetfoot_data::arch().dispatch(Checks);
    }
}
