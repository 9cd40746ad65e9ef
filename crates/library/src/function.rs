//! The elementary functions: names and values.
//!
//! The scalar values here are the only definition: the tape's kernels, constant folding and single rows all use them, so
//! the same expression gives the same bits on every path.

use std::f64::consts::{PI, TAU};

/// A function of one argument.
///
/// Matched exhaustively by exporters on purpose: a function without a translation should not compile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Unary {
    /// `-x`.
    Neg,
    /// Sine, radians.
    Sin,
    /// Cosine, radians.
    Cos,
    /// Tangent, radians.
    Tan,
    /// Inverse sine, radians.
    Asin,
    /// Inverse cosine, radians.
    Acos,
    /// Inverse tangent, radians.
    Atan,
    /// Hyperbolic sine.
    Sinh,
    /// Hyperbolic cosine.
    Cosh,
    /// Hyperbolic tangent.
    Tanh,
    /// Exponential.
    Exp,
    /// Natural logarithm; NaN below zero.
    Log,
    /// Square root; NaN below zero.
    Sqrt,
    /// Absolute value.
    Abs,
    /// -1, 0 or 1; 0 at 0.
    Sign,
    /// 1 for x > 0, otherwise 0.
    Step,
    /// The angle in (-pi, pi] that differs from x by whole turns.
    Wrap,
}

/// A function of two arguments, operators included.
///
/// Matched exhaustively by exporters on purpose, as [`Unary`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Binary {
    /// `a + b`.
    Add,
    /// `a - b`.
    Sub,
    /// `a*b`.
    Mul,
    /// `a/b`.
    Div,
    /// `a^b` with a real exponent.
    Pow,
    /// The angle of the point (b, a): `atan2(y, x)`.
    Atan2,
    /// The smaller; NaN if either is.
    Min,
    /// The larger; NaN if either is.
    Max,
}

impl Unary {
    /// All of them.
    pub const ALL: [Unary; 17] = [
        Self::Neg,
        Self::Sin,
        Self::Cos,
        Self::Tan,
        Self::Asin,
        Self::Acos,
        Self::Atan,
        Self::Sinh,
        Self::Cosh,
        Self::Tanh,
        Self::Exp,
        Self::Log,
        Self::Sqrt,
        Self::Abs,
        Self::Sign,
        Self::Step,
        Self::Wrap,
    ];

    /// The name in the grammar; `-` for the sign.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neg => "-",
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Asin => "asin",
            Self::Acos => "acos",
            Self::Atan => "atan",
            Self::Sinh => "sinh",
            Self::Cosh => "cosh",
            Self::Tanh => "tanh",
            Self::Exp => "exp",
            Self::Log => "log",
            Self::Sqrt => "sqrt",
            Self::Abs => "abs",
            Self::Sign => "sign",
            Self::Step => "step",
            Self::Wrap => "wrap",
        }
    }

    /// The value at `x`.
    #[inline(always)]
    pub fn apply(self, x: f64) -> f64 {
        match self {
            Self::Neg => -x,
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sinh => x.sinh(),
            Self::Cosh => x.cosh(),
            Self::Tanh => x.tanh(),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => sign(x),
            Self::Step => step(x),
            Self::Wrap => wrap(x),
        }
    }
}

impl Binary {
    /// All of them.
    pub const ALL: [Binary; 8] =
        [Self::Add, Self::Sub, Self::Mul, Self::Div, Self::Pow, Self::Atan2, Self::Min, Self::Max];

    /// The operator or the name in the grammar.
    pub fn name(self) -> &'static str {
        match self {
            Self::Add => "+",
            Self::Sub => "-",
            Self::Mul => "*",
            Self::Div => "/",
            Self::Pow => "^",
            Self::Atan2 => "atan2",
            Self::Min => "min",
            Self::Max => "max",
        }
    }

    /// The value at `(a, b)`.
    #[inline(always)]
    pub fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Pow => a.powf(b),
            Self::Atan2 => a.atan2(b),
            // Unlike f64::min and f64::max, a missing value stays missing.
            Self::Min => {
                if a < b || a.is_nan() {
                    a
                } else {
                    b
                }
            }
            Self::Max => {
                if a > b || a.is_nan() {
                    a
                } else {
                    b
                }
            }
        }
    }

    /// Returns true if the arguments can be exchanged without changing a bit of the value (NaN payloads aside).
    pub(crate) fn commutes(self) -> bool {
        matches!(self, Self::Add | Self::Mul)
    }
}

