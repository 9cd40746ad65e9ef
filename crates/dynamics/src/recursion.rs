//! The recursion of tangents over the steps of one trajectory: products of the step's derivatives with the tangents so far.
//!
//! Tangents are states x columns. A product is taken panel by panel of columns, several rows at once in registers:
//! every value is read once a panel. A panel without a column of a region on the way is zero, and left out. Every
//! element is one chain of fused multiply-adds, in the order in which the right side reads its values.

use pulp::{Simd, WithSimd};

use crate::{Simulator, compiled::Workspace, kernel::LANES, slopes::SlopeRows};

/// No coefficient.
pub(crate) const NONE: u32 = u32::MAX;

/// Layout of a simulator's derivatives.
pub(crate) struct Places {
    /// Variables by which the right sides are differentiated: a state (its place in the simulator), rows back.
    pub(crate) variables: Vec<(usize, usize)>,
    /// The right sides that read latents: side, latent.
    pub(crate) readers: Vec<(usize, usize)>,
    /// For every group of latents, by region, then the constant and the functions in use, then latent: the
    /// coefficient's number. `NONE` for a coefficient without derivatives.
    pub(crate) coefficients: Vec<Vec<u32>>,
}

/// The model's derivatives at all rows of a trajectory, in one stage of its steps.
pub(crate) struct Stage {
    pub(crate) slopes: SlopeRows,
    pub(crate) workspace: Workspace,
    /// Seconds behind the row, of each.
    pub(crate) offset: Vec<f64>,
    /// Weight in the mean of the stages.
    pub(crate) weight: f64,
}

/// The recursion, and its memory: states x width each.
pub(crate) struct Recursion<'a> {
    places: &'a Places,
    simulator: &'a Simulator,
    /// The place of a coefficient among the active ones.
    local: &'a [u32],
    width: usize,
    /// Panels of columns that are not zero, ascending, and whether each is one.
    panels: Vec<usize>,
    is_live: Vec<bool>,
    /// For every group of latents, by region that was met: the columns of its coefficients, the constant's and the functions' of every latent.
    columns: Vec<Vec<Option<Box<[u32]>>>>,
    /// Derivatives of the present stage (values read x states).
    factors: Vec<f64>,
    /// The constant's 1 and the functions of the present row.
    features: Vec<f64>,
    slope: Vec<f64>,
    before: Vec<f64>,
    first: Vec<f64>,
    mean: Vec<f64>,
}

impl<'a> Recursion<'a> {
    /// For so many active coefficients, and columns in all.
    pub(crate) fn new(
        places: &'a Places,
        simulator: &'a Simulator,
        local: &'a [u32],
        (active, width): (usize, usize),
    ) -> Self {
        let size = simulator.states.len() * width;
        let regions =
            |group: &crate::compiled::Latents| (0..group.constants.len() / group.width).map(|_| None).collect();
        let mut recursion = Self {
            places,
            simulator,
            local,
            width,
            panels: Vec::new(),
            is_live: vec![false; width / LANES],
            columns: simulator.compiled.groups.iter().map(regions).collect(),
            factors: Vec::new(),
            features: Vec::new(),
            slope: vec![0.0; size],
            before: vec![0.0; size],
            first: vec![0.0; size],
            mean: vec![0.0; size],
        };
        // Gains and beginnings stand behind the coefficients, and are no region's.
        (active / LANES..width / LANES)
            .filter(|panel| (panel + 1) * LANES > active)
            .for_each(|panel| recursion.revive(panel));
        recursion
    }

    fn revive(&mut self, panel: usize) {
        if !std::mem::replace(&mut self.is_live[panel], true) {
            let at = self.panels.partition_point(|&listed| listed < panel);
            self.panels.insert(at, panel);
        }
    }

    /// Notes the columns of the regions of a row that were not met before.
    fn meet(&mut self, stage: &Stage, k: usize) {
        for (number, group) in self.simulator.compiled.groups.iter().enumerate() {
            let region = stage.workspace.regions.get(group.regions).map_or(0, |regions| regions[k] as usize);
            if !matches!(self.columns[number].get(region), Some(None)) {
                continue;
            }
            let length = (group.features.len() + 1) * group.width;
            let places = &self.places.coefficients[number][region * length..][..length];
            let column = |latent: usize, function: usize| {
                self.local.get(places[function * group.width + latent] as usize).copied().unwrap_or(NONE)
            };
            let numbers: Box<[u32]> = (0..group.slots.len())
                .flat_map(|latent| (0..=group.features.len()).map(move |function| (latent, function)))
                .map(|(latent, function)| column(latent, function))
                .collect();
            numbers.iter().filter(|&&column| column != NONE).for_each(|&column| self.revive(column as usize / LANES));
            self.columns[number][region] = Some(numbers);
        }
    }

