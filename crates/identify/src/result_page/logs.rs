//! The logs that models are held against.

use fleetfoot_data::Episode;
use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Cell, Chart, Figure, Part, Section, Span, Spans, Table,
    words::{count, number, seconds, series, thousands},
};

use super::coverage::{self, Coverage};
use crate::Dataset;

/// Logs that are drawn, and logs that stand unfolded in the table.
const DRAWN: usize = 24;
const LISTED: usize = 12;
/// Names that are written out.
const NAMES: usize = 4;

/// The episodes of logs.
pub(super) struct Seen {
    pub(super) episodes: Vec<Episode>,
    pub(super) notes: Vec<String>,
    /// Names of the episodes that trained the first model, as a whole or in part.
    trained: Vec<String>,
}

impl Seen {
    /// What is opened for the first model.
    pub(super) fn of(model: &Model, dataset: &Dataset) -> Self {
        Self {
            episodes: dataset.episodes().to_vec(),
            notes: dataset.notes().to_vec(),
            trained: dataset.in_sample(model),
        }
    }

    /// Parts of logs that trained it are known once their rows have been read.
    pub(super) fn learn(&mut self, trained: &[String]) {
        self.trained = trained.to_vec();
    }

    fn rows(&self) -> usize {
        self.episodes.iter().map(|episode| episode.rows).sum()
    }

    pub(super) fn in_words(&self) -> String {
        let names: Vec<String> = self.episodes.iter().map(|episode| episode.name.clone()).collect();
        format!(
            "{} rows of {}: {}",
            thousands(self.rows() as u64),
            count(names.len(), "episode"),
            series(&names, NAMES)
        )
    }

    fn is_trained(&self, episode: &Episode) -> bool {
        self.trained.contains(&episode.name)
    }

    /// The logs in time and as a table, and how far the columns of their rows reach.
    pub(super) fn section(&self, columns: &[Coverage]) -> Section {
        let mut parts = vec![Part::Paragraph(self.about())];
        parts.extend(self.drawn().map(Part::Figure));
        parts.push(Part::Table(self.table(&self.episodes[..self.episodes.len().min(LISTED)])));
        if self.episodes.len() > LISTED {
            let rest = self.table(&self.episodes[LISTED..]);
            parts.push(Part::Fold(format!("{} more episodes", self.episodes.len() - LISTED), vec![Part::Table(rest)]));
        }
        parts.extend(coverage::parts(columns));
        parts.extend(self.notes.iter().map(|note| Part::Paragraph(format!("Note: {note}."))));
        Section::new("data", "Data", parts)
    }

    fn about(&self) -> String {
        let trained = self.episodes.iter().filter(|episode| self.is_trained(episode)).count();
        let total: f64 = self.episodes.iter().map(Episode::duration).sum();
        let held = match trained {
            0 => "none of them trained the model".to_owned(),
            trained => {
                format!("{trained} of them trained the model, as a whole or in part, so scores on them are in-sample")
            }
        };
        format!(
            "{} of {} rows, {} together; {held}. An episode is an uninterrupted stretch of a log: gaps end it.",
            count(self.episodes.len(), "episode"),
            thousands(self.rows() as u64),
            seconds(total)
        )
    }

    /// Where each log has rows, from its own start on: episodes of one file stand in one row, with the gaps between them.
    fn drawn(&self) -> Option<Figure> {
        let mut rows: Vec<(String, i64, Vec<Span>)> = Vec::new();
        for episode in &self.episodes {
            let name = file_of(&episode.name);
            if rows.last().is_none_or(|(last, _, _)| *last != name) {
                rows.push((name, episode.start, Vec::new()));
            }
            if let Some((_, start, spans)) = rows.last_mut() {
                let at = |stamp: i64| (stamp - *start) as f64 * 1e-9;
                let kind = usize::from(self.is_trained(episode));
                spans.push(Span { from: at(episode.start), to: at(episode.end), kind });
            }
        }
        let total = rows.len();
        let rows: Vec<(String, Vec<Span>)> =
            rows.into_iter().take(DRAWN).map(|(name, _, spans)| (name, merged(spans))).collect();
        if rows.iter().all(|(_, spans)| spans.iter().all(|span| span.to <= span.from)) {
            return None;
        }
        let kinds = if self.episodes.iter().any(|episode| self.is_trained(episode)) {
            vec!["did not train the model".to_owned(), "trained the model".to_owned()]
        } else {
            vec!["rows".to_owned()]
        };
        let more = if total > DRAWN { format!(" Shown are {DRAWN} of {total} logs.") } else { String::new() };
        let caption =
            format!("Where each log has rows, from its first one on; what is empty between them is a gap.{more}");
        let chart = Spans::new(Axis::of("time since the start of the log", "s").with_zero(), kinds, rows);
        Some(Figure::new("logs-in-time", "Rows in time", caption, Chart::Spans(chart)))
    }

    fn table(&self, episodes: &[Episode]) -> Table {
        let mut table = Table::new("Episodes.", ["episode", "rows", "length", "rate [Hz]", "in training"]);
        for episode in episodes {
            let rate = if episode.period > 0.0 { number(1.0 / episode.period) } else { "-".to_owned() };
            let seen = if self.is_trained(episode) { "yes" } else { "no" };
            table = table.row([
                Cell::Text(episode.name.clone()),
                Cell::Number(thousands(episode.rows as u64)),
                Cell::Number(seconds(episode.duration())),
                Cell::Number(rate),
                Cell::Text(seen.to_owned()),
            ]);
        }
        table
    }
}

/// The log that an episode is of.
fn file_of(name: &str) -> String {
    name.rsplit_once('#').map_or(name, |(file, _)| file).to_owned()
}

/// Spans a log at most: neighbours with the least gaps between them are joined, so that a log of ten thousand episodes is drawn in as many strokes as can be seen.
const SPANS: usize = 400;

fn merged(spans: Vec<Span>) -> Vec<Span> {
    if spans.len() <= SPANS {
        return spans;
    }
    let mut gaps: Vec<f64> = spans.windows(2).map(|pair| pair[1].from - pair[0].to).collect();
    gaps.sort_by(|a, b| b.total_cmp(a));
    let least = gaps[SPANS - 1];
    let mut joined: Vec<Span> = Vec::new();
    for span in spans {
        match joined.last_mut() {
            Some(last) if last.kind == span.kind && span.from - last.to <= least => last.to = span.to,
            _ => joined.push(span),
        }
    }
    joined
}
