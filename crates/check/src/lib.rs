//! Faults in logs, found before a fit: stamps that jitter, channels that are dead, stuck or saturated, units that cannot be, delays between channels.
//!
//! [`check`] reads the rows once, and a bounded sample of them for comparisons of pairs of channels. Each [`Finding`]
//! has the fault, its place, the number that shows it, and the command that mends it.

mod channel;
mod finding;
mod names;
mod opened;
mod related;
mod relations;
mod sample;
mod stamps;
mod sums;

use fleetfoot_data::{Column, ColumnKind, Progress, Source};
use fleetfoot_dataset::{Error, Logs};
use fleetfoot_log::inspect_together;
use fleetfoot_recipe::{Kind, Recipe};
use serde::Serialize;

pub use crate::{
    channel::ChannelSummary,
    finding::{Fault, Finding},
    names::split as name_words,
    relations::{Correlations, LagCurve, Shift, correlations, lag_curve},
};
use crate::{channel::Channels, opened::Opened, sample::Sample};

/// The faults and the channels of some logs.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Checked {
    /// Files.
    pub files: usize,
    /// Episodes.
    pub episodes: usize,
    /// Rows.
    pub rows: usize,
    /// Sampling period, seconds; 0 without a clock.
    pub period: f64,
    /// The checked channels: states and inputs of the recipe, else all columns.
    pub channels: Vec<ChannelSummary>,
    /// The faults, the most serious first.
    pub findings: Vec<Finding>,
    /// Assumptions, and columns that were left out.
    pub notes: Vec<String>,
}

/// Role of a channel in a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// A state.
    State,
    /// An input.
    Input,
    /// Neither, or not known.
    Open,
}

/// A channel to check.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub(crate) column: Column,
    /// Its place among the columns of the rows.
    pub(crate) place: usize,
    pub(crate) part: Part,
    /// True if the recipe calls it an angle.
    pub(crate) angle: bool,
}

/// Channels to check, at most: the comparisons grow with the square.
const MOST: usize = 512;

/// Checks logs through a recipe. Without states in it, all columns of tables are checked, and the channels that a draft
/// proposes of robots' logs.
///
/// # Errors
/// Those of the recipe and of reading.
pub fn check(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<Checked, Error> {
    let logs = &logs.into();
    let infos = inspect_together(&logs.files(), false, progress)?;
    let mut notes = Vec::new();
    let Opened { dataset, recipe, mut findings } = Opened::new(recipe, &infos, logs, &mut notes, progress)?;
    notes.extend_from_slice(dataset.notes());
    let view = dataset.view()?;
    let guessed = infos.iter().filter_map(|info| info.clock.as_ref()).map(|clock| clock.column.as_str());
    let clocks: Vec<&str> = guessed.chain(recipe.time.column.as_deref()).collect();
    let columns = view.columns().iter().enumerate().filter(|(_, column)| !clocks.contains(&column.name.as_str()));
    let mut channels: Vec<Channel> = columns.map(|(at, column)| channel(&recipe, column, at)).collect();
    if channels.len() > MOST {
        notes.push(format!(
            "only {MOST} of {} columns are checked; name states and inputs in a recipe (-c) to choose them",
            channels.len()
        ));
        channels.truncate(MOST);
    }
    findings.extend(stamps::of_topics(&infos));
    if infos.iter().all(|info| info.topics.is_empty()) {
        findings.extend(stamps::of_tables(&dataset));
    }
    findings.extend(stamps::of_rows(&view, progress)?);
    let sample = Sample::read(&view, &channels, progress)?;
    let statistics = Channels::read(&view, &channels, &sample, progress)?;
    findings.extend(statistics.findings(&channels, dataset.step()));
    findings.extend(related::findings(&channels, &statistics, &sample, progress)?);
    findings.sort_by_key(|finding| finding.fault.rank());
    Ok(Checked {
        files: logs.len(),
        episodes: dataset.episodes().len(),
        rows: dataset.rows(),
        period: dataset.step(),
        channels: statistics.summaries(&channels),
        findings,
        notes,
    })
}

fn channel(recipe: &Recipe, column: &Column, place: usize) -> Channel {
    let name = column.name.as_str();
    let (part, angle) = match (recipe.states.get(name), recipe.inputs.get(name)) {
        (Some(state), _) => (Part::State, state.kind == Some(Kind::Angle)),
        (None, Some(input)) => (Part::Input, input.table().kind == Some(Kind::Angle)),
        (None, None) => (Part::Open, false),
    };
    Channel { column: column.clone(), place, part, angle }
}

impl Channel {
    /// Returns true for a measured real number, false for a label or a switch.
    pub(crate) fn is_measured(&self) -> bool {
        self.column.kind == ColumnKind::Float
    }
}