    /// The tangents after step `k` from all those before; `next` is zero.
    pub(crate) fn step(&mut self, stages: &[Stage], k: usize, seconds: f64, past: &[f64], next: &mut [f64]) {
        if self.width == 0 {
            return;
        }
        stages.iter().for_each(|stage| self.meet(stage, k));
        for (number, stage) in stages.iter().enumerate() {
            self.chain(stage, k, past, number > 0);
            self.sources(stage, k);
            if stages.len() > 1 {
                let (width, panels) = (self.width, &self.panels);
                let kept = if number == 0 { Some(&mut self.first[..]) } else { None };
                let (slope, mean, weight) = (&self.slope, &mut self.mean, stage.weight);
                fleetfoot_data::arch().dispatch(Averaging { width, panels, slope, mean, kept, weight });
            }
            std::mem::swap(&mut self.slope, &mut self.before);
        }
        let states = self.simulator.states.len();
        let now = &past[k * states * self.width..];
        // Of one stage the mean is its slope. Differences and next values are those of the row itself.
        let [mean, first] = if stages.len() > 1 { [&self.mean, &self.first] } else { [&self.before; 2] };
        for (s, state) in self.simulator.states.iter().enumerate() {
            let row = s * self.width..(s + 1) * self.width;
            let slope = if state.advance.continuous { &mean[row.clone()] } else { &first[row.clone()] };
            let (factor, gain) = (state.advance.factor(seconds), state.advance.gain(seconds));
            let (now, next, panels) = (&now[row.clone()], &mut next[row], &self.panels);
            fleetfoot_data::arch().dispatch(Advancing { panels, factor, now, gain, slope, next });
        }
    }

    /// Adds the change of the right sides by the states that they read, of this stage and of earlier rows.
    fn chain(&mut self, stage: &Stage, k: usize, past: &[f64], moved: bool) {
        let (states, width, readings) = (self.simulator.states.len(), self.width, &self.places.variables);
        let mut read: Vec<&[f64]> = Vec::with_capacity(2 * readings.len());
        self.factors.clear();
        let slopes = &stage.slopes.total[k * states * readings.len()..][..states * readings.len()];
        for (number, &(state, lag)) in readings.iter().enumerate() {
            // The rows in front of the start are recorded.
            let Some(at) = k.checked_sub(lag) else { continue };
            let slopes_of_latent = slopes[number..].iter().step_by(readings.len());
            if slopes_of_latent.clone().all(|&slope| slope == 0.0) {
                continue;
            }
            read.push(&past[(at * states + state) * width..][..width]);
            self.factors.extend(slopes_of_latent.clone());
            if lag == 0 && moved && self.simulator.states[state].advance.continuous {
                read.push(&self.before[state * width..][..width]);
                self.factors.extend(slopes_of_latent.map(|slope| slope * stage.offset[k]));
            }
        }
        fleetfoot_data::arch().dispatch(Product {
            states,
            width,
            panels: &self.panels,
            factors: &self.factors,
            read: &read,
            out: &mut self.slope,
        });
    }

    /// Adds the change of the right sides by the coefficients themselves.
    fn sources(&mut self, stage: &Stage, k: usize) {
        let (states, width, compiled) = (self.simulator.states.len(), self.width, &self.simulator.compiled);
        let regions = &stage.workspace.regions;
        let latents = stage.slopes.by_latents.len() / (stage.offset.len() * states).max(1);
        for (group, columns) in compiled.groups.iter().zip(&self.columns) {
            let region = regions.get(group.regions).map_or(0, |regions| regions[k] as usize);
            let Some(Some(columns)) = columns.get(region) else { continue };
            self.features.clear();
            self.features.push(1.0);
            let feature = |j| group.feature((region, j), k, &stage.workspace);
            self.features.extend((0..group.features.len()).map(feature));
            let count = self.features.len();
            for &(row, slot) in &self.places.readers {
                let Some(latent) = group.slots.iter().position(|&latent| latent == slot) else { continue };
                let by_latent = stage.slopes.by_latents[(k * states + row) * latents + slot];
                let out = &mut self.slope[row * width..][..width];
                for (&column, &feature) in columns[latent * count..][..count].iter().zip(&self.features) {
                    if let Some(out) = out.get_mut(column as usize) {
                        *out += by_latent * feature;
                    }
                }
            }
        }
    }
}

