//! The motion of a rigid body from an inertial sensor and poses: one file a stretch, a row a reading, and a recipe for `fit`.
//!
//! Readings and poses are opened as data sets of their own, each at the stamps of its own topic; all other columns are joined on the readings as everywhere.

mod sensors;
mod table;

use std::path::{Path, PathBuf};

use fleetfoot_data::{Block, ColumnKind, Halo, Progress, Source};
use fleetfoot_log::WriteOptions;
use fleetfoot_signal::{
    Spline, dejitter,
    fuse::{BodyRun, BodyState, BodyTrack, Fused, ImuRecord, PoseRecord, fuse},
};
use serde::Serialize;

use super::{
    EpisodeReport, PieceReport, Places, PrepareReport, PrepareRequest, Prepared,
    columns::written_recipe,
    committed, metadata,
    options::EpisodeOptions,
    pieces,
    write::{self, Names, Written, is_prepared},
};
use crate::{Dataset, EpisodeRule, Error, Logs, PrepareSection, Recipe, folder::Folder};
use sensors::Sensors;

/// What fusion found of a body's sensors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BodyReport {
    /// The origin of the markers' frame in the body frame, m, and the deviations; 0 of what was given.
    pub lever: [f64; 3],
    /// Its deviations.
    pub lever_deviation: [f64; 3],
    /// The markers' frame to the body frame: x, y, z, w.
    pub mounting: [f64; 4],
    /// Its deviations, rad.
    pub mounting_deviation: [f64; 3],
    /// Seconds by which poses are stamped late.
    pub delay: f64,
    /// Its deviation.
    pub delay_deviation: f64,
    /// In the world, m/s^2.
    pub gravity: [f64; 3],
    /// The deviations of its direction about two axes across it, rad.
    pub gravity_deviation: [f64; 2],
    /// Densities of the noise of rate and force.
    pub imu_noise: [f64; 2],
    /// Deviations of position and attitude, m and rad.
    pub pose_noise: [f64; 2],
    /// Whether the noise was told by the residuals.
    pub noise_fitted: bool,
    /// Poses that were read.
    pub poses: usize,
    /// Poses without readings about them.
    pub outside: usize,
    /// Poses of stretches of which fewer than two positions or no attitude lay within the gate: these are not written.
    pub contradicted: usize,
    /// Poses that were left out, log by log.
    pub rejected: Vec<RejectedPoses>,
    /// Whether the iteration came to rest.
    pub converged: bool,
}

/// Poses of a log that are gross errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct RejectedPoses {
    /// The log.
    pub log: String,
    /// Positions, in seconds of the log's readings.
    pub positions: Places,
    /// Attitudes.
    pub attitudes: Places,
}

/// The rows of a log, of whatever episodes, where all that is fused was measured.
struct LogRows {
    log: PathBuf,
    name: String,
    labels: std::collections::BTreeMap<String, String>,
    /// The first stamp, ns.
    epoch: i64,
    /// Seconds after it.
    times: Vec<f64>,
    columns: Vec<Vec<f64>>,
    /// Rows in which one of the first columns is missing.
    missing: usize,
}

impl LogRows {
    /// A data set log by log; rows count in which the first `needed` columns have values.
    fn all(dataset: &Dataset, needed: usize) -> Result<Vec<Self>, Error> {
        let view = dataset.view()?;
        let mut logs: Vec<Self> = Vec::new();
        for (at, episode) in view.episodes().iter().enumerate() {
            let block = view.read(at, 0..episode.rows, Halo::default())?;
            let log = dataset.origin(at);
            if logs.last().is_none_or(|last| last.log != log) {
                let name = episode.name.split_once('#').map_or(episode.name.as_str(), |(file, _)| file).to_owned();
                logs.push(Self {
                    log: log.to_path_buf(),
                    name,
                    labels: episode.labels.clone(),
                    epoch: block.start,
                    times: Vec::new(),
                    columns: vec![Vec::new(); view.columns().len()],
                    missing: 0,
                });
            }
            if let Some(last) = logs.last_mut() {
                last.add(&block, needed);
            }
        }
        Ok(logs)
    }

