//! Simplification: constants are combined, zeros and ones vanish.

use crate::{Binary, Expr, Node, Unary, function::integer_power};

impl Expr {
    /// The same function with constants combined and with what adds 0, multiplies by 0 or 1 or is raised to 1 removed.
    ///
    /// Where the expression is defined the value is the same up to rounding; `0*x` becomes 0 even where x is not a number.
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
        Binary::Atan2 | Binary::Min | Binary::Max => Expr::binary(function, a, b),
    }
}

pub(crate) fn unary(function: Unary, x: Expr) -> Expr {
    match (function, x.node()) {
        (_, Node::Number(value)) => Expr::number(function.apply(*value)),
        (Unary::Neg, Node::Unary(Unary::Neg, inner)) => inner.clone(),
        (Unary::Neg, Node::Binary(Binary::Sub, a, b)) => difference(b.clone(), a.clone()),
        (Unary::Neg, Node::Binary(Binary::Mul, a, b)) if a.as_number().is_some() => product(-a, b.clone()),
        _ => Expr::unary(function, x),
    }
}

pub(crate) fn sum(a: Expr, b: Expr) -> Expr {
    if a.is_number(0.0) {
        return b;
    }
    if b.is_number(0.0) {
        return a;
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x + y),
        (_, Node::Unary(Unary::Neg, y)) => difference(a.clone(), y.clone()),
        (Node::Unary(Unary::Neg, x), _) => difference(b.clone(), x.clone()),
        _ => a + b,
    }
}

pub(crate) fn difference(a: Expr, b: Expr) -> Expr {
    if b.is_number(0.0) {
        return a;
    }
    if a.is_number(0.0) {
        return unary(Unary::Neg, b);
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x - y),
        (_, Node::Unary(Unary::Neg, y)) => sum(a.clone(), y.clone()),
        _ => a - b,
    }
}

/// Products carry one constant, in front.
pub(crate) fn product(a: Expr, b: Expr) -> Expr {
    let ((c, x), (d, y)) = (scaled(&a), scaled(&b));
    let factor = c * d;
    if factor == 0.0 {
        return Expr::number(0.0);
    }
    let rest = match (x, y) {
        (None, None) => return Expr::number(factor),
        (Some(x), None) | (None, Some(x)) => x,
        (Some(x), Some(y)) => square_or_product(x, y),
    };
    if factor == 1.0 {
        rest
    } else if factor == -1.0 {
        unary(Unary::Neg, rest)
    } else {
        factor * rest
    }
}

pub(crate) fn quotient(a: Expr, b: Expr) -> Expr {
    if a.is_number(0.0) {
        return a;
    }
    match (a.node(), b.node()) {
        (Node::Number(x), Node::Number(y)) => Expr::number(x / y),
        (_, Node::Number(1.0)) => a,
        (Node::Unary(Unary::Neg, x), _) => unary(Unary::Neg, quotient(x.clone(), b)),
        _ => a / b,
    }
}

pub(crate) fn power(x: Expr, k: i32) -> Expr {
    match x.node() {
        Node::Number(value) => Expr::number(integer_power(*value, k)),
        _ => x.powi(k),
    }
}

fn square_or_product(x: Expr, y: Expr) -> Expr {
    if x == y { x.powi(2) } else { x * y }
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
