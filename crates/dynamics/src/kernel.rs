//! Small padded kernels. They are inlined into the callers' [`pulp::WithSimd::with_simd`], so that they use the widest vectors of the machine.
//! (A closure would not do: nothing forces the compiler to inline it into the function that has the wide vectors.)
//!
//! Every element is computed by the same chain of fused multiply-adds on every machine and whatever stands beside it: the
//! same bits follow from any vector width, any batch and any tile.

/// Rows of coefficients are padded to a multiple of this many values.
pub(crate) const LANES: usize = 8;

/// `length` rounded up to whole vectors.
pub(crate) fn padded(length: usize) -> usize {
    length.next_multiple_of(LANES)
}

/// `out = constants + sum_j matrix[j, ..] * features[j]`, summed in the order of j.
///
/// `matrix` holds one row of `out.len()` values per feature; `out.len()` is a multiple of [`LANES`].
#[inline(always)]
pub(crate) fn affine(matrix: &[f64], constants: &[f64], features: &[f64], out: &mut [f64]) {
    let width = out.len();
    let mut from = 0;
    while from + 4 * LANES <= width {
        panel::<{ 4 * LANES }>(matrix, constants, features, from, out);
        from += 4 * LANES;
    }
    if from + 2 * LANES <= width {
        panel::<{ 2 * LANES }>(matrix, constants, features, from, out);
        from += 2 * LANES;
    }
    if from + LANES <= width {
        panel::<LANES>(matrix, constants, features, from, out);
    }
}

#[inline(always)]
fn panel<const N: usize>(
    matrix: &[f64],
    constants: &[f64],
    features: &[f64],
    from: usize,
    out: &mut [f64],
) {
    let width = out.len();
    let mut sum = load::<N>(&constants[from..from + N]);
    for (row, &feature) in matrix.chunks_exact(width).zip(features) {
        let row = load::<N>(&row[from..from + N]);
        for i in 0..N {
            sum[i] = row[i].mul_add(feature, sum[i]);
        }
    }
    out[from..from + N].copy_from_slice(&sum);
}

/// The first `N` values of a slice of at least that length.
#[inline(always)]
pub(crate) fn load<const N: usize>(values: &[f64]) -> [f64; N] {
    let mut loaded = [0.0; N];
    loaded.copy_from_slice(&values[..N]);
    loaded
}

/// The largest value and the lowest index that holds it; `values.len()` is a multiple of [`LANES`], no value is NaN.
#[inline(always)]
pub(crate) fn argmax(values: &[f64]) -> (f64, usize) {
    let mut best = [f64::NEG_INFINITY; LANES];
    for chunk in values.chunks_exact(LANES) {
        let chunk = load::<LANES>(chunk);
        for i in 0..LANES {
            best[i] = if chunk[i] > best[i] {
                chunk[i]
            } else {
                best[i]
            };
        }
    }
    let top = best
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, |a, b| if b > a { b } else { a });
    (
        top,
        values.iter().position(|&value| value == top).unwrap_or(0),
    )
}

/// `sum_i ((values[i] - reference[i]) * scale[i])^2`, all of one padded length.
#[inline(always)]
pub(crate) fn scaled_square(values: &[f64], reference: &[f64], scale: &[f64]) -> f64 {
    let mut sum = [0.0; LANES];
    for ((v, r), s) in values
        .chunks_exact(LANES)
        .zip(reference.chunks_exact(LANES))
        .zip(scale.chunks_exact(LANES))
    {
        let (v, r, s) = (load::<LANES>(v), load::<LANES>(r), load::<LANES>(s));
        for i in 0..LANES {
            let d = (v[i] - r[i]) * s[i];
            sum[i] = d.mul_add(d, sum[i]);
        }
    }
    ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]))
}

/// Whether every value lies within its bounds; a NaN does not. All slices of one padded length.
#[inline(always)]
pub(crate) fn within(values: &[f64], low: &[f64], high: &[f64]) -> bool {
    let mut inside = true;
    for ((v, l), h) in values
        .chunks_exact(LANES)
        .zip(low.chunks_exact(LANES))
        .zip(high.chunks_exact(LANES))
    {
        let (v, l, h) = (load::<LANES>(v), load::<LANES>(l), load::<LANES>(h));
        let mut all = true;
        for i in 0..LANES {
            all &= (v[i] >= l[i]) & (v[i] <= h[i]);
        }
        inside &= all;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn affine_is_the_plain_sum_at_every_width() {
        for width in [8, 16, 24, 32, 40, 56, 104] {
            let features: Vec<f64> = (0..5).map(|j| f64::from(j) * 0.7 - 1.1).collect();
            let matrix: Vec<f64> = (0..5 * width).map(|i| (i as f64 * 0.37).sin()).collect();
            let constants: Vec<f64> = (0..width).map(|i| i as f64).collect();
            let mut out = vec![0.0; width];
            affine(&matrix, &constants, &features, &mut out);
            for o in 0..width {
                let expected = (0..5).fold(constants[o], |sum, j| {
                    matrix[j * width + o].mul_add(features[j], sum)
                });
                assert_eq!(out[o].to_bits(), expected.to_bits());
            }
        }
    }

    #[test]
    fn the_lowest_index_wins() {
        let mut values = vec![f64::NEG_INFINITY; 24];
        values[3] = -1.0;
        values[17] = 2.0;
        values[20] = 2.0;
        assert_eq!(argmax(&values), (2.0, 17));
    }

    #[test]
    fn bounds_and_distances() {
        let low = [-1.0; 16];
        let high = [1.0; 16];
        let mut values = [0.5; 16];
        assert!(within(&values, &low, &high));
        values[9] = f64::NAN;
        assert!(!within(&values, &low, &high));
        values[9] = 1.5;
        assert!(!within(&values, &low, &high));
        assert_eq!(scaled_square(&values, &[0.5; 16], &[2.0; 16]), 4.0);
    }
}
