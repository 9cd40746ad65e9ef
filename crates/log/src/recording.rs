//! A recording: the episodes of many files behind one source.

use std::{
    collections::{BTreeSet, HashMap},
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
};

use arrow_buffer::ArrowNativeType;
use fleetfoot_data::{
    Block, Column, ColumnKind, Episode, EpisodeId, Fingerprint, Halo, Mark, Progress, ScalarBuffer, Silent, Source,
    parallel_map,
};

use crate::{
    Base, ClockSummary, Error, Format, LabelRule, MaxGap, Selection, TimeSpec, agreement, arrays, channels,
    column_set::{self, ColumnSet},
    csv,
    cycles::Turns,
    index,
    index::{FileIndex, Span},
    memory::{self, Log},
    naming::{episode_names, labels},
    notes::Notes,
    opened::Opened,
    parquet,
    paths::distinct,
    resample,
    row_mask::RowMask,
    run, splits,
    store::Budget,
    table::{Table, TableRows},
    time_column::{self, Agreed, Chosen},
};

/// Files opened for reading: their episodes, and rows on demand.
///
/// Episodes stand in the order of the files' paths and, within a file, of its rows. A file begins an episode; so does a stamp before its
/// predecessor, and a gap larger than [`Selection::max_gap`] allows. Rows with the very stamp of their predecessor and rows without a readable
/// stamp are left out and counted in [`Recording::notes`].
///
/// A copy shares the decoded rows.
#[derive(Clone)]
pub struct Recording {
    columns: Vec<Column>,
    pub(crate) episodes: Vec<Episode>,
    pub(crate) places: Vec<Place>,
    files: Vec<RecordedFile>,
    notes: Vec<String>,
    row_notes: Vec<String>,
    pub(crate) dt: Option<f64>,
    without_clock: bool,
}

impl std::fmt::Debug for Recording {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let files: Vec<&Path> = self.files.iter().map(|file| file.path.as_path()).collect();
        f.debug_struct("Recording")
            .field("files", &files)
            .field("columns", &self.columns)
            .field("episodes", &self.episodes)
            .finish()
    }
}

/// Place of an episode's rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) file: usize,
    /// Its first row, counted over the used rows of the file.
    pub(crate) first: usize,
}

#[derive(Clone)]
struct RecordedFile {
    /// Of a table in memory, its name.
    path: PathBuf,
    /// Files to read: the file, those that continue it, or those of a run; empty for a table.
    parts: Vec<PathBuf>,
    in_memory: bool,
    table: Arc<dyn Table>,
    mask: Arc<RowMask>,
    turns: Turns,
    clock: ClockSummary,
    log_offset: i64,
    /// For each column: this file's category codes to the recording's.
    recode: Vec<Option<Vec<f64>>>,
}

/// Opens files as one recording. See [`open_with_progress`].
pub fn open<P: AsRef<Path>>(paths: &[P], selection: &Selection) -> Result<Recording, Error> {
    open_with_progress(paths, selection, &Silent)
}

