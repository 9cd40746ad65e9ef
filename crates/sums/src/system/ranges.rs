//! The least and greatest values of monomials over rows, without evaluating them on most rows.

use std::{collections::HashMap, ops::Range};

use fleetfoot_stats::{PolynomialPlan, scan::RegionRanges};
use pulp::{Simd, WithSimd};

/// Rows whose monomials are bounded together.
const SPAN: usize = 16;
/// Spans that are bounded side by side: lanes of the widest vector.
const SPANS: usize = 8;
/// Their rows.
const BLOCK: usize = SPAN * SPANS;

/// The ranges of all monomials of a polynomial library.
///
/// Consecutive rows of a trajectory are near each other. For every few of them, a span, the monomials are bounded by
/// interval arithmetic from the ranges of the variables, several spans at once. Only those whose bound exceeds the
/// known range are evaluated. Products of bounds are rounded as products of values are, and rounding is monotone, so
/// nothing is missed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MonomialRanges {
    /// Every monomial in graded order: the one that it is a multiple of (`None`: the constant) and the variable.
    recipes: Vec<Recipe>,
    /// Place of every monomial among the system's functions.
    order: Vec<usize>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Recipe {
    parent: Option<usize>,
    variable: usize,
    /// True if the monomial is an even power of one variable, and so not negative.
    even: bool,
}

/// Working memory.
#[derive(Debug, Default)]
pub(super) struct RangesScratch {
    /// Of every monomial the lower bounds over the spans, then the upper ones.
    bounds: Vec<f64>,
    /// Of every monomial the values on the rows of a span.
    values: Vec<f64>,
    /// Of every monomial, over the spans: 1 if its bound, or that of a multiple of it, exceeds the known range; else 0.
    wanted: Vec<f64>,
}

impl MonomialRanges {
    pub(super) fn new(plan: &PolynomialPlan, order: &[usize]) -> Self {
        let index: HashMap<&[u8], usize> = plan.exponents().enumerate().map(|(i, exponent)| (exponent, i)).collect();
        let recipe = |exponent: &[u8]| {
            let variable = exponent.iter().rposition(|&power| power > 0).unwrap_or(0);
            let mut parent = exponent.to_vec();
            parent[variable] -= 1;
            let even = exponent[variable].is_multiple_of(2) && exponent[..variable].iter().all(|&power| power == 0);
            Recipe { parent: index.get(parent.as_slice()).copied(), variable, even }
        };
        Self { recipes: plan.exponents().map(recipe).collect(), order: order.to_vec() }
    }

    /// Ranges in graded order in the order of the system's functions.
    pub(super) fn in_order(&self, ranges: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut sorted = vec![RegionRanges::EMPTY; ranges.len()];
        self.order.iter().zip(ranges).for_each(|(&place, range)| sorted[place] = *range);
        sorted
    }

    /// Widens ranges (graded order) by the monomials of rows, whose variables are finite.
    pub(super) fn add(&self, ranges: &mut [[f64; 2]], variables: &[&[f64]], scratch: &mut RangesScratch) {
        let count = self.recipes.len();
        scratch.bounds.resize(count * 2 * SPANS, 0.0);
        scratch.values.resize(count * SPAN, 0.0);
        scratch.wanted.resize(count * SPANS, 0.0);
        fleetfoot_data::arch().dispatch(AddBlocks { recipes: &self.recipes, ranges, variables, scratch });
    }
}

struct AddBlocks<'a> {
    recipes: &'a [Recipe],
    ranges: &'a mut [[f64; 2]],
    variables: &'a [&'a [f64]],
    scratch: &'a mut RangesScratch,
}

impl WithSimd for AddBlocks<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let rows = self.variables.first().map_or(0, |column| column.len());
        for from in (0..rows).step_by(BLOCK) {
            let block = from..(from + BLOCK).min(rows);
            self.bound_variables(block.clone());
            if let Some(spans) = self.bound(simd) {
                for (span, from) in block.clone().step_by(SPAN).enumerate().filter(|&(span, _)| spans[span] > 0.0) {
                    self.evaluate(simd, span, from..(from + SPAN).min(block.end));
                }
            }
        }
    }
}

