//! Numbers of the filter: a number, several side by side, or a number and its slope.

use std::ops::{Add, Mul, Sub};

use pulp::{Simd, bytemuck};

/// A number of the filter.
pub(crate) trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Data of a step: one number for all that stand side by side, or one each.
    type Shared: Number<Shared = f64>;

    /// Data of a step as such a number.
    fn of(self, shared: Self::Shared) -> Self;

    /// Times what is known of a step.
    fn by(self, shared: Self::Shared) -> Self;

    /// A constant, in place of this one.
    fn like(self, constant: f64) -> Self;

    /// Times a constant.
    fn times(self, factor: f64) -> Self;

    /// Plus a constant.
    fn plus(self, term: f64) -> Self;

    /// One over it.
    fn inverse(self) -> Self;

    /// Times a number, plus another: rounded once where many stand side by side, on every machine.
    #[inline(always)]
    fn fused(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }

    /// The same with what is known of a step.
    #[inline(always)]
    fn fused_by(self, shared: Self::Shared, term: Self) -> Self {
        self.by(shared) + term
    }
}

impl Number for f64 {
    type Shared = Self;

    #[inline(always)]
    fn of(self, shared: Self) -> Self {
        shared
    }

    #[inline(always)]
    fn by(self, shared: Self) -> Self {
        self * shared
    }

    #[inline(always)]
    fn like(self, constant: f64) -> Self {
        constant
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * factor
    }

    #[inline(always)]
    fn plus(self, term: f64) -> Self {
        self + term
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        1.0 / self
    }
}

/// As many numbers as a register holds. What is fused is rounded once on every machine, so that on all of them the bits are the same.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// The first of these; the last one again where there are too few.
    #[inline(always)]
    pub(crate) fn load(simd: S, values: &[f64]) -> Self {
        Self::gather(simd, values, |value| *value)
    }

    /// A number of each of these.
    #[inline(always)]
    pub(crate) fn gather<T>(simd: S, all: &[T], of: impl Fn(&T) -> f64) -> Self {
        let mut lanes = simd.splat_f64s(all.last().map_or(1.0, &of));
        let places: &mut [f64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut lanes));
        places.iter_mut().zip(all).for_each(|(place, one)| *place = of(one));
        Self { simd, values: lanes }
    }

    /// The part of this many numbers that begins there.
    #[inline(always)]
    pub(crate) fn read(simd: S, values: &[f64], from: usize) -> Self {
        Self { simd, values: S::as_simd_f64s(values).0[from / S::F64_LANES] }
    }

    /// Puts the numbers there.
    #[inline(always)]
    pub(crate) fn write(self, places: &mut [f64], from: usize) {
        S::as_mut_simd_f64s(places).0[from / S::F64_LANES] = self.values;
    }

    /// Divides normal positive numbers by their powers of two, and adds these to the exponents.
    #[inline(always)]
    pub(crate) fn take_exponents(&mut self, exponents: &mut [i64]) {
        const MANTISSA: u64 = (1 << 52) - 1;
        let places: &mut [u64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut self.values));
        for (place, exponent) in places.iter_mut().zip(exponents) {
            *exponent += (*place >> 52) as i64 - 1023;
            *place = (*place & MANTISSA) | 1.0_f64.to_bits();
        }
    }

    /// The numbers.
    #[inline(always)]
    pub(crate) fn values(&self) -> &[f64] {
        bytemuck::cast_slice(std::slice::from_ref(&self.values))
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { values: self.simd.add_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { values: self.simd.sub_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { values: self.simd.mul_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Number for Lanes<S> {
    type Shared = f64;

    #[inline(always)]
    fn fused(self, factor: Self, term: Self) -> Self {
        Self { values: self.simd.mul_add_f64s(self.values, factor.values, term.values), ..self }
    }

    #[inline(always)]
    fn fused_by(self, shared: f64, term: Self) -> Self {
        self.fused(self.like(shared), term)
    }

    #[inline(always)]
    fn of(self, shared: f64) -> Self {
        self.like(shared)
    }

    #[inline(always)]
    fn by(self, shared: f64) -> Self {
        self.times(shared)
    }

    #[inline(always)]
    fn like(self, constant: f64) -> Self {
        Self { values: self.simd.splat_f64s(constant), ..self }
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        Self { values: self.simd.mul_f64s(self.values, self.simd.splat_f64s(factor)), ..self }
    }

    #[inline(always)]
    fn plus(self, term: f64) -> Self {
        Self { values: self.simd.add_f64s(self.values, self.simd.splat_f64s(term)), ..self }
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        Self { values: self.simd.div_f64s(self.simd.splat_f64s(1.0), self.values), ..self }
    }
}

/// Numbers of rows side by side, each with a step of its own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Abreast<S: Simd>(pub(crate) Lanes<S>);

impl<S: Simd> Add for Abreast<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl<S: Simd> Sub for Abreast<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl<S: Simd> Mul for Abreast<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl<S: Simd> Number for Abreast<S> {
    type Shared = Lanes<S>;

    #[inline(always)]
    fn of(self, shared: Lanes<S>) -> Self {
        Self(shared)
    }

    #[inline(always)]
    fn by(self, shared: Lanes<S>) -> Self {
        Self(self.0 * shared)
    }

    #[inline(always)]
    fn like(self, constant: f64) -> Self {
        Self(self.0.like(constant))
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        Self(self.0.times(factor))
    }

    #[inline(always)]
    fn plus(self, term: f64) -> Self {
        Self(self.0.plus(term))
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        Self(self.0.inverse())
    }
}

/// A number and its slope with respect to something.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sloped<T> {
    pub(crate) value: T,
    pub(crate) slope: T,
}

impl<T: Number> Add for Sloped<T> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl<T: Number> Sub for Sloped<T> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl<T: Number> Mul for Sloped<T> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.value.fused(other.slope, self.slope * other.value) }
    }
}

