//! Cells joined to regions: at every step the two whose joint fit costs least.
//!
//! The cost of a join is the exact growth of the residual sum of squares, `g(a, b) = rss(a + b) - rss(a) - rss(b)`,
//! from the merged Gram matrix. (It is the statistic of Chow's test of equal coefficients; Ward's method joins clusters
//! by the growth of their inertia in the same way.) Of joins with the same cost the one of the nearest regions is made.
//! Few joins are priced: `rss` is superadditive, so that after a join of a and b
//! `g(a + b, c) >= max(g(a, c), g(b, c)) - g(a, b)`. Only a join whose bound is the least of all needs its price.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot_stats::Gram;

/// Growths below this share of the rows' total are rounding, and equal.
const ROUNDING: f64 = 1e-13;

/// A cell, or a region that cells were joined to.
#[derive(Clone)]
pub(crate) struct Cell {
    pub(crate) gram: Gram,
    /// Mean of the standardised partition columns.
    pub(crate) place: Vec<f64>,
    /// Cells that it has a border with.
    pub(crate) neighbours: BTreeSet<u32>,
}

/// Limits of the joins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Regions that are left in the end, at least one.
    pub(crate) least: usize,
    /// Regions of fewer rows have no separate map, and are joined before all others.
    pub(crate) rows: u64,
    /// When so many regions are left all are each other's neighbours: a map may hold in places that lie apart.
    pub(crate) apart: usize,
}

/// All joins, the first ones first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tree {
    cells: usize,
    /// Error of all cells, each with a separate map.
    start: f64,
    joins: Vec<Join>,
}

/// A join.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Join {
    /// The first cell of the region that stands for both, and of the one that is gone.
    pub(crate) kept: u32,
    pub(crate) gone: u32,
    /// Error of all regions afterwards.
    pub(crate) error: f64,
}

impl Tree {
    /// Joins cells; `error` is the residual sum of squares of a Gram matrix, in units of the targets' variances.
    pub(crate) fn grow(cells: Vec<Cell>, limits: Limits, error: impl Fn(&Gram) -> f64) -> Self {
        let count = cells.len();
        let mut growing = Growing::new(cells, limits, error);
        let start: f64 = growing.regions.values().map(|region| region.error).sum();
        let (mut total, mut joins) = (start, Vec::new());
        while growing.regions.len() > limits.least.max(1) {
            if growing.regions.len() == limits.apart {
                growing.connect();
            }
            let Some((kept, gone)) = growing.cheapest() else {
                growing.connect();
                continue;
            };
            total += growing.join(kept, gone);
            joins.push(Join { kept, gone, error: total });
        }
        Self { cells: count, start, joins }
    }

    /// The region of every cell when there are `count` of them, numbered by the first cell of each.
    pub(crate) fn regions(&self, count: usize) -> Vec<u32> {
        let mut parent: Vec<u32> = (0..self.cells as u32).collect();
        for join in self.joins[..self.made(count)].iter().rev() {
            parent[join.gone as usize] = parent[join.kept as usize];
        }
        let mut numbers = BTreeMap::new();
        let mut number = |root: u32| {
            let next = numbers.len() as u32;
            *numbers.entry(root).or_insert(next)
        };
        parent.into_iter().map(&mut number).collect()
    }

    /// Error of `count` regions.
    pub(crate) fn error(&self, count: usize) -> f64 {
        self.made(count).checked_sub(1).map_or(self.start, |last| self.joins[last].error)
    }

    /// The joins that follow when there are `count` regions.
    pub(crate) fn joins(&self, count: usize) -> &[Join] {
        &self.joins[self.made(count)..]
    }

    /// Joins behind a level.
    fn made(&self, count: usize) -> usize {
        self.cells.saturating_sub(count.max(1)).min(self.joins.len())
    }
}

/// A region while joins are sought.
struct Region {
    cell: Cell,
    error: f64,
}

/// Cost of a join, in the queue's order: starved regions before others, then growth of the error, bounds before prices,
/// then distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Price {
    fed: bool,
    /// Bits of a number that is not negative sort as the number.
    growth: u64,
    exact: bool,
    distance: u64,
    pair: (u32, u32),
}

