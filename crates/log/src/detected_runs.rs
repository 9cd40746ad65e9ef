//! Tables that look like the files of runs, a file a topic, with the `[files]` of a recipe for them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use crate::{FileInfo, RunFiles, Selection, TimeSpec, open_with_progress};

/// Tables that look like the files of runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DetectedRuns {
    /// The runs.
    pub runs: Vec<RunFiles>,
    /// Topics and the patterns of their files, as in `[files]`.
    pub patterns: Vec<(String, String)>,
}

impl DetectedRuns {
    /// Looks at files of one call: every folder, its subfolders included, has as many tables of different columns. `None` where that is not so, or where ranges of clocks
    /// that are known do not overlap.
    pub fn among(infos: &[FileInfo]) -> Option<Self> {
        if infos.iter().any(|info| info.format.is_log() || info.clock.is_none()) {
            return None;
        }
        groupings(infos)?.iter().find_map(|folders| Self::of(infos, folders))
    }

    /// The same, where it is known which folders are those of runs.
    fn of(infos: &[FileInfo], folders: &Folders<'_>) -> Option<Self> {
        let is_run = |files: &Vec<&FileInfo>| files.len() > 1 && differ(files) && overlap(files);
        let (folder, first) = folders.iter().next().filter(|_| folders.values().all(is_run))?;
        // Subfolders of one folder may be recordings of their own, some of which have a column more.
        if folders.len() == 1 && first.iter().any(|info| info.path.parent() != Some(folder)) && !are_apart(first) {
            return None;
        }
        let named: Vec<Named<'_>> = first.iter().map(|info| Named::of(&info.path, folder)).collect::<Option<_>>()?;
        let words: BTreeSet<&str> = named.iter().map(|named_file| named_file.word).collect();
        let mut patterns: Vec<(String, String)> = Vec::new();
        for Named { folders: below, name, word, ending } in &named {
            let place = below.iter().map(|part| format!("{part}/")).collect::<String>();
            let within = Path::new(&place).join(name);
            let everywhere = folders.keys().all(|folder| infos.iter().any(|info| info.path == folder.join(&within)));
            let place = glob::Pattern::escape(&place);
            let pattern = match everywhere {
                true => format!("{place}{}", glob::Pattern::escape(name)),
                false => format!("{place}{}*.{ending}", glob::Pattern::escape(word)),
            };
            // The folder distinguishes files of equal names.
            let described =
                if words.len() < named.len() && !below.is_empty() { below.join("_") } else { (*word).to_owned() };
            let topic: String =
                described.chars().map(|c| if c.is_alphanumeric() || c == '_' { c } else { '_' }).collect();
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

    /// Returns true if the stamps of the files of the first run overlap: their rows are read once.
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

/// The files of every folder that may be that of a run.
type Folders<'a> = BTreeMap<PathBuf, Vec<&'a FileInfo>>;

/// Candidate folders of runs: those that files lie in, else folders above them, the lowest first.
fn groupings(infos: &[FileInfo]) -> Option<Vec<Folders<'_>>> {
    let parents: Vec<&Path> = infos.iter().map(|info| info.path.parent()).collect::<Option<_>>()?;
    let all = |folder: &dyn Fn(&Path) -> PathBuf| {
        let mut folders = Folders::new();
        infos.iter().zip(&parents).for_each(|(info, parent)| folders.entry(folder(parent)).or_default().push(info));
        folders
    };
    let first = parents.first()?;
    let shared = first.ancestors().find(|folder| parents.iter().all(|parent| parent.starts_with(folder)))?;
    let depth = |folder: &Path| folder.components().count();
    let deepest = parents.iter().map(|parent| depth(parent)).min()?;
    let above = (depth(shared)..=deepest).rev();
    let above = above.map(|levels| all(&|parent| parent.components().take(levels).collect()));
    Some(std::iter::once(all(&|parent| parent.to_path_buf())).chain(above).collect())
}

/// Parts of the name of a run's file.
struct Named<'a> {
    /// Folders below that of the run.
    folders: Vec<&'a str>,
    name: &'a str,
    /// The name without its ending and the number before that.
    word: &'a str,
    ending: &'a str,
}

impl<'a> Named<'a> {
    fn of(path: &'a Path, folder: &Path) -> Option<Self> {
        let mut folders: Vec<&str> =
            path.strip_prefix(folder).ok()?.iter().map(|part| part.to_str()).collect::<Option<_>>()?;
        let name = folders.pop()?;
        let (stem, ending) = name.split_once('.')?;
        let word = stem.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(['_', '-']);
        Some(Self { folders, name, word: if word.is_empty() { stem } else { word }, ending })
    }
}

/// The columns of every file, clocks left out.
fn columns(files: &[&FileInfo]) -> Vec<BTreeSet<String>> {
    let of = |info: &FileInfo| {
        let clock = info.clock.as_ref();
        let is_clock =
            |name: &str| clock.is_some_and(|clock| clock.column == name || clock.beside.as_deref() == Some(name));
        let names = info.columns.iter().map(|column| column.name.clone());
        names.filter(|name| !is_clock(name)).collect::<BTreeSet<String>>()
    };
    files.iter().map(|info| of(info)).collect()
}

/// Not all files have the same columns: files that have are recordings of one kind, and no topics.
fn differ(files: &[&FileInfo]) -> bool {
    columns(files).into_iter().collect::<BTreeSet<_>>().len() > 1
}

/// No file has all columns of another.
fn are_apart(files: &[&FileInfo]) -> bool {
    let columns = columns(files);
    let mut pairs = columns.iter().enumerate().flat_map(|(at, a)| columns[at + 1..].iter().map(move |b| (a, b)));
    pairs.all(|(a, b)| !a.is_subset(b) && !b.is_subset(a))
}

/// Returns true if the ranges of the clocks overlap, as far as they are known.
fn overlap(files: &[&FileInfo]) -> bool {
    let known = files.iter().filter_map(|info| info.clock.as_ref()?.summary);
    meet(&known.map(|clock| (clock.start, clock.end)).collect::<Vec<_>>())
}

/// Returns true if some moment is in all spans.
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
