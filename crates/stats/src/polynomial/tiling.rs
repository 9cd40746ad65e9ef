//! Products that make the moments, cut into register tiles.
//!
//! The variables are split into two groups. A Chebyshev product over all of them is a function of the first group times
//! a function of the second. The sums over rows of all products up to a total degree are therefore a part of the matrix
//! (functions of group one)' x (functions of group two). It has the shape of a staircase. Functions of one degree are
//! neighbours in graded order, so that this staircase is a set of rectangles. The rectangles are cut into tiles whose
//! sums fit into registers.

use std::ops::Range;

use super::graded::{self, Graded};

/// `rows x columns` sums of products of consecutive functions of two operands; `rows <= columns`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tile {
    /// First function of the first group.
    pub(super) first: usize,
    /// First function of the second group, from the start of the strip.
    pub(super) second: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// True if the short side is the strip.
    pub(super) swapped: bool,
    /// Index of the tile's first sum.
    pub(super) slot: usize,
}

/// Consecutive functions of the second group, at most [`STRIP`] of them, and the tiles that use them: they stay in first-level cache while the functions of the
/// first group pass, which come from further away.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Strip {
    pub(super) start: usize,
    pub(super) width: usize,
    pub(super) tiles: Vec<Tile>,
}

/// Strips of tiles and, for each of the tiles' sums, the index of the moment that it is.
#[derive(Debug, Clone, Default)]
pub(super) struct Tiling {
    pub(super) strips: Vec<Strip>,
    pub(super) index: Vec<usize>,
}

/// Functions of a strip, at most: half of a first-level cache of 32 KiB.
pub(super) const STRIP: usize = 16;
/// Longest short side and long side that the kernel has code for.
pub(super) const LIMITS: (usize, usize) = (4, 8);

/// Returns true if a tile's sums fit into registers, with a quarter left for operands.
fn fits(rows: usize, columns: usize, registers: usize) -> bool {
    let (short, long) = (rows.min(columns), rows.max(columns));
    short <= LIMITS.0 && long <= LIMITS.1 && short * long <= (registers * 3 / 4).max(1)
}

/// Cost of a tile in arbitrary units: two products or two loads a cycle, four cycles of latency at least, and a fixed share per call.
fn cost(rows: usize, columns: usize) -> usize {
    16 * (rows * columns).max(rows + columns).max(8) + 4 * rows * columns + 40
}

/// Length of part `i` of `length` cut into `parts` almost equal parts, and its start.
fn part(length: usize, parts: usize, i: usize) -> (usize, usize) {
    let (start, end) = (i * length / parts, (i + 1) * length / parts);
    (start, end - start)
}

/// The cheapest cut of a `rows x columns` rectangle: numbers of strips both ways.
fn best_cut(rows: usize, columns: usize, registers: usize) -> (usize, usize) {
    let mut best = (usize::MAX, (rows, columns));
    for r in 1..=LIMITS.1.min(rows) {
        for c in 1..=LIMITS.1.min(columns) {
            if fits(r, c, registers) {
                let cut = (rows.div_ceil(r), columns.div_ceil(c));
                let total = (0..cut.0)
                    .flat_map(|i| (0..cut.1).map(move |j| (i, j)))
                    .map(|(i, j)| cost(part(rows, cut.0, i).1, part(columns, cut.1, j).1))
                    .sum();
                best = best.min((total, cut));
            }
        }
    }
    best.1
}

