//! Recursive low-pass filters in second-order sections, run forward and backward.

use std::f64::consts::PI;

use crate::{
    SignalError,
    error::{check, check_finite},
};

/// A section: (b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// b0, b1, b2.
    pub numerator: [f64; 3],
    /// a1, a2.
    pub denominator: [f64; 2],
}

/// A low-pass filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Sections {
    sections: Vec<Section>,
    order: usize,
}

/// A complex number: real and imaginary part.
type Complex = (f64, f64);

fn square((re, im): Complex) -> f64 {
    re * re + im * im
}

impl Section {
    /// The bilinear image of a conjugate pair of analog poles, or of a real one, with two zeros, or one, at the Nyquist frequency and a gain of one at zero.
    ///
    /// With z = (4 + p) / (4 - p) the gain is |p|^2 / |4 - p|^2, which keeps its digits where 1 + a1 + a2 would cancel.
    fn of_pole(pole: Complex, real: bool) -> Self {
        let (re, im) = pole;
        let below = square((4.0 - re, im));
        let z: Complex = ((16.0 - re * re - im * im) / below, 8.0 * im / below);
        if real {
            let gain = -re / (4.0 - re);
            return Self { numerator: [gain, gain, 0.0], denominator: [-z.0, 0.0] };
        }
        let gain = square(pole) / below;
        Self { numerator: [gain, 2.0 * gain, gain], denominator: [-2.0 * z.0, square(z)] }
    }

    /// The state at which a constant input of one stays constant, and the constant output.
    fn steady(&self) -> ([f64; 2], f64) {
        let ([b0, b1, b2], [a1, a2]) = (self.numerator, self.denominator);
        let output = (b0 + b1 + b2) / (1.0 + a1 + a2);
        let second = b2 - a2 * output;
        ([b1 - a1 * output + second, second], output)
    }

    /// Filters in place (transposed direct form II).
    fn run(&self, values: &mut [f64], mut state: [f64; 2]) {
        let ([b0, b1, b2], [a1, a2]) = (self.numerator, self.denominator);
        for value in values {
            let input = *value;
            let output = b0 * input + state[0];
            state = [b1 * input - a1 * output + state[1], b2 * input - a2 * output];
            *value = output;
        }
    }
}

impl Sections {
    /// A Butterworth low-pass: -3 dB at `cutoff`, in Hz like the `rate` of the rows.
    ///
    /// # Errors
    /// No order, or one above 20; a cut-off that is not between 0 and half the rate.
    pub fn butterworth(order: usize, cutoff: f64, rate: f64) -> Result<Self, SignalError> {
        Self::low_pass(order, cutoff, rate, 1.0, 1.0, 1.0)
    }

    /// A Chebyshev low-pass of the first kind: ripples of `ripple` dB up to `cutoff`, in Hz like the `rate` of the rows.
    ///
    /// # Errors
    /// As [`Sections::butterworth`]; ripples that are not positive.
    pub fn chebyshev(order: usize, ripple: f64, cutoff: f64, rate: f64) -> Result<Self, SignalError> {
        check(ripple > 0.0 && ripple.is_finite(), "ripple", ripple, "ripples must be positive, in dB")?;
        let epsilon = (10.0_f64.powf(0.1 * ripple) - 1.0).sqrt();
        let mu = (1.0 / epsilon).asinh() / order.max(1) as f64;
        // At zero frequency an even order is at the bottom of a ripple.
        let gain = if order.is_multiple_of(2) { 1.0 / (1.0 + epsilon * epsilon).sqrt() } else { 1.0 };
        Self::low_pass(order, cutoff, rate, mu.sinh(), mu.cosh(), gain)
    }

