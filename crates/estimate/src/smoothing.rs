//! States and coefficients under which measurements and equations disagree least, if both are noisy. The trajectories
//! have weak constraints (Tremolet, "Accounting for an imperfect model in 4D-Var", 2006). They are estimated together
//! with the coefficients (Hokanson, Iaccarino and Doostan, "Simultaneous identification and denoising of dynamical
//! systems", SIAM Journal on Scientific Computing 45, 2023).
//!
//! With y the recorded states at the rows t_k of a segment, h_k the seconds from one to the next and h their median,
//! the objective is
//!
//! ```text
//! minimise J(z, c) = 1/2 sum_ki (y_ki - z_ki)^2 / r_i + 1/2 sum_ki zeta_ki(z_k, z_k+1, c)^2 / (q_i h_k / h)
//! ```
//!
//! over the states z and the coefficients c, r the variances of the measurements and q those of the process over the
//! median step; a missing measurement has no term. The constraints zeta are those of Hermite and Simpson, of order 4 in
//! the step, inputs linear in between (`transcription.rs`). Steps are those of Gauss and Newton, exact in the
//! derivatives of zeta, and shortened until J falls: no step raises J. The states are eliminated by reflectors
//! (`smoothing/chain.rs`), so that a step is linear in the rows. The rest is a [`Compressed`] of the coefficients:
//! least squares of all measurements on them, the states free, to second order in the errors. The search for terms
//! works on it ([`StateSmoother::information`]).
//!
//! Recordings are held in memory. [`SmoothingOptions::memory`] limits it, and is checked before any row is read.

mod candidates;
mod chain;

use fleetfoot_data::{Progress, Source, parallel_map};
use fleetfoot_dynamics::Coefficient;
use fleetfoot_model::Model;
use fleetfoot_stats::{Compressed, kernel::solve_upper};

use crate::{
    EstimateError,
    reader::Reader,
    recorded::Recorded,
    transcription::{Defects, Middles, Transcription},
};
use candidates::{Candidates, with_inputs};
use chain::{Border, Eliminated, eliminate};

/// Options of state smoothing.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SmoothingOptions {
    /// Bytes that recordings and their elimination may take.
    pub memory: f64,
    /// Steps of a descent, at most.
    pub iterations: usize,
}

impl Default for SmoothingOptions {
    /// 1 GiB, 30 steps.
    fn default() -> Self {
        Self { memory: f64::from(1 << 30), iterations: 30 }
    }
}

/// Coefficients that may be offered together, at most: their triangle is kept for every segment in work.
const MOST_CANDIDATES: usize = 1_000;
/// Coefficients that a descent moves, for the estimate of its memory.
const MOVED: usize = 64;
/// A step of so many median periods is a gap: a segment ends there.
const GAP: f64 = 2.5;
/// A step is halved so often before it is given up.
const HALVINGS: usize = 24;

/// Variances of the errors of measurements and equations, one a state.
#[derive(Debug, Clone, PartialEq)]
pub struct Variances {
    /// Of a measurement, r.
    pub measurement: Vec<f64>,
    /// Of the equations over a median step, q.
    pub process: Vec<f64>,
}

/// States of every segment (rows x states).
#[derive(Debug, Clone, PartialEq)]
pub struct Tracks(pub Vec<Vec<f64>>);

/// End of a descent.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Settled {
    /// The states.
    pub tracks: Tracks,
    /// The coefficients, in the order of [`StateSmoother::candidates`].
    pub coefficients: Vec<f64>,
    /// J.
    pub cost: f64,
    /// Reduction of J by a further step, if everything were linear: the certificate.
    pub promise: f64,
    /// Logarithm of the determinant of the second derivatives of J by the states alone (of the linearised residuals).
    pub log_determinant: f64,
    /// Squared deviations from the measurements, summed, of every state.
    pub misfit: Vec<f64>,
    /// Covariance of the coefficients that moved, in the order in which they were given.
    pub covariance: Vec<Vec<f64>>,
    /// Steps that were taken.
    pub steps: usize,
    /// True if the last promise is within the tolerance.
    pub converged: bool,
}

/// Recordings in memory, and the model whose coefficients are looked for.
pub struct StateSmoother {
    model: Model,
    candidates: Vec<Coefficient>,
    segments: Vec<Recorded>,
    names: Vec<String>,
    /// Median seconds from row to row.
    period: f64,
    options: SmoothingOptions,
}

/// A segment at some states and coefficients.
struct Linearised {
    defects: Defects,
    middles: Middles,
    /// Its part of J.
    cost: f64,
}

