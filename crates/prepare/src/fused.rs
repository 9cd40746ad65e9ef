//! The motion of a rigid body from a gyroscope, an accelerometer and poses, and of joints from encoders and sensors of
//! rate. The output is one file a stretch, a row a reading, and a recipe for `fit`.
//!
//! Every sensor is opened as a separate data set, at the stamps of its topic; all other columns are joined on the
//! readings as everywhere.

mod body;
mod joints;
mod kept;
mod rows;
mod sensors;
mod table;

use std::ops::Range;

use body::Poses;
use fleetfoot_data::setting::{PREPARE_SECTION, TIME_SECTION};
use fleetfoot_data::{ColumnKind, Progress, Source};
use fleetfoot_dataset::{
    Dataset, Error, Logs,
    estimated_clocks::Clocks,
    folder::Folder,
    is_prepared,
    raw::{RawLog, RawLogs},
};
use fleetfoot_output::{ParquetWriter, Values, WriteOptions};
use fleetfoot_recipe::{AttitudeForm, EpisodeRule, PrepareSection, Recipe};
use fleetfoot_signal::fuse::{BodyState, Fused, gaps};
use joints::{Joint, JointPlan, Opening};
use kept::Kept;
use rows::{Layout, LogRows};
use sensors::Sensors;

use crate::{
    EpisodeReport, PieceReport, Places, PrepareReport, PrepareRequest, Prepared, columns::written_recipe, committed,
    metadata, options::EpisodeOptions, pieces, write::Names,
};

/// The pitch, rad, beyond which the equations of roll and yaw grow fast: their slopes are four times those at rest.
const STEEP: f64 = 1.3;

/// Rows that are written at a time.
const CHUNK: usize = 65_536;

/// Refuses settings of single channels, none of which is smoothed, and of other rows than those of the sensors.
fn check(recipe: &Recipe) -> Result<(), Error> {
    if recipe.time.base.is_some() || recipe.time.rate.is_some() {
        return Err(Error::conflict(format!(
            "[body] and [joint] are fused at the stamps of their sensors: remove base and rate from {TIME_SECTION}; decimate of {PREPARE_SECTION} writes fewer rows"
        )));
    }
    let PrepareSection { clip, dejitter, decimate, min_rows, .. } = recipe.prepare;
    let understood = PrepareSection { clip, dejitter, decimate, min_rows, ..PrepareSection::default() };
    if recipe.prepare == understood && recipe.channels.is_empty() {
        return Ok(());
    }
    Err(Error::conflict(format!(
        "with [body] or [joint] no channel is smoothed by itself: of {PREPARE_SECTION} keep only clip, dejitter, decimate and min_rows, and remove [channels]"
    )))
}

/// The body of a recipe and its measurements, log by log.
struct Body {
    sensors: Sensors,
    poses: Vec<Poses>,
    fused: Fused,
}

