//! Choice of the clock's column, and of its unit.

mod names;
#[cfg(test)]
mod tests;
mod units;

use std::{collections::BTreeMap, path::Path};

use fleetfoot_data::setting;

use crate::{Error, MaxGap, Selection, TimeUnit, dates::DateOrder, error::list, selection::TimeSpec};
pub(crate) use names::split_unit;
pub use units::Reading;

/// A column that might be the clock.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Its name.
    pub name: String,
    /// Unit in the file, if there is one.
    pub unit: Option<String>,
    /// Kind of its cells.
    pub kind: CandidateKind,
}

/// Kind of a candidate's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CandidateKind {
    /// Real numbers.
    Float,
    /// Whole numbers.
    Integer,
    /// Dates or a time type: the unit is known.
    Time,
    /// No clock.
    Other,
}

/// The chosen clock.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clock {
    /// The column's name.
    pub name: String,
    /// Its index among the candidates.
    pub column: usize,
    /// A second column whose stamps are added to it, and their unit: the time of the day beside the date, nanoseconds beside seconds.
    pub beside: Option<(usize, TimeUnit)>,
    /// True if its numbers are weeks of GPS, and those beside it the time of the week.
    pub gps_weeks: bool,
    /// The unit of its numbers.
    pub unit: ClockUnit,
    /// Kind of its cells.
    pub kind: CandidateKind,
    /// Origin of the choice of the column.
    pub chosen: Chosen,
}

/// The unit of a clock's numbers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ClockUnit {
    /// A unit that is known from the caller, the name, the file or the type of the column.
    Given(TimeUnit),
    /// Possible units of its numbers.
    Guessed(Vec<Reading>),
    /// Seconds, as numerical libraries count time, although its numbers may be all of these.
    Seconds(Vec<Reading>),
}

/// Origin of the choice of the column of a clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Chosen {
    /// The caller.
    Caller,
    /// Its name.
    Name,
    /// Its values: no other column rises evenly over all rows.
    Values,
}

/// Units and orders that the files of a call determine together for columns that single files leave open, by the
/// columns' names.
#[derive(Debug, Default)]
pub(crate) struct Agreed {
    /// The units of the numbers of clocks.
    pub units: BTreeMap<String, TimeUnit>,
    /// The orders of day and month in dates, and whether a file is certain of it.
    pub orders: BTreeMap<String, (DateOrder, bool)>,
}

/// A clock whose unit is settled.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SettledClock {
    /// Its column's name.
    pub name: String,
    pub column: usize,
    pub beside: Option<(usize, TimeUnit)>,
    /// True if it counts weeks of GPS.
    pub gps_weeks: bool,
    pub unit: TimeUnit,
    pub chosen: Chosen,
    /// The assumption and its reason, if one was made.
    pub assumed: Option<String>,
}

impl SettledClock {
    /// The columns whose stamps are added up, with their units.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (usize, TimeUnit)> {
        std::iter::once((self.column, self.unit)).chain(self.beside)
    }
}

/// The values of the first rows of a candidate, by its index: numbers as they are, dates and times in seconds.
pub(crate) type Sampler<'a> = &'a dyn Fn(usize) -> Vec<f64>;