struct Growing<E> {
    regions: BTreeMap<u32, Region>,
    /// Of every pair of neighbours, the smaller number first.
    prices: BTreeMap<(u32, u32), Price>,
    queue: BTreeSet<Price>,
    limits: Limits,
    error: E,
    noise: f64,
}

impl<E: Fn(&Gram) -> f64> Growing<E> {
    fn new(cells: Vec<Cell>, limits: Limits, error: E) -> Self {
        let noise = ROUNDING * cells.iter().map(|cell| cell.gram.weight).sum::<f64>();
        let of = |(at, cell): (usize, Cell)| (at as u32, Region { error: error(&cell.gram), cell });
        let regions: BTreeMap<u32, Region> = cells.into_iter().enumerate().map(of).collect();
        let mut growing = Self { regions, prices: BTreeMap::new(), queue: BTreeSet::new(), limits, error, noise };
        growing.bound_neighbours();
        growing
    }

    /// Puts every pair of neighbours into the queue that is not there.
    fn bound_neighbours(&mut self) {
        let of = |(&cell, region): (&u32, &Region)| {
            region.cell.neighbours.iter().filter(move |&&other| other > cell).map(move |&other| (cell, other)).collect()
        };
        let pairs: Vec<(u32, u32)> = self.regions.iter().flat_map(|entry| -> Vec<(u32, u32)> { of(entry) }).collect();
        for pair in pairs {
            if !self.prices.contains_key(&pair) {
                self.enqueue(pair, 0.0, None);
            }
        }
    }

    /// Puts a pair into the queue with a bound of its growth, or with its growth and the distance.
    fn enqueue(&mut self, pair: (u32, u32), growth: f64, distance: Option<f64>) {
        let rows = |region: u32| self.regions[&region].cell.gram.rows;
        let price = Price {
            fed: rows(pair.0).min(rows(pair.1)) >= self.limits.rows,
            growth: if growth > self.noise { growth } else { 0.0 }.to_bits(),
            exact: distance.is_some(),
            distance: distance.unwrap_or(0.0).to_bits(),
            pair,
        };
        self.prices.insert(pair, price);
        self.queue.insert(price);
    }

    /// Cost of joining a pair: growth of the error, then distance.
    fn price(&self, (a, b): (u32, u32)) -> (f64, f64) {
        let (a, b) = (&self.regions[&a], &self.regions[&b]);
        let mut gram = a.cell.gram.clone();
        gram.merge(&b.cell.gram);
        let distance = a.cell.place.iter().zip(&b.cell.place).map(|(a, b)| (a - b) * (a - b)).sum();
        ((self.error)(&gram) - a.error - b.error, distance)
    }

    fn cheapest(&mut self) -> Option<(u32, u32)> {
        loop {
            let least = *self.queue.first()?;
            if least.exact {
                return Some(least.pair);
            }
            self.queue.remove(&least);
            let (growth, distance) = self.price(least.pair);
            self.enqueue(least.pair, growth, Some(distance));
        }
    }

    /// Joins two regions; the growth of the error.
    fn join(&mut self, kept: u32, gone: u32) -> f64 {
        let growth = self.prices.get(&(kept, gone)).map_or(0.0, |price| f64::from_bits(price.growth));
        let mut bounds: BTreeMap<u32, f64> = BTreeMap::new();
        for region in [kept, gone] {
            let neighbours: Vec<u32> = self.regions[&region].cell.neighbours.iter().copied().collect();
            for other in neighbours {
                let pair = (region.min(other), region.max(other));
                let Some(price) = self.prices.remove(&pair) else { continue };
                self.queue.remove(&price);
                let bound = bounds.entry(other).or_insert(0.0);
                // Both are known up to rounding.
                *bound = bound.max(f64::from_bits(price.growth) - growth - 2.0 * self.noise);
            }
        }
        let (Some(a), Some(b)) = (self.regions.remove(&kept), self.regions.remove(&gone)) else { return 0.0 };
        let parts = a.error + b.error;
        let cell = united(a.cell, b.cell, (kept, gone));
        for other in &cell.neighbours {
            if let Some(region) = self.regions.get_mut(other) {
                region.cell.neighbours.remove(&gone);
                region.cell.neighbours.insert(kept);
            }
        }
        let error = (self.error)(&cell.gram);
        self.regions.insert(kept, Region { error, cell });
        for (other, bound) in bounds.into_iter().filter(|&(other, _)| other != kept && other != gone) {
            self.enqueue((kept.min(other), kept.max(other)), bound, None);
        }
        error - parts
    }