    fn add(&mut self, block: &Block, needed: usize) {
        let since = (block.start - self.epoch) as f64 * 1e-9;
        for (row, time) in block.seconds().iter().enumerate() {
            if (0..needed).any(|column| !block.column(column)[row].is_finite()) {
                self.missing += 1;
                continue;
            }
            self.times.push(since + time);
            for (at, column) in self.columns.iter_mut().enumerate() {
                column.push(block.column(at)[row]);
            }
        }
    }

    /// Neighbouring columns, row by row.
    fn part<const N: usize>(&self, from: usize) -> Vec<[f64; N]> {
        (0..self.times.len()).map(|row| std::array::from_fn(|i| self.columns[from + i][row])).collect()
    }

    /// Puts the stamps on a line through the sample counts.
    fn even_out(&mut self) -> Result<(), Error> {
        if self.times.len() > 2 {
            let error = |source| Error::Signal { episode: self.name.clone(), channel: "the stamps".into(), source };
            self.times = dejitter(&self.times).map_err(error)?.times;
        }
        Ok(())
    }
}

/// The readings of a log and its poses, as fusion wants them.
struct Run {
    readings: LogRows,
    rates: Vec<[f64; 3]>,
    forces: Vec<[f64; 3]>,
    stamps: Vec<f64>,
    positions: Vec<[f64; 3]>,
    attitudes: Vec<[f64; 4]>,
}

impl Run {
    fn new(readings: LogRows, poses: &LogRows) -> Self {
        let apart = (poses.epoch - readings.epoch) as f64 * 1e-9;
        Self {
            rates: readings.part(0),
            forces: readings.part(3),
            stamps: poses.times.iter().map(|time| time + apart).collect(),
            positions: poses.part(0),
            attitudes: poses.part(3),
            readings,
        }
    }

    fn imu(&self) -> ImuRecord<'_> {
        ImuRecord { times: &self.readings.times, rates: &self.rates, forces: &self.forces }
    }

    fn body_run(&self) -> BodyRun<'_> {
        let poses = PoseRecord { times: &self.stamps, positions: &self.positions, attitudes: &self.attitudes };
        BodyRun { imu: self.imu(), poses }
    }
}

/// Refuses what speaks of single channels, none of which is smoothed, and of other rows than those of the sensors.
fn check(recipe: &Recipe) -> Result<(), Error> {
    if recipe.time.base.is_some() || recipe.time.rate.is_some() {
        return Err(Error::conflict(
            "[body] is fused at the stamps of its own sensors: leave out base and rate of [time]; decimate of [prepare] writes fewer rows".into(),
        ));
    }
    let PrepareSection { clip, dejitter, decimate, min_rows, .. } = recipe.prepare;
    let understood = PrepareSection { clip, dejitter, decimate, min_rows, ..PrepareSection::default() };
    if recipe.prepare == understood && recipe.channels.is_empty() {
        return Ok(());
    }
    Err(Error::conflict(
        "[body] is fused, and no channel is smoothed by itself: of [prepare] clip, dejitter, decimate and min_rows go with it; leave out the rest, and [channels]".into(),
    ))
}

