//! Offsets of other computers' clocks from their reference clocks, estimated log by log from a motion or a wave that
//! both recorded.

use std::path::{Path, PathBuf};

use fleetfoot_data::{Halo, Progress, Source};
use fleetfoot_log::TopicClock;
use fleetfoot_recipe::{ClockSection, Recipe};
use fleetfoot_signal::{
    Alignment, ClockLine, EdgeAlignment, Record, SignalError, WaveOptions, Within, align, align_edges, dejitter,
};

pub use crate::estimated_clocks::{AlignedClock, LagOfPart};
use crate::{dataset::Dataset, error::Error, estimated_clocks::Clocks, logs::Logs};

/// Seconds that clocks may be apart beyond what log times tell of them.
const REACH: f64 = 1.0;

/// Largest relative rate of one clock against another, seconds a second: the limit at which NTP slews a clock. Quartz
/// is five times better.
const SKEW: f64 = 5e-4;

/// The share of a motion that may stay unexplained before a note tells it.
const DOUBTFUL: f64 = 0.5;

/// Deviations off the line at which a quarter of a record is told.
const BENT: f64 = 4.0;

/// The share of a period beyond which stamps are not those of an even sensor.
const UNEVEN: f64 = 0.25;

/// Kind of signal by which a channel is compared.
#[derive(Clone, Copy)]
enum By {
    Motion,
    Wave,
}

/// Finds the clocks of a recipe, in its order, so that one may be compared with those before it. `topics` are those of the first log.
///
/// # Errors
/// A clock that says too little, too much, or what cannot be; logs of one clock; channels that cannot be aligned.
pub(crate) fn find(recipe: &Recipe, logs: &Logs, topics: &[String], progress: &dyn Progress) -> Result<Clocks, Error> {
    let (mut clocks, search) = (Clocks::default(), Search { recipe, logs, topics, progress });
    for (at, (name, section)) in recipe.clocks.iter().enumerate() {
        let place = format!("[clocks.{name}]");
        check_topics(&place, section, topics)?;
        if section.even.is_some() && section.wave.is_none() {
            return Err(Error::conflict(format!(
                "{place}: `even` belongs to a wave; name the two channels that measured it (wave)"
            )));
        }
        match (&section.motion, &section.wave, section.offset) {
            (Some(pair), None, _) => clocks.compare(search, at, By::Motion, pair)?,
            (None, Some(pair), _) => clocks.compare(search, at, By::Wave, pair)?,
            (None, None, Some(offset)) if offset.is_finite() && offset.abs() < 9e9 => {
                clocks.given(name, section, offset)
            }
            (None, None, Some(offset)) => {
                return Err(Error::value(format!("{place} offset = {offset}: write seconds")));
            }
            (Some(_), Some(_), _) => {
                return Err(Error::conflict(format!("{place}: both `motion` and `wave` are set; keep one of them")));
            }
            (None, None, None) => {
                return Err(Error::missing(format!(
                    "{place}: name two channels that measure the same thing (motion = [\"...\", \"...\"] or wave = [\"...\", \"...\"]: a channel by the reference clock, one by this clock), or the offset in seconds"
                )));
            }
        }
    }
    Ok(clocks)
}

/// Every pattern names a topic.
fn check_topics(place: &str, section: &ClockSection, topics: &[String]) -> Result<(), Error> {
    if topics.is_empty() {
        return Err(Error::conflict(format!(
            "{place}: the rows of a table have one clock; clocks are of robots' logs, whose topics are stamped one by one"
        )));
    }
    if section.topics.is_empty() {
        return Err(Error::missing(format!(
            "{place}: name the topics that this clock stamps: topics = [\"/mocap/*\"]"
        )));
    }
    let alone = |pattern: &String| {
        let clock = topic_clock(None, std::slice::from_ref(pattern), [0, 0], 0.0);
        !topics.iter().any(|topic| clock.stamps(topic))
    };
    match section.topics.iter().find(|pattern| alone(pattern)) {
        None => Ok(()),
        Some(pattern) => Err(Error::unknown(
            pattern,
            format!("{place} topics: no topic of the log is called `{pattern}`; there are {}", topics.join(", ")),
        )),
    }
}

fn topic_clock(log: Option<PathBuf>, topics: &[String], [at, offset]: [i64; 2], skew: f64) -> TopicClock {
    TopicClock { log, topics: topics.to_vec(), at, offset, skew }
}

/// Inputs of the search for clocks.
#[derive(Clone, Copy)]
struct Search<'a> {
    recipe: &'a Recipe,
    logs: &'a Logs,
    /// Topics of the first log.
    topics: &'a [String],
    progress: &'a dyn Progress,
}

