//! Partitions: which region a row belongs to.
//!
//! Regions are decided on standardised columns z = (value - centre) / scale (angles enter as their cosine and sine).
//! Voronoi cells of centroids and learned linear separators are the same thing, `argmax_i (w_i . z + b_i)`. Nearest
//! centroid is `w_i = c_i`, `b_i = -|c_i|^2 / 2` (equation (7) of Buchan, Haldane, Fearing, "Automatic Identification
//! of Dynamic Piecewise Affine Models for a Running Robot").

use std::sync::Arc;

use fleetfoot_library::Expr;

use crate::Tree;

/// A partition of the state space into regions.
#[derive(Debug, Clone, PartialEq)]
pub struct Partition {
    /// As the user wrote it: `kmeans:10`.
    pub specification: String,
    /// Partition columns, as expressions over the model's columns. With [`Rule::Labels`] the last one is the label.
    pub columns: Vec<Expr>,
    /// Subtracted from each column (0 for a label).
    pub centre: Vec<f64>,
    /// Divides each column (1 for a label).
    pub scale: Vec<f64>,
    /// Rule that gives the region.
    pub rule: Rule,
    /// Transitions between regions, if they were counted.
    pub transitions: Option<crate::Transitions>,
    /// Distribution of the regions along a phase, if one was named.
    pub phases: Option<crate::Phases>,
    /// Pairs of regions and their test for the same dynamics, if transitions were counted: pairs ascending.
    pub pairs: Vec<crate::RegionPair>,
    /// The tree of joins that the regions are a level of, where they are.
    pub lattice: Option<crate::Lattice>,
    /// Correlation of residuals from row to row, if they are correlated.
    pub correlation: Option<crate::ResidualCorrelation>,
}

/// Rule that gives a region from standardised columns.
#[derive(Debug, Clone, PartialEq)]
pub enum Rule {
    /// One region.
    Whole,
    /// Region 0 within this radius of the origin, region 1 outside (the z-score partition).
    Ball {
        /// Radius in standard deviations.
        radius: f64,
    },
    /// Region 0 where every column is within this distance of its centre, region 1 elsewhere.
    Box {
        /// Half of the sides, in standard deviations.
        half: f64,
    },
    /// `argmax_i (w_i . z + b_i)`; the lowest index wins a tie.
    Linear {
        /// One row of weights per region.
        weights: Vec<Vec<f64>>,
        /// One offset per region.
        offsets: Vec<f64>,
    },
    /// Cells of another rule, several of which make a region: regions need be neither convex nor in one piece.
    Joined {
        /// Rule of the cells; shared by all levels of a tree.
        cells: Arc<Rule>,
        /// The region of each cell.
        regions: Vec<u32>,
    },
    /// Cuts of single columns, one after another. Its partition leaves the columns in their units (centre 0, scale 1),
    /// so that thresholds have these units.
    Tree(Tree),
    /// By the value of the last column; every label has a separate rule for the other columns. Regions are numbered
    /// label by label.
    Labels {
        /// The label values seen in training, ascending.
        values: Vec<f64>,
        /// Their names, for people and for text labels of another recording.
        names: Vec<String>,
        /// The rule within each label.
        rules: Vec<Rule>,
        /// Treatment of other labels.
        unseen: UnseenLabel,
    },
}

/// Treatment of a row whose label was not seen in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnseenLabel {
    /// It has no region: an error for the caller to report.
    Refuse,
    /// It is given to the extra last region, whose model was fitted on all rows.
    Pool,
}

impl Rule {
    /// Nearest centroid; `centroids` is one row per region, standardised.
    pub fn voronoi(centroids: Vec<Vec<f64>>) -> Self {
        let offsets = centroids.iter().map(|c| -0.5 * c.iter().map(|v| v * v).sum::<f64>()).collect();
        Rule::Linear { weights: centroids, offsets }
    }