    /// Poles on an ellipse of these half-axes, the circle of Butterworth among them.
    fn low_pass(order: usize, cutoff: f64, rate: f64, re: f64, im: f64, gain: f64) -> Result<Self, SignalError> {
        check((1..=20).contains(&order), "order", order as f64, "an order must be 1 to 20")?;
        check(rate > 0.0 && rate.is_finite(), "rate", rate, "a rate must be positive and finite")?;
        let holds = cutoff > 0.0 && cutoff < 0.5 * rate;
        check(holds, "cutoff", cutoff, "a cut-off must lie above 0 and below half the rate of the rows")?;
        // The bilinear transform's frequencies, at two rows a second.
        let warped = 4.0 * (PI * cutoff / rate).tan();
        let pole = |k: usize| {
            let angle = PI * (2 * k + 1) as f64 / (2 * order) as f64;
            (-warped * re * angle.sin(), warped * im * angle.cos())
        };
        let real = order % 2 == 1;
        let single = real.then(|| Section::of_pole((-warped * re, 0.0), true));
        // From the real axis outwards: the sharpest resonance comes last.
        let pairs = (0..order / 2).rev().map(|k| Section::of_pole(pole(k), false));
        let mut sections: Vec<Section> = single.into_iter().chain(pairs).collect();
        sections[0].numerator = sections[0].numerator.map(|b| b * gain);
        Ok(Self { sections, order })
    }

    /// The sections.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Rows that a signal must have more than: those that are mirrored at both ends.
    pub fn padding(&self) -> usize {
        3 * (self.order + 1)
    }

    /// Filters forward and backward, so that nothing is delayed and gains are squared. At both ends the signal is continued by its mirror image through the end point, and the
    /// filter starts at rest on the first value (Gustafsson's alternative is not taken; `scipy.signal.sosfiltfilt` with its defaults).
    ///
    /// # Errors
    /// A signal of [`Sections::padding`] rows or fewer, or one that is not finite.
    pub fn zero_phase(&self, values: &[f64]) -> Result<Vec<f64>, SignalError> {
        let (n, edge) = (values.len(), self.padding());
        if n <= edge {
            return Err(SignalError::TooShort { what: "the filter", rows: n, needed: edge });
        }
        check_finite(values)?;
        let (first, last) = (values[0], values[n - 1]);
        let before = values[1..=edge].iter().rev().map(|value| 2.0 * first - value);
        let after = values[n - 1 - edge..n - 1].iter().rev().map(|value| 2.0 * last - value);
        let mut all: Vec<f64> = before.chain(values.iter().copied()).chain(after).collect();
        for _ in 0..2 {
            self.run(&mut all);
            all.reverse();
        }
        Ok(all[edge..edge + n].to_vec())
    }

    fn run(&self, values: &mut [f64]) {
        let mut level = values[0];
        for section in &self.sections {
            let (state, output) = section.steady();
            section.run(values, state.map(|z| z * level));
            level *= output;
        }
    }
}

/// Takes out what lies above the Nyquist frequency of rows that are `ratio` times as far apart: a Chebyshev filter of order 8 with 0.05 dB of ripples up to 0.8 of that frequency, run both
/// ways (as in `scipy.signal.decimate`), so that it does not come back as something else once fewer rows are kept.
///
/// # Errors
/// A ratio below 1; those of [`Sections::zero_phase`].
pub fn anti_alias(values: &[f64], ratio: f64) -> Result<Vec<f64>, SignalError> {
    check(ratio >= 1.0, "ratio", ratio, "the new period must be the old period or longer")?;
    Sections::chebyshev(8, 0.05, 0.4 / ratio, 1.0)?.zero_phase(values)
}

/// Every `factor`-th row from the first on, without what these cannot hold ([`anti_alias`]; `scipy.signal.decimate`).
///
/// # Errors
/// A factor of zero; those of [`Sections::zero_phase`].
pub fn decimate(values: &[f64], factor: usize) -> Result<Vec<f64>, SignalError> {
    check(factor > 0, "factor", 0.0, "a factor must be 1 or more")?;
    if factor == 1 {
        return Ok(values.to_vec());
    }
    Ok(anti_alias(values, factor as f64)?.into_iter().step_by(factor).collect())
}