/// All segments at some states and coefficients.
struct Place {
    tracks: Tracks,
    coefficients: Vec<f64>,
    transcription: Transcription,
    segments: Vec<Linearised>,
    /// J.
    cost: f64,
}

impl StateSmoother {
    /// Reads the episodes of a source whose columns are the model's. `candidates`: the coefficients that may move, of
    /// latents that equations add to their known part.
    ///
    /// # Errors
    /// A model without equations of derivatives, with lags, or whose latents are not added; angles that turn over.
    /// Recordings that do not fit into memory, which is reported before they are read; nothing to smooth; those of
    /// reading.
    pub fn new(
        model: &Model,
        candidates: Vec<Coefficient>,
        source: &dyn Source,
        options: SmoothingOptions,
        progress: &dyn Progress,
    ) -> Result<Self, EstimateError> {
        let model = with_inputs(model);
        let transcription = Transcription::new(&whole(&model, &candidates), true, &[])?;
        let names = transcription.names().to_vec();
        check_size(&model, &names, &candidates, source, &options)?;
        let reader = Reader::new(&model, &transcription, source, 1)?;
        let episodes = source.episodes().len();
        let read = parallel_map(episodes, progress, |at| reader.read(at))?;
        let mut steps: Vec<f64> = read
            .iter()
            .flatten()
            .flat_map(|recorded| recorded.seconds.windows(2).map(|pair| pair[1] - pair[0]))
            .collect();
        steps.sort_unstable_by(f64::total_cmp);
        let period = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        let segments: Vec<Recorded> =
            read.into_iter().flatten().flat_map(|recorded| cut(recorded, GAP * period)).collect();
        if segments.is_empty() {
            return Err(EstimateError::NothingToFollow { episodes, columns: names.join(", ") });
        }
        refuse_turns(&transcription, &segments, source)?;
        Ok(Self { model, candidates, segments, names, period, options })
    }

    /// The coefficients that may move.
    pub fn candidates(&self) -> &[Coefficient] {
        &self.candidates
    }

    /// The states, in the order of everything that is one a state.
    pub fn states(&self) -> &[String] {
        &self.names
    }

    /// Segments, between gaps.
    pub fn segments(&self) -> usize {
        self.segments.len()
    }

    /// Median seconds from row to row.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Rows of all segments.
    pub fn rows(&self) -> usize {
        self.segments.iter().map(|segment| segment.seconds.len()).sum()
    }

    /// Intervals of all segments.
    pub fn intervals(&self) -> usize {
        self.rows() - self.segments.len()
    }

    /// Measurements of every state.
    pub fn measured(&self) -> Vec<usize> {
        let n = self.names.len();
        (0..n)
            .map(|s| {
                self.segments
                    .iter()
                    .flat_map(|segment| segment.there.iter().skip(s).step_by(n))
                    .filter(|there| **there)
                    .count()
            })
            .collect()
    }

    /// Recorded values; interpolated between neighbours if one is missing.
    pub fn recorded(&self) -> Tracks {
        Tracks(self.segments.iter().map(|segment| segment.values.clone()).collect())
    }

    /// Variance of the measurements of every state by their third differences, in which a slow signal leaves little: 20 times that of white noise. A state of too few rows has that of its values.
    pub fn noise(&self) -> Vec<f64> {
        let n = self.names.len();
        let of = |s: usize| {
            let (mut sum, mut count) = (0.0, 0.0_f64);
            for segment in &self.segments {
                for k in 3..segment.seconds.len() {
                    let at = |back: usize| segment.values[(k - back) * n + s];
                    if (0..4).all(|back| segment.there[(k - back) * n + s]) {
                        sum += (at(0) - 3.0 * at(1) + 3.0 * at(2) - at(3)).powi(2);
                        count += 1.0;
                    }
                }
            }
            let variance = sum / (20.0 * count.max(1.0));
            if variance > 0.0 { variance } else { self.spread(s) }
        };
        (0..n).map(of).collect()
    }

    /// Variance of a state; of one that does not move, 1.
    fn spread(&self, s: usize) -> f64 {
        let n = self.names.len();
        let values = || self.segments.iter().flat_map(move |segment| segment.values.iter().skip(s).step_by(n));
        let count = self.rows() as f64;
        let mean = values().sum::<f64>() / count;
        let variance = values().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        if variance > 0.0 { variance } else { 1.0 }
    }

