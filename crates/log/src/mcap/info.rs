//! What a recording tells without its messages: counts, rates and gaps from the indexes.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot_data::{Progress, Silent, parallel_map};
use mcap::records::op;

use super::{
    container::Container,
    layout::PieceKind,
    record::{MessageIndex, Record, for_each_record},
};
use crate::Error;

/// Stamps that are held at once; beyond them, rates are means and gaps are not looked for.
const MAX_STAMPS: u64 = 1 << 24;

/// A period that many times the median is a gap.
const GAP: i64 = 5;

/// What a recording tells of itself.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct LogInfo {
    /// In the order of [`Container::topics`].
    pub(crate) topics: Vec<TopicTimes>,
    /// Log time of the first message, nanoseconds.
    pub(crate) start: Option<i64>,
    /// Log time of the last message, nanoseconds.
    pub(crate) end: Option<i64>,
    /// What wrote the files, each once.
    pub(crate) libraries: BTreeSet<String>,
    /// e.g. `ros2`.
    pub(crate) profiles: BTreeSet<String>,
    /// Chunks by their compression; the empty name is none.
    pub(crate) chunks: BTreeMap<String, u64>,
    /// Notes of opening, and what had to be read in full.
    pub(crate) notes: Vec<String>,
}

/// When the messages of a topic were recorded. Times are log times in nanoseconds.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct TopicTimes {
    /// Messages.
    pub(crate) count: u64,
    /// The first.
    pub(crate) first: Option<i64>,
    /// The last.
    pub(crate) last: Option<i64>,
    /// Messages a second: the inverse of the median period, else of the mean one.
    pub(crate) rate: Option<f64>,
    /// Periods above five medians; `None` where they were not looked for.
    pub(crate) gaps: Option<usize>,
    /// The longest period, seconds.
    pub(crate) largest_gap: Option<f64>,
}

impl TopicTimes {
    /// Times of one topic; the stamps are put in order.
    fn of(mut stamps: Vec<i64>) -> Self {
        if !stamps.is_sorted() {
            stamps.sort_unstable();
        }
        let mut times = Self {
            count: stamps.len() as u64,
            first: stamps.first().copied(),
            last: stamps.last().copied(),
            ..Self::default()
        };
        // The periods take the place of the stamps. Stamps are not negative, so that no difference overflows.
        for i in 1..stamps.len() {
            stamps[i - 1] = stamps[i].saturating_sub(stamps[i - 1]);
        }
        stamps.pop();
        let mut periods = stamps;
        times.largest_gap = periods.iter().max().map(|&longest| longest as f64 * 1e-9);
        let middle = periods.len() / 2;
        if periods.is_empty() {
            return times;
        }
        let median = *periods.select_nth_unstable(middle).1;
        times.gaps = Some(periods.iter().filter(|&&period| median > 0 && period > GAP.saturating_mul(median)).count());
        times.rate = if median > 0 { Some(1e9 / median as f64) } else { times.mean_rate() };
        times
    }

    fn mean_rate(&self) -> Option<f64> {
        let span = self.last?.saturating_sub(self.first?);
        (span > 0 && self.count > 1).then(|| (self.count - 1) as f64 * 1e9 / span as f64)
    }

    /// Adds messages of which only the span is kept.
    fn add(&mut self, count: u64, first: i64, last: i64) {
        self.count += count;
        self.first = Some(self.first.map_or(first, |own| own.min(first)));
        self.last = Some(self.last.map_or(last, |own| own.max(last)));
    }
}

/// Log times of one piece, by topic.
type PieceTimes = BTreeMap<usize, Vec<i64>>;

