//! Models over thresholds: a grid, a list, or every threshold at which the model changes.

use fleetfoot_stats::Compressed;

use super::{
    Optimizer, Regularizer, Sr3, Step, Stlsq, Terms, ThresholdError, Trail,
    criteria::{Criterion, CriterionOptions, rounding, scores},
    error::{not_negative, positive, share},
    optimizer::optimize,
    prepared::Prepared,
    run::Run,
};

/// Thresholds (lambdas, for SR3) to compare. Other optimisers make their own sequence of models.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Thresholds {
    /// `count` of them in equal factors: from just above the largest coefficient of the first regression, where no term
    /// remains, down to `ratio` of it.
    Grid {
        /// Number of thresholds.
        count: usize,
        /// The smallest over the largest.
        ratio: f64,
    },
    /// These.
    List(Vec<f64>),
    /// Every threshold, from 0 up, at which an iteration of STLSQ, or of SR3 with l0, selects other terms. There is one
    /// model for every support, at the (geometric) middle of the thresholds that give it: slightly different data have
    /// it there too. If there would be more than `most`, the upper half of the budget is spread in equal factors.
    Changes {
        /// The most thresholds that are tried.
        most: usize,
    },
}

impl Default for Thresholds {
    fn default() -> Self {
        Self::Grid { count: 40, ratio: 1e-4 }
    }
}

/// All models of one target over the thresholds, the sparsest end first for STLSQ and SR3; for the other optimisers those of [`optimize`]. Chosen is the one with the
/// least BIC for STLSQ and SR3.
///
/// # Errors
/// As [`optimize`], and when a threshold is out of range.
pub fn sweep_thresholds(
    problem: &Compressed,
    target: usize,
    optimizer: &Optimizer,
    terms: &Terms,
    thresholds: &Thresholds,
) -> Result<Trail, ThresholdError> {
    let swept: Swept<'_> = match optimizer {
        Optimizer::Stlsq(stlsq) => {
            stlsq.check(problem.columns())?;
            Swept::Stlsq(stlsq, Prepared::new(problem, terms, stlsq.scaling, stlsq.alpha)?)
        }
        Optimizer::Sr3(sr3) => Swept::Sr3(sr3, sr3.prepared(problem, terms)?),
        _ => return optimize(problem, target, optimizer, terms),
    };
    swept.prepared().check_target(target)?;
    let steps = match thresholds {
        Thresholds::List(list) => swept.at(target, list)?,
        Thresholds::Grid { count, ratio } => swept.at(target, &swept.grid(target, *count, *ratio)?)?,
        Thresholds::Changes { most } => swept.changes(target, *most)?,
    };
    let candidates = swept.prepared().open.len();
    let chosen = scores(&steps, problem, target, candidates, &CriterionOptions::default())?.best(Criterion::Bic);
    Ok(Trail { steps, chosen, order: Vec::new(), rounding: rounding(problem, target) })
}

/// An optimiser with a threshold, on its problem.
enum Swept<'a> {
    Stlsq(&'a Stlsq, Prepared<'a>),
    Sr3(&'a Sr3, Prepared<'a>),
}

/// A model, and the thresholds that give it.
struct Reign {
    step: Step,
    from: f64,
    to: f64,
    /// True if the iterations take the same steps under all of them.
    one_way: bool,
}

impl Reign {
    /// The threshold in the middle: at the ends, the least change of the data gives another model.
    fn middle(&self) -> f64 {
        match (self.from > 0.0, self.to.is_finite()) {
            (true, true) => (self.from * self.to).sqrt().clamp(self.from, self.to.max(self.from)),
            (false, true) => self.to / 2.0,
            (_, false) => 2.0 * self.from,
        }
    }
}

