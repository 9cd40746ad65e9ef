//! Sets of candidate functions, and their sums, products and lags.

use std::{
    cmp::Ordering,
    collections::{HashMap, HashSet},
};

use crate::{Expr, MAX_FUNCTIONS, Node, ParseErrorKind, Unary, simplify::Monomial};

/// Pairs of functions whose products are formed at once; many of them may be equal.
const MAX_PAIRS: usize = 4 * MAX_FUNCTIONS;

/// Exponents of atoms, by ascending atom: what makes a candidate the same as another.
type Powers = Vec<(usize, i32)>;

/// The factors that candidates are made of, numbered in the order in which they came up: the variables first.
#[derive(Debug, Default)]
pub(crate) struct Workshop {
    atoms: Vec<Expr>,
    /// Of an absolute value the factors within: its even powers are theirs.
    within: Vec<Option<Powers>>,
    index: HashMap<Expr, usize>,
}

/// One candidate function.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    factor: f64,
    powers: Powers,
    /// The form in which it was written, where it was.
    written: Option<Expr>,
}

/// Distinct candidate functions in their order.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    pub(crate) constant: bool,
    list: Vec<Candidate>,
    seen: HashSet<Powers>,
}

impl Workshop {
    pub(crate) fn new(variables: &[Expr]) -> Self {
        let mut workshop = Self::default();
        for variable in variables {
            workshop.candidate(&variable.simplified());
        }
        workshop
    }

    fn atom(&mut self, base: Expr) -> usize {
        let key = base.canonical();
        if let Some(&known) = self.index.get(&key) {
            return known;
        }
        let within = match base.node() {
            Node::Unary(Unary::Abs, x) => Some(self.candidate(x).powers),
            _ => None,
        };
        self.index.insert(key, self.atoms.len());
        self.atoms.push(base);
        self.within.push(within);
        self.atoms.len() - 1
    }

    /// The factors of a simplified expression.
    fn candidate(&mut self, expr: &Expr) -> Candidate {
        let product = Monomial::of(expr);
        let factor = product.factor();
        let mut powers: Powers =
            product.powers.into_iter().map(|(base, exponent)| (self.atom(base), exponent)).collect();
        self.settle(&mut powers);
        Candidate { factor, powers, written: Some(expr.clone()) }
    }

    /// Each atom once, in order; even powers of absolute values written out.
    fn settle(&self, powers: &mut Powers) {
        loop {
            powers.sort_unstable();
            powers.dedup_by(|next, first| {
                let same = next.0 == first.0;
                if same {
                    first.1 = first.1.saturating_add(next.1);
                }
                same
            });
            powers.retain(|&(_, exponent)| exponent != 0);
            let even = |&(atom, exponent): &(usize, i32)| exponent % 2 == 0 && self.within[atom].is_some();
            let Some(at) = powers.iter().position(even) else { return };
            let (atom, exponent) = powers.swap_remove(at);
            let within = self.within[atom].iter().flatten();
            powers.extend(within.map(|&(inner, power)| (inner, power.saturating_mul(exponent))));
        }
    }

    /// `a*b^exponent`, with no number in front.
    fn times(&self, a: &Candidate, b: &Candidate, exponent: i32) -> Candidate {
        let raised = b.powers.iter().map(|&(atom, power)| (atom, power.saturating_mul(exponent)));
        let mut powers: Powers = a.powers.iter().copied().chain(raised).collect();
        self.settle(&mut powers);
        // A factor of 1 leaves the other as it was written.
        let written = match (a.powers.is_empty(), b.powers.is_empty()) {
            (_, true) => a.written.clone(),
            (true, _) if exponent == 1 => b.written.clone(),
            _ => None,
        };
        Candidate { factor: 1.0, powers, written }
    }

    /// A candidate function as an expression.
    fn expr(&self, candidate: &Candidate) -> Expr {
        candidate.written.clone().unwrap_or_else(|| {
            let powers =
                candidate.powers.iter().map(|&(atom, exponent)| (self.atoms[atom].clone(), exponent)).collect();
            Monomial::new(candidate.factor, powers).expr()
        })
    }

    /// One expression.
    ///
    /// # Errors
    /// It is 0 or not a number everywhere.
    pub(crate) fn single(&mut self, expr: &Expr) -> Result<Candidates, ParseErrorKind> {
        let simple = expr.simplified();
        let candidate = self.candidate(&simple);
        if candidate.factor == 0.0 || !candidate.factor.is_finite() {
            return Err(ParseErrorKind::NoFunction { value: simple.to_string() });
        }
        Ok([candidate].into_iter().collect())
    }

    /// `function` of every function but the constant.
    pub(crate) fn map(
        &mut self,
        function: impl Fn(&Expr) -> Expr,
        of: &Candidates,
    ) -> Result<Candidates, ParseErrorKind> {
        let mut mapped = Candidates::default();
        for candidate in &of.list {
            mapped.append(self.single(&function(&self.expr(candidate)))?);
        }
        Ok(mapped)
    }

    /// Every function at every one of these lags, lag by lag; a constant stays one.
    pub(crate) fn lagged(
        &mut self,
        of: &Candidates,
        lags: impl ExactSizeIterator<Item = i32>,
    ) -> Result<Candidates, ParseErrorKind> {
        limit(of.list.len().checked_mul(lags.len()))?;
        let mut lagged = Candidates { constant: of.constant, ..Candidates::default() };
        for lag in lags {
            lagged.append(self.map(|x| x.shifted(lag), of)?);
        }
        Ok(lagged)
    }