/// Fuses the sensors of a body and of joints and writes their motion.
pub(crate) fn prepare(
    recipe: &Recipe,
    request: &PrepareRequest,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Prepared, Error> {
    check(recipe)?;
    let plans = joints::plans(recipe)?;
    let has_body = recipe.body.is_some() || recipe.sensor.values().any(|sensor| !sensor.kind.is_of_joint());
    let sensors = has_body.then(|| Sensors::new(recipe)).transpose()?;
    let options = EpisodeOptions::new(&recipe.prepare)?;
    let clocks = Dataset::find_clocks(recipe, logs, progress)?;
    let known = Clocks { topics: clocks.topics.clone(), ..Clocks::default() };
    let along: Vec<String> = recipe.states.keys().chain(recipe.inputs.keys()).cloned().collect();
    let (base, layout) = base(sensors.as_ref(), &plans)?;
    let folder = Folder::create(&request.folder, request.force, &logs.files(), is_prepared)?;
    let mut kept = Kept::new(folder.target(kept::NAME));
    let read = Dataset::for_columns_by(recipe, &[base, along.clone()].concat(), clocks, logs, progress)?;
    let attitude = recipe.body.as_ref().and_then(|body| body.attitude).unwrap_or_default();
    let columns = table::Columns::new(sensors.as_ref(), attitude, &plans, &along_columns(&read, &along)?)?;
    let mut rows = LogRows::all(&read, layout)?;
    if options.dejitter {
        rows.iter_mut().try_for_each(LogRows::even_out)?;
    }
    let mut notes: Vec<String> = read.notes().to_vec();
    let opening = Opening { recipe, logs, clocks: &known, dejitter: options.dejitter, progress };
    let body = match sensors {
        Some(sensors) => Some(Body::new(sensors, &mut rows, opening, &mut kept, &mut notes)?),
        None => None,
    };
    let fuse = |plan| Joint::new(plan, &rows, opening, &mut notes);
    let joints: Vec<Joint> = plans.into_iter().map(fuse).collect::<Result<_, _>>()?;
    notes.extend(folder.notes());
    let write = WriteOptions { metadata: metadata(recipe), inputs: logs.files(), ..WriteOptions::default() };
    let mut raw = RawLogs::new(&request.folder);
    let of_rows = |rows: &LogRows| {
        let episode = (0..read.episodes().len()).find(|&episode| read.origin(episode) == rows.log);
        let Some(episode) = episode else { return Ok(None) };
        let raw = raw.of(&read, episode, progress)?;
        Ok::<_, Error>(raw.map(|raw| RawLog { episode: None, ..raw }))
    };
    let raw = rows.iter().map(of_rows).collect::<Result<Vec<_>, _>>()?;
    let mut job = Job {
        raw,
        rows: &rows,
        body: body.as_ref(),
        joints: &joints,
        columns,
        options,
        folder: &folder,
        write,
        names: Names::default(),
        rules: Vec::new(),
        steepest: 0.0,
    };
    progress.stage("prepare");
    let episodes = (0..rows.len()).map(|run| job.episode(run)).collect::<Result<Vec<_>, _>>()?;
    let Job { columns, rules, steepest, .. } = job;
    if attitude == AttitudeForm::Euler && steepest > STEEP {
        notes.push(format!(
            "the pitch of the body reaches {:.0} degrees, and near 90 degrees the rates of roll and yaw grow without bound: write `attitude = \"quaternion\"` in [body], which makes the attitude one rotation",
            steepest.to_degrees()
        ));
    }
    let mut report = PrepareReport::new(episodes, read.clocks().to_vec(), notes, Vec::new())?;
    let of_joints = joints.iter().map(|joint| joint.fused.smoothed);
    report.smoothed = of_joints.chain(body.iter().map(Body::smoothed)).fold(0.0, f64::max);
    report.body = body.as_ref().map(|body| body::report(&body.fused, &rows, &body.poses, &body.sensors));
    report.joints = joints.iter().map(Joint::report).collect();
    let mut out = columns.recipe(written_recipe(recipe, &[], columns.time(), report.smoothed)?);
    out.episodes = rules;
    committed(folder, report, &out)
}

/// The channels whose rows are written, and the layout of the kept columns: the readings of the body, else the position
/// of the first joint.
fn base(sensors: Option<&Sensors>, plans: &[JointPlan]) -> Result<(Vec<String>, Layout), Error> {
    if let Some(sensors) = sensors {
        let needed = sensors.readings.len();
        return Ok((sensors.readings.clone(), Layout { needed, vectors: needed / 3, skipped: 0 }));
    }
    match plans.iter().find_map(JointPlan::base) {
        Some(channel) => Ok((vec![channel.clone()], Layout { needed: 1, vectors: 0, skipped: 1 })),
        None => Err(Error::missing(
            "no sensor measures the position of a joint: name a [sensor.NAME] with kind = \"position\"".into(),
        )),
    }
}

/// States and inputs that go along as they are, with their units.
fn along_columns(read: &Dataset, along: &[String]) -> Result<Vec<fleetfoot_data::Column>, Error> {
    let view = read.view()?;
    let of_view = |name: &String| view.columns().iter().find(|column| column.name == *name);
    let columns: Vec<_> = along.iter().filter_map(of_view).cloned().collect();
    match columns.iter().find(|column| matches!(column.kind, ColumnKind::Category(_))) {
        Some(text) => {
            Err(Error::value(format!("`{}` is text, and a fused log takes numbers only: remove the column", text.name)))
        }
        None => Ok(columns),
    }
}

impl Body {
    /// Reads the poses and fuses them with the readings; logs without poses are taken out of `rows`.
    fn new(
        sensors: Sensors,
        rows: &mut Vec<LogRows>,
        opening: Opening<'_>,
        kept: &mut Kept,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        let Opening { recipe, logs, clocks, dejitter, progress } = opening;
        let clocks = Clocks { topics: clocks.topics.clone(), ..Clocks::default() };
        let seen = Dataset::for_columns_by(recipe, &sensors.poses, clocks, logs, progress)?;
        let mut rows_of_logs = LogRows::all(&seen, Layout { needed: 7, vectors: 1, skipped: 0 })?;
        if dejitter {
            rows_of_logs.iter_mut().try_for_each(LogRows::even_out)?;
        }
        notes.extend(seen.notes().iter().filter(|note| !notes.contains(note)).cloned().collect::<Vec<_>>());
        let mut poses = Vec::new();
        rows.retain(|rows_of_log| {
            let name = rows_of_log.log.display();
            let Some(at) = rows_of_logs.iter().position(|other| other.log == rows_of_log.log) else {
                notes.push(format!("{name} has readings and no poses: it is left out"));
                return false;
            };
            let seen = rows_of_logs.swap_remove(at);
            for (missing, what) in [(rows_of_log.missing, "readings"), (seen.missing, "poses")] {
                if missing > 0 {
                    notes.push(format!("{name}: {missing} {what} have missing values and are left out"));
                }
            }
            poses.push(Poses::new(seen, rows_of_log.epoch, sensors.pose_average, notes));
            true
        });
        if rows.is_empty() {
            return Err(Error::missing("no log has both readings and poses: name channels that the logs have".into()));
        }
        progress.stage("fuse");
        let fused = body::fused(rows, &poses, &sensors, kept)?;
        if !fused.converged {
            notes.push("the fusion did not converge: give noise, delay, lever or mounting, or longer records".into());
        }
        notes.extend(body::doubts(&fused, rows, &sensors));
        if fused.contradicted > 0 {
            notes.push(format!(
                "{} poses are left out: in their stretches the gate left fewer than two positions or no attitude",
                fused.contradicted
            ));
        }
        Ok(Self { sensors, poses, fused })
    }

    fn smoothed(&self) -> f64 {
        body::smoothed(&self.fused, &self.poses, self.sensors.has_forces())
    }
}

/// The writing of stretches.
struct Job<'a> {
    /// The raw log of every run.
    raw: Vec<Option<RawLog>>,
    rows: &'a [LogRows],
    body: Option<&'a Body>,
    joints: &'a [Joint],
    columns: table::Columns,
    options: EpisodeOptions,
    folder: &'a Folder,
    write: WriteOptions,
    names: Names,
    rules: Vec<EpisodeRule>,
    /// The greatest pitch of all rows, either way, rad.
    steepest: f64,
}