impl Swept<'_> {
    fn prepared(&self) -> &Prepared<'_> {
        match self {
            Self::Stlsq(_, prepared) | Self::Sr3(_, prepared) => prepared,
        }
    }

    fn run(&self, target: usize, parameter: f64) -> Run {
        match self {
            Self::Stlsq(stlsq, prepared) => stlsq.run(prepared, target, parameter),
            Self::Sr3(sr3, prepared) => sr3.run(prepared, target, parameter),
        }
    }

    /// The threshold on coefficients as the optimiser's parameter.
    fn parameter(&self, cut: f64) -> f64 {
        match self {
            Self::Stlsq(..) => cut,
            Self::Sr3(sr3, _) => Optimizer::Sr3((*sr3).clone()).parameter_of_threshold(cut),
        }
    }

    /// The threshold on coefficients that a parameter stands for, up to a factor.
    fn cut(&self, parameter: f64) -> f64 {
        match self {
            Self::Sr3(Sr3 { regularizer: Regularizer::L0, .. }, _) => parameter.sqrt(),
            _ => parameter,
        }
    }

    /// A model under another threshold, for which the iterations go the same way.
    fn moved(&self, mut step: Step, parameter: f64) -> Step {
        let ratio = self.cut(step.parameter) / self.cut(parameter);
        step.certificate.dropped *= ratio;
        step.certificate.kept *= ratio;
        Step { parameter, ..step }
    }

    /// Just above the largest coefficient of the first regression, fixed terms not counted.
    fn largest(&self, target: usize) -> f64 {
        let prepared = self.prepared();
        let values = match self {
            Self::Stlsq(..) => prepared.solve(&prepared.ridged(&prepared.open, target), &prepared.open).values,
            Self::Sr3(sr3, _) => sr3.first(prepared, target),
        };
        let free = prepared.open.iter().zip(&values).filter(|(j, _)| !prepared.fixed[**j]);
        let size = free.map(|(&j, value)| (prepared.unit[j] * value).abs()).fold(0.0, f64::max);
        let size = size / prepared.cut(1.0, target);
        if size.is_finite() { size * (1.0 + 1e-9) } else { 0.0 }
    }

    fn grid(&self, target: usize, count: usize, ratio: f64) -> Result<Vec<f64>, ThresholdError> {
        share("the ratio of the smallest threshold to the largest", positive("the ratio of thresholds", ratio)?)?;
        let largest = self.largest(target);
        let exponent = |k: usize| k as f64 / count.saturating_sub(1).max(1) as f64;
        Ok((0..count).map(|k| self.parameter(largest * ratio.powf(exponent(k)))).collect())
    }

    /// Models at given parameters, descending.
    fn at(&self, target: usize, list: &[f64]) -> Result<Vec<Step>, ThresholdError> {
        let mut list = list.to_vec();
        for &threshold in &list {
            not_negative("a threshold", threshold)?;
        }
        list.sort_by(|a, b| b.total_cmp(a));
        if list.is_empty() {
            let (what, mend) = ("there is no threshold to try", "give a list, or a grid of one or more");
            return Err(ThresholdError::Nothing { what, mend });
        }
        let mut steps: Vec<Step> = Vec::with_capacity(list.len());
        let mut most = f64::INFINITY;
        for threshold in list {
            // A margin for the rounding of thresholds relative to the target.
            let same = steps.last().filter(|_| threshold > most * (1.0 + 1e-12)).cloned();
            steps.push(match same {
                Some(step) => self.moved(step, threshold),
                None => {
                    let run = self.run(target, threshold);
                    most = run.most;
                    run.step
                }
            });
        }
        Ok(steps)
    }

    fn changes(&self, target: usize, most: usize) -> Result<Vec<Step>, ThresholdError> {
        if let Self::Sr3(Sr3 { regularizer: Regularizer::L1 | Regularizer::L2, .. }, _) = self {
            let what = "the models of SR3 with l1 or l2 change with every lambda";
            return Err(ThresholdError::Nothing { what, mend: "give a grid or a list of lambdas" });
        }
        let largest = self.parameter(self.largest(target));
        let (mut reigns, mut parameter) = (Vec::<Reign>::new(), 0.0_f64);
        for tried in 0..most.max(2) {
            let Run { step, least, .. } = self.run(target, parameter);
            let to = self.parameter(least);
            match reigns.last_mut().filter(|last| last.step.support == step.support) {
                Some(last) => (last.to, last.one_way) = (to, false),
                None => reigns.push(Reign { step, from: parameter, to, one_way: parameter > 0.0 }),
            }
            if !least.is_finite() {
                break;
            }
            let mut next = to.max(parameter).next_up();
            let left = most.max(2) - tried;
            if tried >= most / 2 && parameter > 0.0 && parameter < largest {
                next = next.max(parameter * (largest / parameter).powf(1.0 / left as f64));
            }
            parameter = next;
        }
        let at_middle = |reign: Reign| match (reign.middle(), reign.one_way) {
            (middle, true) => self.moved(reign.step, middle),
            (middle, false) => self.run(target, middle).step,
        };
        let mut steps: Vec<Step> = reigns.into_iter().map(at_middle).collect();
        steps.reverse();
        Ok(steps)
    }
}
