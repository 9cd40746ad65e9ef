//! The page of a frequency response: gain, phase and coherence over frequency, of a log and of a model.

use fleetfoot_report::{
    Axis, Chart, Figure, Light, Lines, Page, Part, Scale, Section, Sentence, Series, Stroke, words::number,
};
use fleetfoot_run::{Frequencies, FrequencyLine, FrequencyResponse};

use crate::{Report, sentence::sentence};

/// Frequencies that are drawn, at most.
const POINTS: usize = 240;

/// One page about a frequency response.
pub fn bode(frequencies: &Frequencies) -> Report {
    let title = format!("{} over {}", frequencies.options.output, frequencies.options.input);
    let unit = match &frequencies.units {
        [Some(input), Some(output)] if input == output => String::new(),
        [Some(input), Some(output)] => format!("{}/{}", factor(output), factor(input)),
        _ => String::new(),
    };
    let shown = drawn(&frequencies.measured);
    let mut frequency = Axis::of("frequency", "Hz");
    frequency.scale = Scale::Logarithmic;
    let responses = [("log", Some(&frequencies.measured)), ("model", frequencies.model.as_ref())];
    let responses: Vec<(&str, &FrequencyResponse)> =
        responses.into_iter().filter_map(|(name, response)| Some((name, response?))).collect();
    let mut gain = Axis::of("gain", unit);
    gain.scale = Scale::Logarithmic;
    let figures = [
        ("gain", "Gain", gain, values(&responses, &shown, gains)),
        ("phase", "Phase", Axis::of("phase", "degrees"), values(&responses, &shown, phases)),
        (
            "coherence",
            "Coherence",
            Axis::of("coherence", "").between(0.0, 1.05),
            values(&responses[..1], &shown, coherences),
        ),
    ];
    let captions = [
        format!(
            "Size of the response. Band: 95 % of repetitions, from {} averages of {} samples.",
            number(frequencies.measured.averages),
            frequencies.length
        ),
        "Angle of the response, without jumps of a turn.".to_owned(),
        "Share of the output's power that is linear in the input: less than 1 means noise, other inputs or nonlinearity.".to_owned(),
    ];
    let mut parts = vec![Part::Findings(findings(frequencies))];
    for ((name, title, axis, series), caption) in figures.into_iter().zip(captions) {
        let chart = Chart::Lines(Lines::new(frequency.clone(), axis, series));
        parts.push(Part::Figure(Figure::new(name, title, caption, chart)));
    }
    let lead = format!(
        "{} episodes, {} samples of {} s each part.",
        frequencies.episodes,
        frequencies.length,
        number(frequencies.step)
    );
    let mut page = Page::new(title, lead, vec![Section::new("response", "Frequency response", parts)]);
    page.source = vec![format!("Made by fleetfoot {}.", env!("CARGO_PKG_VERSION"))];
    Report {
        page,
        episodes: frequencies.episodes,
        in_sample: frequencies.in_sample.clone(),
        notes: frequencies.notes.clone(),
    }
}

/// A unit that can be divided.
fn factor(unit: &str) -> String {
    if unit.contains(['/', ' ']) { format!("({unit})") } else { unit.to_owned() }
}

/// Excited lines, thinned evenly over the logarithm of the frequency.
pub(crate) fn drawn(response: &FrequencyResponse) -> Vec<usize> {
    thinned(response, POINTS)
}

/// At most so many excited lines, evenly over the logarithm of the frequency.
pub fn thinned(response: &FrequencyResponse, most: usize) -> Vec<usize> {
    let excited: Vec<usize> = (0..response.lines.len()).filter(|&at| response.lines[at].excited).collect();
    let (Some(&first), Some(&last)) = (excited.first(), excited.last()) else { return Vec::new() };
    let [low, high] = [first, last].map(|at| response.lines[at].frequency.ln());
    let step = (high - low) / most.saturating_sub(1).max(1) as f64;
    let mut next = low;
    let mut chosen = Vec::new();
    for at in excited {
        if response.lines[at].frequency.ln() >= next - 1e-9 {
            chosen.push(at);
            next = (next + step).max(response.lines[at].frequency.ln() + step);
        }
    }
    chosen
}

