//! Layout of a piecewise-affine model for the fast path.

use fleetfoot_library::{Expr, Node, Unary};
use fleetfoot_model::{Equation, Model};

use crate::{
    Simulator,
    affine_kernel::{AffineKernel, Beyond, Side},
    aligned::Aligned,
    cell::Cells,
    compiled::Latents,
    kernel::{LANES, padded},
};

/// One slot, while they are being collected.
#[derive(Clone, Copy, PartialEq)]
enum Slot {
    Column(usize),
    Cosine(usize),
    Sine(usize),
}

struct Slots<'a> {
    simulator: &'a Simulator,
    width: usize,
    others: Vec<Slot>,
}

impl Slots<'_> {
    /// The slot of a plain column, cosine or sine at the present row; `None` for any other expression.
    fn of(&mut self, expression: &Expr) -> Option<usize> {
        let column =
            |expr: &Expr| self.simulator.columns.iter().position(|name| Some(name.as_str()) == expr.as_column());
        let slot = match expression.node() {
            Node::Unary(Unary::Cos, angle) => Slot::Cosine(column(angle)?),
            Node::Unary(Unary::Sin, angle) => Slot::Sine(column(angle)?),
            _ => Slot::Column(column(expression)?),
        };
        if let Slot::Cosine(angle) | Slot::Sine(angle) = slot {
            // The angle needs a slot itself, in front of its cosine and sine.
            self.find(Slot::Column(angle));
        }
        Some(self.find(slot))
    }

    fn find(&mut self, slot: Slot) -> usize {
        if let Slot::Column(column) = slot
            && let Some(state) = self.simulator.states.iter().position(|state| state.column == column)
        {
            return state;
        }
        let other = self.others.iter().position(|&known| known == slot).unwrap_or_else(|| {
            self.others.push(slot);
            self.others.len() - 1
        });
        self.width + other
    }
}

impl AffineKernel {
    /// The kernel of a simulator's model; `None` where the model needs the general path.
    pub(crate) fn new(model: &Model, simulator: &Simulator, equations: &[&Equation]) -> Option<Self> {
        let compiled = &simulator.compiled;
        if compiled.partitions.len() > 1
            || !compiled.groups.iter().all(Latents::is_affine)
            || simulator.states.iter().any(|state| state.advance.lag.is_some())
            || !simulator.geometry.groups.is_empty()
        {
            return None;
        }
        let states = simulator.states.len();
        let width = padded(states);
        let mut slots = Slots { simulator, width, others: Vec::new() };
        let mut columns = Vec::new();
        if let Some(regions) = compiled.partitions.first() {
            for expression in &model.partitions[regions.partition].columns {
                columns.push(slots.of(expression)?);
            }
        }
        let terms = Terms::new(model, simulator, equations, &mut slots)?;
        let slot_count = padded(width + slots.others.len());
        let cells = Cells::new(compiled.partitions.first(), &columns, slot_count)?;
        let mut kernel = Self {
            states,
            width,
            slots: slot_count,
            recorded: Vec::new(),
            circular: Vec::new(),
            rows: terms.rows,
            terms: (!terms.dense).then(|| terms.slots.iter().map(|&slot| slot as u32).collect()),
            matrices: Aligned::new(cells.count() * terms.rows * width, 0.0),
            constants: Aligned::new(cells.count() * width, 0.0),
            keep: Aligned::new(width, 0.0),
            continuous: Aligned::new(width, 0.0),
            angles: (0..states).filter(|&s| simulator.states[s].advance.angle).collect(),
            low: Aligned::new(cells.count() * slot_count, f64::NEG_INFINITY),
            high: Aligned::new(cells.count() * slot_count, f64::INFINITY),
            beyond: terms.beyond(simulator),
            cells,
        };
        for (i, slot) in slots.others.clone().into_iter().enumerate() {
            match slot {
                Slot::Column(column) => kernel.recorded.push((width + i, column)),
                Slot::Cosine(column) => kernel.circular.push((width + i, true, slots.find(Slot::Column(column)))),
                Slot::Sine(column) => kernel.circular.push((width + i, false, slots.find(Slot::Column(column)))),
            }
        }
        for (s, state) in simulator.states.iter().enumerate() {
            kernel.keep[s] = state.advance.keep;
            kernel.continuous[s] = f64::from(u8::from(state.advance.continuous));
        }
        for region in 0..kernel.cells.count() {
            kernel.fill(simulator, &terms, region);
            kernel.fill_ranges(simulator, &terms, region);
        }
        Some(kernel)
    }