/// The channel of a log by one clock.
struct Channel {
    log: PathBuf,
    /// Nanoseconds from which the times count.
    epoch: i64,
    times: Vec<f64>,
    values: Vec<f64>,
    /// Offset to add to its stamps for the log's times, nanoseconds.
    log_offset: i64,
    /// Largest error of the stamps after jitter was removed, s.
    margin: f64,
}

impl Clocks {
    /// A clock whose offset is known.
    fn given(&mut self, name: &str, section: &ClockSection, offset: f64) {
        self.topics.push(topic_clock(None, &section.topics, [0, (offset * 1e9).round() as i64], 0.0));
        self.reports.push(AlignedClock::given(name, offset));
    }

    /// Compares the two channels of a clock, log by log.
    fn compare(
        &mut self,
        search: Search<'_>,
        at: usize,
        by: By,
        [reference, channel_name]: &[String; 2],
    ) -> Result<(), Error> {
        let Search { recipe, logs, topics, progress } = search;
        let (Some((name, section)), later) = (recipe.clocks.get_index(at), recipe.clocks.values().skip(at)) else {
            return Ok(());
        };
        let word = match by {
            By::Motion => "motion",
            By::Wave => "wave",
        };
        let place = format!("[clocks.{name}] {word}");
        let reach = section.reach.unwrap_or(REACH);
        if !(reach > 0.0 && reach.is_finite()) {
            return Err(Error::value(format!("[clocks.{name}] reach = {reach}: write seconds above 0")));
        }
        let compared_set =
            Dataset::for_channels(recipe, std::slice::from_ref(channel_name), &self.topics, logs, progress)?;
        if !is_stamped(&compared_set, topics, std::iter::once(section)) {
            return Err(Error::conflict(format!(
                "{place}: `{channel_name}` is not in a topic of [clocks.{name}]; name first the channel of the reference clock, then the channel of this clock"
            )));
        }
        let reference_set =
            Dataset::for_channels(recipe, std::slice::from_ref(reference), &self.topics, logs, progress)?;
        if is_stamped(&reference_set, topics, later) {
            return Err(Error::conflict(format!(
                "{place}: `{reference}` is stamped by this clock or by a later one of the recipe; compare with the reference clock or with an earlier one"
            )));
        }
        let even = recipe.prepare.dejitter == Some(true);
        let references = channels(&reference_set, even).map_err(|error| error.of(&place, reference))?;
        for compared_channel in channels(&compared_set, even).map_err(|error| error.of(&place, channel_name))? {
            let Some(reference_channel) = references.iter().find(|channel| channel.log == compared_channel.log) else {
                let log = compared_channel.log.display();
                return Err(Error::missing(format!("{place}: {log} has no rows of `{reference}`")));
            };
            let (about, even) = (section.offset, section.even == Some(true));
            let pair = Pair { reference: reference_channel, compared: &compared_channel, reach, about, even };
            let correspondence = pair.estimate(by).map_err(|source| Error::Signal {
                episode: compared_channel.log.display().to_string(),
                channel: format!("{reference}` and `{channel_name}"),
                source,
            })?;
            self.take(name, section, &pair, correspondence)?;
        }
        Ok(())
    }

    /// Keeps what was found of a log, unless it is no find.
    fn take(
        &mut self,
        name: &str,
        section: &ClockSection,
        pair: &Pair<'_>,
        correspondence: Correspondence,
    ) -> Result<(), Error> {
        let log = pair.compared.log.display().to_string();
        if let Correspondence::Motion(Alignment { at_end: true, line, .. }) = &correspondence {
            return Err(Error::undetermined(format!(
                "[clocks.{name}]: in {log} the best clock offset is {:.4} s at {:.1} ppm, at an end of the search range ({} s about {:.4} s): give a longer reach, or an offset to search about",
                line.offset,
                1e6 * line.skew,
                pair.reach,
                pair.about(),
            )));
        }
        if let Correspondence::Motion(Alignment { deviation, unexplained, .. }) = &correspondence
            && (deviation.is_nan() || 1.96 * deviation >= pair.reach)
        {
            return Err(Error::undetermined(format!(
                "[clocks.{name}]: in {log} the motion does not determine the clock offset ({:.2} % of it are unexplained at the best one): name channels with more motion in common, or a wave that both measured",
                1e2 * unexplained
            )));
        }
        let line = correspondence.line();
        let report = match &correspondence {
            Correspondence::Motion(alignment) => {
                AlignedClock::by_motion(name, &log, alignment, pair.reference.times[0])
            }
            Correspondence::Wave(alignment) => {
                AlignedClock::by_wave(name, &log, alignment, pair.even, pair.reference.times[0])
            }
        };
        self.notes.extend(report.doubts(DOUBTFUL, BENT));
        self.reports.push(report);
        // The line is by the reference clock; stamps are by the own one.
        let at = pair.reference.epoch + (line.second(line.at) * 1e9).round() as i64;
        let offset = (line.offset * 1e9).round() as i64;
        let skew = line.skew / (1.0 + line.skew);
        self.topics.push(topic_clock(Some(pair.compared.log.clone()), &section.topics, [at, offset], skew));
        Ok(())
    }
}