    /// Moves states and the coefficients `moving` (numbers of candidates) to the least J, until a step promises less
    /// than `tolerance` of J. No step raises J. Without any coefficients the states alone are smoothed.
    ///
    /// The same bits on any number of threads.
    ///
    /// # Errors
    /// A model that is not finite where it begins; a cancelled run.
    pub fn settle(
        &self,
        from: (&Tracks, &[f64]),
        moving: &[usize],
        (variances, tolerance): (&Variances, f64),
        progress: &dyn Progress,
    ) -> Result<Settled, EstimateError> {
        let mut place = self.place((from.0.clone(), from.1.to_vec()), variances, progress)?;
        if let Some(at) = place.segments.iter().position(|segment| !segment.cost.is_finite()) {
            return Err(self.not_followable(at));
        }
        let mut steps = 0;
        loop {
            fleetfoot_data::checkpoint();
            let (border, chains) = self.eliminated(&place, moving, (variances, true), progress)?;
            let step = border.step();
            let promise = (place.cost - 0.5 * border.residual).max(0.0);
            let converged = promise <= tolerance * place.cost;
            let mut taken = None;
            if !converged && steps < self.options.iterations {
                let moves: Vec<Vec<f64>> = chains.iter().map(|chain| chain.back(&step)).collect();
                taken = self.shortened(&place, (&moves, moving, &step), variances, progress)?;
            }
            let Some(next) = taken else {
                return Ok(Settled {
                    misfit: self.misfit(&place.tracks),
                    log_determinant: chains.iter().map(|chain| chain.log_determinant).sum(),
                    covariance: border.covariance(),
                    tracks: place.tracks,
                    coefficients: place.coefficients,
                    cost: place.cost,
                    promise,
                    steps,
                    converged,
                });
            };
            place = next;
            steps += 1;
        }
    }

    /// The first of the halved steps that lowers J, and where it leads.
    fn shortened(
        &self,
        place: &Place,
        (moves, moving, step): (&[Vec<f64>], &[usize], &[f64]),
        variances: &Variances,
        progress: &dyn Progress,
    ) -> Result<Option<Place>, EstimateError> {
        let mut length = 1.0;
        for _ in 0..HALVINGS {
            let along =
                |(track, by): (&Vec<f64>, &Vec<f64>)| track.iter().zip(by).map(|(z, dz)| z + length * dz).collect();
            let next = Tracks(place.tracks.0.iter().zip(moves).map(along).collect());
            let mut moved = place.coefficients.clone();
            moving.iter().zip(step).for_each(|(&at, by)| moved[at] += length * by);
            let moved_place = self.place((next, moved), variances, progress)?;
            if moved_place.cost < place.cost {
                return Ok(Some(moved_place));
            }
            length *= 0.5;
        }
        Ok(None)
    }

    /// Least squares of all measurements on the coefficients `moving`, the states free: `rss = |R c - z|^2 + residual`
    /// is twice the least J over the states, to second order about `at`.
    ///
    /// # Errors
    /// Those of [`StateSmoother::settle`].
    pub fn information(
        &self,
        at: (&Tracks, &[f64]),
        moving: &[usize],
        variances: &Variances,
        progress: &dyn Progress,
    ) -> Result<Compressed, EstimateError> {
        let place = self.place((at.0.clone(), at.1.to_vec()), variances, progress)?;
        let (border, _) = self.eliminated(&place, moving, (variances, false), progress)?;
        let p = moving.len();
        let z = |i: usize| (i..p).map(|j| border.factor[(i, j)] * at.1[moving[j]]).sum::<f64>() - border.factor[(i, p)];
        let z = faer::Mat::from_fn(p, 1, |i, _| z(i));
        let rows = self.measured().iter().sum::<usize>();
        let total = border.residual + z.col_as_slice(0).iter().map(|value| value * value).sum::<f64>();
        Ok(Compressed {
            rows: rows as u64,
            weight: rows as f64,
            r: faer::Mat::from_fn(p, p, |i, j| border.factor[(i, j)]),
            z,
            residual: vec![border.residual],
            total: vec![total],
            noise: border.rounding(),
            resolution: vec![0.0],
        })
    }

    /// The model with these coefficients; others are zero.
    pub fn model(&self, coefficients: &[f64]) -> Model {
        let mut model = self.model.clone();
        self.candidates.iter().zip(coefficients).for_each(|(candidate, &value)| candidate.set(&mut model, value));
        model
    }

