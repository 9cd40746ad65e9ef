//! Limits that a latent function keeps at every row of the data: drag that is never negative (the failure of the paper's section 9.3).
//!
//! A million rows are a million inequalities, of which a few matter. So constraints are generated: solve, pass over the rows once for the worst
//! violations, add these, and again (the cutting-plane method of Kelley 1960), until a pass finds none.

use std::collections::HashSet;

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{Grid, reduce};

use super::{Constrained, ConstrainedError, ConstrainedOptions, Constraints, LinearConstraint, constrained};
use crate::{
    Strength,
    structured::{Assembled, Regression},
};

/// On which side of its bound a latent stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// `latent >= bound`.
    AtLeast,
    /// `latent <= bound`.
    AtMost,
}

/// What a latent keeps at every row.
#[derive(Debug, Clone, PartialEq)]
pub struct LatentLimit {
    /// Index of the latent.
    pub latent: usize,
    /// The side.
    pub side: Limit,
    /// The bound: a number, or an expression over the columns.
    pub bound: Expr,
}

/// A structured regression with limits on its latents.
#[derive(Debug, Clone, Copy)]
pub struct ConstrainedLatent<'a> {
    /// The regression: names and functions of the latents.
    pub regression: &'a Regression,
    /// Its assembled problem.
    pub assembled: &'a Assembled,
    /// Constraints on the coefficients.
    pub constraints: &'a Constraints,
    /// Limits on the latents.
    pub limits: &'a [LatentLimit],
    /// Strengths of the penalty.
    pub strength: Strength,
    /// Coefficients that may differ from 0 (`None`: all).
    pub support: Option<&'a [usize]>,
}

/// How limits on latents are imposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatentOptions {
    /// How each problem is solved.
    pub solve: ConstrainedOptions,
    /// What a latent keeps beyond its bound at the rows that became constraints, as a share of its largest value without limits: so that all the other
    /// rows can keep the bound itself, exactly.
    pub margin: f64,
    /// Rows that become constraints after a pass, at most, for every limit.
    pub rows_per_pass: usize,
    /// Passes over the data, at most.
    pub max_passes: usize,
}

impl Default for LatentOptions {
    fn default() -> Self {
        Self { solve: ConstrainedOptions::default(), margin: 1e-6, rows_per_pass: 64, max_passes: 50 }
    }
}

/// How far a latent stays from its bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    /// Least distance over all rows, in the latent's units; negative where the bound is broken.
    pub least: f64,
    /// Where that is: episode (by name) and row.
    pub place: Option<(String, usize)>,
    /// Largest absolute value of the latent over all rows.
    pub size: f64,
}

/// A fit with limits on its latents.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LatentFit {
    /// The minimiser.
    pub fit: Constrained,
    /// For every limit, the distance from the bound that the last pass found.
    pub clearance: Vec<Clearance>,
    /// Whether every row of the last pass kept every limit.
    pub kept: bool,
    /// Passes over the data.
    pub passes: usize,
    /// Rows that became constraints.
    pub rows: usize,
}

/// A row of the data that breaks a limit.
#[derive(Debug, Clone)]
struct Breach {
    /// Distance from the bound, negative.
    clearance: f64,
    episode: usize,
    row: usize,
    /// The latent's functions there.
    functions: Vec<f64>,
    bound: f64,
}

/// What a pass finds of one limit.
#[derive(Debug, Clone)]
struct Found {
    least: f64,
    place: Option<(usize, usize)>,
    size: f64,
    breaches: Vec<Breach>,
}

impl Found {
    fn new() -> Self {
        Self { least: f64::INFINITY, place: None, size: 0.0, breaches: Vec::new() }
    }

    /// Joins what later rows say, and keeps the worst breaches; of equals, the earlier.
    fn merge(&mut self, other: Self, keep: usize) {
        if other.least < self.least {
            (self.least, self.place) = (other.least, other.place);
        }
        self.size = self.size.max(other.size);
        self.breaches.extend(other.breaches);
        self.breaches.sort_by(|a, b| a.clearance.total_cmp(&b.clearance));
        self.breaches.truncate(keep);
    }
}

/// Fits with the limits kept at every row of the source at which the latents' functions and the bounds are finite numbers.
///
/// When [`LatentFit::kept`] is true, the last pass found `latent >= bound` (or `<=`) at all of these rows, without a tolerance, in the arithmetic of
/// [`fleetfoot_library::Program`] and a sum over the functions in their order; the objective is at most that of bounds tightened by twice
/// the margin. Needs as many passes as there are rounds of new constraints, usually less than ten, and memory for these rows only.
///
/// # Errors
/// As [`constrained`]; when a latent or a column does not exist, the source cannot be read, or the user stops it.
pub fn constrain_latent(
    problem: &ConstrainedLatent<'_>,
    source: &dyn Source,
    options: &LatentOptions,
    progress: &dyn Progress,
) -> Result<LatentFit, ConstrainedError> {
    let ConstrainedLatent { regression, assembled, limits, strength, support, .. } = *problem;
    let survey = Survey::new(regression, limits, source)?;
    let mut constraints = problem.constraints.clone();
    let before = constraints.inequalities.len();
    let mut known = HashSet::new();
    let mut sizes: Option<Vec<f64>> = None;
    let mut passes = 0;
    loop {
        let fit = constrained(assembled, &constraints, strength, support, &options.solve)?;
        progress.stage("rows that break a limit");
        let found = survey.pass(&fit.theta, options.rows_per_pass, progress)?;
        passes += 1;
        let sizes = sizes.get_or_insert_with(|| found.iter().map(|found| found.size).collect());
        let kept = found.iter().all(|found| found.least >= 0.0);
        let mut new = 0;
        for (at, found) in found.iter().enumerate() {
            for breach in found.breaches.iter().filter(|breach| known.insert((at, breach.episode, breach.row))) {
                constraints.inequalities.push(survey.constraint(at, breach, options.margin * sizes[at]));
                new += 1;
            }
        }
        if kept || new == 0 || passes >= options.max_passes {
            let rows = constraints.inequalities.len() - before - new;
            let clearance = found.iter().map(|found| survey.clearance(found)).collect();
            return Ok(LatentFit { fit, clearance, kept, passes, rows });
        }
    }
}

