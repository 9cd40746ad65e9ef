//! Stepwise sparse regression: one term less at a time.

use fleetfoot_data::checkpoint;
use fleetfoot_stats::Compressed;

use super::{
    Scaling, Status, Step, Terms, ThresholdError, Trail,
    error::not_negative,
    prepared::{Prepared, Solved},
    triangle::Triangle,
};

/// Rule by which stepwise regression removes a term.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Removal {
    /// The one with the smallest |coefficient|.
    #[default]
    Coefficient,
    /// The term whose removal increases the error of the regression least.
    Residual,
}

/// Stepwise sparse regression (Boninsegna, Nuske and Clementi 2018): regress on all terms with a ridge, remove one, regress on the rest, down to one term.
///
/// Defaults, the order of removal and the choice are those of pysindy's `SSR`. Between bounds of [`Terms`] each
/// regression is least squares within them. A term that a bound holds at 0 is removed first. A term at another bound
/// stays there while the errors without another term are compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Ssr {
    /// The ridge; it is not multiplied by the number of rows.
    pub alpha: f64,
    /// The most terms that are removed.
    pub max_removals: usize,
    /// Units of the coefficients that are compared and penalised.
    pub scaling: Scaling,
    /// Rule by which a term is removed.
    pub removal: Removal,
    /// `Some`: chosen is the model with the least `rss + kappa cond(X) terms`. `None`: the one after which removing one more term raises the error by the
    /// largest factor.
    pub kappa: Option<f64>,
    /// True if the models are refitted without the ridge. The choice uses the errors with the ridge.
    pub unbias: bool,
}

impl Default for Ssr {
    fn default() -> Self {
        Self {
            alpha: 0.05,
            max_removals: 20,
            scaling: Scaling::Physical,
            removal: Removal::Coefficient,
            kappa: None,
            unbias: true,
        }
    }
}

impl Ssr {
    pub(super) fn trail(&self, problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
        let prepared = Prepared::new(problem, terms, self.scaling, self.alpha)?;
        prepared.check_target(target)?;
        let price = match self.kappa {
            Some(kappa) => not_negative("kappa", kappa)? * prepared.condition()?,
            None => 0.0,
        };
        let mut active = prepared.open.clone();
        let mut triangle = prepared.ridged(&active, target);
        let (mut steps, mut losses, mut order) = (Vec::new(), Vec::new(), Vec::new());
        loop {
            checkpoint();
            let solved = prepared.solve(&triangle, &active);
            let out = self.worst(&prepared, target, &triangle, &active, &solved);
            let ridged = prepared.step(target, active.clone(), solved, true);
            losses.push(ridged.rss + price * active.len() as f64);
            let step = match self.unbias {
                true => prepared.step(target, active.clone(), prepared.refit(&active, target), false),
                false => ridged,
            };
            let status = if active.is_empty() { Status::Empty } else { Status::Converged };
            steps.push(Step { parameter: active.len() as f64, status, iterations: steps.len() + 1, ..step });
            let Some(out) = out.filter(|_| active.len() > 1 && order.len() < self.max_removals) else { break };
            order.push(active.remove(out));
            let places: Vec<usize> = (0..=active.len()).filter(|&place| place != out).collect();
            triangle = triangle.select(&places, 0);
        }
        let chosen = match self.kappa {
            Some(_) => (0..losses.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0),
            None => inflection(&losses),
        };
        Ok(Trail { steps, chosen, order, rounding: 0.0 })
    }

    /// Place of the term to remove.
    fn worst(
        &self,
        prepared: &Prepared<'_>,
        target: usize,
        triangle: &Triangle,
        active: &[usize],
        solved: &Solved,
    ) -> Option<usize> {
        let free = |place: &usize| !prepared.fixed[active[*place]];
        let least = |values: &[f64]| (0..active.len()).filter(free).min_by(|&a, &b| values[a].total_cmp(&values[b]));
        if self.removal == Removal::Coefficient {
            let sizes: Vec<f64> =
                active.iter().zip(&solved.values).map(|(&j, value)| (prepared.unit[j] * value).abs()).collect();
            return least(&sizes);
        }
        // Coefficients that a bound holds at 0 cost nothing: of several the last, the least simple one of a library.
        let held_out = |place: &usize| prepared.held_out(active[*place], solved.values[*place]);
        if let Some(place) = (0..active.len()).rev().find(held_out) {
            return Some(place);
        }
        // A column that others rebuild costs nothing.
        let spare = solved.confounded.iter().flatten().copied().filter(|&j| !prepared.fixed[j]).max();
        if let Some(column) = spare {
            return active.iter().position(|&j| j == column);
        }
        let plain = prepared.plain(active, target);
        let at_bound = |place: &usize| prepared.at_bound(active[*place], solved.values[*place]);
        let held: Vec<usize> = (0..active.len()).filter(at_bound).collect();
        if held.is_empty() {
            return least(&without(&plain, triangle, &solved.values));
        }
        least(&without_held(prepared, &plain, triangle, active, &solved.values, &held))
    }
}

