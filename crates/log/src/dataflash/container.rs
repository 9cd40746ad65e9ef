//! A recording of one log of ArduPilot, by topic and by piece.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use super::{
    BINARY, KIND, TEXT,
    format::{Form, stamp},
    scan::{Piece, Scan, scan},
};
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Kind, Map, Span, Topic},
};

/// An open log.
#[derive(Debug)]
pub(crate) struct DataflashContainer {
    path: PathBuf,
    map: Map,
    scan: Scan,
    topics: Vec<Topic>,
    /// For each topic that was found, its place among `topics`.
    place_of: Vec<usize>,
}

impl DataflashContainer {
    /// Opens a log, binary or text by its first bytes, and hops over its messages.
    ///
    /// # Errors
    /// A file that is not there or is no log of ArduPilot, a user who stops. Damage is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let map = Map::open(path, compression, Kind { magic: b"", ..KIND })?;
        let form = match () {
            () if map.starts_with(BINARY) => Form::Binary,
            () if map.starts_with(TEXT) => Form::Text,
            () => return Err(map.refused(path, KIND)),
        };
        let scan = scan(&map, form, progress)?;
        let (topics, place_of) = topics(&scan);
        Ok(Self { path: path.into(), map, scan, topics, place_of })
    }

    fn piece(&self, piece: usize) -> Option<&Piece> {
        self.scan.pieces.get(piece)
    }

    /// The topics of a piece with their messages, by their places among all.
    fn spans<'a>(&'a self, piece: &'a Piece) -> impl Iterator<Item = (usize, Span)> + 'a {
        piece.topics.iter().filter_map(|(index, span)| Some((*self.place_of.get(*index)?, *span)))
    }
}

/// The topics sorted by name, and for each that was found its place among them.
fn topics(scan: &Scan) -> (Vec<Topic>, Vec<usize>) {
    let names_of_topics = &scan.topics.topic_names;
    let mut counts = vec![0; names_of_topics.len()];
    for (topic, span) in scan.pieces.iter().flat_map(|piece| &piece.topics) {
        if let Some(count) = counts.get_mut(*topic) {
            *count += span.count;
        }
    }
    // Two instances whose texts become one name are one topic.
    let mut names: Vec<&str> = names_of_topics.iter().map(|(_, name)| name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let place = |name: &str| names.binary_search(&name).unwrap_or_default();
    let place_of: Vec<usize> = names_of_topics.iter().map(|(_, name)| place(name)).collect();
    let topics = names.iter().enumerate().filter_map(|(at, name)| {
        let is_here = |(_, place): &(usize, &usize)| **place == at;
        let count = place_of
            .iter()
            .enumerate()
            .filter(is_here)
            .filter_map(|(names_of_topics, _)| counts.get(names_of_topics))
            .sum();
        let first = place_of.iter().position(|place| *place == at)?;
        let format = scan.definitions.formats.get(names_of_topics.get(first)?.0)?;
        Some(scan.definitions.topic(format, (*name).to_owned(), count))
    });
    (topics.collect(), place_of)
}

impl Container for DataflashContainer {
    fn path(&self) -> &Path {
        &self.path
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.path.clone()]
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.scan.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        Some(self.spans(self.piece(piece)?).map(|(_, span)| span.count).sum())
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let spans = self.spans(self.piece(piece)?).filter(|(topic, _)| wanted.contains(topic));
        Some(spans.map(|(_, span)| span.count).sum())
    }

    fn read_piece(&self, piece: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some(Piece { bytes, before, .. }) = self.piece(piece) else { return Ok(()) };
        if self.wanted_messages(piece, wanted) == Some(0) {
            return Ok(());
        }
        let mut is_wanted = vec![false; self.topics.len()];
        for &topic in wanted {
            if let Some(is_used) = is_wanted.get_mut(topic) {
                *is_used = true;
            }
        }
        let Scan { form, definitions, topics, .. } = &self.scan;
        let (mut at, mut last) = (bytes.start, *before);
        while at < bytes.end
            && let Ok(record) = form.head(&self.map, at, &definitions.formats)
        {
            let begin = std::mem::replace(&mut at, record.end);
            let Some(format) = definitions.formats.get(record.kind).filter(|format| format.is_topic()) else {
                continue;
            };
            let Some(time) = stamp(format, &record.payload, last) else { continue };
            last = time;
            let topic = topics.of(record.kind, format, &record.payload).and_then(|index| self.place_of.get(index));
            if let Some(&topic) = topic
                && is_wanted.get(topic) == Some(&true)
            {
                let whole = form.record(&self.map, begin, &definitions.formats);
                if let Ok(whole) = whole {
                    each(topic, time, time, &whole.payload)?;
                }
            }
        }
        self.map.release(bytes.clone());
        Ok(())
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        let mut spans: BTreeMap<usize, Span> = BTreeMap::new();
        self.spans(self.piece(piece)?).for_each(|(topic, span)| {
            spans.entry(topic).and_modify(|earlier| earlier.join(&span)).or_insert(span);
        });
        Some(spans)
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        self.scan.definitions.metadata()
    }

    fn damage(&self) -> Damage {
        self.scan.damage.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.scan.notes.clone()
    }

    fn release(&self) {
        self.map.release(0..self.map.len());
    }
}
