//! The logs that models are held against.

use std::ops::Range;

use fleetfoot_data::Episode;
use fleetfoot_dataset::{Dataset, clocks::AlignedClock};
use fleetfoot_fit::Error;
use fleetfoot_log::TopicInfo;
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;
use fleetfoot_report::{
    Axis, Cell, Chart, Figure, Part, Section, Span, Spans, Table,
    words::{count, number, seconds, series, thousands, within},
};

use crate::{coverage, missing, passed::Passed};

/// Logs that are drawn, and logs that stand unfolded in the table.
const DRAWN: usize = 24;
const LISTED: usize = 12;
/// Clocks that are farther apart, seconds, are not set to the same time: simulated ones, for example.
const DAY: f64 = 86_400.0;
/// The kind of spans in which rows are lost.
const LOST: usize = 2;
/// Names that are written out.
const NAMES: usize = 4;

/// The episodes of logs.
pub(crate) struct Seen {
    pub(crate) episodes: Vec<Episode>,
    pub(crate) notes: Vec<String>,
    /// Names of the episodes that trained the first model, as a whole or in part.
    trained: Vec<String>,
    /// Source of the stamps, and the clocks of other computers.
    stamps: String,
    clocks: Vec<AlignedClock>,
    /// The channels that rows are made of, in the first log.
    topics: Vec<TopicInfo>,
}

impl Seen {
    /// Episodes and channels opened for the first model.
    pub(crate) fn of(model: &Model, changes: &Recipe, dataset: &Dataset) -> Result<Self, Error> {
        Ok(Self {
            episodes: dataset.episodes().to_vec(),
            notes: dataset.notes().to_vec(),
            trained: dataset.in_sample(model),
            stamps: stamps(&Dataset::recipe_of_run(model, changes)?),
            clocks: dataset.clocks().to_vec(),
            topics: dataset.topics().cloned().collect(),
        })
    }

    /// Parts of logs that trained it are known once their rows have been read.
    pub(crate) fn learn(&mut self, trained: &[String]) {
        self.trained = trained.to_vec();
    }

    fn rows(&self) -> usize {
        self.episodes.iter().map(|episode| episode.rows).sum()
    }