/// Fuses the sensors of a body and writes its motion.
pub(super) fn prepare(
    recipe: &Recipe,
    request: &PrepareRequest,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Prepared, Error> {
    check(recipe)?;
    let (sensors, options) = (Sensors::new(recipe)?, EpisodeOptions::new(&recipe.prepare)?);
    let along: Vec<String> = recipe.states.keys().chain(recipe.inputs.keys()).cloned().collect();
    let names = [sensors.readings.clone(), along.clone()].concat();
    let read = Dataset::for_columns(recipe, Some(&names), logs, progress)?;
    let columns = table::Columns::new(&along_columns(&read, &along)?)?;
    let seen = Dataset::for_columns(recipe, Some(&sensors.poses), logs, progress)?;
    let (mut readings, mut poses) = (LogRows::all(&read, 6)?, LogRows::all(&seen, 7)?);
    if options.dejitter {
        readings.iter_mut().chain(&mut poses).try_for_each(LogRows::even_out)?;
    }
    let mut notes: Vec<String> = read.notes().to_vec();
    notes.extend(seen.notes().iter().filter(|note| !read.notes().contains(note)).cloned());
    let runs = runs(readings, &poses, &mut notes)?;
    progress.stage("fuse");
    let fused = fused(&runs, &sensors)?;
    if !fused.converged {
        notes.push(
            "the fusion did not come to rest: state noise, delay, lever or mounting, or give longer records".into(),
        );
    }
    if fused.contradicted > 0 {
        notes.push(format!(
            "{} poses lie in stretches of which the gate left fewer than two positions or no attitude: these stretches are left out",
            fused.contradicted
        ));
    }
    let folder = Folder::create(&request.folder, request.force, &logs.files(), is_prepared)?;
    notes.extend(folder.notes());
    let write = WriteOptions { metadata: metadata(recipe), inputs: logs.files(), ..WriteOptions::default() };
    let mut job = Job {
        runs: &runs,
        fused: &fused,
        columns,
        options,
        folder: &folder,
        write,
        names: Names::default(),
        rules: Vec::new(),
    };
    progress.stage("prepare");
    let episodes = (0..runs.len()).map(|run| job.episode(run)).collect::<Result<Vec<_>, _>>()?;
    let Job { columns, rules, .. } = job;
    let mut report = PrepareReport::new(episodes, read.clocks().to_vec(), notes, Vec::new())?;
    report.smoothed = smoothed(&fused, &runs);
    report.body = Some(body_report(&fused, &runs, sensors.options.fit_noise));
    let mut out = columns.recipe(written_recipe(recipe, &[], columns.time(), report.smoothed)?);
    out.episodes = rules;
    committed(folder, report, &out)
}

/// States and inputs that go along as they are, with their units.
fn along_columns(read: &Dataset, along: &[String]) -> Result<Vec<fleetfoot_data::Column>, Error> {
    let view = read.view()?;
    let of_view = |name: &String| view.columns().iter().find(|column| column.name == *name);
    let columns: Vec<_> = along.iter().filter_map(of_view).cloned().collect();
    match columns.iter().find(|column| matches!(column.kind, ColumnKind::Category(_))) {
        Some(text) => {
            Err(Error::value(format!("`{}` is text: beside a body numbers alone go along; leave it out", text.name)))
        }
        None => Ok(columns),
    }
}

/// Readings and poses of one log belong together.
fn runs(readings: Vec<LogRows>, poses: &[LogRows], notes: &mut Vec<String>) -> Result<Vec<Run>, Error> {
    let mut runs = Vec::new();
    for own in readings {
        let name = own.log.display().to_string();
        let Some(seen) = poses.iter().find(|other| other.log == own.log) else {
            notes.push(format!("{name} has readings and no poses: it is left out"));
            continue;
        };
        for (rows, what) in [(own.missing, "readings"), (seen.missing, "poses")] {
            if rows > 0 {
                notes.push(format!("{name}: {rows} {what} have missing values and are left out"));
            }
        }
        runs.push(Run::new(own, seen));
    }
    if runs.is_empty() {
        return Err(Error::missing("no log has both readings and poses: name channels that the logs have".into()));
    }
    Ok(runs)
}

fn fused(runs: &[Run], sensors: &Sensors) -> Result<Fused, Error> {
    let records: Vec<BodyRun<'_>> = runs.iter().map(Run::body_run).collect();
    let error =
        |log: &Path, source| Error::Signal { episode: log.display().to_string(), channel: "[body]".into(), source };
    for (run, record) in runs.iter().zip(&records) {
        record.check().map_err(|source| error(&run.readings.log, source))?;
    }
    let all = if let [run] = runs { run.readings.log.clone() } else { PathBuf::from("all logs") };
    fuse(&records, &sensors.options).map_err(|source| error(&all, source))
}

/// Seconds after which states share a hundredth of a measurement: a position under the noise of the force, integrated twice, an attitude under that of the rate, integrated once.
fn smoothed(fused: &Fused, runs: &[Run]) -> f64 {
    let rows: usize = runs.iter().map(|run| run.stamps.len()).sum();
    let seconds: f64 = runs.iter().filter_map(|run| Some(run.stamps.last()? - run.stamps.first()?)).sum();
    let (period, noise) = (seconds / rows.max(1) as f64, &fused.noise);
    let lambda = (noise.position / noise.imu.accelerometer).powi(2);
    let position = Spline::Cubic.correlation_rows(lambda, period, 1.0) * period;
    position.max(100.0_f64.ln() * noise.attitude / noise.imu.gyro * period.sqrt())
}

fn body_report(fused: &Fused, runs: &[Run], noise_fitted: bool) -> BodyReport {
    let (own, noise) = (&fused.constants, &fused.noise);
    let rejected = |at: usize| {
        let run = &runs[at];
        let rows = |of: fn(&BodyTrack) -> &Vec<usize>| {
            let tracks = fused.tracks.iter().filter(|track| track.run == at);
            Places::of(&tracks.flat_map(of).copied().collect::<Vec<_>>(), &run.stamps)
        };
        RejectedPoses {
            log: run.readings.log.display().to_string(),
            positions: rows(|track| &track.positions_rejected),
            attitudes: rows(|track| &track.attitudes_rejected),
        }
    };
    BodyReport {
        lever: own.lever.map(|axis| axis.value),
        lever_deviation: own.lever.map(|axis| axis.deviation),
        mounting: own.mounting,
        mounting_deviation: own.mounting_deviations,
        // Nothing is 0, and not -0.
        delay: 0.0 - own.offset.value,
        delay_deviation: own.offset.deviation,
        gravity: own.gravity,
        gravity_deviation: own.gravity_deviations,
        imu_noise: [noise.imu.gyro, noise.imu.accelerometer],
        pose_noise: [noise.position, noise.attitude],
        noise_fitted,
        poses: runs.iter().map(|run| run.stamps.len()).sum(),
        outside: fused.outside,
        contradicted: fused.contradicted,
        rejected: (0..runs.len()).map(rejected).collect(),
        converged: fused.converged,
    }
}

/// The writing of stretches.
struct Job<'a> {
    runs: &'a [Run],
    fused: &'a Fused,
    columns: table::Columns,
    options: EpisodeOptions,
    folder: &'a Folder,
    write: WriteOptions,
    names: Names,
    rules: Vec<EpisodeRule>,
}