/// `out[row] = sum_t factors[t][row] read[t]` over some panels of columns, each sum from the first t to the last.
struct Product<'a> {
    states: usize,
    width: usize,
    panels: &'a [usize],
    /// Factors (values read x states).
    factors: &'a [f64],
    /// Rows of the width.
    read: &'a [&'a [f64]],
    /// States x width.
    out: &'a mut [f64],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // As many rows as there are registers for.
        match S::F64_LANES {
            8 => self.rows::<S, 8, 1>(simd),
            4 => self.rows::<S, 4, 2>(simd),
            2 => self.rows::<S, 2, 4>(simd),
            _ => self.rows::<S, 1, LANES>(simd),
        }
    }
}

impl Product<'_> {
    /// `R` rows at once, a panel being `V` vectors.
    #[inline(always)]
    fn rows<S: Simd, const R: usize, const V: usize>(&mut self, simd: S) {
        let mut used = Vec::with_capacity(self.read.len());
        let mut row = 0;
        while row < self.states {
            let count = if row + R <= self.states { R } else { 1 };
            used.clear();
            for t in 0..self.read.len() {
                let factors = &self.factors[t * self.states + row..][..count];
                let mut any = false;
                for &factor in factors {
                    any |= factor != 0.0;
                }
                if any {
                    used.push(t);
                }
            }
            for &panel in self.panels {
                if count == R {
                    self.panel::<S, R, V>(simd, row, panel * LANES, &used);
                } else {
                    self.panel::<S, 1, V>(simd, row, panel * LANES, &used);
                }
            }
            row += count;
        }
    }

    #[inline(always)]
    fn panel<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, row: usize, from: usize, used: &[usize]) {
        let mut sums = [[simd.splat_f64s(0.0); V]; R];
        for &t in used {
            let x = S::as_simd_f64s(&self.read[t][from..from + LANES]).0;
            let factors = &self.factors[t * self.states + row..][..R];
            for r in 0..R {
                let factor = simd.splat_f64s(factors[r]);
                for v in 0..V {
                    sums[r][v] = simd.mul_add_f64s(x[v], factor, sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let out = &mut self.out[(row + r) * self.width + from..][..LANES];
            S::as_mut_simd_f64s(out).0.copy_from_slice(&sums[r]);
        }
    }
}

/// Adds the weighted slopes of a stage to the mean of the stages, over some panels; the first stage begins it, and is kept.
struct Averaging<'a> {
    width: usize,
    panels: &'a [usize],
    slope: &'a [f64],
    mean: &'a mut [f64],
    kept: Option<&'a mut [f64]>,
    weight: f64,
}

impl WithSimd for Averaging<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let weight = simd.splat_f64s(self.weight);
        for row in (0..self.mean.len()).step_by(self.width) {
            for &panel in self.panels {
                let lanes = row + panel * LANES..row + (panel + 1) * LANES;
                if let Some(kept) = &mut self.kept {
                    kept[lanes.clone()].copy_from_slice(&self.slope[lanes.clone()]);
                    self.mean[lanes.clone()].fill(0.0);
                }
                let mean = S::as_mut_simd_f64s(&mut self.mean[lanes.clone()]).0;
                for (mean, &slope) in mean.iter_mut().zip(S::as_simd_f64s(&self.slope[lanes]).0) {
                    *mean = simd.mul_add_f64s(slope, weight, *mean);
                }
            }
        }
    }
}

/// `next = factor now + gain slope` of one state, over some panels.
struct Advancing<'a> {
    panels: &'a [usize],
    factor: f64,
    now: &'a [f64],
    gain: f64,
    slope: &'a [f64],
    next: &'a mut [f64],
}

impl WithSimd for Advancing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (factor, gain) = (simd.splat_f64s(self.factor), simd.splat_f64s(self.gain));
        for &panel in self.panels {
            let lanes = panel * LANES..(panel + 1) * LANES;
            let (now, slope) =
                (S::as_simd_f64s(&self.now[lanes.clone()]).0, S::as_simd_f64s(&self.slope[lanes.clone()]).0);
            let next = S::as_mut_simd_f64s(&mut self.next[lanes]).0;
            for ((next, &now), &slope) in next.iter_mut().zip(now).zip(slope) {
                *next = simd.mul_add_f64s(slope, gain, simd.mul_f64s(now, factor));
            }
        }
    }
}