    /// Eliminates the states of every segment. Returns the rows on the coefficients, of all segments together and of
    /// each.
    fn eliminated(
        &self,
        place: &Place,
        moving: &[usize],
        (variances, keep): (&Variances, bool),
        progress: &dyn Progress,
    ) -> Result<(Border, Vec<Eliminated>), EstimateError> {
        let moved: Vec<Coefficient> = moving.iter().map(|&at| self.candidates[at]).collect();
        let candidates = Candidates::new(&self.model, &place.transcription, &moved)?;
        let chains = parallel_map(self.segments.len(), progress, |at| {
            let eliminated = self.chain(at, place, &candidates, (variances, moving.len(), keep));
            eliminated.ok_or_else(|| self.not_followable(at))
        })?;
        let mut border = Border::new(moving.len());
        chains.iter().for_each(|chain| border.merge(&chain.on_border));
        Ok((border, chains))
    }

    fn not_followable(&self, segment: usize) -> EstimateError {
        let recorded = &self.segments[segment];
        EstimateError::NotFollowable {
            episode: format!("number {} (from its row {})", recorded.episode + 1, recorded.rows[0] + 1),
        }
    }

    fn chain(
        &self,
        segment: usize,
        place: &Place,
        candidates: &Candidates,
        (variances, border, keep): (&Variances, usize, bool),
    ) -> Option<Eliminated> {
        let n = self.names.len();
        let (recorded, z, at) = (&self.segments[segment], &place.tracks.0[segment], &place.segments[segment]);
        let values = candidates.evaluate(recorded, z, &at.middles);
        let nodes = recorded.seconds.len();
        eliminate((nodes, n, border), keep, |node, rows| {
            for s in (0..n).filter(|s| recorded.there[node * n + s]) {
                let weight = variances.measurement[s].sqrt().recip();
                let mut row = rows.push();
                row.state()[s] = weight;
                *row.right() = weight * (z[node * n + s] - recorded.values[node * n + s]);
            }
            if node + 1 == nodes {
                return;
            }
            let step = recorded.seconds[node + 1] - recorded.seconds[node];
            for s in 0..n {
                let weight = self.weight(variances, s, step);
                let place = node * n + s;
                let mut row = rows.push();
                let scaled =
                    |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(to, from)| *to = weight * from);
                scaled(row.state(), &at.defects.before[place * n..(place + 1) * n]);
                scaled(row.next(), &at.defects.behind[place * n..(place + 1) * n]);
                candidates.slopes((&values, &at.middles), (node, s, step), weight, row.border());
                *row.right() = weight * at.defects.values[place];
            }
        })
    }

    /// Weight of a state's defect.
    fn weight(&self, variances: &Variances, state: usize, step: f64) -> f64 {
        (variances.process[state] * step / self.period).sqrt().recip()
    }

    /// The segments at some states and coefficients; their part of J is not finite where the model is not.
    fn place(
        &self,
        (tracks, coefficients): (Tracks, Vec<f64>),
        variances: &Variances,
        progress: &dyn Progress,
    ) -> Result<Place, EstimateError> {
        let n = self.names.len();
        let transcription = Transcription::new(&self.model(&coefficients), true, &[])?;
        let deviations: Vec<f64> = variances.measurement.iter().map(|variance| variance.sqrt()).collect();
        let segments = parallel_map(self.segments.len(), progress, |at| {
            let (recorded, z) = (&self.segments[at], &tracks.0[at]);
            let (defects, middles) = transcription.collocated(recorded, z);
            let mut cost = 0.0;
            for k in 0..recorded.seconds.len() - 1 {
                let step = recorded.seconds[k + 1] - recorded.seconds[k];
                for s in 0..n {
                    cost += 0.5 * (defects.values[k * n + s] * self.weight(variances, s, step)).powi(2);
                }
            }
            for (place, (y, z)) in recorded.values.iter().zip(z).enumerate().filter(|(place, _)| recorded.there[*place])
            {
                cost += 0.5 * ((y - z) / deviations[place % n]).powi(2);
            }
            Ok::<_, EstimateError>(Linearised { defects, middles, cost })
        })?;
        let cost = segments.iter().map(|segment| segment.cost).sum();
        Ok(Place { tracks, coefficients, transcription, segments, cost })
    }

    fn misfit(&self, tracks: &Tracks) -> Vec<f64> {
        let n = self.names.len();
        let mut sums = vec![0.0; n];
        for (segment, z) in self.segments.iter().zip(&tracks.0) {
            for (place, (y, z)) in segment.values.iter().zip(z).enumerate().filter(|(place, _)| segment.there[*place]) {
                sums[place % n] += (y - z).powi(2);
            }
        }
        sums
    }
}

impl Border {
    /// The least-squares step of the coefficients; undetermined ones stay.
    fn step(&self) -> Vec<f64> {
        let (p, noise) = (self.squares.len(), self.rounding());
        let mut step = vec![0.0; p];
        for i in (0..p).rev() {
            let pivot = self.factor[(i, i)];
            if pivot.abs() > noise[i] {
                let known: f64 = (i + 1..p).map(|j| self.factor[(i, j)] * step[j]).sum();
                step[i] = -(self.factor[(i, p)] + known) / pivot;
            }
        }
        step
    }