/// Opens files as one recording: reads their headers and stamps (text files wholly), finds the episodes and their identities.
///
/// The order of `paths` does not matter, and a file named twice counts once.
///
/// # Errors
/// Unreadable, damaged or empty files, missing or unsuitable columns, files that disagree about a column, no clock, and the same data twice.
pub fn open_with_progress<P: AsRef<Path>>(
    paths: &[P],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Recording, Error> {
    let logs: Vec<Log> = paths.iter().map(|path| Log::File(path.as_ref().to_path_buf())).collect();
    open_logs(&logs, selection, progress)
}

/// Opens files and tables in memory as one recording ([`open_with_progress`]): the files in the order of their paths, then the tables as they are given.
///
/// # Errors
/// As [`open_with_progress`].
pub fn open_logs(logs: &[Log], selection: &Selection, progress: &dyn Progress) -> Result<Recording, Error> {
    let logs = in_order(logs);
    let agreed = agreement::agreed(&logs, selection, &Quiet { outer: progress })?;
    open_agreed(&logs, selection, &agreed, progress)
}

/// The same of files in their order, with what all files of a call say together.
pub(crate) fn open_agreed(
    logs: &[Log],
    selection: &Selection,
    agreed: &Agreed,
    progress: &dyn Progress,
) -> Result<Recording, Error> {
    check(logs, selection)?;
    let inner = Quiet { outer: progress };
    let splits = splits::joined(logs.to_vec(), &inner)?;
    let logs = &splits.logs;
    let selection = Selection { columns: without_repeats(&selection.columns), ..selection.clone() };
    let budget = Arc::new(Budget::new(selection.memory_budget));
    let cache = Arc::new(parquet::Cursors::new(selection.columns.len() + 1));
    progress.stage("opening files");
    let paths: Vec<PathBuf> = logs.iter().map(|log| log.path().to_path_buf()).collect();
    let opened = parallel_map(logs.len(), progress, |i| {
        let opened = match &logs[i] {
            Log::Run(run) => {
                let open = |path: &Path, run_selection: &Selection| {
                    let opened = open_file(path, &[], run_selection, agreed, &budget, &cache, &inner)?;
                    index_file(path, &opened, run_selection, &inner)?;
                    Ok(opened)
                };
                return run::open(run, &selection, &open, &budget, &inner);
            }
            Log::File(path) => open_file(path, splits.further(path), &selection, agreed, &budget, &cache, &inner)?,
            Log::Table(table) => memory::open(table, &selection, agreed)?,
        };
        match selection.join.base {
            // The topics of a robot's log are joined at that rate already.
            Some(Base::Rate(hz)) if opened.stamp.is_none() => {
                let path = &paths[i];
                if opened.time_column.is_none() {
                    return Err(Error::RateWithoutClock { path: path.clone() });
                }
                index_file(path, &opened, &selection, &inner)?;
                resample::at_rate(path, opened, hz, &selection, &budget, &inner)
            }
            _ => Ok(opened),
        }
    })?;
    agree_on_clocks(&paths, &opened)?;
    let dispensable = matches!(selection.time, TimeSpec::Dispensable { .. });
    let without_clock = dispensable && opened.iter().any(|file| file.time_column.is_none());
    let time = if without_clock { TimeSpec::Uniform { dt_seconds: 1.0 } } else { selection.time.clone() };
    let selection = Selection { time, ..selection };
    let tables: Vec<_> =
        paths.iter().zip(&opened).map(|(path, opened)| (path.as_path(), opened.table.columns())).collect();
    let ColumnSet { columns, recode } = column_set::join(&tables)?;

    progress.stage("finding episodes");
    let indices = parallel_map(paths.len(), progress, |i| index_file(&paths[i], &opened[i], &selection, &inner))?;

    let mut recording = Recording {
        columns,
        episodes: Vec::new(),
        places: Vec::new(),
        files: Vec::with_capacity(paths.len()),
        notes: Vec::new(),
        row_notes: Vec::new(),
        dt: match selection.time {
            TimeSpec::Uniform { dt_seconds } => Some(dt_seconds),
            _ => None,
        },
        without_clock,
    };
    let mut spans = Vec::new();
    let mut all_notes = Notes::default();
    for (((path, opened), FileIndex { mask, turns, spans: file_spans, clock }), recode) in
        paths.into_iter().zip(opened).zip(indices).zip(recode)
    {
        let mut notes = opened.notes;
        notes.extend(opened.time_column.as_deref().and_then(|column| turns.note(column)));
        all_notes.add_file(&path, &notes, &clock, &file_spans);
        let file = recording.files.len();
        spans.extend(file_spans.into_iter().map(|span| (file, span)));
        recording.files.push(RecordedFile {
            parts: match &logs[file] {
                Log::File(path) => [path.clone()].into_iter().chain(splits.further(path).iter().cloned()).collect(),
                Log::Run(run) => run.files.iter().map(|(_, path)| path.clone()).collect(),
                Log::Table(_) => Vec::new(),
            },
            path,
            in_memory: logs[file].file().is_none(),
            table: Arc::from(opened.table),
            mask: Arc::new(mask),
            turns,
            clock,
            log_offset: opened.log_offset,
            recode,
        });
    }
    (recording.notes, recording.row_notes) = (all_notes.all(), all_notes.of_rows());
    recording.add_episodes(spans, &selection.label_rules, progress)?;
    if !selection.allow_duplicates {
        refuse_duplicates(&recording.episodes)?;
    }
    Ok(recording)
}

/// Every file once, in the order of the paths, then the runs in that of their folders, before the tables.
fn in_order(logs: &[Log]) -> Vec<Log> {
    let file = |log: &Log| if let Log::File(path) = log { Some(path.clone()) } else { None };
    let files = distinct(logs.iter().filter_map(file).collect());
    let mut runs: Vec<&Log> = logs.iter().filter(|log| matches!(log, Log::Run(_))).collect();
    runs.sort_by_key(|run| run.path());
    let tables = logs.iter().filter(|log| matches!(log, Log::Table(_)));
    files.into_iter().map(Log::File).chain(runs.into_iter().chain(tables).cloned()).collect()
}

fn check(logs: &[Log], selection: &Selection) -> Result<(), Error> {
    if logs.is_empty() {
        return Err(Error::NoFiles);
    }
    let positive = |what, seconds: f64| {
        if seconds > 0.0 && seconds < 1e9 { Ok(()) } else { Err(Error::BadSeconds { what, seconds }) }
    };
    if let TimeSpec::Uniform { dt_seconds } = selection.time {
        positive("sampling period", dt_seconds)?;
    }
    if let MaxGap::Seconds(seconds) = selection.max_gap {
        positive("largest gap", seconds)?;
    }
    for rule in &selection.label_rules {
        glob::Pattern::new(&rule.pattern)
            .map_err(|problem| Error::Pattern { pattern: rule.pattern.clone(), problem: problem.to_string() })?;
    }
    Ok(())
}

fn without_repeats(names: &[String]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    names.iter().filter(|name| seen.insert(name.as_str())).cloned().collect()
}

fn open_file(
    path: &Path,
    further: &[PathBuf],
    selection: &Selection,
    agreed: &Agreed,
    budget: &Arc<Budget>,
    cache: &Arc<parquet::Cursors>,
    progress: &dyn Progress,
) -> Result<Opened, Error> {
    match Format::of(path) {
        Some(Format::Parquet) => parquet::open(path, selection, agreed, cache),
        Some(format @ (Format::Npy | Format::Npz | Format::Mat)) => arrays::open(path, format, selection, agreed),
        Some(Format::Csv(compression)) => csv::open(path, compression, selection, agreed, budget),
        Some(format) => {
            let mut opened = channels::open(path, format, further, selection, budget, cache, progress)?;
            if let Some(last) = further.last() {
                let (files, last) = (1 + further.len(), last.file_name().unwrap_or_default().to_string_lossy());
                opened
                    .notes
                    .push(format!("its recorder split it into {files} files, up to {last}, which are read as one"));
            }
            Ok(opened)
        }
        None => Err(Error::UnknownFormat { path: path.into() }),
    }
}

/// Logs that were left to choose their clock must have chosen the same.
fn agree_on_clocks(paths: &[PathBuf], opened: &[Opened]) -> Result<(), Error> {
    let mut chosen = paths.iter().zip(opened).filter_map(|(path, opened)| Some((path, opened.stamp?)));
    let Some((first, stamp)) = chosen.next() else {
        return Ok(());
    };
    match chosen.find(|(_, other)| *other != stamp) {
        None => Ok(()),
        Some((second, other)) => Err(Error::ClocksDisagree {
            first: first.clone(),
            first_is: stamp.name(),
            second: second.clone(),
            second_is: other.name(),
        }),
    }
}

fn index_file(
    path: &Path,
    opened: &Opened,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<FileIndex, Error> {
    let table = opened.table.as_ref();
    if table.rows() == 0 {
        return Err(Error::NoRows { path: path.into() });
    }
    if let TimeSpec::Uniform { dt_seconds } = selection.time {
        return index::uniform(path, table.rows(), dt_seconds, &opened.sessions);
    }
    let index = index::build(table, selection.max_gap, &opened.breaks, opened.cycle, progress)?;
    if index.spans.is_empty() {
        let column = opened.time_column.clone().unwrap_or_default();
        return Err(Error::NoStamps { path: path.into(), rows: table.rows(), column });
    }
    check_rising(path, opened, &index.clock)?;
    Ok(index)
}

/// A column that nobody named is a clock only if it rises: over all rows where its values chose it, else but for new episodes and rows that came twice.
fn check_rising(path: &Path, opened: &Opened, clock: &ClockSummary) -> Result<(), Error> {
    let steps = (clock.rows - clock.missing).saturating_sub(1);
    let rising = steps.saturating_sub(clock.backward + clock.repeated);
    let is_clock = match opened.chosen {
        Chosen::Caller => true,
        Chosen::Name => time_column::rises(rising, clock.backward, steps),
        Chosen::Values => rising == steps,
    };
    let column = opened.time_column.clone().unwrap_or_default();
    if is_clock { Ok(()) } else { Err(Error::ClockFalls { path: path.into(), column, rising, steps }) }
}

/// Hands on the wish to stop, and no counts: those of inner work would mix with the outer ones.
struct Quiet<'a> {
    outer: &'a dyn Progress,
}

impl Progress for Quiet<'_> {
    fn advance(&self, _units: usize, _total: usize) {}

    fn cancelled(&self) -> bool {
        self.outer.cancelled()
    }
}

