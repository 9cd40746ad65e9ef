//! Trees of cuts: `if vx < 0.3 then (if w < 2 then region 0 else region 1) else region 2`.

/// Cut of a column at a value, and the branches on either side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The column, an index into those of the partition.
    pub column: usize,
    /// Values below it go one way, it and all above the other.
    pub threshold: f64,
    /// Branch of values below the threshold.
    pub below: Branch,
    /// Branch of the others.
    pub above: Branch,
}

/// Branch behind a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Branch {
    /// Another cut, which stands further behind.
    Cut(usize),
    /// The region is known.
    Region(u32),
}

/// One side of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// The column, an index into those of the partition.
    pub column: usize,
    /// Threshold of the cut.
    pub threshold: f64,
    /// True if values are below the threshold; else they are at it or above.
    pub below: bool,
}

/// A binary tree of cuts, each parallel to all axes but one; the first is the root. N cuts make N + 1 regions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tree {
    /// The cuts, each before those that follow it.
    pub cuts: Vec<Cut>,
}

impl Branch {
    /// As one number: that of the cut, or `-1 - region`.
    pub fn code(self) -> i64 {
        match self {
            Branch::Cut(cut) => cut as i64,
            Branch::Region(region) => -1 - i64::from(region),
        }
    }

    /// The branch of a [`Branch::code`]; `None` for a number that is no code.
    pub fn of_code(code: i64) -> Option<Self> {
        match code {
            0.. => usize::try_from(code).ok().map(Branch::Cut),
            _ => u32::try_from(-1 - code).ok().map(Branch::Region),
        }
    }
}

impl Tree {
    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.cuts.len() + 1
    }

    /// The region of a row, by its columns.
    pub fn region(&self, value: impl Fn(usize) -> f64) -> u32 {
        let mut branch = if self.cuts.is_empty() { Branch::Region(0) } else { Branch::Cut(0) };
        loop {
            match branch {
                Branch::Region(region) => return region,
                Branch::Cut(at) => {
                    let cut = &self.cuts[at];
                    branch = if value(cut.column) < cut.threshold { cut.below } else { cut.above };
                }
            }
        }
    }

    /// The sides of the cuts that lead to every region, from the root on.
    pub fn paths(&self) -> Vec<Vec<Side>> {
        let mut to_cut: Vec<Vec<Side>> = vec![Vec::new(); self.cuts.len()];
        let mut to_region: Vec<Vec<Side>> = vec![Vec::new(); self.regions()];
        for (at, cut) in self.cuts.iter().enumerate() {
            for (branch, below) in [(cut.below, true), (cut.above, false)] {
                let mut path = to_cut[at].clone();
                path.push(Side { column: cut.column, threshold: cut.threshold, below });
                match branch {
                    Branch::Cut(next) => to_cut[next] = path,
                    Branch::Region(region) => to_region[region as usize] = path,
                }
            }
        }
        to_region
    }

    /// The box of every region: of each column that bounds it the lowest value and the first beyond it, in the order of the columns.
    pub fn boxes(&self) -> Vec<Vec<(usize, [f64; 2])>> {
        let bounded = |path: Vec<Side>| {
            let mut sides: std::collections::BTreeMap<usize, [f64; 2]> = std::collections::BTreeMap::new();
            for Side { column, threshold, below } in path {
                let [low, high] = sides.entry(column).or_insert([f64::NEG_INFINITY, f64::INFINITY]);
                if below { *high = high.min(threshold) } else { *low = low.max(threshold) }
            }
            sides.into_iter().collect()
        };
        self.paths().into_iter().map(bounded).collect()
    }

    /// Checks that each cut and region is reached once, over so many columns.
    ///
    /// # Errors
    /// A description of the fault.
    pub fn check(&self, columns: usize) -> Result<(), String> {
        let mut reached = vec![false; self.cuts.len()];
        let mut regions = vec![false; self.regions()];
        for (at, cut) in self.cuts.iter().enumerate() {
            if cut.column >= columns || !cut.threshold.is_finite() {
                return Err(format!("cut {at} is of column {} of {columns} at {}", cut.column, cut.threshold));
            }
            for branch in [cut.below, cut.above] {
                let place = match branch {
                    Branch::Cut(next) if next <= at => None,
                    Branch::Cut(next) => reached.get_mut(next),
                    Branch::Region(region) => regions.get_mut(region as usize),
                };
                if place.is_none_or(|place| std::mem::replace(place, true)) {
                    return Err(format!("what follows cut {at} is no branch of a tree of {} cuts", self.cuts.len()));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `x < 1 ? (y < 2 ? 0 : (x < -1 ? 1 : 2)) : 3`
    pub(crate) fn tree() -> Tree {
        let cut = |column, threshold, below, above| Cut { column, threshold, below, above };
        Tree {
            cuts: vec![
                cut(0, 1.0, Branch::Cut(1), Branch::Region(3)),
                cut(1, 2.0, Branch::Region(0), Branch::Cut(2)),
                cut(0, -1.0, Branch::Region(1), Branch::Region(2)),
            ],
        }
    }

    #[test]
    fn rows_follow_cuts_and_boxes() {
        let tree = tree();
        let of = |row: [f64; 2]| tree.region(|column| row[column]);
        assert_eq!([[0.0, 0.0], [-2.0, 2.0], [-1.0, 2.0], [1.0, 0.0]].map(of), [0, 1, 2, 3]);
        assert_eq!(tree.boxes()[2], [(0, [-1.0, 1.0]), (1, [2.0, f64::INFINITY])]);
        for row in (0..400).map(|i| [f64::from(i % 20) / 4.0 - 2.5, f64::from(i / 20) / 4.0 - 1.0]) {
            let within = |sides: &Vec<(usize, [f64; 2])>| {
                sides.iter().all(|&(column, [low, high])| (low..high).contains(&row[column]))
            };
            let boxes = tree.boxes();
            let held: Vec<usize> = (0..4).filter(|&region| within(&boxes[region])).collect();
            assert_eq!(held, [of(row) as usize]);
        }
        assert_eq!(Tree::default().region(|_| f64::NAN), 0);
    }

    #[test]
    fn invalid_trees_are_refused() {
        assert_eq!(tree().check(2), Ok(()));
        assert!(tree().check(1).is_err());
        let broken = |change: &dyn Fn(&mut Tree)| {
            let mut tree = tree();
            change(&mut tree);
            tree.check(2).is_err()
        };
        assert!(broken(&|tree| tree.cuts[0].threshold = f64::NAN));
        assert!(broken(&|tree| tree.cuts[2].below = Branch::Cut(0)));
        assert!(broken(&|tree| tree.cuts[2].below = Branch::Region(0)));
        assert!(broken(&|tree| tree.cuts[2].below = Branch::Region(4)));
        assert!(broken(&|tree| tree.cuts[1].above = Branch::Cut(3)));
        for branch in [Branch::Cut(0), Branch::Cut(7), Branch::Region(0), Branch::Region(9)] {
            assert_eq!(Branch::of_code(branch.code()), Some(branch));
        }
    }
}
