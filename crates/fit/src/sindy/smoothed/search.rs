//! The search for terms with the states free: supports that compete by the remaining errors of the measurements.
//!
//! At given variances a support S has the value `2 J + price |S|`, J of [`StateSmoother`] at its minimum over the
//! states and the coefficients of S. The price is that of the extended Bayesian criterion for N measurements and P
//! candidates, `ln N + 2 ln P` (Chen and Chen 2008, gamma = 1). Supports to try come from the least squares of the
//! measurements on all candidates, the states eliminated. Backward elimination starts from the candidates that promise
//! most, and from the support with another candidate in it. Every tried support is settled on the rows themselves, and
//! taken only if its value is lower: the value falls from support to support.
//!
//! Between searches the variances of the measurements follow from their residuals, and those of the process are a share
//! of them. The ladder of shares goes down as long as the likelihood of the measurements grows, the states integrated
//! out (Laplace's approximation). A large share at first lets states follow the measurements while the equations are
//! still wrong.

use std::collections::BTreeSet;

use fleetfoot_data::Progress;
use fleetfoot_data::setting::SMOOTH_STATES;
use fleetfoot_estimate::{Settled, StateSmoother, Tracks, Variances};
use fleetfoot_sparse::threshold::{Optimizer, Removal, Scaling, Ssr, Terms, optimize};
use fleetfoot_stats::Compressed;

use crate::error::Error;

/// Variance of the process over a step as a share of that of a measurement.
const SHARES: [f64; 3] = [1e-2, 1e-4, 1e-6];
/// Candidates beside the support from which terms are taken away.
const OPENED: usize = 64;
/// Candidates that are tried beside the support, one at a time.
const BESIDE: usize = 4;
/// Supports that follow each other at given variances, at most.
const SUPPORTS: usize = 12;
/// Searches at one share, at most: after each the variances are those of the residuals.
const SEARCHES: usize = 3;
/// A descent ends where a step promises less than this share of the objective: while supports compete, and in the end.
const ROUGH: f64 = 1e-6;
const FINE: f64 = 1e-9;
/// Variances that change by less are settled.
const SETTLED: f64 = 0.05;

/// State of a search.
#[derive(Clone)]
pub(super) struct Place {
    /// Numbers of the candidates that are in, ascending.
    pub(super) support: Vec<usize>,
    pub(super) settled: Settled,
}

/// Result of a search.
pub(super) struct SearchResult {
    pub(super) place: Place,
    pub(super) variances: Variances,
    pub(super) share: f64,
    /// `2 J + price |S|` of the support that the search began with and of the last, at the last variances.
    pub(super) values: [f64; 2],
    /// Supports that were taken, and tried.
    pub(super) supports: [usize; 2],
}

pub(super) struct Search<'a> {
    pub(super) smoother: &'a StateSmoother,
    /// Candidates that stay.
    pub(super) fixed: &'a [usize],
    pub(super) progress: &'a dyn Progress,
}

/// A support that might be better.
struct Proposal {
    support: Vec<usize>,
    coefficients: Vec<f64>,
    value: f64,
}