impl Recording {
    /// Returns true if no stamps are known ([`TimeSpec::Dispensable`]): rows are in their order, and seconds mean
    /// nothing.
    pub fn without_clock(&self) -> bool {
        self.without_clock
    }

    /// Notes for the user: assumptions made, rows left out, and the cutting of files into episodes.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// [`Recording::notes`] without where episodes begin: what there is to say of files that have no stamps.
    pub fn notes_of_rows(&self) -> &[String] {
        &self.row_notes
    }

    /// The files, in the order of their episodes, with what their stamps look like.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &ClockSummary)> {
        self.files.iter().map(|file| (file.path.as_path(), &file.clock))
    }

    /// Offset to add to an episode's stamps for the times at which a robot's log recorded them, nanoseconds; 0 for
    /// tables.
    pub fn log_offset(&self, episode: usize) -> i64 {
        self.files[self.places[episode].file].log_offset
    }

    /// The path of the file that an episode comes from; of a table in memory its name.
    pub fn origin(&self, episode: usize) -> &Path {
        &self.files[self.places[episode].file].path
    }

    /// The files that an episode's log is read from: one, or those of a run or of a recording that was split; none of a table in memory.
    pub fn files_of(&self, episode: usize) -> &[PathBuf] {
        &self.files[self.places[episode].file].parts
    }

    pub(crate) fn add_episodes(
        &mut self,
        spans: Vec<(usize, Span)>,
        rules: &[LabelRule],
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let paths: Vec<&Path> = self.files.iter().map(|file| file.path.as_path()).collect();
        let owners: Vec<usize> = spans.iter().map(|(file, _)| *file).collect();
        let names = episode_names(&paths, &owners);
        let mut fingerprints = Vec::with_capacity(spans.len());
        for ((file, span), name) in spans.into_iter().zip(names) {
            let RecordedFile { path, in_memory, .. } = &self.files[file];
            self.places.push(Place { file, first: span.first });
            self.episodes.push(Episode {
                id: EpisodeId(0),
                labels: labels(rules, path, &name),
                name,
                file: (!in_memory).then(|| path.clone()),
                rows: span.rows,
                start: span.start,
                end: span.end,
                period: span.period,
                marks: Vec::new(),
            });
            fingerprints.push(span.fingerprint);
        }
        progress.stage("identifying episodes");
        let texts: Vec<Option<Vec<f64>>> = self.columns.iter().map(|column| category_digests(&column.kind)).collect();
        let ids = parallel_map(fingerprints.len(), progress, |e| self.identify(e, fingerprints[e].clone(), &texts))?;
        for (episode, (id, marks)) in self.episodes.iter_mut().zip(ids) {
            (episode.id, episode.marks) = (id, marks);
        }
        Ok(())
    }

    /// Finishes an episode's fingerprint with samples of its values, and marks some of its rows. Categories go in by name: their codes depend on the other files.
    fn identify(
        &self,
        episode: usize,
        fingerprint: Fingerprint,
        texts: &[Option<Vec<f64>>],
    ) -> Result<(EpisodeId, Vec<Mark>), Error> {
        fingerprint.identify(&self.columns, self.episodes[episode].rows, |rows| {
            let mut block = self.read_block(episode, rows, Halo::default())?;
            for (column, digests) in block.columns.iter_mut().zip(texts) {
                if let Some(digests) = digests {
                    *column = recode(column, digests);
                }
            }
            Ok(block)
        })
    }

    pub(crate) fn read_block(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let info = &self.episodes[episode];
        let Place { file, first } = self.places[episode];
        let before = halo.before.min(rows.start);
        let after = halo.after.min(info.rows - rows.end);
        let all = rows.start - before..rows.end + after;
        let mut block = Block {
            first: rows.start,
            before,
            rows: rows.len(),
            after,
            start: info.start,
            time: ScalarBuffer::from(Vec::new()),
            columns: vec![ScalarBuffer::from(Vec::new()); self.columns.len()],
        };
        if all.is_empty() {
            return Ok(block);
        }
        let file = &self.files[file];
        let (from, to) = (file.mask.place(first + all.start), file.mask.place(first + all.end - 1) + 1);
        let TableRows { time, mut columns } = file.table.values(from..to, halo.before + halo.after)?;
        let mut time = file.turns.add(from..to, time);
        if to - from != all.len() {
            let used: Vec<bool> = (from..to).map(|row| !file.mask.is_dropped(row)).collect();
            time = keep(&time, &used);
            columns = columns.iter().map(|column| keep(column, &used)).collect();
        }
        for (column, codes) in columns.iter_mut().zip(&file.recode) {
            if let Some(codes) = codes {
                *column = recode(column, codes);
            }
        }
        block.time = match self.dt {
            Some(dt) => index::uniform_stamps(all, dt),
            None => time,
        };
        block.columns = columns;
        Ok(block)
    }
}