impl Job<'_> {
    /// Writes the stretches of a run.
    fn episode(&mut self, at: usize) -> Result<EpisodeReport, Error> {
        let (fused, run) = (self.fused, &self.runs[at]);
        let mut report = EpisodeReport {
            episode: run.readings.name.clone(),
            rows: run.readings.times.len(),
            clipped: 0,
            out_of_bounds: Places::default(),
            too_short: Places::default(),
            clock: None,
            pieces: Vec::new(),
        };
        let mut too_short = Vec::new();
        for track in fused.tracks.iter().filter(|track| track.run == at) {
            let times = &run.readings.times;
            let from = track.states.first().map_or(0, |state| times.partition_point(|&time| time < state.time));
            let to = track.states.last().map_or(from, |state| times.partition_point(|&time| time <= state.time));
            let found = pieces::pieces(&times[from..to], &[], self.options.clip, self.options.min_rows);
            report.clipped += found.clipped;
            too_short.extend(found.too_short.iter().map(|row| from + row));
            for rows in found.pieces {
                report.pieces.push(self.piece(run, track, from + rows.start..from + rows.end)?);
            }
        }
        report.too_short = Places::of(&too_short, &run.readings.times);
        Ok(report)
    }

    fn piece(&mut self, run: &Run, track: &BodyTrack, rows: std::ops::Range<usize>) -> Result<PieceReport, Error> {
        let (readings, imu, gravity) = (&run.readings, run.imu(), self.fused.constants.gravity);
        let rows: Vec<usize> = rows.step_by(self.options.decimate).collect();
        // All of these rows lie between the first and the last state of the track.
        let states: Vec<BodyState> =
            rows.iter().filter_map(|&row| track.at(&imu, gravity, readings.times[row])).collect();
        let along = readings.columns[6..].iter().map(|column| rows.iter().map(|&row| column[row]).collect());
        let columns: Vec<Written<'_>> = table::values(&states).into_iter().chain(along).map(Written::Numbers).collect();
        let stamps: Vec<i64> = states.iter().map(|state| readings.epoch + (state.time * 1e9).round() as i64).collect();
        let file = self.names.next(&readings.name);
        write::write(&self.folder.staged(&file), self.columns.write.clone(), &stamps, &columns, &self.write)?;
        self.rules.extend(EpisodeRule::of_file(&file, &readings.labels));
        Ok(PieceReport { file, rows: stamps.len(), channels: Vec::new() })
    }
}
