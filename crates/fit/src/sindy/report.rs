//! Report of an equation fit, for people and for programs.

use fleetfoot_model::factor;
use fleetfoot_stats::Compressed;
use fleetfoot_task::{DifferenceErrors, EquationTask};
use serde::Serialize;

use super::{solve::Solved, words::short};
use crate::{
    limit_report::{FreeErrors, LimitReport},
    sindy::{ParameterReport, StateSmoothing},
    summary::FitSummary,
};

/// Report of an equation fit.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SindyReport {
    /// Rows of positive weight.
    pub rows: u64,
    /// Method of the term selection, for people.
    pub method: String,
    /// Criterion of the number of terms, for people.
    pub choice: String,
    /// Folds of the held-out errors; 0 where there are none.
    pub folds: usize,
    /// Rule by which rows were held out, for people; `None` without folds.
    pub fold_rule: Option<String>,
    /// The part that an ensemble varied, for people.
    pub ensemble: Option<String>,
    /// The windows that equations are fitted on in the place of rows, for people; `None` where rows are taken as they are.
    #[serde(rename = "weak", skip_serializing_if = "Option::is_none")]
    pub windows: Option<String>,
    /// Estimated numbers inside expressions.
    pub parameters: Vec<ParameterReport>,
    /// Candidate functions of any equation, the constant among them.
    pub candidates: Vec<String>,
    /// The regions; one without a partition.
    #[serde(flatten, serialize_with = "crate::json::sindy::with_paths")]
    pub regions: Vec<RegionReport>,
    /// The equations that were found in turn with smoothed states, where that was done.
    #[serde(rename = "smooth_states", skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<StateSmoothing>,
    /// Bounds of coefficients under `[constraints]`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub limits: Vec<LimitReport>,
    /// The part of the report that all methods share.
    #[serde(flatten)]
    pub summary: FitSummary,
}

/// A region and its equations.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct RegionReport {
    /// Its name.
    pub name: String,
    /// Its rows.
    pub rows: u64,
    /// The fitted equations.
    pub equations: Vec<EquationReport>,
}

/// A fitted equation in a region.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct EquationReport {
    /// The left side.
    pub label: String,
    /// The right side with numbers for coefficients, its nominal part included.
    pub right: String,
    /// The fitted terms.
    pub terms: Vec<TermReport>,
    /// Number of candidates that it had.
    pub candidates: usize,
    /// Root mean squared error on the rows of the fit.
    pub rms: f64,
    /// Share of the variance of the fitted part (the target less the nominal part) that is explained on these rows; NaN
    /// if it does not vary.
    pub r2: f64,
    /// Root mean squared error on held-out rows; NaN without folds.
    #[serde(rename = "held_out_rms")]
    pub held_out: f64,
    /// Share of that variance that is explained on held-out rows; NaN without folds.
    pub held_out_r2: f64,
    /// `rms` and `held_out` of the equation that is found without `[constraints]`, by the same rule on the same folds: their price.
    #[serde(flatten)]
    pub free: Option<FreeErrors>,
    /// The threshold, lambda or number of terms of the model that was taken.
    pub parameter: f64,
    /// Largest cosine between the residual and a term: 0 up to rounding for least squares.
    pub correlation: f64,
    /// Error against number of terms, ascending by terms.
    pub front: Vec<FrontPoint>,
    /// Functions of any model of [`Self::front`], the largest first, with their contribution to each model. A
    /// contribution is the coefficient times the root mean square over the rows, in the unit of the left side. Of very
    /// many functions those with the largest contributions.
    #[serde(skip)]
    pub along: Vec<(String, Vec<f64>)>,
    /// Number of functions that any model of [`Self::front`] has.
    #[serde(skip)]
    pub entered: usize,
    /// Share of an ensemble's members that have each candidate, where there is an ensemble (candidates of [`SindyReport::candidates`]).
    pub inclusion: Option<Vec<f64>>,
    /// Groups of confounded terms.
    pub confounded: Vec<Vec<String>>,
    /// Error of central differences, if the left side is measured by them.
    pub difference: Option<DifferenceErrors>,
}

