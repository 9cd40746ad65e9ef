//! The clock of a table: its column, its unit, and the assumptions behind both.

use std::path::Path;

use serde::{Serialize, Serializer};

use crate::{
    ClockSummary, Error, Selection, TimeUnit,
    time_column::{Agreed, Clock},
};

/// The column that is taken as the clock when none is named.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ClockInfo {
    /// Its name.
    pub column: String,
    /// The column that is added to it: the time of the day beside a date, nanoseconds beside seconds.
    pub beside: Option<String>,
    /// The unit of its numbers; `None` of dates, and where several units fit.
    #[serde(serialize_with = "unit_symbol")]
    pub unit: Option<TimeUnit>,
    /// Seconds in one unit.
    pub seconds: Option<f64>,
    /// True if column or unit is a guess.
    pub guess: bool,
    /// True if its numbers could be of several units, or of none.
    #[serde(skip)]
    open: bool,
    /// The assumption and its reason, or the units between which there is no choice.
    pub assumed: Option<String>,
    /// Rates and gaps; only when the values were scanned.
    #[serde(flatten)]
    pub summary: Option<ClockSummary>,
}

impl ClockInfo {
    /// Clock of a file, with the settings on which all files of the call agree.
    pub(crate) fn new(path: &Path, clock: Clock, names: &[&str], agreed: &Agreed) -> Self {
        let (column, unit_given) = (clock.name.clone(), clock.given_unit());
        let beside = clock.beside.and_then(|(place, _)| names.get(place)).map(ToString::to_string);
        let is_number = unit_given.is_some() || !clock.readings().is_empty();
        let (unit, assumed, open) = match clock.settle(path, agreed, &Selection::default()) {
            Ok(settled) => (Some(settled.unit).filter(|_| is_number), settled.assumed, false),
            Err(Error::UnknownTimeUnit { readings, .. }) if readings.is_empty() => {
                (None, Some("its numbers fit no unit of time".into()), true)
            }
            Err(Error::UnknownTimeUnit { readings, .. }) => {
                (None, Some(format!("its numbers could be {readings}")), true)
            }
            Err(Error::EmptyClock { .. }) => (None, Some("it has no values in the first rows".into()), true),
            Err(error) => (None, Some(error.to_string()), true),
        };
        let guess = open || assumed.is_some();
        Self { column, beside, unit, seconds: unit.map(TimeUnit::seconds), guess, open, assumed, summary: None }
    }

    /// Returns true if its numbers could be of several units, or of none.
    pub fn is_open(&self) -> bool {
        self.open
    }
}

fn unit_symbol<S: Serializer>(unit: &Option<TimeUnit>, to: S) -> Result<S::Ok, S::Error> {
    unit.map(TimeUnit::symbol).serialize(to)
}
