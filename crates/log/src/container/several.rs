//! A recording in several files of one format, whose topics go on from file to file.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{Container, Damage, Each, Span, Topic};
use crate::Error;

/// The files of a recording, in their order.
#[derive(Debug)]
pub(crate) struct Several {
    path: PathBuf,
    files: Vec<Box<dyn Container>>,
    topics: Vec<Topic>,
    /// For each file, the place of each of its topics among all.
    topic_of: Vec<Vec<usize>>,
    /// For each piece, its file and its place among that file's pieces.
    pieces: Vec<(usize, usize)>,
    /// Breaks of all files, sorted.
    breaks: Vec<i64>,
}

impl Several {
    /// Joins open files; `path` is the folder that names them, or the first of them.
    pub(crate) fn new(path: &Path, files: Vec<Box<dyn Container>>) -> Self {
        let names: BTreeSet<&str> =
            files.iter().flat_map(|file| file.topics()).map(|topic_info| topic_info.name.as_str()).collect();
        let topics: Vec<Topic> = names.iter().filter_map(|name| joined(&files, name)).collect();
        let place =
            |topic: &Topic| topics.binary_search_by(|topic_info| topic_info.name.cmp(&topic.name)).unwrap_or_default();
        let topic_of = files.iter().map(|file| file.topics().iter().map(place).collect()).collect();
        let pieces = files
            .iter()
            .enumerate()
            .flat_map(|(file, container)| (0..container.pieces()).map(move |piece| (file, piece)));
        let pieces = pieces.collect();
        let mut breaks: Vec<i64> = files.iter().flat_map(|file| file.breaks()).copied().collect();
        breaks.sort_unstable();
        Self { path: path.into(), files, topics, topic_of, pieces, breaks }
    }

    /// The file of a piece, its place there, and the places of that file's topics among all.
    fn piece(&self, piece: usize) -> Option<(&dyn Container, usize, &[usize])> {
        let &(file, local_piece) = self.pieces.get(piece)?;
        Some((self.files.get(file)?.as_ref(), local_piece, self.topic_of.get(file)?))
    }
}

/// A topic as all files have it.
fn joined(files: &[Box<dyn Container>], name: &str) -> Option<Topic> {
    let mut same_name = files.iter().flat_map(|file| file.topics()).filter(|topic| topic.name == name);
    let mut all = same_name.next()?.clone();
    for topic in same_name {
        all.count = all.count.zip(topic.count).map(|(sum, count)| sum.saturating_add(count));
        let problem =
            topic.problem.clone().or_else(|| all.contradiction(&topic.message_encoding, topic.schema.as_ref()));
        all.problem = all.problem.take().or(problem);
    }
    Some(all)
}

/// Values by the topics of a file as values by the topics of all.
fn renamed<T>(values: BTreeMap<usize, T>, places: &[usize]) -> BTreeMap<usize, T> {
    values.into_iter().filter_map(|(topic, value)| Some((*places.get(topic)?, value))).collect()
}

/// The topics of a file that are among those of all.
fn within(wanted: &[usize], places: &[usize]) -> Vec<usize> {
    (0..places.len()).filter(|&topic| wanted.contains(&places[topic])).collect()
}

impl Container for Several {
    fn path(&self) -> &Path {
        &self.path
    }

    fn files(&self) -> Vec<PathBuf> {
        self.files.iter().flat_map(|file| file.files()).collect()
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        let (file, local_piece, _) = self.piece(piece)?;
        file.messages(local_piece)
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let (file, local_piece, places) = self.piece(piece)?;
        file.wanted_messages(local_piece, &within(wanted, places))
    }

    fn read_piece(&self, piece: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some((file, local_piece, places)) = self.piece(piece) else { return Ok(()) };
        file.read_piece(local_piece, &within(wanted, places), &mut |topic, log, publish, data| {
            each(places.get(topic).copied().unwrap_or(topic), log, publish, data)
        })
    }

    fn indexed_times(&self, piece: usize) -> Option<BTreeMap<usize, Vec<i64>>> {
        let (file, local_piece, places) = self.piece(piece)?;
        Some(renamed(file.indexed_times(local_piece)?, places))
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        let (file, local_piece, places) = self.piece(piece)?;
        Some(renamed(file.indexed_spans(local_piece)?, places))
    }

    fn breaks(&self) -> &[i64] {
        &self.breaks
    }

    fn topics_of(&self, piece: usize) -> Option<Vec<usize>> {
        let (file, local_piece, places) = self.piece(piece)?;
        Some(file.topics_of(local_piece)?.into_iter().filter_map(|topic| places.get(topic).copied()).collect())
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        self.files.iter().flat_map(|file| file.metadata()).collect()
    }

    fn damage(&self) -> Damage {
        let mut damage = Damage::default();
        self.files.iter().for_each(|file| damage.merge(&file.damage()));
        damage
    }

    fn notes(&self) -> Vec<String> {
        let named = |file: &dyn Container| -> Vec<String> {
            let name = file.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
            file.notes().into_iter().map(|note| format!("{name}: {note}")).collect()
        };
        self.files.iter().flat_map(|file| named(file.as_ref())).collect()
    }

    fn release(&self) {
        self.files.iter().for_each(|file| file.release());
    }
}
