//! What a recording tells without its messages: counts, rates and gaps from the indexes.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::RangeInclusive,
};

use fleetfoot_data::{Progress, Silent, parallel_map};
use mcap::records::op;

use super::{
    container::Container,
    layout::PieceKind,
    record::{MessageIndex, Record, for_each_record},
};
use crate::Error;

/// Messages whose indexes are read entry by entry; of more, only the ends of each chunk's index are, so that a log of gigabytes is told
/// as fast as a small one.
const MAX_STAMPS: u64 = 1 << 20;

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
            info.notes.push(format!(
                "{known} messages: rates and gaps are told from the first and the last message of each topic in a chunk"
            ));
            self.spans(progress)?
        } else {
            self.periods(progress)?
        };
        self.files.iter().for_each(|file| file.map.release(0..file.map.len()));
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
        let mut spans: Vec<Vec<Span>> = vec![Vec::new(); self.topics().len()];
        for piece in self.map_pieces(progress, |piece| self.piece_spans(piece))? {
            for (topic, span) in piece {
                if let Some(own) = spans.get_mut(topic) {
                    own.push(span);
                }
            }
        }
        Ok(spans.into_iter().map(TopicTimes::of_spans).collect())
    }

    /// First and last log times in a piece, by topic.
    fn piece_spans(&self, place: usize) -> Result<BTreeMap<usize, Span>, Error> {
        let mut spans: BTreeMap<usize, Span> = BTreeMap::new();
        let mut add = |topic: usize, span: Span| {
            spans.entry(topic).and_modify(|own| own.join(&span)).or_insert(span);
        };
        match self.indexed(place) {
            None => {
                for (topic, times) in self.piece_times(place)? {
                    let (first, last) = (times.iter().copied().min(), times.iter().copied().max());
                    if let (Some(first), Some(last)) = (first, last) {
                        add(topic, Span { count: times.len() as u64, first, last });
                    }
                }
            }
            Some(indexed) => {
                for_each_record(indexed.records, |record: Record<'_>| {
                    let index = MessageIndex::parse(record.body).filter(|_| record.opcode == op::MESSAGE_INDEX);
                    if let Some((index, topic)) =
                        index.and_then(|index| Some((index, indexed.topic_of.get(&index.channel)?)))
                        && let Some((a, b)) = index.ends()
                        && indexed.sound(a)
                        && indexed.sound(b)
                    {
                        add(*topic, Span { count: index.count(), first: a.min(b) as i64, last: a.max(b) as i64 });
                    }
                    Ok::<_, Error>(())
                })?;
            }
        }
        Ok(spans)
    }

    /// The index of a piece that has one.
    fn indexed(&self, place: usize) -> Option<Indexed<'_>> {
        let info = self.pieces().get(place)?;
        let (file, topic_of) = (self.files.get(info.file)?, self.topic_of.get(info.file)?);
        let piece = file.pieces.get(info.place)?;
        if piece.kind == PieceKind::Records || piece.counts.is_none() {
            return None;
        }
        let span = file.chunk(piece).map(|chunk| chunk.log_times).filter(|span| !span.is_empty());
        let records = file.map.get(piece.index.clone()).unwrap_or_default();
        Some(Indexed { records, topic_of, span: span.unwrap_or(0..=u64::MAX) })
    }

    /// Log times in a piece: from its index, or from its messages.
    fn piece_times(&self, place: usize) -> Result<PieceTimes, Error> {
        let mut times = PieceTimes::new();
        let Some(indexed) = self.indexed(place) else {
            let all: Vec<usize> = (0..self.topics().len()).collect();
            self.read_piece(place, &all, &mut |topic, log, _, _| {
                times.entry(topic).or_default().push(log);
                Ok(())
            })?;
            return Ok(times);
        };
        for_each_record(indexed.records, |record: Record<'_>| {
            let index = MessageIndex::parse(record.body).filter(|_| record.opcode == op::MESSAGE_INDEX);
            if let Some((index, topic)) = index.and_then(|index| Some((index, indexed.topic_of.get(&index.channel)?))) {
                let own = times.entry(*topic).or_default();
                own.reserve(usize::try_from(index.count()).unwrap_or_default());
                own.extend(index.log_times().filter(|&time| indexed.sound(time)).map(|time| time as i64));
            }
            Ok::<_, Error>(())
        })?;
        Ok(times)
    }
}

