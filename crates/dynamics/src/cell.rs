//! The region of a moving state: searched for when it may have changed, known otherwise.

use fleetfoot_model::{Branch, Rule, Tree};
use pulp::Simd;

use crate::{
    aligned::Aligned,
    compiled::Regions,
    kernel::{affine, argmax, copy, padded, scaled_square, smallest_lead, standardise, standardise_by},
    screen::{Screen, Screened},
};

/// The partition of the fast path: how regions follow from the slots of a trajectory.
pub(crate) struct Cells {
    rule: CellRule,
    /// Slots of the standardised columns.
    columns: Vec<usize>,
    /// The first of these slots, when they follow each other and the padding behind them is there.
    consecutive: Option<usize>,
    /// Centres and scales of the columns; the padding's scale makes it 0.
    centre: Aligned,
    scale: Aligned,
    /// `1 / scale`.
    inverse: Aligned,
    /// Per slot: length of the standardised step that a unit step of the slot makes.
    slot_scale: Aligned,
    /// Slots up to the last that a region depends on, padded.
    reach: usize,
}

enum CellRule {
    Whole,
    Ball { radius: f64 },
    Box { half: f64 },
    Linear(Linear),
    Tree(Tree),
}

/// `argmax_i (w_i . z + b_i)`, one vector lane a region.
struct Linear {
    /// Cells, and the regions that they are or are joined to.
    count: usize,
    regions: usize,
    width: usize,
    /// Columns x width.
    weights: Aligned,
    /// Width; minus infinity in the padding.
    offsets: Aligned,
    /// Per region, width: `1 / |w_i - w_j|`.
    nearness: Aligned,
    /// 0, 1, 2, ...
    indices: Aligned,
    /// The region of each cell, where cells are joined to regions.
    joined: Option<Vec<usize>>,
    largest_weight: f64,
    largest_offset: f64,
    screen: Box<Screen>,
}

/// Place of a trajectory: its region, and the distance that it may go before the region has to be searched again.
pub(crate) struct Cell {
    region: usize,
    /// Square of the free radius around the reference; negative: not known.
    free_square: f64,
    reference: Aligned,
    /// Standardised columns, their length, and the regions' scores of the last search.
    z: Aligned,
    size: f64,
    scores: Aligned,
    /// The winner's score; of a tree the distance to the nearest cut on the way; of a box the column of largest size.
    top: f64,
    /// Memory of the screen, where there is one.
    screened: Option<Screened>,
}

impl Cells {
    /// `columns` are the slots of the partition's columns. `None` for a partition by labels.
    pub(crate) fn new(regions: Option<&Regions>, columns: &[usize], slots: usize) -> Option<Self> {
        let width = padded(columns.len());
        let mut cells = Self {
            rule: CellRule::Whole,
            columns: Vec::new(),
            consecutive: None,
            centre: Aligned::new(width, 0.0),
            scale: Aligned::new(width, f64::INFINITY),
            inverse: Aligned::new(width, 0.0),
            slot_scale: Aligned::new(slots, 0.0),
            reach: 0,
        };
        let Some(regions) = regions else {
            return Some(cells);
        };
        cells.rule = match &regions.rule {
            Rule::Whole => return Some(cells),
            Rule::Ball { radius } => CellRule::Ball { radius: *radius },
            Rule::Box { half } => CellRule::Box { half: *half },
            Rule::Linear { weights, offsets } => CellRule::Linear(Linear::new(weights, offsets, columns.len(), None)),
            Rule::Joined { cells, regions } => match &**cells {
                Rule::Linear { weights, offsets } => {
                    CellRule::Linear(Linear::new(weights, offsets, columns.len(), Some(regions)))
                }
                _ => return None,
            },
            Rule::Tree(tree) => CellRule::Tree(tree.clone()),
            Rule::Labels { .. } => return None,
        };
        cells.columns = columns.to_vec();
        cells.reach = padded(columns.iter().max().map_or(0, |last| last + 1)).min(slots);
        cells.consecutive =
            columns.first().copied().filter(|first| columns.iter().copied().eq(*first..*first + columns.len()));
        cells.consecutive = cells.consecutive.filter(|first| first + width <= slots);
        cells.centre[..columns.len()].copy_from_slice(&regions.centre);
        cells.scale[..columns.len()].copy_from_slice(&regions.scale);
        for (column, (&slot, &scale)) in columns.iter().zip(&regions.scale).enumerate() {
            cells.inverse[column] = 1.0 / scale;
            // A column without a cut may go as far as it likes.
            let is_cut = |tree: &Tree| tree.cuts.iter().any(|cut| cut.column == column);
            if !matches!(&cells.rule, CellRule::Tree(tree) if !is_cut(tree)) {
                cells.slot_scale[slot] = cells.slot_scale[slot].hypot(1.0 / scale);
            }
        }
        Some(cells)
    }

