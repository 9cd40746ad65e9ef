//! The columns of E for some rows: functions in good coordinates, and their products.

use std::ops::Range;

use faer::Mat;
use fleetfoot_library::DesignRows;
use pulp::{Simd, WithSimd};

use super::pairs::Pairs;

/// The coordinates of a library: functions phi = psi T.
#[derive(Debug, Clone)]
pub(crate) struct Library {
    /// Upper triangular.
    triangle: Mat<f64>,
    /// Its first function among those of all libraries.
    first: usize,
}

impl Library {
    /// One library after the other, from their triangles.
    pub(crate) fn sequence(triangles: impl Iterator<Item = Mat<f64>>) -> Vec<Self> {
        let mut first = 0;
        let library = |triangle: Mat<f64>| {
            first += triangle.ncols();
            Self { first: first - triangle.ncols(), triangle }
        };
        triangles.map(library).collect()
    }

    pub(crate) fn functions(&self) -> usize {
        self.triangle.ncols()
    }

    /// Column j of T down to its diagonal.
    pub(crate) fn column(&self, j: usize) -> &[f64] {
        &self.triangle.col_as_slice(j)[..=j]
    }

    /// `t_j'M t_j`, the sum of squares of function j, from products `M(a, b)`, a >= b, of the functions psi.
    pub(crate) fn square(&self, j: usize, product: impl Fn(usize, usize) -> f64) -> f64 {
        let t = self.column(j);
        let row = |a: usize| {
            let below: f64 = (0..a).map(|b| 2.0 * t[b] * product(a, b)).sum();
            t[a] * (below + t[a] * product(a, a))
        };
        (0..=j).map(row).sum()
    }
}

/// Columns that fill a tile.
pub(crate) struct Pool<'a> {
    pub(crate) pairs: &'a Pairs,
    /// The target's, last, is the function 1.
    pub(crate) libraries: &'a [Library],
    /// Centres of the scaled columns.
    pub(crate) centres: &'a [f64],
}

/// Columns of E for some rows.
#[derive(Debug, Default)]
pub(crate) struct Tile {
    /// Functions psi, library after library.
    psi: Vec<f64>,
    /// A coefficient times the row weight, and times a function.
    work: [Vec<f64>; 2],
    e: Vec<f64>,
}

impl Tile {
    /// The columns, one after the other.
    pub(crate) fn values(&self) -> &[f64] {
        &self.e
    }

    /// Fills the tile from rows `range` of evaluated outputs: functions, coefficients, scaled columns.
    pub(crate) fn fill(&mut self, pool: &Pool<'_>, rows: &DesignRows, weights: Option<&[f64]>, range: Range<usize>) {
        let n = range.len();
        let functions: usize = pool.libraries.iter().map(Library::functions).sum();
        self.psi.resize(functions * n, 0.0);
        self.work.iter_mut().for_each(|work| work.resize(n, 0.0));
        self.e.resize((pool.pairs.columns + 2 * pool.centres.len()) * n, 0.0);
        let weights = weights.map(|weights| &weights[range.clone()]);
        fleetfoot_data::arch().dispatch(Fill { tile: self, pool, rows, weights, range });
    }
}

struct Fill<'a> {
    tile: &'a mut Tile,
    pool: &'a Pool<'a>,
    rows: &'a DesignRows,
    weights: Option<&'a [f64]>,
    range: Range<usize>,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    // Plain loops: the compiler makes vectors of them for the instruction set that this is compiled for.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { tile, pool, rows, weights, range } = self;
        let n = range.len();
        let Some((target, libraries)) = pool.libraries.split_last() else { return };
        for library in libraries {
            let first = library.first * n;
            let psi = &mut tile.psi[first..first + library.functions() * n];
            for j in 0..library.functions() {
                let (known, column) = psi.split_at_mut(j * n);
                let t = library.column(j);
                substitute(&rows.output(library.first + j)[range.clone()], known, t, &mut column[..n]);
            }
        }
        tile.psi[target.first * n..].fill(1.0);
        let [weighted, product] = &mut tile.work;
        let coefficients = target.first;
        for block in &pool.pairs.blocks {
            let coefficient = &rows.output(coefficients + block.coefficient)[range.clone()];
            match weights {
                Some(weights) => multiply(coefficient, weights, weighted),
                None => weighted.copy_from_slice(coefficient),
            }
            let [a, b] = block.libraries.map(|library| &pool.libraries[library]);
            let symmetric = block.libraries[0] == block.libraries[1];
            let mut next = block.first * n;
            for i in 0..a.functions() {
                let psi = &tile.psi[(a.first + i) * n..(a.first + i + 1) * n];
                multiply(weighted, psi, product);
                let count = if symmetric { i + 1 } else { b.functions() };
                let others = &tile.psi[b.first * n..(b.first + count) * n];
                let columns = &mut tile.e[next..next + count * n];
                for (column, psi) in columns.chunks_exact_mut(n).zip(others.chunks_exact(n)) {
                    multiply(product, psi, column);
                }
                next += count * n;
            }
        }
        let (squares, values) = tile.e[pool.pairs.columns * n..].split_at_mut(pool.centres.len() * n);
        let first = coefficients + pool.pairs.coefficients.len();
        for (at, &centre) in pool.centres.iter().enumerate() {
            let column = &rows.output(first + at)[range.clone()];
            let value = &mut values[at * n..(at + 1) * n];
            value.iter_mut().zip(column).for_each(|(value, column)| *value = column - centre);
            match weights {
                Some(weights) => multiply(value, weights, product),
                None => product.copy_from_slice(value),
            }
            multiply(product, value, &mut squares[at * n..(at + 1) * n]);
            value.copy_from_slice(product);
        }
    }
}

#[inline(always)]
fn multiply(a: &[f64], b: &[f64], product: &mut [f64]) {
    for ((product, a), b) in product.iter_mut().zip(a).zip(b) {
        *product = a * b;
    }
}

/// `(phi_j - sum_i psi_i t_ij) / t_jj`: a step of the substitution of every row, which is backward stable.
#[inline(always)]
fn substitute(phi: &[f64], known: &[f64], t: &[f64], column: &mut [f64]) {
    column.copy_from_slice(phi);
    for (psi, t) in known.chunks_exact(column.len()).zip(t) {
        for (value, psi) in column.iter_mut().zip(psi) {
            *value -= psi * t;
        }
    }
    let inverse = t.last().map_or(1.0, |t| t.recip());
    column.iter_mut().for_each(|value| *value *= inverse);
}