/// `|P c_j - z|^2` for every column j: c_j are the ridge coefficients without it, P and z the rows without the ridge.
///
/// With S the inverse of the ridged Gram matrix, `c_j = c - (c_j / S_jj) S_j`.
fn without(plain: &Triangle, ridged: &Triangle, values: &[f64]) -> Vec<f64> {
    let k = plain.columns();
    let times = |x: &[f64]| {
        let mut product = vec![0.0; k];
        for (j, x) in x.iter().enumerate() {
            (0..=j).for_each(|i| product[i] += plain.r(i, j) * x);
        }
        product
    };
    let left: Vec<f64> = times(values).iter().zip(plain.z(0)).map(|(fit, z)| z - fit).collect();
    let error = |j: usize| {
        let mut s = vec![0.0; k];
        s[j] = 1.0;
        ridged.solve_transposed(&mut s);
        ridged.solve(&mut s);
        let step = values[j] / s[j];
        let moved = times(&s);
        left.iter().zip(&moved).map(|(left, moved)| (left + step * moved).powi(2)).sum()
    };
    (0..k).map(error).collect()
}

/// The same where bounds hold some coefficients (places `held`), which stay where they are as another leaves.
fn without_held(
    prepared: &Prepared<'_>,
    plain: &Triangle,
    ridged: &Triangle,
    active: &[usize],
    values: &[f64],
    held: &[usize],
) -> Vec<f64> {
    let free: Vec<usize> = (0..active.len()).filter(|place| !held.contains(place)).collect();
    let columns: Vec<usize> = free.iter().map(|&place| active[place]).collect();
    let constants = |out: Option<usize>| {
        let mut constants = vec![0.0; active.len()];
        held.iter().filter(|&&place| Some(place) != out).for_each(|&place| constants[place] = values[place]);
        constants
    };
    // The residual of the free columns is dropped with the others' rows, so it is added: the errors of all removals are compared.
    let error = |constants: &[f64], diagonal: &[f64]| {
        let mut all = constants.to_vec();
        free.iter().zip(diagonal).for_each(|(&place, value)| all[place] = *value);
        plain.less(&all).z(0).iter().map(|left| left * left).sum::<f64>()
    };
    let mut losses = vec![0.0; active.len()];
    let kept = constants(None);
    let (shifted, below) = (plain.less(&kept).select(&free, 0), ridged.less(&kept).select(&free, 0));
    let diagonal: Vec<f64> = free.iter().map(|&place| values[place]).collect();
    let dropped = error(&kept, &diagonal) - shifted.less(&diagonal).z(0).iter().map(|left| left * left).sum::<f64>();
    for (&place, loss) in free.iter().zip(without(&shifted, &below, &diagonal)) {
        losses[place] = loss + dropped;
    }
    for &place in held {
        let constants = constants(Some(place));
        let free_values = prepared.solve_free(&ridged.less(&constants).select(&free, 0), &columns);
        losses[place] = error(&constants, &free_values.values);
    }
    losses
}

/// The model after which one term less raises the loss by the largest factor; losses from the most terms to the fewest.
fn inflection(losses: &[f64]) -> usize {
    if let Some(exact) = (0..losses.len()).rev().find(|&k| losses[k] == 0.0) {
        return exact;
    }
    let last = losses.len() - 1;
    // From the fewest terms on, as of equal factors the first counts.
    let factor = |k: usize| losses[k + 1] / losses[k];
    (0..last)
        .rev()
        .fold(None, |best: Option<usize>, k| best.filter(|&b| factor(b) >= factor(k)).or(Some(k)))
        .unwrap_or(last)
}
