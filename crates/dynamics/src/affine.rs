//! The fast path of rollouts: piecewise-affine models on plain columns, their cosines and sines.
//!
//! Coefficients and centroids are padded and stored so that one vector holds several outputs or regions. A few trajectories
//! advance together: their regions' coefficients stay in first-level cache, and the processor overlaps their dependency chains. The
//! step loop allocates nothing, and gives the bits of the general path.
//!
//! Most steps do not search their region. A search also gives the distance that the state may move before any other
//! region can win: that to the nearest border of the cell, less a bound of the rounding. Within this distance, the
//! region is known.

use pulp::Simd;

use crate::{
    End, Method, Simulator, Trajectory,
    affine_kernel::{AffineKernel, Side},
    aligned::Aligned,
    angle::wrap,
    cell::Cell,
    controller::Drive,
    integrate::runge_kutta_mean,
    kernel::{LANES, advance_all, affine, copy, is_near, load, within},
    run::Run,
};

/// Trajectories that advance together.
const TOGETHER: usize = 8;

/// Trajectories whose affine maps are summed side by side.
const ABREAST: usize = 4;

impl AffineKernel {
    /// Simulates complete windows, a few at a time.
    pub(crate) fn simulate(&self, simulator: &Simulator, runs: &[Run<'_>], method: Method) -> Vec<Trajectory> {
        let mut done = Vec::with_capacity(runs.len());
        let mut cells: Vec<Cell> = (0..runs.len().min(TOGETHER)).map(|_| self.cells.nowhere()).collect();
        for runs in runs.chunks(TOGETHER) {
            let fresh = runs.iter().zip(cells.drain(..));
            let mut tracks: Vec<Track<'_>> =
                fresh.map(|(run, cell)| Track::new(self, simulator, run, cell.anew())).collect();
            fleetfoot_data::arch().dispatch(Advancing { kernel: self, simulator, tracks: &mut tracks, method });
            for track in tracks {
                let (trajectory, cell) = track.finish(self.states);
                done.push(trajectory);
                cells.push(cell);
            }
        }
        done
    }

    #[inline(always)]
    fn advance<S: Simd>(&self, simd: S, simulator: &Simulator, tracks: &mut [Track<'_>], method: Method) {
        let horizon = tracks.iter().map(|track| track.run.horizon).max().unwrap_or(0);
        let mut scratch = Scratch::new(self, tracks.len());
        let mut live: Vec<usize> = (0..tracks.len()).collect();
        let mut lost: Vec<usize> = Vec::with_capacity(tracks.len());
        for k in 0..horizon {
            lost.clear();
            for &b in &live {
                if self.cells.has_left(simd, &tracks[b].cell, &tracks[b].slots) {
                    lost.push(b);
                }
            }
            for &b in &lost {
                let track = &mut tracks[b];
                self.cells.refer::<S>(&mut track.cell, &track.slots);
                self.cells.approach(simd, &mut track.cell, &track.slots);
            }
            for &b in &lost {
                self.cells.screen(simd, &mut tracks[b].cell);
            }
            for &b in &lost {
                let track = &mut tracks[b];
                if !self.cells.is_certain(simd, &mut track.cell) {
                    self.cells.settle(simd, &mut track.cell, &track.slots);
                }
            }
            let mut ended = false;
            for &b in &live {
                ended |= !self.enter(simd, &mut tracks[b], k);
            }
            if ended {
                live.retain(|&b| tracks[b].end == End::Horizon);
            }
            self.slopes(simd, tracks, &live, &mut scratch.slopes);
            if self.beyond.is_some() {
                for &b in live.iter().filter(|&&b| tracks[b].outside) {
                    let (out, track) = (&mut scratch.slopes[b * self.width..][..self.width], &tracks[b]);
                    self.slope_beyond(simulator, track.region, &track.slots, &mut scratch.beyond, out);
                }
            }
            for &b in &live {
                ended |= !self.step(simd, simulator, &mut tracks[b], (k, b), method, &mut scratch);
            }
            if ended {
                live.retain(|&b| tracks[b].end == End::Horizon);
            }
        }
    }

    /// Notes the region of a trajectory, whose cell is known, and checks its ranges. Returns true if the trajectory
    /// goes on.
    #[inline(always)]
    fn enter<S: Simd>(&self, simd: S, track: &mut Track<'_>, k: usize) -> bool {
        let Some(region) = self.cells.region(&track.cell) else {
            track.end = End::NoRegion;
            return false;
        };
        track.region = region;
        if track.left.is_none() || self.beyond.is_some() {
            track.outside = self.is_outside(simd, region, &track.slots);
            if track.outside && track.left.is_none() {
                track.left = Some(k);
                if track.run.ends_outside {
                    track.end = End::LeftDomain;
                    return false;
                }
            }
        }
        true
    }

    /// Returns true if a slot is outside of the training range of a region.
    #[inline(always)]
    fn is_outside<S: Simd>(&self, simd: S, region: usize, slots: &[f64]) -> bool {
        let at = region * self.slots;
        !within(simd, slots, &self.low[at..at + self.slots], &self.high[at..at + self.slots])
    }

    /// The right sides of a model that goes on otherwise outside of the ranges, as the general path evaluates them.
    fn slope_beyond(
        &self,
        simulator: &Simulator,
        region: usize,
        slots: &[f64],
        (functions, excess, latents): &mut (Vec<f64>, Vec<f64>, Vec<Vec<f64>>),
        out: &mut [f64],
    ) {
        let Some(beyond) = &self.beyond else { return };
        latents.resize(beyond.functions.len(), Vec::new());
        for ((group, functions_beyond), latents) in
            simulator.compiled.groups.iter().zip(&beyond.functions).zip(&mut *latents)
        {
            functions.clear();
            functions.extend(functions_beyond.iter().map(|&slot| slots[slot]));
            excess.resize(functions.len(), 0.0);
            latents.resize(group.width, 0.0);
            group.affine(region, functions, excess, latents);
        }
        for (out, side) in out.iter_mut().zip(&beyond.sides) {
            *out = match *side {
                Side::Number(value) => value,
                Side::Slot(slot) => slots[slot],
                Side::Latent { group, column } => latents[group][column],
            };
        }
    }

    /// The right sides of some trajectories, each in its region: a row of the padded width a track.
    #[inline(always)]
    fn slopes<S: Simd>(&self, simd: S, tracks: &[Track<'_>], live: &[usize], out: &mut [f64]) {
        let (groups, rest) = live.as_chunks::<ABREAST>();
        for &group in groups {
            self.slopes_of(simd, tracks, group, out);
        }
        for &b in rest {
            self.slopes_of(simd, tracks, [b], out);
        }
    }

    /// The right sides of `G` trajectories. Each sum is a separate chain, whose order is that of [`Self::slope`]; side
    /// by side the processor overlaps them.
    #[inline(always)]
    fn slopes_of<S: Simd, const G: usize>(&self, simd: S, tracks: &[Track<'_>], group: [usize; G], out: &mut [f64]) {
        let mut from = 0;
        while from < self.width {
            if from + 2 * S::F64_LANES <= self.width {
                self.panel::<S, G, 2>(simd, tracks, group, from, out);
                from += 2 * S::F64_LANES;
            } else {
                self.panel::<S, G, 1>(simd, tracks, group, from, out);
                from += S::F64_LANES;
            }
        }
    }

    /// `V` vectors of the right sides of `G` trajectories, from one of the states on.
    #[inline(always)]
    fn panel<S: Simd, const G: usize, const V: usize>(
        &self,
        simd: S,
        tracks: &[Track<'_>],
        group: [usize; G],
        from: usize,
        out: &mut [f64],
    ) {
        let (width, length) = (self.width, self.rows * self.width);
        let mut matrices: [&[f64]; G] = [&[]; G];
        let mut slots: [&[f64]; G] = [&[]; G];
        let mut sums = [[simd.splat_f64s(0.0); V]; G];
        for g in 0..G {
            let track = &tracks[group[g]];
            slots[g] = &track.slots[..self.slots];
            matrices[g] = &self.matrices[track.region * length..][..length];
            let constants = S::as_simd_f64s(&self.constants[track.region * width + from..][..V * S::F64_LANES]).0;
            sums[g].copy_from_slice(constants);
        }
        for j in 0..self.rows {
            // One row a slot, or a row a term.
            let slot = match &self.terms {
                None => j,
                Some(terms) => terms[j] as usize,
            };
            for g in 0..G {
                let feature = simd.splat_f64s(slots[g][slot]);
                let row = S::as_simd_f64s(&matrices[g][j * width + from..][..V * S::F64_LANES]).0;
                for v in 0..V {
                    sums[g][v] = simd.mul_add_f64s(row[v], feature, sums[g][v]);
                }
            }
        }
        for g in 0..G {
            let out = &mut out[group[g] * width + from..][..V * S::F64_LANES];
            S::as_mut_simd_f64s(out).0.copy_from_slice(&sums[g]);
        }
    }

    /// One step of one trajectory, whose slopes are known. Returns true if it goes on.
    #[inline(always)]
    fn step<S: Simd>(
        &self,
        simd: S,
        simulator: &Simulator,
        track: &mut Track<'_>,
        (k, b): (usize, usize),
        method: Method,
        scratch: &mut Scratch,
    ) -> bool {
        let seconds = track.run.step(k);
        if method == Method::Rk4 {
            self.refine(simd, simulator, track, seconds, b, scratch);
        }
        let slopes = &scratch.slopes[b * self.width..][..self.width];
        if !self.move_on(simd, track, seconds, slopes) {
            track.end = End::Diverged;
            return false;
        }
        for &angle in &self.angles {
            track.slots[angle] = wrap(track.slots[angle]);
        }
        // Long before the next step reads them: a wide load that needs a narrow store just made would wait for it.
        self.prepare(track, k + 1);
        append(&mut track.regions, [track.region as u32]);
        let (chunks, rest) = track.slots[..self.states].as_chunks::<LANES>();
        for chunk in chunks {
            append(&mut track.states, *chunk);
        }
        if !rest.is_empty() {
            track.states.extend_from_slice(rest);
        }
        true
    }

    /// The states one step later, before angles are wrapped; whether they are near enough to where they began.
    #[inline(always)]
    fn move_on<S: Simd>(&self, simd: S, track: &mut Track<'_>, seconds: f64, slopes: &[f64]) -> bool {
        let (zero, one, seconds) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0), simd.splat_f64s(seconds));
        let yes = simd.less_than_or_equal_f64s(zero, zero);
        let mut inside = yes;
        let states = S::as_mut_simd_f64s(&mut track.slots[..self.width]).0;
        let (slopes, keep) = (S::as_simd_f64s(slopes).0, S::as_simd_f64s(&self.keep).0);
        let continuous = S::as_simd_f64s(&self.continuous).0;
        let (first, limit) = (S::as_simd_f64s(&track.first).0, S::as_simd_f64s(&track.limit).0);
        for (v, x) in states.iter_mut().enumerate() {
            let gain = simd.select_f64s(simd.greater_than_f64s(continuous[v], zero), seconds, one);
            *x = advance_all(simd, keep[v], gain, *x, slopes[v]);
            inside = simd.and_m64s(inside, is_near(simd, *x, first[v], limit[v]));
        }
        simd.first_true_m64s(simd.xor_m64s(inside, yes)) == S::F64_LANES
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
    fn refine<S: Simd>(
        &self,
        simd: S,
        simulator: &Simulator,
        track: &mut Track<'_>,
        seconds: f64,
        b: usize,
        scratch: &mut Scratch,
    ) {
        let Scratch { slopes, stages, slots, beyond } = scratch;
        let slope = &mut slopes[b * self.width..][..self.width];
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
                Some(region) if self.beyond.is_some() && self.is_outside(simd, region, slots) => {
                    self.slope_beyond(simulator, region, slots, beyond, &mut stages[stage]);
                }
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

/// Appends values for which there is room. (`extend_from_slice` would be a call that copies by another.)
#[inline(always)]
fn append<T: Copy, const N: usize>(to: &mut Vec<T>, values: [T; N]) {
    let length = to.len();
    assert!(N <= to.capacity() - length, "the steps of the horizon were reserved");
    // SAFETY: there is room for as many values behind the last one (asserted), and `values` is this function's own.
    unsafe {
        std::ptr::copy_nonoverlapping(values.as_ptr(), to.as_mut_ptr().add(length), N);
        to.set_len(length + N);
    }
}

/// [`AffineKernel::advance`] with the widest vectors of the machine.
struct Advancing<'a, 'b> {
    kernel: &'a AffineKernel,
    simulator: &'a Simulator,
    tracks: &'a mut [Track<'b>],
    method: Method,
}

impl pulp::WithSimd for Advancing<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.kernel.advance(simd, self.simulator, self.tracks, self.method);
    }
}

/// Memory of the step loop.
struct Scratch {
    /// The right sides at the beginning of the step, a row of the padded width a trajectory.
    slopes: Aligned,
    stages: [Aligned; 4],
    slots: Aligned,
    /// Functions, what is left of them beside the ranges, and latents by group ([`AffineKernel::slope_beyond`]).
    beyond: (Vec<f64>, Vec<f64>, Vec<Vec<f64>>),
}

impl Scratch {
    fn new(kernel: &AffineKernel, tracks: usize) -> Self {
        Self {
            slopes: Aligned::new(tracks * kernel.width, 0.0),
            stages: std::array::from_fn(|_| Aligned::new(kernel.width, 0.0)),
            slots: Aligned::new(kernel.slots, 0.0),
            beyond: Default::default(),
        }
    }
}

/// One trajectory on its way.
struct Track<'a> {
    run: &'a Run<'a>,
    slots: Aligned,
    first: Aligned,
    /// Largest distance of each slot from the first.
    limit: Aligned,
    cell: Cell,
    /// The region of the present step.
    region: usize,
    /// True outside of the training range of its region; updated after the first exit only for models with slopes there.
    outside: bool,
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
    fn new(kernel: &AffineKernel, simulator: &'a Simulator, run: &'a Run<'a>, cell: Cell) -> Self {
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
            cell,
            region: 0,
            outside: false,
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

    /// The trajectory, and the memory of its cell.
    fn finish(self, states: usize) -> (Trajectory, Cell) {
        debug_assert_eq!(self.states.len(), (self.regions.len() + 1) * states);
        let trajectory = Trajectory {
            start: self.run.start,
            time: self.run.time[..=self.regions.len()].to_vec(),
            states: self.states,
            inputs: self.drive.map_or_else(Vec::new, |drive| drive.finish(self.regions.len())),
            regions: self.regions,
            end: self.end,
            left_domain: self.left,
        };
        (trajectory, self.cell)
    }
}