impl Container {
    /// Counts, rates and gaps of all topics. Indexes are read where there are some, and pieces without one in full.
    ///
    /// # Errors
    /// A user who stops.
    pub(crate) fn summary_info(&self, progress: &dyn Progress) -> Result<LogInfo, Error> {
        let mut info = LogInfo { notes: self.notes(), ..LogInfo::default() };
        for file in &self.files {
            info.libraries.extend(Some(file.library.clone()).filter(|name| !name.is_empty()));
            info.profiles.extend(Some(file.profile.clone()).filter(|name| !name.is_empty()));
            for chunk in file.pieces.iter().filter_map(|piece| file.chunk(piece)) {
                *info.chunks.entry(String::from_utf8_lossy(chunk.compression).into_owned()).or_default() += 1;
            }
        }
        let unindexed = self.pieces().iter().filter(|piece| piece.messages.is_none()).count();
        if unindexed > 0 {
            info.notes.push(format!(
                "{unindexed} of its {} parts have no message index and were read in full",
                self.pieces().len()
            ));
        }
        let known: u64 = self.pieces().iter().filter_map(|piece| piece.messages).fold(0, u64::saturating_add);
        progress.stage("reading indexes");
        info.topics = if known > MAX_STAMPS {
            info.notes.push(format!("more than {MAX_STAMPS} messages: rates are means, and gaps were not looked for"));
            self.spans(progress)?
        } else {
            self.periods(progress)?
        };
        info.start = info.topics.iter().filter_map(|topic| topic.first).min();
        info.end = info.topics.iter().filter_map(|topic| topic.last).max();
        Ok(info)
    }

    fn periods(&self, progress: &dyn Progress) -> Result<Vec<TopicTimes>, Error> {
        let pieces = self.map_pieces(progress, |piece| self.piece_times(piece))?;
        parallel_map(self.topics().len(), &Silent, |topic| {
            let own = || pieces.iter().filter_map(|piece| piece.get(&topic));
            let mut stamps = Vec::with_capacity(own().map(Vec::len).sum());
            own().for_each(|times| stamps.extend_from_slice(times));
            Ok(TopicTimes::of(stamps))
        })
    }

    fn spans(&self, progress: &dyn Progress) -> Result<Vec<TopicTimes>, Error> {
        let mut topics = vec![TopicTimes::default(); self.topics().len()];
        let spans = self.map_pieces(progress, |piece| {
            let span = |(topic, times): (usize, Vec<i64>)| {
                Some((topic, times.len() as u64, times.iter().copied().min()?, times.iter().copied().max()?))
            };
            Ok(self.piece_times(piece)?.into_iter().filter_map(span).collect::<Vec<_>>())
        })?;
        for (topic, count, first, last) in spans.into_iter().flatten() {
            if let Some(own) = topics.get_mut(topic) {
                own.add(count, first, last);
            }
        }
        topics.iter_mut().for_each(|topic| topic.rate = topic.mean_rate());
        Ok(topics)
    }

    /// Log times in a piece: from its index, or from its messages.
    fn piece_times(&self, place: usize) -> Result<PieceTimes, Error> {
        let mut times = PieceTimes::new();
        let Some(info) = self.pieces().get(place) else { return Ok(times) };
        let (Some(file), Some(topic_of)) = (self.files.get(info.file), self.topic_of.get(info.file)) else {
            return Ok(times);
        };
        let Some(piece) = file.pieces.get(info.place) else { return Ok(times) };
        if piece.kind == PieceKind::Records || piece.counts.is_none() {
            let all: Vec<usize> = (0..self.topics().len()).collect();
            self.read_piece(place, &all, &mut |topic, log, _, _| {
                times.entry(topic).or_default().push(log);
                Ok(())
            })?;
            return Ok(times);
        }
        let span =
            file.chunk(piece).map(|chunk| chunk.log_times).filter(|span| !span.is_empty()).unwrap_or(0..=u64::MAX);
        let index = file.map.get(piece.index.clone()).unwrap_or_default();
        for_each_record(index, |record: Record<'_>| {
            let index = MessageIndex::parse(record.body).filter(|_| record.opcode == op::MESSAGE_INDEX);
            if let Some((index, topic)) = index.and_then(|index| Some((index, topic_of.get(&index.channel)?))) {
                // Times outside the chunk's span are damage of the index.
                let sound =
                    index.log_times().filter(|time| span.contains(time)).filter_map(|time| i64::try_from(time).ok());
                let own = times.entry(*topic).or_default();
                own.reserve(usize::try_from(index.count()).unwrap_or_default());
                own.extend(sound);
            }
            Ok::<_, Error>(())
        })?;
        Ok(times)
    }
}