/// The index of a chunk.
struct Indexed<'a> {
    records: &'a [u8],
    topic_of: &'a BTreeMap<u16, usize>,
    /// The log times that the chunk says it has.
    span: RangeInclusive<u64>,
}

impl Indexed<'_> {
    /// Times outside the chunk's span are damage of the index, and so are those that are no `i64`.
    fn sound(&self, time: u64) -> bool {
        self.span.contains(&time) && i64::try_from(time).is_ok()
    }
}

/// The messages of a topic in a piece.
#[derive(Debug, Clone, Copy)]
struct Span {
    count: u64,
    first: i64,
    last: i64,
}

impl Span {
    fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.first = self.first.min(other.first);
        self.last = self.last.max(other.last);
    }

    /// The mean period, nanoseconds.
    fn period(&self) -> Option<f64> {
        (self.count > 1).then(|| self.last.saturating_sub(self.first) as f64 / (self.count - 1) as f64)
    }
}

impl TopicTimes {
    /// Times of one topic from its spans in the pieces. The median period is that of the pieces' means; a piece that lasts longer than its messages
    /// need by more than four of these has a gap, and so have two pieces that lie as far apart.
    fn of_spans(mut spans: Vec<Span>) -> Self {
        spans.sort_by_key(|span| span.first);
        let mut times = Self::default();
        spans.iter().for_each(|span| times.add(span.count, span.first, span.last));
        let mut means: Vec<f64> = spans.iter().filter_map(Span::period).filter(|&period| period > 0.0).collect();
        if means.is_empty() {
            times.rate = times.mean_rate();
            return times;
        }
        let middle = means.len() / 2;
        let median = *means.select_nth_unstable_by(middle, f64::total_cmp).1;
        times.rate = Some(1e9 / median);
        let inside = spans.iter().map(|span| {
            let needed = span.count.saturating_sub(1) as f64 * median;
            median + (span.last.saturating_sub(span.first) as f64 - needed).max(0.0)
        });
        let between = spans.windows(2).map(|pair| pair[1].first.saturating_sub(pair[0].last) as f64);
        let periods: Vec<f64> = inside.chain(between).collect();
        times.gaps = Some(periods.iter().filter(|&&period| period > GAP as f64 * median).count());
        times.largest_gap = periods.iter().copied().max_by(f64::total_cmp).map(|longest| longest * 1e-9);
        times
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_tell_the_rates_and_gaps_of_their_messages() {
        // 100 Hz in pieces of 50 messages, 3 s lost between two of them and 2 s inside another.
        let mut stamps: Vec<i64> = (0..1000).map(|i| i * 10_000_000).collect();
        stamps[400..].iter_mut().for_each(|stamp| *stamp += 3_000_000_000);
        stamps[720..].iter_mut().for_each(|stamp| *stamp += 2_000_000_000);
        let spans = stamps.chunks(50).map(|part| Span { count: 50, first: part[0], last: part[49] }).collect();
        let (coarse, exact) = (TopicTimes::of_spans(spans), TopicTimes::of(stamps));
        assert_eq!((coarse.count, coarse.first, coarse.last), (exact.count, exact.first, exact.last));
        assert_eq!((coarse.gaps, exact.gaps), (Some(2), Some(2)));
        assert!((coarse.rate.unwrap() - exact.rate.unwrap()).abs() < 1e-9);
        assert!((coarse.largest_gap.unwrap() - exact.largest_gap.unwrap()).abs() < 1e-9);
        assert_eq!(TopicTimes::of_spans(Vec::new()), TopicTimes::default());
    }
}