/// The named column or the guessed one; `None` when there is none (or the rows are equally spaced).
pub(crate) fn choose(candidates: &[Candidate], sampler: Sampler<'_>, spec: &TimeSpec) -> Option<Clock> {
    let (column, chosen) = match spec {
        TimeSpec::Uniform { .. } => return None,
        TimeSpec::Column { name, .. } => {
            (candidates.iter().position(|candidate| candidate.name == *name)?, Chosen::Caller)
        }
        TimeSpec::Auto | TimeSpec::Dispensable { .. } => {
            let by_values = !matches!(spec, TimeSpec::Dispensable { ordered: false });
            let named = by_name(candidates, sampler);
            if let Some(clock) = in_two_parts(candidates, sampler)
                && named.is_none_or(|column| clock.has(column))
            {
                return Some(clock);
            }
            match named {
                Some(column) => (column, Chosen::Name),
                None => (by_values.then(|| only_even(candidates, sampler))??, Chosen::Values),
            }
        }
    };
    let candidate = &candidates[column];
    let given = match spec {
        TimeSpec::Column { unit, .. } => *unit,
        _ => None,
    };
    let unit_given = given.or_else(|| names::named(&candidate.name, candidate.unit.as_deref()).unit);
    let unit = match (candidate.kind, unit_given) {
        (_, Some(unit)) => ClockUnit::Given(unit),
        (CandidateKind::Time | CandidateKind::Other, None) => ClockUnit::Given(TimeUnit::Nanoseconds),
        (CandidateKind::Float | CandidateKind::Integer, None) => ClockUnit::Guessed(units::readings(&sampler(column))),
    };
    Some(Clock {
        name: candidate.name.clone(),
        column,
        beside: None,
        gps_weeks: false,
        unit,
        kind: candidate.kind,
        chosen,
    })
}

/// A date and a time of the day, or seconds and nanoseconds.
fn in_two_parts(candidates: &[Candidate], sampler: Sampler<'_>) -> Option<Clock> {
    let kinds = |kind: CandidateKind| (0..candidates.len()).filter(move |&c| candidates[c].kind == kind);
    let all = |column: usize, holds: &dyn Fn(f64) -> bool| {
        let sample = sampler(column);
        !sample.is_empty() && sample.into_iter().all(holds)
    };
    const DAY: f64 = 86_400.0;
    let is_date = |&column: &usize| all(column, &|value| value.rem_euclid(DAY) == 0.0 && value != 0.0);
    let is_time = |&column: &usize| all(column, &|value| (0.0..DAY).contains(&value));
    let (dates, times): (Vec<usize>, Vec<usize>) =
        (kinds(CandidateKind::Time).filter(is_date).collect(), kinds(CandidateKind::Time).filter(is_time).collect());
    if let (&[date], &[time]) = (&dates[..], &times[..]) {
        let unit = ClockUnit::Given(TimeUnit::Nanoseconds);
        let beside = Some((time, TimeUnit::Nanoseconds));
        let name = candidates[date].name.clone();
        let gps_weeks = false;
        return Some(Clock {
            name,
            column: date,
            beside,
            gps_weeks,
            unit,
            kind: CandidateKind::Time,
            chosen: Chosen::Name,
        });
    }
    let whole: Vec<(usize, &str)> =
        kinds(CandidateKind::Integer).map(|column| (column, &*candidates[column].name)).collect();
    match names::seconds_and_nanoseconds(&whole)[..] {
        [(column, nanoseconds)] if all(nanoseconds, &|value| (0.0..1e9).contains(&value)) => Some(Clock {
            name: candidates[column].name.clone(),
            column,
            beside: Some((nanoseconds, TimeUnit::Nanoseconds)),
            gps_weeks: false,
            unit: ClockUnit::Given(TimeUnit::Seconds),
            kind: CandidateKind::Integer,
            chosen: Chosen::Name,
        }),
        _ => in_gps_weeks(candidates, sampler),
    }
}

