//! Estimated clocks: for the join, for people and for programs.

use fleetfoot_log::TopicClock;
use fleetfoot_signal::{Alignment, EdgeAlignment, PartLag};
use serde::Serialize;

/// Points of a lag curve that are reported, at most.
const POINTS: usize = 401;

/// Offsets of clocks, with reports and notes.
#[derive(Debug, Default)]
pub struct Clocks {
    /// For the join.
    pub topics: Vec<TopicClock>,
    /// For people.
    pub reports: Vec<AlignedClock>,
    /// Notes on the clocks.
    pub notes: Vec<String>,
}

/// Offset and skew of another computer's clock against the clock that it was compared with, and the evidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct AlignedClock {
    /// Its name in the recipe.
    pub clock: String,
    /// The log; empty where the recipe gives the offset of all.
    pub log: String,
    /// `motion`, `wave` or `given`.
    pub by: String,
    /// The moment of the offset, seconds from the first stamp of the channel that it was compared with.
    pub at: f64,
    /// Seconds that it shows more then.
    pub offset: f64,
    /// Interval of the offset: 95 % confidence by motion. By a wave it is certain, if the edges do not contradict each
    /// other and an `even` wave in the recipe is even.
    pub offset_interval: [f64; 2],
    /// Rate relative to the other clock, seconds a second; positive: faster.
    pub skew: f64,
    /// Interval of the skew, as that of the offset.
    pub skew_interval: [f64; 2],
    /// By motion: the share of the reference's variance that the channel does not explain, and at every lag (the lag curve: seconds, share).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unexplained: Option<f64>,
    /// The lag curve, at the skew that was searched with.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<(f64, f64)>,
    /// By motion: deviation of each quarter of the log from the line; it shows clocks that do not run evenly.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<LagOfPart>,
    /// By motion: values of the channel that was compared with, and of this clock's, that were left out as gross errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<[usize; 2]>,
    /// By a wave: true if the recipe states that it is even, so that its edges bound one another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub even: Option<bool>,
    /// By a wave: edges that both saw.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub edges: Option<usize>,
    /// By a wave: edges that one of them did not see.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alone: Option<[usize; 2]>,
    /// By a wave: seconds by which its edges contradict each other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contradiction: Option<f64>,
    /// By a wave: other offsets that it allows, whole periods away.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<f64>,
}

/// The lag of a part of a log beside the line through all of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct LagOfPart {
    /// Its middle, seconds from the first stamp of the channel that was compared with.
    pub at: f64,
    /// Its lag less that of the line, s.
    pub off: f64,
    /// The standard deviation of that, s.
    pub deviation: f64,
}

impl AlignedClock {
    pub(crate) fn new(clock: &str, log: &str, by: &str, [at, offset, skew]: [f64; 3]) -> Self {
        Self {
            clock: clock.to_owned(),
            log: log.to_owned(),
            by: by.to_owned(),
            at,
            offset,
            offset_interval: [offset; 2],
            skew,
            skew_interval: [skew; 2],
            unexplained: None,
            curve: Vec::new(),
            parts: Vec::new(),
            left_out: None,
            even: None,
            edges: None,
            alone: None,
            contradiction: None,
            others: Vec::new(),
        }
    }

    pub(crate) fn given(clock: &str, offset: f64) -> Self {
        Self::new(clock, "", "given", [0.0, offset, 0.0])
    }

    pub(crate) fn by_motion(clock: &str, log: &str, alignment: &Alignment, start: f64) -> Self {
        let line = alignment.line;
        let interval = |value: f64, deviation: f64| [value - 1.96 * deviation, value + 1.96 * deviation];
        let part = |part: &PartLag| LagOfPart { at: part.at - start, off: part.off, deviation: part.deviation };
        Self {
            offset_interval: interval(line.offset, alignment.deviation),
            skew_interval: interval(line.skew, alignment.skew_deviation),
            unexplained: Some(alignment.unexplained),
            curve: thinned(&alignment.curve),
            parts: alignment.parts.iter().map(part).collect(),
            left_out: Some(alignment.left_out.each_ref().map(Vec::len)),
            ..Self::new(clock, log, "motion", [line.at - start, line.offset, line.skew])
        }
    }

    pub(crate) fn by_wave(clock: &str, log: &str, alignment: &EdgeAlignment, even: bool, start: f64) -> Self {
        let line = alignment.line;
        Self {
            offset_interval: alignment.offset,
            skew_interval: alignment.skew,
            even: Some(even),
            edges: Some(alignment.edges),
            alone: Some(alignment.alone),
            contradiction: Some(alignment.contradiction),
            others: alignment.others.clone(),
            ..Self::new(clock, log, "wave", [line.at - start, line.offset, line.skew])
        }
    }

    /// Doubts about the alignment, in sentences: an unexplained share above `doubtful`, quarters that are off by more
    /// than `bent` deviations, edges that contradict each other.
    pub(crate) fn doubts(&self, doubtful: f64, bent: f64) -> Vec<String> {
        let place = format!("[clocks.{}], {}", self.clock, self.log);
        let mut doubts = Vec::new();
        if let Some(share) = self.unexplained.filter(|share| *share > doubtful) {
            doubts.push(format!(
                "{place}: {:.0} % of the motion are unexplained at the best offset: check that both channels measure the same motion",
                100.0 * share
            ));
        }
        let is_off = |part: &&LagOfPart| part.off.abs() > bent * part.deviation;
        let off = self.parts.iter().filter(is_off).max_by(|a, b| a.off.abs().total_cmp(&b.off.abs()));
        if let Some(part) = off {
            doubts.push(format!(
                "{place}: the clocks do not run evenly: about {:.0} s the lag is {:.3} ms (+- {:.3}) off a straight line",
                part.at,
                1e3 * part.off,
                1e3 * part.deviation
            ));
        }
        if let Some(seconds) = self.contradiction.filter(|seconds| *seconds > 0.0) {
            doubts.push(format!(
                "{place}: edges contradict each other by {:.4} ms: stamps jitter (dejitter = true evens them out), or the clocks do not run evenly; the interval is that of stamps which are wrong by as much",
                1e3 * seconds
            ));
        }
        if !self.others.is_empty() {
            let others: Vec<String> = self.others.iter().map(|offset| format!("{offset:.3}")).collect();
            doubts.push(format!(
                "{place}: the wave repeats: offsets of {} s fit as well, and the one nearest to the given offset is used; a reach below half the period leaves one",
                others.join(", ")
            ));
        }
        doubts
    }
}

/// Every n-th point of a curve, and its least.
fn thinned(curve: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let every = curve.len().div_ceil(POINTS).max(1);
    let least = (0..curve.len()).min_by(|&a, &b| curve[a].1.total_cmp(&curve[b].1));
    let kept = |at: &usize| at.is_multiple_of(every) || Some(*at) == least;
    // Lags at which too few rows are shared have no share.
    (0..curve.len()).filter(kept).map(|at| curve[at]).filter(|(_, share)| share.is_finite()).collect()
}
