//! The line between two clocks that saw one square wave.
//!
//! A computer that samples a wave knows of an edge between which two of its stamps it came. Two computers that saw the same edge bound the line between their clocks from both sides, and many
//! edges bound it closely: the lines that pass between all bounds are the feasible set of a linear program in offset and skew, whose ends are an interval that holds the truth for certain.

mod even;

use crate::{ClockLine, Record, SignalError, Within, error::check, outliers::median};

/// Known properties of a square wave and of its two records.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WaveOptions {
    /// By how much the stamps of either record may be wrong, s.
    pub margin: f64,
    /// True if a timer switches the wave. Its rising edges are then equally far apart by any clock that runs evenly,
    /// and so are its falling ones. Each edge is bounded by all others of its kind too. With many edges the interval is
    /// a small part of a sample.
    pub even: bool,
}

/// Offset and skew of two clocks from the edges of a wave.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeAlignment {
    /// The line that keeps the greatest distance from all bounds.
    pub line: ClockLine,
    /// The least and the greatest offset at the line's moment, s, that agree with all edges.
    pub offset: [f64; 2],
    /// The least and the greatest skew that agree with all edges, seconds a second.
    pub skew: [f64; 2],
    /// Edges that both saw.
    pub edges: usize,
    /// Edges of the first and of the second that were not paired.
    pub alone: [usize; 2],
    /// Size of the contradiction between the bounds of edges, s; 0 if a line agrees with all. If it is not 0, the
    /// intervals are those of bounds widened by twice as much. They then hold the truth only if no stamp is more wrong
    /// than that.
    pub contradiction: f64,
    /// Other offsets, s, at which as many edges agree: a periodic wave determines offsets only within its period.
    pub others: Vec<f64>,
}

/// Edges from which the first lag is voted.
const VOTERS: usize = 16;

/// The share of the most votes at which a lag is as good as the best.
const AS_GOOD: f64 = 0.75;

/// An edge of a square wave, between two stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    rises: bool,
    after: f64,
    before: f64,
}

impl Edge {
    fn middle(&self) -> f64 {
        0.5 * (self.after + self.before)
    }
}

/// The line between the clocks of two records of one square wave; what the first shows at t, the second shows at `line.second(t)`.
///
/// A wave need not be regular. If it is, offsets that differ by whole periods fit equally well; the one nearest to `within.about` is taken, and the others are reported.
///
/// # Errors
/// Stamps that do not increase, records without a wave, fewer than two edges that both saw, a reach or a skew that are not positive, edges that are not even where `even` says that they are.
pub fn align_edges(
    first: Record<'_>,
    second: Record<'_>,
    within: Within,
    wave: WaveOptions,
) -> Result<EdgeAlignment, SignalError> {
    let (Within { about, reach, skew }, WaveOptions { mut margin, even }) = (within, wave);
    check(reach > 0.0 && reach.is_finite(), "the reach", reach, "a reach must be positive and finite")?;
    check(skew > 0.0 && skew < 0.1, "the greatest skew", skew, "a skew must be positive, and below 0.1")?;
    check(about.is_finite(), "the lag to search about", about, "a lag must be finite")?;
    check(margin >= 0.0 && margin.is_finite(), "the margin", margin, "a margin must be 0 or more, and finite")?;
    let (first, second) = (edges(first.check(2)?), edges(second.check(2)?));
    let (lag, others) = voted(&first, &second, within)?;
    let mut pairs = followed(&first, &second, lag);
    if pairs.len() < 2 {
        return Err(SignalError::NotAligned { problem: "both records have fewer than two edges of the wave" });
    }
    if even {
        // The bounds have the margin in them then.
        pairs = even::narrowed(&pairs, margin).ok_or(SignalError::UnevenWave)?;
        margin = 0.0;
    }
    let at = 0.5 * (pairs[0].0.middle() + pairs[pairs.len() - 1].0.middle());
    let program = Program::new(&pairs, at, margin, skew);
    let contradiction = (-0.5 * program.best().1).max(0.0);
    let program = if contradiction > 0.0 { Program::new(&pairs, at, margin + contradiction, skew) } else { program };
    let (skew, _) = program.best();
    let line = ClockLine { at, offset: 0.5 * (program.most(skew) + program.least(skew)), skew };
    let (skew, offset) = program.feasible();
    let alone = [first.len() - pairs.len(), second.len() - pairs.len()];
    Ok(EdgeAlignment { line, offset, skew, edges: pairs.len(), alone, contradiction: 2.0 * contradiction, others })
}

/// The edges of a wave: from a value in the lowest quarter of its range to one in the highest, or back.
fn edges(record: Record<'_>) -> Vec<Edge> {
    let measured = || record.times.iter().zip(record.values).filter(|(_, value)| !value.is_nan());
    let low = measured().map(|(_, value)| *value).fold(f64::INFINITY, f64::min);
    let high = measured().map(|(_, value)| *value).fold(f64::NEG_INFINITY, f64::max);
    let quarter = 0.25 * (high - low);
    let (mut edges, mut last) = (Vec::new(), None);
    for (&time, &value) in measured() {
        let is_high = match value {
            value if value <= low + quarter => false,
            value if value >= high - quarter => true,
            _ => continue,
        };
        if let Some((was_high, after)) = last
            && was_high != is_high
        {
            edges.push(Edge { rises: is_high, after, before: time });
        }
        last = Some((is_high, time));
    }
    edges
}

