//! The region of a moving state: searched for when it may have changed, known otherwise.

use fleetfoot_model::Rule;
use pulp::Simd;

use crate::{
    aligned::Aligned,
    compiled::Regions,
    kernel::{LANES, affine, argmax, copy, load, padded, scaled_square, smallest_lead, standardise},
    rough::Rough,
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
    /// Per slot, up to the last one that matters: length of the standardised step that a unit step of the slot makes.
    slot_scale: Aligned,
}

enum CellRule {
    Whole,
    Ball { radius: f64 },
    Linear(Linear),
}

/// `argmax_i (w_i . z + b_i)`, one vector lane a region.
struct Linear {
    count: usize,
    width: usize,
    /// Columns x width.
    weights: Aligned,
    /// Width; minus infinity in the padding.
    offsets: Aligned,
    /// Per region, width: `1 / |w_i - w_j|`.
    nearness: Aligned,
    /// 0, 1, 2, ...
    indices: Aligned,
    rough: Rough,
    largest_weight: f64,
    largest_offset: f64,
}

/// Where a trajectory is: its region, and how far it may go before the region has to be searched again.
pub(crate) struct Cell {
    region: usize,
    /// Square of the free radius around the reference; negative: not known.
    free_square: f64,
    reference: Aligned,
    /// Standardised columns, their length, and the regions' scores of the last search.
    z: Aligned,
    size: f64,
    scores: Aligned,
    top: f64,
    /// The same in single precision.
    rough_z: Aligned<f32>,
    rough_scores: Aligned<f32>,
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
            slot_scale: Aligned::new(padded(columns.iter().max().map_or(0, |last| last + 1)), 0.0),
        };
        let Some(regions) = regions else {
            return Some(cells);
        };
        cells.rule = match &regions.rule {
            Rule::Whole => return Some(cells),
            Rule::Ball { radius } => CellRule::Ball { radius: *radius },
            Rule::Linear { weights, offsets } => CellRule::Linear(Linear::new(weights, offsets, columns.len())),
            Rule::Labels { .. } => return None,
        };
        cells.columns = columns.to_vec();
        cells.consecutive =
            columns.first().copied().filter(|first| columns.iter().copied().eq(*first..*first + columns.len()));
        cells.consecutive = cells.consecutive.filter(|first| first + width <= slots);
        cells.centre[..columns.len()].copy_from_slice(&regions.centre);
        cells.scale[..columns.len()].copy_from_slice(&regions.scale);
        for (inverse, scale) in cells.inverse.iter_mut().zip(&regions.scale) {
            *inverse = 1.0 / scale;
        }
        for (&slot, &scale) in columns.iter().zip(&regions.scale) {
            cells.slot_scale[slot] = cells.slot_scale[slot].hypot(1.0 / scale);
        }
        Some(cells)
    }

    /// Number of regions.
    pub(crate) fn count(&self) -> usize {
        match &self.rule {
            CellRule::Whole => 1,
            CellRule::Ball { .. } => 2,
            CellRule::Linear(linear) => linear.count,
        }
    }

    /// A cell that has not been searched yet.
    pub(crate) fn nowhere(&self) -> Cell {
        let (width, rough) =
            if let CellRule::Linear(linear) = &self.rule { (linear.width, linear.rough.width()) } else { (0, 0) };
        Cell {
            region: 0,
            free_square: -1.0,
            reference: Aligned::new(self.slot_scale.len(), 0.0),
            z: Aligned::new(self.centre.len(), 0.0),
            size: 0.0,
            scores: Aligned::new(width, 0.0),
            top: 0.0,
            rough_z: Aligned::new(self.centre.len(), 0.0),
            rough_scores: Aligned::new(rough, 0.0),
        }
    }

    /// Whether these slots may lie in another region than the cell's.
    #[inline(always)]
    pub(crate) fn has_left<S: Simd>(&self, simd: S, cell: &Cell, slots: &[f64]) -> bool {
        let stays =
            scaled_square(simd, &slots[..self.slot_scale.len()], &cell.reference, &self.slot_scale) < cell.free_square;
        // So has one whose distance is not a number.
        !stays
    }

    // Finding a region has three stages of long dependency chains. For many trajectories each stage is done for all of them before the next,
    // so that the processor overlaps their chains.

    /// First stage: standardised columns in single precision.
    #[inline(always)]
    pub(crate) fn sketch<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        let (CellRule::Linear(_), Some(first)) = (&self.rule, self.consecutive) else {
            return;
        };
        let values = &slots[first..first + self.centre.len()];
        for from in (0..self.centre.len()).step_by(LANES) {
            let x = load::<f64, LANES>(&values[from..]);
            let centre = load::<f64, LANES>(&self.centre[from..]);
            let inverse = load::<f64, LANES>(&self.inverse[from..]);
            let z: [f32; LANES] = std::array::from_fn(|i| ((x[i] - centre[i]) * inverse[i]) as f32);
            cell.rough_z[from..from + LANES].copy_from_slice(&z);
        }
        cell.size = scaled_square(simd, values, &self.centre, &self.inverse).sqrt();
        copy::<S>(&slots[..self.slot_scale.len()], &mut cell.reference);
    }

    /// Second stage: the regions' scores in single precision.
    #[inline(always)]
    pub(crate) fn rate(&self, cell: &mut Cell) {
        if let (CellRule::Linear(linear), Some(_)) = (&self.rule, self.consecutive) {
            linear.rough.score(&cell.rough_z[..self.columns.len()], &mut cell.rough_scores);
        }
    }

    /// Last stage: the region and its free radius; by a search in double precision where single precision leaves a doubt.
    #[inline(always)]
    pub(crate) fn settle<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        if let (CellRule::Linear(linear), Some(_)) = (&self.rule, self.consecutive)
            && let Some((region, free)) =
                linear.rough.best(simd, &cell.rough_scores, self.terms(), linear.reach(cell.size))
        {
            cell.region = region;
            cell.free_square = free_square(free, cell.size);
        } else {
            self.search(simd, cell, slots);
        }
    }

    /// Finds the region of these slots.
    #[inline(always)]
    pub(crate) fn locate<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        self.sketch(simd, cell, slots);
        self.rate(cell);
        self.settle(simd, cell, slots);
    }

    /// Roundings of a score.
    #[inline(always)]
    fn terms(&self) -> f64 {
        (self.columns.len() + 4) as f64
    }

    /// A search in double precision: the rule itself.
    #[inline(always)]
    fn search<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        self.standardise(simd, cell, slots);
        self.score(cell);
        self.choose(simd, cell);
        self.release(simd, cell);
    }

    /// Standardised columns.
    #[inline(always)]
    fn standardise<S: Simd>(&self, simd: S, cell: &mut Cell, slots: &[f64]) {
        copy::<S>(&slots[..self.slot_scale.len()], &mut cell.reference);
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

    /// The regions' scores.
    #[inline(always)]
    fn score(&self, cell: &mut Cell) {
        if let CellRule::Linear(linear) = &self.rule {
            affine(&linear.weights, &linear.offsets, &cell.z[..self.columns.len()], &mut cell.scores);
        }
    }

    /// The region of the scores.
    #[inline(always)]
    fn choose<S: Simd>(&self, simd: S, cell: &mut Cell) {
        match &self.rule {
            CellRule::Whole => cell.region = 0,
            CellRule::Ball { radius } => {
                // Summed as the rule itself does it.
                let square: f64 = cell.z[..self.columns.len()].iter().map(|z| z * z).sum();
                cell.region = usize::from(square > radius * radius);
            }
            CellRule::Linear(linear) => {
                (cell.top, cell.region) = argmax(simd, &cell.scores, &linear.indices);
            }
        }
    }

    /// The distance in z within which no other region can win.
    ///
    /// While z moves by d, the lead of region i over j changes by at most `|w_i - w_j| d`.
    #[inline(always)]
    fn release<S: Simd>(&self, simd: S, cell: &mut Cell) {
        let size = cell.size;
        let terms = self.terms();
        let free = match &self.rule {
            CellRule::Whole => f64::INFINITY,
            CellRule::Ball { radius } => (size - radius).abs() - 4.0 * terms * f64::EPSILON * (1.0 + size + radius),
            CellRule::Linear(linear) => {
                let rounding = f64::MIN_POSITIVE + 4.0 * terms * f64::EPSILON * linear.reach(size);
                let nearness = &linear.nearness[cell.region.min(linear.count - 1) * linear.width..][..linear.width];
                smallest_lead(simd, cell.top, rounding, &cell.scores, nearness)
            }
        };
        cell.free_square = free_square(free, size);
    }

    /// The region of a cell that was searched for where it is; `None` where a standardised column is not a number.
    #[inline(always)]
    pub(crate) fn region(&self, cell: &Cell) -> Option<usize> {
        (!cell.size.is_nan() && cell.region < self.count()).then_some(cell.region)
    }
}

