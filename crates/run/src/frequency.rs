//! Frequency response of a log, and of a model that is simulated with the inputs of the log.

mod leakage;
mod periods;
mod spectra;

use fleetfoot_data::{Halo, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_dynamics::{End, RolloutOptions, Simulator, Start, Starts, Step};
use fleetfoot_fit::Error;
use fleetfoot_library::{Expr, Program, Scope, Scratch};
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;

use crate::{opened_to_roll, roll_rows};
use periods::Periods;
use spectra::Spectra;

/// Segments of averaged spectra where no length is given, at least.
const SEGMENTS: usize = 16;
/// Samples of a segment, at least.
const SHORTEST: usize = 16;

/// Options of a frequency response.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FrequencyOptions {
    /// The input: a column, or an expression over columns.
    pub input: String,
    /// The output; with a model one of its simulated states.
    pub output: String,
    /// Length of the segments of averaged spectra, seconds; rounded to a power of two of samples. `None`: the longest
    /// that gives sixteen segments.
    pub segment: Option<f64>,
    /// Period of a periodic excitation, seconds: whole periods in place of windowed segments.
    pub period: Option<f64>,
    /// Periods at the beginning of each episode that are left out, while the system settles.
    pub skip: usize,
}

impl FrequencyOptions {
    /// Averaged spectra, or with a period its harmonics after the first period.
    pub fn new(input: impl Into<String>, output: impl Into<String>) -> Self {
        Self { input: input.into(), output: output.into(), segment: None, period: None, skip: 1 }
    }
}

/// The response at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Hz
    pub frequency: f64,
    /// Real and imaginary part.
    pub value: [f64; 2],
    /// Radius of the circle about the value that holds the expected estimate in 95 % of repetitions: of averaged spectra
    /// that is the response but for leakage. NaN for a single part.
    pub radius: f64,
    /// Share of the output's power that is linear in the input.
    pub coherence: f64,
    /// Power of the input: per Hz, or of a periodic excitation the square of the amplitude.
    pub input: f64,
    /// Power of the output.
    pub output: f64,
    /// True if the input has at least a thousandth of its largest power here.
    pub excited: bool,
}

impl Line {
    /// Size of the response.
    pub fn gain(&self) -> f64 {
        self.value[0].hypot(self.value[1])
    }

    /// Angle of the response, rad.
    pub fn phase(&self) -> f64 {
        self.value[1].atan2(self.value[0])
    }

    /// Half of the interval of the phase, rad: pi where the circle has the origin inside.
    pub fn phase_error(&self) -> f64 {
        let share = self.radius / self.gain();
        if share < 1.0 {
            share.asin()
        } else if share.is_nan() {
            f64::NAN
        } else {
            std::f64::consts::PI
        }
    }
}

/// Root mean square amplitudes of the output, by frequencies of a periodic excitation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    /// At excited frequencies.
    pub excited: f64,
    /// At odd multiples of the fundamental that are not excited; `None` without one.
    pub odd: Option<f64>,
    /// At even multiples that are not excited.
    pub even: Option<f64>,
    /// Of the part that does not repeat; `None` for a single period.
    pub noise: Option<f64>,
}

/// A frequency response.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Response {
    /// By frequency, from the lowest.
    pub lines: Vec<Line>,
    /// Independent averages behind each line.
    pub averages: f64,
    /// Segments or periods.
    pub parts: usize,
    /// Segments or periods left out for missing values.
    pub lost: usize,
    /// Output where a periodic excitation has no input.
    pub distortion: Option<Distortion>,
}

/// Frequency responses of a log, and of a model on the same rows.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Frequencies {
    /// Options, with the lengths that were used.
    pub options: FrequencyOptions,
    /// Samples of a segment or a period.
    pub length: usize,
    /// Seconds between samples.
    pub step: f64,
    /// Units of input and output.
    pub units: [Option<String>; 2],
    /// The response of the log.
    pub measured: Response,
    /// That of the model's simulations with the same inputs.
    pub model: Option<Response>,
    /// Episodes.
    pub episodes: usize,
    /// Names of those that the model was trained on.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

impl Frequencies {
    /// Share of the excited lines at which the model lies in the circle of the log's response; `None` without a model
    /// or without circles.
    pub fn inside(&self) -> Option<f64> {
        let model = self.model.as_ref()?;
        let pairs = self.measured.lines.iter().zip(&model.lines);
        let known: Vec<bool> = pairs
            .filter(|(line, model)| line.excited && line.radius.is_finite() && model.gain().is_finite())
            .map(|(line, model)| (line.value[0] - model.value[0]).hypot(line.value[1] - model.value[1]) <= line.radius)
            .collect();
        (!known.is_empty()).then(|| known.iter().filter(|inside| **inside).count() as f64 / known.len() as f64)
    }
}

