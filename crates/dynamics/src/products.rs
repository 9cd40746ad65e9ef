//! Products of a trajectory's derivatives with one vector: forward along a direction of the coefficients, and back from weights of the states.
//!
//! Both follow the very steps that made the trajectory, stage by stage. They hold one number a state, while the
//! tangents of all coefficients hold one for each coefficient. With S the tangents by the coefficients, `forward` gives
//! `S v` after every step, by the recursion of S itself. `back` gives `S' w` for weights w of every state after every
//! step, by the same recursion transposed, from the last step to the first (the adjoint method; Griewank and Walther,
//! Evaluating Derivatives, 2008, chapter 3).

use std::ops::Range;

use crate::{
    Coefficient, Simulator,
    recursion::{NONE, Places, Stage},
};

/// Sums over segments: products of their derivatives J (n x p) with one vector.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Products {
    /// `J'r`, or `J'J v` for a direction v (p).
    pub back: Vec<f64>,
    /// `r'r`, or `|J v|^2`.
    pub square: f64,
    /// Sum of the squares of the measurements, in the units of the residuals.
    pub size: f64,
    /// Residuals.
    pub residuals: u64,
    /// Segments.
    pub segments: u64,
    /// Segments that ended early.
    pub ended: u64,
    /// True if all of it is finite.
    pub finite: bool,
}

impl Products {
    /// Of no segment, over so many coefficients.
    pub fn new(coefficients: usize) -> Self {
        Self {
            back: vec![0.0; coefficients],
            square: 0.0,
            size: 0.0,
            residuals: 0,
            segments: 0,
            ended: 0,
            finite: true,
        }
    }

    /// Adds those of other segments.
    pub fn merge(&mut self, other: &Self) {
        self.back.iter_mut().zip(&other.back).for_each(|(sum, value)| *sum += value);
        self.square += other.square;
        self.size += other.size;
        self.residuals += other.residuals;
        self.segments += other.segments;
        self.ended += other.ended;
        self.finite &= other.finite;
    }
}

/// The normal matrix J'J of one step from the recorded rows of segments, in the units of their residuals. It has a
/// block for the coefficients that a latent has in a region.
///
/// A state's next value is linear in the coefficients of the latents that it reads. The derivatives are the functions
/// of the recorded row, times the length of the step if a derivative is integrated. Products between latents that one
/// equation reads are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalBlocks {
    coefficients: Vec<Coefficient>,
    /// Numbers of the coefficients of every block.
    ranges: Vec<Range<usize>>,
    /// Offset of each coefficient's block among the values, and the block's number.
    places: Vec<(usize, usize)>,
    values: Vec<f64>,
}

impl NormalBlocks {
    /// Of no row, for coefficients in ascending order.
    pub fn new(coefficients: &[Coefficient]) -> Self {
        let (mut ranges, mut places, mut total) = (Vec::new(), Vec::with_capacity(coefficients.len()), 0);
        for coefficients_of_latent in coefficients.chunk_by(|a, b| (a.region, a.latent) == (b.region, b.latent)) {
            places.extend(std::iter::repeat_n((total, ranges.len()), coefficients_of_latent.len()));
            let first = places.len() - coefficients_of_latent.len();
            ranges.push(first..places.len());
            total += coefficients_of_latent.len() * coefficients_of_latent.len();
        }
        Self { coefficients: coefficients.to_vec(), ranges, places, values: vec![0.0; total] }
    }

    /// The coefficients, by their numbers.
    pub fn coefficients(&self) -> &[Coefficient] {
        &self.coefficients
    }

    /// The numbers of the coefficients of every block, and its matrix (by rows).
    pub fn blocks(&self) -> impl Iterator<Item = (Range<usize>, &[f64])> {
        self.ranges.iter().map(|range| {
            let at = self.places[range.start].0;
            (range.clone(), &self.values[at..at + range.len() * range.len()])
        })
    }

    /// With so much more on the diagonal.
    pub fn raised(mut self, by: impl Fn(usize) -> f64) -> Self {
        for range in &self.ranges {
            let first = self.places[range.start].0;
            range.clone().enumerate().for_each(|(i, number)| self.values[first + i * (range.len() + 1)] += by(number));
        }
        self
    }

    /// Adds those of other rows.
    pub fn merge(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(sum, value)| *sum += value);
    }
}

/// The coefficients of one row's region in one group of latents.
struct Met<'a> {
    /// The constant and the functions in use, then latent: the coefficient's number.
    numbers: &'a [u32],
    /// The latents, and the stride from function to function.
    width: usize,
    /// The constant's 1 and the functions there.
    features: &'a [f64],
}