    /// Number of regions.
    pub(crate) fn count(&self) -> usize {
        match &self.rule {
            CellRule::Whole => 1,
            CellRule::Ball { .. } | CellRule::Box { .. } => 2,
            CellRule::Linear(linear) => linear.regions,
            CellRule::Tree(tree) => tree.regions(),
        }
    }

    /// A cell that has not been searched yet.
    pub(crate) fn nowhere(&self) -> Cell {
        let width = if let CellRule::Linear(linear) = &self.rule { linear.width } else { 0 };
        Cell {
            region: 0,
            free_square: -1.0,
            reference: Aligned::new(self.reach, 0.0),
            z: Aligned::new(self.centre.len(), 0.0),
            size: 0.0,
            scores: Aligned::new(width, 0.0),
            top: 0.0,
            screened: match &self.rule {
                CellRule::Linear(linear) => Some(linear.screen.memory(self.columns.len())),
                _ => None,
            },
        }
    }

    /// Returns true if these slots may lie in another region than the cell's.
    #[inline(always)]
    pub(crate) fn has_left<S: Simd>(&self, simd: S, cell: &Cell, slots: &[f64]) -> bool {
        let (slots, scale) = (&slots[..self.reach], &self.slot_scale[..self.reach]);
        let stays = scaled_square(simd, slots, &cell.reference, scale) < cell.free_square;
        // So has one whose distance is not a number.
        !stays
    }

    // A search has stages of long dependency chains. For many trajectories each stage is done for all of them before the next, so that the
    // processor overlaps their chains.

    /// First stage of a search: from here on distances count.
    #[inline(always)]
    pub(crate) fn refer<S: Simd>(&self, cell: &mut Cell, slots: &[f64]) {
        copy::<S>(&slots[..self.reach], &mut cell.reference);
    }