    /// Number of regions.
    pub fn count(&self) -> usize {
        match self {
            Rule::Whole => 1,
            Rule::Ball { .. } | Rule::Box { .. } => 2,
            Rule::Linear { offsets, .. } => offsets.len(),
            Rule::Joined { regions, .. } => regions.iter().max().map_or(0, |&last| last as usize + 1),
            Rule::Tree(tree) => tree.regions(),
            Rule::Labels { rules, unseen, .. } => {
                rules.iter().map(Rule::count).sum::<usize>() + usize::from(*unseen == UnseenLabel::Pool)
            }
        }
    }

    /// Assigns rows to regions. `z` holds one slice per column, standardised, all of the length of `regions`. Rows
    /// without a region (unseen label, NaN) get `u32::MAX`.
    pub fn assign(&self, z: &[&[f64]], regions: &mut [u32]) {
        match self {
            Rule::Whole => regions.fill(0),
            Rule::Ball { radius } => ball(z, *radius, regions),
            Rule::Box { half } => within_box(z, *half, regions),
            Rule::Linear { weights, offsets } => {
                fleetfoot_data::arch().dispatch(Linear { weights, offsets, z, regions });
            }
            Rule::Joined { cells, regions: table } => {
                cells.assign(z, regions);
                join(table, regions);
            }
            Rule::Tree(tree) => {
                for (row, region) in regions.iter_mut().enumerate() {
                    *region = tree.region(|column| z[column][row]);
                }
            }
            Rule::Labels { values, rules, unseen, .. } => labels(values, rules, *unseen, z, regions),
        }
        if !matches!(self, Rule::Labels { .. } | Rule::Whole) {
            for column in z {
                for (region, value) in regions.iter_mut().zip(*column) {
                    if value.is_nan() {
                        *region = u32::MAX;
                    }
                }
            }
        }
    }

    /// The region of a single row.
    pub fn assign_row(&self, z: &[f64]) -> Option<u32> {
        let columns: Vec<&[f64]> = z.chunks_exact(1).collect();
        let mut region = [u32::MAX];
        self.assign(&columns, &mut region);
        (region[0] != u32::MAX).then_some(region[0])
    }
}

impl Partition {
    /// The one-region partition.
    pub fn whole() -> Self {
        Self {
            specification: "average".into(),
            columns: Vec::new(),
            centre: Vec::new(),
            scale: Vec::new(),
            rule: Rule::Whole,
            transitions: None,
            phases: None,
            pairs: Vec::new(),
            lattice: None,
            correlation: None,
        }
    }

    /// Returns true if the targets decided its regions: refined regions, joined cells, trees, alone or within labels.
    ///
    /// The specification ends with the kind of regions and their number; a column of labels may have any name.
    pub fn is_drawn_by_targets(&self) -> bool {
        let kind = self.specification.rsplit_once(':').map_or("", |(kind, _)| kind);
        let within =
            if kind.starts_with("labels:") { kind.rsplit_once('+').map_or("", |(_, kind)| kind) } else { kind };
        ["refined", "lattice", "tree"].contains(&within)
    }

    /// The name of a region, for people: `all`, `inner`, `3`, `grass`, `grass/2`.
    pub fn region_name(&self, region: usize) -> String {
        match &self.rule {
            Rule::Whole => "all".into(),
            Rule::Ball { .. } | Rule::Box { .. } => ["inner", "outer"][region.min(1)].into(),
            Rule::Linear { .. } | Rule::Joined { .. } | Rule::Tree(_) => region.to_string(),
            Rule::Labels { names, rules, .. } => {
                let mut offset = 0;
                for (name, rule) in names.iter().zip(rules) {
                    if region < offset + rule.count() {
                        return if rule.count() == 1 { name.clone() } else { format!("{name}/{}", region - offset) };
                    }
                    offset += rule.count();
                }
                "pooled".into()
            }
        }
    }

    /// Assigns rows to regions by raw columns, one slice a column, all of the length of `regions`; `u32::MAX` is none. `work` is overwritten.
    pub fn assign(&self, columns: &[&[f64]], work: &mut Vec<f64>, regions: &mut [u32]) {
        work.clear();
        for ((column, centre), scale) in columns.iter().zip(&self.centre).zip(&self.scale) {
            work.extend(column.iter().map(|value| (value - centre) / scale));
        }
        let z: Vec<&[f64]> = work.chunks_exact(regions.len().max(1)).collect();
        self.rule.assign(&z, regions);
    }
}