impl Met<'_> {
    /// The first of a latent's numbers, if all are requested and follow each other.
    fn run(&self, latent: usize) -> Option<usize> {
        let last = self.numbers[(self.features.len() - 1) * self.width + latent];
        let first = self.numbers[latent];
        (last != NONE && (last - first) as usize + 1 == self.features.len()).then_some(first as usize)
    }

    /// The requested numbers of a latent's coefficients, with their functions.
    fn each(&self, latent: usize) -> impl Iterator<Item = (usize, f64)> {
        let row = self.numbers[latent..].iter().step_by(self.width).zip(self.features);
        row.filter(|(number, _)| **number != NONE).map(|(&number, &feature)| (number as usize, feature))
    }

    /// Change of a latent along a direction.
    fn along(&self, latent: usize, direction: &[f64]) -> f64 {
        match self.run(latent) {
            Some(first) => direction[first..][..self.features.len()]
                .iter()
                .zip(self.features)
                .map(|(v, feature)| v * feature)
                .sum(),
            None => self.each(latent).map(|(number, feature)| direction[number] * feature).sum(),
        }
    }

    /// Adds so much times a latent's functions.
    fn back(&self, latent: usize, weight: f64, into: &mut [f64]) {
        match self.run(latent) {
            Some(first) => {
                let into = into[first..][..self.features.len()].iter_mut();
                into.zip(self.features).for_each(|(into, feature)| *into += weight * feature);
            }
            None => self.each(latent).for_each(|(number, feature)| into[number] += weight * feature),
        }
    }
}

/// A trajectory with the derivatives along it.
pub(crate) struct Along<'a> {
    pub(crate) simulator: &'a Simulator,
    pub(crate) places: &'a Places,
    pub(crate) stages: &'a [Stage],
    /// Length of every step, seconds.
    pub(crate) seconds: &'a [f64],
    /// For every step the derivatives of each rotation's retraction (a matrix by rows).
    pub(crate) retractions: Vec<Vec<Vec<f64>>>,
}

