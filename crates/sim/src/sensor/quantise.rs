//! Analogue-to-digital conversion.

/// A converter over `-range..range`: clips and rounds to its grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Converter {
    step: f64,
    /// Codes are two's complement: one more below zero than above.
    lowest: f64,
    highest: f64,
}

impl Converter {
    /// With codes of `bits` bits; 0 bits clip and do not round.
    pub(super) fn new(range: f64, bits: u32) -> Self {
        if bits == 0 {
            return Self { step: 0.0, lowest: -range, highest: range };
        }
        let half = 2f64.powi(bits as i32 - 1);
        Self { step: range / half, lowest: -half, highest: half - 1.0 }
    }

    pub(super) fn convert(&self, value: f64) -> f64 {
        if self.step == 0.0 {
            return value.clamp(self.lowest, self.highest);
        }
        (value / self.step).round().clamp(self.lowest, self.highest) * self.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_on_the_grid_within_half_a_step() {
        let converter = Converter::new(2.0, 3);
        assert_eq!([0.24, 0.25, 0.7, -0.76].map(|value| converter.convert(value)), [0.0, 0.5, 0.5, -1.0]);
        assert_eq!([9.0, 1.9, -9.0].map(|value| converter.convert(value)), [1.5, 1.5, -2.0]);
        let wide = Converter::new(34.9, 16);
        for sample in -1000..1000 {
            let value = f64::from(sample) * 0.0317;
            assert!((wide.convert(value) - value).abs() <= 34.9 / 65_536.0 * (1.0 + 1e-12));
        }
    }

    #[test]
    fn no_bits_clip_only() {
        let converter = Converter::new(2.0, 0);
        assert_eq!([0.123, 2.5, -2.5].map(|value| converter.convert(value)), [0.123, 2.0, -2.0]);
    }
}