impl Search<'_> {
    /// Searches from some coefficients (one a candidate).
    pub(super) fn run(&self, coefficients: &[f64]) -> Result<SearchResult, Error> {
        let mut measurement = self.smoother.noise();
        let mut counts = [0, 0];
        let mut best: Option<(f64, Place, Variances, f64)> = None;
        let begun = support_of(coefficients, self.fixed);
        let mut at = (self.smoother.recorded(), coefficients.to_vec(), begun.clone());
        for share in SHARES {
            let mut place = None;
            for _ in 0..SEARCHES {
                let variances = variances(&measurement, share);
                let from = self.settle((&at.0, &at.1), at.2.clone(), &variances, ROUGH)?;
                let descent = self.descend(from, &variances, &mut counts)?;
                at = (descent.settled.tracks.clone(), descent.settled.coefficients.clone(), descent.support.clone());
                let change = self.learn(&mut measurement, &descent);
                place = Some(descent);
                if change < SETTLED {
                    break;
                }
            }
            let Some(place) = place else { break };
            let variances = variances(&measurement, share);
            let place = self.settle((&at.0, &at.1), place.support, &variances, FINE)?;
            let likelihood = self.likelihood(&place, &variances);
            if best.as_ref().is_some_and(|(least, ..)| *least <= likelihood) {
                break;
            }
            best = Some((likelihood, place, variances, share));
        }
        let Some((_, place, variances, share)) = best else {
            return Err(Error::undetermined(format!(
                "{SMOOTH_STATES}: the variances of the noise could not be estimated"
            )));
        };
        let before = match self.settle((&place.settled.tracks, coefficients), begun, &variances, ROUGH) {
            Ok(before) => self.value(&before),
            Err(error @ Error::Cancelled(_)) => return Err(error),
            Err(_) => f64::INFINITY,
        };
        Ok(SearchResult { values: [before, self.value(&place)], place, variances, share, supports: counts })
    }

    /// Settles a support; coefficients beside it are zero.
    pub(super) fn settle(
        &self,
        (tracks, coefficients): (&Tracks, &[f64]),
        support: Vec<usize>,
        variances: &Variances,
        tolerance: f64,
    ) -> Result<Place, Error> {
        let mut step = vec![0.0; coefficients.len()];
        support.iter().for_each(|&at| step[at] = coefficients[at]);
        let settled = self.smoother.settle((tracks, &step), &support, (variances, tolerance), self.progress)?;
        Ok(Place { support, settled })
    }

    /// The states of some coefficients, from the recording on: under the largest share at first, as these may be far from the truth.
    pub(super) fn followed(&self, coefficients: &[f64], (measurement, share): (&[f64], f64)) -> Result<Settled, Error> {
        let mut tracks = self.smoother.recorded();
        if share < SHARES[0] {
            let variances = variances(measurement, SHARES[0]);
            tracks = self.smoother.settle((&tracks, coefficients), &[], (&variances, ROUGH), self.progress)?.tracks;
        }
        let variances = variances(measurement, share);
        Ok(self.smoother.settle((&tracks, coefficients), &[], (&variances, ROUGH), self.progress)?)
    }

    /// The coefficients of the same terms, and the states, from the recording on.
    pub(super) fn refitted(&self, coefficients: &[f64], (measurement, share): (&[f64], f64)) -> Result<Settled, Error> {
        let support = support_of(coefficients, self.fixed);
        let (tracks, variances) = (self.smoother.recorded(), variances(measurement, share));
        Ok(self.smoother.settle((&tracks, coefficients), &support, (&variances, ROUGH), self.progress)?)
    }

    /// From support to support, each of lower value than the one before, at given variances.
    fn descend(&self, from: Place, variances: &Variances, counts: &mut [usize; 2]) -> Result<Place, Error> {
        let mut place = from;
        let mut seen = BTreeSet::from([place.support.clone()]);
        for _ in 0..SUPPORTS {
            let Some(next) = self.better(&place, variances, &mut seen, &mut counts[1])? else { break };
            counts[0] += 1;
            place = next;
        }
        Ok(place)
    }

    /// The first proposal of lower value.
    fn better(
        &self,
        place: &Place,
        variances: &Variances,
        seen: &mut BTreeSet<Vec<usize>>,
        tried: &mut usize,
    ) -> Result<Option<Place>, Error> {
        for proposal in self.proposals(place, variances)? {
            // With another candidate and nothing less, the value is well foreseen.
            let more = place.support.iter().all(|support| proposal.support.contains(support));
            if (more && proposal.value >= self.value(place)) || !seen.insert(proposal.support.clone()) {
                continue;
            }
            *tried += 1;
            let at = (&place.settled.tracks, proposal.coefficients.as_slice());
            let trial = self.settle(at, proposal.support, variances, ROUGH);
            // A support with which the model is not finite is none.
            let trial = match trial {
                Ok(state) => state,
                Err(error @ Error::Cancelled(_)) => return Err(error),
                Err(_) => continue,
            };
            if self.value(&trial) < self.value(place) {
                return Ok(Some(trial));
            }
        }
        Ok(None)
    }

    /// Supports that may be better, the most promising first.
    fn proposals(&self, place: &Place, variances: &Variances) -> Result<Vec<Proposal>, Error> {
        let all: Vec<usize> = (0..self.smoother.candidates().len()).collect();
        let at = (&place.settled.tracks, place.settled.coefficients.as_slice());
        let problem = self.smoother.information(at, &all, variances, self.progress)?;
        let beside = by_gain(&problem, &place.support);
        let opened = |count: usize| place.support.iter().chain(beside.iter().take(count)).copied().collect::<Vec<_>>();
        let mut states = vec![self.eliminated(&problem, &opened(OPENED), None)?];
        states.push(self.eliminated(&problem, &place.support, None)?);
        for &one in beside.iter().take(BESIDE) {
            let support = place.support.iter().copied().chain([one]).collect::<Vec<_>>();
            states.push(self.eliminated(&problem, &support, Some(one))?);
        }
        let mut proposals: Vec<Proposal> = states.into_iter().flatten().collect();
        proposals.sort_by(|a, b| a.value.total_cmp(&b.value));
        Ok(proposals)
    }

    /// The best support that backward elimination meets; `kept` stays in.
    fn eliminated(
        &self,
        problem: &Compressed,
        opened: &[usize],
        kept: Option<usize>,
    ) -> Result<Option<Proposal>, Error> {
        let mut allowed = vec![false; problem.columns()];
        opened.iter().for_each(|&at| allowed[at] = true);
        if opened.is_empty() {
            return Ok(None);
        }
        let mut fixed: Vec<usize> = self.fixed.iter().copied().chain(kept).collect();
        fixed.sort_unstable();
        fixed.dedup();
        let backward = Ssr {
            alpha: 0.0,
            max_removals: opened.len(),
            scaling: Scaling::Physical,
            removal: Removal::Residual,
            unbias: false,
            ..Ssr::default()
        };
        let terms = Terms { allowed: Some(allowed), fixed, ..Terms::all() };
        let trail = optimize(problem, 0, &Optimizer::Ssr(backward), &terms)?;
        let value = |step: &fleetfoot_sparse::threshold::Step| step.rss + self.price() * step.terms() as f64;
        let best = trail.steps.iter().min_by(|a, b| value(a).total_cmp(&value(b)));
        Ok(best.map(|step| Proposal {
            support: step.support.clone(),
            coefficients: step.coefficients.clone(),
            value: value(step),
        }))
    }

    /// Price of a term, in twice the objective.
    pub(super) fn price(&self) -> f64 {
        let measured = self.smoother.measured().iter().sum::<usize>().max(1) as f64;
        measured.ln() + 2.0 * (self.smoother.candidates().len().max(1) as f64).ln()
    }

    fn value(&self, place: &Place) -> f64 {
        2.0 * place.settled.cost + self.price() * place.support.len() as f64
    }

    /// Updates the variances of the measurements from their residuals: shared out by the states' deviations, so that
    /// the whole has as much as degrees of freedom. Returns the largest relative change.
    fn learn(&self, measurement: &mut [f64], place: &Place) -> f64 {
        let counts = self.smoother.measured();
        let (total, states) = (counts.iter().sum::<usize>() as f64, measurement.len() as f64);
        let free = (self.smoother.segments() as f64 * states + place.support.len() as f64).min(0.5 * total);
        let ratio = |s: usize| place.settled.misfit[s] / (counts[s].max(1) as f64 * measurement[s]);
        let mean = (0..measurement.len()).map(|s| ratio(s) * counts[s] as f64).sum::<f64>() / total;
        let whole = 2.0 * place.settled.cost / (total - free);
        let factors: Vec<f64> = (0..measurement.len()).map(|s| ratio(s) / mean * whole).collect();
        let mut change = 0.0_f64;
        for (measurement, factor) in measurement.iter_mut().zip(factors).filter(|(_, f)| f.is_finite() && *f > 0.0) {
            *measurement *= factor;
            change = change.max(factor.ln().abs());
        }
        change
    }

    /// Minus twice the logarithm of the likelihood, the states integrated out, and the price of the terms.
    fn likelihood(&self, place: &Place, variances: &Variances) -> f64 {
        let counts = self.smoother.measured();
        let measured =
            counts.iter().zip(&variances.measurement).map(|(&count, measurement)| count as f64 * measurement.ln());
        let process = variances.process.iter().map(|process| self.smoother.intervals() as f64 * process.ln());
        self.value(place) + place.settled.log_determinant + measured.chain(process).sum::<f64>()
    }
}