/// Returns true if a channel reads a topic that one of these clocks stamps.
fn is_stamped<'a>(dataset: &Dataset, topics: &[String], sections: impl Iterator<Item = &'a ClockSection>) -> bool {
    let fields = dataset.columns();
    let is_read = |topic: &&String| {
        fields.iter().any(|field| field.strip_prefix(topic.as_str()).is_some_and(|rest| rest.starts_with(['.', '['])))
    };
    let read: Vec<&String> = topics.iter().filter(is_read).collect();
    sections
        .map(|section| topic_clock(None, &section.topics, [0, 0], 0.0))
        .any(|clock| read.iter().any(|topic| clock.stamps(topic)))
}

/// Error that stops the reading of a channel.
enum Stopped {
    Error(Error),
    Signal(PathBuf, SignalError),
}

impl Stopped {
    fn of(self, place: &str, channel: &str) -> Error {
        match self {
            Self::Error(error) => error,
            Self::Signal(log, source) => {
                Error::Signal { episode: format!("{place}, {}", log.display()), channel: channel.to_owned(), source }
            }
        }
    }
}

impl<E: Into<Error>> From<E> for Stopped {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// The one column of a data set, log by log, with stamps evened out where they are even but for jitter.
fn channels(dataset: &Dataset, even: bool) -> Result<Vec<Channel>, Stopped> {
    let view = dataset.view()?;
    let mut channels: Vec<Channel> = Vec::new();
    for (at, episode) in view.episodes().iter().enumerate() {
        let block = view.read(at, 0..episode.rows, Halo::default())?;
        let log: &Path = dataset.origin(at);
        if channels.last().is_none_or(|last| last.log != log) {
            let (times, values) = (Vec::new(), Vec::new());
            let (log, log_offset) = (log.to_path_buf(), dataset.log_offset(at));
            channels.push(Channel { log, epoch: block.start, times, values, log_offset, margin: 0.0 });
        }
        if let Some(last) = channels.last_mut() {
            let since = (block.start - last.epoch) as f64 * 1e-9;
            last.times.extend(block.seconds().iter().map(|time| since + time));
            last.values.extend_from_slice(block.column(0));
        }
    }
    for channel in channels.iter_mut().filter(|channel| even && channel.times.len() > 2) {
        let stamps = dejitter(&channel.times).map_err(|source| Stopped::Signal(channel.log.clone(), source))?;
        // Messages of what happens now and then are not even, and have nothing to even out.
        if stamps.jitter > UNEVEN * stamps.period {
            continue;
        }
        // Four deviations of the line at its ends, which is where it is known least.
        channel.margin = 8.0 * stamps.jitter / (channel.times.len() as f64).sqrt();
        channel.times = stamps.times;
    }
    Ok(channels)
}

/// Alignment of a clock in a log.
enum Correspondence {
    Motion(Alignment),
    Wave(EdgeAlignment),
}

impl Correspondence {
    fn line(&self) -> ClockLine {
        match self {
            Self::Motion(estimate) => estimate.line,
            Self::Wave(estimate) => estimate.line,
        }
    }
}

/// The two channels of a log.
struct Pair<'a> {
    reference: &'a Channel,
    compared: &'a Channel,
    reach: f64,
    /// The offset that the recipe gives, s.
    about: Option<f64>,
    /// True if the recipe states that the wave is even.
    even: bool,
}

impl Pair<'_> {
    /// The offset that is searched about, s: what the recipe says, else the difference of what the headers lack to the log's times, which delays alone spoil.
    fn about(&self) -> f64 {
        self.about.unwrap_or((self.reference.log_offset - self.compared.log_offset) as f64 * 1e-9)
    }

    fn estimate(&self, by: By) -> Result<Correspondence, SignalError> {
        // Seconds of both from the reference's beginning.
        let apart = (self.compared.epoch - self.reference.epoch) as f64 * 1e-9;
        let compared_times: Vec<f64> = self.compared.times.iter().map(|time| time + apart).collect();
        let first = Record { times: &self.reference.times, values: &self.reference.values };
        let second = Record { times: &compared_times, values: &self.compared.values };
        let within = Within { about: self.about(), reach: self.reach, skew: SKEW };
        match by {
            By::Motion => align(first, second, within).map(Correspondence::Motion),
            By::Wave => {
                let wave = WaveOptions { margin: self.reference.margin.max(self.compared.margin), even: self.even };
                align_edges(first, second, within, wave).map(Correspondence::Wave)
            }
        }
    }
}
