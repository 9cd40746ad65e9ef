//! The region of a moving state: searched for when it may have changed, known otherwise.

use fleetfoot_model::Rule;
use pulp::Simd;

use crate::{
    aligned::Aligned,
    compiled::Regions,
    kernel::{affine, argmax, padded, scaled_square, smallest_lead, standardise},
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
    /// Per slot: length of the standardised step that a unit step of the slot makes.
    slot_scale: Aligned,
    slots: usize,
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
    largest_weight: f64,
    largest_offset: f64,
}

/// Where a trajectory is: its region, and how far it may go before the region has to be searched again.
pub(crate) struct Cell {
    region: usize,
    /// Square of the free radius around the reference; negative: not known.
    free_square: f64,
    reference: Aligned,
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
            slot_scale: Aligned::new(slots, 0.0),
            slots,
        };
        let Some(regions) = regions else {
            return Some(cells);
        };
        cells.rule = match &regions.rule {
            Rule::Whole => return Some(cells),
            Rule::Ball { radius } => CellRule::Ball { radius: *radius },
            Rule::Linear { weights, offsets } => {
                CellRule::Linear(Linear::new(weights, offsets, columns.len()))
            }
            Rule::Labels { .. } => return None,
        };
        cells.columns = columns.to_vec();
        cells.consecutive = columns
            .first()
            .copied()
            .filter(|first| columns.iter().copied().eq(*first..*first + columns.len()));
        cells.consecutive = cells.consecutive.filter(|first| first + width <= slots);
        cells.centre[..columns.len()].copy_from_slice(&regions.centre);
        cells.scale[..columns.len()].copy_from_slice(&regions.scale);
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

    /// Length of the scratch memory of [`Self::locate`].
    pub(crate) fn scratch(&self) -> usize {
        let width = if let CellRule::Linear(linear) = &self.rule {
            linear.width
        } else {
            0
        };
        2 * self.centre.len() + width
    }

    /// A cell that has not been searched yet.
    pub(crate) fn nowhere(&self) -> Cell {
        Cell {
            region: 0,
            free_square: -1.0,
            reference: Aligned::new(self.slots, 0.0),
        }
    }

    /// The region of these slots; `None` where a standardised column is not a number.
    #[inline(always)]
    pub(crate) fn locate<S: Simd>(
        &self,
        simd: S,
        cell: &mut Cell,
        slots: &[f64],
        scratch: &mut [f64],
    ) -> Option<usize> {
        if scaled_square(simd, slots, &cell.reference, &self.slot_scale) < cell.free_square {
            return Some(cell.region);
        }
        self.search(cell, slots, scratch)
    }

    /// Not inlined: one search for all callers.
    fn search(&self, cell: &mut Cell, slots: &[f64], scratch: &mut [f64]) -> Option<usize> {
        pulp::Arch::new().dispatch(Search {
            cells: self,
            cell,
            slots,
            scratch,
        })
    }

    #[inline(always)]
    fn search_here<S: Simd>(
        &self,
        simd: S,
        cell: &mut Cell,
        slots: &[f64],
        scratch: &mut [f64],
    ) -> Option<usize> {
        let (z, rest) = scratch.split_at_mut(self.centre.len());
        let square = match self.consecutive {
            Some(first) => standardise(
                simd,
                &slots[first..first + z.len()],
                &self.centre,
                &self.scale,
                z,
            ),
            None => {
                let (gathered, _) = rest.split_at_mut(z.len());
                for (value, &slot) in gathered.iter_mut().zip(&self.columns) {
                    *value = slots[slot];
                }
                standardise(simd, gathered, &self.centre, &self.scale, z)
            }
        };
        let (size, scores) = (square.sqrt(), &mut rest[z.len()..]);
        if size.is_nan() {
            cell.free_square = -1.0;
            return None;
        }
        let z = &z[..self.columns.len()];
        let (region, free) = match &self.rule {
            CellRule::Whole => (0, f64::INFINITY),
            CellRule::Ball { radius } => {
                // Summed as the rule itself does it.
                let square: f64 = z.iter().map(|z| z * z).sum();
                let rounding = (z.len() + 4) as f64 * 4.0 * f64::EPSILON * (1.0 + size + radius);
                (
                    usize::from(square > radius * radius),
                    (size - radius).abs() - rounding,
                )
            }
            CellRule::Linear(linear) => linear.search(simd, z, size, scores),
        };
        cell.region = region;
        // Beyond this radius the bound on rounding would not hold; distances are computed to a few parts in 1e16 themselves.
        let free = free.min(1.0 + size) * (1.0 - 1e-9);
        cell.free_square = if free > 0.0 { free * free } else { -1.0 };
        cell.reference.copy_from_slice(slots);
        Some(region)
    }
}

/// [`Cells::search_here`] with the widest vectors of the machine.
struct Search<'a> {
    cells: &'a Cells,
    cell: &'a mut Cell,
    slots: &'a [f64],
    scratch: &'a mut [f64],
}

impl pulp::WithSimd for Search<'_> {
    type Output = Option<usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<usize> {
        self.cells
            .search_here(simd, self.cell, self.slots, self.scratch)
    }
}

impl Linear {
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
            largest_weight: 0.0,
            largest_offset: offsets.iter().fold(0.0, |a: f64, b| a.max(b.abs())),
        };
        linear.offsets[..count].copy_from_slice(offsets);
        for (i, row) in weights.iter().enumerate() {
            for (column, &weight) in row.iter().enumerate() {
                linear.weights[column * width + i] = weight;
            }
            linear.largest_weight = linear
                .largest_weight
                .max(row.iter().map(|w| w * w).sum::<f64>().sqrt());
            for (j, other) in weights.iter().enumerate() {
                let distance = row
                    .iter()
                    .zip(other)
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum::<f64>()
                    .sqrt();
                // Equal weights: the order of the two never changes. The region itself, whose lead is nothing but the
                // rounding subtracted from 0, is no rival.
                linear.nearness[i * width + j] = match distance {
                    _ if i == j => f64::NEG_INFINITY,
                    d if d > 1e-300 => 1.0 / d,
                    _ => 1e300,
                };
            }
        }
        linear
    }

    /// The region and the distance in z within which no other can win.
    ///
    /// While `z` moves by d, the lead of region i over j changes by at most `|w_i - w_j| d`.
    #[inline(always)]
    fn search<S: Simd>(&self, simd: S, z: &[f64], size: f64, scores: &mut [f64]) -> (usize, f64) {
        affine(&self.weights, &self.offsets, z, scores);
        let (top, region) = argmax(simd, scores, &self.indices);
        // Rounding of two scores within the largest radius that is allowed, 1 + |z|.
        let terms = (z.len() + 4) as f64;
        let rounding = f64::MIN_POSITIVE
            + 4.0
                * terms
                * f64::EPSILON
                * (self.largest_offset + self.largest_weight * (2.0 * size + 1.0));
        let nearness = &self.nearness[region * self.width..][..self.width];
        (region, smallest_lead(simd, top, rounding, scores, nearness))
    }
}
