//! From raw logs to clean episodes: smooth states and derivatives with their standard deviations, and a recipe that `fit` takes as it is.
//!
//! One episode is in memory at a time: the columns that are read, and those that are written of it.

mod channel;
mod columns;
mod fused;
mod fused_report;
mod grid;
mod options;
mod pieces;
mod places;
mod report;
mod samples;
mod write;

use std::{collections::BTreeMap, ops::Range, path::PathBuf};

use channel::{Channel, Curve};
use columns::{Planned, written_recipe};
use fleetfoot_data::{Block, Halo, Progress, Source, parallel_map};
use fleetfoot_dataset::{
    Dataset, Error, Logs, NOISE, UnitRotations,
    clocks::AlignedClock,
    folder::{Folder, RECIPE},
    is_prepared,
    raw::{PREPARED_BY, RawLog, RawLogs},
};
use fleetfoot_model::RotationKind;
use fleetfoot_output::{WriteColumn, WriteOptions, write_atomic};
use fleetfoot_recipe::{EpisodeRule, Recipe};
use fleetfoot_signal::{SignalError, dejitter};
pub use fused_report::{BodyReport, CorrelationReport, JointReport, JointSensorReport, RejectedPoses};
use options::{EpisodeOptions, Method};
pub use places::Places;
pub use report::{ChannelReport, ClockReport, EpisodeReport, PieceReport, PrepareReport};
use samples::{Samples, Topics};
use serde::Serialize;
use write::{Names, Written};

/// Output folder of clean episodes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PrepareRequest {
    /// The folder, made if it is not there.
    pub folder: PathBuf,
    /// True to replace the files of an earlier preparation.
    pub force: bool,
}

/// Result of a preparation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Prepared {
    /// Report of the preparation.
    pub report: PrepareReport,
    /// The recipe for `fit`.
    pub recipe: PathBuf,
    /// The files of the episodes.
    pub files: Vec<PathBuf>,
}