    /// `sin(k*x), cos(k*x)` for k = 1..=n and every function x but the constant, frequency by frequency.
    pub(crate) fn fourier(&mut self, of: &Candidates, n: u32) -> Result<Candidates, ParseErrorKind> {
        limit(of.list.len().checked_mul(2 * n as usize))?;
        let mut waves = Candidates::default();
        for k in 1..=n {
            for x in of.functions(self) {
                let angle = if k == 1 { x } else { f64::from(k) * x };
                for function in [Unary::Sin, Unary::Cos] {
                    waves.append(self.single(&Expr::unary(function, angle.clone()))?);
                }
            }
        }
        Ok(waves)
    }

    /// Products of up to `degree` of the functions, each up to `highest` times, by total degree, then lexicographically.
    pub(crate) fn monomials(
        &mut self,
        of: &Candidates,
        degree: u32,
        highest: u32,
        bias: bool,
    ) -> Result<Candidates, ParseErrorKind> {
        limit(count_monomials(of.list.len(), degree, highest))?;
        let mut all = Candidates { constant: bias, ..Candidates::default() };
        // All products of one degree: the index of their last function, how often it occurs, and the product.
        let mut level: Vec<(usize, u32, Candidate)> = Vec::new();
        for total in 1..=degree {
            level = match total {
                1 => of.list.iter().enumerate().map(|(at, candidate)| (at, 1, candidate.clone())).collect(),
                _ => level.iter().flat_map(|shorter| self.longer(shorter, of, highest)).collect(),
            };
            for (_, _, product) in &level {
                all.insert(product.clone());
            }
        }
        Ok(all)
    }

    /// A product times its last function again or a later one.
    fn longer(
        &self,
        (last, times, product): &(usize, u32, Candidate),
        of: &Candidates,
        highest: u32,
    ) -> Vec<(usize, u32, Candidate)> {
        let again = (*times < highest).then_some((*last, *times + 1));
        let next = again.into_iter().chain((last + 1..of.list.len()).map(|next| (next, 1)));
        next.map(|(at, times)| (at, times, self.times(product, &of.list[at], 1))).collect()
    }

    /// All pairwise products; `exponent` -1 divides by the functions of `b`.
    pub(crate) fn product(&self, a: &Candidates, b: &Candidates, exponent: i32) -> Result<Candidates, ParseErrorKind> {
        let sizes = [a, b].map(|of| of.list.len() + usize::from(of.constant));
        match sizes[0].checked_mul(sizes[1]) {
            Some(pairs) if pairs <= MAX_PAIRS => {}
            pairs => limit(pairs)?,
        }
        let one = Candidate { factor: 1.0, powers: Powers::new(), written: None };
        let with_constant = |of: &Candidates| {
            of.constant.then(|| one.clone()).into_iter().chain(of.list.iter().cloned()).collect::<Vec<_>>()
        };
        let (left, right) = (with_constant(a), with_constant(b));
        let mut products: Vec<Candidate> =
            left.iter().flat_map(|a| right.iter().map(move |b| self.times(a, b, exponent))).collect();
        products.sort_by(graded);
        let product: Candidates = products.into_iter().collect();
        limit(Some(product.len()))?;
        Ok(product)
    }
}

impl Candidates {
    /// Functions, the constant not counted.
    pub(crate) fn len(&self) -> usize {
        self.list.len()
    }

    pub(crate) fn append(&mut self, other: Self) {
        self.constant |= other.constant;
        self.extend(other.list);
    }

    /// The functions but the constant.
    pub(crate) fn functions(&self, workshop: &Workshop) -> Vec<Expr> {
        self.list.iter().map(|candidate| workshop.expr(candidate)).collect()
    }

    fn insert(&mut self, candidate: Candidate) {
        if candidate.powers.is_empty() {
            self.constant = true;
        } else if self.seen.insert(candidate.powers.clone()) {
            self.list.push(candidate);
        }
    }
}

impl Extend<Candidate> for Candidates {
    fn extend<T: IntoIterator<Item = Candidate>>(&mut self, candidates: T) {
        candidates.into_iter().for_each(|candidate| self.insert(candidate));
    }
}

impl FromIterator<Candidate> for Candidates {
    fn from_iter<T: IntoIterator<Item = Candidate>>(candidates: T) -> Self {
        let mut all = Self::default();
        all.extend(candidates);
        all
    }
}

/// By total degree, then higher powers of earlier atoms first: x, y, x^2, x*y, y^2.
fn graded(a: &Candidate, b: &Candidate) -> Ordering {
    let degree = |of: &Candidate| of.powers.iter().map(|&(_, exponent)| i64::from(exponent).abs()).sum::<i64>();
    degree(a).cmp(&degree(b)).then_with(|| {
        let differs = a.powers.iter().zip(&b.powers).find(|(x, y)| x != y);
        match differs {
            Some((&(i, k), &(j, l))) => i.cmp(&j).then(l.cmp(&k)),
            None => b.powers.len().cmp(&a.powers.len()),
        }
    })
}

/// `sum over s of` the monomials of total degree s = 1..=degree with no exponent beyond `highest` (1 or no limit).
fn count_monomials(variables: usize, degree: u32, highest: u32) -> Option<usize> {
    if highest > 1 {
        return crate::library::monomials(variables, degree);
    }
    let (mut subsets, mut sum) = (1u128, 0u128);
    for size in 1..=(degree as usize).min(variables) as u128 {
        subsets = subsets.checked_mul(variables as u128 - size + 1)? / size;
        sum = sum.checked_add(subsets)?;
        if sum > usize::MAX as u128 {
            return None;
        }
    }
    usize::try_from(sum).ok()
}

fn limit(count: Option<usize>) -> Result<(), ParseErrorKind> {
    match count {
        Some(count) if count <= MAX_FUNCTIONS => Ok(()),
        functions => Err(ParseErrorKind::TooManyFunctions { functions }),
    }
}