impl<T: Number> Number for Sloped<T> {
    type Shared = T::Shared;

    #[inline(always)]
    fn fused(self, factor: Self, term: Self) -> Self {
        let slope = self.slope.fused(factor.value, term.slope);
        Self { value: self.value.fused(factor.value, term.value), slope: self.value.fused(factor.slope, slope) }
    }

    #[inline(always)]
    fn fused_by(self, shared: T::Shared, term: Self) -> Self {
        Self { value: self.value.fused_by(shared, term.value), slope: self.slope.fused_by(shared, term.slope) }
    }

    #[inline(always)]
    fn of(self, shared: T::Shared) -> Self {
        Self { value: self.value.of(shared), slope: self.slope.like(0.0) }
    }

    #[inline(always)]
    fn by(self, shared: T::Shared) -> Self {
        Self { value: self.value.by(shared), slope: self.slope.by(shared) }
    }

    #[inline(always)]
    fn like(self, constant: f64) -> Self {
        Self { value: self.value.like(constant), slope: self.slope.like(0.0) }
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        Self { value: self.value.times(factor), slope: self.slope.times(factor) }
    }

    #[inline(always)]
    fn plus(self, term: f64) -> Self {
        Self { value: self.value.plus(term), ..self }
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        let value = self.value.inverse();
        Self { value, slope: (value * value * self.slope).times(-1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_follow_the_rules_of_calculus() {
        let of = |x: Sloped<f64>| (x * x).times(3.0).plus(1.0) * (x.plus(2.0)).inverse() - x;
        let at = |x: f64| (3.0 * x * x + 1.0) / (x + 2.0) - x;
        let result = of(Sloped { value: 0.7, slope: 1.0 });
        assert!((result.value - at(0.7)).abs() < 1e-15);
        let slope = (6.0 * 0.7 * 2.7 - (3.0 * 0.49 + 1.0)) / (2.7 * 2.7) - 1.0;
        assert!((result.slope - slope).abs() < 1e-15);
    }
}