    /// Second stage of a search: scores of the screen, at standardised columns within a rounding.
    #[inline(always)]
    pub(crate) fn approach<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        let (CellRule::Linear(linear), Some(screened)) = (&self.rule, &mut cell.screened) else { return };
        let square = match self.consecutive {
            Some(first) => {
                let values = &slots[first..first + self.centre.len()];
                standardise_by(simd, values, &self.centre, &self.inverse, &mut cell.z)
            }
            None => {
                let mut square = 0.0;
                let columns = self.centre.iter().zip(self.inverse.iter()).zip(&self.columns);
                for (z, ((&centre, &inverse), &slot)) in cell.z.iter_mut().zip(columns) {
                    *z = (slots[slot] - centre) * inverse;
                    square += *z * *z;
                }
                square
            }
        };
        linear.screen.score(simd, &cell.z[..self.columns.len()], screened);
        cell.size = square.sqrt();
    }

    /// Columns standardised as the rule itself does it.
    #[inline(always)]
    fn standardise<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        let square = match self.consecutive {
            Some(first) => {
                let values = &slots[first..first + self.centre.len()];
                standardise(simd, values, &self.centre, &self.scale, &mut cell.z)
            }
            None => {
                let mut square = 0.0;
                let columns = self.centre.iter().zip(self.scale.iter()).zip(&self.columns);
                for (z, ((&centre, &scale), &slot)) in cell.z.iter_mut().zip(columns) {
                    *z = (slots[slot] - centre) / scale;
                    square += *z * *z;
                }
                square
            }
        };
        cell.size = square.sqrt();
    }

    /// Third stage: the winner by the screen.
    #[inline(always)]
    pub(crate) fn screen<S: Simd>(&self, simd: S, cell: &mut Cell) {
        if let (CellRule::Linear(linear), Some(screened)) = (&self.rule, &mut cell.screened) {
            linear.screen.choose(simd, screened);
        }
    }

    /// Fourth stage: whether that is certain, and how far the state may go.
    #[inline(always)]
    pub(crate) fn is_certain<S: Simd>(&self, simd: S, cell: &mut Cell) -> bool {
        let (CellRule::Linear(linear), Some(screened)) = (&self.rule, &cell.screened) else { return false };
        let Some(free) = linear.screen.free(simd, screened, cell.size) else { return false };
        cell.region = screened.cell;
        cell.allow(free);
        true
    }

    /// Settles a cell about which the screen is not certain: exact scores, the winner, and the free radius.
    #[inline(always)]
    pub(crate) fn settle<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        self.standardise(simd, cell, slots);
        self.score(cell);
        self.choose(simd, cell);
        self.release(simd, cell);
    }

    /// The regions' scores.
    #[inline(always)]
    fn score(&self, cell: &mut Cell) {
        if let CellRule::Linear(linear) = &self.rule {
            affine(&linear.weights, &linear.offsets, &cell.z[..self.columns.len()], &mut cell.scores);
        }
    }

    /// The region.
    #[inline(always)]
    fn choose<S: Simd>(&self, simd: S, cell: &mut Cell) {
        match &self.rule {
            CellRule::Whole => cell.region = 0,
            CellRule::Ball { radius } => {
                // Summed as the rule itself does it.
                let square: f64 = cell.z[..self.columns.len()].iter().map(|z| z * z).sum();
                cell.region = usize::from(square > radius * radius);
            }
            CellRule::Box { half } => {
                cell.top = largest(&cell.z[..self.columns.len()]);
                cell.region = usize::from(cell.top > *half);
            }
            CellRule::Linear(linear) => {
                (cell.top, cell.region) = argmax(simd, &cell.scores, &linear.indices);
            }
            CellRule::Tree(tree) => (cell.region, cell.top) = walk(tree, &cell.z),
        }
    }

    /// The distance in z within which no other region can win.
    ///
    /// While z moves by d, the lead of region i over j changes by at most `|w_i - w_j| d`.
    #[inline(always)]
    fn release<S: Simd>(&self, simd: S, cell: &mut Cell) {
        let size = cell.size;
        let terms = (self.columns.len() + 4) as f64;
        let free = match &self.rule {
            CellRule::Whole => f64::INFINITY,
            CellRule::Ball { radius } => (size - radius).abs() - 4.0 * terms * f64::EPSILON * (1.0 + size + radius),
            // Exact within; elsewhere the border is at least as far as the column that is farthest from it.
            CellRule::Box { half } => (cell.top - half).abs() - 4.0 * terms * f64::EPSILON * (1.0 + size + half),
            CellRule::Linear(linear) => {
                // Rounding of two scores within the largest radius that is allowed, 1 + |z|.
                let reach = linear.largest_offset + linear.largest_weight * (2.0 * size + 1.0);
                let rounding = f64::MIN_POSITIVE + 4.0 * terms * f64::EPSILON * reach;
                let nearness = &linear.nearness[cell.region.min(linear.count - 1) * linear.width..][..linear.width];
                smallest_lead(simd, cell.top, rounding, &cell.scores, nearness)
            }
            // No cut on the way is nearer.
            CellRule::Tree(_) => cell.top,
        };
        cell.allow(free);
    }

    /// All stages of a search.
    #[inline(always)]
    pub(crate) fn search<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        self.refer::<S>(cell, slots);
        self.approach(simd, cell, slots);
        self.screen(simd, cell);
        if !self.is_certain(simd, cell) {
            self.settle(simd, cell, slots);
        }
    }

    /// The region of a cell that was searched for where it is; `None` where a standardised column is not a number.
    #[inline(always)]
    pub(crate) fn region(&self, cell: &Cell) -> Option<usize> {
        let region = match &self.rule {
            CellRule::Linear(Linear { joined: Some(regions), .. }) => *regions.get(cell.region)?,
            _ => cell.region,
        };
        (!cell.size.is_nan() && region < self.count()).then_some(region)
    }
}

