//! Forward regression by orthogonal least squares, with error reduction ratios.

use fleetfoot_data::checkpoint;
use fleetfoot_stats::{Compressed, householder::reflector};

use super::{
    Scaling, Status, Step, Terms, ThresholdError, Trail,
    criteria::{Criterion, CriterionOptions, scores},
    error::{not_negative, share},
    prepared::{Prepared, Solved},
    triangle::Triangle,
};
use crate::kernel::{LANES, Slab, add_scaled, dot};

/// Candidates whose reductions differ by a smaller share reduce alike, as `s` and `s^3` of a sign do: the first one is taken, the simpler one of a library.
const TIE: f64 = 1e-9;

/// Forward regression by orthogonal least squares (Billings, Chen and Korenberg 1989; Billings 2013, chapter 3). It
/// adds one term after the other, always the one with the largest error reduction ratio. The ratio is
/// `ERR_j = (w_j'y)^2 / (w_j'w_j y'y)`, with w_j the remainder of column j beyond the terms in the model.
///
/// The sums of squares are about zero, not about the mean, as there: the constant is a term like the others. The columns are orthogonalised by Householder
/// reflections of R, which do not lose orthogonality where Gram and Schmidt do.
#[derive(Debug, Clone, PartialEq)]
pub struct Frols {
    /// The most terms, fixed ones not counted.
    pub max_terms: usize,
    /// Ridge on the coefficients in the system that leads back from the orthogonal terms, as pysindy has it; no matter with `unbias`.
    pub alpha: f64,
    /// Units of the coefficients that the ridge is on; the selection does not depend on it.
    pub scaling: Scaling,
    /// True if the coefficients are those of plain least squares.
    pub unbias: bool,
    /// Rule by which a model is chosen.
    pub choice: FrolsChoice,
}

/// Rule by which forward regression chooses among its models.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FrolsChoice {
    /// pysindy's rule for one target: the model before the term with the least `ERR + kappa cond(X) terms`. Without kappa it is the model before the term
    /// that adds the least.
    LeastRatio {
        /// Weight of the number of terms, relative to the condition number of the columns.
        kappa: f64,
    },
    /// The first model whose residual is at most this share of `y'y` (Billings 2013, equation 3.24).
    ErrorSum(f64),
    /// The model with the least value of a criterion.
    Criterion(Criterion, CriterionOptions),
    /// The last one.
    Last,
}

impl Default for Frols {
    fn default() -> Self {
        let choice = FrolsChoice::LeastRatio { kappa: 0.0 };
        Self { max_terms: 10, alpha: 0.05, scaling: Scaling::Physical, unbias: true, choice }
    }
}

impl Frols {
    pub(super) fn trail(&self, problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
        not_negative("alpha, the ridge,", self.alpha)?;
        terms.refuse_bounds("frols")?;
        if let FrolsChoice::ErrorSum(rest) = self.choice {
            share("the share of the target that may be left", rest)?;
        }
        let prepared = Prepared::new(problem, terms, self.scaling, 0.0)?;
        prepared.check_target(target)?;
        // One more than is kept: pysindy's rule looks at the term after a model.
        let entered = Entered::select(&prepared, target, self.max_terms + 1);
        let fixed = entered.fixed;
        let count = entered.order.len().min(fixed + self.max_terms);
        let steps: Vec<Step> = (fixed..=count).map(|terms| self.step(&prepared, target, &entered, terms)).collect();
        let chosen = self.choose(&prepared, target, &entered, &steps)?;
        Ok(Trail { steps, chosen, order: entered.order[..count].to_vec(), rounding: 0.0 })
    }

    /// The model of the first `terms` terms.
    pub(super) fn step(&self, prepared: &Prepared<'_>, target: usize, entered: &Entered, terms: usize) -> Step {
        let ridge = if self.unbias { 0.0 } else { self.alpha };
        let values = entered.coefficients(prepared, terms, ridge);
        let mut order: Vec<usize> = (0..terms).collect();
        order.sort_by_key(|&place| entered.order[place]);
        let support = order.iter().map(|&place| entered.order[place]).collect();
        let values = order.iter().map(|&place| values[place]).collect();
        let step = prepared.step(target, support, Solved { values, confounded: Vec::new() }, false);
        Step {
            err: Some(entered.err[..terms].to_vec()),
            parameter: terms as f64,
            iterations: terms,
            status: if terms == 0 { Status::Empty } else { Status::Converged },
            ..step
        }
    }

    pub(super) fn choose(
        &self,
        prepared: &Prepared<'_>,
        target: usize,
        entered: &Entered,
        steps: &[Step],
    ) -> Result<usize, ThresholdError> {
        let last = steps.len() - 1;
        let fixed = steps[0].terms();
        Ok(match self.choice {
            FrolsChoice::Last => last,
            FrolsChoice::ErrorSum(rest) => {
                let left = |step: &Step| 1.0 - step.err.iter().flatten().sum::<f64>();
                steps.iter().position(|step| left(step) <= rest).unwrap_or(last)
            }
            FrolsChoice::Criterion(criterion, options) => {
                let candidates = prepared.open.len() - fixed;
                scores(steps, prepared.problem(), target, candidates, &options)?.best(criterion)
            }
            FrolsChoice::LeastRatio { kappa } => {
                not_negative("kappa", kappa)?;
                let weight = if kappa > 0.0 { kappa * prepared.condition()? } else { 0.0 };
                let loss = |k: usize| entered.err.get(fixed + k).map(|err| err + weight * (k + 1) as f64);
                let losses = (0..=last).filter_map(|k| loss(k).map(|loss| (k, loss)));
                losses.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(last, |(k, _)| k)
            }
        })
    }
}