/// The week of GPS, and the time of the week in seconds or milliseconds.
fn in_gps_weeks(candidates: &[Candidate], sampler: Sampler<'_>) -> Option<Clock> {
    const WEEK: f64 = 604_800.0;
    let numbers = |kinds: &[CandidateKind], is_named: &dyn Fn(&str) -> bool| -> Vec<usize> {
        let is_one = |&c: &usize| kinds.contains(&candidates[c].kind) && is_named(&candidates[c].name);
        (0..candidates.len()).filter(is_one).collect()
    };
    let weeks = numbers(&[CandidateKind::Integer], &names::is_gps_week);
    let times = numbers(&[CandidateKind::Integer, CandidateKind::Float], &|name| names::time_of_week(name).is_some());
    let (&[week], &[time]) = (&weeks[..], &times[..]) else { return None };
    let finite = |column: usize| sampler(column).into_iter().filter(|value| value.is_finite()).collect::<Vec<f64>>();
    let (week_sample, time_sample) = (finite(week), finite(time));
    let is_week = !week_sample.is_empty() && week_sample.iter().all(|week| (1.0..5000.0).contains(week));
    let largest = time_sample.iter().copied().fold(0.0, f64::max);
    let unit_given = candidates[time].unit.as_deref().and_then(TimeUnit::parse);
    let unit = match (unit_given.or(names::time_of_week(&candidates[time].name)?), candidates[time].kind) {
        (Some(unit), _) => unit,
        (None, _) if largest > WEEK => TimeUnit::Milliseconds,
        (None, CandidateKind::Float) => TimeUnit::Seconds,
        // Whole numbers in the first ten minutes of a week, or seconds.
        (None, _) => return None,
    };
    let is_time =
        mostly_rises(&time_sample) && time_sample.iter().all(|time| (0.0..=WEEK).contains(&(time * unit.seconds())));
    (is_week && is_time).then(|| Clock {
        name: candidates[week].name.clone(),
        column: week,
        beside: Some((time, unit)),
        gps_weeks: true,
        unit: ClockUnit::Given(TimeUnit::Seconds),
        kind: CandidateKind::Integer,
        chosen: Chosen::Name,
    })
}

/// Note on weeks of GPS.
const GPS_TIME: &str =
    "its stamps are weeks of GPS and the time of the week: GPS time, which is 18 s ahead of UTC since 2017";

/// End of notes on a unit that the numbers decide.
const IF_WRONG: &str = "name the unit if that is wrong";

/// The name that pandas gives in a file to an index without a name.
const INDEX: &str = "__index_level_0__";

/// The column with the most telling name among those that rise.
fn by_name(candidates: &[Candidate], sampler: Sampler<'_>) -> Option<usize> {
    let mut ranked = ranked(candidates).into_iter().filter(|&c| candidates[c].kind != CandidateKind::Other);
    ranked.find(|&c| mostly_rises(&sampler(c)))
}

/// The columns that are named as a clock is, the most telling name first.
fn ranked(candidates: &[Candidate]) -> Vec<usize> {
    let rank = |candidate: &Candidate| match candidate.kind {
        CandidateKind::Time if candidate.name == INDEX => Some(usize::MAX),
        // A date needs no unit: what stands in brackets is a time zone, or its form.
        CandidateKind::Time => names::named(split_unit(&candidate.name).0, None)
            .rank
            .or_else(|| names::named(&candidate.name, candidate.unit.as_deref()).rank),
        _ => names::named(&candidate.name, candidate.unit.as_deref()).rank,
    };
    let ranked = candidates.iter().enumerate();
    let mut ranked: Vec<(usize, usize)> = ranked.filter_map(|(c, candidate)| Some((rank(candidate)?, c))).collect();
    ranked.sort_unstable();
    ranked.into_iter().map(|(_, c)| c).collect()
}

/// Returns true if a sample can be that of a clock. At least half of its steps then rise, and at most a fifth falls
/// (new episodes begin there).
fn mostly_rises(sample: &[f64]) -> bool {
    let (rising, falling, steps) = counted(sample);
    rises(rising, falling, steps)
}

/// Rising steps, falling steps and all steps of a sample.
fn counted(sample: &[f64]) -> (usize, usize, usize) {
    let values: Vec<f64> = sample.iter().copied().filter(|value| value.is_finite()).collect();
    // Decimals of a date go beyond what `f64` holds: the pass over the stamps sees them all.
    let is_finer = |pair: &[f64]| pair[1] == pair[0] && pair[0].fract() != 0.0;
    let rising = values.windows(2).filter(|pair| pair[1] > pair[0] || is_finer(pair)).count();
    let falling = values.windows(2).filter(|pair| pair[1] < pair[0]).count();
    (rising, falling, values.len().saturating_sub(1))
}

/// Returns true if a clock can have these steps: at least half of them rise, and at most a fifth falls.
pub(crate) fn rises(rising: usize, falling: usize, steps: usize) -> bool {
    2 * rising >= steps && 5 * falling <= steps
}

