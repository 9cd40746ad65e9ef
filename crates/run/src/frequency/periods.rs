//! Frequency response under a periodic excitation, and distortion at the frequencies that it leaves out (R. Pintelon,
//! J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., sections 2.5 and 4.3).

use std::f64::consts::TAU;

use super::{Distortion, Line, Response, spectra::EXCITED};

/// Frequencies that are looked at, at most.
const MOST: usize = 4_096;

type Complex = [f64; 2];

/// Whole periods of input and output.
pub(super) struct Periods {
    length: usize,
    lines: usize,
    turns: Vec<Complex>,
    /// Per episode its periods: for each the lines of the input, and those of the output.
    episodes: Vec<Vec<[Vec<Complex>; 2]>>,
    lost: usize,
}

fn times([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

fn minus(a: Complex, b: Complex) -> Complex {
    [a[0] - b[0], a[1] - b[1]]
}

fn square([a, b]: Complex) -> f64 {
    a * a + b * b
}

fn mean<'a>(all: impl Iterator<Item = &'a Complex>) -> Complex {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for value in all {
        sum = [sum[0] + value[0], sum[1] + value[1]];
        count += 1.0;
    }
    sum.map(|part| part / count)
}

impl Periods {
    /// `length` samples a period.
    pub(super) fn new(length: usize) -> Self {
        let turns = (0..length).map(|n| -TAU * n as f64 / length as f64).map(|a| [a.cos(), a.sin()]).collect();
        Self { length, lines: (length / 2).min(MOST), turns, episodes: Vec::new(), lost: 0 }
    }

    /// Adds the whole periods of an episode; those with a missing value are left out.
    pub(super) fn add(&mut self, input: &[f64], output: &[f64]) {
        let mut periods = Vec::new();
        for (u, y) in input.chunks_exact(self.length).zip(output.chunks_exact(self.length)) {
            if u.iter().chain(y).any(|value| !value.is_finite()) {
                self.lost += 1;
                continue;
            }
            periods.push([self.transformed(u), self.transformed(y)]);
        }
        if !periods.is_empty() {
            self.episodes.push(periods);
        }
    }

    /// Amplitudes and phases of the lines from the first on.
    fn transformed(&self, values: &[f64]) -> Vec<Complex> {
        let line = |k: usize| {
            let (mut sum, mut turn) = ([0.0; 2], 0);
            for value in values {
                let [cosine, sine] = self.turns[turn];
                sum = [value.mul_add(cosine, sum[0]), value.mul_add(sine, sum[1])];
                turn = (turn + k) % self.length;
            }
            sum.map(|part| 2.0 * part / self.length as f64)
        };
        (1..=self.lines).map(line).collect()
    }

    /// The response; `None` without a period.
    pub(super) fn finish(&self, period: f64) -> Option<Response> {
        let parts: usize = self.episodes.iter().map(Vec::len).sum();
        if parts == 0 {
            return None;
        }
        let power = |which: usize, k: usize| {
            let all = self.episodes.iter().flatten().map(|one| square(one[which][k]));
            all.sum::<f64>() / parts as f64
        };
        let inputs: Vec<f64> = (0..self.lines).map(|k| power(0, k)).collect();
        let largest = inputs.iter().copied().fold(0.0, f64::max);
        let line = |k: usize| {
            let (mut cross, mut squares) = ([0.0; 2], 0.0);
            for episode in &self.episodes {
                let weight = episode.len() as f64;
                let [u, y] = [0, 1].map(|which| mean(episode.iter().map(|one| &one[which][k])));
                let product = times([u[0], -u[1]], y);
                cross = [weight.mul_add(product[0], cross[0]), weight.mul_add(product[1], cross[1])];
                squares += weight * square(u);
            }
            let value = cross.map(|part| part / squares);
            let output = power(1, k);
            let all = self.episodes.iter().flatten();
            let left: f64 = all.map(|one| square(minus(one[1][k], times(value, one[0][k])))).sum();
            Line {
                frequency: (k + 1) as f64 / (self.length as f64 * period),
                value,
                radius: self.radius(k, value, squares),
                coherence: (1.0 - left / (parts as f64 * output)).clamp(0.0, 1.0),
                input: inputs[k],
                output,
                excited: inputs[k] > EXCITED * largest,
            }
        };
        let lines: Vec<Line> = (0..self.lines).map(line).collect();
        let distortion = self.distortion(&lines);
        Some(Response { lines, averages: parts as f64, parts, lost: self.lost, distortion })
    }

    /// Radius of the circle that holds the response in 95 % of repetitions, by Fisher's distribution: from the
    /// differences between episodes, else between periods.
    fn radius(&self, k: usize, value: Complex, squares: f64) -> f64 {
        let left = |episode: &[[Vec<Complex>; 2]]| {
            let [u, y] = [0, 1].map(|which| mean(episode.iter().map(|one| &one[which][k])));
            minus(y, times(value, u))
        };
        let (sum, freedom) = match self.episodes.as_slice() {
            [one] => {
                let about = left(one);
                let residuals = one.iter().map(|period| minus(period[1][k], times(value, period[0][k])));
                (residuals.map(|residual| square(minus(residual, about))).sum::<f64>(), 2.0 * (one.len() as f64 - 1.0))
            }
            several => {
                let residuals = several.iter().map(|episode| episode.len() as f64 * square(left(episode)));
                (residuals.sum(), 2.0 * (several.len() as f64 - 1.0))
            }
        };
        if freedom <= 0.0 {
            return f64::NAN;
        }
        // Variance of a period's residual; `squares` is the sum of the squared inputs over the periods.
        let variance = 2.0 * sum / freedom / squares;
        (variance * freedom / 2.0 * (0.05f64.powf(-2.0 / freedom) - 1.0)).sqrt()
    }

    /// Output at the frequencies that are not excited, up to the highest that is.
    fn distortion(&self, lines: &[Line]) -> Option<Distortion> {
        let last = lines.iter().rposition(|line| line.excited)?;
        let root = |of: &dyn Fn(usize) -> f64, chosen: &dyn Fn(usize) -> bool| {
            let values: Vec<f64> = (0..=last).filter(|&k| chosen(k)).map(of).collect();
            (!values.is_empty()).then(|| (values.iter().sum::<f64>() / values.len() as f64).sqrt())
        };
        // Mean over the periods, and the rest.
        let steady = |k: usize| {
            let all = self.episodes.iter().map(|episode| square(mean(episode.iter().map(|one| &one[1][k]))));
            all.sum::<f64>() / self.episodes.len() as f64
        };
        let noise = |k: usize| {
            let variance = |episode: &Vec<[Vec<Complex>; 2]>| {
                let centre = mean(episode.iter().map(|one| &one[1][k]));
                let count = episode.len() as f64;
                let sum: f64 = episode.iter().map(|one| square(minus(one[1][k], centre))).sum();
                sum / (count - 1.0) / count
            };
            self.episodes.iter().map(variance).sum::<f64>() / self.episodes.len() as f64
        };
        let repeated = self.episodes.iter().all(|episode| episode.len() > 1);
        let harmonic = |k: usize| k + 1;
        Some(Distortion {
            excited: root(&steady, &|k| lines[k].excited)?,
            odd: root(&steady, &|k| !lines[k].excited && harmonic(k) % 2 == 1),
            even: root(&steady, &|k| !lines[k].excited && harmonic(k) % 2 == 0),
            noise: if repeated { root(&noise, &|_| true) } else { None },
        })
    }
}
