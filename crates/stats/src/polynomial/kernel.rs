//! The inner loop: the sums of products of the functions of a tile of rows.
//!
//! One vector register holds one function on consecutive rows. Functions are stored one after the other, [`TILE`] values each, and the
//! sums stay spread over the lanes until [`FLUSH`] rows are done. The order of every addition depends on the rows alone.

use pulp::{Simd, WithSimd};

use super::{
    affine::AffineMap,
    functions::{Functions, LANES, STRIDE, TILE},
    tiling::{LIMITS, STRIP, Tiling},
};

/// Rows whose products are summed in plain arithmetic before the sums go to the compensated totals.
pub(super) const FLUSH: usize = 1024;

/// Values that start at a cache line, so that no vector crosses two.
#[derive(Debug, Clone)]
struct Buffer {
    values: Vec<f64>,
    start: usize,
    length: usize,
}

impl Buffer {
    fn new(length: usize) -> Self {
        let values = vec![0.0; length + LANES];
        // `align_offset` may decline by a huge answer: then the values are only slower to load.
        let start = values.as_ptr().align_offset(64).min(LANES);
        Self { values, start, length }
    }

    fn get(&self) -> &[f64] {
        &self.values[self.start..self.start + self.length]
    }

    fn get_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.start..self.start + self.length]
    }
}

/// The kernel's part of a plan.
#[derive(Debug, Clone)]
pub(super) struct Program {
    pub(super) first: Functions,
    pub(super) second: Functions,
    /// The targets, which are stored.
    pub(super) targets: Functions,
    /// Functions of the first group up to the library's degree: factors of a target.
    pub(super) low: usize,
    pub(super) moments: Tiling,
    /// Sums of the functions of the first group that are not stored.
    pub(super) tops: Option<Tiling>,
    /// Sums for one target: library functions times the target.
    pub(super) cross: Tiling,
    /// Sums of target t with targets 0..=t, for each t.
    pub(super) pairs: Vec<Tiling>,
}

impl Program {
    /// Sums per row in all: moments, cross-moments, products of targets.
    pub(super) fn sums(&self) -> usize {
        let pairs: usize = self.pairs.iter().map(|tiling| tiling.index.len()).sum();
        self.moments() + self.pairs.len() * self.cross.index.len() + pairs
    }

    /// Moments.
    fn moments(&self) -> usize {
        self.moments.index.len() + self.tops.as_ref().map_or(0, |tops| tops.index.len())
    }
}

/// The kernel's working memory.
#[derive(Debug, Clone)]
pub(super) struct Workspace {
    weights: Buffer,
    variables: Buffer,
    targets: Buffer,
    first: Buffer,
    second: Buffer,
    strip: Buffer,
    weighted: Buffer,
    sums: Buffer,
}

impl Workspace {
    pub(super) fn new(program: &Program, variables: usize) -> Self {
        Self {
            weights: Buffer::new(STRIDE),
            variables: Buffer::new(variables * STRIDE),
            targets: Buffer::new(program.pairs.len() * STRIDE),
            first: Buffer::new(program.first.len() * STRIDE),
            second: Buffer::new(program.second.len() * STRIDE),
            strip: Buffer::new(STRIP * STRIDE),
            weighted: Buffer::new(program.low * STRIDE),
            sums: Buffer::new(program.sums() * LANES),
        }
    }
}

/// Rows to add: equally long columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) base: &'a [&'a [f64]],
    pub(super) targets: &'a [&'a [f64]],
    pub(super) weights: Option<&'a [f64]>,
    pub(super) count: usize,
}

/// Adds rows; `total(i, value)` receives, every [`FLUSH`] rows, the sum `value` that belongs to index `i`: moments first, then the
/// cross-moments target by target, then the packed lower triangle of the targets' products.
pub(super) struct AddRows<'a, F: FnMut(usize, f64)> {
    pub(super) program: &'a Program,
    pub(super) map: &'a AffineMap,
    pub(super) target_centre: &'a [f64],
    pub(super) rows: Rows<'a>,
    pub(super) workspace: &'a mut Workspace,
    pub(super) total: F,
}

