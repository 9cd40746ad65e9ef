//! Forms in which expressions are compared.

use crate::{
    Binary, Expr, Node, Unary,
    simplify::{Monomial, Sum, unary},
};

impl Expr {
    /// A form for comparison only: equal for expressions that differ by the order of commuting operands, by brackets in sums
    /// and products, by signs, or by what [`Expr::simplified`] collects.
    pub(crate) fn canonical(&self) -> Self {
        self.simplified().fold(|expr, arguments: &[Expr]| match (expr.node(), arguments) {
            (Node::Unary(function, _), [x]) => ordered(unary(*function, x.clone())),
            (Node::Power(_, k), [x]) => ordered(x.powi(*k)),
            (Node::Binary(function, ..), [a, b]) => {
                let swap = matches!(function, Binary::Min | Binary::Max) && a.digest() > b.digest();
                let (a, b) = if swap { (b, a) } else { (a, b) };
                ordered(Expr::binary(*function, a.clone(), b.clone()))
            }
            _ => expr.clone(),
        })
    }
}

/// Brings the root's operands into an order of their own.
fn ordered(expr: Expr) -> Expr {
    match expr.node() {
        Node::Binary(Binary::Add | Binary::Sub, ..) => {
            let mut sum = Sum::of(&expr);
            sum.terms.sort_by_key(|term| term.function.digest());
            sum.expr()
        }
        Node::Unary(Unary::Neg, _) | Node::Power(..) | Node::Binary(Binary::Mul | Binary::Div, ..) => {
            let mut product = Monomial::of(&expr);
            product.powers.sort_by_key(|(base, _)| base.digest());
            product.expr()
        }
        _ => expr,
    }
}
