//! The fast path of rollouts: piecewise-affine models on plain columns, their cosines and sines.
//!
//! Coefficients and centroids are padded and stored so that one vector holds several outputs or regions. A few trajectories
//! advance together: their regions' coefficients stay in first-level cache, and the processor overlaps their dependency chains. The
//! step loop allocates nothing, and gives the bits of the general path.
//!
//! Most steps do not search their region. A search also finds how far the state may move before any other region can win
//! (the distance to the nearest border of the cell, less what rounding could do); until it has moved that far, the region is known.

use fleetfoot_library::{Expr, Node, Unary};
use fleetfoot_model::{Equation, Model};

use crate::{
    End, Method, Simulator, Trajectory,
    angle::wrap,
    cell::{Cell, Cells},
    integrate::{advance, runge_kutta_mean},
    kernel::{LANES, load, padded, within},
    simulator::Run,
};

/// Trajectories that advance together.
const TOGETHER: usize = 8;

/// A piecewise-affine model laid out for stepping.
///
/// A trajectory's values stand in **slots**: the states first (padded), then the recorded columns in use, cosines and sines.
pub(crate) struct AffineKernel {
    states: usize,
    /// Padded number of states.
    width: usize,
    slots: usize,
    /// Recorded columns: slot, column of the model.
    recorded: Vec<(usize, usize)>,
    /// Cosines and sines: slot, whether cosine, slot of the angle.
    circular: Vec<(usize, bool, usize)>,
    cells: Cells,
    /// Slot of each term of the affine maps.
    terms: Vec<u32>,
    /// Per region: terms x width.
    matrices: Vec<f64>,
    /// Per region: width.
    constants: Vec<f64>,
    /// Per state: the factor of the state itself.
    keep: Vec<f64>,
    /// Per state: 1 where the step length multiplies the right side, else 0.
    continuous: Vec<f64>,
    angles: Vec<usize>,
    /// Per region: ranges by slot.
    low: Vec<f64>,
    high: Vec<f64>,
}

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
        let column = |expr: &Expr| {
            self.simulator
                .columns
                .iter()
                .position(|name| Some(name.as_str()) == expr.as_column())
        };
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
            && let Some(state) = self
                .simulator
                .states
                .iter()
                .position(|state| state.column == column)
        {
            return state;
        }
        let other = self
            .others
            .iter()
            .position(|&known| known == slot)
            .unwrap_or_else(|| {
                self.others.push(slot);
                self.others.len() - 1
            });
        self.width + other
    }
}

impl AffineKernel {
    /// The kernel of a simulator's model; `None` where the model needs the general path.
    pub(crate) fn new(
        model: &Model,
        simulator: &Simulator,
        equations: &[&Equation],
    ) -> Option<Self> {
        let compiled = &simulator.compiled;
        if compiled.partitions.len() > 1 {
            return None;
        }
        let states = simulator.states.len();
        let width = padded(states);
        let mut slots = Slots {
            simulator,
            width,
            others: Vec::new(),
        };
        let mut columns = Vec::new();
        if let Some(regions) = compiled.partitions.first() {
            for expression in &model.partitions[regions.partition].columns {
                columns.push(slots.of(expression)?);
            }
        }
        let mut terms: Vec<usize> = Vec::new();
        let mut first_term = Vec::new();
        for group in &compiled.groups {
            first_term.push(terms.len());
            for &function in &group.kept {
                terms.push(slots.of(&model.libraries[group.library][function])?);
            }
        }
        let sides = right_sides(model, simulator, equations, &mut slots)?;
        for side in &sides {
            if let Side::Slot(slot) = side
                && !terms.contains(slot)
            {
                terms.push(*slot);
            }
        }
        let slot_count = padded(width + slots.others.len());
        let others = std::mem::take(&mut slots.others);
        let slot_of = |slot: Slot| {
            Slots {
                simulator,
                width,
                others: others.clone(),
            }
            .find(slot)
        };
        let recorded = others
            .iter()
            .enumerate()
            .filter_map(|(i, slot)| match slot {
                Slot::Column(column) => Some((width + i, *column)),
                _ => None,
            });
        let circular = others
            .iter()
            .enumerate()
            .filter_map(|(i, slot)| match *slot {
                Slot::Cosine(column) => Some((width + i, true, slot_of(Slot::Column(column)))),
                Slot::Sine(column) => Some((width + i, false, slot_of(Slot::Column(column)))),
                Slot::Column(_) => None,
            });
        let mut kernel = Self {
            states,
            width,
            slots: slot_count,
            recorded: recorded.collect(),
            circular: circular.collect(),
            cells: Cells::new(compiled.partitions.first(), &columns, slot_count)?,
            terms: terms.iter().map(|&slot| slot as u32).collect(),
            matrices: Vec::new(),
            constants: Vec::new(),
            keep: vec![0.0; width],
            continuous: vec![0.0; width],
            angles: (0..states)
                .filter(|&s| simulator.states[s].advance.angle)
                .collect(),
            low: Vec::new(),
            high: Vec::new(),
        };
        for (s, state) in simulator.states.iter().enumerate() {
            kernel.keep[s] = state.advance.keep;
            kernel.continuous[s] = f64::from(u8::from(state.advance.continuous));
        }
        kernel.fill(simulator, &sides, &terms, &first_term);
        kernel.fill_ranges(simulator, &terms, &first_term);
        Some(kernel)
    }