impl<F: FnMut(usize, f64)> WithSimd for AddRows<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut from = 0;
        while from < self.rows.count {
            let end = (from + FLUSH).min(self.rows.count);
            self.workspace.sums.get_mut().fill(0.0);
            while from < end {
                let to = (from + TILE).min(end);
                self.load(simd, from, to);
                self.add_tile(simd, to - from);
                from = to;
            }
            self.flush(simd);
        }
    }
}

impl<F: FnMut(usize, f64)> AddRows<'_, F> {
    /// Maps the rows `from..to` into the workspace; the lanes behind them get weight zero and harmless values.
    #[inline(always)]
    fn load<S: Simd>(&mut self, simd: S, from: usize, to: usize) {
        let count = to - from;
        if self.rows.weights.is_some() || count < TILE {
            let w = self.workspace.weights.get_mut();
            match self.rows.weights {
                Some(weights) => w[..count].copy_from_slice(&weights[from..to]),
                None => w[..count].fill(1.0),
            }
            w[count..].fill(0.0);
        }
        for (t, column) in self.rows.targets.iter().enumerate() {
            let y = &mut self.workspace.targets.get_mut()[t * STRIDE..][..TILE];
            for (y, value) in y.iter_mut().zip(&column[from..to]) {
                *y = value - self.target_centre[t];
            }
            y[count..].fill(0.0);
        }
        let v = self.workspace.variables.get_mut();
        for (k, column) in self.rows.base.iter().enumerate() {
            let (done, rest) = v.split_at_mut(k * STRIDE);
            let x = &mut rest[..TILE];
            x[..count].copy_from_slice(&column[from..to]);
            whiten(simd, self.map, k, done, x);
            x[count..].fill(0.0);
        }
        // A row of weight zero counts for nothing, whatever it holds.
        if self.rows.weights.is_some() {
            let (w, y) = (self.workspace.weights.get(), self.workspace.targets.get_mut());
            for column in y.chunks_exact_mut(STRIDE).chain(v.chunks_exact_mut(STRIDE)) {
                column.iter_mut().zip(w).filter(|(_, w)| **w == 0.0).for_each(|(value, _)| *value = 0.0);
            }
        }
    }

    #[inline(always)]
    fn add_tile<S: Simd>(&mut self, simd: S, count: usize) {
        let steps = count.div_ceil(S::F64_LANES);
        let weighted = self.rows.weights.is_some() || count < steps * S::F64_LANES;
        let (program, space) = (self.program, &mut *self.workspace);
        let (v, w) = (space.variables.get(), space.weights.get());
        program.first.evaluate(simd, v, space.first.get_mut());
        program.second.evaluate(simd, v, space.second.get_mut());
        let (sums, mut rest) = space.sums.get_mut().split_at_mut(program.moments() * S::F64_LANES);
        let (sums, tops) = sums.split_at_mut(program.moments.index.len() * S::F64_LANES);
        let (second, leaves) = (space.second.get(), space.strip.get_mut());
        if let Some(tiling) = &program.tops {
            // Before the stored ones, of which they are products, are weighted.
            let (first, factors) = (space.first.get(), weighted.then_some(w));
            let functions = &program.first;
            // The second group's function 0 is the constant.
            simd.vectorize(Products {
                tiling,
                functions,
                factors,
                leaves,
                first: second,
                second: first,
                sums: tops,
                steps,
            });
        }
        if weighted {
            space.first.get_mut().chunks_exact_mut(STRIDE).for_each(|f| multiply(simd, f, w));
        }
        let (first, functions, factors) = (space.first.get(), &program.second, None);
        let tiling = &program.moments;
        simd.vectorize(Products { tiling, functions, factors, leaves, first, second, sums, steps });
        for (t, pairs) in program.pairs.iter().enumerate() {
            let targets = space.targets.get();
            let weighted = space.weighted.get_mut();
            let target = &targets[t * STRIDE..][..TILE];
            for (out, f) in weighted.chunks_exact_mut(STRIDE).zip(first.chunks_exact(STRIDE)) {
                product_of(simd, &f[..TILE], target, &mut out[..TILE]);
            }
            let (sums, others) = rest.split_at_mut(program.cross.index.len() * S::F64_LANES);
            let tiling = &program.cross;
            simd.vectorize(Products { tiling, functions, factors, leaves, first: weighted, second, sums, steps });
            let (sums, others) = others.split_at_mut(pairs.index.len() * S::F64_LANES);
            // They are all there, as the functions up to the library's degree are.
            let (tiling, functions) = (pairs, &program.targets);
            simd.vectorize(Products {
                tiling,
                functions,
                factors,
                leaves,
                first: weighted,
                second: targets,
                sums,
                steps,
            });
            rest = others;
        }
    }

    /// Adds up the lanes and hands the sums on.
    #[inline(always)]
    fn flush<S: Simd>(&mut self, simd: S) {
        let (sums, _) = S::as_simd_f64s(self.workspace.sums.get());
        let (library, moments) = (self.program.cross.index.len(), self.program.moments());
        let mut sums = sums.iter().map(|&sum| simd.reduce_sum_f64s(sum));
        let targets = self.program.pairs.len();
        let tops = self.program.tops.iter().flat_map(|tops| &tops.index);
        for (&i, sum) in self.program.moments.index.iter().chain(tops).zip(&mut sums) {
            (self.total)(i, sum);
        }
        for (t, pairs) in self.program.pairs.iter().enumerate() {
            for (&i, sum) in self.program.cross.index.iter().zip(&mut sums) {
                (self.total)(moments + t * library + i, sum);
            }
            for (&i, sum) in pairs.index.iter().zip(&mut sums) {
                (self.total)(moments + targets * library + i, sum);
            }
        }
    }
}

