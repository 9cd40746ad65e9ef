//! Random expressions, and their values by plain recursion.

use fleetfoot_library::{Binary, Expr, Node, Unary};
use proptest::prelude::*;

/// Any expression over `names`: every node, every kind of number.
pub(crate) fn expressions(names: &'static [&'static str]) -> impl Strategy<Value = Expr> {
    let number = prop_oneof![
        4 => (-50i32..50).prop_map(|n| Expr::number(f64::from(n) / 4.0)),
        1 => any::<f64>().prop_map(Expr::number),
        1 => prop::sample::select(vec![0.0, -0.0, 1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e-300, 5e-324])
            .prop_map(Expr::number),
    ];
    let leaf = prop_oneof![
        2 => number,
        3 => prop::sample::select(names).prop_map(Expr::column),
        1 => (prop::sample::select(names), -3i32..4).prop_map(|(name, lag)| Expr::lagged(name, lag)),
        1 => (-3i32..4).prop_map(|lag| Expr::time().shifted(lag)),
    ];
    leaf.prop_recursive(6, 48, 2, |inner| {
        prop_oneof![
            2 => (prop::sample::select(&Unary::ALL[..]), inner.clone()).prop_map(|(f, x)| Expr::unary(f, x)),
            4 => (prop::sample::select(&Binary::ALL[..]), inner.clone(), inner.clone())
                .prop_map(|(f, a, b)| Expr::binary(f, a, b)),
            1 => (inner.clone(), prop_oneof![-9i32..12, any::<i32>()]).prop_map(|(x, k)| x.powi(k)),
            // A part that occurs twice.
            1 => inner.prop_map(|x| x.sin() * &x),
        ]
    })
}

/// The value by the definition, without sharing: `column(name, lag)` and `time(lag)` are the leaves.
pub(crate) fn naive(expr: &Expr, column: &dyn Fn(&str, i32) -> f64, time: &dyn Fn(i32) -> f64) -> f64 {
    let of = |x: &Expr| naive(x, column, time);
    match expr.node() {
        Node::Number(value) => *value,
        Node::Column { name, lag } => column(name, *lag),
        Node::Time { lag } => time(*lag),
        Node::Power(x, k) => {
            let value = power(of(x), k.unsigned_abs());
            if *k < 0 { 1.0 / value } else { value }
        }
        Node::Unary(function, x) => {
            let x = of(x);
            match function {
                Unary::Neg => -x,
                Unary::Sin => x.sin(),
                Unary::Cos => x.cos(),
                Unary::Tan => x.tan(),
                Unary::Asin => x.asin(),
                Unary::Acos => x.acos(),
                Unary::Atan => x.atan(),
                Unary::Sinh => x.sinh(),
                Unary::Cosh => x.cosh(),
                Unary::Tanh => x.tanh(),
                Unary::Exp => x.exp(),
                Unary::Log => x.ln(),
                Unary::Sqrt => x.sqrt(),
                Unary::Abs => x.abs(),
                Unary::Sign if x == 0.0 => 0.0,
                Unary::Sign => {
                    if x.is_nan() {
                        x
                    } else {
                        x.signum()
                    }
                }
                Unary::Step if x.is_nan() => x,
                Unary::Step => f64::from(u8::from(x > 0.0)),
                Unary::Wrap => function.apply(x),
            }
        }
        Node::Binary(function, a, b) => {
            let (a, b) = (of(a), of(b));
            match function {
                Binary::Add => a + b,
                Binary::Sub => a - b,
                Binary::Mul => a * b,
                Binary::Div => a / b,
                Binary::Pow => a.powf(b),
                Binary::Atan2 => a.atan2(b),
                Binary::Min | Binary::Max if a.is_nan() || b.is_nan() => f64::NAN,
                // The standard's minimum leaves the sign of zero open.
                Binary::Min | Binary::Max => function.apply(a, b),
            }
        }
    }
}

fn power(x: f64, k: u32) -> f64 {
    match k {
        0 => 1.0,
        1 => x,
        _ if k.is_multiple_of(2) => {
            let half = power(x, k / 2);
            half * half
        }
        // Both halves of an odd exponent, each by the same rule.
        _ => pair(x, k / 2).0 * pair(x, k / 2).1,
    }
}

/// `(x^k, x^(k+1))`, so that large exponents take as many steps as they have bits.
fn pair(x: f64, k: u32) -> (f64, f64) {
    if k == 1 {
        return (x, x * x);
    }
    let (low, high) = pair(x, k / 2);
    if k.is_multiple_of(2) { (low * low, low * high) } else { (low * high, high * high) }
}

/// Equality of bits, all NaN being one.
pub(crate) fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}