/// The median distance between neighbouring edges.
fn interval(edges: &[Edge]) -> f64 {
    median(&mut edges.windows(2).map(|pair| pair[1].middle() - pair[0].middle()).collect::<Vec<_>>()).unwrap_or(0.0)
}

/// The lag on which most pairs of edges agree, nearest to the one that is searched about where several do, and the others.
fn voted(first: &[Edge], second: &[Edge], within: Within) -> Result<(f64, Vec<f64>), SignalError> {
    let shared = |edge: &&Edge| {
        let lag = edge.middle() + within.about;
        second.iter().any(|other| (other.middle() - lag).abs() <= within.reach)
    };
    let shared: Vec<&Edge> = first.iter().filter(shared).collect();
    let from = shared.len().saturating_sub(VOTERS) / 2;
    let voters = &shared[from..(from + VOTERS).min(shared.len())];
    let mut lags: Vec<f64> = Vec::new();
    for edge in voters {
        let low = second.partition_point(|other| other.middle() < edge.middle() + within.about - within.reach);
        let near =
            second[low..].iter().take_while(|other| other.middle() <= edge.middle() + within.about + within.reach);
        lags.extend(near.filter(|other| other.rises == edge.rises).map(|other| other.middle() - edge.middle()));
    }
    lags.sort_by(f64::total_cmp);
    let width = |edges: &[Edge]| median(&mut edges.iter().map(|edge| edge.before - edge.after).collect::<Vec<_>>());
    let drift = voters.last().zip(voters.first()).map_or(0.0, |(last, first)| last.middle() - first.middle());
    let tolerance = width(first).unwrap_or(0.0) + width(second).unwrap_or(0.0) + within.skew * drift;
    let mut lag_clusters = clusters(&lags, tolerance);
    let most = lag_clusters.iter().map(|(_, votes)| *votes).max().unwrap_or(0);
    lag_clusters.retain(|(_, votes)| *votes as f64 >= AS_GOOD * most as f64);
    lag_clusters.sort_by(|a, b| (a.0 - within.about).abs().total_cmp(&(b.0 - within.about).abs()));
    let mut lags = lag_clusters.into_iter().map(|(lag, _)| lag);
    match lags.next() {
        Some(lag) => Ok((lag, lags.collect())),
        None => Err(SignalError::NotAligned { problem: "no edge of one wave is within reach of an edge of the other" }),
    }
}

/// Runs of sorted lags that lie within a tolerance: their middle, and how many they are.
fn clusters(lags: &[f64], tolerance: f64) -> Vec<(f64, usize)> {
    let mut groups: Vec<(f64, usize)> = Vec::new();
    let mut start = 0;
    while start < lags.len() {
        let end = start + lags[start..].partition_point(|lag| lag - lags[start] <= tolerance);
        groups.push((0.5 * (lags[start] + lags[end - 1]), end - start));
        start = end;
    }
    groups
}

/// The edges that both saw: from the middle of the record outwards, each at the lag of the one before, so that the clocks may drift apart by many periods.
fn followed(first: &[Edge], second: &[Edge], lag: f64) -> Vec<(Edge, Edge)> {
    let most = 0.25 * interval(first).min(interval(second));
    let nearest = |edge: &Edge, lag: f64| {
        let at = second.partition_point(|other| other.middle() < edge.middle() + lag);
        let off = |other: &Edge| other.middle() - edge.middle() - lag;
        let near = second[at.saturating_sub(2)..(at + 2).min(second.len())].iter().copied();
        let alike = near.filter(|other| other.rises == edge.rises);
        alike.min_by(|a, b| off(a).abs().total_cmp(&off(b).abs())).filter(|other| off(other).abs() < most)
    };
    let follow = |edges: &mut dyn Iterator<Item = &Edge>| {
        let (mut lag, mut pairs) = (lag, Vec::new());
        for edge in edges {
            if let Some(other) = nearest(edge, lag) {
                lag = other.middle() - edge.middle();
                pairs.push((*edge, other));
            }
        }
        pairs
    };
    let (before, after) = first.split_at(first.len() / 2);
    let mut pairs = follow(&mut before.iter().rev());
    pairs.reverse();
    pairs.extend(follow(&mut after.iter()));
    pairs
}

/// The linear program: offset and skew of the lines above all lower points and below all upper ones.
struct Program {
    /// The lower hull of the upper points, and the upper hull of the lower ones: no others bound a line.
    upper: Vec<(f64, f64)>,
    lower: Vec<(f64, f64)>,
    /// Skews at which the vertex that bounds changes, and the ends of what is allowed.
    skews: Vec<f64>,
}

