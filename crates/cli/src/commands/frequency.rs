//! `fleetfoot frequency`.

use std::path::PathBuf;

use fleetfoot::{
    Error, FigureFormat, Frequencies, FrequencyLine, FrequencyOptions, Recipe, bode, decibels, frequency, thinned,
};

use super::{Context, changes, files, flags, in_sample, read_by, read_model, report::is_model};
use crate::{
    args::Frequency,
    table::{number, ratio, table},
};

/// Frequencies that are printed, at most.
const ROWS: usize = 20;

pub(crate) fn run(arguments: &Frequency, context: &Context) -> Result<(), Error> {
    let (models, data): (Vec<PathBuf>, Vec<PathBuf>) = arguments.files.iter().cloned().partition(|path| is_model(path));
    if data.is_empty() {
        return Err(Error::missing("there is no log: name files, globs or folders behind the model".into()));
    }
    let data = files(&data)?;
    let inputs = read_by(&data, models.iter().chain(&arguments.recipe));
    context.claim(&arguments.page.iter().cloned().collect::<Vec<_>>(), &inputs, false)?;
    let model = match models.as_slice() {
        [] => None,
        [path] => Some(read_model(path)?),
        several => {
            let message = format!("{} models are named; `frequency` compares one with a log", several.len());
            return Err(Error::value(message));
        }
    };
    let recipe = match (models.first(), &arguments.recipe) {
        (Some(_), Some(_)) => {
            return Err(Error::value("a model has its own recipe; leave --recipe away, or the model".into()));
        }
        (Some(path), None) => changes(&arguments.time, path)?,
        (None, recipe) => {
            let mut recipe = recipe.as_deref().map_or_else(|| Ok(Recipe::default()), Recipe::read)?;
            flags::apply_time(&mut recipe, &arguments.time)?;
            if let Some(first) = data.first() {
                recipe.cache = flags::cache(&arguments.time.channels, first);
            }
            recipe
        }
    };
    let mut options = FrequencyOptions::new(arguments.input.clone(), arguments.output.clone());
    (options.segment, options.period, options.skip) = (arguments.segment, arguments.period, arguments.skip);
    let bar = context.bar();
    let frequencies = frequency(model.as_ref(), &recipe, &data, &options, &bar);
    bar.finish();
    let frequencies = frequencies?;
    context.notes(&frequencies.notes);
    in_sample(context, &frequencies.in_sample, frequencies.episodes);
    context.print(frequencies.to_json(), || to_text(&frequencies));
    let page = bode(&frequencies);
    if let Some(path) = &arguments.page {
        page.write(path, &inputs)?;
        context.say(format!("wrote {}", path.display()));
    }
    if let Some(folder) = &arguments.svg {
        let paths = page.write_figures(folder, FigureFormat::Svg, &inputs)?;
        context.say(format!("wrote {} figures to {}", paths.len(), folder.display()));
    }
    Ok(())
}

fn to_text(frequencies: &Frequencies) -> String {
    let what = if frequencies.options.period.is_some() { "periods" } else { "segments" };
    let mut text = format!(
        "{} over {}: {} {what} of {} samples ({} s), {} left out for missing values\n",
        frequencies.options.output,
        frequencies.options.input,
        frequencies.measured.parts,
        frequencies.length,
        number(frequencies.length as f64 * frequencies.step),
        frequencies.measured.lost
    );
    let mut header = vec!["Hz", "gain", "95 % from", "to", "phase", "±", "coherence"];
    if frequencies.model.is_some() {
        header.extend(["model gain", "model phase"]);
    }
    let degrees = |value: f64| if value.is_finite() { format!("{:.1}°", value.to_degrees()) } else { "-".to_owned() };
    let row = |at: usize| {
        let line: &FrequencyLine = &frequencies.measured.lines[at];
        let end = |value: f64| if value.is_finite() { number(value.max(0.0)) } else { "-".to_owned() };
        let mut row = vec![
            number(line.frequency),
            number(line.gain()),
            end(line.gain() - line.radius),
            end(line.gain() + line.radius),
            degrees(line.phase()),
            degrees(line.phase_error()),
            ratio(line.coherence),
        ];
        if let Some(model) = &frequencies.model {
            row.extend([number(model.lines[at].gain()), degrees(model.lines[at].phase())]);
        }
        row
    };
    text.push_str(&table(&header, thinned(&frequencies.measured, ROWS).into_iter().map(row).collect()));
    if let Some(inside) = frequencies.inside() {
        text.push_str(&format!(
            "\nthe model lies within the interval at {:.1} % of the excited frequencies",
            100.0 * inside
        ));
    }
    if let Some(distortion) = &frequencies.measured.distortion {
        let level = |value: Option<f64>| {
            value
                .map_or_else(|| "unknown".to_owned(), |value| format!("{:.1} dB", decibels(value / distortion.excited)))
        };
        text.push_str(&format!(
            "\noutput beside the excited frequencies, relative to that at them: odd multiples {}, even multiples {}, noise {}",
            level(distortion.odd),
            level(distortion.even),
            level(distortion.noise)
        ));
    }
    text
}
