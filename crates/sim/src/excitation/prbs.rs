//! Pseudo-random binary sequences.

use rand::Rng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::check::{samples, that, time};
use crate::ParameterError;
use crate::parameter_error::{finite, not_negative};

/// A binary sequence of maximum length from a linear feedback shift register. It repeats after `2^order - 1` clock
/// periods, and its circular autocorrelation is that of white noise but for one count in the length. Each run starts
/// elsewhere in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prbs {
    /// Middle of the two levels, in the channel's unit.
    pub offset: f64,
    /// Half their distance, in the channel's unit.
    pub amplitude: f64,
    /// Shortest hold time of a level, s; whole samples.
    pub clock: f64,
    /// Bits of the register, 2 to 24. The longest time at one level is as many clock periods.
    pub order: u32,
}

impl Default for Prbs {
    fn default() -> Self {
        Self { offset: 0.0, amplitude: 1.0, clock: 0.25, order: 11 }
    }
}

/// Exponents of a primitive polynomial over GF(2) for each order from 2 on, the constant term left out.
const POLYNOMIALS: [&[u32]; 23] = [
    &[2, 1],
    &[3, 2],
    &[4, 3],
    &[5, 3],
    &[6, 5],
    &[7, 6],
    &[8, 6, 5, 4],
    &[9, 5],
    &[10, 7],
    &[11, 9],
    &[12, 6, 4, 1],
    &[13, 4, 3, 1],
    &[14, 5, 3, 1],
    &[15, 14],
    &[16, 15, 13, 4],
    &[17, 14],
    &[18, 11],
    &[19, 6, 2, 1],
    &[20, 17],
    &[21, 19],
    &[22, 21],
    &[23, 18],
    &[24, 23, 22, 17],
];

impl Prbs {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("amplitude", self.amplitude)?;
        time("clock", self.clock, dt)?;
        that((2..=24).contains(&self.order), "order", self.order, "2 to 24")
    }
}

/// A register in Fibonacci's form: the fed-back bit is the parity of its taps.
#[derive(Debug, Clone)]
struct Register {
    bits: u32,
    taps: u32,
    mask: u32,
}

impl Register {
    fn new(order: u32, start: u32) -> Self {
        let order = order.clamp(2, 24);
        let taps = POLYNOMIALS[order as usize - 2].iter().fold(0, |taps, exponent| taps | 1 << (exponent - 1));
        let mask = (1 << order) - 1;
        // A register of zeros would stay there.
        Self { bits: start % mask + 1, taps, mask }
    }

    fn shift(&mut self) {
        let parity = (self.bits & self.taps).count_ones() & 1;
        self.bits = (self.bits << 1 | parity) & self.mask;
    }
}

#[derive(Debug, Clone)]
pub(super) struct PrbsSignal {
    register: Register,
    low_high: [f64; 2],
    clock: u64,
    held: u64,
    levels: u64,
}

impl PrbsSignal {
    pub(super) fn new(parameters: &Prbs, dt: f64, random: &mut Pcg64) -> Self {
        let Prbs { offset, amplitude, clock, order } = *parameters;
        let register = Register::new(order, random.next_u32());
        Self {
            register,
            low_high: [offset - amplitude, offset + amplitude],
            clock: samples(clock, dt),
            held: 0,
            levels: 1,
        }
    }

    pub(super) fn levels(&self) -> u64 {
        self.levels
    }

    pub(super) fn next(&mut self) -> f64 {
        if self.held == self.clock {
            self.register.shift();
            self.held = 0;
            self.levels += 1;
        }
        self.held += 1;
        self.low_high[(self.register.bits & 1) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn every_order_has_its_maximum_length() {
        for order in 2..=24 {
            let mut register = Register::new(order, 0);
            let start = register.bits;
            let mut period = 0u32;
            loop {
                register.shift();
                period += 1;
                if register.bits == start {
                    break;
                }
            }
            assert_eq!(period, (1 << order) - 1, "{order}");
        }
    }

    #[test]
    fn its_autocorrelation_has_two_values() {
        let parameters = Prbs { offset: 0.0, amplitude: 1.0, clock: 0.03, order: 9 };
        let mut signal = PrbsSignal::new(&parameters, 0.01, &mut Pcg64::seed_from_u64(3));
        let samples: Vec<f64> = (0..2 * 3 * 511).map(|_| signal.next()).collect();
        let (first, second) = samples.split_at(3 * 511);
        assert_eq!(first, second);
        assert!(first.chunks(3).all(|held| held.iter().all(|x| *x == held[0])));
        let chips: Vec<f64> = first.iter().step_by(3).copied().collect();
        for lag in 0..511 {
            let sum: f64 = (0..511).map(|k| chips[k] * chips[(k + lag) % 511]).sum();
            assert_eq!(sum, if lag == 0 { 511.0 } else { -1.0 }, "{lag}");
        }
    }

    #[test]
    fn runs_start_elsewhere_in_the_sequence() {
        let parameters = Prbs { offset: 1.0, amplitude: 2.0, ..Prbs::default() };
        let run = |seed| {
            let mut signal = PrbsSignal::new(&parameters, 0.01, &mut Pcg64::seed_from_u64(seed));
            (0..1000).map(|_| signal.next()).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
        assert!(run(1).iter().all(|x| *x == -1.0 || *x == 3.0));
    }
}
