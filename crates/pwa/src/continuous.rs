//! Maps that meet at the borders of their regions: `--continuous`.
//!
//! Let a border of the regions i and j lie on the plane `w . z + d = 0` of the partition columns, which are among the regressors x. Their maps agree there exactly where
//!
//! `A_i x + b_i - (A_j x + b_j) = c (w . z + d)`
//!
//! The free numbers form a null space of these equations, the same for all targets. Along a tree of borders all maps
//! follow from that of one region and from the c, and c = Z g. So the maps of all regions are one affine map and
//! hinges: features of the rows that are affine in x within each region. Least squares over them are unconstrained and
//! exact, on reflectors, from the square-root forms of the regions ([`SquareRoot::pooled`]). The jump that remains is
//! rounding, and it is reported.
//!
//! Rows tell which regions have a border (`borders`); a border where no row lies is ignored.

mod borders;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use faer::{Mat, MatRef};
use fleetfoot_stats::{Features, SquareRoot, householder::fold_rows, kernel::Slab, least_squares, svd};

use crate::region_model::{Base, RegionModel, column_scale};
pub(crate) use borders::{Border, borders, check};

/// Singular values of the equations below this share of the largest are zero: borders at smaller angles are parallel.
const PARALLEL: f64 = 1e-10;

/// Free numbers of maps that meet at their borders.
#[derive(Debug, Clone)]
pub(crate) struct Ties {
    regions: usize,
    borders: Vec<Border>,
    /// The regressor that each partition column is.
    places: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    /// Regions that borders connect.
    parts: Vec<Part>,
}

/// Regions whose maps are one affine map and hinges.
#[derive(Debug, Clone)]
struct Part {
    regions: Vec<u32>,
    /// For each region its hinges over (z, 1): hinges x (d + 1).
    hinges: Vec<Mat<f64>>,
}

/// Maps of all regions.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) models: Vec<RegionModel>,
    /// Numbers that were free, of each target.
    pub(crate) numbers: usize,
}

/// Cost of continuity: the loss with maps that meet at the borders of neighbouring regions, beside the loss without.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Continuity {
    /// Borders between rows.
    pub borders: usize,
    /// Numbers that are free, of each target.
    pub numbers: usize,
    /// The loss of as many maps that need not meet; NaN without folds.
    pub apart: f64,
    /// The largest difference of two maps at a border, in standard deviations of the target: rounding.
    pub jump: f64,
}

impl Ties {
    /// Of the borders of so many regions, over partition columns `(x_place - centre) / scale`.
    pub(crate) fn new(
        regions: usize,
        borders: Vec<Border>,
        places: &[usize],
        (centre, scale): (&[f64], &[f64]),
    ) -> Self {
        let parts = walk(regions, &borders).iter().map(|tree| Part::new(tree, &borders, centre.len())).collect();
        let (places, centre, scale) = (places.to_vec(), centre.to_vec(), scale.to_vec());
        Self { regions, borders, places, centre, scale, parts }
    }

    /// Number of borders.
    pub(crate) fn borders(&self) -> usize {
        self.borders.len()
    }

