//! The fast path of rollouts: piecewise-affine models on plain columns, their cosines and sines.
//!
//! Coefficients and centroids are padded and stored so that one vector holds several outputs or regions. A few trajectories
//! advance together: their regions' coefficients stay in first-level cache, and the processor overlaps their dependency chains. The
//! step loop allocates nothing, and gives the bits of the general path.
//!
//! Most steps do not search their region. A search also finds how far the state may move before any other region can win
//! (the distance to the nearest border of the cell, less what rounding could do); until it has moved that far, the region is known.

use pulp::Simd;

use crate::{
    End, Method, Simulator, Trajectory,
    affine_kernel::AffineKernel,
    aligned::Aligned,
    angle::wrap,
    cell::Cell,
    controller::Drive,
    integrate::{advance, runge_kutta_mean},
    kernel::{LANES, affine, copy, load, near, within},
    run::Run,
};

/// Trajectories that advance together.
const TOGETHER: usize = 8;

impl AffineKernel {
    /// Simulates complete windows, a few at a time.
    pub(crate) fn simulate(&self, simulator: &Simulator, runs: &[Run<'_>], method: Method) -> Vec<Trajectory> {
        let mut done = Vec::with_capacity(runs.len());
        for runs in runs.chunks(TOGETHER) {
            let mut tracks: Vec<Track<'_>> = runs.iter().map(|run| Track::new(self, simulator, run)).collect();
            pulp::Arch::new().dispatch(Advancing { kernel: self, tracks: &mut tracks, method });
            done.extend(tracks.into_iter().map(|track| track.finish(self.states)));
        }
        done
    }

    #[inline(always)]
    fn advance<S: Simd>(&self, simd: S, tracks: &mut [Track<'_>], method: Method) {
        let horizon = tracks.iter().map(|track| track.run.horizon).max().unwrap_or(0);
        let mut scratch = Scratch::new(self);
        let mut lost = Vec::with_capacity(tracks.len());
        for k in 0..horizon {
            lost.clear();
            for (b, track) in tracks.iter().enumerate() {
                if track.end == End::Horizon && self.cells.has_left(simd, &track.cell, &track.slots) {
                    lost.push(b);
                }
            }
            for &b in &lost {
                let track = &mut tracks[b];
                self.cells.standardise(simd, &mut track.cell, &track.slots);
            }
            for &b in &lost {
                self.cells.score(&mut tracks[b].cell);
            }
            for &b in &lost {
                self.cells.choose(simd, &mut tracks[b].cell);
            }
            for &b in &lost {
                self.cells.release(simd, &mut tracks[b].cell);
            }
            for track in tracks.iter_mut().filter(|track| track.end == End::Horizon) {
                self.step(simd, track, k, method, &mut scratch);
            }
        }
    }

    /// One step of one trajectory, whose cell is known.
    #[inline(always)]
    fn step<S: Simd>(&self, simd: S, track: &mut Track<'_>, k: usize, method: Method, scratch: &mut Scratch) {
        let Some(region) = self.cells.region(&track.cell) else {
            track.end = End::NoRegion;
            return;
        };
        if track.left.is_none() {
            let at = region * self.slots;
            let (low, high) = (&self.low[at..at + self.slots], &self.high[at..at + self.slots]);
            if !within(simd, &track.slots, low, high) {
                track.left = Some(k);
                if track.run.ends_outside {
                    track.end = End::LeftDomain;
                    return;
                }
            }
        }
        let seconds = track.run.step(k);
        self.slope(region, &track.slots, &mut scratch.slope);
        if method == Method::Rk4 {
            self.refine(simd, track, seconds, scratch);
        }
        for from in (0..self.width).step_by(LANES) {
            let mut x = load::<LANES>(&track.slots[from..]);
            let f = load::<LANES>(&scratch.slope[from..]);
            let keep = load::<LANES>(&self.keep[from..]);
            let continuous = load::<LANES>(&self.continuous[from..]);
            for i in 0..LANES {
                let gain = if continuous[i] > 0.0 { seconds } else { 1.0 };
                x[i] = advance(keep[i], gain, x[i], f[i]);
            }
            track.slots[from..from + LANES].copy_from_slice(&x);
        }
        if !near(simd, &track.slots[..self.width], &track.first, &track.limit) {
            track.end = End::Diverged;
            return;
        }
        for &angle in &self.angles {
            track.slots[angle] = wrap(track.slots[angle]);
        }
        // Long before the next step reads them: a wide load that needs a narrow store just made would wait for it.
        self.prepare(track, k + 1);
        track.regions.push(region as u32);
        let (chunks, rest) = track.slots[..self.states].as_chunks::<LANES>();
        for chunk in chunks {
            track.states.extend_from_slice(chunk);
        }
        track.states.extend_from_slice(rest);
    }

    /// Fills the slots that are not states for step `k`.
    #[inline(always)]
    fn prepare(&self, track: &mut Track<'_>, k: usize) {
        for (&(slot, _), values) in self.recorded.iter().zip(&track.recorded) {
            if let Some(&value) = values.get(k) {
                track.slots[slot] = value;
            }
        }
        if let Some(drive) = &mut track.drive
            && k < track.run.horizon
        {
            drive.step(k, track.run.time[k], |state| track.slots[state]);
            for &(slot, input) in &track.driven {
                track.slots[slot] = drive.inputs[input];
            }
        }
        self.turn(&mut track.slots);
    }

    /// Cosines and sines of the angles among the slots.
    #[inline(always)]
    fn turn(&self, slots: &mut [f64]) {
        for &(slot, cosine, angle) in &self.circular {
            slots[slot] = if cosine { slots[angle].cos() } else { slots[angle].sin() };
        }
    }

    /// The right sides in a region.
    #[inline(always)]
    fn slope(&self, region: usize, slots: &[f64], out: &mut [f64]) {
        let length = self.rows * self.width;
        let matrix = &self.matrices[region * length..][..length];
        let constants = &self.constants[region * self.width..][..self.width];
        match &self.terms {
            // One row a slot.
            None => affine(matrix, constants, &slots[..self.rows], out),
            Some(terms) => {
                for from in (0..self.width).step_by(LANES) {
                    let mut sum = load::<LANES>(&constants[from..]);
                    for (row, &term) in matrix.chunks_exact(self.width).zip(terms) {
                        let (row, feature) = (load::<LANES>(&row[from..]), slots[term as usize]);
                        for i in 0..LANES {
                            sum[i] = row[i].mul_add(feature, sum[i]);
                        }
                    }
                    out[from..from + LANES].copy_from_slice(&sum);
                }
            }
        }
    }

    /// Replaces the slopes of the continuous states by the mean of the four Runge-Kutta stages.
    #[inline(always)]
    fn refine<S: Simd>(&self, simd: S, track: &mut Track<'_>, seconds: f64, scratch: &mut Scratch) {
        let Scratch { slope, stages, slots, .. } = scratch;
        copy::<S>(slope, &mut stages[0]);
        for stage in 1..4 {
            let offset = if stage == 3 { seconds } else { seconds * 0.5 };
            copy::<S>(&track.slots, slots);
            for from in (0..self.width).step_by(LANES) {
                let mut x = load::<LANES>(&track.slots[from..]);
                let slope = load::<LANES>(&stages[stage - 1][from..]);
                let continuous = load::<LANES>(&self.continuous[from..]);
                for i in 0..LANES {
                    x[i] = offset.mul_add(if continuous[i] > 0.0 { slope[i] } else { 0.0 }, x[i]);
                }
                slots[from..from + LANES].copy_from_slice(&x);
            }
            self.turn(slots);
            if self.cells.has_left(simd, &track.cell, slots) {
                self.cells.search(simd, &mut track.cell, slots);
            }
            match self.cells.region(&track.cell) {
                Some(region) => self.slope(region, slots, &mut stages[stage]),
                None => stages[stage].fill(f64::NAN),
            }
        }
        for s in 0..self.width {
            let mean = runge_kutta_mean([stages[0][s], stages[1][s], stages[2][s], stages[3][s]]);
            slope[s] = if self.continuous[s] > 0.0 { mean } else { slope[s] };
        }
    }
}

/// [`AffineKernel::advance`] with the widest vectors of the machine.
struct Advancing<'a, 'b> {
    kernel: &'a AffineKernel,
    tracks: &'a mut [Track<'b>],
    method: Method,
}

impl pulp::WithSimd for Advancing<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.kernel.advance(simd, self.tracks, self.method);
    }
}