/// Replaces cells by regions, in place; a missing cell stays without a region.
pub fn join(table: &[u32], cells: &mut [u32]) {
    for cell in cells {
        *cell = table.get(*cell as usize).copied().unwrap_or(u32::MAX);
    }
}

fn ball(z: &[&[f64]], radius: f64, regions: &mut [u32]) {
    for (row, region) in regions.iter_mut().enumerate() {
        let square: f64 = z.iter().map(|column| column[row] * column[row]).sum();
        *region = u32::from(square > radius * radius);
    }
}

fn within_box(z: &[&[f64]], half: f64, regions: &mut [u32]) {
    for (row, region) in regions.iter_mut().enumerate() {
        *region = u32::from(z.iter().any(|column| column[row].abs() > half));
    }
}

/// `argmax_i (w_i . z + b_i)` for all rows, compiled once for every vector width that a machine may have.
struct Linear<'a> {
    weights: &'a [Vec<f64>],
    offsets: &'a [f64],
    z: &'a [&'a [f64]],
    regions: &'a mut [u32],
}

impl pulp::NullaryFnOnce for Linear<'_> {
    type Output = ();

    // Must be inlined into the function that carries the target features: as a call, `mul_add` would be one to the C library.
    #[inline(always)]
    fn call(self) {
        linear(self.weights, self.offsets, self.z, self.regions);
    }
}

/// Rows go through in tiles that stay in registers and first-level cache; `mul_add` gives the same bits on every machine.
#[inline(always)]
fn linear(weights: &[Vec<f64>], offsets: &[f64], z: &[&[f64]], regions: &mut [u32]) {
    const TILE: usize = 64;
    let mut from = 0;
    while from < regions.len() {
        let rows = TILE.min(regions.len() - from);
        let mut best = [f64::NEG_INFINITY; TILE];
        let mut winner = [0u32; TILE];
        for (region, (row_weights, &offset)) in weights.iter().zip(offsets).enumerate() {
            let mut score = [offset; TILE];
            for (column, &weight) in z.iter().zip(row_weights) {
                if let Some(values) = column.get(from..from + TILE) {
                    let values: &[f64; TILE] = values.try_into().unwrap_or(&[0.0; TILE]);
                    for i in 0..TILE {
                        score[i] = weight.mul_add(values[i], score[i]);
                    }
                } else {
                    for (s, &value) in score.iter_mut().zip(&column[from..from + rows]) {
                        *s = weight.mul_add(value, *s);
                    }
                }
            }
            for i in 0..TILE {
                let better = score[i] > best[i];
                best[i] = if better { score[i] } else { best[i] };
                winner[i] = if better { region as u32 } else { winner[i] };
            }
        }
        regions[from..from + rows].copy_from_slice(&winner[..rows]);
        from += rows;
    }
}

