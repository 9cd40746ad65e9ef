//! Trees of cuts: `if vx < 0.3`, and an affine map at every leaf.
//!
//! A node is cut where its rows' error falls most, each side with a separate map. The cut is exact, from the Gram
//! matrices of bins of its rows along every partition column, merged from both ends (`cuts`). After Breiman, Friedman,
//! Olshen, Stone, "Classification and Regression Trees" (1984), with the affine leaves of Quinlan's M5 ("Learning with
//! continuous classes", 1992) in place of means. All nodes grow down to the requested depth, for a cut may pay only
//! together with those that follow it. Then branches go that do not pay for their numbers: of all subtrees the one
//! stays of least
//!
//! `sum over leaves |e|^2 / tau^2 + alpha leaves`, `alpha = (q (p + 1) + 1) ln n`
//!
//! over n rows, q targets and p regressors, with `tau^2` the mean squared error of the grown tree by its degrees of
//! freedom. (It is cost-complexity pruning at the price of the Bayesian information criterion: a leaf is q maps of p +
//! 1 numbers and a threshold.) The folds choose the depth of a tree, as they choose every partition.
//!
//! Thresholds stand between two rows, at the shortest decimal number that is there, in the units of their column.

mod cuts;

use fleetfoot_data::{Cancelled, Progress, parallel_all};
use fleetfoot_model::{Branch, Cut, Rule, Tree};
use fleetfoot_stats::Gram;

use crate::{
    Error,
    examples::{Examples, Shape},
};
use cuts::{Node, NodeCut};

/// Rows of a leaf at least, of each number of a map.
const ROWS_OF_A_NUMBER: usize = 5;

/// A tree of one training set, grown to the deepest request so far.
pub(crate) struct Grown {
    examples: Examples,
    nodes: Vec<Grew>,
    /// Levels of cuts that were looked for.
    depth: usize,
}

/// A node of a growing tree.
struct Grew {
    node: Node,
    depth: usize,
    /// Its cut, and the nodes below and above it.
    cut: Option<(usize, f64, [usize; 2])>,
}

impl Grown {
    /// The root, on some rows of columns ([`Examples::new`]); `None` where none weigh anything.
    pub(crate) fn new(columns: &[Vec<f64>], shape: Shape, rows: &[usize]) -> Option<Self> {
        // Columns stay as they are: cuts do not care for units, and people read them.
        let examples = Examples::new(columns, shape, (&vec![0.0; shape.0], &vec![1.0; shape.0]), rows)?;
        let rows: Vec<u32> = (0..examples.rows as u32).collect();
        let labels: Vec<Vec<u32>> = examples.map(|_, chunk| vec![0; chunk.rows]);
        let gram = examples.grams(&labels, 1).swap_remove(0);
        let root = Grew { node: Node::new(&examples, rows, gram), depth: 0, cut: None };
        Some(Self { examples, nodes: vec![root], depth: 0 })
    }

    /// The tree of at most so many cuts one after another.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn rule(&mut self, depth: usize, progress: &dyn Progress) -> Result<Rule, Error> {
        while self.depth < depth {
            if progress.cancelled() {
                return Err(Cancelled.into());
            }
            self.grow();
            progress.advance(1, depth);
        }
        let kept = self.pruned(depth);
        let mut tree = Tree::default();
        if kept[0] {
            self.write(0, &kept, &mut 0, &mut tree);
        }
        Ok(if tree.cuts.is_empty() { Rule::Whole } else { Rule::Tree(tree) })
    }

    /// Cuts the nodes of the last level.
    fn grow(&mut self) {
        let least = (ROWS_OF_A_NUMBER * (self.examples.regressors + 1)) as u64;
        let open: Vec<usize> = (0..self.nodes.len()).filter(|&at| self.nodes[at].depth == self.depth).collect();
        let d = self.examples.dimensions;
        let examples = &self.examples;
        let cuts: Vec<Option<NodeCut>> = {
            let nodes = &self.nodes;
            parallel_all(open.len() * d, |at| nodes[open[at / d]].node.best(examples, at % d, least))
        };
        let mut cuts = cuts.into_iter();
        for &at in &open {
            // The first of equal ones, up to rounding.
            let noise = cuts::ROUNDING * self.nodes[at].node.total;
            let columns = cuts.by_ref().take(d).flatten();
            let best = columns.reduce(|best, next| if next.error < best.error - noise { next } else { best });
            let Some(best) = best.map(|best| self.nodes[at].node.sharpened(examples, best, least)) else { continue };
            let children = self.nodes[at].node.sides(examples, &best);
            let first = self.nodes.len();
            self.nodes[at].cut = Some((best.column, best.threshold, [first, first + 1]));
            let depth = self.depth + 1;
            self.nodes.extend(children.map(|node| Grew { node, depth, cut: None }));
        }
        self.depth += 1;
    }

    /// Marks of the nodes that are cut in the subtree of least cost.
    fn pruned(&self, depth: usize) -> Vec<bool> {
        let (p, q) = (self.examples.regressors, self.examples.targets);
        let cut = |node: &Grew| node.cut.filter(|_| node.depth < depth);
        let leaves: Vec<&Grew> = self.nodes.iter().filter(|node| node.depth <= depth && cut(node).is_none()).collect();
        let rows = self.examples.rows as f64;
        let freedom = (1.0 - (leaves.len() * (p + 1)) as f64 / rows).max(0.1);
        let left: f64 = leaves.iter().map(|leaf| leaf.node.error).sum();
        let rounding = cuts::ROUNDING * self.nodes[0].node.total;
        let square = left.max(rounding) / (rows * q as f64 * freedom);
        let price = ((q * (p + 1) + 1) as f64) * rows.ln();
        let (mut cost, mut kept) = (vec![0.0; self.nodes.len()], vec![false; self.nodes.len()]);
        // Children stand behind their parents.
        for at in (0..self.nodes.len()).rev().filter(|&at| self.nodes[at].depth <= depth) {
            cost[at] = self.nodes[at].node.error / square + price;
            if let Some((_, _, [below, above])) = cut(&self.nodes[at])
                && cost[below] + cost[above] < cost[at]
            {
                (kept[at], cost[at]) = (true, cost[below] + cost[above]);
            }
        }
        kept
    }

    /// Appends the cuts from a node on; regions are numbered from the lowest values of the first cut on.
    fn write(&self, at: usize, kept: &[bool], regions: &mut u32, tree: &mut Tree) -> Branch {
        let Some((column, threshold, sides)) = self.nodes[at].cut.filter(|_| kept[at]) else {
            *regions += 1;
            return Branch::Region(*regions - 1);
        };
        let count = tree.cuts.len();
        tree.cuts.push(Cut { column, threshold, below: Branch::Region(0), above: Branch::Region(0) });
        let [below, above] = sides.map(|side| self.write(side, kept, regions, tree));
        (tree.cuts[count].below, tree.cuts[count].above) = (below, above);
        Branch::Cut(count)
    }
}

