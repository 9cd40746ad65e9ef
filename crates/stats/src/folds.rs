//! Folds: the rows held out together, and the neighbours that train nothing for them. One rule for every method.
//!
//! Neighbouring rows of a log resemble each other, so that no fold is drawn row by row. With enough episodes folds are
//! whole episodes. With few, every episode is cut into contiguous spans, at least [`SPANS`] of them, that belong to the
//! folds in turn: each fold sees every episode. Rows on either side of a held-out span train nothing for it if they are
//! made of the same samples. The same holds for rows that are correlated with it, up to a tenth of a span.

use std::{collections::BTreeMap, ops::Range};

use fleetfoot_data::setting::FOLDS;
use fleetfoot_data::{Canonical, EpisodeId};

use crate::Fold;

/// Spans that an episode is cut into, at least, and episodes from which on whole ones are held out.
pub const SPANS: usize = 5;
/// Folds where nobody says how many, and where the rows are few.
const USUAL_FOLDS: usize = 10;
const FEWER: usize = 5;
/// Rows of a fold, at least, where nobody says how many folds there are.
const ROWS: usize = 10;
/// Share of a span that its neighbours' purge gap takes, at most.
const TENTH: usize = 10;

/// Rule by which rows are held out together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum FoldRule {
    /// Ten folds, five of few rows.
    #[default]
    Auto,
    /// This many folds.
    Count(usize),
    /// Every episode once.
    Episodes,
}

/// Rows on either side of a held-out span that train nothing for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purge {
    /// Exactly this many; the caller must ensure that spans are longer.
    Exactly(usize),
    /// Rows that resemble the held-out rows, by shared samples or by correlation.
    Alike {
        /// Rows on either side that are made of the same samples as a row: lags and differences reach over them, smoothing mixed them. All of them are left
        /// out, up to the whole neighbouring span.
        shared: usize,
        /// Rows over which the log is correlated: left out as far as they are no more than a tenth of the span.
        correlated: usize,
    },
}

impl Purge {
    /// A tenth of a span: where nobody knows over how many rows the log is correlated.
    pub const TENTH: Self = Self::Alike { shared: 0, correlated: usize::MAX };

    /// Rows beside spans of this length.
    pub fn rows(self, span: usize) -> usize {
        match self {
            Self::Exactly(_) => self.certain(span),
            Self::Alike { correlated, .. } => correlated.min(span / TENTH).max(self.certain(span)),
        }
    }

    /// Those of them that are left out even where many rows were summed in one piece.
    pub fn certain(self, span: usize) -> usize {
        match self {
            Self::Exactly(rows) => rows,
            Self::Alike { shared, .. } => shared.min(span),
        }
    }
}

/// Folds that cannot be made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FoldError {
    /// Fewer than two folds, or more than the limit.
    #[error("{count} folds are asked for: write a number from 2 to 65535 ({FOLDS})")]
    Count {
        /// Number of folds asked for.
        count: usize,
    },
    /// One episode cannot be left out and fitted on.
    #[error(
        "leaving every episode out once needs 2 episodes or more, and there is {episodes}: {given_folds} cuts it into spans instead", given_folds = FOLDS.to(10)
    )]
    Episodes {
        /// Number of episodes that have rows.
        episodes: usize,
    },
    /// A fold would hold out nothing.
    #[error(
        "{folds} folds of spans need episodes of {spans} rows or more, and the longest of {episodes} has {rows}: ask for fewer folds ({FOLDS}), or give more data"
    )]
    Rows {
        /// Number of folds.
        folds: usize,
        /// Spans of an episode.
        spans: usize,
        /// Number of episodes.
        episodes: usize,
        /// Rows of the longest.
        rows: usize,
    },
}

/// The folds of some episodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoldLayout {
    folds: u16,
    cut: Cut,
    purge: Purge,
    /// Rows of the longest episode.
    longest: usize,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Cut {
    /// The fold of every episode.
    Episodes(BTreeMap<EpisodeId, u16>),
    /// Every episode, into so many spans.
    Spans(usize),
}

impl FoldLayout {
    /// Adds all that says which rows are in which fold.
    pub fn encode(&self, out: &mut Canonical) {
        out.count(self.folds.into());
        match &self.cut {
            Cut::Episodes(folds) => {
                out.tag(0);
                out.count(folds.len() as u64);
                for (episode, &fold) in folds {
                    out.bytes(&episode.0.to_le_bytes());
                    out.count(fold.into());
                }
            }
            Cut::Spans(spans) => {
                out.tag(1);
                out.count(*spans as u64);
            }
        }
        match self.purge {
            Purge::Exactly(rows) => {
                out.tag(0);
                out.count(rows as u64);
            }
            Purge::Alike { correlated, shared } => {
                out.tag(1);
                [correlated, shared].into_iter().for_each(|rows| out.count(rows as u64));
            }
        }
        out.count(self.longest as u64);
    }

