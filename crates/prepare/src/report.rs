//! Report of a preparation, for people and programs.

use fleetfoot_dataset::clocks::AlignedClock;
use fleetfoot_signal::Dejittered;
use serde::Serialize;

use crate::{
    fused_report::{BodyReport, JointReport},
    places::Places,
};

/// Report of a preparation.
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
    /// Report of the fusion of a body's sensors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyReport>,
    /// Report of the fusion of the joints' sensors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<JointReport>,
    /// Every episode that was read.
    pub episodes: Vec<EpisodeReport>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Report of an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct EpisodeReport {
    /// Its name.
    pub episode: String,
    /// Rows.
    pub rows: usize,
    /// Rows cut off at its ends.
    pub clipped: usize,
    /// Rows whose state the fused sensors do not determine: before, between and beyond the span of all of them.
    #[serde(skip_serializing_if = "Places::is_empty")]
    pub untold: Places,
    /// Rows beyond the bounds of a channel, which end an episode.
    pub out_of_bounds: Places,
    /// Rows of pieces that are too short to be written.
    pub too_short: Places,
    /// Clock of its stamps, if they were evened out.
    pub clock: Option<ClockReport>,
    /// Pieces that were written.
    pub pieces: Vec<PieceReport>,
}

/// Clock, estimated from stamps.
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

/// A piece of an episode that was written.
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

/// Report of a channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ChannelReport {
    /// The state or input.
    pub channel: String,
    /// Smoothing method.
    pub method: String,
    /// The topic whose samples the curve goes through, where that is not the rows' own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// Clock of these samples' stamps, if they were evened out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockReport>,
    /// Samples: rows, or messages of the topic.
    pub samples: usize,
    /// Samples without a value.
    pub missing: usize,
    /// Values at or beyond the ends of the sensor's range.
    pub saturated: Places,
    /// Values of a sensor that is stuck.
    pub stuck: Places,
    /// Values that are repeated before a jump, as of a stuck sensor; they are not left out.
    pub hangs: Places,
    /// Values off the median of their neighbours.
    pub hampel: Places,
    /// Values off the curve.
    pub rejected: Places,
    /// True if rejection was given up and nothing rejected: the outliers are motion, and no errors.
    pub gave_up: bool,
    /// Rows that stay empty: nothing was measured over longer than the curve bridges.
    pub left_empty: Places,
    /// The penalty, s^3 or s^5.
    pub lambda: Option<f64>,
    /// True if the penalty is at an end of the searched range.
    pub lambda_at_end: bool,
    /// True if the penalty is the least in the searched range: the curve interpolates every value.
    pub through_all: bool,
    /// Standard deviation of a measurement about the curve.
    pub noise: Option<f64>,
    /// Seconds over which neighbouring rows share smoothed values.
    pub smoothed: f64,
}

impl ClockReport {
    /// Clock of stamps that were evened out.
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
