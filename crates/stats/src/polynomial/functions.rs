//! The Chebyshev functions of a tile of rows.

use std::ops::Range;

use pulp::Simd;

use super::graded::Graded;

/// Rows whose functions are evaluated at once. Measured: shorter tiles load and store the sums too often, longer ones leave first-level cache.
pub(super) const TILE: usize = 128;
/// Values from one function to the next: not a power of two, so that equal rows of different functions do not share the low bits of their
/// addresses (a load behind a store with the same low twelve bits has to wait).
pub(super) const STRIDE: usize = TILE + LANES;
/// The widest vector, in values.
pub(super) const LANES: usize = 8;

/// Formula of a function in terms of earlier ones.
#[derive(Debug, Clone, Copy)]
enum Recipe {
    One,
    /// T_1 = v.
    Variable(usize),
    /// T_{k+1}(v) = 2 v T_k(v) - T_{k-1}(v).
    Recurrence {
        variable: usize,
        last: usize,
        before: usize,
    },
    Product(usize, usize),
}

/// The functions of one group of variables, starting at variable `from`.
#[derive(Debug, Clone)]
pub(super) struct Functions {
    /// The functions that are stored, in graded order.
    recipes: Vec<Recipe>,
    /// For each function of the group, the two stored functions whose product it is (of a stored one: itself and 0).
    /// Empty when all are stored.
    leaves: Vec<(usize, usize)>,
    /// Number of leading functions that are stored at their places in graded order.
    prefix: usize,
}

impl Functions {
    /// So many values that stand where functions would.
    pub(super) fn given(count: usize) -> Self {
        Self { recipes: Vec::new(), leaves: Vec::new(), prefix: count }
    }

    /// Functions of degree `top` are not stored but for powers of one variable: they are products of two others, meet nothing but the constant, and are made
    /// when they are needed.
    pub(super) fn below(list: &Graded, from: usize, top: usize) -> Self {
        Self::without(list, from, |exponent| degree(exponent) == top)
    }

    /// Beyond degree `low` only functions without the group's last variable, and powers of one variable, are stored, and of degree `top` only the latter; the
    /// others are products of two of them and made when they are needed: a store that misses the first-level cache costs more than six products.
    pub(super) fn with_leaves(list: &Graded, from: usize, low: usize, top: usize) -> Self {
        let meets_last = |exponent: &[u8]| exponent.last().is_some_and(|&last| last > 0);
        Self::without(list, from, |e| degree(e) == top || degree(e) > low && meets_last(e))
    }

    /// The group without those functions of several variables that are said to be leaves. What a leaf is the product of, itself without its last variable and the power
    /// of that, is no leaf.
    fn without(list: &Graded, from: usize, is_leaf: impl Fn(&[u8]) -> bool) -> Self {
        let last = |exponent: &[u8]| exponent.iter().rposition(|&e| e > 0);
        let is_stored = |exponent: &[u8]| {
            let alone = last(exponent).is_none_or(|k| exponent[..k].iter().all(|&e| e == 0));
            alone || !is_leaf(exponent)
        };
        let stored: Vec<usize> = (0..list.len()).filter(|&i| is_stored(list.exponent(i))).collect();
        let place = |exponent: &[u8]| list.index(exponent).and_then(|i| stored.binary_search(&i).ok()).unwrap_or(0);
        let leaf = |i: usize| {
            let exponent = list.exponent(i);
            let Some(k) = last(exponent).filter(|_| !is_stored(exponent)) else { return (place(exponent), 0) };
            let (mut rest, mut power) = (exponent.to_vec(), vec![0; exponent.len()]);
            std::mem::swap(&mut rest[k], &mut power[k]);
            (place(&rest), place(&power))
        };
        let leaves = if stored.len() < list.len() { (0..list.len()).map(leaf).collect() } else { Vec::new() };
        let prefix = stored.iter().enumerate().take_while(|&(place, &i)| place == i).count();
        Self { recipes: stored.iter().map(|&i| recipe(list.exponent(i), from, place)).collect(), leaves, prefix }
    }

    /// Number of stored functions.
    pub(super) fn len(&self) -> usize {
        self.recipes.len()
    }

    /// Returns true if every function is stored at its place in graded order.
    pub(super) fn all_stored(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Returns true if the functions of this range are stored at their places in graded order.
    pub(super) fn are_stored(&self, range: &Range<usize>) -> bool {
        range.end <= self.prefix
    }

    /// The stored functions on a tile of rows, one every [`STRIDE`] values.
    #[inline(always)]
    pub(super) fn evaluate<S: Simd>(&self, simd: S, variables: &[f64], out: &mut [f64]) {
        for (i, recipe) in self.recipes.iter().enumerate() {
            let (done, rest) = out.split_at_mut(i * STRIDE);
            let get = |j: usize| S::as_simd_f64s(&done[j * STRIDE..][..TILE]).0;
            let (target, _) = S::as_mut_simd_f64s(&mut rest[..TILE]);
            match *recipe {
                Recipe::One => target.fill(simd.splat_f64s(1.0)),
                Recipe::Variable(k) => target.copy_from_slice(S::as_simd_f64s(&variables[k * STRIDE..][..TILE]).0),
                Recipe::Recurrence { variable, last, before } => {
                    let (v, _) = S::as_simd_f64s(&variables[variable * STRIDE..][..TILE]);
                    for (((target, &v), &last), &before) in target.iter_mut().zip(v).zip(get(last)).zip(get(before)) {
                        *target = simd.mul_add_e_f64s(simd.add_f64s(v, v), last, simd.neg_f64s(before));
                    }
                }
                Recipe::Product(a, b) => {
                    for ((target, &a), &b) in target.iter_mut().zip(get(a)).zip(get(b)) {
                        *target = simd.mul_f64s(a, b);
                    }
                }
            }
        }
    }

    /// The functions `range`, from the stored ones.
    #[inline(always)]
    pub(super) fn strip<S: Simd>(&self, simd: S, stored: &[f64], range: Range<usize>, steps: usize, out: &mut [f64]) {
        let get = |j: usize| &S::as_simd_f64s(&stored[j * STRIDE..][..TILE]).0[..steps];
        for (&(a, b), out) in self.leaves[range].iter().zip(out.chunks_exact_mut(STRIDE)) {
            let out = &mut S::as_mut_simd_f64s(&mut out[..TILE]).0[..steps];
            if b == 0 {
                out.copy_from_slice(get(a));
            } else {
                out.iter_mut().zip(get(a)).zip(get(b)).for_each(|((out, &a), &b)| *out = simd.mul_f64s(a, b));
            }
        }
    }
}

fn degree(exponent: &[u8]) -> usize {
    exponent.iter().map(|&e| usize::from(e)).sum()
}

/// The recipe of a function; `place` finds functions of the group by exponent.
fn recipe(exponent: &[u8], from: usize, place: impl Fn(&[u8]) -> usize) -> Recipe {
    let Some(k) = exponent.iter().rposition(|&e| e > 0) else {
        return Recipe::One;
    };
    let power = exponent[k];
    let pure = |power: u8| {
        let mut only = vec![0; exponent.len()];
        only[k] = power;
        place(&only)
    };
    if exponent[..k].iter().any(|&e| e > 0) {
        let mut rest = exponent.to_vec();
        rest[k] = 0;
        Recipe::Product(place(&rest), pure(power))
    } else if power == 1 {
        Recipe::Variable(from + k)
    } else {
        Recipe::Recurrence { variable: from + k, last: pure(power - 1), before: pure(power - 2) }
    }
}
