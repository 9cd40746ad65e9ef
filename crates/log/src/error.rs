//! Errors: each names the file, the place in it, and the remedy.

use std::path::{Path, PathBuf};

use fleetfoot_data::Cancelled;
use fleetfoot_data::setting::{self, DT, FILES, INFO, INFO_VALUES, JOIN, RATE, RENAME, TIME, TIME_SECTION};

/// Readable formats, for messages.
pub(crate) const KNOWN: &str = ".mcap, .bag, .db3, .ulg, .bin and .log (ArduPilot), .wpilog, .csv, .tsv, .txt (each also with .gz or .zst), .parquet, .npy, .npz, .mat; and rosbag2 folders";

/// Why a file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Action that was tried, as an infinitive.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Decoded columns cannot be kept.
    #[error(transparent)]
    Output(#[from] fleetfoot_output::Error),
    /// No argument named a file.
    #[error("no input files: name files, folders or patterns such as runs/*.parquet")]
    NoFiles,
    /// A file or pattern that matches nothing.
    #[error(
        "nothing matches {pattern}{}",
        hint(nearest, "the nearest name is", "look for a typing error, or a wrong folder")
    )]
    NoMatch {
        /// The argument.
        pattern: String,
        /// An existing name close to it.
        nearest: Option<String>,
    },
    /// A pattern that cannot be understood.
    #[error("{pattern} is not a valid file pattern: {problem}; write * ? [a-z] or ** between slashes")]
    Pattern {
        /// The argument.
        pattern: String,
        /// Description of the problem.
        problem: String,
    },
    /// A folder without any file of a known format.
    #[error("{} holds no recording ({}); name the files, or another folder", path.display(), KNOWN)]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A file of an unknown format.
    #[error("{}: {}", path.display(), unknown_format(path))]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// Contents that do not match the name.
    #[error("{}: {problem}; {mend}", path.display())]
    WrongFormat {
        /// The file.
        path: PathBuf,
        /// Description of the problem.
        problem: String,
        /// Remedy.
        mend: &'static str,
    },
    /// A damaged, truncated or lying file.
    #[error("{}: {place}: {problem}; {mend}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Place in the file.
        place: String,
        /// Description of the damage.
        problem: String,
        /// Remedy.
        mend: &'static str,
    },
    /// A column that the file does not have.
    #[error("{} has no column `{column}`{}", path.display(), hint(nearest, "the nearest name is", format_args!("list its columns with {INFO}")))]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The column asked for.
        column: String,
        /// An existing name close to it.
        nearest: Option<String>,
    },
    /// A name that two columns of the file share.
    #[error("{} has {count} columns named `{column}`: rename them, because the name is ambiguous", path.display())]
    AmbiguousColumn {
        /// The file.
        path: PathBuf,
        /// Name of the requested column.
        column: String,
        /// Number of columns of that name.
        count: usize,
    },
    /// A column whose type cannot become numbers.
    #[error("{}: column `{column}` has the type {kind}, which is not a number, a truth value, a time or a text: leave it out or convert it", path.display())]
    UnsupportedColumn {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Its type in the file.
        kind: String,
    },
    /// A column of a table in memory that cannot be its clock.
    #[error("{}: column `{column}` holds neither numbers nor times, so it cannot be the clock: convert it", path.display())]
    NoClock {
        /// The table.
        path: PathBuf,
        /// The column.
        column: String,
    },
    /// A column that means different things in two files.
    #[error("column `{column}` is {first_is} in {} but {second_is} in {}: make the files agree", first.display(), second.display())]
    ColumnsDisagree {
        /// The column.
        column: String,
        /// One file.
        first: PathBuf,
        /// Kind of the column in the first file.
        first_is: String,
        /// The other file.
        second: PathBuf,
        /// Kind of the column in the other file.
        second_is: String,
    },
    /// A table needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// A text column with too many different texts to be a category.
    #[error("{}: column `{column}` holds more than {limit} different texts, so it is not a category: leave it out", path.display())]
    TooManyCategories {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// The most that is accepted.
        limit: usize,
    },
    /// No column can be the clock.
    #[error("{}: no time column found among {columns}{problem}. Name the clock ({TIME}; {TIME_SECTION} column in a recipe), or give the sampling period ({DT})", path.display())]
    NoTimeColumn {
        /// The file.
        path: PathBuf,
        /// The columns there are, shortened.
        columns: String,
        /// Reason against the column that is named as a clock is, behind `; `; empty without one.
        problem: String,
    },
    /// A clock without a value in the first rows, which would tell its unit.
    #[error(
        "{}: `{column}` has no values in the first rows: name another time column ({TIME}), give the sampling period ({DT}), or name the unit of its later stamps ({})",
        path.display(),
        setting::clock(column, unit)
    )]
    EmptyClock {
        /// The file.
        path: PathBuf,
        /// The time column.
        column: String,
        /// One of the units.
        unit: &'static str,
    },
    /// Stamps whose numbers fit several units of time, or none.
    #[error(
        "{}: the numbers of `{column}` {}: name the unit ({})",
        path.display(),
        if readings.is_empty() { "fit no unit of time".to_owned() } else { format!("could be {readings}") },
        setting::clock(column, unit)
    )]
    UnknownTimeUnit {
        /// The file.
        path: PathBuf,
        /// The time column.
        column: String,
        /// Possible units, with the rate and the first stamp of each.
        readings: String,
        /// One of the units.
        unit: &'static str,
    },
    /// A column whose name is a clock's, but whose values are not.
    #[error(
        "{}: `{column}` rises in only {rising} of {steps} steps, so it is not used as time: name the clock ({TIME}; {TIME_SECTION} column in a recipe), or give the sampling period ({DT})",
        path.display()
    )]
    ClockFalls {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Rows whose stamp is above the one of the row before.
        rising: usize,
        /// Rows that have a row before them.
        steps: usize,
    },
    /// A sampling period or a gap that is not a positive number.
    #[error("the {what} must be a positive number of seconds below 1e9, not {seconds}")]
    BadSeconds {
        /// Setting that the value was for.
        what: &'static str,
        /// The value.
        seconds: f64,
    },
    /// No row has a usable stamp.
    #[error("{}: none of its {rows} rows has a readable stamp in `{column}`; name another time column or its unit", path.display())]
    NoStamps {
        /// The file.
        path: PathBuf,
        /// Its rows.
        rows: usize,
        /// The time column.
        column: String,
    },
    /// A file without rows.
    #[error("{} has no rows: leave it out", path.display())]
    NoRows {
        /// The file.
        path: PathBuf,
    },
    /// A text row with the wrong number of fields.
    #[error("{}:{line}: {fields} fields where the header has {expected}; mend the line, or quote fields that contain the delimiter `{delimiter}`", path.display())]
    RaggedRow {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// Fields found.
        fields: usize,
        /// Fields of the header.
        expected: usize,
        /// The delimiter in use.
        delimiter: char,
    },
    /// A text cell that does not fit the type of the column.
    #[error("{}:{line}: column `{column}` should hold {expected}, but the cell is `{text}`; mend it, or leave it empty to mark it missing", path.display())]
    BadCell {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// The column.
        column: String,
        /// Expected content of the column.
        expected: &'static str,
        /// The cell, shortened.
        text: String,
    },
    /// A topic of a robot's log whose messages cannot be read.
    #[error("{}: topic {topic}: {problem}; leave it out, or record it again", path.display())]
    UnusableTopic {
        /// The recording.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Why.
        problem: String,
    },
    /// The same data twice in one recording.
    #[error("{first} and {second} hold the same data: remove one, or a fit counts it twice")]
    Duplicate {
        /// An episode.
        first: String,
        /// Its copy.
        second: String,
    },
    /// A column of a topic that the log does not have.
    #[error(
        "{} has no topic for the column `{column}`{}",
        path.display(),
        hint(nearest, format_args!("the nearest topic is ({RENAME} maps topics)"), format_args!("list its topics with {INFO}"))
    )]
    MissingTopic {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// A topic that is spelled similarly.
        nearest: Option<String>,
    },
    /// A robot's log opened without a column or a base channel.
    #[error("{}: without a named column or base channel there are no rows; name one of its fields ({INFO_VALUES} lists them)", path.display())]
    NothingAsked {
        /// The file.
        path: PathBuf,
    },
    /// A column's name that is no way into a message.
    #[error("{}: the column `{column}` names no field of a message: {problem}; write /topic.field.part, /topic.array[3] or /topic.array[name]", path.display())]
    BadField {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Description of the problem.
        problem: String,
    },
    /// Messages that cannot be read, or not as asked.
    #[error("{}: {topic}{}: {problem}", path.display(), if type_name.is_empty() { String::new() } else { format!(" ({type_name})") })]
    Topic {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The type of its messages.
        type_name: String,
        /// Description of the problem, and the remedy.
        problem: String,
    },
    /// Header stamps asked of messages without a header.
    #[error(
        "{}: the messages of {topic} have no header stamp: take the log's or the publisher's clock for all channels (stamp = \"log\" or \"publish\"), or leave the topic out",
        path.display()
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
    },
    /// Logs whose channels have different clocks.
    #[error(
        "{} goes by the stamps of its {first_is}, {} by those of its {second_is}: choose one for all (stamp = \"log\", \"publish\" or \"header\")",
        first.display(), second.display()
    )]
    ClocksDisagree {
        /// A file.
        first: PathBuf,
        /// Its clock.
        first_is: &'static str,
        /// Another file.
        second: PathBuf,
        /// Its clock.
        second_is: &'static str,
    },
    /// Another clock than the messages' asked of a robot's log.
    #[error("{}: a robot's log has its own clock, not {asked}: choose one of its stamps (stamp = \"header\", \"log\" or \"publish\"), and rate = HZ for even rows", path.display())]
    NoSuchClock {
        /// The file.
        path: PathBuf,
        /// Clock that was asked for.
        asked: String,
    },
    /// Two channels without a moment in common.
    #[error(
        "{}: the {what} of {first}, {}, and of {second}, {}, do not overlap: take the same clock for all (stamp = \"log\", \"publish\" or \"header\"), another channel, or, for values that hold until the next message, max_gap = \"none\" in {JOIN}",
        path.display(), describe_range(ranges[0]), describe_range(ranges[1])
    )]
    NoOverlap {
        /// The file.
        path: PathBuf,
        /// Kind of stamps that do not overlap: `stamps` or `log times`.
        what: &'static str,
        /// A channel.
        first: String,
        /// The other channel.
        second: String,
        /// The first and the last of each channel, nanoseconds.
        ranges: Box<[(i64, i64); 2]>,
    },
    /// A rate that is no number of rows a second.
    #[error("the rate must be a number of rows a second from 1e-6 to 1e6, not {hz}")]
    BadRate {
        /// The value.
        hz: f64,
    },
    /// A rate far beyond that of the channels.
    #[error(
        "{}: {hz} rows a second are more than 100 times the {fastest} samples a second of {name}: take a rate ({RATE}; {TIME_SECTION} rate in a recipe) up to {}",
        path.display(), 100.0 * fastest
    )]
    RateTooHigh {
        /// The file.
        path: PathBuf,
        /// Rows a second.
        hz: f64,
        /// The fastest channel.
        name: String,
        /// Its samples a second.
        fastest: f64,
    },
    /// A rate asked of rows without a clock.
    #[error(
        "{}: rows at a rate ({RATE}; {TIME_SECTION} rate in a recipe) need a clock, and this file has none: name the time column ({TIME}), or leave the rate out",
        path.display()
    )]
    RateWithoutClock {
        /// The file.
        path: PathBuf,
    },
    /// A run without a file for one of its topics.
    #[error(
        "{}: no file for `{setting}` of {FILES}: a run has one file a topic. It holds {there}: mend the pattern, add the file, or leave the run out",
        folder.display()
    )]
    NoFileOfTopic {
        /// The run's folder.
        folder: PathBuf,
        /// The entry of `[files]`.
        setting: String,
        /// Contents of the folder.
        there: String,
    },
    /// Two files of a run for one topic.
    #[error(
        "{}: {} and {} both match `{setting}` of {FILES}: narrow the pattern, or put every run into a folder of its own",
        folder.display(), first.display(), second.display()
    )]
    TwoFiles {
        /// The run's folder.
        folder: PathBuf,
        /// The entry of `[files]`.
        setting: String,
        /// A file.
        first: PathBuf,
        /// The other one.
        second: PathBuf,
    },
    /// A file that is two topics.
    #[error("{} matches the patterns of `{}` and of `{}` in {FILES}: narrow one of them", path.display(), topics[0], topics[1])]
    FileOfTwoTopics {
        /// The file.
        path: PathBuf,
        /// The topics.
        topics: [String; 2],
    },
    /// A robot's log as a topic of a run.
    #[error("{} matches `{topic}` in {FILES}, which joins tables (CSV, Parquet); a robot's log has topics: leave {FILES} out for it", path.display())]
    TopicIsLog {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
    },
    /// A file outside of all runs.
    #[error(
        "{} belongs to no run: no file beside it matches a pattern of {FILES}. Name the folders of runs, mend the patterns, or leave {FILES} out for single files",
        path.display()
    )]
    FileOfNoRun {
        /// The file.
        path: PathBuf,
    },
    /// A name that is of no topic of a run.
    #[error("{}: no file in {FILES} has `{name}`; write TOPIC.COLUMN, or TOPIC as the base; the topics are {topics}", path.display())]
    NoTopicOfRun {
        /// The run's folder.
        path: PathBuf,
        /// The name.
        name: String,
        /// The topics.
        topics: String,
    },
    /// Files joined without stamps.
    #[error(
        "{}: the files of a run ({FILES}) are joined by their stamps: leave the sampling period out ({DT}; {entry}), and name the time column where it is not found",
        path.display(), entry = TIME_SECTION.entry("dt")
    )]
    RunWithoutClock {
        /// The run's folder.
        path: PathBuf,
    },
    /// Two files of a run without a moment in common.
    #[error(
        "{}: the stamps of {first}, {}, and of {second}, {}, do not overlap, and the files of a run ({FILES}) share one clock: name its unit ({TIME_SECTION} column and unit), leave one file out, or, for values that hold until the next, write max_gap = \"none\" in {JOIN}",
        path.display(), describe_range(ranges[0]), describe_range(ranges[1])
    )]
    FilesApart {
        /// The run's folder.
        path: PathBuf,
        /// A topic.
        first: String,
        /// The other topic.
        second: String,
        /// The first and the last of each, nanoseconds.
        ranges: Box<[(i64, i64); 2]>,
    },
    /// A rate that asks for far more rows than there are samples.
    #[error(
        "{}: {hz} rows a second would be {rows} rows for at most {samples} samples of a channel, as the stamps of {name} run over {}: take a lower rate, another clock (stamp = \"log\", \"publish\" or \"header\"), or the stamps of a channel",
        path.display(), describe_range(*range)
    )]
    GridTooLong {
        /// The file.
        path: PathBuf,
        /// The channel.
        name: String,
        /// Rows a second.
        hz: f64,
        /// Rows there would be.
        rows: usize,
        /// Samples of the longest channel.
        samples: usize,
        /// First and last stamp of the longest run, nanoseconds.
        range: (i64, i64),
    },
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<Error> for fleetfoot_data::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::Cancelled(cancelled) => Self::Cancelled(cancelled),
            error => Self::Read(Box::new(error)),
        }
    }
}