/// A term.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TermReport {
    /// The function; `1` for the constant.
    pub function: String,
    /// Its index among the candidates.
    #[serde(skip)]
    pub candidate: usize,
    /// Its coefficient.
    pub coefficient: f64,
    /// Unit of the coefficient, where those of the left side and of the function are known.
    pub unit: Option<String>,
    /// Standard error of the coefficient, given the terms; NaN if it is not known.
    pub standard_error: f64,
    /// Share of an ensemble's members that have the term, where there is one.
    pub inclusion: Option<f64>,
    /// True if the term is in every model.
    pub fixed: bool,
}

/// A model of the front: none with as few terms errs less.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct FrontPoint {
    /// Number of terms.
    pub terms: usize,
    /// Root mean squared error on the rows of the fit.
    pub rms: f64,
    /// Root mean squared error on held-out rows of the models of as many terms; NaN without folds.
    #[serde(rename = "held_out_rms")]
    pub held_out: f64,
    /// The threshold, lambda or number of terms.
    pub parameter: f64,
    /// True for the model that was taken.
    pub chosen: bool,
    /// Its terms.
    pub functions: Vec<String>,
}

impl EquationReport {
    /// Puts the equation, which is on no front, beside those that are, as the one that was taken. `contributions`: of each of its functions.
    pub(super) fn choose_beside(&mut self, contributions: &[(String, f64)]) {
        self.front.iter_mut().for_each(|point| point.chosen = false);
        let place = self.front.partition_point(|point| point.terms <= contributions.len());
        let contribution =
            |name: &str| contributions.iter().find(|(function, _)| function == name).map_or(0.0, |(_, value)| *value);
        for (name, values) in &mut self.along {
            values.insert(place, contribution(name));
        }
        for (name, value) in contributions {
            if self.along.iter().all(|(function, _)| function != name) {
                let mut values = vec![0.0; self.front.len() + 1];
                values[place] = *value;
                self.along.push((name.clone(), values));
                self.entered += 1;
            }
        }
        let point = FrontPoint {
            terms: contributions.len(),
            rms: self.rms,
            held_out: self.held_out,
            parameter: self.parameter,
            chosen: true,
            functions: contributions.iter().map(|(name, _)| name.clone()).collect(),
        };
        self.front.insert(place, point);
    }
}

/// Functions that are listed along the front of an equation.
const ALONG: usize = 24;

/// The report of a fitted equation. `problem`: the moments of the region's rows; `error`: the standard error of a candidate.
pub(super) fn equation(
    task: &EquationTask,
    target: usize,
    solved: &Solved,
    problem: &Compressed,
    error: impl Fn(usize) -> f64,
) -> EquationReport {
    let equation = &task.fitted[target];
    let step = &solved.step;
    let (weight, total) = (problem.weight, problem.total[target]);
    let rms = |rss: f64| (rss / weight).sqrt();
    let terms: Vec<TermReport> = step
        .support
        .iter()
        .map(|&j| TermReport {
            function: task.candidate(j),
            candidate: j,
            coefficient: step.coefficients[j],
            unit: task.coefficient_unit(target, j),
            standard_error: error(j),
            inclusion: solved.inclusion.as_ref().map(|shares| shares[j]),
            fixed: equation.fixed.contains(&j),
        })
        .collect();
    let names = |columns: &[usize]| columns.iter().map(|&j| task.candidate(j)).collect::<Vec<_>>();
    let sweep = &solved.sweep;
    let mut shown = sweep.front.clone();
    if !shown.contains(&sweep.chosen) {
        shown.push(sweep.chosen);
        shown.sort_by_key(|&k| sweep.trail.steps[k].terms());
    }
    let point = |&k: &usize| {
        let step = &sweep.trail.steps[k];
        FrontPoint {
            terms: step.terms(),
            rms: rms(step.rss),
            held_out: sweep.folds.as_ref().map_or(f64::NAN, |folds| folds.mean[k].sqrt()),
            parameter: step.parameter,
            chosen: k == sweep.chosen,
            functions: names(&step.support),
        }
    };
    let (along, entered) = along(task, solved, problem, &shown);
    EquationReport {
        label: equation.label.clone(),
        right: right(task, target, &terms),
        candidates: equation.allowed.iter().filter(|allowed| **allowed).count(),
        rms: rms(step.rss),
        // A region may rest where the others move: nothing is explained there.
        r2: if total > sweep.trail.rounding { 1.0 - step.rss / total } else { f64::NAN },
        held_out: solved.held_out[0].sqrt(),
        held_out_r2: solved.held_out[1],
        free: None,
        parameter: step.parameter,
        correlation: step.certificate.correlation,
        front: shown.iter().map(point).collect(),
        along,
        entered,
        inclusion: solved.inclusion.clone(),
        confounded: step.confounded.iter().map(|group| names(group)).collect(),
        difference: equation.central.as_ref().and_then(|central| central.errors),
        terms,
    }
}

