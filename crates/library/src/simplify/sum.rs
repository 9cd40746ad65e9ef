//! Expressions as a number plus multiples of distinct functions, a form in which sums are collected.

use std::collections::HashMap;

use super::{join_difference, join_sum, monomial::Monomial, product, unary};
use crate::{Binary, Expr, Node, Unary};

/// Operands and operators of a sum that are looked at together, as for products.
const MAX_PARTS: usize = 256;

/// `constant + sum of coefficient * function`: the functions are distinct as products, in the order of their first appearance,
/// and without a number of their own.
#[derive(Debug, Clone)]
pub(crate) struct Sum {
    constant: f64,
    pub(crate) terms: Vec<Term>,
    /// True if the expression had two terms with the same function, or two numbers.
    pub(crate) collected: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct Term {
    pub(crate) function: Expr,
    coefficient: f64,
    /// The term without its sign, as long as it stands for itself.
    written: Option<(Expr, f64)>,
}

impl Sum {
    /// The terms of an expression; those that cancel are gone.
    pub(crate) fn of(expr: &Expr) -> Self {
        let mut sum = Self { constant: 0.0, terms: Vec::new(), collected: false };
        let mut index: HashMap<u64, Vec<usize>> = HashMap::new();
        let (mut stack, mut parts, mut numbers) = (vec![(expr.clone(), 1.0)], 0, 0);
        while let Some((part, sign)) = stack.pop() {
            parts += 1;
            match part.node() {
                Node::Binary(Binary::Add, a, b) if parts < MAX_PARTS => {
                    stack.extend([(b.clone(), sign), (a.clone(), sign)]);
                }
                Node::Binary(Binary::Sub, a, b) if parts < MAX_PARTS => {
                    stack.extend([(b.clone(), -sign), (a.clone(), sign)]);
                }
                Node::Unary(Unary::Neg, x) => stack.push((x.clone(), -sign)),
                Node::Number(value) => {
                    sum.constant += sign * value;
                    numbers += 1;
                }
                _ => sum.add(part, sign, &mut index),
            }
        }
        sum.terms.retain(|term| term.coefficient != 0.0);
        sum.collected |= numbers > 1;
        sum
    }

    fn add(&mut self, part: Expr, sign: f64, index: &mut HashMap<u64, Vec<usize>>) {
        let (coefficient, function) = split(&part);
        let coefficient = sign * coefficient;
        let same = index.entry(digest(&function)).or_default();
        match same.iter().find(|&&at| equal(&self.terms[at].function, &function)) {
            Some(&at) => {
                let term = &mut self.terms[at];
                term.coefficient += coefficient;
                term.written = None;
                self.collected = true;
            }
            None => {
                same.push(self.terms.len());
                self.terms.push(Term { function, coefficient, written: Some((part, sign)) });
            }
        }
    }

    /// The expression, added from the left in the order of the terms, the constant last; a positive term first if there is one.
    pub(crate) fn expr(&self) -> Expr {
        let mut signed: Vec<(Expr, bool)> = self.terms.iter().map(Term::expr).collect();
        if self.constant != 0.0 {
            signed.push((Expr::number(self.constant.abs()), self.constant < 0.0));
        }
        if let Some(first) = signed.iter().position(|&(_, negative)| !negative) {
            signed[..=first].rotate_right(1);
        }
        let mut terms = signed.into_iter();
        let first = match terms.next() {
            None => return Expr::number(0.0),
            Some((first, false)) => first,
            Some((first, true)) => unary(Unary::Neg, first),
        };
        terms.fold(
            first,
            |sum, (term, negative)| if negative { join_difference(sum, term) } else { join_sum(sum, term) },
        )
    }
}

impl Term {
    /// The term, and whether it is to be subtracted.
    fn expr(&self) -> (Expr, bool) {
        match &self.written {
            Some((written, sign)) if self.coefficient * sign > 0.0 => (written.clone(), *sign < 0.0),
            _ => {
                let size = Expr::number(self.coefficient.abs());
                (product(size, self.function.clone()), self.coefficient < 0.0)
            }
        }
    }
}

/// A number in front or a number below, and the rest of a simplified product.
fn split(expr: &Expr) -> (f64, Expr) {
    let (scale, rest) = match expr.node() {
        Node::Binary(Binary::Div, a, b) => match b.as_number() {
            Some(divisor) if divisor != 0.0 => (1.0 / divisor, a),
            _ => (1.0, expr),
        },
        _ => (1.0, expr),
    };
    match rest.node() {
        Node::Binary(Binary::Mul, a, b) => match a.as_number() {
            Some(factor) => (factor * scale, b.clone()),
            None => (scale, rest.clone()),
        },
        _ => (scale, rest.clone()),
    }
}

fn is_product(expr: &Expr) -> bool {
    matches!(expr.node(), Node::Binary(Binary::Mul, ..))
}

/// Equal up to the order of factors.
fn equal(a: &Expr, b: &Expr) -> bool {
    if a == b {
        return true;
    }
    if !is_product(a) || !is_product(b) || a.size() != b.size() {
        return false;
    }
    let (a, b) = (Monomial::of(a), Monomial::of(b));
    a.factor() == b.factor()
        && a.powers.len() == b.powers.len()
        && a.powers.iter().all(|power| b.powers.contains(power))
}

/// The same for expressions that are [`equal`].
fn digest(expr: &Expr) -> u64 {
    if !is_product(expr) {
        return expr.digest();
    }
    let powers = Monomial::of(expr).powers;
    powers.iter().fold(0, |sum, (base, exponent)| {
        sum.wrapping_add(fleetfoot_data::mix(base.digest().wrapping_add(*exponent as u64)))
    })
}
