//! A recording of one ULog file, by topic and by piece.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use super::{
    KIND,
    message::Message,
    scan::{Piece, Scan, scan},
};
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Map, Span, Topic},
};

/// An open file.
#[derive(Debug)]
pub(crate) struct UlogContainer {
    path: PathBuf,
    map: Map,
    scan: Scan,
    topics: Vec<Topic>,
    /// For each topic that was found, its place among `topics`; none where it has no messages.
    place_of: Vec<Option<usize>>,
}

impl UlogContainer {
    /// Opens a file, and hops over all its messages.
    ///
    /// # Errors
    /// A file that is not there or is no ULog file, flags that only a newer reader understands, a user who stops. Damage is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let map = Map::open(path, compression, KIND)?;
        let refuse = |problem| {
            let mend = "convert it with the tools of its writer, or log without the feature that sets the flag";
            Error::WrongFormat { path: path.into(), problem, mend }
        };
        let scan = scan(&map, refuse, progress)?;
        map.release(0..map.len());
        let (topics, place_of) = topics(&scan);
        Ok(Self { path: path.into(), map, scan, topics, place_of })
    }

    fn piece(&self, piece: usize) -> Option<&Piece> {
        self.scan.pieces.get(piece)
    }

    /// The topics of a piece with their messages, by their places among all.
    fn spans<'a>(&'a self, piece: &'a Piece) -> impl Iterator<Item = (usize, Span)> + 'a {
        piece.topics.iter().filter_map(|(index, span)| Some(((*self.place_of.get(*index)?)?, *span)))
    }
}

/// The topics that have messages, sorted by name, and for each that was found its place among them.
fn topics(scan: &Scan) -> (Vec<Topic>, Vec<Option<usize>>) {
    let described = scan.definitions.topics();
    let mut counts = scan.unreadable.clone();
    counts.resize(described.len(), 0);
    for (topic, span) in scan.pieces.iter().flat_map(|piece| &piece.topics) {
        if let Some(count) = counts.get_mut(*topic) {
            *count += span.count;
        }
    }
    let mut order: Vec<(&str, usize)> =
        described.iter().enumerate().map(|(place, topic_described)| (topic_described.name(), place)).collect();
    order.retain(|(_, place)| counts[*place] > 0);
    order.sort_unstable();
    let mut place_of = vec![None; described.len()];
    order.iter().enumerate().for_each(|(place, (_, index))| place_of[*index] = Some(place));
    (order.iter().map(|(_, place)| described[*place].topic(counts[*place])).collect(), place_of)
}

impl Container for UlogContainer {
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
        let Some(Piece { bytes, .. }) = self.piece(piece) else { return Ok(()) };
        if self.wanted_messages(piece, wanted) == Some(0) {
            return Ok(());
        }
        let mut is_wanted = vec![false; self.topics.len()];
        for &topic in wanted {
            if let Some(is_used) = is_wanted.get_mut(topic) {
                *is_used = true;
            }
        }
        let places: Vec<Option<usize>> =
            self.place_of.iter().map(|place| place.filter(|&place| is_wanted[place])).collect();
        let part = self.map.get(..bytes.end).unwrap_or_default();
        let mut at = bytes.start;
        while let Ok(message) = Message::at(part, at) {
            at = message.end();
            let Some((channel, data)) = self.scan.definitions.channel(&message) else { continue };
            if let Some(Some(topic)) = places.get(channel.topic)
                && let Ok(time) = channel.time(data)
            {
                each(*topic, time, time, data)?;
            }
        }
        self.map.release(bytes.clone());
        Ok(())
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        Some(self.spans(self.piece(piece)?).collect())
    }

    fn breaks(&self) -> &[i64] {
        &self.scan.dropouts.after
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        self.scan.about.pairs(&self.map)
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
