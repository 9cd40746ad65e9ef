//! From files and a recipe to a statistic: one pass, file by file, on top of what is there.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    num::NonZeroUsize,
    path::Path,
};

use fleetfoot_data::setting::INFO_VALUES;
use fleetfoot_data::{Column, Episode, Progress, Source, Work, until_stopped};
use fleetfoot_dataset::{
    ContentHash, Dataset, EquationStatistic, FileRecord, Logs, StatisticFile,
    content::{Hashed, hash_logs},
    open::OpenedStructure,
    refuse_unprintable,
};
use fleetfoot_library::Expr;
use fleetfoot_recipe::Recipe;
use fleetfoot_stats::{FINE, Grid};
use fleetfoot_sums::structured::Plan;
use fleetfoot_task::{EquationTask, StructuredTask};

use super::{
    LabelKey,
    equations::{self, accepts_equations, unserved},
};
use crate::{error::Error, incomplete::incomplete_rows, not_finite::too_few, radial, subset::Subset};

/// Rows that are scanned between two moments at which the work can be kept.
const GROUP_ROWS: usize = 1 << 18;
/// Bytes that the statistics of all chunks should fit into.
const BUDGET: usize = 256 << 20;

/// Options of a scan.
#[derive(Debug, Clone, Default)]
pub struct ScanOptions {
    /// Labels from the files' paths; they stand above the recipe's.
    pub keys: Vec<LabelKey>,
    /// Rows of a chunk, at most; chosen by the number of rows when not given.
    pub chunk_rows: Option<NonZeroUsize>,
}

/// Counts and notes of a scan.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ScanReport {
    /// Files scanned.
    pub files: usize,
    /// Episodes scanned.
    pub episodes: usize,
    /// Rows scanned.
    pub rows: u64,
    /// Files and episodes that were there already, each with the reason.
    pub skipped: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Scans logs once. With `base` its plan is used and its rows are kept: files whose content it has, and episodes that it has, are skipped.
