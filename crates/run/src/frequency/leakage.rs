//! Leakage of segments that are short for a resonance. It biases the response of averaged spectra, and the intervals do
//! not hold it (J. S. Bendat, A. G. Piersol, Random Data, 4th ed., section 9.1).
//!
//! Noise has the same share of the output's power whatever the length of the segments. The share of leakage falls with
//! the length: what falls between one length and twice that length is leakage. In simulations of resonances with a
//! damping from 0.01 to 0.7, intervals beside a resonance held the response at fewer than two thirds of the frequencies
//! where the share fell by more than [`MOST`], and at nine tenths or more where it fell by less than half of that.

use fleetfoot_data::setting::SEGMENT;

use super::Response;

/// Share of the output's power that may be leakage.
const MOST: f64 = 0.05;
/// Averages of twice as long segments, at least: the shares of fewer scatter more than [`MOST`].
const AVERAGES: f64 = 6.0;

/// Note on too short segments of `length` samples, from the response by segments twice as long.
pub(super) fn note(short: &Response, longer: &Response, length: usize, longest: usize, step: f64) -> Option<String> {
    let fall = incoherent(short) - incoherent(longer);
    if longer.averages < AVERAGES || fall.is_nan() || fall <= MOST {
        return None;
    }
    let times = if 4 * length <= longest { 4 } else { 2 };
    let seconds = |samples: usize| (samples as f64 * step * 1e6).round() / 1e6;
    Some(format!(
        "segments of {} s are short for a resonance: in segments twice as long, {:.0} % more of the output's power is linear in the input. The intervals hold noise, not this leakage; give longer segments ({})",
        seconds(length),
        100.0 * fall,
        SEGMENT.to(seconds(times * length))
    ))
}

/// Share of the output's power that is not linear in the input, over the excited frequencies, without its bias: of `n`
/// averages the response explains `1/n` of noise.
fn incoherent(response: &Response) -> f64 {
    let excited = response.lines.iter().filter(|line| line.excited);
    let (rest, all) =
        excited.fold((0.0, 0.0), |(rest, all), line| (rest + (1.0 - line.coherence) * line.output, all + line.output));
    rest / all * response.averages / (response.averages - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frequency::spectra::Spectra;

    const STEP: f64 = 0.02;

    /// A number in [0, 1) of a counter (splitmix64).
    fn uniform(at: u64) -> f64 {
        let mut z = at.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A resonance of 1 Hz under white noise, `y'' = w^2 (u - y) - 2 d w y'` by the semi-implicit rule of Euler, with
    /// uniform noise of `noise` times the output's deviation.
    fn noted(damping: f64, noise: f64, rows: usize, seed: u64) -> Option<String> {
        let w = std::f64::consts::TAU;
        let u: Vec<f64> = (0..rows as u64).map(|k| uniform(seed << 32 | k) - 0.5).collect();
        let (mut position, mut speed) = (0.0, 0.0);
        let mut y: Vec<f64> = Vec::new();
        for force in &u {
            y.push(position);
            speed += STEP * (w * w * (force - position) - 2.0 * damping * w * speed);
            position += STEP * speed;
        }
        let deviation = (y.iter().map(|value| value * value).sum::<f64>() / rows as f64).sqrt();
        for (k, value) in y.iter_mut().enumerate() {
            *value += noise * deviation * 12f64.sqrt() * (uniform(seed << 32 | 1 << 31 | k as u64) - 0.5);
        }
        let length = 1 << (2 * rows / 16).ilog2();
        let [short, longer] = [length, 2 * length].map(|samples| {
            let mut sums = Spectra::new(samples);
            sums.add(&u, &y);
            sums.finish(STEP).expect("segments")
        });
        note(&short, &longer, length, rows, STEP)
    }

    #[test]
    fn short_segments_of_resonances_are_noted() {
        for seed in 0..3 {
            for noise in [0.0, 0.05, 0.5] {
                let note = noted(0.03, noise, 2000, seed).unwrap_or_else(|| panic!("{seed} {noise}"));
                assert!(note.contains("segments of 2.56 s") && note.contains("--segment 10.24"), "{note}");
                assert_eq!(noted(0.7, noise, 20_000, seed), None, "{noise}");
            }
            // Noise alone, with twice the deviation of the output.
            assert_eq!(noted(0.7, 2.0, 20_000, seed), None);
        }
    }
}
