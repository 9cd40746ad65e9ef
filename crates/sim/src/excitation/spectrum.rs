//! Spectra of sampled signals, for tests.

use std::f64::consts::TAU;

/// The power of the sine of a frequency in all of the samples: the variance that it contributes.
pub(super) fn power(samples: &[f64], dt: f64, frequency: f64) -> f64 {
    let [mut real, mut imaginary] = [0.0; 2];
    for (k, x) in samples.iter().enumerate() {
        let (sine, cosine) = (TAU * frequency * k as f64 * dt).sin_cos();
        real += x * cosine;
        imaginary += x * sine;
    }
    2.0 * (real * real + imaginary * imaginary) / (samples.len() as f64).powi(2)
}

/// One-sided power density at a frequency: the mean over segments with a Hann window and without their means (Welch).
pub(super) fn density(samples: &[f64], dt: f64, frequency: f64, segment: usize) -> f64 {
    let window: Vec<f64> = (0..segment).map(|k| 0.5 - 0.5 * (TAU * k as f64 / segment as f64).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let waves: Vec<[f64; 2]> = (0..segment).map(|k| (TAU * frequency * k as f64 * dt).sin_cos().into()).collect();
    let segments = samples.chunks_exact(segment);
    let count = segments.len() as f64;
    let density = segments.map(|part| {
        let mean = part.iter().sum::<f64>() / segment as f64;
        let sums = (0..segment).fold([0.0; 2], |[a, b], k| {
            let x = window[k] * (part[k] - mean);
            [a + x * waves[k][0], b + x * waves[k][1]]
        });
        2.0 * dt * (sums[0] * sums[0] + sums[1] * sums[1]) / energy
    });
    density.sum::<f64>() / count
}

/// The slope of log(y) on log(x) by least squares.
pub(super) fn slope(x: &[f64], y: &[f64]) -> f64 {
    let count = x.len() as f64;
    let mean = |values: &[f64]| values.iter().map(|value| value.ln()).sum::<f64>() / count;
    let (mean_x, mean_y) = (mean(x), mean(y));
    let products: f64 = x.iter().zip(y).map(|(x, y)| (x.ln() - mean_x) * (y.ln() - mean_y)).sum();
    products / x.iter().map(|x| (x.ln() - mean_x).powi(2)).sum::<f64>()
}
