//! Tables that look like the files of runs, a file a topic: what `[files]` of a recipe would say of them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use crate::{FileInfo, RunFiles, Selection, TimeSpec, open_with_progress};

/// Tables that look like the files of runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundRuns {
    /// The runs.
    pub runs: Vec<RunFiles>,
    /// Topics and the patterns of their files, as in `[files]`.
    pub patterns: Vec<(String, String)>,
}

impl FoundRuns {
    /// Looks at files of one call: in every folder there are as many tables, of which none has the columns of another, beside its clock. `None` where that is not
    /// so, or where ranges of clocks that are known do not overlap.
    pub fn among(infos: &[FileInfo]) -> Option<Self> {
        let mut folders: BTreeMap<&Path, Vec<&FileInfo>> = BTreeMap::new();
        for info in infos {
            if info.format.is_log() || info.clock.is_none() {
                return None;
            }
            folders.entry(info.path.parent()?).or_default().push(info);
        }
        let is_run = |files: &Vec<&FileInfo>| files.len() > 1 && are_apart(files) && overlap(files);
        let first = folders.values().next().filter(|_| folders.values().all(is_run))?;
        let mut patterns: Vec<(String, String)> = Vec::new();
        for info in first {
            let name = info.path.file_name()?.to_str()?;
            let (stem, ending) = name.split_once('.')?;
            let word = stem.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(['_', '-']);
            let word = if word.is_empty() { stem } else { word };
            let everywhere = folders.keys().all(|folder| infos.iter().any(|own| own.path == folder.join(name)));
            let exact = glob::Pattern::escape(name);
            let pattern = if everywhere { exact } else { format!("{}*.{ending}", glob::Pattern::escape(word)) };
            let topic: String = word.chars().map(|c| if c.is_alphanumeric() || c == '_' { c } else { '_' }).collect();
            patterns.push((topic, pattern));
        }
        let topics: BTreeSet<&str> = patterns.iter().map(|(topic, _)| topic.as_str()).collect();
        if topics.len() < patterns.len() {
            return None;
        }
        let files: Vec<PathBuf> = infos.iter().map(|info| info.path.clone()).collect();
        let (runs, others) = RunFiles::group(&files, &patterns).ok()?;
        (others.is_empty() && runs.len() == folders.len()).then_some(Self { runs, patterns })
    }

    /// Whether the stamps of the files of the first run overlap: their rows are read once.
    pub fn share_a_clock(&self, progress: &dyn Progress) -> bool {
        let spans = self.runs.first().map_or(&[][..], |run| &run.files).iter().map(|(_, path)| span(path, progress));
        spans.collect::<Option<Vec<_>>>().is_some_and(|spans| meet(&spans))
    }

    /// The lines of `[files]`, in one.
    pub fn in_words(&self) -> String {
        let lines = self.patterns.iter().map(|(topic, pattern)| format!("{topic} = \"{pattern}\""));
        lines.collect::<Vec<_>>().join(", ")
    }
}

/// No file has all columns of another, clocks left out.
fn are_apart(files: &[&FileInfo]) -> bool {
    let columns = |info: &FileInfo| {
        let clock = info.clock.as_ref();
        let is_clock =
            |name: &str| clock.is_some_and(|clock| clock.column == name || clock.beside.as_deref() == Some(name));
        let names = info.columns.iter().map(|column| column.name.clone());
        names.filter(|name| !is_clock(name)).collect::<BTreeSet<String>>()
    };
    let columns: Vec<BTreeSet<String>> = files.iter().map(|info| columns(info)).collect();
    let mut pairs = columns.iter().enumerate().flat_map(|(at, a)| columns[at + 1..].iter().map(move |b| (a, b)));
    pairs.all(|(a, b)| !a.is_subset(b) && !b.is_subset(a))
}

/// Whether the ranges of the clocks overlap, as far as they are known.
fn overlap(files: &[&FileInfo]) -> bool {
    let known = files.iter().filter_map(|info| info.clock.as_ref()?.summary);
    meet(&known.map(|clock| (clock.start, clock.end)).collect::<Vec<_>>())
}

/// Whether some moment is in all spans.
fn meet(spans: &[(i64, i64)]) -> bool {
    let (start, end) = (spans.iter().map(|span| span.0).max(), spans.iter().map(|span| span.1).min());
    start.zip(end).is_none_or(|(start, end)| start < end)
}

/// The first and the last stamp of a table.
fn span(path: &Path, progress: &dyn Progress) -> Option<(i64, i64)> {
    let info = crate::inspect(path).ok()?;
    let clock = info.clock?.column;
    let column = info.columns.into_iter().find(|column| column.name != clock && column.unsupported.is_none())?;
    let selection = Selection { time: TimeSpec::Auto, ..Selection::new([column.name]) };
    let recording = open_with_progress(&[path], &selection, progress).ok()?;
    recording.files().next().map(|(_, clock)| (clock.start, clock.end))
}