impl Source for Recording {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, fleetfoot_data::Error> {
        self.episodes[episode].check(&rows)?;
        Ok(self.read_block(episode, rows, halo)?)
    }
}

/// The values whose row is used.
fn keep<T: ArrowNativeType>(values: &ScalarBuffer<T>, used: &[bool]) -> ScalarBuffer<T> {
    values.iter().zip(used).filter(|(_, used)| **used).map(|(&value, _)| value).collect::<Vec<T>>().into()
}

/// Codes to what stands for them; NaN stays NaN.
fn recode(values: &[f64], table: &[f64]) -> ScalarBuffer<f64> {
    let look_up = |&code: &f64| {
        if code >= 0.0 { table.get(code as usize).copied().unwrap_or(f64::NAN) } else { f64::NAN }
    };
    values.iter().map(look_up).collect::<Vec<f64>>().into()
}

/// A number for each category that depends on its name alone.
fn category_digests(kind: &ColumnKind) -> Option<Vec<f64>> {
    let ColumnKind::Category(names) = kind else {
        return None;
    };
    let digest = |name: &String| {
        let mut bytes = [0u8; 8];
        bytes.copy_from_slice(&blake3::hash(name.as_bytes()).as_bytes()[..8]);
        // 52 bits are a whole number that f64 holds exactly.
        (u64::from_le_bytes(bytes) >> 12) as f64
    };
    Some(names.iter().map(digest).collect())
}

pub(crate) fn refuse_duplicates(episodes: &[Episode]) -> Result<(), Error> {
    let mut seen: HashMap<EpisodeId, &str> = HashMap::new();
    for episode in episodes {
        if let Some(first) = seen.insert(episode.id, &episode.name) {
            return Err(Error::Duplicate { first: first.into(), second: episode.name.clone() });
        }
    }
    Ok(())
}