/// `x` becomes variable `k`; `done` holds the variables before it.
#[inline(always)]
fn whiten<S: Simd>(simd: S, map: &AffineMap, k: usize, done: &[f64], x: &mut [f64]) {
    let (x, _) = S::as_mut_simd_f64s(x);
    let (centre, scale) = (simd.splat_f64s(map.centre[k]), simd.splat_f64s(map.scale[k]));
    x.iter_mut().for_each(|x| *x = simd.sub_f64s(*x, centre));
    for (l, &slope) in map.slopes(k).iter().enumerate() {
        let (v, _) = S::as_simd_f64s(&done[l * STRIDE..][..TILE]);
        let slope = simd.splat_f64s(-slope);
        x.iter_mut().zip(v).for_each(|(x, &v)| *x = simd.mul_add_e_f64s(slope, v, *x));
    }
    x.iter_mut().for_each(|x| *x = simd.mul_f64s(*x, scale));
}

#[inline(always)]
fn multiply<S: Simd>(simd: S, values: &mut [f64], factors: &[f64]) {
    let ((values, _), (factors, _)) = (S::as_mut_simd_f64s(values), S::as_simd_f64s(factors));
    values.iter_mut().zip(factors).for_each(|(value, &factor)| *value = simd.mul_f64s(*value, factor));
}

/// `out = values * factors`.
#[inline(always)]
fn product_of<S: Simd>(simd: S, values: &[f64], factors: &[f64], out: &mut [f64]) {
    let ((values, _), (factors, _)) = (S::as_simd_f64s(values), S::as_simd_f64s(factors));
    let (out, _) = S::as_mut_simd_f64s(out);
    out.iter_mut().zip(values).zip(factors).for_each(|((out, &value), &factor)| *out = simd.mul_f64s(value, factor));
}