    /// Lays out the coefficients of the right sides.
    fn fill(
        &mut self,
        simulator: &Simulator,
        sides: &[Side],
        terms: &[usize],
        first_term: &[usize],
    ) {
        let regions = self.cells.count();
        let (width, count) = (self.width, terms.len());
        self.matrices = vec![0.0; regions * count * width];
        self.constants = vec![0.0; regions * width];
        for (s, side) in sides.iter().enumerate() {
            for region in 0..regions {
                match *side {
                    Side::Number(value) => self.constants[region * width + s] = value,
                    Side::Slot(slot) => {
                        let term = terms.iter().position(|&known| known == slot).unwrap_or(0);
                        self.matrices[(region * count + term) * width + s] = 1.0;
                    }
                    Side::Latent { group, column } => {
                        let latents = &simulator.compiled.groups[group];
                        let (kept, from) = (latents.kept.len(), first_term[group]);
                        self.constants[region * width + s] =
                            latents.constants[region * latents.width + column];
                        for j in 0..kept {
                            self.matrices[(region * count + from + j) * width + s] =
                                latents.matrices[(region * kept + j) * latents.width + column];
                        }
                    }
                }
            }
        }
    }

    /// Lays out the training ranges by slot.
    fn fill_ranges(&mut self, simulator: &Simulator, terms: &[usize], first_term: &[usize]) {
        let regions = self.cells.count();
        self.low = vec![f64::NEG_INFINITY; regions * self.slots];
        self.high = vec![f64::INFINITY; regions * self.slots];
        let Some(ranges) = &simulator.ranges else {
            return;
        };
        for region in 0..regions {
            for j in 0..simulator.compiled.groups[ranges.group].kept.len() {
                let to = region * self.slots + terms[first_term[ranges.group] + j];
                self.low[to] = self.low[to].max(ranges.low[region * ranges.width + j]);
                self.high[to] = self.high[to].min(ranges.high[region * ranges.width + j]);
            }
        }
    }