type Curve = (Vec<f64>, Option<[Vec<f64>; 2]>);

fn values(
    responses: &[(&str, &FrequencyResponse)],
    shown: &[usize],
    of: fn(&[&FrequencyLine]) -> Curve,
) -> Vec<Series> {
    let series = responses.iter().map(|(name, response)| {
        let lines: Vec<&FrequencyLine> = shown.iter().map(|&at| &response.lines[at]).collect();
        let (y, band) = of(&lines);
        let line = Series::line(*name, lines.iter().map(|line| line.frequency).collect(), y);
        match (*name, band) {
            ("log", Some([low, high])) => line.looks(Stroke::Measured).banded(low, high),
            ("log", None) => line.looks(Stroke::Measured),
            _ => line,
        }
    });
    series.collect()
}

fn gains(lines: &[&FrequencyLine]) -> Curve {
    let side = |sign: f64| lines.iter().map(|line| (line.gain() + sign * line.radius).max(0.0)).collect();
    (lines.iter().map(|line| line.gain()).collect(), Some([side(-1.0), side(1.0)]))
}

fn phases(lines: &[&FrequencyLine]) -> Curve {
    let mut turned: Vec<f64> = Vec::with_capacity(lines.len());
    for line in lines {
        let phase = line.phase().to_degrees();
        let before = turned.iter().rev().find(|value| value.is_finite()).copied().unwrap_or(phase);
        turned.push(phase - 360.0 * ((phase - before) / 360.0).round());
    }
    let side = |sign: f64| {
        let error = |line: &&FrequencyLine| sign * line.phase_error().to_degrees();
        turned.iter().zip(lines).map(|(value, line)| value + error(line)).collect()
    };
    let band = [side(-1.0), side(1.0)];
    (turned, Some(band))
}

fn coherences(lines: &[&FrequencyLine]) -> Curve {
    (lines.iter().map(|line| line.coherence).collect(), None)
}

fn findings(frequencies: &Frequencies) -> Vec<Sentence> {
    let excited: Vec<&FrequencyLine> = frequencies.measured.lines.iter().filter(|line| line.excited).collect();
    let mean = excited.iter().map(|line| line.coherence).sum::<f64>() / excited.len().max(1) as f64;
    let light = if mean > 0.9 { Light::Good } else { Light::Doubtful };
    let mut sentences = vec![sentence(
        light,
        "Coherence.",
        &format!("On average {} at the {} excited frequencies.", number(mean), excited.len()),
    )];
    if let Some(inside) = frequencies.inside() {
        let light = if inside > 0.9 { Light::Good } else { Light::Doubtful };
        let text = format!(
            "At {} % of the excited frequencies the simulated response lies within the 95 % interval of the log's.",
            number((1000.0 * inside).round() / 10.0)
        );
        sentences.push(sentence(light, "The model.", &text));
    }
    if let Some(distortion) = &frequencies.measured.distortion {
        let level = |value: Option<f64>| {
            value
                .map_or_else(|| "unknown".to_owned(), |value| format!("{:.1} dB", decibels(value / distortion.excited)))
        };
        let text = format!(
            "Output beside the excited frequencies, relative to that at them: odd multiples {}, even multiples {}, noise {}.",
            level(distortion.odd),
            level(distortion.even),
            level(distortion.noise)
        );
        sentences.push(sentence(Light::Plain, "Distortion.", &text));
    }
    sentences
}

/// A ratio of amplitudes in dB, to a tenth.
pub fn decibels(ratio: f64) -> f64 {
    (200.0 * ratio.log10()).round() / 10.0
}
