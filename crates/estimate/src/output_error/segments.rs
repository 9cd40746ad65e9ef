//! All segments of a recording as a sum of squares over the parameters.

// Matrices are capitals.
#![allow(non_snake_case)]

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

use faer::Mat;
use fleetfoot_data::{Block, Progress, Source, parallel_map};
use fleetfoot_dynamics::Stretch;
use fleetfoot_model::Model;

use super::{
    Begun, Gains, OutputErrorOptions,
    beginning::{Best, Segment, dot, products, search},
    coloured::Series,
    stretches,
};
use crate::{
    Bounded, EstimateError, Parameter,
    evaluate::{Evaluation, Objective, Pass},
    limits::Limits,
    products::compressed,
};

/// The problem for given noise.
pub(super) struct Segments<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    source: &'a dyn Source,
    options: &'a OutputErrorOptions,
    progress: &'a dyn Progress,
    /// Bounds of the unknowns: the parameters, then the outputs' gains if there are some.
    bounds: Vec<[f64; 2]>,
    limits: Option<Limits>,
    /// Without bounds, one a state.
    open: Vec<[f64; 2]>,
    states: Vec<String>,
    /// Of every output, which state it is.
    outputs: Vec<usize>,
    /// Standard deviation of the noise of every output.
    pub(super) deviations: Vec<f64>,
    /// The least that they may be.
    least: Vec<f64>,
    segments: Vec<Stretch>,
    missing: usize,
    /// Starting points of the beginnings: those at the best parameters so far.
    known: Mutex<Known>,
    /// True to search for beginnings to the last digits.
    pub(super) exact: bool,
    passes: AtomicUsize,
}

/// The beginnings at the best parameters so far.
#[derive(Clone)]
struct Known {
    cost: f64,
    theta: Vec<f64>,
    beginnings: Vec<Vec<f64>>,
    responses: Vec<Mat<f64>>,
}

/// State of a search beside the parameters, from which it goes on.
#[derive(Clone)]
pub(super) struct Standing {
    deviations: Vec<f64>,
    known: Known,
}

/// One segment, summed.
struct Part {
    beginning: Vec<f64>,
    response: Mat<f64>,
    products: Mat<f64>,
    slope: Vec<f64>,
    /// Sum of squares of every output.
    shares: Vec<f64>,
    residuals: u64,
    size: f64,
}

/// Results at the end of a search.
pub(super) struct Last {
    pub(super) beginnings: Vec<Begun>,
    pub(super) series: Vec<Series>,
}

impl<'a> Segments<'a> {
    pub(super) fn new(
        model: &'a Model,
        bounded: &Bounded<'a>,
        gains: Option<&Gains>,
        source: &'a dyn Source,
        options: &'a OutputErrorOptions,
        progress: &'a dyn Progress,
    ) -> Result<Self, EstimateError> {
        let parameters = bounded.parameters;
        let mut theta: Vec<f64> = parameters.iter().map(|parameter| parameter.initial).collect();
        let compiled = stretches(model, &theta, source, &options.shooting)?;
        let states = compiled.states().to_vec();
        let outputs = outputs(&states, &options.outputs)?;
        let mut bounds: Vec<[f64; 2]> = parameters.iter().map(|parameter| parameter.bounds).collect();
        if let Some(gains) = gains {
            bounds.extend(gains.bounds(outputs.len())?);
        }
        let limits = Limits::new(bounded, &bounds[parameters.len()..])?;
        theta.resize(bounds.len(), 0.0);
        let cut = compiled.cut(options.rows);
        let (mut segments, mut beginnings, mut spread) = (Vec::new(), Vec::new(), Spread::new(outputs.len()));
        for &stretch in &cut {
            let block = compiled.read(stretch)?;
            if let Some(beginning) = compiled.measured_beginning(&block, stretch) {
                segments.push(stretch);
                beginnings.push(beginning);
                spread.add(&outputs, &states, source, &block);
            }
        }
        if segments.is_empty() {
            return Err(EstimateError::NoSegment { segments: cut.len() });
        }
        let missing = cut.len() - segments.len();
        let deviations = spread.deviations();
        let responses = vec![Mat::zeros(states.len(), theta.len()); segments.len()];
        Ok(Self {
            model,
            parameters,
            source,
            options,
            progress,
            bounds,
            limits,
            open: vec![[f64::NEG_INFINITY, f64::INFINITY]; states.len()],
            states,
            outputs,
            least: deviations.iter().map(|deviation| super::LEAST * deviation).collect(),
            deviations,
            segments,
            missing,
            known: Mutex::new(Known { cost: f64::INFINITY, theta, beginnings, responses }),
            exact: false,
            passes: AtomicUsize::new(1),
        })
    }

