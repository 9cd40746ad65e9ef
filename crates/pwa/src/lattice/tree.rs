//! Cells joined to regions: at every step the two neighbours whose joint fit costs least.
//!
//! The cost of a join is the exact growth of the residual sum of squares, `rss(a + b) - rss(a) - rss(b)`, from the merged Gram matrix (the statistic of Chow's
//! test of equal coefficients; as Ward's method joins clusters by the growth of their inertia). Of joins that cost the same the one of the nearest regions is made.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot_stats::Gram;

/// Growths below this share of the rows' total are rounding, and equal.
const ROUNDING: f64 = 1e-13;

/// A cell, or what cells were joined to.
#[derive(Clone)]
pub(crate) struct Cell {
    pub(crate) gram: Gram,
    /// Mean of the standardised partition columns.
    pub(crate) place: Vec<f64>,
    /// Cells that it has a border with.
    pub(crate) neighbours: BTreeSet<u32>,
}

/// All joins, the first ones first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tree {
    cells: usize,
    /// The cell that stands for both, and the one that is gone.
    joins: Vec<(u32, u32)>,
}

/// A region while joins are sought.
struct Region {
    cell: Cell,
    error: f64,
}

/// What a join costs: growth of the error, then distance.
type Price = (f64, f64);

impl Tree {
    /// Joins cells until `least` regions are left; `error` is the residual sum of squares of a Gram matrix, in units of the targets' variances.
    pub(crate) fn grow(cells: Vec<Cell>, least: usize, error: impl Fn(&Gram) -> f64) -> Self {
        let count = cells.len();
        let noise = ROUNDING * cells.iter().map(|cell| cell.gram.weight).sum::<f64>();
        let of = |(at, cell): (usize, Cell)| (at as u32, Region { error: error(&cell.gram), cell });
        let mut growing =
            Growing { regions: cells.into_iter().enumerate().map(of).collect(), prices: BTreeMap::new(), error, noise };
        for region in growing.regions.keys().copied().collect::<Vec<_>>() {
            growing.price(region, |other| other > region);
        }
        let mut joins = Vec::new();
        while growing.regions.len() > least.max(1) {
            let Some(join) = growing.cheapest() else {
                growing.connect();
                continue;
            };
            growing.join(join);
            joins.push(join);
        }
        Self { cells: count, joins }
    }

    /// The region of every cell when there are `count` of them, numbered by the first cell of each.
    pub(crate) fn regions(&self, count: usize) -> Vec<u32> {
        let mut parent: Vec<u32> = (0..self.cells as u32).collect();
        let made = self.cells.saturating_sub(count.max(1)).min(self.joins.len());
        for &(kept, gone) in self.joins[..made].iter().rev() {
            parent[gone as usize] = parent[kept as usize];
        }
        let mut numbers = BTreeMap::new();
        let mut number = |root: u32| {
            let next = numbers.len() as u32;
            *numbers.entry(root).or_insert(next)
        };
        parent.into_iter().map(&mut number).collect()
    }
}

struct Growing<E> {
    regions: BTreeMap<u32, Region>,
    /// Of every pair of neighbours, the smaller number first.
    prices: BTreeMap<(u32, u32), Price>,
    error: E,
    noise: f64,
}

impl<E: Fn(&Gram) -> f64> Growing<E> {
    /// Prices the joins of a region with those of its neighbours that are wanted.
    fn price(&mut self, region: u32, wanted: impl Fn(u32) -> bool) {
        let own = &self.regions[&region];
        for &other in own.cell.neighbours.iter().filter(|&&other| wanted(other)) {
            let (a, b) = (own, &self.regions[&other]);
            let mut gram = a.cell.gram.clone();
            gram.merge(&b.cell.gram);
            let growth = (self.error)(&gram) - a.error - b.error;
            let growth = if growth > self.noise { growth } else { 0.0 };
            let distance = a.cell.place.iter().zip(&b.cell.place).map(|(a, b)| (a - b) * (a - b)).sum();
            self.prices.insert((region.min(other), region.max(other)), (growth, distance));
        }
    }

    fn cheapest(&self) -> Option<(u32, u32)> {
        let by_price = |a: &Price, b: &Price| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
        self.prices.iter().min_by(|(_, a), (_, b)| by_price(a, b)).map(|(&pair, _)| pair)
    }

    fn join(&mut self, (kept, gone): (u32, u32)) {
        self.prices.retain(|&(a, b), _| ![a, b].contains(&kept) && ![a, b].contains(&gone));
        let (Some(a), Some(b)) = (self.regions.remove(&kept), self.regions.remove(&gone)) else { return };
        let mut gram = a.cell.gram;
        gram.merge(&b.cell.gram);
        let share = if gram.weight > 0.0 { b.cell.gram.weight / gram.weight } else { 0.5 };
        let place = a.cell.place.iter().zip(&b.cell.place).map(|(a, b)| a + share * (b - a)).collect();
        let mut neighbours = a.cell.neighbours;
        neighbours.extend(b.cell.neighbours);
        neighbours.retain(|&other| other != kept && other != gone);
        for other in &neighbours {
            if let Some(region) = self.regions.get_mut(other) {
                region.cell.neighbours.remove(&gone);
                region.cell.neighbours.insert(kept);
            }
        }
        self.regions.insert(kept, Region { error: (self.error)(&gram), cell: Cell { gram, place, neighbours } });
        self.price(kept, |_| true);
    }

    /// Where no neighbours are left, all regions are each other's.
    fn connect(&mut self) {
        let all: BTreeSet<u32> = self.regions.keys().copied().collect();
        for (own, region) in &mut self.regions {
            region.cell.neighbours = all.iter().copied().filter(|other| other != own).collect();
        }
        for region in all {
            self.price(region, |other| other > region);
        }
    }
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

    #[test]
    fn cells_of_one_line_are_joined_first() {
        // y = x up to 3, then 6 - x.
        let line = |x: f64| if x < 3.0 { x } else { 6.0 - x };
        let cells: Vec<Vec<(f64, f64)>> = (0..6)
            .map(|cell| (0..5).map(|i| f64::from(cell) + f64::from(i) * 0.2).map(|x| (x, line(x))).collect())
            .collect();
        let tree = Tree::grow(chain(&cells), 1, error);
        assert_eq!(tree.regions(2), [0, 0, 0, 1, 1, 1]);
        assert_eq!(tree.regions(1), [0; 6]);
        assert_eq!(tree.regions(6), [0, 1, 2, 3, 4, 5]);
        assert_eq!(tree.regions(100).len(), 6);
    }

    #[test]
    fn cells_without_neighbours_are_joined_in_the_end() {
        let mut cells =
            chain(&[vec![(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)], vec![(5.0, 5.0), (6.0, 6.5)], vec![(9.0, 0.0)]]);
        cells.iter_mut().for_each(|cell| cell.neighbours.clear());
        assert_eq!(Tree::grow(cells, 1, error).regions(1), [0; 3]);
    }

    proptest! {
        #[test]
        fn every_join_makes_one_region_less_of_the_regions_before(
            values in prop::collection::vec(prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..6), 2..12)
        ) {
            let tree = Tree::grow(chain(&values), 1, error);
            for count in 1..values.len() {
                let (coarse, fine) = (tree.regions(count), tree.regions(count + 1));
                let distinct: BTreeSet<u32> = coarse.iter().copied().collect();
                prop_assert_eq!(distinct.len(), count);
                // Cells that were together stay together.
                for (i, j) in (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
                    prop_assert!(fine[i] != fine[j] || coarse[i] == coarse[j]);
                }
            }
        }
    }
}