///
/// # Errors
/// Those of opening and reading files; a recipe that asks for something else than `base` holds; text where numbers are needed; no complete row.
pub fn scan(
    recipe: &Recipe,
    options: &ScanOptions,
    base: Option<StatisticFile>,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<(StatisticFile, ScanReport), Error> {
    let mut scan = Scan::new(recipe, options, base, "the statistic");
    scan.run(hash_logs(&logs.into(), recipe, progress)?, progress, &mut |_| Ok(()))?;
    scan.finish()
}

/// [`scan`] for `fit sparse` alone: without the sums of equations.
///
/// # Errors
/// As [`scan`].
pub(crate) fn scan_tasks(
    recipe: &Recipe,
    options: &ScanOptions,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<(StatisticFile, ScanReport), Error> {
    let mut scan = Scan { equations: false, ..Scan::new(recipe, options, None, "the statistic") };
    scan.run(hash_logs(logs, recipe, progress)?, progress, &mut |_| Ok(()))?;
    scan.finish()
}

/// The plan that a scan of these logs would freeze from a pilot sample of their rows, without any rows; and its
/// assumptions.
///
/// Scans that begin with it, wherever they run, go together.
///
/// # Errors
/// Those of opening files and of reading the sample; text where numbers are needed.
pub fn freeze(
    recipe: &Recipe,
    options: &ScanOptions,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<(StatisticFile, Vec<String>), Error> {
    let mut scan = Scan::new(recipe, options, None, "the plan");
    let files = scan.new_files(hash_logs(&logs.into(), recipe, progress)?);
    let logs: Logs = files.into_iter().map(|file| file.log).collect::<Vec<_>>().into();
    let opened = Dataset::for_scan(recipe, &logs, true, progress)?;
    Ok((scan.begin(&opened, progress)?, scan.report.notes))
}

/// [`scan`] of some of the logs of one scan, with the plan of `plan`, whose rows are left out. A part may be without a complete row.
///
/// Parts put together with [`StatisticFile::append`] in the order of their logs equal one scan of all, bit for bit.
///
/// # Errors
/// As [`scan`], a part without a complete row excepted.
pub fn scan_part(
    plan: &StatisticFile,
    options: &ScanOptions,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<(StatisticFile, ScanReport), Error> {
    let recipe = Recipe::parse(&plan.recipe, "the recipe of the plan")?;
    let mut scan = Scan::new(&recipe, options, Some(plan.without_rows()), "the plan");
    scan.run(hash_logs(&logs.into(), &recipe, progress)?, progress, &mut |_| Ok(()))?;
    let Scan { file, report, .. } = scan;
    Ok((file.unwrap_or_else(|| plan.without_rows()), report))
}

/// A scan under way.
pub(super) struct Scan<'a> {
    recipe: &'a Recipe,
    options: &'a ScanOptions,
    /// Statistic of the complete files.
    pub(super) file: Option<StatisticFile>,
    whose: String,
    pub(super) report: ScanReport,
    pub(super) group_rows: usize,
    /// True to sum the equations of the recipe, if there is no base that decides.
    equations: bool,
}

impl<'a> Scan<'a> {
    /// Continues from `base`, which messages call `whose`.
    pub(super) fn new(recipe: &'a Recipe, options: &'a ScanOptions, base: Option<StatisticFile>, whose: &str) -> Self {
        Self {
            recipe,
            options,
            file: base,
            whose: whose.to_owned(),
            report: ScanReport::default(),
            group_rows: GROUP_ROWS,
            equations: true,
        }
    }

    /// Scans the new files; `keep` is called whenever more files are complete.
    pub(super) fn run(
        &mut self,
        files: Vec<Hashed>,
        progress: &dyn Progress,
        keep: &mut dyn FnMut(&mut StatisticFile) -> Result<(), Error>,
    ) -> Result<(), Error> {
        radial::refuse(self.recipe, "scan")?;
        if let (Some(file), Some(first)) = (&self.file, files.first()) {
            // Told before the files are opened, which may take long, and also when all of them are there already.
            let (recipe, fields, task) = Dataset::structure(self.recipe, &vec![first.log.clone()].into())?;
            file.accepts_rows(self.recipe, &self.whose)?;
            file.accepts_chunks(&task, self.options.chunk_rows.map(Into::into), &self.whose, "the recipe")?;
            accepts_equations(file, &recipe, &fields, [&self.whose, "the recipe"])?;
        }
        let files = self.new_files(files);
        if files.is_empty() {
            return Ok(());
        }
        let logs: Logs = files.iter().map(|file| file.log.clone()).collect::<Vec<_>>().into();
        let equations = self.file.as_ref().map_or(self.equations, |file| file.equations.is_some());
        let opened = Dataset::for_scan(self.recipe, &logs, equations, progress)?;
        let mut file = self.begin(&opened, progress)?;
        let before = file.scanned.counts().incomplete;
        let added = self.add(&mut file, &files, &opened.dataset, progress, keep);
        let counts = file.scanned.counts();
        let (incomplete, no_row) = (counts.incomplete - before, counts.complete == 0);
        self.file = Some(file);
        added?;
        let read = row_expressions(&opened.task).cloned().collect();
        self.report.notes.extend(incomplete_rows(incomplete, &opened.dataset, read)?);
        if no_row {
            self.report.notes.extend(too_few(&opened.dataset)?);
        }
        Ok(())
    }

    /// Takes the statistic of the complete files; else makes a plan from a pilot sample, without rows.
    fn begin(&mut self, opened: &OpenedStructure, progress: &dyn Progress) -> Result<StatisticFile, Error> {
        let OpenedStructure { dataset, task, recipe, fields, equations } = opened;
        self.report.notes.extend_from_slice(dataset.notes());
        if let Some(file) = self.file.take() {
            return Ok(file);
        }
        progress.stage("pilot");
        let view = dataset.view()?;
        let chunk_rows = self.options.chunk_rows.map_or_else(|| default_chunk(task, view.rows()), Into::into);
        let plan = Plan::new(task.regression.clone(), task.also.clone(), chunk_rows, &view)?;
        let mut file = StatisticFile::empty(plan, recipe, task, fields);
        match equations {
            None => {}
            Some(Err(error)) => self.report.notes.push(unserved(error)),
            Some(Ok(tasks)) => file.equations = self.freeze((recipe, fields), tasks, dataset, progress)?,
        }
        Ok(file)
    }

    /// The plan of the equations; `None` and a note where there can be none.
    fn freeze(
        &mut self,
        recipe: (&Recipe, &[Column]),
        tasks: &[EquationTask],
        dataset: &Dataset,
        progress: &dyn Progress,
    ) -> Result<Option<EquationStatistic>, Error> {
        let chunk_rows = self.options.chunk_rows.map(Into::into);
        let notes = &mut self.report.notes;
        let frozen = equations::freeze(recipe, tasks, (dataset, chunk_rows), notes, progress);
        match frozen.and_then(|equations| refuse_unprintable(&equations).map(|()| equations).map_err(Error::from)) {
            Ok(equations) => Ok(Some(equations)),
            Err(error) if progress.cancelled() => Err(error),
            Err(error) => {
                self.report.notes.push(unserved(&error));
                Ok(None)
            }
        }
    }

    /// The files whose content is not there yet, each content once.
    fn new_files(&mut self, files: Vec<Hashed>) -> Vec<Hashed> {
        let mut known: HashMap<ContentHash, String> =
            self.file.iter().flat_map(|file| &file.files).map(|file| (file.hash, file.name.clone())).collect();
        let mut new = Vec::new();
        for file in files {
            let name = file.path().to_string_lossy().into_owned();
            match known.get(&file.hash) {
                Some(same) if *same == name => {
                    self.report.skipped.push(format!("{name}: the statistic has it already"))
                }
                Some(same) => self.report.skipped.push(format!("{name}: the same content as {same}")),
                None => {
                    known.insert(file.hash, name);
                    new.push(file);
                }
            }
        }
        new
    }

    fn add(
        &mut self,
        file: &mut StatisticFile,
        files: &[Hashed],
        dataset: &Dataset,
        progress: &dyn Progress,
        keep: &mut dyn FnMut(&mut StatisticFile) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let view = &dataset.view()?;
        let logs = self.logs(file, files, dataset)?;
        let pending = logs.iter().flat_map(|log| &log.pending).map(|(episode, ..)| view.episodes()[*episode].rows);
        let whole = Whole { outer: progress, total: pending.map(|rows| chunks_of(file, rows)).sum() };
        progress.stage("scan");
        for group in groups(&logs, view.episodes(), self.group_rows) {
            let episodes: Vec<usize> =
                group.iter().flat_map(|log| &log.pending).map(|(episode, ..)| *episode).collect();
            let subset = Subset::new(view, episodes);
            // A stop keeps the complete files.
            let (scanned, sums) = until_stopped(|| {
                let scanned = file.plan.scan(&subset, &whole)?;
                let sums = file.equations.as_ref().map(|equations| equations.sum_rows(&subset, &whole)).transpose()?;
                Ok::<_, Error>((scanned, sums))
            })??;
            file.scanned.merge(scanned)?;
            if let (Some(equations), Some(sums)) = (&mut file.equations, sums) {
                equations.add(sums)?;
            }
            for log in group {
                self.report.files += 1;
                let Hashed { log: read, hash, bytes } = &files[log.file];
                let name = read.path().to_string_lossy().into_owned();
                file.files.push(FileRecord { name, hash: *hash, bytes: *bytes });
                for (episode, number, labels) in &log.pending {
                    let episode = &view.episodes()[*episode];
                    self.report.episodes += 1;
                    self.report.rows += episode.rows as u64;
                    file.add_episode(episode, *hash, *number, labels.clone());
                }
            }
            file.arrange();
            keep(file)?;
        }
        Ok(())
    }

    /// The episodes of every file that are not there yet.
    fn logs(&mut self, known: &StatisticFile, files: &[Hashed], dataset: &Dataset) -> Result<Vec<Pending>, Error> {
        let mut logs: Vec<Pending> = (0..files.len()).map(|file| Pending { file, pending: Vec::new() }).collect();
        let places: HashMap<&Path, usize> = files.iter().enumerate().map(|(at, file)| (file.path(), at)).collect();
        let episodes = dataset.episodes();
        let place = |episode: usize| places.get(dataset.origin(episode)).copied().unwrap_or(0);
        let mut counts = vec![0_u32; files.len()];
        (0..episodes.len()).for_each(|episode| counts[place(episode)] += 1);
        let mut numbers = vec![0_u32; files.len()];
        for (index, episode) in episodes.iter().enumerate() {
            let at = place(index);
            numbers[at] += 1;
            if let Some(same) = known.episode(episode.id) {
                self.report.skipped.push(format!("{}: the same rows as {}", episode.name, same.name));
                continue;
            }
            let mut labels = episode.labels.clone();
            for key in &self.options.keys {
                labels.insert(key.name().to_owned(), key.value(files[at].path())?);
            }
            logs[at].pending.push((index, if counts[at] > 1 { numbers[at] } else { 0 }, labels));
        }
        Ok(logs)
    }

    /// Ends the scan with its statistic and report.
    pub(super) fn finish(self) -> Result<(StatisticFile, ScanReport), Error> {
        let Self { file, mut report, .. } = self;
        let Some(mut file) = file else { return Err(Error::missing("no file is given".into())) };
        file.command = None;
        let counts = file.scanned.counts();
        if counts.complete == 0 {
            let reasons: String = report.notes.iter().map(|note| format!("; {note}")).collect();
            return Err(Error::too_few_rows(
                0,
                1,
                format!(
                    "no row can be used: {} lack neighbours at the border of their episode, {} have a missing value; look at the columns with \
                 {INFO_VALUES}, or give other files{reasons}",
                    counts.at_border, counts.incomplete
                ),
            ));
        }
        let empty: Vec<&str> = file
            .episodes
            .iter()
            .filter(|episode| file.scanned.rows.get(&episode.id).is_none_or(|rows| rows.complete == 0))
            .map(|episode| episode.name.as_str())
            .collect();
        if let Some(first) = empty.first() {
            report.notes.push(format!("{} episodes have no complete row, {first} among them", empty.len()));
        }
        Ok((file, report))
    }
}

/// The episodes of a file that are to be scanned: index, number within the file, labels.
struct Pending {
    file: usize,
    pending: Vec<(usize, u32, BTreeMap<String, String>)>,
}

/// Consecutive files of about `rows` rows in all.
fn groups<'l>(logs: &'l [Pending], episodes: &[Episode], rows: usize) -> Vec<&'l [Pending]> {
    let (mut groups, mut first, mut some) = (Vec::new(), 0, 0);
    for (at, log) in logs.iter().enumerate() {
        some += log.pending.iter().map(|(episode, ..)| episodes[*episode].rows).sum::<usize>();
        if some >= rows || at + 1 == logs.len() {
            groups.push(&logs[first..=at]);
            (first, some) = (at + 1, 0);
        }
    }
    groups
}

/// Rows of a chunk, by the bytes that the statistics of one chunk take.
pub(crate) fn default_chunk(task: &StructuredTask, rows: usize) -> usize {
    Grid::for_budget(rows, 1, chunk_bytes(task), BUDGET, FINE)
}

/// Bytes of the statistics of one chunk.
pub(super) fn chunk_bytes(task: &StructuredTask) -> usize {
    let numbers = |d: usize| d * (d + 1) / 2 + d + 8;
    let terms = |task: &fleetfoot_sums::structured::Task| task.terms.clone();
    let functions = |latent: usize| task.regression.latents[latent].functions.len();
    let tasks = task.regression.tasks.iter().map(|task| terms(task).iter().map(|term| functions(term.latent)).sum());
    8 * tasks.map(|columns: usize| numbers(columns + 1)).chain([numbers(task.also.len())]).sum::<usize>()
}

/// All expressions over the columns that a row needs.
pub(crate) fn row_expressions(task: &StructuredTask) -> impl Iterator<Item = &Expr> {
    let regression = &task.regression;
    let functions = regression.latents.iter().flat_map(|latent| &latent.functions);
    let tasks =
        regression.tasks.iter().flat_map(|task| task.terms.iter().map(|term| &term.coefficient).chain([&task.target]));
    functions.chain(tasks).chain(&regression.weight).chain(&task.also)
}

/// Chunks of an episode of so many rows, in all passes over it.
fn chunks_of(file: &StatisticFile, rows: usize) -> usize {
    let groups = file.equations.iter().flat_map(|equations| &equations.groups);
    let lengths: BTreeSet<usize> = groups.map(|group| group.plan.chunk_rows).collect();
    lengths.into_iter().chain([file.plan.chunk_rows]).map(|length| rows.div_ceil(length.max(1))).sum()
}

/// Progress of a part of the chunks, as progress of all.
struct Whole<'a> {
    outer: &'a dyn Progress,
    total: usize,
}

impl Progress for Whole<'_> {
    fn advance(&self, units: usize, _total: usize) {
        self.outer.advance(units, self.total);
    }

    fn cancelled(&self) -> bool {
        self.outer.cancelled()
    }

    fn expect(&self, work: Work) {
        self.outer.expect(work);
    }
}