    pub(crate) fn in_words(&self) -> String {
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
    pub(crate) fn section(&self, passed: Option<&Passed>) -> Section {
        let columns = passed.map_or(&[][..], |passed| &passed.columns);
        let mut parts = vec![Part::Paragraph(self.about())];
        parts.extend((!self.stamps.is_empty()).then(|| Part::Paragraph(self.stamps.clone())));
        parts.extend(self.drawn(passed).map(Part::Figure));
        parts.extend(missing::columns(columns, &self.episodes).map(Part::Figure));
        parts.push(Part::Table(self.table(0..self.episodes.len().min(LISTED), passed)));
        parts.extend((!self.topics.is_empty()).then(|| Part::Table(channels(&self.topics))));
        parts.extend((!self.clocks.is_empty()).then(|| Part::Table(clocks(&self.clocks))));
        if self.episodes.len() > LISTED {
            let rest = self.table(LISTED..self.episodes.len(), passed);
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

    /// Spans with rows of each log, from its start on: episodes of one file stand in one row, with the gaps between
    /// them.
    fn drawn(&self, passed: Option<&Passed>) -> Option<Figure> {
        let mut rows: Vec<(String, i64, Vec<Span>)> = Vec::new();
        let mut lost: Vec<Vec<Span>> = Vec::new();
        for (index, episode) in self.episodes.iter().enumerate() {
            let name = file_of(&episode.name);
            if rows.last().is_none_or(|(last, _, _)| *last != name) {
                rows.push((name, episode.start, Vec::new()));
                lost.push(Vec::new());
            }
            if let (Some((_, start, spans)), Some(lost)) = (rows.last_mut(), lost.last_mut()) {
                let at = |stamp: i64| (stamp - *start) as f64 * 1e-9;
                let kind = usize::from(self.is_trained(episode));
                spans.push(Span { from: at(episode.start), to: at(episode.end), kind });
                let gaps = passed.map_or_else(Vec::new, |passed| passed.lost.spans(index));
                lost.extend(gaps.into_iter().map(|[from, to]| {
                    let ends = [from, to].map(|since| at(episode.start) + since.min(episode.duration()));
                    Span { from: ends[0], to: ends[1], kind: LOST }
                }));
            }
        }
        let total = rows.len();
        // Marks of lost rows lie over the rows.
        let over = |(name, spans, lost): (String, Vec<Span>, Vec<Span>)| {
            (name, merged(spans).into_iter().chain(merged(lost)).collect::<Vec<Span>>())
        };
        let rows = rows.into_iter().zip(lost).take(DRAWN).map(|((name, _, spans), lost)| over((name, spans, lost)));
        let rows: Vec<(String, Vec<Span>)> = rows.collect();
        if rows.iter().all(|(_, spans)| spans.iter().all(|span| span.to <= span.from)) {
            return None;
        }
        let is_lost = rows.iter().flat_map(|(_, spans)| spans).any(|span| span.kind == LOST);
        let is_trained = self.episodes.iter().any(|episode| self.is_trained(episode));
        let mut kinds = match (is_trained, is_lost) {
            (false, false) => vec!["rows"],
            _ => vec!["did not train the model", "trained the model"],
        };
        kinds.extend(is_lost.then_some("rows are lost to missing values"));
        let kinds: Vec<String> = kinds.into_iter().map(str::to_owned).collect();
        let more = if total > DRAWN { format!(" Shown are {DRAWN} of {total} logs.") } else { String::new() };
        let caption =
            format!("Rows of each log over time, from its first one on; empty parts between them are gaps.{more}");
        let chart = Spans::new(Axis::of("time since the start of the log", "s").with_zero(), kinds, rows);
        Some(Figure::new("logs-in-time", "Rows in time", caption, Chart::Spans(chart)))
    }

    fn table(&self, episodes: Range<usize>, passed: Option<&Passed>) -> Table {
        let lost = passed.filter(|passed| passed.lost.any());
        let head = ["episode", "rows", "length", "rate [Hz]", "in training"];
        let mut table = Table::new("Episodes.", head.into_iter().chain(lost.map(|_| "rows lost")));
        for index in episodes {
            let episode = &self.episodes[index];
            let rate = if episode.period > 0.0 { number(1.0 / episode.period) } else { "-".to_owned() };
            let seen = if self.is_trained(episode) { "yes" } else { "no" };
            table = table.row(
                [
                    Cell::Text(episode.name.clone()),
                    Cell::Number(thousands(episode.rows as u64)),
                    Cell::Number(seconds(episode.duration())),
                    Cell::Number(rate),
                    Cell::Text(seen.to_owned()),
                ]
                .into_iter()
                .chain(lost.map(|passed| Cell::Number(thousands(passed.lost.rows(index))))),
            );
        }
        table
    }
}

/// Sentence about the source of the rows' stamps, by the recipe.
fn stamps(recipe: &Recipe) -> String {
    let time = &recipe.time;
    let unit = time.unit.as_ref().map_or_else(String::new, |unit| format!(" [{unit}]"));
    let of_logs = |stamp: &String| match stamp.as_str() {
        "header" => "Stamps are those of the messages\u{2019} headers.".to_owned(),
        "log" => "Stamps are the times at which messages were recorded.".to_owned(),
        "publish" => "Stamps are the times at which messages were sent.".to_owned(),
        other => format!("Stamps are those of {other}."),
    };
    let sentences = [
        time.column.as_ref().map(|column| format!("Stamps are those of {column}{unit}.")),
        time.dt.map(|dt| format!("Rows are {} apart, as the recipe says.", seconds(dt))),
        time.stamp.as_ref().map(of_logs),
        time.base.as_ref().map(|base| format!("The messages of {base} make the rows.")),
        time.rate.map(|rate| {
            format!("There are {} rows a second, made of the channels between their samples.", number(rate))
        }),
        time.smoothed.map(|over| format!("Rows were smoothed over {}.", seconds(over))),
    ];
    sentences.into_iter().flatten().collect::<Vec<_>>().join(" ")
}

/// Table of the channels before they are joined to rows.
fn channels(topics: &[TopicInfo]) -> Table {
    let caption = "Channels that the model reads, in the first log, before they are joined to rows. A gap is longer than five median periods; headers are compared with the times at which messages \
                   were recorded.";
    let head = ["channel", "messages", "rate [Hz]", "gaps", "longest gap", "headers are behind by"];
    let known = |text: Option<String>| Cell::Number(text.unwrap_or_else(|| "-".to_owned()));
    topics.iter().take(DRAWN).fold(Table::new(caption, head), |table, topic| {
        let behind = topic.header_offset.map(|offset| match [offset.first, offset.last] {
            _ if offset.zero => "headers are zero".to_owned(),
            [first, _] if first.abs() > DAY => "another clock".to_owned(),
            [first, last] => format!("{} to {} ms", number(1e3 * first), number(1e3 * last)),
        });
        table.row([
            Cell::Text(topic.name.clone()),
            known(topic.messages.map(thousands)),
            known(topic.rate.map(number)),
            known(topic.gaps.map(|gaps| gaps.to_string())),
            known(topic.largest_gap.map(seconds)),
            known(behind),
        ])
    })
}

/// Table of clock offsets of other computers.
fn clocks(clocks: &[AlignedClock]) -> Table {
    let caption = "Clock offsets of other computers to the first one, with 95 % intervals.";
    let head = ["clock", "log", "by", "offset [ms]", "skew [ppm]"];
    clocks.iter().take(DRAWN).fold(Table::new(caption, head), |table, clock| {
        let half = |[low, high]: [f64; 2]| 0.5 * (high - low);
        let within = |value: f64, interval, factor: f64| Cell::Number(within(factor * value, factor * half(interval)));
        table.row([
            Cell::Text(clock.clock.clone()),
            Cell::Text(clock.log.clone()),
            Cell::Text(clock.by.clone()),
            within(clock.offset, clock.offset_interval, 1e3),
            within(clock.skew, clock.skew_interval, 1e6),
        ])
    })
}

/// The log that an episode is of.
fn file_of(name: &str) -> String {
    name.rsplit_once('#').map_or(name, |(file, _)| file).to_owned()
}

/// Spans a log at most. Neighbours with the least gaps between them are joined, so that a log of ten thousand episodes
/// is drawn in as many strokes as can be seen.
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
