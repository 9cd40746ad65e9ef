//! Missing values: channels that were rejected, that began late or ended early, and the rows that they cost.

use std::{collections::BTreeMap, sync::Arc};

use fleetfoot_data::Episode;
use fleetfoot_report::{Axis, Bins, Chart, Figure, Span, Spans};

use crate::coverage::{Coverage, MISSING};

/// Bins along the time of an episode.
const OF_EPISODE: usize = 128;
/// Columns that are drawn.
const DRAWN: usize = 24;

/// Rows that a missing value takes from the scores, by episode.
#[derive(Clone)]
pub(crate) struct Lost {
    /// Seconds before each episode, if they stood one behind the other.
    before: Arc<Vec<f64>>,
    /// Seconds between the rows of each.
    periods: Arc<Vec<f64>>,
    /// By the seconds since the start of the episode; none where none are lost.
    episodes: BTreeMap<usize, Bins>,
}

impl Lost {
    pub(crate) fn new(episodes: &[Episode]) -> Self {
        let before = episodes.iter().scan(0.0, |sum, episode| {
            let before = *sum;
            *sum += episode.duration();
            Some(before)
        });
        let periods = episodes.iter().map(|episode| episode.period).collect();
        Self { before: Arc::new(before.collect()), periods: Arc::new(periods), episodes: BTreeMap::new() }
    }

    /// Seconds of the episodes before one.
    pub(crate) fn before(&self, episode: usize) -> f64 {
        self.before[episode]
    }

    /// A row of an episode is lost, so many seconds after its start.
    pub(crate) fn add(&mut self, episode: usize, seconds: f64) {
        self.episodes.entry(episode).or_insert_with(|| Bins::new(OF_EPISODE)).add(seconds, 1.0);
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        for (&episode, bins) in &other.episodes {
            self.episodes.entry(episode).or_insert_with(|| Bins::new(OF_EPISODE)).merge(bins);
        }
    }

    pub(crate) fn any(&self) -> bool {
        !self.episodes.is_empty()
    }

    /// Lost rows of an episode.
    pub(crate) fn rows(&self, episode: usize) -> u64 {
        self.episodes.get(&episode).map_or(0, |bins| bins.counts().iter().sum())
    }

    /// Spans without values, seconds since the start of the episode.
    pub(crate) fn spans(&self, episode: usize) -> Vec<[f64; 2]> {
        self.episodes.get(&episode).map_or_else(Vec::new, |bins| spans(bins, self.periods[episode]))
    }
}

/// Runs of bins that have something: bins narrower than the rows are apart are empty here and there.
fn spans(bins: &Bins, period: f64) -> Vec<[f64; 2]> {
    let half = 0.5 * bins.width();
    let mut spans: Vec<[f64; 2]> = Vec::new();
    for (place, _) in bins.places().into_iter().zip(bins.counts()).filter(|(_, count)| *count > 0) {
        let [from, to] = [(place - half).max(0.0), place + half];
        match spans.last_mut() {
            Some(last) if from <= last[1] + period => last[1] = to,
            _ => spans.push([from, to]),
        }
    }
    spans
}

/// The columns that lack values, and when.
pub(crate) fn columns(columns: &[Coverage], episodes: &[Episode]) -> Option<Figure> {
    let total: f64 = episodes.iter().map(Episode::duration).sum();
    let period = episodes.iter().map(|episode| episode.period).fold(0.0, f64::max);
    let mut lacking: Vec<&Coverage> = columns.iter().filter(|column| column.without() > 0).collect();
    if lacking.is_empty() || total <= 0.0 {
        return None;
    }
    lacking.sort_by_key(|column| std::cmp::Reverse(column.without()));
    let row = |column: &&Coverage| {
        let all = Span { from: 0.0, to: total, kind: 0 };
        let spans =
            spans(&column.missing, period).into_iter().map(|[from, to]| Span { from, to: to.min(total), kind: 2 });
        (column.name.clone(), std::iter::once(all).chain(spans).collect())
    };
    let rows: Vec<(String, Vec<Span>)> = lacking.iter().take(DRAWN).map(row).collect();
    let kinds = ["values", "", "values are missing"].map(str::to_owned).to_vec();
    let more = if lacking.len() > DRAWN {
        format!(" Shown are {DRAWN} of {} such columns.", lacking.len())
    } else {
        String::new()
    };
    let caption = format!(
        "Rows in which a column of the model has no value: a value that `prepare` rejected or left empty, a sample that a channel lacks, or an expression that cannot be computed. One missing value marks \
         its bin, of which there are at most {MISSING}. The other columns have all their values.{more}"
    );
    let chart = Spans::new(Axis::of("time, logs one behind the other", "s").with_zero(), kinds, rows);
    Some(Figure::new("missing-in-time", "Missing values in time", caption, Chart::Spans(chart)))
}
