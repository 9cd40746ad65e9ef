//! The files of one run, a file a topic, as one log: grouping of files, and rows joined on one clock.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::Progress;

use crate::{
    Base, Error, Format, JoinKind, Selection, TimeSpec,
    by_name::ByName,
    channels::{Names, corrections},
    error::list,
    join::{self, JoinColumn, check_rate, join},
    opened::Opened,
    resample,
    store::{Budget, StoreBuilder, StoredTable},
    table::{Table, TableColumn},
    time_column::Chosen,
};

/// The files of one run: tables on one clock, each of which is a topic. Their columns are called `topic.column`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFiles {
    /// The folder that they lie in.
    pub folder: PathBuf,
    /// Topics and their files, in the order of the patterns.
    pub files: Vec<(String, PathBuf)>,
}

impl RunFiles {
    /// Groups files by the folders of their runs. `patterns` are topics and what their files are called below the folder of a run: `imu*.csv`, `imu/data.csv`.
    /// Every run has one file a topic. Files of other names that lie in a run are left out; they come beside the runs.
    ///
    /// # Errors
    /// A pattern that cannot be read, a topic of which a run has no file or several, a file of two topics, and a file that lies in no run.
    pub fn group(files: &[PathBuf], patterns: &[(String, String)]) -> Result<(Vec<Self>, Vec<PathBuf>), Error> {
        let patterns = patterns.iter().map(|(topic, text)| Pattern::new(topic, text)).collect::<Result<Vec<_>, _>>()?;
        let mut runs: BTreeMap<PathBuf, Vec<Option<PathBuf>>> = BTreeMap::new();
        let mut others = Vec::new();
        for file in files {
            let mut places = patterns.iter().enumerate().filter_map(|(at, pattern)| Some((at, pattern.folder(file)?)));
            let Some((at, folder)) = places.next() else {
                others.push(file.clone());
                continue;
            };
            if let Some((second, _)) = places.next() {
                let topics = [at, second].map(|at| patterns[at].topic.to_owned());
                return Err(Error::FileOfTwoTopics { path: file.clone(), topics });
            }
            if Format::of(file).is_some_and(Format::is_log) {
                return Err(Error::TopicIsLog { path: file.clone(), topic: patterns[at].topic.to_owned() });
            }
            let run = runs.entry(folder.clone()).or_insert_with(|| vec![None; patterns.len()]);
            if let Some(first) = run[at].replace(file.clone()) {
                let Pattern { topic, text, .. } = &patterns[at];
                return Err(Error::TwoFiles {
                    folder,
                    setting: format!("{topic} = \"{text}\""),
                    first,
                    second: file.clone(),
                });
            }
        }
        if let Some(alone) = others.iter().find(|file| !runs.keys().any(|folder| is_within(file, folder))) {
            return Err(Error::FileOfNoRun { path: alone.clone() });
        }
        let complete = |(folder, files): (PathBuf, Vec<Option<PathBuf>>)| {
            let chosen = files.into_iter().zip(&patterns).map(|(file, Pattern { topic, text, .. })| match file {
                Some(file) => Ok(((*topic).to_owned(), file)),
                None => Err(Error::NoFileOfTopic {
                    folder: folder.clone(),
                    setting: format!("{topic} = \"{text}\""),
                    there: inside(&folder),
                }),
            });
            let files = chosen.collect::<Result<_, Error>>()?;
            // Its name is what episodes are called.
            let named = folder.file_name().is_none().then(|| std::fs::canonicalize(&folder).ok()).flatten();
            Ok(Self { folder: named.unwrap_or(folder), files })
        };
        Ok((runs.into_iter().map(complete).collect::<Result<_, Error>>()?, others))
    }

    /// The topics.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|(topic, _)| topic.as_str())
    }

    /// The topic of a column, and the column's name in its file, which is empty where the name is the topic's.
    fn locate<'a>(&self, names: &Names, name: &'a str) -> Result<(usize, &'a str), Error> {
        let Some((topic, rest)) = names.locate(name) else {
            let topics = list(&self.topics().collect::<Vec<_>>());
            return Err(Error::NoTopicOfRun { path: self.folder.clone(), name: name.into(), topics });
        };
        Ok((topic, rest.strip_prefix('.').unwrap_or(rest)))
    }
}

/// A topic's entry of `[files]`.
struct Pattern<'a> {
    topic: &'a str,
    text: &'a str,
    pattern: glob::Pattern,
    /// Names of folders in it, and that of the file.
    parts: usize,
}

impl<'a> Pattern<'a> {
    fn new(topic: &'a str, text: &'a str) -> Result<Self, Error> {
        let pattern = glob::Pattern::new(text)
            .map_err(|problem| Error::Pattern { pattern: text.to_owned(), problem: problem.to_string() })?;
        Ok(Self { topic, text, pattern, parts: text.split('/').count() })
    }