    /// Simulates complete windows, a few at a time.
    pub(crate) fn simulate(
        &self,
        simulator: &Simulator,
        runs: &[Run<'_>],
        limits: &[f64],
        method: Method,
    ) -> Vec<Trajectory> {
        let mut limit = vec![f64::MAX; self.width];
        limit[..limits.len()].copy_from_slice(limits);
        let mut done = Vec::with_capacity(runs.len());
        for runs in runs.chunks(TOGETHER) {
            let mut tracks: Vec<Track<'_>> = runs
                .iter()
                .map(|run| Track::new(self, simulator, run))
                .collect();
            pulp::Arch::new().dispatch(Advancing {
                kernel: self,
                tracks: &mut tracks,
                limit: &limit,
                method,
            });
            done.extend(tracks.into_iter().map(|track| track.finish(self.states)));
        }
        done
    }

    #[inline(always)]
    fn advance(&self, tracks: &mut [Track<'_>], limit: &[f64], method: Method) {
        let horizon = tracks
            .iter()
            .map(|track| track.run.horizon)
            .max()
            .unwrap_or(0);
        let mut scratch = Scratch::new(self);
        for k in 0..horizon {
            for track in tracks.iter_mut() {
                if track.end == End::Horizon {
                    self.step(track, k, limit, method, &mut scratch);
                }
            }
        }
    }

    /// One step of one trajectory.
    #[inline(always)]
    fn step(
        &self,
        track: &mut Track<'_>,
        k: usize,
        limit: &[f64],
        method: Method,
        scratch: &mut Scratch,
    ) {
        for (&(slot, _), values) in self.recorded.iter().zip(&track.recorded) {
            track.slots[slot] = values[k];
        }
        self.turn(&mut track.slots);
        let region = match self
            .cells
            .locate(&mut track.cell, &track.slots, &mut scratch.cells)
        {
            Some(region) => region,
            None => {
                track.end = End::NoRegion;
                return;
            }
        };
        if track.left.is_none() {
            let at = region * self.slots;
            let (low, high) = (
                &self.low[at..at + self.slots],
                &self.high[at..at + self.slots],
            );
            if !within(&track.slots, low, high) {
                track.left = Some(k);
            }
        }
        let seconds = track.seconds(k);
        self.slope(region, &track.slots, &mut scratch.slope);
        if method == Method::Rk4 {
            self.refine(track, seconds, scratch);
        }
        let Scratch { slope, next, .. } = scratch;
        let mut near = true;
        for from in (0..self.width).step_by(LANES) {
            let x = load::<LANES>(&track.slots[from..]);
            let f = load::<LANES>(&slope[from..]);
            let keep = load::<LANES>(&self.keep[from..]);
            let continuous = load::<LANES>(&self.continuous[from..]);
            let (x0, limit) = (
                load::<LANES>(&track.first[from..]),
                load::<LANES>(&limit[from..]),
            );
            let mut out = [0.0; LANES];
            for i in 0..LANES {
                let gain = if continuous[i] > 0.0 { seconds } else { 1.0 };
                out[i] = advance(keep[i], gain, x[i], f[i]);
            }
            for i in 0..LANES {
                near &= (out[i] - x0[i]).abs() <= limit[i];
            }
            next[from..from + LANES].copy_from_slice(&out);
        }
        if !near {
            track.end = End::Diverged;
            return;
        }
        for &angle in &self.angles {
            next[angle] = wrap(next[angle]);
        }
        track.slots[..self.width].copy_from_slice(next);
        track.regions.push(region as u32);
        track.states.extend_from_slice(&next[..self.states]);
    }

    /// Cosines and sines of the angles among the slots.
    #[inline(always)]
    fn turn(&self, slots: &mut [f64]) {
        for &(slot, cosine, angle) in &self.circular {
            slots[slot] = if cosine {
                slots[angle].cos()
            } else {
                slots[angle].sin()
            };
        }
    }

    /// The right sides in a region.
    #[inline(always)]
    fn slope(&self, region: usize, slots: &[f64], out: &mut [f64]) {
        let length = self.terms.len() * self.width;
        let matrix = &self.matrices[region * length..][..length];
        let constants = &self.constants[region * self.width..][..self.width];
        let mut from = 0;
        while from + 2 * LANES <= self.width {
            self.panel::<{ 2 * LANES }>(matrix, constants, slots, from, out);
            from += 2 * LANES;
        }
        if from < self.width {
            self.panel::<LANES>(matrix, constants, slots, from, out);
        }
    }

    #[inline(always)]
    fn panel<const N: usize>(
        &self,
        matrix: &[f64],
        constants: &[f64],
        slots: &[f64],
        from: usize,
        out: &mut [f64],
    ) {
        let mut sum = load::<N>(&constants[from..]);
        for (row, &term) in matrix.chunks_exact(self.width).zip(&self.terms) {
            let (row, feature) = (load::<N>(&row[from..]), slots[term as usize]);
            for i in 0..N {
                sum[i] = row[i].mul_add(feature, sum[i]);
            }
        }
        out[from..from + N].copy_from_slice(&sum);
    }

    /// Replaces the slopes of the continuous states by the mean of the four Runge-Kutta stages.
    #[inline(always)]
    fn refine(&self, track: &mut Track<'_>, seconds: f64, scratch: &mut Scratch) {
        let Scratch {
            slope,
            stages,
            slots,
            cells,
            ..
        } = scratch;
        stages[0].copy_from_slice(slope);
        for stage in 1..4 {
            let offset = if stage == 3 { seconds } else { seconds * 0.5 };
            slots.copy_from_slice(&track.slots);
            for s in 0..self.states {
                let slope = if self.continuous[s] > 0.0 {
                    stages[stage - 1][s]
                } else {
                    0.0
                };
                slots[s] = offset.mul_add(slope, track.slots[s]);
            }
            self.turn(slots);
            match self.cells.locate(&mut track.cell, slots, cells) {
                Some(region) => self.slope(region, slots, &mut stages[stage]),
                None => stages[stage].fill(f64::NAN),
            }
        }
        for s in 0..self.states {
            if self.continuous[s] > 0.0 {
                slope[s] =
                    runge_kutta_mean([stages[0][s], stages[1][s], stages[2][s], stages[3][s]]);
            }
        }
    }
}

/// [`AffineKernel::advance`] with the widest vectors of the machine.
struct Advancing<'a, 'b> {
    kernel: &'a AffineKernel,
    tracks: &'a mut [Track<'b>],
    limit: &'a [f64],
    method: Method,
}

impl pulp::WithSimd for Advancing<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.kernel.advance(self.tracks, self.limit, self.method);
    }
}