    /// Folds of episodes by their rows; episodes without rows are in no fold.
    ///
    /// Whole episodes are folds where there are as many as folds, and at least [`SPANS`]: the longest first, each to the fold with the fewest rows.
    /// Otherwise every episode is cut into the least multiple of the number of folds that is [`SPANS`] or more.
    ///
    /// # Errors
    /// Folds that cannot be made as they are asked for; another number is never taken in silence.
    pub fn new(
        rule: FoldRule,
        episodes: impl IntoIterator<Item = (EpisodeId, usize)>,
        purge: Purge,
    ) -> Result<Self, FoldError> {
        let mut rows: BTreeMap<EpisodeId, usize> = BTreeMap::new();
        episodes
            .into_iter()
            .filter(|(_, rows)| *rows > 0)
            .for_each(|(id, count)| *rows.entry(id).or_insert(0) += count);
        let (episodes, longest) = (rows.len(), rows.values().copied().max().unwrap_or(0));
        let count = match rule {
            FoldRule::Count(count) => count,
            FoldRule::Episodes if episodes < 2 => return Err(FoldError::Episodes { episodes }),
            FoldRule::Episodes => episodes,
            FoldRule::Auto if rows.values().sum::<usize>() >= USUAL_FOLDS * ROWS => USUAL_FOLDS,
            FoldRule::Auto => FEWER,
        };
        let folds = u16::try_from(count).ok().filter(|&folds| folds >= 2).ok_or(FoldError::Count { count })?;
        let whole = rule == FoldRule::Episodes || episodes >= count.max(SPANS);
        let cut = if whole {
            Cut::Episodes(balanced(&rows, count))
        } else {
            let spans = count * SPANS.div_ceil(count);
            if longest < spans {
                return Err(FoldError::Rows { folds: count, spans, episodes, rows: longest });
            }
            Cut::Spans(spans)
        };
        Ok(Self { folds, cut, purge, longest })
    }

    /// Number of folds.
    pub fn folds(&self) -> u16 {
        self.folds
    }

    /// Returns true if folds are whole episodes.
    pub fn whole_episodes(&self) -> bool {
        matches!(self.cut, Cut::Episodes(_))
    }

    /// The spans of an episode of so many rows, in order, and the fold that holds each out; one where folds are whole episodes, none of no rows.
    pub fn spans(&self, episode: EpisodeId, rows: usize) -> Vec<(Range<usize>, u16)> {
        let spans = match &self.cut {
            Cut::Episodes(folds) => vec![(0..rows, folds.get(&episode).copied().unwrap_or(0))],
            Cut::Spans(count) => {
                let border = |span: usize| (span as u128 * rows as u128 / *count as u128) as usize;
                (0..*count)
                    .map(|span| (border(span)..border(span + 1), (span % usize::from(self.folds)) as u16))
                    .collect()
            }
        };
        spans.into_iter().filter(|(span, _)| !span.is_empty()).collect()
    }

    /// The same, cut where the purge gaps of the neighbours begin and end: the rows of a piece have one place in cross-validation.
    pub fn pieces(&self, episode: EpisodeId, rows: usize) -> Vec<(Range<usize>, Fold)> {
        let spans = self.spans(episode, rows);
        let mut pieces = Vec::with_capacity(3 * spans.len());
        for (at, (span, fold)) in spans.iter().enumerate() {
            let gap = self.gap(&spans, at);
            let mut cuts = [span.start, gap.start, gap.end, span.end];
            cuts.sort_unstable();
            for pair in cuts.windows(2).filter(|pair| pair[0] < pair[1]) {
                let purged = self.neighbours(&spans, at, &(pair[0]..pair[1]));
                pieces.push((pair[0]..pair[1], Fold { held_out: *fold, purged }));
            }
        }
        pieces
    }

    /// The place in cross-validation of rows that were summed together, of an episode of so many rows: the span that their middle lies in holds them
    /// out, and they train nothing for a neighbour when they reach into its purge gap. Rows longer than a tenth of a span are in no gap that is there for
    /// correlation alone.
    pub fn place(&self, episode: EpisodeId, rows: usize, unit: Range<usize>) -> Fold {
        let spans = self.spans(episode, rows);
        let middle = unit.start + unit.len() / 2;
        let Some(at) = spans.iter().position(|(span, _)| middle < span.end) else {
            return Fold::default();
        };
        Fold { held_out: spans[at].1, purged: self.neighbours(&spans, at, &unit) }
    }

