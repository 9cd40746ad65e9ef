//! Overview of a recording without its messages: counts, rates and gaps from the indexes.

use std::collections::BTreeMap;

use fleetfoot_data::{Progress, parallel_map, parallel_pieces};

use super::Container;
use crate::Error;

/// Messages whose indexes are read entry by entry; of more, only the ends of each chunk's index are, so that a log of gigabytes is told
/// as fast as a small one.
const MAX_STAMPS: u64 = 1 << 20;

/// A period that many times the median is a gap.
const GAP: i64 = 5;

/// Times of a recording's topics.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct LogInfo {
    /// In the order of [`Container::topics`].
    pub(crate) topics: Vec<TopicTimes>,
    /// Notes of opening, and of topics that were read in full.
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
    /// Messages a second, from the first to the last.
    pub(crate) rate: Option<f64>,
    /// The median period, seconds; `None` where the periods were not looked at.
    pub(crate) period: Option<f64>,
    /// The median deviation of the periods from their median, seconds; `None` where they were not looked at.
    pub(crate) jitter: Option<f64>,
    /// Groups of messages less than a tenth of the mean period apart; `None` where they were not looked for.
    pub(crate) bursts: Option<usize>,
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
        times.rate = times.mean_rate();
        let mean = times.rate.map_or(0.0, |rate| 1e9 / rate);
        let is_close = |period: &i64| (*period as f64) < mean / 10.0;
        // A group begins where a close message follows one that is not.
        let begins = |at: usize| is_close(&periods[at]) && (at == 0 || !is_close(&periods[at - 1]));
        times.bursts = (!periods.is_empty()).then(|| (0..periods.len()).filter(|&at| begins(at)).count());
        times.largest_gap = periods.iter().max().map(|&longest| longest as f64 * 1e-9);
        let middle = periods.len() / 2;
        if periods.is_empty() {
            return times;
        }
        let median = *periods.select_nth_unstable(middle).1;
        times.period = Some(median as f64 * 1e-9);
        times.gaps = Some(periods.iter().filter(|&&period| median > 0 && period > GAP.saturating_mul(median)).count());
        periods.iter_mut().for_each(|period| *period = (*period - median).abs());
        times.jitter = Some(*periods.select_nth_unstable(middle).1 as f64 * 1e-9);
        times
    }

    /// Messages a second, by the median period or on average, whichever is more.
    pub(crate) fn fastest(&self) -> Option<f64> {
        let by_period = self.period.filter(|&period| period > 0.0).map(|period| 1.0 / period);
        self.rate.into_iter().chain(by_period).reduce(f64::max)
    }

    fn mean_rate(&self) -> Option<f64> {
        let span = self.last?.saturating_sub(self.first?);
        (span > 0 && self.count > 1).then(|| (self.count - 1) as f64 * 1e9 / span as f64)
    }

    /// Adds messages of which only the span is kept.
    fn add(&mut self, count: u64, first: i64, last: i64) {
        self.count += count;
        self.first = Some(self.first.map_or(first, |known_first| known_first.min(first)));
        self.last = Some(self.last.map_or(last, |known_last| known_last.max(last)));
    }
}

/// Log times of one piece, by topic.
type PieceTimes = BTreeMap<usize, Vec<i64>>;

/// Counts, rates and gaps of all topics. Indexes are read where there are some, and pieces without one in full.
///
/// # Errors
/// A user who stops.
pub(crate) fn summary(container: &dyn Container, progress: &dyn Progress) -> Result<LogInfo, Error> {
    let mut info = LogInfo { notes: container.notes(), ..LogInfo::default() };
    let pieces = container.pieces();
    let counts: Vec<Option<u64>> = (0..pieces).map(|piece| container.messages(piece)).collect();
    let unindexed = counts.iter().filter(|messages| messages.is_none()).count();
    if unindexed > 0 {
        info.notes.push(format!("{unindexed} of its {pieces} parts have no message index and were read in full"));
    }
    let known: u64 = counts.into_iter().flatten().fold(0, u64::saturating_add);
    progress.stage("reading indexes");
    info.topics = if known > MAX_STAMPS {
        info.notes.push(format!(
            "{known} messages: rates and gaps are estimated from the first and the last message of each topic in a chunk"
        ));
        spans(container, progress)?
    } else {
        periods(container, progress)?
    };
    container.release();
    Ok(info)
}

