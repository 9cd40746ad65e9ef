//! Twice the working precision, for small sums and products that must add no error.
//!
//! Error-free transformations: T. J. Dekker, "A floating-point technique for extending the available precision" (1971); D. E. Knuth, TAOCP 2, 4.2.2.

/// An unevaluated sum `high + low` with `|low| <= ulp(high)/2`: about 106 bits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Double {
    high: f64,
    low: f64,
}

/// `a + b = s + e` exactly, `s` the rounded sum (Knuth).
#[inline(always)]
pub(super) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let bb = s - a;
    (s, (a - (s - bb)) + (b - bb))
}

impl Double {
    fn renormalised(high: f64, low: f64) -> Self {
        let s = high + low;
        Self { high: s, low: low - (s - high) }
    }

    pub(super) fn to_f64(self) -> f64 {
        self.high
    }

    /// `1 / value`, by one Newton step from the rounded quotient.
    pub(super) fn reciprocal(value: f64) -> Self {
        let high = 1.0 / value;
        let error = (-high).mul_add(value, 1.0);
        Self::renormalised(high, error / value)
    }
}

impl From<f64> for Double {
    fn from(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }
}

impl std::ops::Add for Double {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (s, e) = two_sum(self.high, other.high);
        let (t, f) = two_sum(self.low, other.low);
        let first = Self::renormalised(s, e + t);
        Self::renormalised(first.high, first.low + f)
    }
}

impl std::ops::Neg for Double {
    type Output = Self;

    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl std::ops::Sub for Double {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl std::ops::Mul for Double {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let p = self.high * other.high;
        let e = self.high.mul_add(other.high, -p);
        Self::renormalised(p, e + (self.high * other.low + self.low * other.high))
    }
}

impl std::ops::AddAssign for Double {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn double_doubles_keep_digits_that_doubles_lose() {
        let tiny = Double::from(1e-25);
        let sum = Double::from(1.0) + tiny - Double::from(1.0);
        assert!((sum.to_f64() - 1e-25).abs() < 1e-31);
        let third = Double::reciprocal(3.0);
        let rest = third * Double::from(3.0) - Double::from(1.0);
        assert!(rest.to_f64().abs() < 1e-31, "{rest:?}");
        let square =
            (Double::from(1.0) + Double::from(1e-20)) * (Double::from(1.0) - Double::from(1e-20)) - Double::from(1.0);
        assert!(square.to_f64().abs() < 1e-31);
    }
}