/// Adds the products of all tiles to their sums.
struct Products<'a> {
    tiling: &'a Tiling,
    /// The second group; its functions that are not stored are made strip by strip.
    functions: &'a Functions,
    /// Row weights of the functions that are made strip by strip; `None`: 1.
    factors: Option<&'a [f64]>,
    /// Buffer for one strip, which stays in first-level cache.
    leaves: &'a mut [f64],
    first: &'a [f64],
    second: &'a [f64],
    sums: &'a mut [f64],
    /// Vectors per function that hold rows.
    steps: usize,
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (sums, _) = S::as_mut_simd_f64s(self.sums);
        for strip in &self.tiling.strips {
            let range = strip.start..strip.start + strip.width;
            let second = if self.functions.are_stored(&range) {
                &self.second[strip.start * STRIDE..]
            } else {
                self.functions.strip(simd, self.second, range, self.steps, self.leaves);
                if let Some(factors) = self.factors {
                    let made = self.leaves.chunks_exact_mut(STRIDE).take(strip.width);
                    made.for_each(|f| multiply(simd, f, factors));
                }
                &*self.leaves
            };
            for tile in &strip.tiles {
                let (first, second) = (&self.first[tile.first * STRIDE..], &second[tile.second * STRIDE..]);
                let (a, b) = if tile.swapped { (second, first) } else { (first, second) };
                let sums = &mut sums[tile.slot..][..tile.rows * tile.columns];
                macro_rules! shapes {
                    ($(($r:literal, $c:literal)),*) => {
                        match (tile.rows, tile.columns) {
                            $(($r, $c) => products::<S, $r, $c>(simd, a, b, sums, self.steps),)*
                            _ => unreachable!("tiles have at most {LIMITS:?} functions a side"),
                        }
                    };
                }
                shapes!(
                    (1, 1),
                    (1, 2),
                    (1, 3),
                    (1, 4),
                    (1, 5),
                    (1, 6),
                    (1, 7),
                    (1, 8),
                    (2, 2),
                    (2, 3),
                    (2, 4),
                    (2, 5),
                    (2, 6),
                    (2, 7),
                    (2, 8),
                    (3, 3),
                    (3, 4),
                    (3, 5),
                    (3, 6),
                    (3, 7),
                    (3, 8),
                    (4, 4),
                    (4, 5),
                    (4, 6)
                );
            }
        }
    }
}

/// `R x C` sums in registers over the rows of the tile.
///
/// The short side is held and the long one passes: `R + 1` registers beside the sums, where the other way round would want `C + 1`, which sixteen registers
/// do not have for 3 x 4 sums.
#[inline(always)]
fn products<S: Simd, const R: usize, const C: usize>(
    simd: S,
    a: &[f64],
    b: &[f64],
    sums: &mut [S::f64s],
    steps: usize,
) {
    let a: [&[S::f64s]; R] = std::array::from_fn(|i| &S::as_simd_f64s(&a[i * STRIDE..][..TILE]).0[..steps]);
    let b: [&[S::f64s]; C] = std::array::from_fn(|j| &S::as_simd_f64s(&b[j * STRIDE..][..TILE]).0[..steps]);
    let sums = &mut sums[..R * C];
    let mut local: [[S::f64s; C]; R] = std::array::from_fn(|i| std::array::from_fn(|j| sums[i * C + j]));
    for s in 0..steps {
        let left: [S::f64s; R] = std::array::from_fn(|i| a[i][s]);
        for j in 0..C {
            let right = b[j][s];
            for i in 0..R {
                local[i][j] = simd.mul_add_e_f64s(left[i], right, local[i][j]);
            }
        }
    }
    for i in 0..R {
        for j in 0..C {
            sums[i * C + j] = local[i][j];
        }
    }
}

/// The number of vector registers of the instruction set in use.
pub(super) struct Registers;

impl WithSimd for Registers {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::REGISTER_COUNT
    }
}
