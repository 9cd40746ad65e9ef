//! A scan into a file: appended to, resumed, and whole at every moment.

use std::{
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Progress, unstoppable};
use fleetfoot_dataset::{
    Logs,
    content::{Hashed, hash_logs},
};
use fleetfoot_output::{WriteLock, check_outputs, is_stream};
use fleetfoot_recipe::Recipe;

use super::{ScanOptions, ScanReport, Sizes, StatisticError, StatisticFile, scan::Scan};
use crate::error::Error;

/// Output of a scan, and treatment of an existing file.
#[derive(Debug, Clone, Default)]
pub struct ScanTarget {
    /// The `.stats` file.
    pub output: PathBuf,
    /// A `.stats` file whose plan is used.
    pub plan: Option<PathBuf>,
    /// True to keep the output's content and use its plan.
    pub append: bool,
    /// True to replace the output's content.
    pub force: bool,
}

/// Result of a scan.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ScanOutcome {
    /// The statistic.
    pub file: StatisticFile,
    /// Counts and notes of the scan.
    pub report: ScanReport,
    /// True if the scan resumed an interrupted one.
    pub resumed: bool,
    /// Bytes of the output before, where it was appended to.
    pub before: Option<u64>,
    /// Sizes of the output.
    pub sizes: Sizes,
}

/// Scans files into a `.stats` file.
///
/// During the scan the complete part is kept beside the output as `OUTPUT.partial`. The same command resumes from it,
/// to the same bytes as without an interruption. Another command is refused, and so is a second one at the same time.
/// An output that is no file (a device, a pipe) is written at the end, and nothing is kept beside it.
///
/// # Errors
/// Those of [`scan`](super::scan()) and of reading and writing statistics. An output that exists, without `append` and
/// `force`. [`Error::Paused`] when the user stops it and something is kept.
pub fn scan_to(
    target: &ScanTarget,
    recipe: &Recipe,
    options: &ScanOptions,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<ScanOutcome, Error> {
    scan_in_groups(target, recipe, options, &logs.into(), progress, None)
}

pub(super) fn scan_in_groups(
    target: &ScanTarget,
    recipe: &Recipe,
    options: &ScanOptions,
    logs: &Logs,
    progress: &dyn Progress,
    group_rows: Option<usize>,
) -> Result<ScanOutcome, Error> {
    let partial = partial(&target.output);
    let mut read = logs.files();
    read.extend(target.plan.clone());
    check_outputs(&[&target.output, &partial], &read)?;
    let is_file = !is_stream(&target.output);
    let _lock = if is_file { Some(WriteLock::take(WriteLock::beside(&target.output), &target.output)?) } else { None };
    let exists = is_file && target.output.exists();
    if exists && !target.append && !target.force {
        return Err(StatisticError::Exists { path: target.output.clone() }.into());
    }
    let (base, before, whose) = match &target.plan {
        _ if target.append && exists => {
            let (file, sizes) = StatisticFile::read_with_sizes(&target.output)?;
            (Some(file), Some(sizes), target.output.display().to_string())
        }
        Some(plan) => (Some(StatisticFile::read(plan)?.without_rows()), None, plan.display().to_string()),
        None => (None, None, target.output.display().to_string()),
    };
    let hashed = hash_logs(logs, recipe, progress)?;
    let command = command(target, recipe, options, &hashed, base.as_ref());
    let unfinished = base.as_ref().is_some_and(StatisticFile::is_partial);
    let partial_file = interrupted(&partial, command, target.force)?;
    let resumed = partial_file.is_some();
    let mut scan = Scan::new(recipe, options, partial_file.or(base), &whose);
    scan.group_rows = group_rows.unwrap_or(scan.group_rows);
    // Kept whenever a quarter more is done: all the writing together is a few times the last one's.
    let mut kept = rows(scan.file.as_ref());
    let done = scan.run(hashed, progress, &mut |file| {
        let now = rows(Some(file));
        if is_file && now - kept >= (kept / 4).max(1) {
            file.command = Some(command);
            file.write(&partial)?;
            kept = now;
        }
        Ok(())
    });
    if let Err(error) = done {
        if is_file
            && rows(scan.file.as_ref()) > kept
            && let Some(file) = &mut scan.file
        {
            file.command = Some(command);
            unstoppable(|| file.write(&partial))?;
        }
        return Err(if progress.cancelled() && partial.exists() { Error::Paused { path: partial } } else { error });
    }
    let changed = resumed || unfinished || scan.report.files > 0;
    let (file, report) = scan.finish()?;
    let sizes = match &before {
        Some(sizes) if !changed => sizes.clone(),
        _ => file.write(&target.output)?,
    };
    if partial.exists() {
        fs::remove_file(&partial).map_err(|source| fleetfoot_dataset::Error::Write { path: partial, source })?;
    }
    Ok(ScanOutcome { file, report, resumed, before: before.map(|sizes| sizes.total), sizes })
}

fn rows(file: Option<&StatisticFile>) -> u64 {
    file.map_or(0, |file| file.episodes.iter().map(|episode| episode.rows).sum())
}

/// `run.stats.partial`.
pub(super) fn partial(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".partial");
    name.into()
}

/// Statistic that an interrupted scan of the same command left.
fn interrupted(partial: &Path, command: [u8; 32], force: bool) -> Result<Option<StatisticFile>, Error> {
    if !partial.exists() {
        return Ok(None);
    }
    match StatisticFile::read(partial) {
        Ok(file) if file.command == Some(command) => Ok(Some(file)),
        _ if force => Ok(None),
        Ok(_) => Err(StatisticError::OtherCommand { path: partial.to_owned() }.into()),
        Err(error) => Err(error.into()),
    }
}

/// All that decides about the bytes of the output.
fn command(
    target: &ScanTarget,
    recipe: &Recipe,
    options: &ScanOptions,
    files: &[Hashed],
    base: Option<&StatisticFile>,
) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(env!("CARGO_PKG_VERSION").as_bytes());
    part(recipe.to_toml().as_bytes());
    part(&[u8::from(target.append), u8::from(target.plan.is_some())]);
    part(&options.chunk_rows.map_or(0, |rows| rows.get() as u64).to_le_bytes());
    for key in &options.keys {
        part(key.text().as_bytes());
    }
    part(b"files");
    for file in files {
        part(file.path().as_os_str().as_encoded_bytes());
        part(&file.hash.0);
    }
    if let Some(base) = base {
        part(base.plan_hash().as_bytes());
        part(&(base.chunks() as u64).to_le_bytes());
        base.files.iter().for_each(|file| part(&file.hash.0));
        base.episodes.iter().for_each(|episode| part(&episode.id.0.to_le_bytes()));
    }
    *hasher.finalize().as_bytes()
}
