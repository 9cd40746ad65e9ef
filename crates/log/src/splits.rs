//! Recordings split into numbered files by their recorder, `run_0.mcap`, `run_1.mcap`, ...: read as one if each
//! continues the one before.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Progress, parallel_map};

use crate::{
    Error, Format, Log,
    container::{Container, Span, piece_spans},
    containers,
};

/// Nanoseconds between two files of a recording at most, if its messages come faster.
const LONGEST: f64 = 0.5e9;
/// Periods of the fastest topic between two files at most, if they are longer.
const PERIODS: f64 = 5.0;

/// Logs, and of those that were split the further files by the path of the first.
pub(crate) struct Joined {
    pub logs: Vec<Log>,
    pub further: BTreeMap<PathBuf, Vec<PathBuf>>,
}

impl Joined {
    /// The further files of a log.
    pub(crate) fn further(&self, path: &Path) -> &[PathBuf] {
        self.further.get(path).map_or(&[], Vec::as_slice)
    }
}

/// Joins the files that go on with those before them. The first file stands for all.
///
/// # Errors
/// A user who stops. What cannot be read stays alone, and opening it tells why.
pub(crate) fn joined(logs: Vec<Log>, progress: &dyn Progress) -> Result<Joined, Error> {
    let mut sets: BTreeMap<(PathBuf, String, String), BTreeMap<u64, PathBuf>> = BTreeMap::new();
    for path in logs.iter().filter_map(Log::file) {
        if let Some((number, set)) = numbered(path) {
            sets.entry(set).or_default().insert(number, path.to_path_buf());
        }
    }
    let mut further: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
    sets.retain(|_, files| files.len() > 1);
    let all: Vec<&PathBuf> = sets.values().flat_map(BTreeMap::values).collect();
    let mut ends = parallel_map(all.len(), progress, |at| Ends::of(all[at], progress))?.into_iter();
    for files in sets.into_values() {
        let mut head: Option<(PathBuf, u64, Option<Ends>)> = None;
        for ((number, path), ends) in files.into_iter().zip(&mut ends) {
            let before =
                head.as_ref().filter(|(_, before, _)| before + 1 == number).and_then(|(_, _, ends)| ends.as_ref());
            let goes_on = before.zip(ends.as_ref()).is_some_and(|(before, ends)| ends.go_on_from(before));
            let first = match head.take() {
                Some((first, ..)) if goes_on => {
                    further.entry(first.clone()).or_default().push(path);
                    first
                }
                _ => path,
            };
            head = Some((first, number, ends));
        }
    }
    let is_further =
        |log: &Log| log.file().is_some_and(|path| further.values().flatten().any(|further_path| further_path == path));
    Ok(Joined { logs: logs.into_iter().filter(|log| !is_further(log)).collect(), further })
}

/// The number at the end of an MCAP file's name; its folder, and its name before and behind the number.
fn numbered(path: &Path) -> Option<(u64, (PathBuf, String, String))> {
    Format::of(path).filter(|format| containers::is_split(*format))?;
    let (stem, rest) = path.file_name()?.to_str()?.rsplit_once('_')?;
    let (digits, ending) = rest.split_once('.')?;
    let number = digits.parse().ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_digit()))?;
    Some((number, (path.parent()?.to_path_buf(), stem.to_owned(), ending.to_owned())))
}

/// Topics of a file with their types, its first and last log time, and the mean period of its fastest topic, nanoseconds.
struct Ends {
    topics: Vec<(String, String)>,
    first: i64,
    last: i64,
    shortest: Option<f64>,
}

impl Ends {
    /// `None` of a file that cannot be read or has no messages.
    fn of(path: &Path, progress: &dyn Progress) -> Result<Option<Self>, Error> {
        let Some(format) = Format::of(path) else { return Ok(None) };
        match containers::open(path, format, &[], progress) {
            Ok(container) => Ok(Self::of_container(container.as_ref())),
            Err(error @ Error::Cancelled(_)) => Err(error),
            Err(_) => Ok(None),
        }
    }

    /// By the first and the last piece that has messages.
    fn of_container(container: &dyn Container) -> Option<Self> {
        let spans = |piece: usize| -> Option<Vec<Span>> {
            let spans = piece_spans(container, piece).ok()?;
            (!spans.is_empty()).then(|| spans.into_values().collect())
        };
        let begin = (0..container.pieces()).find_map(spans)?;
        let end = (0..container.pieces()).rev().find_map(spans)?;
        let periods = begin.iter().chain(&end).filter_map(Span::period).filter(|&period| period > 0.0);
        Some(Self {
            topics: container.topics().iter().map(|topic| (topic.name.clone(), topic.type_name.clone())).collect(),
            first: begin.iter().map(|span| span.first).min()?,
            last: end.iter().map(|span| span.last).max()?,
            shortest: periods.reduce(f64::min),
        })
    }

    fn go_on_from(&self, before: &Self) -> bool {
        let longest = before.shortest.map_or(LONGEST, |period| LONGEST.max(PERIODS * period));
        self.topics == before.topics && self.first.abs_diff(before.last) as f64 <= longest
    }
}