    /// Makes all regions each other's neighbours.
    fn connect(&mut self) {
        let all: BTreeSet<u32> = self.regions.keys().copied().collect();
        for (number, region) in &mut self.regions {
            region.cell.neighbours = all.iter().copied().filter(|other| other != number).collect();
        }
        self.bound_neighbours();
    }
}

/// Two cells as one, without the border between them.
fn united(a: Cell, b: Cell, (kept, gone): (u32, u32)) -> Cell {
    let mut gram = a.gram;
    gram.merge(&b.gram);
    let share = if gram.weight > 0.0 { b.gram.weight / gram.weight } else { 0.5 };
    let place = a.place.iter().zip(&b.place).map(|(a, b)| a + share * (b - a)).collect();
    let mut neighbours = a.neighbours;
    neighbours.extend(b.neighbours);
    neighbours.retain(|&other| other != kept && other != gone);
    Cell { gram, place, neighbours }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rows (x, y) as a Gram matrix.
    fn gram(rows: &[(f64, f64)]) -> Gram {
        let (x, y): (Vec<f64>, Vec<f64>) = rows.iter().copied().unzip();
        Gram::of_columns(&[&x, &y], None)
    }

    fn error(gram: &Gram) -> f64 {
        let (xx, xy, yy) = (gram.get(0, 0), gram.get(0, 1), gram.get(1, 1));
        if xx > 1e-12 { (yy - xy * xy / xx).max(0.0) } else { yy }
    }

    fn to(least: usize) -> Limits {
        Limits { least, rows: 0, apart: 0 }
    }

    /// Cells along a line, each a neighbour of the next.
    fn chain(cells: &[Vec<(f64, f64)>]) -> Vec<Cell> {
        let beside = |at: usize| [at.checked_sub(1), (at + 1 < cells.len()).then_some(at + 1)];
        cells
            .iter()
            .enumerate()
            .map(|(at, rows)| Cell {
                gram: gram(rows),
                place: vec![at as f64],
                neighbours: beside(at).into_iter().flatten().map(|at| at as u32).collect(),
            })
            .collect()
    }

    /// Cells of five rows each of a function, side by side.
    fn of_function(count: u32, f: impl Fn(f64) -> f64) -> Vec<Vec<(f64, f64)>> {
        let row = |cell: u32, i: u32| f64::from(cell) + f64::from(i) * 0.2;
        (0..count).map(|cell| (0..5).map(|i| (row(cell, i), f(row(cell, i)))).collect()).collect()
    }

    #[test]
    fn cells_of_one_line_are_joined_first() {
        // y = x up to 3, then 6 - x.
        let cells = of_function(6, |x| if x < 3.0 { x } else { 6.0 - x });
        let tree = Tree::grow(chain(&cells), to(1), error);
        assert_eq!(tree.regions(2), [0, 0, 0, 1, 1, 1]);
        assert_eq!(tree.regions(1), [0; 6]);
        assert_eq!(tree.regions(6), [0, 1, 2, 3, 4, 5]);
        assert_eq!(tree.regions(100).len(), 6);
        assert!(tree.error(2) < 1e-9 && tree.joins(2).len() == 1);
    }

    #[test]
    fn one_map_may_hold_in_distant_places() {
        // Between two pieces of the line y = x lies another line.
        let cells = of_function(9, |x| if (3.0..6.0).contains(&x) { -x } else { x });
        let neighbours = Tree::grow(chain(&cells), to(1), error);
        assert!(neighbours.error(2) > 1.0);
        let apart = Tree::grow(chain(&cells), Limits { apart: 4, ..to(1) }, error);
        assert_eq!(apart.regions(2), [0, 0, 0, 1, 1, 1, 0, 0, 0]);
        assert!(apart.error(2) < 1e-9);
    }

    #[test]
    fn starved_cells_are_joined_before_all_others() {
        // The last cell's only row is far off every line.
        let mut cells = of_function(5, |x| if x < 3.0 { x } else { 6.0 - x });
        cells.push(vec![(5.5, 40.0)]);
        let tree = Tree::grow(chain(&cells), Limits { rows: 2, ..to(1) }, error);
        assert_eq!(tree.regions(5), [0, 1, 2, 3, 4, 4]);
    }

    #[test]
    fn cells_without_neighbours_are_joined_in_the_end() {
        let mut cells =
            chain(&[vec![(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)], vec![(5.0, 5.0), (6.0, 6.5)], vec![(9.0, 0.0)]]);
        cells.iter_mut().for_each(|cell| cell.neighbours.clear());
        assert_eq!(Tree::grow(cells, to(1), error).regions(1), [0; 3]);
    }

    /// The tree by pricing every pair of neighbours at every step.
    fn brute_force(cells: Vec<Cell>) -> Vec<(u32, u32)> {
        let mut left: Vec<(u32, Cell)> = cells.into_iter().enumerate().map(|(at, cell)| (at as u32, cell)).collect();
        let mut joins = Vec::new();
        while left.len() > 1 {
            let mut best: Option<(f64, usize, usize)> = None;
            for (i, (_, a)) in left.iter().enumerate() {
                for (j, (other, b)) in left.iter().enumerate().skip(i + 1) {
                    let mut both = a.gram.clone();
                    both.merge(&b.gram);
                    let growth = error(&both) - error(&a.gram) - error(&b.gram);
                    if a.neighbours.contains(other) && best.is_none_or(|(least, ..)| growth < least) {
                        best = Some((growth, i, j));
                    }
                }
            }
            let Some((_, i, j)) = best else { break };
            let (gone, b) = left.remove(j);
            let kept = left[i].0;
            joins.push((kept, gone));
            left[i].1 = united(left[i].1.clone(), b, (kept, gone));
            for (_, cell) in &mut left {
                if cell.neighbours.remove(&gone) {
                    cell.neighbours.insert(kept);
                }
            }
        }
        joins
    }

    proptest! {
        #[test]
        fn the_cheapest_join_is_made_though_few_are_priced(
            values in prop::collection::vec(prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..6), 2..14),
            borders in prop::collection::vec((0usize..14, 0usize..14), 0..20),
        ) {
            let mut cells = chain(&values);
            for (a, b) in borders {
                if a != b && a < cells.len() && b < cells.len() {
                    cells[a].neighbours.insert(b as u32);
                    cells[b].neighbours.insert(a as u32);
                }
            }
            let tree = Tree::grow(cells.clone(), to(1), error);
            let joins: Vec<(u32, u32)> = tree.joins.iter().map(|join| (join.kept, join.gone)).collect();
            prop_assert_eq!(joins, brute_force(cells));
        }

        #[test]
        fn joins_remove_one_region_each(
            values in prop::collection::vec(prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..6), 2..12)
        ) {
            let tree = Tree::grow(chain(&values), to(1), error);
            for count in 1..values.len() {
                let (coarse, fine) = (tree.regions(count), tree.regions(count + 1));
                let distinct: BTreeSet<u32> = coarse.iter().copied().collect();
                prop_assert_eq!(distinct.len(), count);
                // Cells that were together stay together.
                for (i, j) in (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
                    prop_assert!(fine[i] != fine[j] || coarse[i] == coarse[j]);
                }
                prop_assert!(tree.error(count) >= tree.error(count + 1) - 1e-12);
            }
            // The error of a level is that of its regions' rows, each fitted by itself.
            for count in 1..=values.len() {
                let regions = tree.regions(count);
                let of = |region: usize| {
                    let members = values.iter().zip(&regions).filter(|&(_, &r)| r as usize == region);
                    error(&gram(&members.flat_map(|(rows, _)| rows).copied().collect::<Vec<_>>()))
                };
                let direct: f64 = (0..count).map(of).sum();
                prop_assert!((tree.error(count) - direct).abs() < 1e-9, "{count}: {} {direct}", tree.error(count));
            }
        }
    }
}