/// Estimates the response of an output to an input from logs; with a model also that of its simulations, which begin at
/// the first row of every episode that has the rows before it.
///
/// # Errors
/// An unknown column, an output that the model does not simulate, rows at uneven times, a period that is no whole number
/// of samples, too few rows. Those of reading and of rollouts.
pub fn frequency(
    model: Option<&Model>,
    recipe: &Recipe,
    logs: impl Into<Logs>,
    options: &FrequencyOptions,
    progress: &dyn Progress,
) -> Result<Frequencies, Error> {
    let logs = logs.into();
    let (model, dataset) = match model {
        Some(model) => {
            let (model, dataset) = opened_to_roll(model, recipe, &logs, None, progress)?;
            (Some(model), dataset)
        }
        None => (None, Dataset::for_columns(recipe, None, logs, progress)?),
    };
    dataset.search(progress)?;
    let view = dataset.view()?;
    progress.stage("frequency");
    let channels = Channels::new(&view, options)?;
    let step = dataset.step();
    let longest = dataset.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    let total: usize = dataset.episodes().iter().map(|episode| episode.rows).sum();
    let mut options = options.clone();
    let length = match options.period {
        Some(seconds) => period(seconds, step)?,
        None => segment(options.segment, step, longest, total)?,
    };
    let needed = if options.period.is_some() { length * (options.skip + 1) } else { length };
    if longest < needed {
        return Err(Error::too_few_rows(
            longest as u64,
            needed as u64,
            format!(
                "the longest episode has {longest} rows and {needed} are needed for {}; give a shorter one",
                if options.period.is_some() { "the periods that settle and one more" } else { "a segment" }
            ),
        ));
    }
    options.segment = options.period.is_none().then_some(length as f64 * step);
    let mut notes = dataset.notes().to_vec();
    let mut measured = Sums::new(&options, length);
    // Twice as long segments show the leakage.
    let mut longer = options.period.is_none().then(|| Spectra::new(2 * length));
    let mut simulated = model.as_ref().map(|_| Sums::new(&options, length));
    let mut ended = 0;
    for (at, episode) in dataset.episodes().iter().enumerate() {
        even(&view, at, step)?;
        let [input, output] = channels.read(&view, at)?;
        measured.add(&input, &output);
        if let Some(longer) = &mut longer {
            longer.add(&input, &output);
        }
        if let (Some(model), Some(sums)) = (&model, &mut simulated) {
            let path = simulate(model, &dataset, at, episode, &options.output, progress)?;
            ended += usize::from(path.last().is_some_and(|last| last.is_nan()));
            // Of the same rows, so that both have the same leakage.
            sums.add(&input, &path);
        }
    }
    if ended > 0 {
        notes.push(format!(
            "{ended} simulations ended early; the rows behind their ends are left out of the model's response"
        ));
    }
    let missing = || {
        Error::undetermined(format!(
            "no {} without missing values; check {} and {}",
            if options.period.is_some() { "period" } else { "segment" },
            options.input,
            options.output
        ))
    };
    let measured = measured.finish(step).ok_or_else(missing)?;
    let longer = longer.and_then(|sums| sums.finish(step));
    notes.extend(longer.and_then(|longer| leakage::note(&measured, &longer, length, longest, step)));
    Ok(Frequencies {
        length,
        step,
        units: channels.units.clone(),
        measured,
        model: simulated.and_then(|sums| sums.finish(step)),
        episodes: dataset.episodes().len(),
        in_sample: model.as_ref().map(|model| dataset.in_sample(model)).unwrap_or_default(),
        notes,
        options,
    })
}

/// Sums of either method.
enum Sums {
    Spectra(Spectra),
    Periods(Periods, usize),
}

impl Sums {
    fn new(options: &FrequencyOptions, length: usize) -> Self {
        match options.period {
            Some(_) => Self::Periods(Periods::new(length), options.skip * length),
            None => Self::Spectra(Spectra::new(length)),
        }
    }

    fn add(&mut self, input: &[f64], output: &[f64]) {
        match self {
            Self::Spectra(sums) => sums.add(input, output),
            Self::Periods(sums, skip) => {
                sums.add(input.get(*skip..).unwrap_or_default(), output.get(*skip..).unwrap_or_default());
            }
        }
    }

    fn finish(&self, step: f64) -> Option<Response> {
        match self {
            Self::Spectra(sums) => sums.finish(step),
            Self::Periods(sums, _) => sums.finish(step),
        }
    }
}

/// Input and output, compiled.
struct Channels {
    program: Program,
    units: [Option<String>; 2],
}

