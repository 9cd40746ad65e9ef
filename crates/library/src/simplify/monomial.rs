//! Expressions as a number times integer powers, a form in which products of candidate functions are compared and
//! collected.

use crate::{Binary, Expr, Node, Unary, function::integer_power};

/// Operands and operators of a product that are looked at together. What lies deeper stays as it is, so that the time is linear
/// in the size of an expression however its parts are shared.
const MAX_PARTS: usize = 64;
/// Exponents beyond which a power is taken for a function of its own.
const MAX_EXPONENT: i64 = 1 << 16;

/// `above/below * product of base^exponent`: the bases are distinct, no products, quotients or powers themselves, and in the
/// order of their first appearance; no exponent is zero.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Monomial {
    above: f64,
    below: f64,
    pub(crate) powers: Vec<(Expr, i32)>,
    /// True if the expression had two numbers, the same base twice, or an even power of an absolute value.
    pub(crate) collected: bool,
}

impl Monomial {
    pub(crate) fn new(factor: f64, powers: Vec<(Expr, i32)>) -> Self {
        Self { above: factor, below: 1.0, powers, collected: false }
    }

    /// The factors of an expression. The same function wherever the expression is defined: `x/x` is 1.
    pub(crate) fn of(expr: &Expr) -> Self {
        let mut product = Self::new(1.0, Vec::new());
        let (mut stack, mut parts, mut numbers) = (vec![(expr.clone(), 1i64)], 0, 0);
        while let Some((part, exponent)) = stack.pop() {
            parts += 1;
            let open = parts < MAX_PARTS;
            match part.node() {
                Node::Number(value) => {
                    numbers += usize::from(*value != -1.0);
                    let side = if exponent < 0 { &mut product.below } else { &mut product.above };
                    *side *= integer_power(*value, exponent.abs() as i32);
                }
                Node::Unary(Unary::Neg, x) => {
                    product.above *= if exponent % 2 == 0 { 1.0 } else { -1.0 };
                    stack.push((x.clone(), exponent));
                }
                Node::Unary(Unary::Abs, x) if open && exponent % 2 == 0 => {
                    product.collected = true;
                    stack.push((x.clone(), exponent));
                }
                Node::Binary(Binary::Mul, a, b) if open => stack.extend([(b.clone(), exponent), (a.clone(), exponent)]),
                Node::Binary(Binary::Div, a, b) if open => {
                    stack.extend([(b.clone(), -exponent), (a.clone(), exponent)])
                }
                Node::Power(x, k) if open && (i64::from(*k) * exponent).abs() <= MAX_EXPONENT => {
                    stack.push((x.clone(), i64::from(*k) * exponent));
                }
                _ => product.multiply(part, exponent as i32),
            }
            // An even power may have come together only now.
            if stack.is_empty() && open {
                let even = |(base, exponent): &mut (Expr, i32)| {
                    *exponent != 0 && *exponent % 2 == 0 && matches!(base.node(), Node::Unary(Unary::Abs, _))
                };
                stack.extend(product.powers.extract_if(.., even).map(|(base, exponent)| (base, i64::from(exponent))));
            }
        }
        product.powers.retain(|&(_, exponent)| exponent != 0);
        // A division by zero is defined nowhere, and stays as it is written.
        product.collected = (product.collected || numbers > 1) && product.below != 0.0;
        product
    }

    fn multiply(&mut self, base: Expr, exponent: i32) {
        match self.powers.iter_mut().find(|(known, _)| *known == base) {
            Some((_, total)) => {
                *total += exponent;
                self.collected = true;
            }
            None => self.powers.push((base, exponent)),
        }
    }

    /// The number.
    pub(crate) fn factor(&self) -> f64 {
        self.above / self.below
    }

    /// The expression: one number, in front or at the end of the quotient as it needs no rounding; powers multiplied from the
    /// left in their order; one quotient.
    pub(crate) fn expr(&self) -> Expr {
        let (above, below) = reduced(self.above, self.below);
        if self.powers.is_empty() || above == 0.0 {
            return Expr::number(above / below);
        }
        let side = |number: f64, sign: i32| {
            let powers = self.powers.iter().filter(|(_, exponent)| exponent.signum() == sign);
            let powers =
                powers.map(|(base, exponent)| base.powi(exponent * sign)).reduce(|product, power| product * power);
            match powers {
                None => Expr::number(number),
                Some(product) if number == 1.0 => product,
                Some(product) => number * product,
            }
        };
        let minus = above == -1.0;
        let (above, below) = (side(if minus { 1.0 } else { above }, 1), side(below, -1));
        let quotient = if below.is_number(1.0) { above } else { above / below };
        if minus { super::unary(Unary::Neg, quotient) } else { quotient }
    }
}

/// `above/below` with one of them 1 where that needs no rounding, and no sign below.
fn reduced(above: f64, below: f64) -> (f64, f64) {
    let exact = |a: f64, b: f64| (a / b).is_normal() && (a / b).mul_add(b, -a) == 0.0;
    let sign = below.signum();
    if exact(above, below) {
        (above / below, 1.0)
    } else if exact(below, above) {
        let ratio = below / above;
        (ratio.signum(), ratio.abs())
    } else {
        (above * sign, below * sign)
    }
}