/// Variances of the process as a share of those of the measurements.
pub(super) fn variances(measurement: &[f64], share: f64) -> Variances {
    Variances {
        measurement: measurement.to_vec(),
        process: measurement.iter().map(|measurement| share * measurement).collect(),
    }
}

/// Coefficients that are not zero, and those that stay.
fn support_of(coefficients: &[f64], fixed: &[usize]) -> Vec<usize> {
    (0..coefficients.len()).filter(|at| coefficients[*at] != 0.0 || fixed.contains(at)).collect()
}

/// Candidates beside a support, by the reduction of the sum of squares by each alone, the largest first.
fn by_gain(problem: &Compressed, support: &[usize]) -> Vec<usize> {
    let p = problem.columns();
    let others: Vec<usize> = (0..p).filter(|at| !support.contains(at)).collect();
    let order: Vec<usize> = support.iter().chain(&others).copied().collect();
    let sorted = problem.select(&order);
    let k = support.len();
    let gain = |place: usize| {
        let column = &sorted.r.col_as_slice(place)[k..=place];
        let length: f64 = column.iter().map(|value| value * value).sum();
        let along: f64 = column.iter().zip(&sorted.z.col_as_slice(0)[k..]).map(|(r, z)| r * z).sum();
        if length > sorted.noise[place].powi(2) { along * along / length } else { 0.0 }
    };
    let mut gains: Vec<(f64, usize)> = (k..p).map(|place| (gain(place), order[place])).collect();
    gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    gains.into_iter().filter(|(gain, _)| *gain > 0.0).map(|(_, at)| at).collect()
}
