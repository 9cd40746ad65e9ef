//! Description of a file: columns, units, clock, and, when asked, the range of the values.

use std::{
    collections::{BTreeMap, HashMap},
    path::{Path, PathBuf},
};

use fleetfoot_data::{Halo, Progress, Silent, Source, parallel_fold};
use serde::{Serialize, Serializer};

use crate::{
    ArrayInfo, ClockInfo, ColumnInfo, ColumnStatistics, Error, Format, Log, MaxGap, Recording, RunFiles, Selection,
    TimeSpec, TopicInfo, agreement, arrays, channels, csv, parquet, recording::open_agreed, time_column::Agreed,
};

/// Rows of a block of the scan for [`ColumnStatistics`].
const BLOCK: usize = 65_536;

/// Description of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct FileInfo {
    /// The file.
    #[serde(rename = "file", serialize_with = "path_in_words")]
    pub path: PathBuf,
    /// Its format.
    #[serde(serialize_with = "format_name")]
    pub format: Format,
    /// Its size.
    pub bytes: u64,
    /// Rows, if the file states them or the values were scanned.
    pub rows: Option<usize>,
    /// Columns in the order of the file. For a robot's log: the fields of some of its messages, or of all when the
    /// values were scanned.
    pub columns: Vec<ColumnInfo>,
    /// Arrays of a robot's log whose elements are not listed among the columns.
    pub arrays: Vec<ArrayInfo>,
    /// The topics of a robot's log; empty for tables.
    pub topics: Vec<TopicInfo>,
    /// The column that is taken as the clock when none is named; `None` of a robot's log, whose messages are stamped.
    pub clock: Option<ClockInfo>,
    /// Episodes; only when the values were scanned.
    pub episodes: Option<usize>,
    /// Metadata of a robot's log beside its messages ([`crate::metadata`]); empty for tables.
    pub metadata: BTreeMap<String, String>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

impl FileInfo {
    /// Some topics of a robot's log alone; none given: all.
    ///
    /// # Errors
    /// A topic that the log does not have.
    pub fn of_topics(mut self, topics: &[String]) -> Result<Self, Error> {
        let names = channels::Names::new(self.topics.iter().map(|topic| topic.name.as_str()), &[]);
        for topic in topics {
            if !self.topics.iter().any(|topic_info| topic_info.name == *topic) {
                return Err(Error::MissingTopic {
                    path: self.path,
                    column: topic.clone(),
                    nearest: names.nearest(topic),
                });
            }
        }
        if topics.is_empty() {
            return Ok(self);
        }
        let all: Vec<String> = self.topics.iter().map(|topic| topic.name.clone()).collect();
        let is_wanted = |column: &str| names.locate(column).is_some_and(|(topic, _)| topics.contains(&all[topic]));
        self.columns.retain(|column| is_wanted(&column.name));
        self.arrays.retain(|array| is_wanted(&array.name));
        self.topics.retain(|topic| topics.contains(&topic.name));
        Ok(self)
    }

    /// The same with topics called as [`crate::JoinSpec::renames`] asks.
    #[must_use]
    pub fn renamed(mut self, renames: &[(String, String)]) -> Self {
        if renames.is_empty() {
            return self;
        }
        let names = channels::Names::new(self.topics.iter().map(|topic| topic.name.as_str()), renames);
        let plain = channels::Names::new(self.topics.iter().map(|topic| topic.name.as_str()), &[]);
        let rename = |column: &mut String| match plain.locate(column) {
            None => true,
            Some((topic, rest)) => {
                let name = names.of(topic).map(|name| format!("{name}{rest}"));
                name.map(|name| *column = name).is_some()
            }
        };
        self.columns.retain_mut(|column| rename(&mut column.name));
        self.arrays.retain_mut(|array| rename(&mut array.name));
        let kept: Vec<Option<String>> =
            (0..self.topics.len()).map(|topic| names.of(topic).map(str::to_owned)).collect();
        let mut kept = kept.into_iter();
        self.topics.retain_mut(|topic| kept.next().flatten().map(|name| topic.name = name).is_some());
        self
    }
}

/// A path for programs as people see it: names of files need not be text, which all of JSON is.
///
/// # Errors
/// Those of the serializer.
pub fn path_in_words<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&path.display())
}

fn format_name<S: Serializer>(format: &Format, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(format.name())
}