impl Channels {
    fn new(source: &dyn Source, options: &FrequencyOptions) -> Result<Self, Error> {
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let parse = |text: &String| match names.contains(&text.trim()) {
            true => Ok(Expr::column(text.trim())),
            false => Expr::parse(text, &Scope::new(names.iter().copied())).map_err(|source| {
                fleetfoot_recipe::Error::Expression { place: "frequency".into(), text: text.clone(), source }
            }),
        };
        let both = [parse(&options.input)?, parse(&options.output)?];
        let unit = |expression: &Expr| {
            let name = expression.as_column()?;
            source.columns().iter().find(|column| column.name == *name)?.unit.clone()
        };
        Ok(Self {
            program: Program::compile(&both, &names).map_err(fleetfoot_dynamics::Error::from)?,
            units: [unit(&both[0]), unit(&both[1])],
        })
    }

    fn read(&self, source: &dyn Source, episode: usize) -> Result<[Vec<f64>; 2], Error> {
        let rows = source.episodes()[episode].rows;
        let block = source.read(episode, 0..rows, Halo::default()).map_err(fleetfoot_dynamics::Error::from)?;
        let valid = self.program.valid_rows(&block);
        let mut values = vec![f64::NAN; 2 * rows];
        if !valid.is_empty() {
            let at = valid.start;
            self.program.evaluate_block(&block, valid, &mut values[at..], rows, &mut Scratch::default());
        }
        let output = values.split_off(rows);
        Ok([values, output])
    }
}

/// Samples of a period.
fn period(seconds: f64, step: f64) -> Result<usize, Error> {
    let samples = seconds / step;
    if !(samples.is_finite() && samples.round() >= 4.0) {
        return Err(Error::value(format!("a period of {seconds} s has less than four samples of {step} s")));
    }
    if (samples - samples.round()).abs() > 1e-3 {
        return Err(Error::value(format!(
            "a period of {seconds} s is {samples:.3} samples of {step} s; it must be a whole number: resample the log (`rate` in the recipe), or leave the period away"
        )));
    }
    Ok(samples.round() as usize)
}

/// Samples of a segment, a power of two.
fn segment(seconds: Option<f64>, step: f64, longest: usize, total: usize) -> Result<usize, Error> {
    let samples = match seconds {
        Some(seconds) if !(seconds.is_finite() && seconds >= SHORTEST as f64 * step) => {
            return Err(Error::value(format!(
                "a segment of {seconds} s is too short: {SHORTEST} samples of {step} s are {} s",
                SHORTEST as f64 * step
            )));
        }
        Some(seconds) => (seconds / step).log2().round(),
        None => (longest.min(2 * total / SEGMENTS).max(SHORTEST) as f64).log2().floor(),
    };
    Ok(1usize << (samples as u32).min(40))
}

/// Refuses rows at uneven times.
fn even(source: &dyn Source, episode: usize, step: f64) -> Result<(), Error> {
    let entry = &source.episodes()[episode];
    let block = source.read(episode, 0..entry.rows, Halo::default()).map_err(fleetfoot_dynamics::Error::from)?;
    let stamps = block.stamps();
    let Some((first, last)) = stamps.first().zip(stamps.last()) else { return Ok(()) };
    let mean = (last - first) as f64 * 1e-9 / (entry.rows.max(2) - 1) as f64;
    let far = stamps
        .iter()
        .enumerate()
        .map(|(k, stamp)| ((stamp - first) as f64 * 1e-9 - k as f64 * step).abs())
        .fold(0.0, f64::max);
    if far > 0.5 * step {
        return Err(Error::undetermined(format!(
            "{}: the rows are not at even times (mean {mean:.6} s, up to {far:.6} s beside multiples of {step} s); set `rate` in the recipe for even rows",
            entry.name
        )));
    }
    Ok(())
}

/// The model's simulated output on an episode; NaN before its first row and behind an early end.
fn simulate(
    model: &Model,
    dataset: &Dataset,
    at: usize,
    episode: &fleetfoot_data::Episode,
    output: &str,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Error> {
    let view = dataset.view()?;
    let simulator = Simulator::for_source(model, &view, Step::Median)?;
    let Some(state) = simulator.states().iter().position(|name| name == output.trim()) else {
        return Err(Error::value(format!(
            "`{output}` is no state that the model simulates; its states are {}",
            simulator.states().join(", ")
        )));
    };
    let needed = simulator.needed_rows(1);
    let mut path = vec![f64::NAN; episode.rows];
    let behind = needed.after.max(1) - 1;
    let Some(horizon) = (episode.rows - 1).checked_sub(needed.before + behind).filter(|steps| *steps > 0) else {
        return Ok(path);
    };
    let mut options = RolloutOptions::new(horizon);
    options.keep = true;
    let start = Start { episode: at, row: needed.before };
    let rolled = roll_rows(model, dataset, &Starts::At(vec![start]), &options, None, progress)?;
    for trajectory in &rolled.rollouts.trajectories {
        let steps = if trajectory.end == End::Horizon { horizon } else { trajectory.steps() };
        for k in 0..=steps {
            path[start.row + k] = trajectory.state(k)[state];
        }
    }
    Ok(path)
}
