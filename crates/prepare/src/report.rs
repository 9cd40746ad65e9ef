//! What preparation did, for people and programs.

use fleetfoot_dataset::clocks::AlignedClock;
use fleetfoot_signal::Dejittered;
use serde::Serialize;

use crate::{
    fused_report::{BodyReport, JointReport},
    places::Places,
};

/// What preparation did.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PrepareReport {
    /// Rows that were read.
    pub rows: usize,
    /// Rows that were written.
    pub written: usize,
    /// Seconds over which neighbouring rows share smoothed values: the longest of all channels.
    pub smoothed: f64,
    /// The clocks of other computers, log by log.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub clocks: Vec<AlignedClock>,
    /// What fusion found of a body's sensors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyReport>,
    /// What fusion found of the joints' sensors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<JointReport>,
    /// Every episode that was read.
    pub episodes: Vec<EpisodeReport>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// What was done to an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct EpisodeReport {
    /// Its name.
    pub episode: String,
    /// Rows.
    pub rows: usize,
    /// Rows cut off at its ends.
    pub clipped: usize,
    /// Rows of which the sensors that are fused do not tell the state: before, between and beyond what all of them measured.
    #[serde(skip_serializing_if = "Places::is_empty")]
    pub untold: Places,
    /// Rows beyond the bounds of a channel, which end an episode.
    pub out_of_bounds: Places,
    /// Rows of pieces that are too short to be written.
    pub too_short: Places,
    /// What its stamps say of the clock, where they were evened out.
    pub clock: Option<ClockReport>,
    /// What was written.
    pub pieces: Vec<PieceReport>,
}

/// What stamps say of a clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ClockReport {
    /// Seconds a sample.
    pub period: f64,
    /// Standard deviation of the period, s.
    pub period_deviation: f64,
    /// Standard deviation of the stamps, s.
    pub jitter: f64,
    /// Correlation of neighbouring errors of the stamps: near 1 where clocks drift, which a straight line does not follow.
    pub correlation: f64,
    /// Missing samples.
    pub missing: u64,
}

/// What was written of an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PieceReport {
    /// The file's name.
    pub file: String,
    /// Its rows.
    pub rows: usize,
    /// The states and inputs that were prepared.
    pub channels: Vec<ChannelReport>,
}

/// What was done to a channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ChannelReport {
    /// The state or input.
    pub channel: String,
    /// How it became smooth.
    pub method: String,
    /// The topic whose samples the curve goes through, where that is not the rows' own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// What the stamps of these samples say of their clock, where they were evened out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockReport>,
    /// Samples: rows, or messages of the topic.
    pub samples: usize,
    /// Samples without a value.
    pub missing: usize,
    /// Values at or beyond the ends of what the sensor can measure.
    pub saturated: Places,
    /// Values that hang.
    pub stuck: Places,
    /// Values that are repeated before a jump, as of a sensor that hangs; they are not left out.
    pub hangs: Places,
    /// Values off the median of their neighbours.
    pub hampel: Places,
    /// Values off the curve.
    pub rejected: Places,
    /// Whether rejection was given up and nothing rejected: what stands out is motion, and no error.
    pub gave_up: bool,
    /// Rows that stay empty: nothing was measured over longer than the curve bridges.
    pub left_empty: Places,
    /// The penalty, s^3 or s^5.
    pub lambda: Option<f64>,
    /// Whether the penalty is at an end of what was searched.
    pub lambda_at_end: bool,
    /// Whether the penalty is the least that was searched, so that the curve goes through every value.
    pub through_all: bool,
    /// Standard deviation of a measurement about the curve.
    pub noise: Option<f64>,
    /// Seconds over which neighbouring rows share smoothed values.
    pub smoothed: f64,
}

impl ClockReport {
    /// What evening out found.
    pub(crate) fn of(even: &Dejittered) -> Self {
        Self {
            period: even.period,
            period_deviation: even.period_deviation,
            jitter: even.jitter,
            correlation: even.correlation,
            missing: even.gaps.iter().map(|(_, missing)| missing).sum(),
        }
    }
}