    pub(super) fn states(&self) -> &[String] {
        &self.states
    }

    pub(super) fn names(&self) -> Vec<String> {
        self.parameters.iter().map(|parameter| parameter.name.clone()).collect()
    }

    pub(super) fn outputs(&self) -> Vec<String> {
        self.outputs.iter().map(|&state| self.states[state].clone()).collect()
    }

    pub(super) fn missing(&self) -> usize {
        self.missing
    }

    pub(super) fn passes(&self) -> usize {
        self.passes.load(Ordering::Relaxed)
    }

    pub(super) fn standing(&self) -> Standing {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Standing { deviations: self.deviations.clone(), known }
    }

    /// Continues from there.
    pub(super) fn stand(&mut self, standing: Standing) {
        self.deviations = standing.deviations;
        *self.known.get_mut().unwrap_or_else(PoisonError::into_inner) = standing.known;
    }

    /// Forgets the best cost: costs of other noise cannot be compared.
    pub(super) fn forget(&mut self) {
        self.known.get_mut().unwrap_or_else(PoisonError::into_inner).cost = f64::INFINITY;
    }

    /// The deviations of maximum likelihood, from the shares of the outputs in the cost: of each its sum of squares,
    /// then the number of residuals. Also the largest relative change of a deviation.
    pub(super) fn deviations_of(&self, shares: &[f64]) -> (Vec<f64>, f64) {
        let (squares, counts) = shares.split_at(self.outputs.len());
        let deviation = |at: usize| self.deviations[at] * (squares[at] / counts[at].max(1.0)).sqrt();
        let deviations: Vec<f64> = (0..self.outputs.len()).map(|at| deviation(at).max(self.least[at])).collect();
        let change = |(old, new): (&f64, &f64)| (new / old - 1.0).abs();
        let change = self.deviations.iter().zip(&deviations).map(change).fold(0.0, f64::max);
        (deviations, change)
    }

    /// `sum_j n_j log sigma_j` with the deviations that [`Self::deviations_of`] finds.
    pub(super) fn misfit(&self, shares: &[f64]) -> f64 {
        let counts = &shares[self.outputs.len()..];
        self.deviations_of(shares).0.iter().zip(counts).map(|(deviation, count)| count * deviation.ln()).sum()
    }

    /// Every segment at its best beginning; `None` where one diverges.
    fn each<R: Send>(
        &self,
        theta: &[f64],
        take: impl Fn(Stretch, Best) -> R + Sync,
    ) -> Result<Option<Vec<R>>, EstimateError> {
        self.passes.fetch_add(1, Ordering::Relaxed);
        let (parameters, gain_values) = theta.split_at(self.parameters.len());
        let stretches = stretches(self.model, parameters, self.source, &self.options.shooting)?;
        let mut gains = vec![0.0; if gain_values.is_empty() { 0 } else { self.states.len() }];
        self.outputs.iter().zip(gain_values).for_each(|(&state, &gain)| gains[state] = gain);
        let guesses = self.guesses(theta);
        let mut scale = vec![0.0; self.states.len()];
        self.outputs.iter().zip(&self.deviations).for_each(|(&state, deviation)| scale[state] = 1.0 / deviation);
        let parts = parallel_map(self.segments.len(), self.progress, |at| -> Result<_, EstimateError> {
            let stretch = self.segments[at];
            let block = &stretches.read(stretch)?;
            let (stretches, scale, gains, bounds) = (&stretches, &scale[..], &gains[..], &self.open[..]);
            let search = search(self.exact);
            let segment = Segment { stretches, block, stretch, scale, gains, search, bounds, last: Default::default() };
            Ok(segment.best(guesses[at].clone())?.map(|best| take(stretch, best)))
        })?;
        Ok(parts.into_iter().collect())
    }

    /// The beginnings at the best parameters so far, moved to these to first order.
    fn guesses(&self, theta: &[f64]) -> Vec<Vec<f64>> {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let moved = |(beginning, response): (&Vec<f64>, &Mat<f64>)| {
            let shift = |s: usize| {
                theta
                    .iter()
                    .zip(&known.theta)
                    .enumerate()
                    .map(|(j, (new, old))| response[(s, j)] * (new - old))
                    .sum::<f64>()
            };
            beginning.iter().enumerate().map(|(s, value)| value + shift(s)).collect()
        };
        known.beginnings.iter().zip(&known.responses).map(moved).collect()
    }

