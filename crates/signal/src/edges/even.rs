//! Edges of a wave that a timer switches bound one another.
//!
//! By a clock that runs evenly, edge k of a kind comes at `a + b k`. Every edge bounds that line by the stamps before and after it, and the lines that pass between all of them tell within which
//! part of its own bracket each edge was. Rising and falling edges are each a kind, since nobody says how long the wave is high.

use super::{Edge, Program};
use crate::clock::counted;

/// Edges of a kind from which a line of two numbers is bounded by more than itself.
const FEWEST: usize = 3;

/// The pairs, each edge between bounds that no edge of its kind contradicts; `None` where no even wave passes between the stamps, though these be wrong by `margin`.
pub(super) fn narrowed(pairs: &[(Edge, Edge)], margin: f64) -> Option<Vec<(Edge, Edge)>> {
    let (mut first, mut second): (Vec<Edge>, Vec<Edge>) = pairs.iter().copied().unzip();
    for edges in [&mut first, &mut second] {
        for rises in [false, true] {
            let kind: Vec<usize> = (0..edges.len()).filter(|&at| edges[at].rises == rises).collect();
            let edges_of_kind: Vec<Edge> = kind.iter().map(|&at| edges[at]).collect();
            for (at, edge) in kind.into_iter().zip(evened(&edges_of_kind, margin)?) {
                edges[at] = edge;
            }
        }
    }
    Some(first.into_iter().zip(second).collect())
}

/// The edges of a kind, between bounds that all others allow.
fn evened(edges: &[Edge], margin: f64) -> Option<Vec<Edge>> {
    if edges.len() < FEWEST {
        return Some(edges.to_vec());
    }
    let middles: Vec<f64> = edges.iter().map(Edge::middle).collect();
    let (counts, period) = counted(&middles);
    let center = 0.5 * (counts[0] + counts[counts.len() - 1]) as f64;
    let places: Vec<f64> = counts.iter().map(|&count| count as f64 - center).collect();
    let start = middles[0] - period * places[0];
    // Of the line near all middles: so that differences of microseconds keep their digits.
    let about = |place: f64| start + period * place;
    let upper = edges.iter().zip(&places).map(|(edge, &place)| (place, edge.before + margin - about(place)));
    let lower = edges.iter().zip(&places).map(|(edge, &place)| (place, edge.after - margin - about(place)));
    let program = Program::between(upper, lower, period);
    if program.best().1 < 0.0 {
        return None;
    }
    let corners = program.corners(program.ends());
    let bounded = edges.iter().zip(&places).map(|(edge, &place)| {
        let [least, most] = Program::reach(&corners, place).map(|off| about(place) + off);
        // Rounded corners add nothing beyond the bracket.
        let (after, before) = (least.max(edge.after - margin), most.min(edge.before + margin));
        Edge { after: after.min(before), before, ..*edge }
    });
    Some(bounded.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brackets of edges a + b k: k goes on by one or two, and the wave's own clock knows nothing of those who look.
    fn brackets(rows: u64) -> Vec<Edge> {
        let share = |k: u64, with: f64| (k as f64 * with).rem_euclid(1.0);
        let edge = |k: u64| {
            let (count, moment) = (k + k / 7, 3.0 + 0.71 * (k + k / 7) as f64);
            assert!(count >= k);
            Edge { rises: true, after: moment - 0.02 * share(k, 0.618_034), before: moment + 0.02 * share(k, 0.414_21) }
        };
        (1..=rows).map(edge).collect()
    }

    /// The bounds are the heights of the feasible polygon's corners, which are found by brute force: all crossings of two constraints that violate no other.
    #[test]
    fn bounds_match_all_corners() {
        let edges = brackets(40);
        let places: Vec<f64> = (1..=40_u64).map(|k| (k + k / 7) as f64).collect();
        let limits: Vec<(f64, f64)> =
            edges.iter().zip(&places).flat_map(|(edge, &x)| [(x, edge.after), (x, edge.before)]).collect();
        let holds = |a: f64, b: f64| {
            let inside =
                |(edge, &x): (&Edge, &f64)| edge.after - 1e-11 <= a + b * x && a + b * x <= edge.before + 1e-11;
            edges.iter().zip(&places).all(inside)
        };
        let mut corners = Vec::new();
        for (i, (x, u)) in limits.iter().enumerate() {
            for (y, v) in &limits[..i] {
                let b = (u - v) / (x - y);
                let a = u - b * x;
                if x != y && holds(a, b) {
                    corners.push((a, b));
                }
            }
        }
        assert!(corners.len() >= 3, "{corners:?}");
        let bounds = evened(&edges, 0.0).unwrap();
        let mut width = 0.0;
        for ((edge, bound), &x) in edges.iter().zip(&bounds).zip(&places) {
            let least = corners.iter().map(|(a, b)| a + b * x).fold(f64::INFINITY, f64::min);
            let most = corners.iter().map(|(a, b)| a + b * x).fold(f64::NEG_INFINITY, f64::max);
            assert!(
                (bound.after - least).abs() < 1e-10 && (bound.before - most).abs() < 1e-10,
                "{bound:?} {least} {most}"
            );
            assert!(edge.after - 1e-10 <= bound.after && bound.before <= edge.before + 1e-10);
            width += (bound.before - bound.after) / (edge.before - edge.after) / 40.0;
        }
        assert!(width < 0.5, "of what two stamps alone say {width} stays");
    }

    /// An edge that is later than its stamps may be wrong contradicts all lines; a margin as large as it is late does not.
    #[test]
    fn uneven_edges_are_reported() {
        let mut edges = brackets(40);
        edges[20].after += 0.05;
        edges[20].before += 0.05;
        assert_eq!(evened(&edges, 0.0), None);
        assert!(evened(&edges, 0.05).is_some());
    }
}
