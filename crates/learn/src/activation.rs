//! Activations over whole tiles, and their derivatives from the values alone.

use pulp::{Simd, WithSimd};

/// Function of a unit's sum that gives its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Activation {
    /// `tanh(z)`.
    Tanh,
    /// `max(z, 0)`.
    Relu,
    /// `ln(1 + exp(z))`.
    Softplus,
}

impl Activation {
    /// Replaces sums by values.
    pub fn apply(self, values: &mut [f64]) {
        match self {
            Self::Tanh => fleetfoot_data::arch().dispatch(Tanh(values)),
            Self::Relu => values.iter_mut().for_each(|z| *z = z.max(0.0)),
            Self::Softplus => values.iter_mut().for_each(|z| *z = z.max(0.0) + (-z.abs()).exp().ln_1p()),
        }
    }

    /// Multiplies slopes by the derivative, given the values.
    pub fn chain(self, values: &[f64], slopes: &mut [f64]) {
        let both = slopes.iter_mut().zip(values);
        match self {
            Self::Tanh => both.for_each(|(slope, h)| *slope *= 1.0 - h * h),
            Self::Relu => both.for_each(|(slope, &h)| *slope *= if h > 0.0 { 1.0 } else { 0.0 }),
            Self::Softplus => both.for_each(|(slope, h)| *slope *= -(-h).exp_m1()),
        }
    }
}

struct Tanh<'a>(&'a mut [f64]);

impl WithSimd for Tanh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // Without vectors there may be no fused instruction, and a call in its place takes fifty times as long.
        if size_of::<S::f64s>() > size_of::<f64>() {
            self.0.iter_mut().for_each(|value| *value = tanh::<true>(*value));
        } else {
            self.0.iter_mut().for_each(|value| *value = tanh::<false>(*value));
        }
    }
}

/// `2^(1/ln 2)` and ln 2 in two parts, of which the first has few digits.
const LOG2_E: f64 = std::f64::consts::LOG2_E;
const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// 1.5 * 2^52: the last digits of a sum with it are a whole number.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// `tanh` without branches, to 3e-16 (absolute): `(1 - t)/(1 + t)` with `t = exp(-2|z|)`, by its Taylor polynomial within `ln(2)/2` of a power of two.
#[inline(always)]
fn tanh<const FUSED: bool>(z: f64) -> f64 {
    let multiply_add = |a: f64, b: f64, c: f64| if FUSED { a.mul_add(b, c) } else { a * b + c };
    let y = -2.0 * z.abs().min(20.0);
    let shifted = multiply_add(y, LOG2_E, ROUND);
    let k = shifted - ROUND;
    let r = multiply_add(k, -LN_2_LOW, multiply_add(k, -LN_2_HIGH, y));
    let mut sum = 1.0 / 6_227_020_800.0;
    for inverse in [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        sum = multiply_add(r, sum, inverse);
    }
    let t = sum * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    // NaN stays NaN: `min` drops it, the sign does not bring it back.
    let value = ((1.0 - t) / (1.0 + t)).copysign(z);
    if z.is_nan() { z } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_and_derivatives_match_formulas() {
        let places: Vec<f64> = (-4000..=4000).map(|i| f64::from(i) * 0.011).chain([1e-9, -1e-300, 0.0]).collect();
        type Formula = fn(f64) -> f64;
        let formulas: [(Activation, Formula); 3] = [
            (Activation::Tanh, f64::tanh),
            (Activation::Relu, |z| z.max(0.0)),
            (Activation::Softplus, |z| if z > 40.0 { z } else { z.exp().ln_1p() }),
        ];
        for (activation, formula) in formulas {
            let mut values = places.clone();
            activation.apply(&mut values);
            let mut slopes = vec![2.0; places.len()];
            activation.chain(&values, &mut slopes);
            for ((z, value), slope) in places.iter().zip(&values).zip(&slopes) {
                assert!(
                    (value - formula(*z)).abs() <= 4e-16 * formula(*z).abs().max(1.0),
                    "{activation:?} {z} {value}"
                );
                if z.abs() > 1e-4 {
                    let difference = (formula(z + 1e-5) - formula(z - 1e-5)) / 2e-5;
                    assert!((slope / 2.0 - difference).abs() < 1e-8, "{activation:?} {z} {slope}");
                }
            }
        }
    }

    #[test]
    fn extreme_sums_do_not_overflow() {
        for activation in [Activation::Tanh, Activation::Softplus] {
            let mut values = [1e300, -1e300, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
            activation.apply(&mut values);
            assert!(values[1].abs() <= 1.0 && values[0] > 0.0 && values[4].is_nan(), "{activation:?} {values:?}");
        }
    }
}