fn labels(values: &[f64], rules: &[Rule], unseen: UnseenLabel, z: &[&[f64]], regions: &mut [u32]) {
    let Some((label, rest)) = z.split_last() else {
        regions.fill(u32::MAX);
        return;
    };
    regions.fill(match unseen {
        UnseenLabel::Refuse => u32::MAX,
        UnseenLabel::Pool => rules.iter().map(Rule::count).sum::<usize>() as u32,
    });
    let mut offset = 0;
    for (&value, rule) in values.iter().zip(rules) {
        let rows: Vec<usize> = (0..regions.len()).filter(|&row| label[row] == value).collect();
        let gathered: Vec<Vec<f64>> = rest.iter().map(|column| rows.iter().map(|&row| column[row]).collect()).collect();
        let slices: Vec<&[f64]> = gathered.iter().map(Vec::as_slice).collect();
        let mut inner = vec![0; rows.len()];
        rule.assign(&slices, &mut inner);
        for (&row, &region) in rows.iter().zip(&inner) {
            regions[row] = if region == u32::MAX { u32::MAX } else { offset + region };
        }
        offset += rule.count() as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_column_may_have_a_partitions_name() {
        let drawn = |text: &str| Partition { specification: text.into(), ..Partition::whole() }.is_drawn_by_targets();
        for text in ["refined:4", "lattice:3", "tree:2", "labels:surface+refined:3", "labels:a:b+tree:1"] {
            assert!(drawn(text), "{text}");
        }
        for text in ["average", "kmeans:4", "zscore:1.5", "labels:tree", "labels:tree+kmeans:2", "labels:refined:x"] {
            assert!(!drawn(text), "{text}");
        }
    }

    #[test]
    fn nearest_centroid_and_ties() {
        let rule = Rule::voronoi(vec![vec![0.0, 0.0], vec![2.0, 0.0], vec![0.0, 2.0]]);
        let x: Vec<f64> = (0..200).map(|i| f64::from(i % 20) / 5.0 - 1.0).collect();
        let y: Vec<f64> = (0..200).map(|i| f64::from(i / 20) / 3.0 - 1.0).collect();
        let mut regions = vec![9; 200];
        rule.assign(&[&x, &y], &mut regions);
        for row in 0..200 {
            let distance = |c: [f64; 2]| (x[row] - c[0]).powi(2) + (y[row] - c[1]).powi(2);
            let all = [distance([0.0, 0.0]), distance([2.0, 0.0]), distance([0.0, 2.0])];
            let nearest = all.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(all[regions[row] as usize] <= nearest + 1e-12);
            assert_eq!(rule.assign_row(&[x[row], y[row]]), Some(regions[row]));
        }
        assert_eq!(rule.assign_row(&[1.0, -1.0]), Some(0), "the lowest index wins a tie");
        assert_eq!(rule.assign_row(&[f64::NAN, 0.0]), None);
    }

    #[test]
    fn joined_cells_are_one_region() {
        let cells = Arc::new(Rule::voronoi(vec![vec![-2.0], vec![0.0], vec![2.0]]));
        let rule = Rule::Joined { cells, regions: vec![1, 0, 1] };
        assert_eq!(rule.count(), 2);
        let mut regions = [9; 4];
        rule.assign(&[&[-3.0, 0.5, 1.5, f64::NAN]], &mut regions);
        assert_eq!(regions, [1, 0, 1, u32::MAX]);
    }

    #[test]
    fn ball_and_labels() {
        assert_eq!(Rule::Ball { radius: 1.5 }.assign_row(&[1.5, 0.0]), Some(0));
        assert_eq!(Rule::Ball { radius: 1.5 }.assign_row(&[1.5, 0.1]), Some(1));
        assert_eq!(Rule::Box { half: 1.5 }.assign_row(&[1.5, -1.5]), Some(0));
        assert_eq!(Rule::Box { half: 1.5 }.assign_row(&[0.0, -1.6]), Some(1));
        assert_eq!(Rule::Box { half: 1.5 }.assign_row(&[f64::NAN, 0.0]), None);
        let mut rule = Rule::Labels {
            values: vec![1.0, 4.0],
            names: vec!["1".into(), "4".into()],
            rules: vec![Rule::voronoi(vec![vec![-1.0], vec![1.0]]), Rule::Whole],
            unseen: UnseenLabel::Refuse,
        };
        assert_eq!(rule.count(), 3);
        let label = [1.0, 4.0, 1.0, 2.0];
        let mut regions = [0; 4];
        rule.assign(&[&[0.9, 5.0, -0.2, 0.0], &label], &mut regions);
        assert_eq!(regions, [1, 2, 0, u32::MAX]);
        if let Rule::Labels { unseen, .. } = &mut rule {
            *unseen = UnseenLabel::Pool;
        }
        rule.assign(&[&[0.9, 5.0, -0.2, 0.0], &label], &mut regions);
        assert_eq!(regions, [1, 2, 0, 3]);
    }
}