/// Message about a file of an unknown format: some formats are read in Python alone.
fn unknown_format(path: &Path) -> String {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    let (kind, package) = match &*ending {
        "h5" | "hdf5" | "hdf" | "he5" => ("HDF5", "h5py"),
        "arrow" | "feather" | "arrows" | "ipc" => ("Arrow", "pyarrow"),
        _ => return format!("unknown format; the readable ones end in {KNOWN}: rename or convert the file"),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    format!(
        "{kind} is read in Python alone, as ff.open(\"{name}\") with {package}: open it there, or save it as Parquet or CSV"
    )
}

/// `; <with> <name>` when there is a name, else `; <without>`.
fn hint(nearest: &Option<String>, with: impl std::fmt::Display, without: impl std::fmt::Display) -> String {
    match nearest {
        Some(name) => format!("; {with} `{name}`"),
        None => format!("; {without}"),
    }
}

/// Stamps before this are no dates: clocks that began at zero.
const YEAR_2000: i64 = 946_684_800_000_000_000;

/// A range of stamps for a message: seconds, and dates where the stamps are such.
fn describe_range((start, end): (i64, i64)) -> String {
    let seconds = format!("{} to {} s", seconds(start), seconds(end));
    let date =
        |stamp: i64| jiff::Timestamp::from_nanosecond(stamp.into()).ok().map(|date| date.strftime("%F %T").to_string());
    match (date(start), date(end)) {
        (Some(first), Some(last)) if start >= YEAR_2000 => format!("{seconds} ({first} to {last} UTC)"),
        _ => seconds,
    }
}

/// Nanoseconds as seconds, with all digits that are not zero.
fn seconds(stamp: i64) -> String {
    let (sign, size) = (if stamp < 0 { "-" } else { "" }, stamp.unsigned_abs());
    let text = format!("{sign}{}.{:09}", size / 1_000_000_000, size % 1_000_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A few names for a message.
pub(crate) fn list(names: &[&str]) -> String {
    let shown = names.iter().take(12).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    if names.len() > 12 { format!("{shown} and {} more", names.len() - 12) } else { shown }
}

/// A word for a POSIX shell.
pub fn shell_word(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:,=@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

/// A text for a message: one line, at most 60 characters.
pub(crate) fn shorten(bytes: &[u8]) -> String {
    let text: String =
        String::from_utf8_lossy(&bytes[..bytes.len().min(240)]).chars().flat_map(char::escape_debug).collect();
    if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
}