impl Prepared {
    /// The report with the paths of the written files, as printed by `prepare --json`.
    pub fn to_json(&self) -> serde_json::Value {
        fleetfoot_dataset::json::value(Content {
            report: &self.report,
            recipe: self.recipe.display().to_string(),
            files: self.files.iter().map(|file| file.display().to_string()).collect(),
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    #[serde(flatten)]
    report: &'a PrepareReport,
    recipe: String,
    files: Vec<String>,
}

/// Names that the column of the stamps may have: the first that is free.
const TIMES: [&str; 4] = ["t", "time", "stamp", "prepared_stamp"];

/// Smooths the states of logs, and writes a Parquet file a piece of an episode, with derivatives and standard deviations, and a recipe for it.
///
/// All files appear together or not at all. The bytes do not depend on the number of threads.
///
/// # Errors
/// Those of the recipe and of opening; a folder that holds other logs; a channel that cannot be prepared; no piece that is long enough.
pub fn prepare(
    recipe: &Recipe,
    request: &PrepareRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Prepared, Error> {
    let logs = &logs.into();
    if recipe.body.is_some() || !recipe.joint.is_empty() || !recipe.sensor.is_empty() {
        return fused::prepare(recipe, request, logs, progress);
    }
    let options = EpisodeOptions::new(&recipe.prepare)?;
    let (dataset, recipe, columns) = Dataset::for_preparation(recipe, logs, progress)?;
    let view = dataset.view()?;
    let planned = Planned::all(&recipe, &columns, view.columns())?;
    let is_free = |time: &&&str| planned.iter().all(|column| column.name != **time);
    let time = TIMES.iter().find(is_free).copied().unwrap_or(TIMES[0]);
    let folder = Folder::create(&request.folder, request.force, &logs.files(), is_prepared)?;
    let topics = Topics::new(&recipe, &dataset, &planned, logs, options.dejitter, progress)?;
    let mut raw = RawLogs::new(&request.folder);
    let of_episode = |episode| raw.of(&dataset, episode, progress);
    let raw = (0..view.episodes().len()).map(of_episode).collect::<Result<Vec<_>, _>>()?;
    let mut job = Job {
        raw,
        view: &view,
        dataset: &dataset,
        topics: &topics,
        planned: &planned,
        columns: write::columns(&planned, time)?,
        options,
        folder: &folder,
        write: WriteOptions { metadata: metadata(&recipe), inputs: logs.files(), ..WriteOptions::default() },
        names: Names::default(),
        notes: dataset.notes().iter().cloned().chain(folder.notes()).collect(),
        too_few: Vec::new(),
        rules: Vec::new(),
    };
    progress.stage("prepare");
    let mut episodes = Vec::new();
    for episode in 0..view.episodes().len() {
        if progress.cancelled() {
            return Err(fleetfoot_data::Cancelled.into());
        }
        episodes.push(job.episode(episode)?);
        progress.advance(1, view.episodes().len());
    }
    let Job { notes, too_few, rules, .. } = job;
    let report = PrepareReport::new(episodes, dataset.clocks().to_vec(), notes, too_few)?;
    let mut out = written_recipe(&recipe, &planned, time, report.smoothed)?;
    out.episodes = rules;
    committed(folder, report, &out)
}

/// Makes rotations of the smoothed parts of one.
fn brought_back(kind: RotationKind, places: &[usize], curves: &mut [Result<Option<Curve>, SignalError>]) {
    let value = |curve: &Result<Option<Curve>, SignalError>| match curve {
        Ok(Some(curve)) => curve.derivatives.first().cloned(),
        _ => None,
    };
    let Some(mut parts) = places.iter().map(|&place| value(&curves[place])).collect::<Option<Vec<_>>>() else { return };
    let mut rotation = vec![0.0; places.len()];
    for row in 0..parts[0].len() {
        rotation.iter_mut().zip(&parts).for_each(|(value, part)| *value = part[row]);
        kind.retract(&mut rotation);
        rotation.iter().zip(&mut parts).for_each(|(value, part)| part[row] = *value);
    }
    for (&place, part) in places.iter().zip(parts) {
        if let Ok(Some(curve)) = &mut curves[place] {
            curve.derivatives[0] = part;
        }
    }
}

/// Writes the recipe beside the pieces, and puts all of it into the folder at once.
fn committed(folder: Folder, report: PrepareReport, recipe: &Recipe) -> Result<Prepared, Error> {
    write_atomic(folder.staged(RECIPE), recipe.to_toml().as_bytes())?;
    let names: Vec<String> = report.pieces().map(|piece| piece.file.clone()).chain([RECIPE.to_owned()]).collect();
    let files = report.pieces().map(|piece| folder.target(&piece.file)).collect();
    let recipe = folder.target(RECIPE);
    folder.commit(&names)?;
    Ok(Prepared { report, recipe, files })
}

/// Metadata of a prepared file.
fn metadata(recipe: &Recipe) -> BTreeMap<String, String> {
    let pairs = [(PREPARED_BY, recipe.to_toml()), ("fleetfoot.version", env!("CARGO_PKG_VERSION").to_owned())];
    pairs.map(|(key, value)| (key.to_owned(), value)).into()
}

impl PrepareReport {
    fn new(
        episodes: Vec<EpisodeReport>,
        clocks: Vec<AlignedClock>,
        mut notes: Vec<String>,
        too_few: Vec<String>,
    ) -> Result<Self, Error> {
        let channels = too_few.first().map_or(String::new(), |first| format!(" ({first})"));
        notes.extend(too_few);
        let mut report =
            Self { rows: 0, written: 0, smoothed: 0.0, clocks, body: None, joints: Vec::new(), episodes, notes };
        report.rows = report.episodes.iter().map(|episode| episode.rows).sum();
        report.written = report.pieces().map(|piece| piece.rows).sum();
        report.smoothed =
            report.pieces().flat_map(|piece| &piece.channels).fold(0.0, |most, channel| most.max(channel.smoothed));
        if report.written == 0 {
            let problem = format!(
                "no piece of {} rows is long enough to be written{channels}; give longer logs, looser bounds, or lower min_rows",
                report.rows
            );
            return Err(Error::too_few_rows(report.rows as u64, 1, problem));
        }
        Ok(report)
    }

    /// All pieces that were written.
    pub fn pieces(&self) -> impl Iterator<Item = &PieceReport> {
        self.episodes.iter().flat_map(|episode| &episode.pieces)
    }
}

/// An episode as it was read.
#[derive(Clone, Copy)]
struct Rows<'a> {
    block: &'a Block,
    /// Seconds of the rows.
    times: &'a [f64],
    /// Samples with other stamps, by the places of the columns.
    samples: &'a BTreeMap<usize, Samples>,
}

/// A preparation under way.
struct Job<'a> {
    /// The raw log of every episode.
    raw: Vec<Option<RawLog>>,
    view: &'a UnitRotations<'a>,
    dataset: &'a Dataset,
    topics: &'a Topics,
    planned: &'a [Planned],
    columns: Vec<WriteColumn>,
    options: EpisodeOptions,
    folder: &'a Folder,
    write: WriteOptions,
    names: Names,
    notes: Vec<String>,
    /// The pieces in which a channel has too few values.
    too_few: Vec<String>,
    /// Labels of the written episodes.
    rules: Vec<EpisodeRule>,
}

impl Job<'_> {
    /// Prepares an episode.
    fn episode(&mut self, episode: usize) -> Result<EpisodeReport, Error> {
        let info = &self.view.episodes()[episode];
        let mut block = self.view.read(episode, 0..info.rows, Halo::default())?;
        self.view.turn_on(&mut block);
        let (times, clock) = self.times(&block, &info.name)?;
        let samples = self.topics.of_episode(self.dataset, episode, &block, &mut self.notes)?;
        let bounds = self.planned.iter().enumerate();
        let bounds = bounds.filter_map(|(at, planned)| Some((block.column(at), planned.options?.bounds?)));
        let cut = pieces::pieces(&times, &bounds.collect::<Vec<_>>(), self.options.clip, self.options.min_rows);
        let (mut pieces, mut too_short) = (Vec::new(), cut.too_short);
        for rows in cut.pieces {
            match self.piece(episode, Rows { block: &block, times: &times, samples: &samples }, rows.clone())? {
                Some(piece) => pieces.push(piece),
                None => too_short.extend(rows),
            }
        }
        too_short.sort_unstable();
        Ok(EpisodeReport {
            episode: info.name.clone(),
            rows: info.rows,
            clipped: cut.clipped,
            untold: Places::default(),
            out_of_bounds: Places::of(&cut.outside, &times),
            too_short: Places::of(&too_short, &times),
            clock,
            pieces,
        })
    }

    /// Seconds of the episode, evened out on request.
    fn times(&mut self, block: &Block, episode: &str) -> Result<(Vec<f64>, Option<ClockReport>), Error> {
        let times = block.seconds();
        if !self.options.dejitter || times.len() < 3 {
            return Ok((times, None));
        }
        let even = dejitter(&times).map_err(|source| self.error(episode, "the stamps", source))?;
        if even.correlation > 0.9 {
            self.notes.push(format!(
                "{episode}: errors of neighbouring stamps are correlated ({:.3}): the clocks drift, or the stamps were even; compare with dejitter = false",
                even.correlation
            ));
        }
        let clock = ClockReport::of(&even);
        Ok((even.times, Some(clock)))
    }

    fn error(&self, episode: &str, channel: &str, source: SignalError) -> Error {
        Error::Signal { episode: episode.to_owned(), channel: channel.to_owned(), source }
    }

    /// Prepares and writes a piece; `None`, with a note, if a channel of it has too few values.
    fn piece(&mut self, episode: usize, all: Rows<'_>, rows: Range<usize>) -> Result<Option<PieceReport>, Error> {
        let Rows { block, times, .. } = all;
        let info = &self.view.episodes()[episode];
        let mut curves: Vec<Result<Option<Curve>, SignalError>> =
            parallel_map(self.planned.len(), &fleetfoot_data::Silent, |at| {
                Ok::<_, Error>(self.curve(at, all, rows.clone()).transpose())
            })?;
        self.view.rotations().for_each(|(kind, places)| brought_back(kind, places, &mut curves));
        let mut columns: Vec<Written<'_>> = Vec::new();
        let mut channels = Vec::new();
        for (at, curve) in curves.into_iter().enumerate() {
            let planned = &self.planned[at];
            let curve = match curve {
                Ok(curve) => curve,
                Err(short @ (SignalError::TooFew { .. } | SignalError::TooShort { .. })) => {
                    let span = [times[rows.start], times[rows.end - 1]];
                    self.too_few.push(format!(
                        "{}, {} to {} s, `{}`: {short}; not written",
                        info.name, span[0], span[1], planned.name
                    ));
                    return Ok(None);
                }
                Err(source) => return Err(self.error(&info.name, &planned.name, source)),
            };
            channels.extend(curve.as_ref().map(|curve| curve.report.clone()));
            let values = block.column(at)[rows.clone()].iter().copied().step_by(self.options.decimate).collect();
            columns.extend(write::values(planned, values, curve));
        }
        let stamp = |time: &f64| block.start + (time * 1e9).round() as i64;
        let stamps: Vec<i64> = times[rows].iter().step_by(self.options.decimate).map(stamp).collect();
        let file = self.names.next(&info.name);
        let noise: BTreeMap<&str, f64> = channels
            .iter()
            .filter_map(|channel: &ChannelReport| Some((channel.channel.as_str(), channel.noise?)))
            .collect();
        let mut options = self.write.clone();
        options.metadata.insert(NOISE.to_owned(), serde_json::json!(noise).to_string());
        options.metadata.extend(self.raw_log(episode, &channels).map(|raw| raw.entry()));
        write::write(&self.folder.staged(&file), self.columns.clone(), &stamps, &columns, &options)?;
        self.label(&file, &info.labels);
        Ok(Some(PieceReport { file, rows: stamps.len(), channels }))
    }

    /// The raw log of an episode, and the reports of its channels.
    fn raw_log(&self, episode: usize, channels: &[ChannelReport]) -> Option<RawLog> {
        let mut raw = self.raw[episode].clone()?;
        for planned in self.planned {
            let late =
                planned.options.filter(|options| options.method != Method::None).map_or(0.0, |options| options.late);
            if late != 0.0 {
                raw.late.insert(planned.name.clone(), late);
            }
        }
        for ChannelReport { channel, topic, saturated, stuck, hampel, rejected, .. } in channels {
            raw.topics.extend(topic.iter().map(|topic| (channel.clone(), topic.clone())));
            let spans = [saturated, stuck, hampel, rejected].into_iter().flat_map(|places| places.spans.clone());
            let spans: Vec<[f64; 2]> = spans.collect();
            if !spans.is_empty() {
                raw.left_out.insert(channel.clone(), spans);
            }
        }
        Some(raw)
    }

    /// A state or input, prepared.
    fn curve(&self, at: usize, all: Rows<'_>, rows: Range<usize>) -> Option<Result<Curve, SignalError>> {
        let planned = &self.planned[at];
        let options = planned.options?;
        let (samples, seconds) = (all.samples.get(&at), &all.times[rows.clone()]);
        let late = if options.method == Method::None { 0.0 } else { options.late };
        let (times, values) = match samples {
            Some(samples) => samples.within(seconds[0] + late, seconds[seconds.len() - 1] + late),
            None => (seconds, &all.block.column(at)[rows]),
        };
        let earlier: Vec<f64> = if late == 0.0 { Vec::new() } else { times.iter().map(|time| time - late).collect() };
        let channel = Channel {
            name: &planned.name,
            angle: planned.angle,
            options,
            times: if late == 0.0 { times } else { &earlier },
            values,
            rows: (samples.is_some() || late != 0.0).then_some(seconds),
            decimate: self.options.decimate,
        };
        if times.is_empty() {
            return Some(Err(SignalError::TooFew { count: 0, needed: 2 }));
        }
        let curve = channel.curve().map(|mut curve| {
            curve.report.topic = samples.map(|samples| samples.topic.clone());
            curve.report.clock = samples.and_then(|samples| samples.clock.clone());
            curve
        });
        Some(curve)
    }

    /// The labels of an episode belong to its file.
    fn label(&mut self, file: &str, labels: &BTreeMap<String, String>) {
        self.rules.extend(EpisodeRule::of_file(file, labels));
    }
}