    /// The maps of least error that meet at all borders, from the training rows of the regions; `shrinkage` as for maps that are not tied.
    pub(crate) fn fit(&self, base: &Base, training: &BTreeMap<u32, SquareRoot>, shrinkage: f64) -> Fitted {
        // Directions that the rows of a region determine do not depend on its neighbours.
        let region_model = |region: u32| match training.get(&region) {
            Some(root) => RegionModel::new(least_squares(root, &base.scale)),
            None => base.average.clone(),
        };
        let mut models: Vec<RegionModel> = (0..self.regions as u32).map(region_model).collect();
        let penalty: Vec<f64> = base.scale.iter().map(|scale| shrinkage.sqrt() * scale).collect();
        let mut numbers = 0;
        for part in &self.parts {
            let shrunk: Vec<SquareRoot> = part
                .regions
                .iter()
                .filter_map(|region| training.get(region))
                .map(|root| match shrinkage > 0.0 {
                    true => root.towards(&penalty, base.average.coefficients.as_ref()),
                    false => root.clone(),
                })
                .collect();
            let seen = (0..part.regions.len()).filter(|&at| training.contains_key(&part.regions[at]));
            let rows: Vec<(&SquareRoot, Features)> =
                shrunk.iter().zip(seen).map(|(root, at)| (root, self.features(part, at, base))).collect();
            let Some(pooled) = SquareRoot::pooled(&rows) else { continue };
            let least_squares = least_squares(&pooled, &column_scale(&pooled));
            numbers += least_squares.rank + 1;
            for (at, &region) in part.regions.iter().enumerate() {
                let model = &mut models[region as usize];
                let features = self.features(part, at, base);
                model.coefficients = features.linear.transpose() * &least_squares.coefficients;
                for (t, intercept) in model.intercept.iter_mut().enumerate() {
                    let constants = features.constant.iter().enumerate();
                    *intercept = constants
                        .fold(least_squares.intercept[t], |sum, (j, l)| sum + l * least_squares.coefficients[(j, t)]);
                }
            }
        }
        Fitted { models, numbers }
    }

    /// The regressors, and behind them the hinges, of a region.
    fn features(&self, part: &Part, at: usize, base: &Base) -> Features {
        let (p, hinges) = (base.scale.len(), &part.hinges[at]);
        let (g, d) = (hinges.nrows(), self.places.len());
        let mut linear = Mat::zeros(p + g, p);
        let mut constant = vec![0.0; p + g];
        (0..p).for_each(|j| linear[(j, j)] = 1.0);
        for k in 0..g {
            constant[p + k] = hinges[(k, d)];
            for (column, &place) in self.places.iter().enumerate() {
                let slope = hinges[(k, column)] / self.scale[column];
                linear[(p + k, place)] += slope;
                constant[p + k] -= slope * self.centre[column];
            }
        }
        Features { linear, constant }
    }

    /// The largest difference of two maps on their border, for regressors one standard deviation off their means: in standard deviations of the targets.
    pub(crate) fn jump(&self, models: &[RegionModel], base: &Base) -> f64 {
        let (p, q, d) = (base.scale.len(), base.root.targets(), self.places.len());
        let mut largest: f64 = 0.0;
        for border in &self.borders {
            let [i, j] = border.pair.map(|region| &models[region as usize]);
            for t in 0..q {
                let deviation = (base.root.total[t] / base.root.weight).sqrt();
                let slope = |x: usize| i.coefficients[(x, t)] - j.coefficients[(x, t)];
                // Over (z, 1), and the regressors that regions do not look at.
                let mut difference: Vec<f64> =
                    self.places.iter().zip(&self.scale).map(|(&place, scale)| slope(place) * scale).collect();
                let means = self.places.iter().zip(&self.centre).map(|(&place, centre)| slope(place) * centre);
                difference.push(means.fold(i.intercept[t] - j.intercept[t], |sum, mean| sum + mean));
                let along: f64 = difference.iter().zip(&border.normal).map(|(a, b)| a * b).sum();
                let left = (0..=d).map(|column| difference[column] - along * border.normal[column]);
                let others = (0..p).filter(|x| !self.places.contains(x)).map(|x| slope(x) * base.scale[x]);
                largest = left.chain(others).fold(largest, |largest, left| largest.max(left.abs() / deviation));
            }
        }
        largest
    }
}

/// A tree of borders through connected regions, and the borders that it leaves out.
struct Walk {
    /// In the order in which they are reached, with the border and the region before; the first has neither.
    regions: Vec<(u32, Option<(usize, u32)>)>,
    /// Borders that close a walk.
    closing: Vec<usize>,
}