fn periods(container: &dyn Container, progress: &dyn Progress) -> Result<Vec<TopicTimes>, Error> {
    let pieces = parallel_map(container.pieces(), progress, |piece| piece_times(container, piece))?;
    let mut stamps: Vec<Vec<i64>> = vec![Vec::new(); container.topics().len()];
    for (topic, times) in pieces.into_iter().flatten() {
        if let Some(times_of_topic) = stamps.get_mut(topic) {
            times_of_topic.extend(times);
        }
    }
    Ok(parallel_pieces(&mut stamps, 1, |_, times_of_topic| TopicTimes::of(std::mem::take(&mut times_of_topic[0]))))
}

fn spans(container: &dyn Container, progress: &dyn Progress) -> Result<Vec<TopicTimes>, Error> {
    let mut spans: Vec<Vec<Span>> = vec![Vec::new(); container.topics().len()];
    for piece in parallel_map(container.pieces(), progress, |piece| piece_spans(container, piece))? {
        for (topic, span) in piece {
            if let Some(span_of_topic) = spans.get_mut(topic) {
                span_of_topic.push(span);
            }
        }
    }
    Ok(spans.into_iter().map(TopicTimes::of_spans).collect())
}

/// Log times in a piece: from its index, or from its messages.
fn piece_times(container: &dyn Container, piece: usize) -> Result<PieceTimes, Error> {
    if let Some(times) = container.indexed_times(piece) {
        return Ok(times);
    }
    let mut times = PieceTimes::new();
    let all: Vec<usize> = (0..container.topics().len()).collect();
    container.read_piece(piece, &all, &mut |topic, log, _, _| {
        times.entry(topic).or_default().push(log);
        Ok(())
    })?;
    Ok(times)
}

/// First and last log times in a piece, by topic.
pub(crate) fn piece_spans(container: &dyn Container, piece: usize) -> Result<BTreeMap<usize, Span>, Error> {
    if let Some(spans) = container.indexed_spans(piece) {
        return Ok(spans);
    }
    let span = |(topic, times): (usize, Vec<i64>)| {
        let (first, last) = (times.iter().copied().min()?, times.iter().copied().max()?);
        Some((topic, Span { count: times.len() as u64, first, last }))
    };
    Ok(piece_times(container, piece)?.into_iter().filter_map(span).collect())
}

/// The messages of a topic in a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Span {
    /// Number of messages.
    pub(crate) count: u64,
    /// The earliest log time.
    pub(crate) first: i64,
    /// The latest.
    pub(crate) last: i64,
}

impl Span {
    /// Adds others of the topic.
    pub(crate) fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.first = self.first.min(other.first);
        self.last = self.last.max(other.last);
    }

    /// The mean period, nanoseconds.
    pub(crate) fn period(&self) -> Option<f64> {
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
        times.rate = times.mean_rate();
        let mut means: Vec<f64> = spans.iter().filter_map(Span::period).filter(|&period| period > 0.0).collect();
        if means.is_empty() {
            return times;
        }
        let middle = means.len() / 2;
        let median = *means.select_nth_unstable_by(middle, f64::total_cmp).1;
        times.period = Some(median * 1e-9);
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
    fn spans_report_rates_and_gaps() {
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
        // Messages over time, and the bursts that they come in: 24 messages, of which six come every second, 4 us apart.
        let bursts: Vec<i64> = (0..24).map(|i| i / 6 * 1_000_000_000 + i % 6 * 4_000).collect();
        let times = TopicTimes::of(bursts);
        assert!((times.rate.unwrap() - 23.0 / 3.00002).abs() < 1e-9, "{times:?}");
        assert_eq!((times.bursts, times.jitter), (Some(4), Some(0.0)));
        let even = TopicTimes::of((0..100).map(|i| i * 10_000_000 + (i % 2) * 1_000_000).collect());
        assert!((even.rate.unwrap() - 99.0 / 0.991).abs() < 1e-9 && even.bursts == Some(0), "{even:?}");
        assert_eq!(even.jitter, Some(0.0), "{even:?}");
    }
}
