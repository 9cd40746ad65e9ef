//! Pairs of regions that have a border, and the plane of each border.

use std::collections::BTreeSet;

use fleetfoot_model::{Rule, Tree};

use crate::{Error, Problem, Specification, Within};

/// Rows that determine borders, at most.
const ROWS: usize = 1 << 16;

/// A border of two regions: `normal . (z, 1) = 0`, positive on the side of the first, of unit length.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Border {
    pub(crate) pair: [u32; 2],
    pub(crate) normal: Vec<f64>,
}

/// Refuses partitions whose maps cannot meet at their borders; which regressor each partition column is.
pub(crate) fn check(problem: &Problem, partitions: &[Specification]) -> Result<Vec<usize>, Error> {
    let linear = |one: &&Specification| match one {
        Specification::Null | Specification::Average | Specification::KMeans(_) => true,
        Specification::Refined(_) | Specification::Tree(_) => true,
        Specification::Labels {
            within: Within::Whole | Within::KMeans(_) | Within::Refined(_) | Within::Tree(_),
            ..
        }
        | Specification::ZScore(_)
        | Specification::ZBox(_)
        | Specification::Lattice(_) => false,
    };
    if let Some(other) = partitions.iter().find(|one| !linear(one)) {
        return Err(Error::NotLinear { specification: other.to_string() });
    }
    let place = |column: &fleetfoot_library::Expr| {
        let index = problem.library.iter().position(|function| function == column);
        index.ok_or_else(|| Error::NoRegressor { column: column.to_string() })
    };
    problem.partition_columns.iter().map(place).collect()
}

/// The borders of a rule between some rows, given by their raw partition columns. `units`: the centre and scale of z,
/// those of the rule if it has linear separators. Rules of one region have none.
pub(crate) fn borders(rule: &Rule, columns: &[Vec<f64>], (centre, scale): (&[f64], &[f64])) -> Vec<Border> {
    let mut borders = match rule {
        Rule::Linear { weights, offsets } => separated(weights, offsets, columns, (centre, scale)),
        Rule::Tree(tree) => cut(tree, columns, (centre, scale)),
        Rule::Whole | Rule::Ball { .. } | Rule::Box { .. } | Rule::Joined { .. } | Rule::Labels { .. } => Vec::new(),
    };
    for border in &mut borders {
        let length = border.normal.iter().map(|v| v * v).sum::<f64>().sqrt();
        border.normal.iter_mut().for_each(|v| *v /= length);
    }
    // A plane that is nowhere is no border.
    borders.retain(|border| border.normal.iter().all(|v| v.is_finite()));
    borders
}

/// Two regions that are the first and the second choice of a row have a border between that row and those of the second
/// region. On the way there the second stays before all others, for scores are affine (Martinetz and Schulten,
/// "Topology representing networks", 1994, for the nearest of centroids).
fn separated(
    weights: &[Vec<f64>],
    offsets: &[f64],
    columns: &[Vec<f64>],
    (centre, scale): (&[f64], &[f64]),
) -> Vec<Border> {
    let rows = columns.first().map_or(0, Vec::len);
    let mut pairs: BTreeSet<[u32; 2]> = BTreeSet::new();
    let mut seen: BTreeSet<u32> = BTreeSet::new();
    let mut z = vec![0.0; columns.len()];
    for row in (0..rows).step_by(rows.div_ceil(ROWS).max(1)) {
        for (z, (column, (centre, scale))) in z.iter_mut().zip(columns.iter().zip(centre.iter().zip(scale))) {
            *z = (column[row] - centre) / scale;
        }
        let mut best = [(f64::NEG_INFINITY, 0); 2];
        for (region, (weights, offset)) in weights.iter().zip(offsets).enumerate() {
            let score = weights.iter().zip(&z).fold(*offset, |sum, (w, z)| sum + w * z);
            if score > best[0].0 {
                best = [(score, region as u32), best[0]];
            } else if score > best[1].0 {
                best[1] = (score, region as u32);
            }
        }
        seen.insert(best[0].1);
        if best[1].0 > f64::NEG_INFINITY {
            pairs.insert([best[0].1.min(best[1].1), best[0].1.max(best[1].1)]);
        }
    }
    // Regions that are no row's first choice have no border that rows tell.
    pairs.retain(|pair| pair.iter().all(|region| seen.contains(region)));
    let border = |[i, j]: [u32; 2]| {
        let (a, b) = (i as usize, j as usize);
        let mut normal: Vec<f64> = weights[a].iter().zip(&weights[b]).map(|(a, b)| a - b).collect();
        normal.push(offsets[a] - offsets[b]);
        Border { pair: [i, j], normal }
    };
    pairs.into_iter().map(border).collect()
}

/// Boxes that touch along a cut, within the box of all rows.
fn cut(tree: &Tree, columns: &[Vec<f64>], (centre, scale): (&[f64], &[f64])) -> Vec<Border> {
    let range = |column: &Vec<f64>| {
        column.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &v| [low.min(v), high.max(v)])
    };
    let whole: Vec<[f64; 2]> = columns.iter().map(range).collect();
    let boxes: Vec<Vec<[f64; 2]>> = tree
        .boxes()
        .into_iter()
        .map(|sides| {
            let mut part = whole.clone();
            for (column, [low, high]) in sides {
                part[column] = [part[column][0].max(low), part[column][1].min(high)];
            }
            part
        })
        .collect();
    let overlap = |a: &[f64; 2], b: &[f64; 2]| a[0].max(b[0]) < a[1].min(b[1]) || (a == b && a[0] == a[1]);
    let mut borders = Vec::new();
    for (i, a) in boxes.iter().enumerate() {
        for (j, b) in boxes.iter().enumerate().skip(i + 1) {
            // Along one column they touch, in all others they overlap.
            let touching = (0..columns.len()).find(|&column| {
                let others = (0..columns.len()).filter(|&other| other != column);
                (a[column][1] == b[column][0] || b[column][1] == a[column][0])
                    && others.clone().all(|other| overlap(&a[other], &b[other]))
            });
            if let Some(column) = touching {
                let (threshold, sign) =
                    if a[column][1] == b[column][0] { (a[column][1], -1.0) } else { (b[column][1], 1.0) };
                let mut normal = vec![0.0; columns.len() + 1];
                normal[column] = sign * scale[column];
                normal[columns.len()] = sign * (centre[column] - threshold);
                borders.push(Border { pair: [i as u32, j as u32], normal });
            }
        }
    }
    borders
}