impl Node {
    /// Some rows and their Gram matrix.
    fn new(examples: &Examples, rows: Vec<u32>, gram: Gram) -> Self {
        let error = examples.error(&gram);
        Self { rows, error, total: gram.weight * examples.targets as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetfoot_data::{Silent, mix};

    fn uniform(at: u64) -> f64 {
        2.0 * (mix(mix(at)) >> 11) as f64 * 2f64.powi(-53) - 1.0
    }

    /// Rows (x0, x1, y) of a function, with noise of so much.
    fn grown(rows: u64, noise: f64, f: impl Fn(f64, f64) -> f64) -> Grown {
        let row = |at: u64| {
            let (x, y) = (uniform(3 * at), uniform(3 * at + 1));
            [x, y, f(x, y) + noise * uniform(3 * at + 2)]
        };
        let rows: Vec<[f64; 3]> = (0..rows).map(row).collect();
        let column = |j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
        let all: Vec<usize> = (0..rows.len()).collect();
        Grown::new(&[0, 1, 0, 1, 2].map(column), (2, 2, 1), &all).unwrap()
    }

    fn cuts(rule: &Rule) -> Vec<Cut> {
        match rule {
            Rule::Tree(tree) => {
                assert_eq!(tree.check(2), Ok(()));
                tree.cuts.clone()
            }
            _ => Vec::new(),
        }
    }

    /// Three maps: below 0.25 of the first column, and on both sides of -0.5 of the second beyond.
    fn three(x: f64, y: f64) -> f64 {
        if x < 0.25 {
            x
        } else if y < -0.5 {
            7.0 - y
        } else {
            5.0 - x + 3.0 * y
        }
    }

    #[test]
    fn true_cuts_are_recovered() {
        for depth in [2, 4, 6] {
            let cuts = cuts(&grown(4000, 0.1, three).rule(depth, &Silent).unwrap());
            assert_eq!(cuts.len(), 2, "depth {depth}: {cuts:?}");
            assert_eq!((cuts[0].column, cuts[1].column), (0, 1));
            assert!((cuts[0].threshold - 0.25).abs() < 5e-3 && (cuts[1].threshold + 0.5).abs() < 0.01, "{cuts:?}");
            assert_eq!((cuts[0].below, cuts[0].above), (Branch::Region(0), Branch::Cut(1)));
        }
    }

    #[test]
    fn noise_is_not_cut() {
        assert_eq!(grown(2000, 1.0, |x, y| x - y).rule(5, &Silent).unwrap(), Rule::Whole);
        assert_eq!(grown(2000, 0.0, |x, y| x - y).rule(5, &Silent).unwrap(), Rule::Whole);
    }

    #[test]
    fn sign_of_product_has_four_corners() {
        let cuts = cuts(&grown(4000, 0.05, |x, y| (x * y).signum()).rule(3, &Silent).unwrap());
        assert!(cuts.len() >= 3, "{cuts:?}");
        let of = |x: f64, y: f64| Tree { cuts: cuts.clone() }.region(|column| [x, y][column]);
        let corners = [of(-0.5, -0.5), of(-0.5, 0.5), of(0.5, -0.5), of(0.5, 0.5)];
        assert!((0..4).all(|i| (0..i).all(|j| corners[i] != corners[j])), "{corners:?}");
    }

    #[test]
    fn shallow_tree_does_not_depend_on_depth() {
        let wave = |x: f64, y: f64| (4.0 * x).sin() * y;
        let mut together = grown(3000, 0.1, wave);
        for depth in [3, 1, 5, 2] {
            let alone = grown(3000, 0.1, wave).rule(depth, &Silent).unwrap();
            assert_eq!(together.rule(depth, &Silent).unwrap(), alone);
            assert!(alone.count() <= 1 << depth && alone.count() > 1);
        }
    }

    #[test]
    fn leaves_have_rows_enough_for_their_maps() {
        let mut few = grown(60, 0.0, |x, y| (9.0 * x).sin() + (7.0 * y).cos());
        assert!(few.rule(8, &Silent).unwrap().count() <= 4);
        assert!(few.nodes.len() > 1 && few.nodes.iter().all(|node| node.node.rows.len() >= 15));
    }
}