impl Job<'_> {
    /// Writes the stretches of a run.
    fn episode(&mut self, at: usize) -> Result<EpisodeReport, Error> {
        let rows = &self.rows[at];
        let mut report = EpisodeReport {
            episode: rows.name.clone(),
            rows: rows.times.len(),
            clipped: 0,
            untold: Places::default(),
            out_of_bounds: Places::default(),
            too_short: Places::default(),
            clock: None,
            pieces: Vec::new(),
        };
        let (mut too_short, mut untold) = (Vec::new(), Vec::new());
        let mut end = 0;
        for (stretch, track) in self.stretches(at) {
            untold.extend(end.min(stretch.start)..stretch.start);
            end = stretch.end;
            let stretch_pieces =
                pieces::pieces(&rows.times[stretch.clone()], &[], self.options.clip, self.options.min_rows);
            report.clipped += stretch_pieces.clipped;
            too_short.extend(stretch_pieces.too_short.iter().map(|row| stretch.start + row));
            for piece in stretch_pieces.pieces {
                report.pieces.push(self.piece(at, track, stretch.start + piece.start..stretch.start + piece.end)?);
            }
        }
        untold.extend(end..rows.times.len());
        report.untold = Places::of(&untold, &rows.times);
        report.too_short = Places::of(&too_short, &rows.times);
        Ok(report)
    }

    /// Rows of a run over which all is known, and the track of the body that they are of.
    fn stretches(&self, at: usize) -> Vec<(Range<usize>, usize)> {
        let times = &self.rows[at].times;
        let within = |[first, last]: [f64; 2]| {
            let from = times.partition_point(|&time| time < first);
            from..times.partition_point(|&time| time <= last).max(from)
        };
        let all = match self.body {
            Some(body) => body
                .fused
                .tracks
                .iter()
                .enumerate()
                .filter(|(_, track)| track.run == at)
                .filter_map(|(index, track)| {
                    Some((within([track.states.first()?.time, track.states.last()?.time]), index))
                })
                .collect(),
            None => parts(times).into_iter().map(|rows| (rows, 0)).collect::<Vec<_>>(),
        };
        let known = self.joints.iter().map(|joint| within(joint.span(at)));
        let known =
            known.fold(0..times.len(), |all, interval| all.start.max(interval.start)..all.end.min(interval.end));
        let begun = self.joints.iter().map(|joint| joint.begun(at)).fold(known.start, usize::max);
        let cut = |(rows, track): (Range<usize>, usize)| (rows.start.max(begun)..rows.end.min(known.end), track);
        all.into_iter().map(cut).filter(|(rows, _)| rows.start < rows.end).collect()
    }

    fn piece(&mut self, at: usize, track: usize, piece: Range<usize>) -> Result<PieceReport, Error> {
        let rows = &self.rows[at];
        let file = self.names.next(&rows.name);
        let mut write = self.write.clone();
        write.metadata.extend(self.raw[at].as_ref().map(RawLog::entry));
        let mut writer = ParquetWriter::create(self.folder.staged(&file), self.columns.write.clone(), &write)?;
        let wanted: Vec<usize> = piece.step_by(self.options.decimate).collect();
        for chunk in wanted.chunks(CHUNK) {
            let mut columns = match self.body {
                Some(body) => {
                    let states = self.states(body, at, track, chunk);
                    self.steepest = self.steepest.max(table::steepest(&states));
                    table::values(&states, body.sensors.has_forces())
                }
                None => Vec::new(),
            };
            columns.extend(self.joints.iter().flat_map(|joint| joint.values(at, chunk)));
            columns.extend(rows.columns.iter().map(|column| chunk.iter().map(|&row| column[row]).collect()));
            let stamp = |&row: &usize| rows.epoch + (rows.times[row] * 1e9).round() as i64;
            let stamps: Vec<i64> = chunk.iter().map(stamp).collect();
            let all = columns.iter().map(|column| Values::Float(column));
            writer.write(&std::iter::once(Values::Integer(&stamps)).chain(all).collect::<Vec<_>>())?;
        }
        writer.finish()?;
        self.rules.extend(EpisodeRule::of_file(&file, &rows.labels));
        Ok(PieceReport { file, rows: wanted.len(), channels: Vec::new() })
    }

    /// The body's states at these rows, all of which lie between the first and the last state of the track.
    fn states(&self, body: &Body, at: usize, track: usize, rows: &[usize]) -> Vec<BodyState> {
        let Fused { tracks, constants, noise, .. } = &body.fused;
        let imu = body::imu(&self.rows[at], body.sensors.averages);
        let state = |&row: &usize| tracks[track].at(&imu, constants.gravity, noise, self.rows[at].times[row]);
        rows.iter().filter_map(state).collect()
    }
}

/// Rows between the gaps of a record.
fn parts(times: &[f64]) -> Vec<Range<usize>> {
    if times.len() < 2 {
        return Vec::new();
    }
    let ends = gaps(times).into_iter().map(|[from, _]| times.partition_point(|&time| time <= from));
    let mut start = 0;
    ends.chain([times.len()]).map(|end| std::mem::replace(&mut start, end)..end).collect()
}