/// Looks at files that are given in one call, as [`inspect`] or, for `values`, as [`inspect_values`]: what single ones leave open, units of clocks and orders of day
/// and month, all of them tell together, as for [`crate::open`]. Where they disagree, a note of each says what opening them together would.
///
/// # Errors
/// As of each file alone.
pub fn inspect_together<P: AsRef<Path>>(
    paths: &[P],
    values: bool,
    progress: &dyn Progress,
) -> Result<Vec<FileInfo>, Error> {
    let logs: Vec<Log> = paths.iter().map(|path| Log::File(path.as_ref().to_path_buf())).collect();
    let (agreed, problem) = match agreement::agreed(&logs, &Selection::default(), progress) {
        Ok(agreed) => (agreed, None),
        Err(problem @ Error::ColumnsDisagree { .. }) => (Agreed::default(), Some(problem.to_string())),
        Err(error) => return Err(error),
    };
    let each = |path: &P| {
        let path = path.as_ref();
        let mut info = if values { inspect_values_by(path, &agreed, progress)? } else { inspect_by(path, &agreed)? };
        if info.clock.is_some() {
            info.notes
                .extend(problem.iter().map(|problem| format!("these files cannot be opened together: {problem}")));
        }
        Ok(info)
    };
    paths.iter().map(each).collect()
}

/// Looks at a file's header, metadata and first rows.
pub fn inspect(path: impl AsRef<Path>) -> Result<FileInfo, Error> {
    inspect_by(path.as_ref(), &Agreed::default())
}

/// The files of a run as one log: every file is a topic, and its columns are called `topic.column`. Its clock is each file's own.
///
/// # Errors
/// As of each file alone.
pub fn inspect_run(run: &RunFiles) -> Result<FileInfo, Error> {
    let mut all: Option<FileInfo> = None;
    for (topic, path) in &run.files {
        let mut info = inspect(path)?;
        info.columns.iter_mut().for_each(|column| column.name = format!("{topic}.{}", column.name));
        let messages = info.rows.and_then(|rows| u64::try_from(rows).ok());
        info.topics = vec![TopicInfo { name: topic.clone(), messages, ..TopicInfo::default() }];
        match &mut all {
            None => all = Some(FileInfo { path: run.folder.clone(), rows: None, clock: None, ..info }),
            Some(all) => {
                all.bytes += info.bytes;
                all.columns.append(&mut info.columns);
                all.topics.append(&mut info.topics);
                all.notes.append(&mut info.notes);
            }
        }
    }
    all.ok_or(Error::NoFiles)
}

fn inspect_by(path: &Path, agreed: &Agreed) -> Result<FileInfo, Error> {
    let Some(format) = Format::of(path) else {
        return Err(Error::UnknownFormat { path: path.into() });
    };
    let bytes = size(path)?;
    let (columns, clock, rows, notes) = match format {
        Format::Parquet => {
            let described = parquet::describe(path)?;
            (described.columns, described.clock, Some(described.rows), Vec::new())
        }
        Format::Npy | Format::Npz | Format::Mat => {
            let described = arrays::describe(path, format)?;
            (described.columns, described.clock, Some(described.rows), described.notes)
        }
        Format::Csv(compression) => {
            let described = csv::describe(path, compression, agreed)?;
            (
                described.columns.into_iter().map(|column| (column, Ok(()))).collect(),
                described.clock,
                None,
                described.notes,
            )
        }
        _ => return Ok(log_info(path, format, bytes, channels::describe(path, format, &Silent)?)),
    };
    let names: Vec<&str> = columns.iter().map(|(column, _)| column.name.as_str()).collect();
    let clock = clock.map(|clock| ClockInfo::new(path, clock, &names, agreed));
    let columns = columns
        .into_iter()
        .map(|(column, support)| ColumnInfo {
            name: column.name,
            unit: column.unit,
            kind: column.kind,
            unsupported: support.err(),
            statistics: None,
        })
        .collect();
    Ok(FileInfo {
        path: path.into(),
        format,
        bytes,
        rows,
        columns,
        arrays: Vec::new(),
        topics: Vec::new(),
        metadata: BTreeMap::new(),
        clock,
        episodes: None,
        notes,
    })
}

/// Bytes of a file, or of all files of a recording's folder.
fn size(path: &Path) -> Result<u64, Error> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let file_metadata = std::fs::metadata(path).map_err(io)?;
    if !file_metadata.is_dir() {
        return Ok(file_metadata.len());
    }
    let mut bytes = 0;
    for entry in std::fs::read_dir(path).map_err(io)? {
        bytes += entry.and_then(|entry| entry.metadata()).map_err(io)?.len();
    }
    Ok(bytes)
}

fn log_info(path: &Path, format: Format, bytes: u64, described: channels::Description) -> FileInfo {
    FileInfo {
        path: path.into(),
        format,
        bytes,
        rows: None,
        columns: described.columns,
        arrays: described.arrays,
        topics: described.topics,
        metadata: described.metadata,
        clock: None,
        episodes: None,
        notes: described.notes,
    }
}

/// As [`inspect`], and reads all rows once: ranges of the values, rates, gaps, backward stamps. Memory stays bounded.
pub fn inspect_values(path: impl AsRef<Path>, progress: &dyn Progress) -> Result<FileInfo, Error> {
    inspect_values_by(path.as_ref(), &Agreed::default(), progress)
}