    /// Length of a column that is rounding.
    fn rounding(&self) -> Vec<f64> {
        self.squares.iter().map(|square| 16.0 * f64::EPSILON * square.sqrt()).collect()
    }

    /// (R'R)^-1; infinite where R is singular.
    fn covariance(&self) -> Vec<Vec<f64>> {
        let p = self.squares.len();
        // Columns of R^-1: row i of the inverse of R is what every unit vector leaves.
        let columns: Vec<Vec<f64>> = (0..p).map(|j| self.factor.col_as_slice(j).to_vec()).collect();
        let unit = |j: usize| {
            let mut x = vec![0.0; p];
            x[j] = 1.0;
            solve_upper(|k| &columns[k][..], &mut x);
            x
        };
        let inverse: Vec<Vec<f64>> = (0..p).map(unit).collect();
        let entry = |a: usize, b: usize| inverse.iter().map(|column| column[a] * column[b]).sum();
        (0..p).map(|a| (0..p).map(|b| entry(a, b)).collect()).collect()
    }
}

/// The model with all candidates at 1, which reads whatever any of its coefficients may read.
fn whole(model: &Model, candidates: &[Coefficient]) -> Model {
    let mut model = model.clone();
    candidates.iter().for_each(|candidate| candidate.set(&mut model, 1.0));
    model
}

/// Bytes of a row: its eliminated state, the derivatives of its interval, its values and functions.
fn bytes_of_row(states: usize, functions: usize) -> f64 {
    let n = states as f64;
    8.0 * (n * (2.0 * n + MOVED as f64 + 1.0) + 8.0 * n * n + 16.0 * n + 3.0 * functions as f64)
}

fn check_size(
    model: &Model,
    states: &[String],
    candidates: &[Coefficient],
    source: &dyn Source,
    options: &SmoothingOptions,
) -> Result<(), EstimateError> {
    if candidates.len() > MOST_CANDIDATES {
        return Err(EstimateError::TooManyToSmooth { count: candidates.len(), most: MOST_CANDIDATES });
    }
    let functions = model.libraries.iter().map(Vec::len).sum::<usize>() + 1;
    let most = (options.memory / bytes_of_row(states.len(), functions)) as usize;
    let rows = source.episodes().iter().map(|episode| episode.rows).sum::<usize>();
    if rows > most {
        return Err(EstimateError::TooManyRowsToSmooth { rows, states: states.len(), most });
    }
    Ok(())
}

/// The parts of an episode between gaps, of two rows or more; rows that lack an input are in none.
fn cut(recorded: Recorded, gap: f64) -> Vec<Recorded> {
    let rows = recorded.rows.len();
    let (width, replays) = (recorded.values.len() / rows, recorded.replayed.len() / rows);
    let mut parts = Vec::new();
    let mut first = 0;
    for k in 0..=rows {
        let ends =
            k == rows || !recorded.whole[k] || (k > first && recorded.seconds[k] - recorded.seconds[k - 1] > gap);
        if !ends {
            continue;
        }
        if k >= first + 2 {
            parts.push(Recorded {
                episode: recorded.episode,
                rows: recorded.rows[first..k].to_vec(),
                stamps: recorded.stamps[first..k].to_vec(),
                seconds: recorded.seconds[first..k].to_vec(),
                values: recorded.values[first * width..k * width].to_vec(),
                there: recorded.there[first * width..k * width].to_vec(),
                replayed: recorded.replayed[first * replays..k * replays].to_vec(),
                whole: vec![true; k - first],
            });
        }
        first = if k < rows && recorded.whole[k] { k } else { k + 1 };
    }
    parts
}

/// Refuses angles that turn over: smoothed ones would leave the range in which functions of the recorded ones are read.
fn refuse_turns(
    transcription: &Transcription,
    segments: &[Recorded],
    source: &dyn Source,
) -> Result<(), EstimateError> {
    let n = transcription.states();
    for s in (0..n).filter(|&s| transcription.is_angle(s)) {
        let turns = |recorded: &&Recorded| {
            recorded.values.iter().skip(s).step_by(n).any(|value| value.abs() > 1.01 * std::f64::consts::PI)
        };
        if let Some(segment) = segments.iter().find(turns) {
            return Err(EstimateError::AngleTurns {
                state: transcription.names()[s].clone(),
                episode: source.episodes()[segment.episode].name.clone(),
            });
        }
    }
    Ok(())
}
