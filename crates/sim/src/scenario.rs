//! Scenarios: a robot, its world and its sensors, run to produce a log.

use fleetfoot_data::Column;

use crate::{Reading, Stamps, Topic};

/// Why a log could not be written.
pub type SinkError = Box<dyn std::error::Error + Send + Sync>;

/// Receiver of a run's log.
///
/// A sink that keeps messages does not need rows, and the other way round: the default of either method does nothing.
pub trait Sink {
    /// A message on the topic with this index in [`Scenario::topics`]. Messages come in the order of their log stamps.
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        let _ = (topic, stamps, reading);
        Ok(())
    }

    /// Takes the true values at a stamp (ns, true time), in the order of [`Scenario::columns`]. Rows are
    /// [`Scenario::row_period`] apart.
    fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        let _ = (stamp, values);
        Ok(())
    }
}

/// A robot, its world, its sensors and what drives it: immutable, so that runs can go in parallel.
pub trait Scenario: Send + Sync {
    /// The topics of its messages.
    fn topics(&self) -> Vec<Topic>;

    /// The columns of its rows of truth, without the time: states first, then inputs, then what else is known.
    fn columns(&self) -> Vec<Column>;

    /// Number of columns that are states, and number of inputs after them.
    fn regressors(&self) -> Regressors;

    /// Seconds between rows.
    fn row_period(&self) -> f64;

    /// Simulates one run from its beginning. The same scenario, seed and length give the same bits.
    ///
    /// # Errors
    /// Those of the sink, and nothing else: what happens to the robot is told by [`End`].
    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError>;
}

/// Columns that a model of the robot is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Regressors {
    /// The first columns are states.
    pub states: usize,
    /// Those after them are inputs.
    pub inputs: usize,
}

/// One run of a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Its length, s of true time.
    pub seconds: f64,
    /// Seed of its random numbers.
    pub seed: u64,
}

/// End of a run.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum End {
    /// It ran for its whole length.
    Complete,
    /// It ended before its length because there was nothing more to record: a climb that came to its top. No fault.
    Early {
        /// True time, s.
        seconds: f64,
        /// Reason in a few words.
        reason: String,
    },
    /// The robot left where it may be, fell, or the like; the log ends there.
    Fault {
        /// True time, s.
        seconds: f64,
        /// Description of the fault.
        reason: String,
    },
}