/// The one column that rises evenly at every row and is no row counter; `None` where there are several.
fn only_even(candidates: &[Candidate], sampler: Sampler<'_>) -> Option<usize> {
    let mut rising = (0..candidates.len()).filter(|&c| {
        let kind = candidates[c].kind;
        kind != CandidateKind::Other && always_rises(&sampler(c), kind)
    });
    let first = rising.next()?;
    let is_only = rising.next().is_none();
    (is_only
        && (candidates[first].kind == CandidateKind::Time
            || is_even(&sampler(first)) && !has_dates(candidates, sampler)))
    .then_some(first)
}

/// Returns true if a column of dates advances, however coarse its stamps are: then no column of numbers is the clock.
fn has_dates(candidates: &[Candidate], sampler: Sampler<'_>) -> bool {
    let goes_on = |column: usize| {
        let (rising, falling, steps) = counted(&sampler(column));
        rising > 0 && 5 * falling <= steps
    };
    (0..candidates.len()).any(|column| candidates[column].kind == CandidateKind::Time && goes_on(column))
}

/// Returns true if the sample rises at every row and is not a mere row counter.
fn always_rises(sample: &[f64], kind: CandidateKind) -> bool {
    let rising = sample.len() >= 3 && sample.windows(2).all(|pair| pair[1] > pair[0]);
    rising && (kind != CandidateKind::Integer || sample.windows(2).any(|pair| pair[1] - pair[0] != 1.0))
}

/// Returns true if nine of ten steps are within a quarter of the median step; the steps of a position vary with the
/// speed.
fn is_even(sample: &[f64]) -> bool {
    let mut steps: Vec<f64> = sample.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let median = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
    let near = steps.iter().filter(|&&step| (step - median).abs() <= 0.25 * median).count();
    10 * near >= 9 * steps.len()
}

impl Clock {
    /// Returns true if a column is one of its parts.
    fn has(&self, column: usize) -> bool {
        self.column == column || self.beside.is_some_and(|(beside, _)| beside == column)
    }

    /// The unit of its numbers where the file, a name or the caller tells it; dates have none.
    pub(crate) fn given_unit(&self) -> Option<TimeUnit> {
        match self.unit {
            ClockUnit::Given(unit) if self.kind != CandidateKind::Time => Some(unit),
            _ => None,
        }
    }

    /// Possible units of its numbers; empty if the unit is known.
    pub(crate) fn readings(&self) -> &[Reading] {
        match &self.unit {
            ClockUnit::Given(_) => &[],
            ClockUnit::Guessed(readings) | ClockUnit::Seconds(readings) => readings,
        }
    }

    /// The unit that the numbers of a file may be in although they are taken as seconds.
    pub(crate) fn doubt(&self) -> Option<TimeUnit> {
        match &self.unit {
            ClockUnit::Guessed(readings) if self.kind != CandidateKind::Integer => match readings[..] {
                [reading] => units::instead(&reading),
                _ => None,
            },
            _ => None,
        }
    }