impl Cell {
    /// The same memory, for another trajectory.
    pub(crate) fn anew(self) -> Self {
        Self { region: 0, free_square: -1.0, ..self }
    }

    /// Notes how far the state may go before the region is searched again.
    #[inline(always)]
    fn allow(&mut self, free: f64) {
        // Beyond this radius the bound on rounding would not hold; distances are computed to a few parts in 1e16 themselves.
        let free = free.min(1.0 + self.size) * (1.0 - 1e-9);
        self.free_square = if free > 0.0 { free * free } else { -1.0 };
    }
}

/// The largest size of standardised columns.
fn largest(z: &[f64]) -> f64 {
    z.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

/// The region of standardised columns, and how far the nearest of the cuts on the way is.
fn walk(tree: &Tree, z: &[f64]) -> (usize, f64) {
    let (mut branch, mut nearest) = (Branch::Cut(0), f64::INFINITY);
    loop {
        match branch {
            Branch::Region(region) => return (region as usize, nearest),
            Branch::Cut(at) => {
                let Some(cut) = tree.cuts.get(at) else { return (0, nearest) };
                let value = z[cut.column];
                nearest = nearest.min((value - cut.threshold).abs());
                branch = if value < cut.threshold { cut.below } else { cut.above };
            }
        }
    }
}

impl Linear {
    fn new(weights: &[Vec<f64>], offsets: &[f64], columns: usize, joined: Option<&[u32]>) -> Self {
        let count = offsets.len();
        let width = padded(count);
        let mut linear = Self {
            count,
            regions: joined.map_or(count, |regions| regions.iter().max().map_or(0, |&last| last as usize + 1)),
            width,
            weights: Aligned::new(columns * width, 0.0),
            offsets: Aligned::new(width, f64::NEG_INFINITY),
            nearness: Aligned::new(count * width, 1.0),
            indices: Aligned::from_slice(&(0..width).map(|i| i as f64).collect::<Vec<_>>()),
            joined: joined.map(|regions| regions.iter().map(|&region| region as usize).collect()),
            largest_weight: 0.0,
            largest_offset: offsets.iter().fold(0.0, |a: f64, b| a.max(b.abs())),
            screen: Box::new(Screen::new(weights, offsets, columns, |i, j| {
                joined.is_some_and(|cells| cells[i] == cells[j])
            })),
        };
        linear.offsets[..count].copy_from_slice(offsets);
        for (i, row) in weights.iter().enumerate() {
            for (column, &weight) in row.iter().enumerate() {
                linear.weights[column * width + i] = weight;
            }
            linear.largest_weight = linear.largest_weight.max(row.iter().map(|w| w * w).sum::<f64>().sqrt());
            for (j, other) in weights.iter().enumerate() {
                let distance = row.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
                let together = joined.is_some_and(|regions| regions[i] == regions[j]);
                // Equal weights: the order of the two never changes; of two cells of one region it does not matter. The region itself, whose lead is nothing but the
                // rounding subtracted from 0, is no rival.
                linear.nearness[i * width + j] = match distance {
                    _ if i == j => f64::NEG_INFINITY,
                    d if d > 1e-300 && !together => 1.0 / d,
                    _ => 1e300,
                };
            }
        }
        linear
    }
}