/// Contribution of each function to the models of a front, the largest first, and the number of functions.
fn along(
    task: &EquationTask,
    solved: &Solved,
    problem: &Compressed,
    front: &[usize],
) -> (Vec<(String, Vec<f64>)>, usize) {
    let steps = || front.iter().map(|&k| &solved.sweep.trail.steps[k]);
    let rms = |j: usize| (problem.r.col_as_slice(j)[..=j].iter().map(|v| v * v).sum::<f64>() / problem.weight).sqrt();
    let members: std::collections::BTreeSet<usize> = steps().flat_map(|step| step.support.iter().copied()).collect();
    let contributions = |&j: &usize| {
        let scale = rms(j);
        (j, steps().map(|step| scale * step.coefficients[j]).collect::<Vec<f64>>())
    };
    let mut all: Vec<(usize, Vec<f64>)> = members.iter().map(contributions).collect();
    let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    all.sort_by(|a, b| largest(&b.1).total_cmp(&largest(&a.1)).then(a.0.cmp(&b.0)));
    all.truncate(ALONG);
    (all.into_iter().map(|(j, values)| (task.candidate(j), values)).collect(), members.len())
}

/// The right side with the fitted part written out behind the nominal part.
pub(super) fn right(task: &EquationTask, target: usize, terms: &[TermReport]) -> String {
    let learnt = sum(terms.iter().map(|term| (term.function.as_str(), term.coefficient)));
    let nominal = &task.fitted[target].nominal;
    match nominal {
        None => learnt,
        Some(nominal) if learnt == "0" => nominal.to_string(),
        Some(nominal) => match learnt.strip_prefix('-') {
            Some(rest) => format!("{nominal} - {rest}"),
            None => format!("{nominal} + {learnt}"),
        },
    }
}

/// A sum of coefficients times functions, for people.
pub(super) fn sum<'a>(terms: impl Iterator<Item = (&'a str, f64)>) -> String {
    let mut text = String::new();
    for (function, coefficient) in terms {
        let size = short(coefficient.abs());
        let product = if function == "1" { size } else { format!("{size}*{}", factor(function.to_owned())) };
        text.push_str(match (text.is_empty(), coefficient < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        });
        text.push_str(&product);
    }
    if text.is_empty() { "0".into() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_printed_with_signs() {
        let terms = [("1", -0.5), ("x", 28.0), ("x*z", -1.0), ("sin(x)", 1.234_567_8e-7), ("x - v", 2.0)];
        assert_eq!(sum(terms.into_iter()), "-0.5 + 28*x - 1*x*z + 1.23457e-7*sin(x) + 2*(x - v)");
        assert_eq!(sum(std::iter::empty()), "0");
        assert_eq!(short(2.666_666_666_7), "2.66667");
    }
}