    /// The rows of a span that train for both of its neighbours.
    fn gap(&self, spans: &[(Range<usize>, u16)], at: usize) -> Range<usize> {
        self.within(spans, at, |span| self.purge.rows(span))
    }

    /// A span without the rows that `gap` takes beside its neighbours.
    fn within(&self, spans: &[(Range<usize>, u16)], at: usize, gap: impl Fn(usize) -> usize) -> Range<usize> {
        let span = &spans[at].0;
        let before = if at > 0 { gap(spans[at - 1].0.len().min(span.len())) } else { 0 };
        let after = spans.get(at + 1).map_or(0, |(next, _)| gap(next.len().min(span.len())));
        span.start.saturating_add(before).min(span.end)..span.end.saturating_sub(after).max(span.start)
    }

    /// The neighbouring folds that rows of a span do not train for.
    fn neighbours(&self, spans: &[(Range<usize>, u16)], at: usize, unit: &Range<usize>) -> [Option<u16>; 2] {
        // Rows that were summed in one piece are purged in one piece; for correlation alone only if they are no more than a gap may be.
        let span = &spans[at].0;
        let small = unit.len() <= (span.len() / TENTH).max(1);
        let inner = if small { self.gap(spans, at) } else { self.within(spans, at, |span| self.purge.certain(span)) };
        // Pieces that reach over a border without a gap stay.
        let previous = inner.start > span.start && unit.start < inner.start;
        let next = inner.end < span.end && unit.end > inner.end;
        [previous.then(|| spans[at - 1].1), next.then(|| spans[at + 1].1)]
    }

    /// The rule for people: `10 folds of spans, 10 in every episode (51 rows of the longest), 5 rows beside a span left out`.
    pub fn in_words(&self) -> String {
        let folds = self.folds;
        match &self.cut {
            Cut::Episodes(of) if of.len() == usize::from(folds) => {
                format!("every one of {folds} episodes left out once")
            }
            Cut::Episodes(of) => format!("{folds} folds of {} whole episodes", of.len()),
            Cut::Spans(spans) => {
                let span = self.longest / spans;
                let gap = match self.purge.rows(span) {
                    0 => "no gap beside them".to_owned(),
                    1 => "a gap of 1 row on either side".to_owned(),
                    rows => format!("a gap of {rows} rows on either side"),
                };
                format!("{folds} folds of spans, {spans} an episode of up to {span} rows, {gap}")
            }
        }
    }
}

