//! Libraries that are all monomials of some variables up to a degree. Their rows are summed as Chebyshev moments,
//! several times cheaper than products of pairs of functions.

use std::collections::HashMap;

use fleetfoot_library::{Binary, Expr, Node};
use fleetfoot_stats::{PolynomialMoments, PolynomialPlan, PolynomialScratch, Preconditioner};

use super::ranges::MonomialRanges;

/// Rows of the pilot that fix the basis, for every function.
const ROWS_A_FUNCTION: usize = 8;
/// And at least and at most.
const ROWS: [usize; 2] = [4_096, 20_000];
/// Condition of the basis up to which the factor of its Gram matrix is taken: its square times 1e-16 is the error of coefficients.
const CONDITION: f64 = 1e5;
/// Share that rounding may have in the uncertainty of the fit.
const ROUNDING: f64 = 1e-3;
/// Error of a fit, relative to the size of its target, below which the moments are too inaccurate: they have its square
/// to some 1e-16 of the target's.
const EXACT: f64 = 1e-6;

/// Functions that are exactly the monomials of degree 1 to `degree` of `variables`, in any order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Monomials {
    pub(super) variables: Vec<Expr>,
    pub(super) degree: usize,
    /// Powers of the variables in every function, in the order of the functions.
    exponents: Vec<Vec<u8>>,
}

/// A plan of moments, and how its functions stand among the system's.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polynomial {
    pub(super) variables: Vec<Expr>,
    pub(super) plan: PolynomialPlan,
    pub(super) preconditioner: Preconditioner,
    pub(super) ranges: MonomialRanges,
}

impl Monomials {
    /// Monomials of `functions`; `None` if they are not that. Variables are the factors of the products: columns, lags,
    /// functions of them.
    pub(super) fn recognise(functions: &[Expr]) -> Option<Self> {
        let mut variables: Vec<Expr> = Vec::new();
        let mut index: HashMap<Expr, usize> = HashMap::new();
        let mut powers: Vec<HashMap<usize, u32>> = Vec::with_capacity(functions.len());
        for function in functions {
            let mut product = HashMap::new();
            factors(function, 1, &mut |variable, power| {
                let next = variables.len();
                let at = *index.entry(variable.clone()).or_insert(next);
                if at == next {
                    variables.push(variable.clone());
                }
                *product.entry(at).or_insert(0) += power;
            })?;
            powers.push(product);
        }
        let degrees = powers.iter().map(|product| product.values().sum::<u32>());
        let degree = degrees.max().filter(|&degree| degree < 128)? as usize;
        if choose(variables.len() + degree, degree) != Some(functions.len() + 1) {
            return None;
        }
        let exponents: Vec<Vec<u8>> = powers
            .iter()
            .map(|product| (0..variables.len()).map(|v| product.get(&v).map_or(0, |&power| power as u8)).collect())
            .collect();
        let distinct: std::collections::HashSet<&Vec<u8>> = exponents.iter().collect();
        (distinct.len() == functions.len()).then_some(Self { variables, degree, exponents })
    }

    /// The plan for a source of `total` rows with this pilot sample, one vector a column, variables first. `None` if
    /// products of pairs are more accurate: a pilot with nearly collinear functions, or data so exact that rounding
    /// would show.
    pub(super) fn plan(self, pilot: &[Vec<f64>], total: usize) -> Option<Polynomial> {
        let rows = pilot.first().map_or(0, Vec::len);
        let wanted = (ROWS_A_FUNCTION * self.exponents.len()).clamp(ROWS[0], ROWS[1]);
        let stride = rows.div_ceil(wanted).max(1);
        let some: Vec<Vec<f64>> = pilot.iter().map(|column| column.iter().step_by(stride).copied().collect()).collect();
        let columns: Vec<&[f64]> = some.iter().map(Vec::as_slice).collect();
        let (base, targets) = columns.split_at(self.variables.len());
        let plan = PolynomialPlan::from_pilot(base, targets, self.degree).ok()?;
        if plan.condition() > CONDITION {
            return None;
        }
        let moments = self.of_plan(plan)?;
        moments.tells(base, targets, total).then_some(moments)
    }

    /// The plan that [`PolynomialPlan::to_bytes`] kept, for so many targets; `None` where the bytes are not of these functions.
    pub(super) fn restore(self, bytes: &[u8], targets: usize) -> Option<Polynomial> {
        let plan = PolynomialPlan::from_bytes(bytes, self.variables.len(), self.degree, targets).ok()?;
        self.of_plan(plan)
    }

    fn of_plan(self, plan: PolynomialPlan) -> Option<Polynomial> {
        let places: HashMap<&[u8], usize> =
            self.exponents.iter().enumerate().map(|(place, exponent)| (exponent.as_slice(), place)).collect();
        let order: Option<Vec<usize>> = plan.exponents().map(|exponent| places.get(exponent).copied()).collect();
        let order = order?;
        let ranges = MonomialRanges::new(&plan, &order);
        let preconditioner = plan.preconditioner(&order);
        Some(Polynomial { variables: self.variables, plan, preconditioner, ranges })
    }
}

impl Polynomial {
    /// Returns true if the rounding of the moments of `rows` rows stays a small part of a fit's uncertainty.
    ///
    /// Errors e of the rows move X'y by about `sqrt(n) |x| |e|`. The moments sum squares of targets and functions
    /// themselves. Their rounding moves X'y by at most `n eps |x| |y|`, and by as much times the condition through X'X.
    /// Both go through the same inverse to the coefficients. The test is therefore on
    /// `sqrt(n) eps condition |y| / |e|`. A plan of products takes the pilot's prediction out of the targets first, and
    /// keeps the digits of exact data.
    fn tells(&self, base: &[&[f64]], targets: &[&[f64]], rows: usize) -> bool {
        let mut moments = self.plan.moments();
        moments.add(&self.plan, &mut self.plan.scratch(), base, targets, None);
        let root = self.preconditioner.square_root(&self.plan.gram(&moments));
        let least = ((rows as f64).sqrt() * f64::EPSILON * self.plan.condition() / ROUNDING).max(EXACT);
        root.residual.iter().zip(&root.total).all(|(residual, total)| residual.sqrt() > least * total.sqrt())
    }

    /// Adds rows: variables and targets, column-major.
    pub(super) fn add(
        &self,
        moments: &mut PolynomialMoments,
        scratch: &mut PolynomialScratch,
        columns: &[&[f64]],
        weights: Option<&[f64]>,
    ) {
        let (base, targets) = columns.split_at(self.variables.len());
        moments.add(&self.plan, scratch, base, targets, weights);
    }
}

/// Calls `take(variable, power)` for the factors of a product; `None` unless it is a monomial.
fn factors(expr: &Expr, power: u32, take: &mut impl FnMut(&Expr, u32)) -> Option<()> {
    match expr.node() {
        Node::Binary(Binary::Mul, a, b) => {
            factors(a, power, take)?;
            factors(b, power, take)
        }
        Node::Power(base, exponent) => {
            let exponent = u32::try_from(*exponent).ok()?;
            factors(base, power.checked_mul(exponent)?, take)
        }
        Node::Number(_) => None,
        _ => {
            take(expr, power);
            Some(())
        }
    }
}

/// n over k, unless it overflows.
fn choose(n: usize, k: usize) -> Option<usize> {
    (1..=k.min(n - k)).try_fold(1_usize, |value, i| Some(value.checked_mul(n + 1 - i)? / i))
}
