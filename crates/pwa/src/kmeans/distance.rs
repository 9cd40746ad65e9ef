//! The arithmetic that decides: squared distances in `f64`, in one order on every machine.
//!
//! The faster code in this module only proves the answers of these functions. The order of the operations is therefore
//! fixed here: eight partial sums with fused multiply-adds, as wide as the widest vectors in use.

const LANES: usize = 8;

/// `||x - c||^2`. The rounding error is at most `(d + 3) 2^-53` of the result; the bits do not depend on the instruction set.
#[inline(always)]
pub(super) fn squared_distance(x: &[f64], c: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (x_chunks, x_rest) = x.as_chunks::<LANES>();
    let (c_chunks, c_rest) = c.as_chunks::<LANES>();
    for (x, c) in x_chunks.iter().zip(c_chunks) {
        for lane in 0..LANES {
            let difference = x[lane] - c[lane];
            sums[lane] = difference.mul_add(difference, sums[lane]);
        }
    }
    for (lane, (x, c)) in x_rest.iter().zip(c_rest).enumerate() {
        let difference = x - c;
        sums[lane] = difference.mul_add(difference, sums[lane]);
    }
    let half = [sums[0] + sums[4], sums[1] + sums[5], sums[2] + sums[6], sums[3] + sums[7]];
    (half[0] + half[2]) + (half[1] + half[3])
}

/// The nearest of the centroids and the distances to it and to the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nearest {
    /// The nearest centroid; of equally near ones the first.
    pub(super) label: u32,
    /// Squared distance to it.
    pub(super) first: f64,
    /// Squared distance to the nearest of the others; infinite if there is no other.
    pub(super) second: f64,
}

/// Compares `x` with every row of `centroids` (k x d, row-major).
#[inline(always)]
pub(super) fn nearest(x: &[f64], centroids: &[f64]) -> Nearest {
    let mut nearest = Nearest { label: 0, first: f64::INFINITY, second: f64::INFINITY };
    for (label, c) in centroids.chunks_exact(x.len()).enumerate() {
        let distance = squared_distance(x, c);
        if distance < nearest.first {
            nearest = Nearest { label: label as u32, first: distance, second: nearest.first };
        } else if distance < nearest.second {
            nearest.second = distance;
        }
    }
    nearest
}