impl AddBlocks<'_> {
    /// The ranges of the variables over the spans of a block: the first monomials, in the order of the variables.
    #[inline(always)]
    fn bound_variables(&mut self, block: Range<usize>) {
        for (bounds, column) in self.scratch.bounds.chunks_exact_mut(2 * SPANS).zip(self.variables) {
            let (low, high) = bounds.split_at_mut(SPANS);
            let spans = column[block.clone()].chunks(SPAN);
            let count = spans.len();
            for (span, (low, high)) in spans.zip(low.iter_mut().zip(high.iter_mut())) {
                [*low, *high] = range_of(span);
            }
            // Spans that are not there are as the first.
            for i in count..SPANS {
                (low[i], high[i]) = (low[0], high[0]);
            }
        }
    }

    /// Bounds all monomials, and marks those that must be evaluated. Returns 1 for the spans with such monomials,
    /// `None` without any.
    #[inline(always)]
    fn bound<S: Simd>(&mut self, simd: S) -> Option<[f64; SPANS]> {
        let RangesScratch { bounds, wanted, .. } = &mut *self.scratch;
        let vectors = SPANS / S::F64_LANES;
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let mut spans = [0.0; SPANS];
        let any = S::as_mut_simd_f64s(&mut spans).0;
        for (i, (recipe, wanted)) in self.recipes.iter().zip(wanted.chunks_exact_mut(SPANS)).enumerate() {
            let (known, bound) = bounds.split_at_mut(i * 2 * SPANS);
            let bound = S::as_mut_simd_f64s(&mut bound[..2 * SPANS]).0;
            if let Some(parent) = recipe.parent {
                let of = |monomial: usize| S::as_simd_f64s(&known[monomial * 2 * SPANS..][..2 * SPANS]).0;
                multiply(simd, recipe.even, of(parent), of(recipe.variable), bound);
            }
            let [least, most] = self.ranges[i].map(|end| simd.splat_f64s(end));
            let wanted = S::as_mut_simd_f64s(wanted).0;
            for k in 0..vectors {
                // Not so where a bound is not a number.
                let above = simd.less_than_or_equal_f64s(least, bound[k]);
                let below = simd.less_than_or_equal_f64s(bound[vectors + k], most);
                wanted[k] = simd.select_f64s(simd.and_m64s(above, below), zero, one);
                any[k] = simd.max_f64s(any[k], wanted[k]);
            }
        }
        if spans.iter().all(|&span| span == 0.0) {
            return None;
        }
        // Divisors of a wanted monomial are wanted.
        for (i, recipe) in self.recipes.iter().enumerate().rev() {
            if let Some(parent) = recipe.parent {
                let (before, of_function) = wanted.split_at_mut(i * SPANS);
                let parent = S::as_mut_simd_f64s(&mut before[parent * SPANS..][..SPANS]).0;
                let of_function = S::as_simd_f64s(&of_function[..SPANS]).0;
                parent.iter_mut().zip(of_function).for_each(|(parent, &span)| *parent = simd.max_f64s(*parent, span));
            }
        }
        Some(spans)
    }

    /// Evaluates the wanted monomials on the rows of a span, its first row again in the place of those that are not there.
    #[inline(always)]
    fn evaluate<S: Simd>(&mut self, simd: S, span: usize, rows: Range<usize>) {
        let RangesScratch { values, wanted, .. } = &mut *self.scratch;
        for (values, column) in values.chunks_exact_mut(SPAN).zip(self.variables) {
            let column = &column[rows.clone()];
            values[..column.len()].copy_from_slice(column);
            values[column.len()..].fill(column[0]);
        }
        for (i, recipe) in self.recipes.iter().enumerate() {
            if wanted[i * SPANS + span] == 0.0 {
                continue;
            }
            let (known, value_span) = values.split_at_mut(i * SPAN);
            let value_span = S::as_mut_simd_f64s(&mut value_span[..SPAN]).0;
            if let Some(parent) = recipe.parent {
                let of = |monomial: usize| S::as_simd_f64s(&known[monomial * SPAN..][..SPAN]).0;
                let factors = of(parent).iter().zip(of(recipe.variable));
                value_span.iter_mut().zip(factors).for_each(|(product, (&a, &b))| *product = simd.mul_f64s(a, b));
            }
            let (mut least, mut most) = (value_span[0], value_span[0]);
            for &value in &*value_span {
                least = simd.min_f64s(value, least);
                most = simd.max_f64s(value, most);
            }
            let range = &mut self.ranges[i];
            let (least, most) = (simd.reduce_min_f64s(least), simd.reduce_max_f64s(most));
            *range = [min(least, range[0]), max(most, range[1])];
        }
    }
}

/// The bounds of a product over spans, lower ones first. The product is of a monomial and a variable, or, if it is
/// even, of an odd power of the variable and it.
#[inline(always)]
fn multiply<S: Simd>(simd: S, even: bool, a: &[S::f64s], b: &[S::f64s], out: &mut [S::f64s]) {
    let vectors = out.len() / 2;
    let zero = simd.splat_f64s(0.0);
    for k in 0..vectors {
        let ([a, b], [c, d]) = ([a[k], a[vectors + k]], [b[k], b[vectors + k]]);
        let [p, q] = [simd.mul_f64s(a, c), simd.mul_f64s(a, d)];
        let [r, s] = [simd.mul_f64s(b, c), simd.mul_f64s(b, d)];
        let least = if even {
            // The parent is an odd power, of the variable's sign; in between lies zero or not.
            let one_sign = simd.or_m64s(simd.less_than_f64s(zero, c), simd.less_than_f64s(d, zero));
            simd.select_f64s(one_sign, simd.min_f64s(p, s), zero)
        } else {
            simd.min_f64s(simd.min_f64s(p, q), simd.min_f64s(r, s))
        };
        out[k] = least;
        out[vectors + k] = simd.max_f64s(simd.max_f64s(p, q), simd.max_f64s(r, s));
    }
}

/// Least and greatest value of a span.
#[inline(always)]
fn range_of(values: &[f64]) -> [f64; 2] {
    const LANES: usize = 8;
    let [low, high] = RegionRanges::EMPTY;
    let (mut least, mut most) = ([low; LANES], [high; LANES]);
    let (whole, rest) = values.as_chunks::<LANES>();
    for values in whole {
        for i in 0..LANES {
            least[i] = min(values[i], least[i]);
            most[i] = max(values[i], most[i]);
        }
    }
    for (i, &value) in rest.iter().enumerate() {
        least[i] = min(value, least[i]);
        most[i] = max(value, most[i]);
    }
    for half in [4, 2, 1] {
        for i in 0..half {
            least[i] = min(least[i + half], least[i]);
            most[i] = max(most[i + half], most[i]);
        }
    }
    [least[0], most[0]]
}

/// Of numbers, without the care for NaN that costs instructions.
#[inline(always)]
fn min(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