/// Integer powers by multiplication only: `x^k = x^floor(k/2) * x^ceil(k/2)`, and `1 / x^-k` below zero.
///
/// The split is the same for every k, so that a set of powers of one base shares its factors: all powers up to k cost
/// one multiplication each, a single one about 2 log2(k).
pub(crate) fn integer_power(x: f64, k: i32) -> f64 {
    // (x^a, x^(a+1)) for the leading bits a of |k|: the recursion meets only these two on each of its levels.
    let (magnitude, mut low, mut high) = (k.unsigned_abs(), 1.0, x);
    for bit in (0..u32::BITS - magnitude.leading_zeros()).rev() {
        let between = low * high;
        (low, high) = if magnitude >> bit & 1 == 0 { (low * low, between) } else { (between, high * high) };
    }
    if k < 0 { 1.0 / low } else { low }
}

#[inline(always)]
fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else if x == 0.0 {
        0.0
    } else {
        x
    }
}

#[inline(always)]
fn step(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x <= 0.0 {
        0.0
    } else {
        x
    }
}

#[inline(always)]
fn wrap(x: f64) -> f64 {
    let y = x - TAU * ((x - PI) / TAU).ceil();
    // The product is rounded, so that far from zero y may fall a little outside.
    let y = if y > PI { y - TAU } else { y };
    if y <= -PI { y + TAU } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integer_powers_follow_the_recursion() {
        fn recursion(x: f64, k: u32) -> f64 {
            if k == 1 { x } else { recursion(x, k / 2) * recursion(x, k - k / 2) }
        }
        for x in [1.1, -0.7, 3.0, 1e-3] {
            for k in 1..70 {
                assert_eq!(integer_power(x, k as i32), recursion(x, k), "{x}^{k}");
                assert_eq!(integer_power(x, -(k as i32)), 1.0 / recursion(x, k), "{x}^-{k}");
            }
        }
        assert_eq!(integer_power(2.0, 0), 1.0);
        assert_eq!(integer_power(2.0, i32::MIN), 0.0);
        assert_eq!(integer_power(-1.0, i32::MAX), -1.0);
    }

    #[test]
    fn wrap_keeps_interval_and_angle() {
        assert_eq!(wrap(PI), PI);
        assert_eq!(wrap(-PI), PI);
        assert_eq!(wrap(0.25), 0.25);
        assert!(wrap(PI.next_up()) < -3.1 && wrap(PI.next_up()) > -PI);
        for k in -20_000..20_000 {
            let x = k as f64 * 0.37 + 1e-4;
            let y = wrap(x);
            assert!(y > -PI && y <= PI, "{x} -> {y}");
            assert!((x.sin() - y.sin()).abs() < 1e-11 && (x.cos() - y.cos()).abs() < 1e-11, "{x} -> {y}");
            let turns = wrap(k as f64 * PI);
            assert!(turns > -PI && turns <= PI, "{k} half turns -> {turns}");
        }
        assert!(wrap(f64::INFINITY).is_nan() && wrap(f64::NAN).is_nan());
    }

    #[test]
    fn missing_values_stay_missing() {
        for binary in Binary::ALL {
            assert!(binary.apply(f64::NAN, 2.0).is_nan() && binary.apply(2.0, f64::NAN).is_nan(), "{binary:?}");
        }
        for unary in Unary::ALL {
            assert!(unary.apply(f64::NAN).is_nan(), "{unary:?}");
        }
        assert_eq!((sign(-0.0), sign(-3.0), step(0.0), step(2.0)), (0.0, -1.0, 0.0, 1.0));
    }
}
