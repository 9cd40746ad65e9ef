//! Supports that compete: those of an optimiser's path, of backward elimination, and the simplest ones.

use fleetfoot_stats::Compressed;

use super::{
    Optimizer, Scaling, Step, Terms, ThresholdError, Thresholds, Trail,
    prepared::Prepared,
    ssr::{Removal, Ssr},
    sweep::sweep_thresholds,
};

/// Models that compete with the optimiser's path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rivals {
    /// The supports of backward elimination: the first term removed is the one whose removal increases the error least.
    pub backward: bool,
    /// The model without any term that is not fixed.
    pub zero: bool,
    /// The model of this column alone, beside the fixed ones: the constant.
    pub alone: Option<usize>,
}

impl Rivals {
    /// Terms from which backward elimination starts, at most: each removal costs a regression of that size. Of more candidates it starts from the largest model of
    /// the optimiser's path that is no larger.
    pub const START: usize = 150;

    /// The models of one target: the optimiser's path (over thresholds where it has one), and those rivals whose supports are not on it.
    ///
    /// # Errors
    /// As [`sweep_thresholds`].
    pub(super) fn trail(
        self,
        problem: &Compressed,
        target: usize,
        optimizer: &Optimizer,
        terms: &Terms,
        thresholds: &Thresholds,
    ) -> Result<Trail, ThresholdError> {
        let mut trail = sweep_thresholds(problem, target, optimizer, terms, thresholds)?;
        let prepared = Prepared::new(problem, terms, Scaling::Physical, 0.0)?;
        if self.backward {
            for step in backward(problem, target, terms, &trail)? {
                let parameter = parameter(&prepared, target, optimizer, &step);
                add(&mut trail, Step { parameter, ..step });
            }
        }
        for (wanted, alone) in [(self.alone.is_some(), self.alone), (self.zero, None)] {
            let is_kept = |j: &usize| prepared.fixed[*j] || alone == Some(*j);
            let support: Vec<usize> = prepared.open.iter().copied().filter(is_kept).collect();
            if wanted {
                let step = prepared.step(target, support.clone(), prepared.refit(&support, target), false);
                let parameter = parameter(&prepared, target, optimizer, &step);
                add(&mut trail, Step { parameter, ..step });
            }
        }
        Ok(trail)
    }
}

/// A model, unless its support is there already.
fn add(trail: &mut Trail, step: Step) {
    if trail.steps.iter().all(|known| known.support != step.support) {
        trail.steps.push(step);
    }
}

/// The models of backward elimination, refitted.
fn backward(problem: &Compressed, target: usize, terms: &Terms, path: &Trail) -> Result<Vec<Step>, ThresholdError> {
    let allowed = |j: usize| terms.allowed.as_ref().is_none_or(|allowed| allowed[j]);
    let mut open: Vec<bool> = (0..problem.columns()).map(allowed).collect();
    if open.iter().filter(|open| **open).count() > Rivals::START {
        let sizes = path.steps.iter().filter(|step| step.terms() <= Rivals::START);
        let Some(largest) = sizes.max_by(|a, b| a.terms().cmp(&b.terms()).then(b.rss.total_cmp(&a.rss))) else {
            return Ok(Vec::new());
        };
        let fixed = terms.checked(problem)?.fixed;
        open = (0..problem.columns()).map(|j| largest.support.contains(&j) || fixed[j]).collect();
    }
    let ssr = Ssr {
        alpha: 0.0,
        max_removals: usize::MAX,
        scaling: Scaling::Physical,
        removal: Removal::Residual,
        ..Ssr::default()
    };
    let terms = Terms { allowed: Some(open), ..terms.clone() };
    Ok(ssr.trail(problem, target, &terms)?.steps)
}

/// Optimiser parameter of such a model: half of the largest threshold that keeps all its terms, or their number.
fn parameter(prepared: &Prepared<'_>, target: usize, optimizer: &Optimizer, step: &Step) -> f64 {
    let scaling = match optimizer {
        Optimizer::Stlsq(stlsq) => stlsq.scaling,
        Optimizer::Sr3(sr3) => sr3.scaling,
        _ => return step.terms() as f64,
    };
    let (unit, cut) = prepared.thresholded(scaling, target);
    let free = step.support.iter().filter(|&&j| !prepared.fixed[j]);
    let least = free.map(|&j| (unit(j) * step.coefficients[j]).abs()).fold(f64::INFINITY, f64::min);
    let threshold = if least.is_finite() && cut > 0.0 { least / cut / 2.0 } else { 0.0 };
    optimizer.parameter_of_threshold(threshold)
}