/// The limits, compiled for a source.
struct Survey<'a> {
    regression: &'a Regression,
    limits: &'a [LatentLimit],
    source: &'a dyn Source,
    /// The functions of every limit's latent, then its bound.
    design: Design,
}

impl<'a> Survey<'a> {
    fn new(
        regression: &'a Regression,
        limits: &'a [LatentLimit],
        source: &'a dyn Source,
    ) -> Result<Self, ConstrainedError> {
        let latents = regression.latents.len();
        if let Some(limit) = limits.iter().find(|limit| limit.latent >= latents) {
            return Err(ConstrainedError::NoSuchLatent { latent: limit.latent, latents });
        }
        let expressions =
            limits.iter().flat_map(|limit| regression.latents[limit.latent].functions.iter().chain([&limit.bound]));
        let expressions: Vec<Expr> = expressions.cloned().collect();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self { regression, limits, source, design: Design::compile(&expressions, &names)? })
    }

    /// One pass over all rows.
    fn pass(&self, theta: &[f64], keep: usize, progress: &dyn Progress) -> Result<Vec<Found>, ConstrainedError> {
        let chunks = Grid { chunk_rows: 65_536 }.chunks(self.source.episodes());
        let empty = || vec![Found::new(); self.limits.len()];
        let mut total = empty();
        reduce(
            self.source,
            &chunks,
            self.design.halo(),
            progress,
            || (empty(), DesignRows::default()),
            |(found, rows), chunk, block, tile| {
                self.design.evaluate(block, tile, rows);
                let mut first = 0;
                for (limit, found) in self.limits.iter().zip(found) {
                    found.merge(self.tile(limit, theta, rows, (first, chunk.episode, block.first)), keep);
                    first += self.regression.latents[limit.latent].functions.len() + 1;
                }
                Ok::<_, ConstrainedError>(())
            },
            |_, (found, _)| {
                total.iter_mut().zip(found).for_each(|(total, found)| total.merge(found, keep));
                Ok(())
            },
        )?;
        Ok(total)
    }

    /// One tile: only its worst row can become a constraint, since its neighbours say much the same.
    fn tile(
        &self,
        limit: &LatentLimit,
        theta: &[f64],
        rows: &DesignRows,
        (first, episode, offset): (usize, usize, usize),
    ) -> Found {
        let n = self.regression.latents[limit.latent].functions.len();
        let theta = &theta[self.regression.first(limit.latent)..][..n];
        let mut values = vec![0.0; rows.rows()];
        for (k, &theta) in theta.iter().enumerate().filter(|(_, theta)| **theta != 0.0) {
            values.iter_mut().zip(rows.output(first + k)).for_each(|(value, phi)| *value += theta * phi);
        }
        let bounds = rows.output(first + n);
        let mut found = Found::new();
        let mut worst = None;
        for (i, (&value, &bound)) in values.iter().zip(bounds).enumerate() {
            found.size = found.size.max(value.abs());
            let clearance = match limit.side {
                Limit::AtLeast => value - bound,
                Limit::AtMost => bound - value,
            };
            if clearance < found.least {
                (found.least, worst) = (clearance, Some(i));
            }
        }
        found.place = worst.map(|i| (episode, offset + rows.index[i]));
        if let (Some(i), true) = (worst, found.least < 0.0) {
            let functions = (0..n).map(|k| rows.output(first + k)[i]).collect();
            let row = offset + rows.index[i];
            found.breaches.push(Breach { clearance: found.least, episode, row, functions, bound: bounds[i] });
        }
        found
    }

    /// The limit at a row, tightened by the margin.
    fn constraint(&self, at: usize, breach: &Breach, margin: f64) -> LinearConstraint {
        let limit = &self.limits[at];
        let (sign, symbol) = match limit.side {
            Limit::AtLeast => (1.0, ">="),
            Limit::AtMost => (-1.0, "<="),
        };
        let first = self.regression.first(limit.latent);
        let latent = &self.regression.latents[limit.latent].name;
        let episode = &self.source.episodes()[breach.episode].name;
        LinearConstraint {
            name: format!("{latent} {symbol} {} at row {} of {episode}", limit.bound, breach.row),
            coefficients: breach.functions.iter().enumerate().map(|(k, phi)| (first + k, sign * phi)).collect(),
            bound: sign * breach.bound + margin,
        }
    }

    fn clearance(&self, found: &Found) -> Clearance {
        let place = found.place.map(|(episode, row)| (self.source.episodes()[episode].name.clone(), row));
        Clearance { least: found.least, place, size: found.size }
    }
}