impl Along<'_> {
    /// `S v` after every step ((steps + 1) x states) for a direction v of the coefficients.
    pub(crate) fn forward(&self, direction: &[f64]) -> Vec<f64> {
        let (states, count) = (self.simulator.states.len(), self.places.variables.len());
        let mut tangent = vec![0.0; (self.seconds.len() + 1) * states];
        let (mut slopes, mut read) = (vec![vec![0.0; states]; self.stages.len()], vec![0.0; count]);
        let mut features = Vec::new();
        for (k, &seconds) in self.seconds.iter().enumerate() {
            let (past, next) = tangent.split_at_mut((k + 1) * states);
            for number in 0..self.stages.len() {
                let (before, rest) = slopes.split_at_mut(number);
                let (stage, slope) = (&self.stages[number], &mut rest[0]);
                for (read, place) in read.iter_mut().zip(&self.places.variables) {
                    *read = self.at(k, place).map_or(0.0, |at| {
                        let moved = before.last().filter(|_| self.moves(place)).map_or(0.0, |before| before[place.0]);
                        past[at] + stage.offset[k] * moved
                    });
                }
                for (slope, totals) in slope.iter_mut().zip(self.totals(stage, k)) {
                    *slope = totals.iter().zip(&read).map(|(total, read)| total * read).sum();
                }
                self.readers(stage, k, &mut features, |row, by_latent, latent, met| {
                    slope[row] += by_latent * met.along(latent, direction);
                });
            }
            for (s, state) in self.simulator.states.iter().enumerate() {
                let mean =
                    || self.stages.iter().zip(&slopes).map(|(stage, slope)| stage.weight * slope[s]).sum::<f64>();
                let slope = if state.advance.continuous && slopes.len() > 1 { mean() } else { slopes[0][s] };
                next[s] = state.advance.factor(seconds) * past[k * states + s] + state.advance.gain(seconds) * slope;
            }
            self.brought_back(k, |matrix, parts, i, j| matrix[i * parts + j], &mut next[..states]);
        }
        tangent
    }

    /// Adds `S' w` to `into` (one number a coefficient) for weights w of every state after every step ((steps + 1) x
    /// states). The weights are used up.
    pub(crate) fn back(&self, weights: &mut [f64], into: &mut [f64]) {
        let (states, count) = (self.simulator.states.len(), self.places.variables.len());
        let (mut adjoints, mut read) = (vec![vec![0.0; states]; self.stages.len()], vec![0.0; count]);
        let mut features = Vec::new();
        for (k, &seconds) in self.seconds.iter().enumerate().rev() {
            let (past, next) = weights.split_at_mut((k + 1) * states);
            self.brought_back(k, |matrix, parts, i, j| matrix[j * parts + i], &mut next[..states]);
            adjoints.iter_mut().for_each(|adjoint| adjoint.fill(0.0));
            for (s, state) in self.simulator.states.iter().enumerate() {
                past[k * states + s] += state.advance.factor(seconds) * next[s];
                let of_slope = state.advance.gain(seconds) * next[s];
                if state.advance.continuous && adjoints.len() > 1 {
                    let weighted = adjoints.iter_mut().zip(self.stages);
                    weighted.for_each(|(adjoint, stage)| adjoint[s] += stage.weight * of_slope);
                } else {
                    adjoints[0][s] += of_slope;
                }
            }
            for number in (0..self.stages.len()).rev() {
                let (before, rest) = adjoints.split_at_mut(number);
                let (stage, adjoint) = (&self.stages[number], &rest[0]);
                read.fill(0.0);
                for (&adjoint, totals) in adjoint.iter().zip(self.totals(stage, k)) {
                    read.iter_mut().zip(totals).for_each(|(read, total)| *read += total * adjoint);
                }
                for (&read, place) in read.iter().zip(&self.places.variables) {
                    let Some(at) = self.at(k, place) else { continue };
                    past[at] += read;
                    if let Some(before) = before.last_mut().filter(|_| self.moves(place)) {
                        before[place.0] += stage.offset[k] * read;
                    }
                }
                self.readers(stage, k, &mut features, |row, by_latent, latent, met| {
                    met.back(latent, by_latent * adjoint[row], into);
                });
            }
        }
    }

    /// Adds the step from row `k` to the normal matrix of one step; `scale` are the units of every state's residual.
    pub(crate) fn normal(&self, k: usize, scale: &[f64], into: &mut NormalBlocks) {
        let Some(stage) = self.stages.first() else { return };
        let mut entries: Vec<(usize, f64)> = Vec::new();
        self.readers(stage, k, &mut Vec::new(), |row, by_latent, latent, met| {
            let weight = scale[row] * self.simulator.states[row].advance.gain(self.seconds[k]) * by_latent;
            entries.clear();
            entries.extend(met.each(latent).map(|(number, feature)| (number, weight * feature)));
            let Some(&(first, _)) = entries.first().filter(|_| entries.iter().all(|(_, value)| value.is_finite()))
            else {
                return;
            };
            let (at, block) = into.places[first];
            let range = into.ranges[block].clone();
            for &(i, left) in &entries {
                let values = &mut into.values[at + (i - range.start) * range.len()..][..range.len()];
                entries.iter().for_each(|&(j, right)| values[j - range.start] += left * right);
            }
        });
    }

    /// Multiplies the parts of every rotation with the retraction after step `k`; `entry` is that of a row and a
    /// column.
    fn brought_back(&self, k: usize, entry: impl Fn(&[f64], usize, usize, usize) -> f64, states: &mut [f64]) {
        let Some(retractions) = self.retractions.get(k) else { return };
        for (group, matrix) in self.simulator.geometry.groups.iter().zip(retractions) {
            let before = group.of(|place| states[place]);
            for (i, &place) in group.places.iter().enumerate() {
                states[place] =
                    before.iter().enumerate().map(|(j, value)| entry(matrix, before.len(), i, j) * value).sum();
            }
        }
    }

    /// Returns true if a stage reads a state moved by the slope of the stage before.
    fn moves(&self, &(state, lag): &(usize, usize)) -> bool {
        lag == 0 && self.simulator.states[state].advance.continuous
    }

    /// Index of a value read at row `k`; the rows in front of the start are recorded.
    fn at(&self, k: usize, &(state, lag): &(usize, usize)) -> Option<usize> {
        Some(k.checked_sub(lag)? * self.simulator.states.len() + state)
    }

    /// The derivatives of every right side by the values that it reads at row `k`.
    fn totals<'b>(&self, stage: &'b Stage, k: usize) -> std::slice::ChunksExact<'b, f64> {
        let (states, count) = (self.simulator.states.len(), self.places.variables.len());
        stage.slopes.total[k * states * count..][..states * count].chunks_exact(count.max(1))
    }

    /// The right sides that read latents at row `k`. For each: the right side, its derivative by the latent, the
    /// latent's place in its group, and the coefficients.
    fn readers(
        &self,
        stage: &Stage,
        k: usize,
        features: &mut Vec<f64>,
        mut take: impl FnMut(usize, f64, usize, &Met<'_>),
    ) {
        let (states, compiled) = (self.simulator.states.len(), &self.simulator.compiled);
        let latents = stage.slopes.by_latents.len() / (stage.offset.len() * states).max(1);
        let workspace = &stage.workspace;
        for (group, places) in compiled.groups.iter().zip(&self.places.coefficients) {
            let region = workspace.regions.get(group.regions).map_or(0, |regions| regions[k] as usize);
            let length = (group.features.len() + 1) * group.width;
            let Some(numbers) = places.get(region.saturating_mul(length)..).and_then(|places| places.get(..length))
            else {
                continue;
            };
            features.clear();
            features.push(1.0);
            features.extend((0..group.features.len()).map(|j| group.feature((region, j), k, workspace)));
            let met = Met { numbers, width: group.width, features };
            for &(row, slot) in &self.places.readers {
                let Some(latent) = group.slots.iter().position(|&latent| latent == slot) else { continue };
                take(row, stage.slopes.by_latents[(k * states + row) * latents + slot], latent, &met);
            }
        }
    }
}
