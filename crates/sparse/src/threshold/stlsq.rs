//! Sequentially thresholded least squares.

use fleetfoot_data::checkpoint;
use fleetfoot_stats::Compressed;

use super::{
    Scaling, Status, Step, Terms, ThresholdError, Trail,
    error::not_negative,
    prepared::{Prepared, Solved},
    run::Run,
};
use crate::SparseError;

/// Sequentially thresholded least squares (Brunton, Proctor and Kutz 2016; with a ridge, Rudy et al. 2017): regress,
/// drop the terms below the threshold, regress on the rest, until no term is dropped.
///
/// Each regression minimises `sum w (y - x'b)^2 + alpha sum_j (u_j b_j)^2` over the remaining columns, u the units of
/// [`Scaling`]; dropped is `|u_j b_j| < threshold`. Between bounds of [`Terms`] each regression is least squares within
/// them, and a term that a bound holds at 0 is dropped. Defaults, stopping rule and last refit are those of pysindy's
/// `STLSQ`.
#[derive(Debug, Clone, PartialEq)]
pub struct Stlsq {
    /// Coefficients below it are dropped, in the units of `scaling`.
    pub threshold: f64,
    /// The ridge; it is not multiplied by the number of rows.
    pub alpha: f64,
    /// The most regressions.
    pub max_iterations: usize,
    /// Units of the coefficients that are thresholded and penalised.
    pub scaling: Scaling,
    /// True if the remaining terms are refitted without the ridge.
    pub unbias: bool,
    /// A first guess (p). As in pysindy, the first regression is on all columns whatever the guess is. Only the
    /// stopping rule compares with it: the iteration ends when the first regression keeps the terms of the guess.
    pub initial: Option<Vec<f64>>,
}

impl Default for Stlsq {
    fn default() -> Self {
        Self {
            threshold: 0.1,
            alpha: 0.05,
            max_iterations: 20,
            scaling: Scaling::Physical,
            unbias: true,
            initial: None,
        }
    }
}

impl Stlsq {
    pub(super) fn check(&self, columns: usize) -> Result<(), ThresholdError> {
        not_negative("the threshold", self.threshold)?;
        if self.max_iterations == 0 {
            return Err(ThresholdError::NotPositive { name: "max_iterations", value: 0.0 });
        }
        match &self.initial {
            Some(initial) if initial.len() != columns => {
                let (count, expected) = (initial.len(), columns);
                Err(SparseError::Length { what: "the first guess", actual: count, expected }.into())
            }
            _ => Ok(()),
        }
    }

    pub(super) fn trail(&self, problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
        self.check(problem.columns())?;
        let prepared = Prepared::new(problem, terms, self.scaling, self.alpha)?;
        prepared.check_target(target)?;
        Ok(Trail::single(self.run(&prepared, target, self.threshold).step))
    }

    /// One threshold on a prepared problem.
    pub(super) fn run(&self, prepared: &Prepared<'_>, target: usize, threshold: f64) -> Run {
        self.watched(prepared, target, threshold, |_, _| {})
    }

    /// The same; `watch` sees the columns that each iteration keeps, and their coefficients.
    pub(super) fn watched(
        &self,
        prepared: &Prepared<'_>,
        target: usize,
        threshold: f64,
        mut watch: impl FnMut(&[usize], &[f64]),
    ) -> Run {
        let cut = prepared.cut(threshold, target);
        let mut active = prepared.open.clone();
        let mut before: Option<Vec<usize>> = self.initial.as_ref().map(|guess| nonzero(guess));
        let (mut dropped, mut kept, mut least) = (0.0_f64, f64::INFINITY, f64::INFINITY);
        let (mut iterations, mut status) = (0, Status::MaxIterations);
        let mut triangle = prepared.ridged(&active, target);
        let mut solved = Solved { values: Vec::new(), confounded: Vec::new() };
        while iterations < self.max_iterations {
            checkpoint();
            solved = prepared.solve(&triangle, &active);
            iterations += 1;
            kept = f64::INFINITY;
            let mut places = Vec::with_capacity(active.len());
            for (place, (&j, value)) in active.iter().zip(&solved.values).enumerate() {
                let size = (prepared.unit[j] * value).abs();
                // Not `size < cut`: what is not a number stays, and is seen.
                let small = size < cut && !prepared.fixed[j];
                if prepared.held_out(j, *value) {
                    continue;
                }
                if small {
                    dropped = dropped.max(size / cut);
                } else {
                    places.push(place);
                    kept = if prepared.fixed[j] { kept } else { kept.min(size) };
                }
            }
            least = least.min(kept);
            let all = places.len() == active.len();
            if !all {
                triangle = triangle.select(&places, 0);
                active = places.iter().map(|&place| active[place]).collect();
                solved.values = places.iter().map(|&place| solved.values[place]).collect();
            }
            watch(&active, &solved.values);
            if all || before.take().is_some_and(|before| before == active) {
                status = Status::Converged;
                break;
            }
            if active.is_empty() {
                break;
            }
        }
        if active.iter().all(|&j| prepared.fixed[j]) && !prepared.open.iter().all(|&j| prepared.fixed[j]) {
            status = Status::Empty;
        }
        let solved = if self.unbias { prepared.refit(&active, target) } else { solved };
        let mut step = prepared.step(target, active, solved, !self.unbias);
        step.certificate.dropped = dropped;
        let unit = prepared.cut(1.0, target);
        step.certificate.kept = if cut > 0.0 { kept / cut } else { f64::INFINITY };
        Run {
            step: Step { iterations, status, parameter: threshold, ..step },
            least: least / unit,
            most: dropped * threshold,
        }
    }
}

/// Indices of the entries that are not zero.
pub(super) fn nonzero(values: &[f64]) -> Vec<usize> {
    (0..values.len()).filter(|&j| values[j] != 0.0).collect()
}