/// Terms in the order in which they entered.
pub(super) struct Entered {
    /// Number of fixed terms, which come first.
    pub(super) fixed: usize,
    pub(super) order: Vec<usize>,
    /// Error reduction ratio of each.
    pub(super) err: Vec<f64>,
    /// Columns in order of entry, upper triangular, and Q'y behind them.
    factor: Slab,
    z: Vec<f64>,
}

impl Entered {
    /// Fixed terms, then up to `most` others.
    pub(super) fn select(prepared: &Prepared<'_>, target: usize, most: usize) -> Self {
        let problem = prepared.problem();
        let p = problem.columns();
        let mut left: Vec<usize> = prepared.open.clone();
        let mut work = Slab::from_fn(p, left.len(), |i, at| if i <= left[at] { problem.r[(i, left[at])] } else { 0.0 });
        let mut places: Vec<usize> = (0..left.len()).collect();
        let mut z = problem.z.col_as_slice(target).to_vec();
        let size = prepared.target_length(target).powi(2);
        let (mut order, mut err, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        let mut count = 0;
        while order.len() < most.saturating_add(count) && !left.is_empty() {
            checkpoint();
            let k = order.len();
            let fixed = left.iter().any(|&j| prepared.fixed[j]);
            let mut best: Option<(usize, f64)> = None;
            for (at, &j) in left.iter().enumerate() {
                if fixed && !prepared.fixed[j] {
                    continue;
                }
                let ratio = reduction(&work.column(places[at])[k..p], &z[k..], problem.noise[j]);
                if let Some(ratio) = ratio.filter(|&ratio| best.is_none_or(|(_, most)| ratio > most * (1.0 + TIE))) {
                    best = Some((at, ratio));
                }
                if fixed && best.is_some() {
                    break;
                }
            }
            let Some((at, ratio)) = best else {
                // Fixed columns that depend on others are left out; the rest goes on.
                let before = left.len();
                left_out(&mut left, &mut places, |j| fixed && prepared.fixed[j]);
                if left.len() == before { break } else { continue }
            };
            let (column, place) = (left.remove(at), places.remove(at));
            reflect(&mut work, place, &places, &mut z, k, p);
            order.push(column);
            count += usize::from(prepared.fixed[column]);
            err.push(if size > 0.0 { ratio / size } else { 0.0 });
            taken.push(place);
        }
        let entry = |i: usize, at: usize| if i <= at { work.column(taken[at])[i] } else { 0.0 };
        let factor = Slab::from_fn(order.len(), order.len(), entry);
        Self { fixed: count, order, err, factor, z }
    }

    /// Raw coefficients of the first `terms` terms, in order of entry. The ridge is on the system `A b = g` of the orthogonal terms, A with unit diagonal.
    pub(super) fn coefficients(&self, prepared: &Prepared<'_>, terms: usize, ridge: f64) -> Vec<f64> {
        let unit = |at: usize| if ridge > 0.0 { prepared.unit[self.order[at]] } else { 1.0 };
        let scale = |i: usize| if ridge > 0.0 { self.factor.column(i)[i] / unit(i) } else { 1.0 };
        let a =
            faer::Mat::from_fn(
                terms,
                terms,
                |i, j| if i <= j { self.factor.column(j)[i] / scale(i) / unit(j) } else { 0.0 },
            );
        let g = faer::Mat::from_fn(terms, 1, |i, _| self.z[i] / scale(i));
        let system = Triangle::stacked(a.as_ref(), g.as_ref(), &vec![ridge.sqrt(); terms]);
        let mut values = system.z(0).to_vec();
        system.solve(&mut values);
        values.iter().enumerate().map(|(at, value)| value / unit(at)).collect()
    }
}

/// Removes columns from the candidates.
fn left_out(left: &mut Vec<usize>, places: &mut Vec<usize>, out: impl Fn(usize) -> bool) {
    let keep: Vec<bool> = left.iter().map(|&j| !out(j)).collect();
    let mut at = keep.iter();
    left.retain(|_| at.next().is_none_or(|&keep| keep));
    let mut at = keep.iter();
    places.retain(|_| at.next().is_none_or(|&keep| keep));
}

/// `(w'y)^2 / w'w`; `None` where w is rounding.
fn reduction(w: &[f64], z: &[f64], noise: f64) -> Option<f64> {
    let (mut with, mut square) = ([0.0; 4], [0.0; 4]);
    for (w, z) in w.chunks(4).zip(z.chunks(4)) {
        for (i, (w, z)) in w.iter().zip(z).enumerate() {
            with[i] += w * z;
            square[i] += w * w;
        }
    }
    let (with, square): (f64, f64) = (with.iter().sum(), square.iter().sum());
    (square > noise * noise).then(|| with * with / square)
}

/// Reflects the rows from k on so that the column at `place` ends at row k.
fn reflect(work: &mut Slab, place: usize, others: &[usize], z: &mut [f64], k: usize, p: usize) {
    let mut v = vec![0.0; work.stride()];
    v[k..p].copy_from_slice(&work.column(place)[k..p]);
    let Some((diagonal, beta)) = reflector(&mut v[k..p]) else { return };
    let column = work.column_mut(place);
    column[k..p].fill(0.0);
    column[k] = diagonal;
    let from = k / LANES * LANES;
    for &other in others {
        let x = &mut work.column_mut(other)[from..];
        let step = beta * dot(&v[from..], x);
        add_scaled(-step, &v[from..], x);
    }
    let step = beta * v[k..p].iter().zip(&z[k..]).map(|(v, z)| v * z).sum::<f64>();
    z[k..].iter_mut().zip(&v[k..p]).for_each(|(z, v)| *z -= step * v);
}