impl Program {
    /// The second clock reads at least `second.after` when the first reads `first.before`, and at most `second.before` when it reads `first.after`.
    fn new(pairs: &[(Edge, Edge)], at: f64, margin: f64, most: f64) -> Self {
        let upper = pairs.iter().map(|(first, second)| (first.after - at, second.before - first.after + 2.0 * margin));
        let lower = pairs.iter().map(|(first, second)| (first.before - at, second.after - first.before - 2.0 * margin));
        Self::between(upper, lower, most)
    }

    /// Lines below the upper points and above the lower ones, both in the order of their x, with a skew of `most` either way.
    fn between(upper: impl Iterator<Item = (f64, f64)>, lower: impl Iterator<Item = (f64, f64)>, most: f64) -> Self {
        let (upper, lower) = (hull(upper, 1.0), hull(lower, -1.0));
        let slope = |pair: &[(f64, f64)]| (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0);
        let all = upper.windows(2).chain(lower.windows(2)).map(slope);
        let mut skews: Vec<f64> = all.filter(|skew| skew.abs() < most).chain([-most, most]).collect();
        skews.sort_by(f64::total_cmp);
        Self { upper, lower, skews }
    }

    /// The greatest offset of a line of this skew.
    fn most(&self, skew: f64) -> f64 {
        tangent(&self.upper, skew, 1.0)
    }

    /// The least.
    fn least(&self, skew: f64) -> f64 {
        tangent(&self.lower, skew, -1.0)
    }

    fn gap(&self, skew: f64) -> f64 {
        self.most(skew) - self.least(skew)
    }

    /// The skew of the widest gap, and that gap; the middle of skews where several are alike.
    fn best(&self) -> (f64, f64) {
        let gaps: Vec<f64> = self.skews.iter().map(|&skew| self.gap(skew)).collect();
        let widest = gaps.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let alike = |&at: &usize| gaps[at] >= widest - 1e-12 * widest.abs();
        let first = (0..gaps.len()).find(alike).unwrap_or(0);
        let last = (0..gaps.len()).rev().find(alike).unwrap_or(0);
        let skew = 0.5 * (self.skews[first] + self.skews[last]);
        (skew, self.gap(skew))
    }

    /// The ends of skews, and of offsets. The gap is concave in the skew and straight between the vertices' slopes.
    fn feasible(&self) -> ([f64; 2], [f64; 2]) {
        let skews = self.ends();
        (skews, Self::reach(&self.corners(skews), 0.0))
    }

    /// The least and the greatest skew of a line.
    fn ends(&self) -> [f64; 2] {
        let best = self.best().0;
        let end = |further: &mut dyn Iterator<Item = f64>| {
            let mut inside = best;
            for skew in further {
                let (from, to) = (self.gap(inside).max(0.0), self.gap(skew));
                if to < 0.0 {
                    return inside + (skew - inside) * from / (from - to);
                }
                inside = skew;
            }
            inside
        };
        let low = end(&mut self.skews.iter().rev().copied().filter(|skew| *skew < best));
        let high = end(&mut self.skews.iter().copied().filter(|skew| *skew > best));
        [low, high]
    }

    /// Skews between these at which the set of lines has corners, with the least and the greatest offset of each.
    fn corners(&self, [low, high]: [f64; 2]) -> Vec<[f64; 3]> {
        let within = self.skews.iter().copied().filter(|skew| (low..=high).contains(skew));
        let corner = |skew: f64| [skew, self.least(skew), self.most(skew)];
        within.chain([low, self.best().0, high]).map(corner).collect()
    }

    /// The least and the greatest height at `x` of a line that passes: that of a corner, as the greatest height is concave in the skew and straight between them, the least convex.
    fn reach(corners: &[[f64; 3]], x: f64) -> [f64; 2] {
        let least = corners.iter().map(|[skew, least, _]| least + skew * x).fold(f64::INFINITY, f64::min);
        let most = corners.iter().map(|[skew, _, most]| most + skew * x).fold(f64::NEG_INFINITY, f64::max);
        [least, most]
    }
}

/// The lower hull of points in the order of their x, or the upper one for `sign` -1 (Andrew's chain).
fn hull(points: impl Iterator<Item = (f64, f64)>, sign: f64) -> Vec<(f64, f64)> {
    let mut hull: Vec<(f64, f64)> = Vec::new();
    for (x, y) in points {
        while let [.., a, b] = hull[..] {
            if sign * ((b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (x - a.0)) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push((x, y));
    }
    hull
}

/// The offset of the line of a skew that touches a hull.
fn tangent(hull: &[(f64, f64)], skew: f64, sign: f64) -> f64 {
    // Along a lower hull the slopes rise: the line touches where they pass its own.
    let slopes_below = |pair: &(f64, f64), next: &(f64, f64)| sign * (next.1 - pair.1 - skew * (next.0 - pair.0)) < 0.0;
    let (mut low, mut high) = (0, hull.len() - 1);
    while low < high {
        let middle = low + (high - low) / 2;
        if slopes_below(&hull[middle], &hull[middle + 1]) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    hull[low].1 - skew * hull[low].0
}
