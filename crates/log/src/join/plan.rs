//! Requests to each series, gathered so that each sample is looked up once.

use crate::{
    MaxGap,
    join::{JoinKind, Series},
};

/// A column of the joined table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JoinColumn {
    /// The series it comes from.
    pub series: usize,
    /// Its column in that series; not looked at when there is a `quaternion`.
    pub column: usize,
    /// Kind of join.
    pub kind: JoinKind,
    /// Time for which a sample is trusted. Between two samples further apart, a value is NaN; a held value is NaN if
    /// its sample is older. Automatic is five median steps of the series, as for episodes; of bursts, five times the
    /// step between them. Unlimited bridges any gap, and a held value is then latched: it continues beyond the last
    /// sample too.
    pub gap: MaxGap,
    /// For [`JoinKind::Slerp`]: the columns of x, y, z and w in that series. A component without the other three is no rotation and is
    /// joined linearly.
    pub quaternion: Option<[usize; 4]>,
    /// For [`JoinKind::Slerp`]: which of the four this is, 0 to 3.
    pub component: usize,
}

/// Columns of one series with one rule about gaps.
#[derive(Debug, PartialEq)]
pub(super) struct Feed {
    pub series: usize,
    /// True if a sample is valid for the time after it, instead of the time between it and the next.
    pub held: bool,
    /// Nanoseconds; `None` is no limit.
    pub limit: Option<u64>,
    /// True if samples on both sides of a break are no neighbours.
    pub breaks: bool,
    pub scalars: Vec<Scalar>,
    pub rotations: Vec<Rotation>,
}

/// A number of its own.
#[derive(Debug, PartialEq)]
pub(super) struct Scalar {
    /// Its column in the series.
    pub column: usize,
    pub angle: bool,
    /// Its column in the joined table.
    pub output: usize,
}

/// A quaternion.
#[derive(Debug, PartialEq)]
pub(super) struct Rotation {
    /// Its columns in the series.
    pub columns: [usize; 4],
    /// Its components that are wanted, each with its column in the joined table.
    pub outputs: Vec<(usize, usize)>,
}

impl Feed {
    /// A held value without a limit goes on for ever.
    pub(super) fn latched(&self) -> bool {
        self.held && self.limit.is_none()
    }
}

/// Gathers the columns.
pub(super) fn feeds(series: &[Series], columns: &[JoinColumn]) -> Vec<Feed> {
    let mut feeds: Vec<Feed> = Vec::new();
    for (output, column) in columns.iter().enumerate() {
        let (held, limit) = (column.kind == JoinKind::Hold, limit(&series[column.series], column.gap));
        let breaks = column.gap == MaxGap::Auto && !series[column.series].breaks.moments().is_empty();
        let rule = (column.series, held, limit, breaks);
        let alike = |feed: &Feed| (feed.series, feed.held, feed.limit, feed.breaks) == rule;
        let place = feeds.iter().position(alike).unwrap_or_else(|| {
            let (scalars, rotations) = (Vec::new(), Vec::new());
            feeds.push(Feed { series: column.series, held, limit, breaks, scalars, rotations });
            feeds.len() - 1
        });
        let feed = &mut feeds[place];
        match column.quaternion.filter(|_| column.kind == JoinKind::Slerp) {
            Some(quaternion) => {
                let wanted = (column.component, output);
                match feed.rotations.iter_mut().find(|rotation| rotation.columns == quaternion) {
                    Some(rotation) => rotation.outputs.push(wanted),
                    None => feed.rotations.push(Rotation { columns: quaternion, outputs: vec![wanted] }),
                }
            }
            None => {
                feed.scalars.push(Scalar { column: column.column, angle: column.kind == JoinKind::Angle, output });
            }
        }
    }
    feeds
}

fn limit(series: &Series, gap: MaxGap) -> Option<u64> {
    match gap {
        // Without two neighbours there is nothing in between.
        MaxGap::Auto => Some(series.median_step.map_or(0, |step| step.saturating_mul(5))),
        // Saturates; NaN and negative numbers are 0.
        MaxGap::Seconds(seconds) => Some((seconds * 1e9).round() as u64),
        MaxGap::Unlimited => None,
    }
}