/// Trees of borders through all regions, breadth first, so that closed walks are short.
fn walk(regions: usize, borders: &[Border]) -> Vec<Walk> {
    let mut beside: Vec<Vec<(u32, usize)>> = vec![Vec::new(); regions];
    for (at, Border { pair: [i, j], .. }) in borders.iter().enumerate() {
        beside[*i as usize].push((*j, at));
        beside[*j as usize].push((*i, at));
    }
    let mut reached = vec![false; regions];
    let mut walks = Vec::new();
    for first in 0..regions as u32 {
        if std::mem::replace(&mut reached[first as usize], true) {
            continue;
        }
        let mut walk = Walk { regions: vec![(first, None)], closing: Vec::new() };
        let (mut queue, mut used) = (VecDeque::from([first]), BTreeSet::new());
        while let Some(region) = queue.pop_front() {
            for &(other, border) in &beside[region as usize] {
                if used.insert(border) {
                    if std::mem::replace(&mut reached[other as usize], true) {
                        walk.closing.push(border);
                    } else {
                        walk.regions.push((other, Some((border, region))));
                        queue.push_back(other);
                    }
                }
            }
        }
        walks.push(walk);
    }
    walks
}

impl Part {
    fn new(walk: &Walk, borders: &[Border], d: usize) -> Self {
        let used = walk.regions.iter().filter_map(|(_, before)| before.map(|(border, _)| border));
        let edges: Vec<usize> = used.chain(walk.closing.iter().copied()).collect();
        let number: BTreeMap<usize, usize> = edges.iter().enumerate().map(|(at, &border)| (border, at)).collect();
        // A region's map less that of the first: (d + 1) x edges, in the c of the edges.
        let mut paths: BTreeMap<u32, Mat<f64>> = BTreeMap::new();
        for &(region, before) in &walk.regions {
            let path = match before.map(|(border, before)| (border, paths.get(&before).cloned())) {
                Some((border, Some(mut path))) => {
                    add(&mut path, number[&border], &borders[border], region);
                    path
                }
                _ => Mat::zeros(d + 1, edges.len()),
            };
            paths.insert(region, path);
        }
        // Around a closed walk the differences sum to zero.
        let mut equations = Slab::zeros(walk.closing.len() * (d + 1), edges.len());
        for (at, &border) in walk.closing.iter().enumerate() {
            let [i, j] = borders[border].pair;
            let mut round = &paths[&i] - &paths[&j];
            // From j to i the map changes by c (w . z + d).
            for row in 0..=d {
                round[(row, number[&border])] -= borders[border].normal[row];
            }
            for edge in 0..edges.len() {
                for row in 0..=d {
                    equations.column_mut(edge)[at * (d + 1) + row] = round[(row, edge)];
                }
            }
        }
        let free = null_space(&mut equations);
        let hinges = |region: &u32| {
            Mat::from_fn(free.ncols(), d + 1, |k, row| {
                (0..edges.len()).map(|edge| paths[region][(row, edge)] * free[(edge, k)]).sum()
            })
        };
        let regions: Vec<u32> = walk.regions.iter().map(|(region, _)| *region).collect();
        let hinges = regions.iter().map(hinges).collect();
        Self { regions, hinges }
    }
}

/// Goes over a border into a region. The map changes by c times the function that vanishes on the border, which is
/// positive on the side of the first of its pair.
fn add(path: &mut Mat<f64>, edge: usize, border: &Border, into: u32) {
    let sign = if border.pair[0] == into { 1.0 } else { -1.0 };
    for (row, normal) in border.normal.iter().enumerate() {
        path[(row, edge)] += sign * normal;
    }
}

/// Basis (columns) of the null space of some equations (m x n).
fn null_space(equations: &mut Slab) -> Mat<f64> {
    let n = equations.columns();
    if equations.rows() == 0 {
        return Mat::identity(n, n);
    }
    let mut triangle = Mat::zeros(n, n);
    fold_rows(&mut triangle, equations);
    let free = |triangle: MatRef<'_, f64>| {
        let svd = svd(triangle)?;
        let largest = svd.s.first().copied().unwrap_or(0.0);
        let first = svd.s.iter().position(|&s| s <= PARALLEL * largest).unwrap_or(n);
        Some(Mat::from_fn(n, n - first, |i, j| svd.v[(i, first + j)]))
    };
    // Numbers that are no numbers leave nothing free.
    free(triangle.as_ref()).unwrap_or_else(|| Mat::zeros(n, 0))
}