/// Square of the radius within which a state may move, from the distance at which another region may win.
#[inline(always)]
fn free_square(free: f64, size: f64) -> f64 {
    // Beyond 1 + |z| the bound on rounding would not hold; distances are computed to a few parts in 1e16 themselves.
    let free = free.min(1.0 + size) * (1.0 - 1e-9);
    if free > 0.0 { free * free } else { -1.0 }
}

impl Linear {
    /// Bound on the terms of every score as far as a cell's free radius goes, `|z| + (1 + |z|)`.
    #[inline(always)]
    fn reach(&self, size: f64) -> f64 {
        self.largest_offset + self.largest_weight * (2.0 * size + 1.0)
    }

    fn new(weights: &[Vec<f64>], offsets: &[f64], columns: usize) -> Self {
        let count = offsets.len();
        let width = padded(count);
        let mut linear = Self {
            count,
            width,
            weights: Aligned::new(columns * width, 0.0),
            offsets: Aligned::new(width, f64::NEG_INFINITY),
            nearness: Aligned::new(count * width, 1.0),
            indices: Aligned::from_slice(&(0..width).map(|i| i as f64).collect::<Vec<_>>()),
            rough: Rough::new(&[], &[], &[], width),
            largest_weight: 0.0,
            largest_offset: offsets.iter().fold(0.0, |a: f64, b| a.max(b.abs())),
        };
        linear.offsets[..count].copy_from_slice(offsets);
        for (i, row) in weights.iter().enumerate() {
            for (column, &weight) in row.iter().enumerate() {
                linear.weights[column * width + i] = weight;
            }
            linear.largest_weight = linear.largest_weight.max(row.iter().map(|w| w * w).sum::<f64>().sqrt());
            for (j, other) in weights.iter().enumerate() {
                let distance = row.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
                // Equal weights: the order of the two never changes. The region itself, whose lead is nothing but the
                // rounding subtracted from 0, is no rival.
                linear.nearness[i * width + j] = match distance {
                    _ if i == j => f64::NEG_INFINITY,
                    d if d > 1e-300 => 1.0 / d,
                    _ => 1e300,
                };
            }
        }
        linear.rough = Rough::new(&linear.weights, &linear.offsets, &linear.nearness, width);
        linear
    }
}
