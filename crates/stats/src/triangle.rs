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
        fleetfoot_data::arch().dispatch(Solve { triangle: self, panel });
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
            let unknown = &mut unknown[..BLOCK * PANEL];
            // Values, vectors of a known column and a factor stay in registers: 16 + 2 + 1, or 8 + 2 + 1 where there are sixteen of them. In either case every
            // value meets the columns before it in their order.
            if S::REGISTER_COUNT >= 32 {
                block_solve::<S, BLOCK, 2>(simd, known, unknown, (above, diagonal), 0);
            } else {
                block_solve::<S, { BLOCK / 2 }, 2>(simd, known, unknown, (above, diagonal), 0);
                block_solve::<S, { BLOCK / 2 }, 2>(simd, known, unknown, (above, diagonal), BLOCK / 2);
            }
        }
    }
}

/// Solves `C` columns of a block, from column `first` of it on, for all rows of the panel, `V` vectors of rows at a time, given the columns before them.
#[inline(always)]
fn block_solve<S: Simd, const C: usize, const V: usize>(
    simd: S,
    known: &[f64],
    block: &mut [f64],
    (above, diagonal): (&[f64], &[f64]),
    first: usize,
) {
    let (known, _) = S::as_simd_f64s(known);
    let (done, panel) = block.split_at_mut(first * PANEL);
    let (done, panel) = (S::as_simd_f64s(done).0, S::as_mut_simd_f64s(&mut panel[..C * PANEL]).0);
    let vectors = PANEL / S::F64_LANES;
    for at in (0..vectors).step_by(V) {
        let mut x = [[simd.splat_f64s(0.0); V]; C];
        for j in 0..C {
            x[j] = load(panel, j * vectors + at);
        }
        let before = known.chunks_exact(vectors).zip(above.chunks_exact(BLOCK));
        let within = done.chunks_exact(vectors).zip(diagonal.chunks_exact(BLOCK));
        for (column, t) in before.chain(within) {
            subtract(simd, load(column, at), &t[first..first + C], &mut x);
        }
        for j in 0..C {
            let t = &diagonal[(first + j) * BLOCK + first..][..C];
            let inverse = simd.splat_f64s(t[j]);
            for v in 0..V {
                x[j][v] = simd.mul_f64s(x[j][v], inverse);
            }
            let (solved, unsolved) = x.split_at_mut(j + 1);
            subtract(simd, solved[j], &t[j + 1..], unsolved);
        }
        for j in 0..C {
            panel[j * vectors + at..][..V].copy_from_slice(&x[j]);
        }
    }
}

/// `x_j -= t_j y`.
#[inline(always)]
fn subtract<S: Simd, const V: usize>(simd: S, y: [S::f64s; V], t: &[f64], x: &mut [[S::f64s; V]]) {
    let mut minus = y;
    for v in 0..V {
        minus[v] = simd.neg_f64s(y[v]);
    }
    for (x, &t) in x.iter_mut().zip(t) {
        let t = simd.splat_f64s(t);
        for v in 0..V {
            x[v] = simd.mul_add_f64s(minus[v], t, x[v]);
        }
    }
}

#[inline(always)]
fn load<V: Copy, const N: usize>(values: &[V], from: usize) -> [V; N] {
    let mut loaded = [values[from]; N];
    loaded.copy_from_slice(&values[from..from + N]);
    loaded
}
