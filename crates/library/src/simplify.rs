//! Simplification: constants are combined, zeros and ones vanish, equal factors and equal terms are collected.

mod monomial;
mod sum;

pub(crate) use monomial::Monomial;
pub(crate) use sum::Sum;

use crate::{Binary, Expr, Node, Unary, function::integer_power};

impl Expr {
    /// The same function in a shorter form. Constants are combined; additions of 0, factors of 0 or 1 and exponents of
    /// 1 are removed. Equal factors are collected to powers (`x*x^2` to `x^3`, `x^2/x` to `x`) and equal terms to
    /// multiples (`x + y - 3*x` to `y - 2*x`, `x*y - y*x` to 0). Brackets are not multiplied out, and no identities of
    /// functions are used but those of signs and absolute values. The result is never larger; collected terms stand in
    /// the order of their first appearance.
    ///
    /// If the expression is defined, the value is the same up to rounding. `0*x` becomes 0 even where x is not a
    /// number, and `x/x` becomes 1 even at 0. Sums of more than 128 terms and products of more than 32 factors are
    /// collected piece by piece.
    pub fn simplified(&self) -> Self {
        self.fold(|expr, arguments: &[Expr]| match (expr.node(), arguments) {
            (Node::Unary(function, _), [x]) => unary(*function, x.clone()),
            (Node::Power(_, k), [x]) => power(x.clone(), *k),
            (Node::Binary(function, ..), [a, b]) => binary(*function, a.clone(), b.clone()),
            _ => expr.clone(),
        })
    }

    pub(crate) fn is_number(&self, value: f64) -> bool {
        self.as_number() == Some(value)
    }
}

pub(crate) fn binary(function: Binary, a: Expr, b: Expr) -> Expr {
    if let (Some(x), Some(y)) = (a.as_number(), b.as_number()) {
        return Expr::number(function.apply(x, y));
    }
    match function {
        Binary::Add => sum(a, b),
        Binary::Sub => difference(a, b),
        Binary::Mul => product(a, b),
        Binary::Div => quotient(a, b),
        Binary::Pow => {
            let expr = Expr::binary(Binary::Pow, a, b);
            match expr.node() {
                Node::Power(x, k) => power(x.clone(), *k),
                _ => expr,
            }
        }
        Binary::Min | Binary::Max if a == b => a,
        Binary::Atan2 | Binary::Min | Binary::Max => Expr::binary(function, a, b),
    }
}

pub(crate) fn unary(function: Unary, x: Expr) -> Expr {
    match (function, x.node()) {
        (_, Node::Number(value)) => Expr::number(function.apply(*value)),
        (Unary::Neg, Node::Unary(Unary::Neg, inner)) => inner.clone(),
        (Unary::Neg, Node::Binary(Binary::Sub, a, b)) => join_difference(b.clone(), a.clone()),
        (Unary::Neg, Node::Binary(Binary::Mul, a, b)) if a.as_number().is_some() => product(-a, b.clone()),
        (Unary::Neg, Node::Binary(Binary::Div, a, b)) if number_in_front(a) => {
            join_quotient(unary(Unary::Neg, a.clone()), b.clone())
        }
        (Unary::Abs, Node::Unary(Unary::Neg, inner)) => unary(Unary::Abs, inner.clone()),
        (Unary::Abs, Node::Unary(Unary::Abs, _)) => x,
        _ => Expr::unary(function, x),
    }
}

pub(crate) fn sum(a: Expr, b: Expr) -> Expr {
    collected_sum(join_sum(a, b))
}

pub(crate) fn difference(a: Expr, b: Expr) -> Expr {
    collected_sum(join_difference(a, b))
}

pub(crate) fn product(a: Expr, b: Expr) -> Expr {
    collected_product(join_product(a, b))
}

pub(crate) fn quotient(a: Expr, b: Expr) -> Expr {
    collected_product(join_quotient(a, b))
}

pub(crate) fn power(x: Expr, k: i32) -> Expr {
    match x.node() {
        Node::Number(value) => Expr::number(integer_power(*value, k)),
        Node::Power(inner, j) => match j.checked_mul(k) {
            Some(both) => power(inner.clone(), both),
            None => x.powi(k),
        },
        Node::Unary(Unary::Neg, inner) if k % 2 == 0 => power(inner.clone(), k),
        Node::Unary(Unary::Neg, inner) => unary(Unary::Neg, power(inner.clone(), k)),
        Node::Unary(Unary::Abs, inner) if k % 2 == 0 => power(inner.clone(), k),
        _ => x.powi(k),
    }
}