    fn part(&self, best: Best) -> Part {
        let residuals = &best.residuals;
        let S = &residuals.by_parameters;
        let m = self.outputs.len();
        let mut shares = vec![0.0; 2 * m];
        for (at, (r, there)) in residuals.values.iter().zip(&residuals.there).enumerate() {
            shares[at % m] += r * r;
            shares[m + at % m] += f64::from(u8::from(*there));
        }
        Part {
            products: products(S.as_ref()),
            slope: (0..S.ncols()).map(|j| dot(S.col_as_slice(j), &residuals.values)).collect(),
            residuals: residuals.there.iter().filter(|&&there| there).count() as u64,
            size: residuals.size,
            shares,
            beginning: best.beginning,
            response: best.response,
        }
    }

    fn keep(&self, cost: f64, theta: &[f64], parts: &[Part]) {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if cost < known.cost {
            (known.cost, known.theta) = (cost, theta.to_vec());
            known.beginnings = parts.iter().map(|part| part.beginning.clone()).collect();
            known.responses = parts.iter().map(|part| part.response.clone()).collect();
        }
    }

    fn refused(&self) -> EstimateError {
        let start = self.segments[0].start;
        EstimateError::Diverges { episode: self.source.episodes()[start.episode].name.clone(), row: start.row }
    }

    /// Beginnings and residuals at the end.
    pub(super) fn last(&self, theta: &[f64]) -> Result<Last, EstimateError> {
        let m = self.outputs.len();
        let take = |stretch: Stretch, best: Best| {
            (Begun { stretch, states: best.beginning }, Series { outputs: m, residuals: best.residuals })
        };
        let evaluated = self.each(theta, take)?.ok_or_else(|| self.refused())?;
        let (beginnings, series) = evaluated.into_iter().unzip();
        Ok(Last { beginnings, series })
    }
}

impl Objective for Segments<'_> {
    fn bounds(&self) -> &[[f64; 2]] {
        &self.bounds
    }

    fn limits(&self) -> Option<&Limits> {
        self.limits.as_ref()
    }

    /// The sums count residuals.
    fn residuals(&self) -> usize {
        1
    }

    fn unknowns(&self) -> usize {
        self.bounds.len() + self.segments.len() * self.states.len()
    }

    fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError> {
        let Some(parts) = self.each(theta, |_, best| self.part(best))? else {
            return Ok(Pass::Refused(self.refused()));
        };
        let p = theta.len();
        let (mut sum, mut slope, mut shares) =
            (Mat::<f64>::zeros(p, p), vec![0.0; p], vec![0.0; 2 * self.outputs.len()]);
        let (mut rows, mut targets) = (0, 0.0);
        for part in &parts {
            sum += &part.products;
            slope.iter_mut().zip(&part.slope).for_each(|(sum, value)| *sum += value);
            shares.iter_mut().zip(&part.shares).for_each(|(sum, value)| *sum += value);
            rows += part.residuals;
            targets += part.size;
        }
        let cost: f64 = shares[..self.outputs.len()].iter().sum();
        if !(cost.is_finite() && slope.iter().all(|value| value.is_finite())) {
            return Ok(Pass::Refused(self.refused()));
        }
        let (jacobian, rhs) = compressed(&sum, &slope).ok_or(EstimateError::Overflow)?;
        self.keep(cost, theta, &parts);
        let (scores, linear) = (Vec::new(), Vec::new());
        Ok(Pass::Finite(Evaluation { jacobian, rhs, cost, targets, rows, scores, linear, shares, ended: 0 }))
    }
}

/// Numbers of the compared states.
fn outputs(states: &[String], named: &[String]) -> Result<Vec<usize>, EstimateError> {
    let place = |name: &String| {
        let unknown = || EstimateError::NoState { name: name.clone(), states: states.join(", ") };
        states.iter().position(|state| state == name).ok_or_else(unknown)
    };
    if named.is_empty() { Ok((0..states.len()).collect()) } else { named.iter().map(place).collect() }
}

/// Spread of the outputs: the starting value of the noise.
struct Spread {
    sums: Vec<[f64; 3]>,
}

impl Spread {
    fn new(outputs: usize) -> Self {
        Self { sums: vec![[0.0; 3]; outputs] }
    }

    fn add(&mut self, outputs: &[usize], states: &[String], source: &dyn Source, block: &Block) {
        for (sum, &output) in self.sums.iter_mut().zip(outputs) {
            let Some(column) = source.column_index(&states[output]) else { continue };
            for value in block.core(column).iter().filter(|value| value.is_finite()) {
                *sum = [sum[0] + 1.0, sum[1] + value, sum[2] + value * value];
            }
        }
    }

    fn deviations(&self) -> Vec<f64> {
        let of = |&[n, sum, squares]: &[f64; 3]| ((squares - sum * sum / n.max(1.0)) / n.max(1.0)).max(0.0).sqrt();
        self.sums.iter().map(of).map(|deviation| if deviation > 0.0 { deviation } else { 1.0 }).collect()
    }
}