    /// Lays out the coefficients of the right sides in a region.
    fn fill(&mut self, simulator: &Simulator, terms: &Terms, region: usize) {
        let (width, rows) = (self.width, self.rows);
        let matrix = &mut self.matrices[region * rows * width..][..rows * width];
        let constants = &mut self.constants[region * width..][..width];
        for (s, side) in terms.sides.iter().enumerate() {
            match *side {
                Side::Number(value) => constants[s] = value,
                Side::Slot(slot) => {
                    let term = terms.slots.iter().position(|&known| known == slot).unwrap_or(0);
                    matrix[terms.row(term) * width + s] = 1.0;
                }
                Side::Latent { group, column } => {
                    let latents = &simulator.compiled.groups[group];
                    let kept = latents.kept.len();
                    constants[s] = latents.constants[region * latents.width + column];
                    for j in 0..kept {
                        let coefficient = latents.matrices[(region * kept + j) * latents.width + column];
                        matrix[terms.row(terms.first[group] + j) * width + s] = coefficient;
                    }
                }
            }
        }
    }

    /// Lays out a region's training ranges by slot.
    fn fill_ranges(&mut self, simulator: &Simulator, terms: &Terms, region: usize) {
        for (group, &first) in simulator.compiled.groups.iter().zip(&terms.first) {
            let Some(ranges) = &group.ranges else { continue };
            for j in 0..group.kept.len() {
                let to = region * self.slots + terms.slots[first + j];
                self.low[to] = self.low[to].max(ranges.low[region * ranges.width + j]);
                self.high[to] = self.high[to].min(ranges.high[region * ranges.width + j]);
            }
        }
    }
}

/// The terms of the affine maps: first the functions of every group of latents, then columns that are right sides themselves.
struct Terms {
    /// Slot of each term.
    slots: Vec<usize>,
    /// First term of each group of latents.
    first: Vec<usize>,
    sides: Vec<Side>,
    /// True if a matrix has a row for every slot up to the last, instead of one for every term. The terms are then in
    /// the order of the slots, and need no index.
    dense: bool,
    rows: usize,
}

impl Terms {
    fn new(model: &Model, simulator: &Simulator, equations: &[&Equation], slots: &mut Slots<'_>) -> Option<Self> {
        let (mut terms, mut first) = (Vec::new(), Vec::new());
        for group in &simulator.compiled.groups {
            first.push(terms.len());
            for &function in &group.kept {
                terms.push(slots.of(&model.libraries[group.library][function])?);
            }
        }
        let sides = right_sides(model, simulator, equations, slots)?;
        for side in &sides {
            if let Side::Slot(slot) = side
                && !terms.contains(slot)
            {
                terms.push(*slot);
            }
        }
        let ascending = terms.windows(2).all(|pair| pair[0] < pair[1]);
        let all = terms.last().map_or(0, |last| last + 1);
        let dense = ascending && all <= terms.len() + terms.len() / 4 + LANES;
        let rows = if dense { all } else { terms.len() };
        Some(Self { slots: terms, first, sides, dense, rows })
    }

    /// Places of its values outside of the training ranges, for a model with slopes of its own there.
    fn beyond(&self, simulator: &Simulator) -> Option<Beyond> {
        let groups = &simulator.compiled.groups;
        let slots = |(group, &first): (&Latents, &usize)| self.slots[first..first + group.kept.len()].to_vec();
        groups.iter().any(|group| group.beyond.is_some()).then(|| Beyond {
            functions: groups.iter().zip(&self.first).map(slots).collect(),
            sides: self.sides.clone(),
        })
    }

    /// The matrix row of a term.
    fn row(&self, term: usize) -> usize {
        if self.dense { self.slots[term] } else { term }
    }
}

fn right_sides(
    model: &Model,
    simulator: &Simulator,
    equations: &[&Equation],
    slots: &mut Slots<'_>,
) -> Option<Vec<Side>> {
    equations
        .iter()
        .map(|equation| {
            if let Some(value) = equation.right.as_number() {
                return Some(Side::Number(value));
            }
            let name = equation.right.as_column();
            let is_column = simulator.columns.iter().any(|column| Some(column.as_str()) == name);
            if name.is_none() || is_column {
                return slots.of(&equation.right).map(Side::Slot);
            }
            let latent = model.latents.iter().position(|latent| Some(latent.name.as_str()) == name)?;
            simulator.compiled.groups.iter().enumerate().find_map(|(group, latents)| {
                latents.slots.iter().position(|&slot| slot == latent).map(|column| Side::Latent { group, column })
            })
        })
        .collect()
}