    /// The folder of the run that a file belongs to as this topic.
    fn folder(&self, file: &Path) -> Option<PathBuf> {
        let folder = file.ancestors().nth(self.parts)?;
        let name = file.strip_prefix(folder).ok()?;
        let options = glob::MatchOptions { require_literal_separator: true, ..glob::MatchOptions::new() };
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        self.pattern.matches_path_with(name, options).then(|| folder.to_path_buf())
    }
}

fn is_within(file: &Path, folder: &Path) -> bool {
    file.starts_with(folder) || folder == Path::new(".") && file.is_relative()
}

/// The names of a folder's files, for a message.
fn inside(folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    list(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Rule by which a clock is chosen: rows of several files need one.
pub(crate) fn clock_of(time: &TimeSpec) -> &TimeSpec {
    if matches!(time, TimeSpec::Dispensable { .. }) { &TimeSpec::Auto } else { time }
}

/// Opens the files of a run that the selected columns are in, and joins their rows as those of topics are. `open` opens a file and checks its stamps.
pub(crate) fn open(
    run: &RunFiles,
    selection: &Selection,
    open: &dyn Fn(&Path, &Selection) -> Result<Opened, Error>,
    budget: &Arc<Budget>,
    progress: &dyn Progress,
) -> Result<Opened, Error> {
    let folder = run.folder.as_path();
    if matches!(selection.time, TimeSpec::Uniform { .. }) {
        return Err(Error::RunWithoutClock { path: folder.into() });
    }
    let names = Names::new(run.topics(), &[]);
    let located = selection.columns.iter().map(|name| run.locate(&names, name)).collect::<Result<Vec<_>, _>>()?;
    let base = match &selection.join.base {
        Some(Base::Rate(_)) => None,
        Some(Base::Channel(name)) => Some(run.locate(&names, name)?.0),
        None => located.first().map(|(topic, _)| *topic),
    };
    let mut used: Vec<usize> = located.iter().map(|(topic, _)| *topic).chain(base).collect();
    used.sort_unstable();
    used.dedup();
    if used.is_empty() {
        return Err(Error::NothingAsked { path: folder.into() });
    }
    progress.stage("joining files");
    let (mut series, mut columns, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    for &topic in &used {
        let (name, path) = &run.files[topic];
        let topic_columns = located.iter().filter(|(at, _)| *at == topic).map(|(_, column)| *column);
        let selection_of_file = Selection {
            time: clock_of(&selection.time).clone(),
            columns: topic_columns.map(str::to_owned).collect(),
            ..selection.clone()
        };
        let is_slerp = |column: &str| {
            let rule = selection.join.columns.get(&format!("{name}.{column}"));
            rule.is_some_and(|rule| rule.kind == Some(JoinKind::Slerp))
        };
        let opened = with_siblings(path, selection_of_file, &is_slerp, open)?;
        let clocks = corrections(folder, name, &selection.join.clocks);
        let mut rows = resample::series(folder, &opened, &clocks, budget, progress)?;
        name.clone_into(&mut rows.name);
        notes.extend(
            opened
                .notes
                .iter()
                .chain(&rows.counts.left_out("rows").collect::<Vec<_>>())
                .map(|note| format!("{name}: {note}")),
        );
        columns.push(opened.table.columns().iter().map(|column| named(name, column)).collect::<Vec<_>>());
        series.push(rows);
    }
    let place = |topic: usize| used.iter().position(|&used_topic| used_topic == topic).unwrap_or_default();
    let joins: Vec<(usize, JoinColumn)> = located
        .iter()
        .zip(&selection.columns)
        .map(|((topic, _), name)| {
            let at = place(*topic);
            let names = ByName::new(columns[at].iter().map(|column| column.column.name.as_str()));
            Ok((at, JoinColumn { series: at, ..resample::joined(&columns[at], names.find(folder, name)?, selection) }))
        })
        .collect::<Result<_, Error>>()?;
    let base = match (&selection.join.base, base) {
        (Some(Base::Rate(hz)), _) => {
            check_rate(folder, *hz, series.iter().map(|one| (&*one.name, one.rate())))?;
            join::Base::Rate(*hz)
        }
        (_, base) => join::Base::Series(base.map_or(0, place)),
    };
    if let join::Base::Series(at) = base
        && series.len() > 1
    {
        notes.push(format!("one row per row of {}; other files are joined to these rows", series[at].name));
    }
    let joined: Vec<TableColumn> =
        joins.iter().map(|(at, join)| resample::joined_column(&columns[*at][join.column], join)).collect();
    let kinds: Vec<JoinColumn> = joins.into_iter().map(|(_, join)| join).collect();
    let mut rows = StoreBuilder::new(folder, kinds.len(), budget.clone());
    join(&series, &kinds, base, progress, |stamps, columns| rows.push_columns(stamps, columns)).map_err(apart)?;
    let table: Box<dyn Table> = Box::new(StoredTable { store: rows.finish()?, columns: joined, has_time: true });
    Ok(Opened { time_column: Some("its clock".into()), chosen: Chosen::Caller, ..Opened::of_table(table, None, notes) })
}

/// Opens a file for columns, and for all four of each quaternion of which one is joined by slerp, as far as the file has them.
fn with_siblings(
    path: &Path,
    sibling_selection: Selection,
    is_slerp: &dyn Fn(&str) -> bool,
    open: &dyn Fn(&Path, &Selection) -> Result<Opened, Error>,
) -> Result<Opened, Error> {
    let stems = sibling_selection.columns.iter().filter(|column| is_slerp(column));
    let mut stems: Vec<&str> = stems.filter_map(|column| column.strip_suffix(['x', 'y', 'z', 'w'])).collect();
    loop {
        let siblings = stems.iter().flat_map(|stem| ["x", "y", "z", "w"].map(|letter| format!("{stem}{letter}")));
        let columns =
            sibling_selection.columns.iter().cloned().chain(siblings).collect::<BTreeSet<_>>().into_iter().collect();
        match open(path, &Selection { columns, ..sibling_selection.clone() }) {
            // Three of them are a vector.
            Err(Error::MissingColumn { column, .. }) if !sibling_selection.columns.contains(&column) => {
                let before = stems.len();
                stems.retain(|stem| column.strip_suffix(['x', 'y', 'z', 'w']) != Some(stem));
                if stems.len() == before {
                    return open(path, &sibling_selection);
                }
            }
            opened => return opened,
        }
    }
}

/// A column with its topic.
fn named(topic: &str, column: &TableColumn) -> TableColumn {
    let mut column = column.clone();
    column.column.name = format!("{topic}.{}", column.column.name);
    column
}

/// The error of series that do not overlap, told of files.
fn apart(error: Error) -> Error {
    match error {
        Error::NoOverlap { path, first, second, ranges, .. } => Error::FilesApart { path, first, second, ranges },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(files: &[&str], patterns: &[(&str, &str)]) -> Result<(Vec<RunFiles>, Vec<PathBuf>), Error> {
        let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
        let patterns: Vec<(String, String)> = patterns.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect();
        RunFiles::group(&files, &patterns)
    }

    #[test]
    fn deep_folder_is_a_run() {
        let files = ["r/2/imu_7.csv", "r/2/odom/data.csv", "r/1/imu.csv", "r/1/odom/data.csv", "r/1/plots/sum.csv"];
        let (runs, others) = group(&files, &[("imu", "imu*.csv"), ("odom", "odom/*.csv")]).unwrap();
        let files_of_run: Vec<(&str, &str)> =
            runs.iter().map(|run| (run.folder.to_str().unwrap(), run.files[0].1.to_str().unwrap())).collect();
        assert_eq!(files_of_run, [("r/1", "r/1/imu.csv"), ("r/2", "r/2/imu_7.csv")]);
        assert_eq!(runs[1].files[1], ("odom".into(), "r/2/odom/data.csv".into()));
        assert_eq!(others, [Path::new("r/1/plots/sum.csv")]);
        // The folder that the command runs in, by its name.
        let (runs, _) = group(&["a.csv", "b.parquet"], &[("a", "a.*"), ("b", "b.*")]).unwrap();
        assert_eq!(runs[0].folder, std::fs::canonicalize(".").unwrap());
    }

    #[test]
    fn files_without_a_run_are_an_error() {
        let one = [("a", "a*.csv"), ("b", "b.*")];
        assert!(matches!(group(&["r/a.csv"], &one), Err(Error::NoFileOfTopic { .. })));
        assert!(matches!(group(&["r/a.csv", "r/a2.csv", "r/b.csv"], &one), Err(Error::TwoFiles { .. })));
        assert!(matches!(group(&["r/a.csv", "r/b.mcap"], &one), Err(Error::TopicIsLog { .. })));
        assert!(matches!(group(&["r/a.csv", "r/b.csv", "c/x.csv"], &one), Err(Error::FileOfNoRun { .. })));
        assert!(matches!(group(&["r/ab.csv"], &[("a", "a*"), ("b", "*b.csv")]), Err(Error::FileOfTwoTopics { .. })));
        assert!(matches!(group(&["r/a.csv"], &[("a", "a[")]), Err(Error::Pattern { .. })));
    }
}