/// Memory of the step loop.
struct Scratch {
    slope: Vec<f64>,
    next: Vec<f64>,
    stages: [Vec<f64>; 4],
    slots: Vec<f64>,
    cells: Vec<f64>,
}

impl Scratch {
    fn new(kernel: &AffineKernel) -> Self {
        Self {
            slope: vec![0.0; kernel.width],
            next: vec![0.0; kernel.width],
            stages: std::array::from_fn(|_| vec![0.0; kernel.width]),
            slots: vec![0.0; kernel.slots],
            cells: vec![0.0; kernel.cells.scratch()],
        }
    }
}

/// One trajectory on its way.
struct Track<'a> {
    run: &'a Run<'a>,
    slots: Vec<f64>,
    first: Vec<f64>,
    cell: Cell,
    recorded: Vec<&'a [f64]>,
    states: Vec<f64>,
    regions: Vec<u32>,
    end: End,
    left: Option<usize>,
}

impl<'a> Track<'a> {
    fn new(kernel: &AffineKernel, simulator: &Simulator, run: &'a Run<'a>) -> Self {
        let mut slots = vec![0.0; kernel.slots];
        for (slot, state) in slots.iter_mut().zip(&simulator.states) {
            *slot = run.window.values(state.column, 0, 1)[0];
        }
        let mut states = Vec::with_capacity((run.horizon + 1) * kernel.states);
        states.extend_from_slice(&slots[..kernel.states]);
        Self {
            run,
            first: slots[..kernel.width].to_vec(),
            cell: kernel.cells.nowhere(),
            recorded: kernel
                .recorded
                .iter()
                .map(|&(_, column)| run.window.values(column, 0, run.horizon as i64))
                .collect(),
            states,
            regions: Vec::with_capacity(run.horizon),
            end: End::Horizon,
            left: None,
            slots,
        }
    }

    #[inline(always)]
    fn seconds(&self, k: usize) -> f64 {
        self.run.step(k)
    }

    fn finish(self, states: usize) -> Trajectory {
        debug_assert_eq!(self.states.len(), (self.regions.len() + 1) * states);
        Trajectory {
            start: self.run.start,
            time: self.run.time[..=self.regions.len()].to_vec(),
            states: self.states,
            regions: self.regions,
            end: self.end,
            left_domain: self.left,
        }
    }
}

/// The right side of an equation.
enum Side {
    Number(f64),
    Slot(usize),
    Latent { group: usize, column: usize },
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
            let is_column = simulator
                .columns
                .iter()
                .any(|column| Some(column.as_str()) == name);
            if name.is_none() || is_column {
                return slots.of(&equation.right).map(Side::Slot);
            }
            let latent = model
                .latents
                .iter()
                .position(|latent| Some(latent.name.as_str()) == name)?;
            simulator
                .compiled
                .groups
                .iter()
                .enumerate()
                .find_map(|(group, latents)| {
                    latents
                        .slots
                        .iter()
                        .position(|&slot| slot == latent)
                        .map(|column| Side::Latent { group, column })
                })
        })
        .collect()
}
