//! The least and greatest values of monomials over rows, without evaluating them on most rows.

use std::collections::HashMap;

use fleetfoot_stats::{
    PolynomialPlan,
    scan::{RegionRanges, extreme},
};
use pulp::NullaryFnOnce;

/// Rows whose monomials are bounded together.
const BLOCK: usize = 128;

/// The ranges of all monomials of a polynomial library.
///
/// Consecutive rows of a trajectory are near each other. For every few of them the monomials are bounded by interval arithmetic from the ranges of the variables,
/// and evaluated only if a bound leaves what is already known. Products of bounds are rounded as products of values are, and rounding is monotone, so nothing is
/// missed.
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
    /// Whether the monomial is an even power of one variable, and so not negative.
    even: bool,
}

/// Working memory: ranges in graded order, bounds of a block, its monomials.
#[derive(Debug, Default)]
pub(super) struct RangesScratch {
    bounds: Vec<[f64; 2]>,
    values: Vec<f64>,
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
        scratch.bounds.resize(self.recipes.len(), RegionRanges::EMPTY);
        scratch.values.resize(self.recipes.len() * BLOCK, 0.0);
        pulp::Arch::new().dispatch(AddBlocks { recipes: &self.recipes, ranges, variables, scratch });
    }
}

struct AddBlocks<'a> {
    recipes: &'a [Recipe],
    ranges: &'a mut [[f64; 2]],
    variables: &'a [&'a [f64]],
    scratch: &'a mut RangesScratch,
}

impl NullaryFnOnce for AddBlocks<'_> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let rows = self.variables.first().map_or(0, |column| column.len());
        for from in (0..rows).step_by(BLOCK) {
            let to = (from + BLOCK).min(rows);
            if self.may_widen(from, to) {
                self.evaluate(from, to);
            }
        }
    }
}

impl AddBlocks<'_> {
    /// Whether the bound of a monomial over the rows leaves its range.
    #[inline(always)]
    fn may_widen(&mut self, from: usize, to: usize) -> bool {
        let (bounds, mut widens) = (&mut self.scratch.bounds, false);
        // Monomials of degree 1 come first, and in the order of the variables.
        for (bound, column) in bounds.iter_mut().zip(self.variables) {
            *bound = extreme(RegionRanges::EMPTY, &column[from..to]);
        }
        for (i, recipe) in self.recipes.iter().enumerate() {
            if let Some(parent) = recipe.parent {
                let ([a, b], [c, d]) = (bounds[parent], bounds[recipe.variable]);
                let [p, q, r, s] = [a * c, a * d, b * c, b * d];
                let mut bound = [min(min(p, q), min(r, s)), max(max(p, q), max(r, s))];
                if recipe.even {
                    // The parent is an odd power, of the variable's sign; in between lies zero or not.
                    bound[0] = if c > 0.0 || d < 0.0 { min(p, s) } else { 0.0 };
                }
                bounds[i] = bound;
            }
            widens |= bounds[i][0] < self.ranges[i][0] || bounds[i][1] > self.ranges[i][1];
        }
        widens
    }

    #[inline(always)]
    fn evaluate(&mut self, from: usize, to: usize) {
        let count = to - from;
        for (i, recipe) in self.recipes.iter().enumerate() {
            let (known, values) = self.scratch.values.split_at_mut(i * BLOCK);
            let (values, variable) = (&mut values[..count], &self.variables[recipe.variable][from..to]);
            match recipe.parent {
                Some(parent) => {
                    let known = &known[parent * BLOCK..parent * BLOCK + count];
                    for ((value, a), b) in values.iter_mut().zip(known).zip(variable) {
                        *value = a * b;
                    }
                }
                None => values.copy_from_slice(variable),
            }
            self.ranges[i] = extreme(self.ranges[i], values);
        }
    }
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