/// Equal terms of a sum taken together, if there are any.
fn collected_sum(expr: Expr) -> Expr {
    if !matches!(expr.node(), Node::Binary(Binary::Add | Binary::Sub, ..)) {
        return expr;
    }
    let sum = Sum::of(&expr);
    if !sum.collected {
        return expr;
    }
    let shorter = sum.expr();
    if shorter.size() <= expr.size() { shorter } else { expr }
}

/// Equal factors of a product and its numbers taken together, if there are any.
fn collected_product(expr: Expr) -> Expr {
    match expr.node() {
        Node::Binary(Binary::Mul | Binary::Div, ..) => {}
        Node::Unary(Unary::Neg, x) if matches!(x.node(), Node::Binary(Binary::Mul | Binary::Div, ..)) => {
            return unary(Unary::Neg, collected_product(x.clone()));
        }
        _ => return expr,
    }
    let product = Monomial::of(&expr);
    if !product.collected {
        return expr;
    }
    let shorter = product.expr();
    if shorter.size() <= expr.size() { shorter } else { expr }
}

/// Two terms, with no minus behind a plus.
pub(crate) fn join_sum(a: Expr, b: Expr) -> Expr {
    if a.is_number(0.0) {
        return b;
    }
    if b.is_number(0.0) {
        return a;
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x + y),
        _ => match (negated(&a), negated(&b)) {
            (_, Some(y)) => join_difference(a, y),
            (Some(x), None) => b - x,
            _ => a + b,
        },
    }
}

pub(crate) fn join_difference(a: Expr, b: Expr) -> Expr {
    if b.is_number(0.0) {
        return a;
    }
    if a.is_number(0.0) {
        return unary(Unary::Neg, b);
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x - y),
        _ => match negated(&b) {
            Some(y) => join_sum(a, y),
            None => a - b,
        },
    }
}

/// The expression without its minus sign, if it has an evident one: `x` of `-x`, `2*x` of `-2*x`, 3 of -3.
fn negated(expr: &Expr) -> Option<Expr> {
    match expr.node() {
        Node::Unary(Unary::Neg, x) => Some(x.clone()),
        Node::Number(value) if *value < 0.0 => Some(Expr::number(-value)),
        Node::Binary(Binary::Mul, a, b) if a.as_number().is_some_and(|value| value < 0.0) => Some(-a * b),
        Node::Binary(Binary::Div, a, b) if a.as_number().is_some_and(|value| value < 0.0) => Some(-a / b),
        _ => None,
    }
}

/// Products carry one constant, in front.
fn join_product(a: Expr, b: Expr) -> Expr {
    let ((c, x), (d, y)) = (scaled(&a), scaled(&b));
    let factor = c * d;
    if factor == 0.0 {
        return Expr::number(0.0);
    }
    let rest = match (x, y) {
        (None, None) => return Expr::number(factor),
        (Some(x), None) | (None, Some(x)) => x,
        (Some(x), Some(y)) => collected_product(x * y),
    };
    if factor == 1.0 {
        rest
    } else if factor == -1.0 {
        unary(Unary::Neg, rest)
    } else {
        factor * rest
    }
}

fn join_quotient(a: Expr, b: Expr) -> Expr {
    if a.is_number(0.0) {
        return a;
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x / y),
        (_, Node::Number(1.0)) => a,
        (_, Node::Number(value)) if *value < 0.0 && (number_in_front(&a) || negated(&a).is_some()) => {
            join_quotient(unary(Unary::Neg, a), Expr::number(-value))
        }
        (Node::Unary(Unary::Neg, x), _) => unary(Unary::Neg, join_quotient(x.clone(), b)),
        (_, Node::Unary(Unary::Neg, y)) => unary(Unary::Neg, join_quotient(a.clone(), y.clone())),
        _ => a / b,
    }
}

fn number_in_front(expr: &Expr) -> bool {
    match expr.node() {
        Node::Number(_) => true,
        Node::Binary(Binary::Mul, a, _) => a.as_number().is_some(),
        _ => false,
    }
}

/// A constant factor and the rest; no rest for a constant.
fn scaled(expr: &Expr) -> (f64, Option<Expr>) {
    match expr.node() {
        Node::Number(value) => (*value, None),
        Node::Unary(Unary::Neg, x) => {
            let (factor, rest) = scaled_once(x);
            (-factor, rest)
        }
        _ => scaled_once(expr),
    }
}

fn scaled_once(expr: &Expr) -> (f64, Option<Expr>) {
    match expr.node() {
        Node::Number(value) => (*value, None),
        Node::Binary(Binary::Mul, a, b) => match a.as_number() {
            Some(factor) => (factor, Some(b.clone())),
            None => (1.0, Some(expr.clone())),
        },
        _ => (1.0, Some(expr.clone())),
    }
}