    /// The clock with its unit: the only one that is possible, or what all files of the call agree on.
    ///
    /// # Errors
    /// Several units are possible, or none.
    pub(crate) fn settle(self, path: &Path, agreed: &Agreed, selection: &Selection) -> Result<SettledClock, Error> {
        let (name, readings) = (&self.name, self.readings());
        let agreed = agreed.units.get(name).copied();
        let reading = readings.iter().find(|reading| agreed.is_none_or(|unit| unit == reading.unit));
        // Rows whose order alone counts need no seconds.
        let by_order = matches!(selection.time, TimeSpec::Dispensable { .. }) && selection.max_gap == MaxGap::Auto;
        let (unit, reason) = match (&self.unit, reading) {
            (ClockUnit::Given(unit), _) => (*unit, None),
            (_, Some(reading)) if agreed.is_some() => {
                (reading.unit, Some(format!("the only unit that fits all files; {IF_WRONG}")))
            }
            (ClockUnit::Seconds(_), Some(_)) => (TimeUnit::Seconds, None),
            (_, Some(reading)) if readings.len() == 1 => (reading.unit, Some(only_reading(name, reading))),
            (_, Some(reading)) if by_order => {
                (reading.unit, Some(format!("other units fit too, but only the order of rows counts; {IF_WRONG}")))
            }
            _ => return Err(unknown_unit(path, name, readings)),
        };
        // Numbers with decimals are expected to be seconds.
        let is_usual = unit == TimeUnit::Seconds && self.kind != CandidateKind::Integer && readings.len() <= 1;
        let others = match &self.unit {
            _ if by_order || agreed.is_some() => Vec::new(),
            ClockUnit::Seconds(readings) => units::symbols(readings, TimeUnit::Seconds),
            _ => self.doubt().into_iter().map(TimeUnit::symbol).collect(),
        };
        // Notes with rounded numbers, or none: those of many files become one.
        let guess = match reason.filter(|_| !is_usual) {
            Some(reason) => Some(format!("the numbers of `{name}` are taken as {}: {reason}", unit.symbol())),
            None if others.is_empty() => None,
            None => Some(format!(
                "the numbers of `{name}` are taken as s; they could be {}: name the unit if they are",
                others.join(" or ")
            )),
        };
        let why = (self.chosen == Chosen::Values)
            .then(|| format!("`{name}` is taken as the time: it is the only column that rises evenly at every row"));
        let why = why.or_else(|| self.gps_weeks.then(|| GPS_TIME.into()));
        let assumed = match (why, guess) {
            (Some(why), Some(guess)) => Some(format!("{why}; {guess}")),
            (why, guess) => why.or(guess),
        };
        let Self { name, column, beside, gps_weeks, chosen, .. } = self;
        Ok(SettledClock { name, column, beside, gps_weeks, unit, chosen, assumed })
    }
}

/// The reason for the only unit that fits, with the slower reading that its rate alone excludes.
fn only_reading(name: &str, reading: &Reading) -> String {
    match units::slower(reading) {
        None => format!("no other unit fits; {IF_WRONG}"),
        Some((rate, unit)) => format!(
            "{} rows a second; in {unit} it would be one row in {} s: name the unit then ({})",
            units::rounded(rate, 2),
            units::rounded(1.0 / (rate * 1e-3), 2),
            setting::clock(name, unit)
        ),
    }
}

/// The refusal of a table without a clock, with the reason against the column whose name is most like a clock's.
pub(crate) fn no_clock(path: &Path, candidates: &[Candidate], sampler: Sampler<'_>) -> Error {
    let names: Vec<&str> = candidates.iter().map(|candidate| candidate.name.as_str()).collect();
    let problem = ranked(candidates).first().map(|&column| {
        let Candidate { name, kind, .. } = &candidates[column];
        if *kind == CandidateKind::Other {
            return format!("; `{name}` holds text: look for decimal commas, and words among numbers");
        }
        match counted(&sampler(column)) {
            (0, 0, steps) => format!("; `{name}` has the same value in its first {} stamps", steps + 1),
            (rising, falling, steps) if falling > rising => {
                format!("; `{name}` falls in {falling} of its first {steps} steps, rises in {rising}")
            }
            (rising, _, steps) => format!("; `{name}` rises in only {rising} of its first {steps} steps"),
        }
    });
    Error::NoTimeColumn { path: path.into(), columns: list(&names), problem: problem.unwrap_or_default() }
}

/// The refusal of stamps that fit these units.
fn unknown_unit(path: &Path, column: &str, readings: &[Reading]) -> Error {
    let all: Vec<String> = readings.iter().map(ToString::to_string).collect();
    let unit = readings.last().map_or("ms", |reading| reading.unit.symbol());
    if !readings.is_empty() && readings.iter().all(|reading| reading.start.is_nan()) {
        return Error::EmptyClock { path: path.into(), column: column.into(), unit };
    }
    Error::UnknownTimeUnit { path: path.into(), column: column.into(), readings: all.join(" or "), unit }
}