fn inspect_values_by(path: &Path, agreed: &Agreed, progress: &dyn Progress) -> Result<FileInfo, Error> {
    if let Some(format) = Format::of(path).filter(|format| format.is_log()) {
        return Ok(log_info(path, format, size(path)?, channels::statistics(path, format, progress)?));
    }
    let mut info = inspect_by(path, agreed)?;
    let mut time = match &info.clock {
        Some(clock) if !clock.is_open() => TimeSpec::Auto,
        _ => TimeSpec::Uniform { dt_seconds: 1.0 },
    };
    // A name that occurs twice cannot be asked for, and a text with too many values is no category: leave these out and say so.
    let mut readable: Vec<usize> = (0..info.columns.len()).filter(|&c| info.columns[c].unsupported.is_none()).collect();
    let mut count: HashMap<&str, usize> = HashMap::new();
    info.columns.iter().for_each(|column| *count.entry(&column.name).or_default() += 1);
    readable.retain(|&c| count[info.columns[c].name.as_str()] == 1);
    let recording = loop {
        let names = readable.iter().map(|&c| info.columns[c].name.clone());
        let selection =
            Selection { time: time.clone(), max_gap: MaxGap::Auto, allow_duplicates: true, ..Selection::new(names) };
        match open_agreed(&[Log::File(info.path.clone())], &selection, agreed, progress) {
            Ok(recording) => break recording,
            Err(error @ Error::ClockFalls { .. }) => {
                (info.clock, time) = (None, TimeSpec::Uniform { dt_seconds: 1.0 });
                info.notes.push(error.to_string());
            }
            Err(Error::TooManyCategories { column, limit, .. }) => {
                let Some(at) = readable.iter().position(|&c| info.columns[c].name == column) else {
                    return Err(Error::TooManyCategories { path: info.path, column, limit });
                };
                info.columns[readable.remove(at)].unsupported = Some(format!("text with more than {limit} values"));
            }
            Err(error) => return Err(error),
        }
    };
    let (statistics, rows) = (statistics(&recording, progress)?, recording.rows());
    for (&c, (column, statistics)) in readable.iter().zip(recording.columns().iter().zip(statistics)) {
        info.columns[c].kind = column.kind.clone();
        info.columns[c].statistics = Some(statistics);
    }
    let summary = recording.files().next().map(|(_, clock)| *clock);
    info.rows = Some(summary.map_or(rows, |clock| clock.rows));
    let has_stamps = time == TimeSpec::Auto;
    if let Some(clock) = info.clock.as_mut().filter(|_| has_stamps) {
        clock.summary = summary;
    }
    info.episodes = Some(recording.episodes().len());
    info.notes.extend_from_slice(if has_stamps { recording.notes() } else { recording.notes_of_rows() });
    Ok(info)
}

/// Count, missing, least, sum and greatest of one column.
type Sums = (usize, usize, f64, f64, f64);

fn statistics(recording: &Recording, progress: &dyn Progress) -> Result<Vec<ColumnStatistics>, Error> {
    let mut blocks = Vec::new();
    for (episode, info) in recording.episodes().iter().enumerate() {
        blocks.extend((0..info.rows).step_by(BLOCK).map(|from| (episode, from..(from + BLOCK).min(info.rows))));
    }
    let mut totals: Vec<Sums> = vec![(0, 0, f64::INFINITY, 0.0, f64::NEG_INFINITY); recording.columns().len()];
    progress.stage("reading values");
    parallel_fold(
        blocks.len(),
        progress,
        |i| {
            let (episode, rows) = blocks[i].clone();
            let block = recording.read_block(episode, rows, Halo::default())?;
            Ok::<_, Error>((0..block.columns.len()).map(|c| sums(block.core(c))).collect::<Vec<Sums>>())
        },
        |block| {
            for (total, block_total) in totals.iter_mut().zip(block) {
                *total = (
                    total.0 + block_total.0,
                    total.1 + block_total.1,
                    total.2.min(block_total.2),
                    total.3 + block_total.3,
                    total.4.max(block_total.4),
                );
            }
            Ok(())
        },
    )?;
    let finish = |(count, missing, min, sum, max): Sums| {
        let there = |value: f64| if count > 0 { value } else { f64::NAN };
        ColumnStatistics { count, missing, min: there(min), mean: there(sum / count.max(1) as f64), max: there(max) }
    };
    Ok(totals.into_iter().map(finish).collect())
}

fn sums(values: &[f64]) -> Sums {
    values.iter().fold((0, 0, f64::INFINITY, 0.0, f64::NEG_INFINITY), |(count, missing, min, sum, max), &value| {
        if value.is_nan() {
            (count, missing + 1, min, sum, max)
        } else {
            (count + 1, missing, min.min(value), sum + value, max.max(value))
        }
    })
}
