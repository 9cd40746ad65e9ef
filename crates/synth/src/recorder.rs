//! Recorder of a run's readings and rows: the file, the measure of excitation, progress and cancellation.

use std::{collections::BTreeMap, path::Path};

use fleetfoot_data::{Cancelled, Progress};
use fleetfoot_fit::Error;
use fleetfoot_output::{McapOptions, WriteOptions};
use fleetfoot_sim::{Reading, Scenario, Sink, SinkError, Stamps, Topic};

use super::{
    Format, Job,
    excitation_report::{Gathered, Meter, Terms},
    mcap_sink::McapSink,
    parquet_sink::ParquetSink,
};

/// Topics of the truth begin like this.
const TRUTH: &str = "/truth";

const NANOSECONDS: f64 = 1e9;

/// Returns true if a job keeps a topic.
pub(super) fn keeps(job: &Job, topic: &Topic) -> bool {
    job.truth || !topic.name.starts_with(TRUTH)
}

/// Output of a run's log.
pub(super) enum Output {
    Mcap(Box<McapSink>),
    Parquet(Box<ParquetSink>),
}

impl Output {
    pub(super) fn create(
        path: &Path,
        job: &Job,
        metadata: BTreeMap<String, String>,
        scenario: &dyn Scenario,
    ) -> Result<Self, Error> {
        Ok(match job.format {
            Format::Mcap => {
                let options = McapOptions { metadata, ..McapOptions::default() };
                let keep = |topic: &Topic| keeps(job, topic);
                Self::Mcap(Box::new(McapSink::create(path, &options, scenario.topics(), keep)?))
            }
            Format::Parquet => {
                let options = WriteOptions { metadata, ..WriteOptions::default() };
                Self::Parquet(Box::new(ParquetSink::create(path, &options, &scenario.columns())?))
            }
        })
    }
}

/// Simulated seconds of all runs.
pub(super) struct Seconds<'a> {
    progress: &'a dyn Progress,
    /// Whole seconds of a run, at least one.
    each: usize,
    total: usize,
}

/// Pieces of parallel work that are no units of progress.
pub(super) struct Quiet<'a>(&'a dyn Progress);

impl<'a> Seconds<'a> {
    pub(super) fn new(progress: &'a dyn Progress, seconds: f64, runs: u64) -> Self {
        let each = seconds.ceil().max(1.0) as usize;
        Self { progress, each, total: each.saturating_mul(runs as usize) }
    }

    /// For the work itself, which counts runs.
    pub(super) fn quiet(&self) -> Quiet<'_> {
        Quiet(self.progress)
    }

    /// For a run.
    pub(super) fn run(&self) -> RunSeconds<'_> {
        RunSeconds { of: self, reported: 0 }
    }
}

impl Progress for Quiet<'_> {
    fn advance(&self, _units: usize, _total: usize) {}

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// Simulated seconds of a run.
pub(super) struct RunSeconds<'a> {
    of: &'a Seconds<'a>,
    reported: usize,
}

impl RunSeconds<'_> {
    /// The run has come to this second.
    fn reach(&mut self, second: usize) -> Result<(), Cancelled> {
        let second = second.min(self.of.each);
        if second > self.reported {
            self.of.progress.advance(second - self.reported, self.of.total);
            self.reported = second;
            if self.of.progress.cancelled() {
                return Err(Cancelled);
            }
        }
        Ok(())
    }
}

/// The sink of a run.
pub(super) struct Recorder<'a> {
    output: Output,
    meter: Meter<'a>,
    /// Numbers of a row.
    columns: usize,
    rows: u64,
    messages: u64,
    /// True time of the first row, ns.
    start: Option<i64>,
    seconds: RunSeconds<'a>,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(output: Output, terms: &'a Terms, columns: usize, seconds: RunSeconds<'a>) -> Self {
        Self { output, meter: Meter::new(terms), columns, rows: 0, messages: 0, start: None, seconds }
    }

    /// Completes the file. Returns rows, messages, and the gathered sums.
    pub(super) fn finish(mut self) -> Result<(u64, u64, Gathered), Error> {
        // A fault ends a run early: what was not simulated is done too.
        self.seconds.reach(usize::MAX)?;
        match self.output {
            Output::Mcap(sink) => sink.finish()?,
            Output::Parquet(sink) => sink.finish()?,
        }
        Ok((self.rows, self.messages, self.meter.finish()))
    }
}

impl Sink for Recorder<'_> {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        if let Output::Mcap(sink) = &mut self.output {
            self.messages += u64::from(sink.message(topic, stamps, reading)?);
        }
        Ok(())
    }

    fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        if values.len() != self.columns {
            return Err(format!("a row of {} numbers for {} columns", values.len(), self.columns).into());
        }
        self.rows += 1;
        self.meter.row(values);
        if let Output::Parquet(sink) = &mut self.output {
            sink.row(stamp, values)?;
        }
        let start = *self.start.get_or_insert(stamp);
        let second = (stamp.saturating_sub(start) as f64 / NANOSECONDS) as usize;
        Ok(self.seconds.reach(second).map_err(Error::from)?)
    }
}