/// The fold of every episode: the longest first, each to the fold with the fewest rows, then the fewest episodes, then the first.
fn balanced(episodes: &BTreeMap<EpisodeId, usize>, folds: usize) -> BTreeMap<EpisodeId, u16> {
    let mut order: Vec<(EpisodeId, usize)> = episodes.iter().map(|(id, rows)| (*id, *rows)).collect();
    order.sort_by_key(|&(id, rows)| (std::cmp::Reverse(rows), id));
    let mut filled: std::collections::BinaryHeap<_> = (0..folds).map(|fold| std::cmp::Reverse((0, 0, fold))).collect();
    let mut of = BTreeMap::new();
    for (id, rows) in order {
        if let Some(std::cmp::Reverse((load, count, fold))) = filled.pop() {
            of.insert(id, fold as u16);
            filled.push(std::cmp::Reverse((load + rows, count + 1, fold)));
        }
    }
    of
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episodes(lengths: &[usize]) -> Vec<(EpisodeId, usize)> {
        lengths.iter().enumerate().map(|(e, &rows)| (EpisodeId(e as u128 * 7), rows)).collect()
    }

    fn alike(shared: usize, correlated: usize) -> Purge {
        Purge::Alike { shared, correlated }
    }

    fn layout(rule: FoldRule, lengths: &[usize], purge: Purge) -> FoldLayout {
        FoldLayout::new(rule, episodes(lengths), purge).unwrap()
    }

    #[test]
    fn layout_has_the_requested_folds() {
        for (rule, folds, spans) in [
            (FoldRule::Auto, 10, 10),
            (FoldRule::Count(2), 2, 6),
            (FoldRule::Count(4), 4, 8),
            (FoldRule::Count(7), 7, 7),
            (FoldRule::Count(10), 10, 10),
        ] {
            let layout = layout(rule, &[512, 512], Purge::TENTH);
            assert_eq!(layout.folds(), folds, "{rule:?}");
            for (id, rows) in episodes(&[512, 512]) {
                let cut = layout.spans(id, rows);
                assert_eq!(cut.len(), spans, "{rule:?}");
                assert!(cut.iter().enumerate().all(|(at, (_, fold))| usize::from(*fold) == at % usize::from(folds)));
            }
        }
        let whole = layout(FoldRule::Episodes, &[512, 512], Purge::TENTH);
        assert_eq!((whole.folds(), whole.whole_episodes()), (2, true));
        assert_eq!(layout(FoldRule::Auto, &[20, 30], Purge::TENTH).folds(), 5);
    }

    #[test]
    fn impossible_folds_are_refused() {
        let new = |rule, lengths: &[usize]| FoldLayout::new(rule, episodes(lengths), Purge::TENTH).unwrap_err();
        assert_eq!(new(FoldRule::Count(1), &[100]), FoldError::Count { count: 1 });
        assert_eq!(new(FoldRule::Count(70_000), &[100]), FoldError::Count { count: 70_000 });
        assert_eq!(new(FoldRule::Episodes, &[100, 0]), FoldError::Episodes { episodes: 1 });
        let rows = FoldError::Rows { folds: 200, spans: 200, episodes: 2, rows: 100 };
        assert_eq!(new(FoldRule::Count(200), &[100, 50]), rows);
    }

    #[test]
    fn gaps_are_no_more_than_a_tenth_of_a_span() {
        for (purge, gap) in [
            (Purge::TENTH, 10),
            (alike(0, 3), 3),
            (alike(4, 3), 4),
            (alike(25, usize::MAX), 25),
            (Purge::Exactly(25), 25),
        ] {
            let layout = layout(FoldRule::Count(10), &[1000], purge);
            let pieces = layout.pieces(EpisodeId(0), 1000);
            for fold in 0..10 {
                let rows = |wanted: &dyn Fn(&Fold) -> bool| -> Vec<usize> {
                    pieces.iter().filter(|(_, place)| wanted(place)).flat_map(|(rows, _)| rows.clone()).collect()
                };
                let (held, trained) = (rows(&|place| place.held_out == fold), rows(&|place| place.trains(fold)));
                let sides = if fold == 0 || fold == 9 { 1 } else { 2 };
                assert_eq!((held.len(), trained.len()), (100, 900 - sides * gap));
                assert!(trained.iter().all(|t| held.iter().all(|h| t.abs_diff(*h) > gap)));
            }
        }
    }

    #[test]
    fn chunks_are_held_out_whole() {
        let layout = layout(FoldRule::Count(5), &[500], alike(0, 7));
        let place = |rows: Range<usize>| layout.place(EpisodeId(0), 500, rows);
        assert_eq!(place(100..105), Fold { held_out: 1, purged: [Some(0), None] });
        assert_eq!(place(105..110), Fold { held_out: 1, purged: [Some(0), None] });
        assert_eq!(place(110..115), Fold { held_out: 1, purged: [None; 2] });
        assert_eq!(place(195..200), Fold { held_out: 1, purged: [None, Some(2)] });
        // 40 rows are more than a tenth of a span; they stay.
        assert_eq!(place(90..130), Fold { held_out: 1, purged: [None; 2] });
        assert_eq!(place(0..5), Fold { held_out: 0, purged: [None; 2] });
    }

    #[test]
    fn rows_with_shared_samples_are_purged() {
        let layout = layout(FoldRule::Count(5), &[500], alike(3, 7));
        let place = |rows: Range<usize>| layout.place(EpisodeId(0), 500, rows);
        assert_eq!(place(102..140), Fold { held_out: 1, purged: [Some(0), None] });
        assert_eq!(place(103..140), Fold { held_out: 1, purged: [None; 2] });
        assert_eq!(place(100..198), Fold { held_out: 1, purged: [Some(0), Some(2)] });
        assert_eq!(place(105..110), Fold { held_out: 1, purged: [Some(0), None] });
    }

    #[test]
    fn enough_episodes_are_held_out_whole_and_evenly() {
        let lengths = [100, 200, 300, 101, 102, 50];
        let layout = layout(FoldRule::Count(3), &lengths, Purge::TENTH);
        let mut load = [0; 3];
        for (id, rows) in episodes(&lengths) {
            let pieces = layout.pieces(id, rows);
            assert_eq!((pieces.len(), pieces[0].1.purged), (1, [None; 2]));
            load[usize::from(pieces[0].1.held_out)] += rows;
        }
        assert!(load.iter().all(|&rows| (252..=303).contains(&rows)), "{load:?}");
    }
}