/// Memory of the step loop.
struct Scratch {
    slope: Aligned,
    stages: [Aligned; 4],
    slots: Aligned,
}

impl Scratch {
    fn new(kernel: &AffineKernel) -> Self {
        Self {
            slope: Aligned::new(kernel.width, 0.0),
            stages: std::array::from_fn(|_| Aligned::new(kernel.width, 0.0)),
            slots: Aligned::new(kernel.slots, 0.0),
        }
    }
}

/// One trajectory on its way.
struct Track<'a> {
    run: &'a Run<'a>,
    slots: Aligned,
    first: Aligned,
    /// How far each slot may go from the first.
    limit: Aligned,
    cell: Cell,
    recorded: Vec<&'a [f64]>,
    drive: Option<Drive<'a>>,
    /// Slots of driven inputs, and which.
    driven: Vec<(usize, usize)>,
    states: Vec<f64>,
    regions: Vec<u32>,
    end: End,
    left: Option<usize>,
}

impl<'a> Track<'a> {
    fn new(kernel: &AffineKernel, simulator: &'a Simulator, run: &'a Run<'a>) -> Self {
        let mut slots = Aligned::new(kernel.slots, 0.0);
        for (slot, state) in slots.iter_mut().zip(&simulator.states) {
            *slot = run.window.values(state.column, 0, 1)[0];
        }
        let mut limit = Aligned::new(kernel.width, f64::MAX);
        for ((limit, state), &start) in limit.iter_mut().zip(&simulator.states).zip(slots.iter()) {
            *limit = state.limit(run.divergence, start);
        }
        let drives = simulator.driver.as_ref().map_or(&[][..], |driver| &driver.drives);
        let input = |column: usize| drives.iter().position(|&(driven, _)| driven == column);
        let mut states = Vec::with_capacity((run.horizon + 1) * kernel.states);
        states.extend_from_slice(&slots[..kernel.states]);
        let mut track = Self {
            run,
            first: Aligned::from_slice(&slots[..kernel.width]),
            limit,
            cell: kernel.cells.nowhere(),
            recorded: kernel
                .recorded
                .iter()
                .map(|&(_, column)| match input(column) {
                    // The controller's business.
                    Some(_) => &[],
                    None => run.window.values(column, 0, run.horizon as i64),
                })
                .collect(),
            drive: simulator.driver.as_ref().map(|driver| driver.start(run.window, run.horizon)),
            driven: kernel
                .recorded
                .iter()
                .filter_map(|&(slot, column)| input(column).map(|input| (slot, input)))
                .collect(),
            states,
            regions: Vec::with_capacity(run.horizon),
            end: End::Horizon,
            left: None,
            slots,
        };
        kernel.prepare(&mut track, 0);
        track
    }

    fn finish(self, states: usize) -> Trajectory {
        debug_assert_eq!(self.states.len(), (self.regions.len() + 1) * states);
        Trajectory {
            start: self.run.start,
            time: self.run.time[..=self.regions.len()].to_vec(),
            states: self.states,
            inputs: self.drive.map_or_else(Vec::new, |drive| drive.finish(self.regions.len())),
            regions: self.regions,
            end: self.end,
            left_domain: self.left,
        }
    }
}
