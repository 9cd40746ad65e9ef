//! Rows times the inverse of an upper triangle, by substitution.

use pulp::{Simd, WithSimd};

/// Columns that are solved together; their values of two vectors of rows stay in registers.
const BLOCK: usize = 8;
/// Rows of a panel: two of the widest vectors, a few times over, so that a panel of a hundred columns stays in the second-level cache.
pub(crate) const PANEL: usize = 96;

/// An upper triangle T (d x d), laid out for `X T^-1`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Triangle {
    dimension: usize,
    /// For each block of columns: the rows of T down to the end of the block, `BLOCK` entries a row; the diagonal holds reciprocals.
    packed: Vec<f64>,
}

impl Triangle {
    /// From the entries `(i, j), i <= j`; the diagonal must not be zero.
    pub(crate) fn new(dimension: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let mut packed = Vec::new();
        for first in (0..dimension).step_by(BLOCK) {
            for i in 0..first + BLOCK {
                for j in first..first + BLOCK {
                    packed.push(match i.cmp(&j) {
                        _ if i >= dimension || j >= dimension => f64::from(i == j),
                        std::cmp::Ordering::Less => entry(i, j),
                        std::cmp::Ordering::Equal => entry(i, i).recip(),
                        std::cmp::Ordering::Greater => 0.0,
                    });
                }
            }
        }
        Self { dimension, packed }
    }

    /// Length of the panel that [`Triangle::solve`] works on.
    pub(crate) fn panel_length(&self) -> usize {
        self.dimension.next_multiple_of(BLOCK) * PANEL
    }

    /// `X <- X T^-1` for a panel of `PANEL` rows: column j at `j * PANEL`. Columns beyond the dimension must hold zeros.
    ///
    /// Every row solves a triangular system by substitution, which is backward stable by row (Higham 2002, theorem 8.5), as the
    /// product with an explicit inverse is not.
    pub(crate) fn solve(&self, panel: &mut [f64]) {
        pulp::Arch::new().dispatch(Solve { triangle: self, panel });
    }
}

struct Solve<'a> {
    triangle: &'a Triangle,
    panel: &'a mut [f64],
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { triangle, panel } = self;
        let mut rest = &triangle.packed[..];
        for (block, columns) in (0..triangle.dimension).step_by(BLOCK).zip(0..) {
            let (packed, after) = rest.split_at((block + BLOCK) * BLOCK);
            rest = after;
            let (known, unknown) = panel.split_at_mut(columns * BLOCK * PANEL);
            let (above, diagonal) = packed.split_at(block * BLOCK);
            block_solve(simd, known, &mut unknown[..BLOCK * PANEL], above, diagonal);
        }
    }
}

/// Solves one block of columns for all rows of the panel, given the columns before it.
#[inline(always)]
fn block_solve<S: Simd>(simd: S, known: &[f64], block: &mut [f64], above: &[f64], diagonal: &[f64]) {
    let (known, _) = S::as_simd_f64s(known);
    let (block, _) = S::as_mut_simd_f64s(block);
    let vectors = PANEL / S::F64_LANES;
    for at in (0..vectors).step_by(2) {
        let mut x = [[simd.splat_f64s(0.0); 2]; BLOCK];
        for (j, x) in x.iter_mut().enumerate() {
            *x = [block[j * vectors + at], block[j * vectors + at + 1]];
        }
        for (column, t) in known.chunks_exact(vectors).zip(above.chunks_exact(BLOCK)) {
            let y = [simd.neg_f64s(column[at]), simd.neg_f64s(column[at + 1])];
            for j in 0..BLOCK {
                let t = simd.splat_f64s(t[j]);
                x[j][0] = simd.mul_add_f64s(y[0], t, x[j][0]);
                x[j][1] = simd.mul_add_f64s(y[1], t, x[j][1]);
            }
        }
        for j in 0..BLOCK {
            let inverse = simd.splat_f64s(diagonal[j * BLOCK + j]);
            x[j] = [simd.mul_f64s(x[j][0], inverse), simd.mul_f64s(x[j][1], inverse)];
            let y = [simd.neg_f64s(x[j][0]), simd.neg_f64s(x[j][1])];
            for l in j + 1..BLOCK {
                let t = simd.splat_f64s(diagonal[j * BLOCK + l]);
                x[l] = [simd.mul_add_f64s(y[0], t, x[l][0]), simd.mul_add_f64s(y[1], t, x[l][1])];
            }
        }
        for (j, x) in x.iter().enumerate() {
            [block[j * vectors + at], block[j * vectors + at + 1]] = *x;
        }
    }
}
