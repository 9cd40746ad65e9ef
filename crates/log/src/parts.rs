//! Parts of the episodes of a recording as its episodes.

use std::ops::Range;

use fleetfoot_data::{Fingerprint, Halo, Progress};

use crate::{
    Error, Recording, Selection,
    index::{Span, uniform_stamp},
    recording::refuse_duplicates,
};

/// Stamps read at once.
const ROWS: usize = 65_536;

impl Recording {
    /// The recording, which was opened by this selection, of some of its rows: every part, an episode and its rows, is an episode of its own; the order is that of the list. Whole episodes stay what they are.
    ///
    /// # Errors
    /// Those of reading; the same values twice, where rows have no stamps of their own.
    pub fn parts(
        mut self,
        parts: &[(usize, Range<usize>)],
        selection: &Selection,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        progress.stage("parting episodes");
        let mut spans = Vec::with_capacity(parts.len());
        for (episode, rows) in parts.iter().filter(|(_, rows)| !rows.is_empty()) {
            if progress.cancelled() {
                return Err(fleetfoot_data::Cancelled.into());
            }
            spans.push(self.span(*episode, rows.clone())?);
        }
        self.places.clear();
        self.episodes.clear();
        self.add_episodes(spans, &selection.label_rules, progress)?;
        if !selection.allow_duplicates {
            refuse_duplicates(&self.episodes)?;
        }
        Ok(self)
    }

    /// Some rows of an episode, and the file that they are in.
    fn span(&self, episode: usize, rows: Range<usize>) -> Result<(usize, Span), Error> {
        let (whole, place) = (&self.episodes[episode], self.places[episode]);
        let mut span = Span {
            first: place.first + rows.start,
            rows: rows.len(),
            start: whole.start,
            end: whole.end,
            period: if rows.len() > 1 { whole.period } else { 0.0 },
            fingerprint: Fingerprint::new(),
        };
        for first in rows.clone().step_by(ROWS) {
            let piece = first..(first + ROWS).min(rows.end);
            let stamps = match self.dt {
                // Rows without stamps of their own begin at zero in every episode.
                Some(dt) => piece.map(|row| uniform_stamp(row - rows.start, dt)).collect::<Vec<_>>().into(),
                None => self.read_block(episode, piece, Halo::default())?.time,
            };
            if let (true, Some(&stamp)) = (first == rows.start, stamps.first()) {
                span.start = stamp;
            }
            span.end = stamps.last().copied().unwrap_or(span.end);
            span.fingerprint.stamps(&stamps);
        }
        Ok((place.file, span))
    }
}