impl Tiling {
    /// All products of total degree at most `degree` of the functions of two groups of variables, of the first group those up to degree `highest`; `target` is the
    /// list of the moments.
    pub(super) fn staircase(
        (first, highest): (&Graded, usize),
        second: &Graded,
        degree: usize,
        target: &Graded,
        registers: usize,
    ) -> Self {
        let mut tiling = Self::default();
        for d in 0..=degree {
            let columns = second.of_degree(d);
            let rows = 0..first.of_degree(highest.min(degree - d)).end;
            if columns.is_empty() {
                continue;
            }
            let cut = best_cut(rows.len(), columns.len(), registers);
            let parts: Vec<(usize, usize)> = (0..cut.1).map(|j| part(columns.len(), cut.1, j)).collect();
            let widest = parts.iter().map(|&(_, width)| width).max().unwrap_or(1);
            for parts in parts.chunks((STRIP / widest).max(1)) {
                tiling.begin(columns.start + parts[0].0);
                for i in 0..cut.0 {
                    let (a, height) = part(rows.len(), cut.0, i);
                    for &(b, width) in parts {
                        tiling.push((a, height), (columns.start + b, width), |a, b| {
                            let exponent = [first.exponent(a), second.exponent(b)].concat();
                            target.index(&exponent).unwrap_or(0)
                        });
                    }
                }
            }
        }
        tiling
    }

    /// The functions `range` of a group by themselves, strip by strip; `index(j)` says which sum function j is.
    pub(super) fn alone(range: Range<usize>, registers: usize, index: impl Fn(usize) -> usize) -> Self {
        let mut tiling = Self::default();
        let cut = best_cut(1, range.len(), registers);
        for j in 0..cut.1 {
            let (b, width) = part(range.len(), cut.1, j);
            tiling.begin(range.start + b);
            tiling.push((0, 1), (range.start + b, width), |_, b| index(b));
        }
        tiling
    }

    fn begin(&mut self, start: usize) {
        self.strips.push(Strip { start, width: 0, tiles: Vec::new() });
    }

    /// A tile of some functions of the first operand (the first and how many) with some of the last strip.
    fn push(&mut self, (a, height): (usize, usize), (b, width): (usize, usize), index: impl Fn(usize, usize) -> usize) {
        let Some(strip) = self.strips.last_mut() else {
            return;
        };
        let swapped = height > width;
        let (rows, columns) = if swapped { (width, height) } else { (height, width) };
        let second = b - strip.start;
        strip.width = strip.width.max(second + width);
        strip.tiles.push(Tile { first: a, second, rows, columns, swapped, slot: self.index.len() });
        for i in 0..rows {
            for j in 0..columns {
                self.index.push(if swapped { index(a + j, b + i) } else { index(a + i, b + j) });
            }
        }
    }
}

/// Number of variables in the first group: the split with the fewest functions to evaluate.
pub(super) fn best_split(variables: usize, degree: usize) -> usize {
    let functions =
        |split: usize| graded::count(split, degree).saturating_add(graded::count(variables - split, degree));
    (1..=variables).min_by_key(|&split| functions(split)).unwrap_or(variables)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_staircase_covers_every_moment_once() {
        for (variables, degree, registers) in [(1, 10, 32), (2, 6, 16), (3, 10, 32), (3, 10, 16), (6, 4, 32), (5, 3, 1)]
        {
            let split = best_split(variables, degree);
            let (a, b, all) =
                (Graded::new(split, degree), Graded::new(variables - split, degree), Graded::new(variables, degree));
            for highest in [degree, degree - 1] {
                let tiling = Tiling::staircase((&a, highest), &b, degree, &all, registers);
                let tops = a.of_degree(degree);
                let alone = Tiling::alone(tops.clone(), registers, |i| {
                    all.index(&[a.exponent(i), &vec![0; variables - split]].concat()).unwrap()
                });
                let tops = if highest < degree { alone.index } else { Vec::new() };
                let mut seen = [tiling.index.clone(), tops].concat();
                seen.sort_unstable();
                assert_eq!(seen, (0..all.len()).collect::<Vec<_>>(), "{variables} {degree} {registers}");
                let strips = || tiling.strips.iter().chain(&alone.strips);
                assert!(strips().all(|strip| strip.width <= STRIP.max(LIMITS.1)));
                let tiles = || strips().flat_map(|strip| &strip.tiles);
                assert!(tiles().all(|t| t.rows <= t.columns && fits(t.rows, t.columns, registers)));
            }
        }
    }

    #[test]
    fn three_variables_split_into_one_and_two() {
        assert!([1, 2].contains(&best_split(3, 10)));
        assert_eq!(best_split(1, 4), 1);
        assert_eq!(best_split(4, 10), 2);
    }
}
