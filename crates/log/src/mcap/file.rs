//! One MCAP file: its bytes, its parts and its channels.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;

use super::{
    KIND,
    channels::Definitions,
    chunk,
    layout::{Layout, Piece, PieceKind},
    record::Chunk,
    summary::{self, Statistics},
};
use crate::{
    Compression, Error,
    container::{Damage, Lost, Map},
};

/// An open file.
#[derive(Debug)]
pub(super) struct McapFile {
    pub(super) path: PathBuf,
    pub(super) map: Map,
    pub(super) pieces: Vec<Piece>,
    pub(super) definitions: Definitions,
    /// Messages of each channel; `None` without an index and without a plausible summary.
    pub(super) counts: Option<BTreeMap<u16, u64>>,
    /// The bodies of its metadata records.
    pub(super) metadata: Vec<Range<usize>>,
    /// Losses before any chunk was read.
    pub(super) damage: Damage,
    pub(super) notes: Vec<String>,
}

impl McapFile {
    /// Opens a file and finds its parts and channels. Chunks are decompressed only when channels are not defined outside them.
    pub(super) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let map = Map::open(path, compression, KIND)?;
        let mut layout = Layout::find(&map);
        refuse_unknown_compression(path, &map, &layout.pieces)?;
        let mut notes = Vec::new();
        let summary = summary::read(&map, layout.data_end).unwrap_or_else(|why| {
            notes.push(format!("the summary at its end is ignored: {why}"));
            None
        });
        mark_cut(&map, &mut layout, summary.is_some(), &mut notes);
        let mut definitions = Definitions::default();
        definitions.add_top_level(&map, &layout);
        let (mut statistics, mut summary_channels) = (None, false);
        if let Some(summary) = summary {
            summary_channels = !summary.definitions.channels.is_empty();
            definitions.merge(summary.definitions);
            statistics = summary.statistics;
        }
        let counts = reconcile(&mut layout, statistics, &mut notes);
        let summarised = summary_channels || layout.pieces.iter().all(|piece| piece.counts.is_some());
        let counted = counts.iter().flatten().all(|(channel, _)| definitions.channels.contains_key(channel));
        if !(summarised && counted && definitions.explain(&layout.pieces)) {
            definitions.scan(&map, &layout.pieces, progress)?;
        }
        notes.extend(definitions.notes.iter().cloned());
        let undefined = counts.iter().flatten().filter(|(channel, _)| !definitions.channels.contains_key(channel));
        let lost = undefined.fold(0_u64, |sum, (_, count)| sum.saturating_add(*count));
        if lost > 0 {
            notes.push(format!("{lost} messages of undefined channels are left out"));
        }
        let Layout { pieces, metadata, damage, .. } = layout;
        // The system maps more around each record that was looked at than was asked for.
        map.release(0..map.len());
        Ok(Self { path: path.into(), map, pieces, definitions, counts, metadata, damage, notes })
    }

    /// The head of a chunk; `None` for a run of messages.
    pub(super) fn chunk(&self, piece: &Piece) -> Option<Chunk<'_>> {
        chunk_of(&self.map, piece)
    }
}

fn chunk_of<'a>(file: &'a [u8], piece: &Piece) -> Option<Chunk<'a>> {
    Chunk::parse(file.get(piece.bytes.clone())?).filter(|_| piece.kind == PieceKind::Chunk)
}

/// A file of which no chunk can be decompressed is refused; a single unknown name in a file is damage.
fn refuse_unknown_compression(path: &Path, file: &[u8], pieces: &[Piece]) -> Result<(), Error> {
    let known = |piece: &Piece| chunk_of(file, piece).is_none_or(|chunk| chunk::is_known(chunk.compression));
    let Some(first) = pieces.first().filter(|_| !pieces.iter().any(known)).and_then(|piece| chunk_of(file, piece))
    else {
        return Ok(());
    };
    let problem = format!(
        "its chunks are compressed by `{}`; readable are {}",
        String::from_utf8_lossy(first.compression),
        chunk::KNOWN
    );
    Err(Error::WrongFormat { path: path.into(), problem, mend: "write it again with one of these" })
}

/// A file without its end mark was cut, or is still being written.
fn mark_cut(map: &Map, layout: &mut Layout, summary: bool, notes: &mut Vec<String>) {
    if layout.data_end.is_none() {
        let why = "the file ends without its end mark: it was cut, or the recorder did not close it";
        let why = map.cut.as_deref().unwrap_or(why);
        layout.damage.add(map.len(), why, Lost { bytes: 0, chunk: false, messages: None });
    } else if let Some(cut) = &map.cut {
        notes.push(cut.clone());
    } else if !summary && !map.ends_with(mcap::MAGIC) {
        notes.push("its summary is cut; no message is lost by that".into());
    }
}

/// Holds what indexes, summary and found chunks say against each other. The answer is the messages of each channel, where they agree.
///
/// Indexes let whole chunks be skipped, so that one that lies would lose messages in silence: against a summary that says otherwise,
/// none of the indexes is believed.
fn reconcile(
    layout: &mut Layout,
    statistics: Option<Statistics>,
    notes: &mut Vec<String>,
) -> Option<BTreeMap<u16, u64>> {
    let chunks = layout.pieces.iter().filter(|piece| piece.kind == PieceKind::Chunk).count() as u64;
    let sound = layout.damage.is_empty();
    let statistics = statistics.filter(|statistics| {
        let fits = if sound { chunks == statistics.chunks } else { chunks <= statistics.chunks };
        if !fits {
            notes.push(format!(
                "its summary lists {} chunks but the file has {chunks}: the counts of the summary are ignored",
                statistics.chunks
            ));
        }
        fits
    });
    let mut counts: Option<BTreeMap<u16, u64>> = Some(BTreeMap::new());
    for piece in &layout.pieces {
        match (&mut counts, &piece.counts) {
            (Some(counts), Some(piece_counts)) => {
                piece_counts.iter().for_each(|(channel, count)| *counts.entry(*channel).or_default() += count)
            }
            _ => counts = None,
        }
    }
    let Some(mut statistics) = statistics else { return counts };
    statistics.counts.retain(|_, count| *count > 0);
    let Some(scanned_counts) = counts else { return Some(statistics.counts).filter(|_| sound) };
    let within =
        scanned_counts.iter().all(|(channel, count)| statistics.counts.get(channel).is_some_and(|all| count <= all));
    if sound && scanned_counts == statistics.counts {
        return Some(scanned_counts);
    }
    if !sound && within {
        let total = |counts: &BTreeMap<u16, u64>| counts.values().fold(0_u64, |sum, count| sum.saturating_add(*count));
        layout.damage.know_messages(total(&statistics.counts).saturating_sub(total(&scanned_counts)));
        return Some(scanned_counts);
    }
    notes.push("its indexes and its summary count different messages: every chunk is read, and messages are counted by reading".into());
    layout.pieces.iter_mut().filter(|piece| piece.kind == PieceKind::Chunk).for_each(|piece| piece.counts = None);
    None
}
