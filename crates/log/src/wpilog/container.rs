//! A recording of one file, by topic and by piece.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use super::{
    KIND,
    record::Record,
    scan::{Piece, Scan, scan},
};
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Map, Span, Topic},
};

/// The version of the format that is read; the minor one may be newer.
const MAJOR: u8 = 1;

/// An open file.
#[derive(Debug)]
pub(crate) struct WpilogContainer {
    path: PathBuf,
    map: Map,
    scan: Scan,
    topics: Vec<Topic>,
    /// For each topic that was found, its place among `topics`; none where it has no values.
    place_of: Vec<Option<usize>>,
}

impl WpilogContainer {
    /// Opens a file, and hops over its records.
    ///
    /// # Errors
    /// A file that is not there or is no WPILOG file, a version that is not read, a user who stops. Damage is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let map = Map::open(path, compression, KIND)?;
        if let Some(&[minor, major]) = map.get(6..8).and_then(|bytes| bytes.first_chunk())
            && major != MAJOR
        {
            let problem = format!("a WPILOG file of version {major}.{minor}, and only {MAJOR}.x is read");
            let mend = "write it again with a current WPILib, or export it as CSV";
            return Err(Error::WrongFormat { path: path.into(), problem, mend });
        }
        let scan = scan(&map, progress)?;
        let mut counts = vec![0; scan.entries.len()];
        for (topic, span) in scan.pieces.iter().flat_map(|piece| &piece.topics) {
            if let Some(count) = counts.get_mut(*topic) {
                *count += span.count;
            }
        }
        let mut order: Vec<(usize, u64)> = counts.into_iter().enumerate().filter(|(_, count)| *count > 0).collect();
        order.sort_by_key(|(topic, _)| scan.entries.name(*topic));
        let mut place_of = vec![None; scan.entries.len()];
        order.iter().enumerate().for_each(|(place, (index, _))| place_of[*index] = Some(place));
        let topics = scan.entries.topics(&order);
        Ok(Self { path: path.into(), map, scan, topics, place_of })
    }

    fn piece(&self, piece: usize) -> Option<&Piece> {
        self.scan.pieces.get(piece)
    }

    fn place(&self, index: usize) -> Option<usize> {
        *self.place_of.get(index)?
    }

    /// The topics of a piece with their values, by their places among all.
    fn spans<'a>(&'a self, piece: &'a Piece) -> impl Iterator<Item = (usize, Span)> + 'a {
        piece.topics.iter().filter_map(|(index, span)| Some((self.place(*index)?, *span)))
    }
}

impl Container for WpilogContainer {
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
        let mut at = bytes.start;
        while at < bytes.end
            && let Ok(record) = Record::at(&self.map, at)
        {
            at = record.end;
            let topic = self.scan.entries.topic_of(&record).and_then(|index| self.place(index));
            if let (Some(topic), Some(time)) = (topic, record.nanoseconds())
                && is_wanted.get(topic) == Some(&true)
            {
                each(topic, time, time, record.payload)?;
            }
        }
        self.map.release(bytes.clone());
        Ok(())
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        Some(self.spans(self.piece(piece)?).collect())
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        let mut pairs = self.scan.entries.metadata().clone();
        if !self.scan.header.is_empty() {
            pairs.insert("header".to_owned(), self.scan.header.clone());
        }
        pairs
    }

    fn damage(&self) -> Damage {
        self.scan.damage.clone()
    }

    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    fn release(&self) {
        self.map.release(0..self.map.len());
    }
}
