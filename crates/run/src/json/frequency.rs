//! Frequency responses, for programs.

use fleetfoot_dataset::json::report;
use serde::Serialize;
use serde_json::Value;

use crate::{Frequencies, frequency::Response};

impl Frequencies {
    /// All lines of the log and of the model, with their intervals.
    pub fn to_json(&self) -> Value {
        report(Content {
            input: &self.options.input,
            output: &self.options.output,
            units: &self.units,
            method: if self.options.period.is_some() { "periods" } else { "averaged spectra" },
            samples: self.length,
            seconds: self.length as f64 * self.step,
            step: self.step,
            measured: Lines::new(&self.measured),
            model: self.model.as_ref().map(Lines::new),
            inside: self.inside(),
            episodes: self.episodes,
            in_sample_episodes: &self.in_sample,
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    input: &'a str,
    output: &'a str,
    units: &'a [Option<String>; 2],
    method: &'static str,
    samples: usize,
    seconds: f64,
    step: f64,
    measured: Lines,
    model: Option<Lines>,
    inside: Option<f64>,
    episodes: usize,
    in_sample_episodes: &'a [String],
    notes: &'a [String],
}

/// A response, one entry a frequency.
#[derive(Serialize)]
struct Lines {
    frequency: Vec<f64>,
    gain: Vec<f64>,
    phase: Vec<f64>,
    real: Vec<f64>,
    imaginary: Vec<f64>,
    radius: Vec<f64>,
    coherence: Vec<f64>,
    input_power: Vec<f64>,
    output_power: Vec<f64>,
    excited: Vec<bool>,
    averages: f64,
    parts: usize,
    lost: usize,
    distortion: Option<Levels>,
}

/// Amplitudes of the output.
#[derive(Serialize)]
struct Levels {
    excited: f64,
    odd: Option<f64>,
    even: Option<f64>,
    noise: Option<f64>,
}

impl Lines {
    fn new(response: &Response) -> Self {
        let all = |of: fn(&crate::frequency::Line) -> f64| response.lines.iter().map(of).collect();
        Self {
            frequency: all(|line| line.frequency),
            gain: all(|line| line.gain()),
            phase: all(|line| line.phase()),
            real: all(|line| line.value[0]),
            imaginary: all(|line| line.value[1]),
            radius: all(|line| line.radius),
            coherence: all(|line| line.coherence),
            input_power: all(|line| line.input),
            output_power: all(|line| line.output),
            excited: response.lines.iter().map(|line| line.excited).collect(),
            averages: response.averages,
            parts: response.parts,
            lost: response.lost,
            distortion: response.distortion.map(|levels| Levels {
                excited: levels.excited,
                odd: levels.odd,
                even: levels.even,
                noise: levels.noise,
            }),
        }
    }
}
