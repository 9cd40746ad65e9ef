//! Block coordinate descent on a working set of groups, and the Newton steps that finish it.

use faer::Mat;
use fleetfoot_data::checkpoint;

use super::{block::Rule, spectrum::Spectrum};
use crate::{
    cholesky,
    kernel::{Slab, add_scaled, norm},
};

/// Proximal steps within a group that has no exact step, a visit.
const INNER: usize = 10;
/// Halvings of a Newton step.
const HALVINGS: usize = 16;

/// A group in the working set: its place, its rule at the present lambda, and its spectrum.
pub(super) struct Part<'a> {
    pub(super) first: usize,
    pub(super) rule: Rule<'a>,
    /// Of several columns.
    pub(super) spectrum: Option<&'a Spectrum>,
}

/// `1/2 v'Mv - b'v + sum of the parts' penalties` in k columns, in the units of the blocks.
pub(super) struct Small<'a> {
    /// M (k x k).
    pub(super) matrix: Slab,
    /// b, padded.
    pub(super) target: Vec<f64>,
    pub(super) parts: Vec<Part<'a>>,
}

impl Part<'_> {
    fn range(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.rule.units.len()
    }
}

impl Small<'_> {
    /// b - M v, padded.
    fn gradient(&self, v: &[f64]) -> Vec<f64> {
        let mut gradient = self.target.clone();
        self.matrix.subtract(v, &mut gradient);
        gradient
    }

    /// Largest violation of the optimality conditions, as a correlation.
    fn violation(&self, v: &[f64], gradient: &[f64]) -> f64 {
        let violation = |part: &Part<'_>| part.rule.violation(&v[part.range()], &gradient[part.range()]);
        self.parts.iter().map(violation).fold(0.0, f64::max)
    }

    /// Minimises from `v` on until the violation is below `tolerance`; whether it is, and the sweeps that it took.
    ///
    /// As for single columns: descent finds which coefficients are zero, and once these stand still Newton steps find the others to the last digits.
    pub(super) fn minimise(&self, v: &mut [f64], tolerance: f64, max_epochs: usize) -> (bool, usize) {
        let mut gradient = self.gradient(v);
        if self.violation(v, &gradient) <= tolerance {
            return (true, 0);
        }
        let mut pattern: Vec<bool> = Vec::new();
        let mut due = 8;
        for epoch in 1..=max_epochs {
            checkpoint();
            self.sweep(v, &mut gradient);
            let now: Vec<bool> = v.iter().map(|value| *value != 0.0).collect();
            let still = now == pattern;
            pattern = now;
            if still || epoch >= due || self.violation(v, &gradient) <= tolerance {
                due = 2 * epoch.max(8);
                pattern.clear();
                // The gradient was updated along the way: the verdict is that of a fresh one.
                let before = (v.to_vec(), self.violation(v, &self.gradient(v)));
                self.polish(v);
                gradient = self.gradient(v);
                let after = self.violation(v, &gradient);
                if after > before.1 && before.1 <= tolerance {
                    v.copy_from_slice(&before.0);
                    return (true, epoch);
                }
                if after <= tolerance {
                    return (true, epoch);
                }
            }
        }
        (false, max_epochs)
    }

    /// One visit of every part; the gradient follows.
    fn sweep(&self, v: &mut [f64], gradient: &mut [f64]) {
        for part in &self.parts {
            let now = v[part.range()].to_vec();
            let pull = self.pull(part, &now, gradient);
            let next = self.step(part, &now, &pull);
            for (at, (now, next)) in now.iter().zip(&next).enumerate() {
                if now != next {
                    add_scaled(now - next, self.matrix.column(part.first + at), gradient);
                }
            }
            v[part.range()].copy_from_slice(&next);
        }
    }

    /// The gradient of a part at zero, the others fixed: `gradient + H v`.
    fn pull(&self, part: &Part<'_>, v: &[f64], gradient: &[f64]) -> Vec<f64> {
        let mut pull = gradient[part.range()].to_vec();
        for (at, value) in v.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            let column = &self.matrix.column(part.first + at)[part.range()];
            pull.iter_mut().zip(column).for_each(|(pull, entry)| *pull += entry * value);
        }
        pull
    }

    /// The minimiser in one part, or a good step towards it.
    fn step(&self, part: &Part<'_>, now: &[f64], pull: &[f64]) -> Vec<f64> {
        let rule = &part.rule;
        if let [pull] = pull {
            let square = self.matrix.column(part.first)[part.first];
            let beyond = rule.beyond(0, *pull);
            return vec![(beyond.abs() - rule.group).max(0.0).copysign(beyond) / square];
        }
        if rule.holds(pull) {
            return vec![0.0; now.len()];
        }
        let free = rule.signs.iter().all(|sign| sign.sides().len() == 2);
        match part.spectrum {
            Some(spectrum) if rule.l1 == 0.0 && free => spectrum.minimise(pull, rule.group, norm(now.iter().copied())),
            _ => self.proximal(part, now, pull),
        }
    }

    /// Proximal gradient steps in one part: the step of the absolute values and signs, then that of the norm, is the exact proximal map of both.
    fn proximal(&self, part: &Part<'_>, now: &[f64], pull: &[f64]) -> Vec<f64> {
        let rule = &part.rule;
        let curvature = part.spectrum.map_or(0.0, Spectrum::largest);
        let mut v = now.to_vec();
        for _ in 0..INNER {
            let column = |at: usize| &self.matrix.column(part.first + at)[part.range()];
            let mut next: Vec<f64> = v.iter().zip(pull).map(|(v, pull)| curvature * v + pull).collect();
            for (at, value) in v.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                next.iter_mut().zip(column(at)).for_each(|(next, entry)| *next -= entry * value);
            }
            next.iter_mut().enumerate().for_each(|(at, next)| *next = rule.beyond(at, *next));
            let length = norm(next.iter().copied());
            let share = if length > rule.group { (1.0 - rule.group / length) / curvature } else { 0.0 };
            next.iter_mut().for_each(|next| *next = if *next == 0.0 { 0.0 } else { *next * share });
            let same = next == v;
            v = next;
            if same {
                break;
            }
        }
        v
    }

    /// Newton steps on the coefficients that are not zero, where the objective is smooth: each to the first that would change its sign, and shortened until
    /// objective and gradient fall. Stops where they do not. (The gradient alone would not do: along columns that depend on each other it may fall on the way to
    /// infinity.)
    fn polish(&self, v: &mut [f64]) {
        for _ in 0..20 + 2 * v.len() {
            checkpoint();
            let (support, wanted) = self.wanted(v);
            let before = norm(wanted.iter().copied());
            if before == 0.0 {
                return;
            }
            let hessian = self.hessian(v, &support);
            let level = 8.0 * f64::EPSILON * (v.len() + 1) as f64;
            let mut step = cholesky::solve(&hessian, &wanted, level);
            let crossing = |(&i, step): (&usize, &f64)| {
                let crosses = self.watched(i) && *step * v[i] < 0.0 && step.abs() >= v[i].abs();
                crosses.then(|| (i, v[i].abs() / step.abs()))
            };
            let first_of =
                |step: &[f64]| support.iter().zip(step).filter_map(crossing).min_by(|a, b| a.1.total_cmp(&b.1));
            let mut first = first_of(&step);
            if let Some(flat) = cholesky::flat(&hessian, &wanted, &step, level) {
                // As far as to the first that would change its sign; where none would, the norms bend it, and descent has to do.
                let far: Vec<f64> = flat.iter().map(|entry| entry * (0.5 / f64::EPSILON)).collect();
                if let Some((i, share)) = first_of(&far) {
                    step = far.iter().map(|entry| entry * share).collect();
                    first = Some((i, 1.0));
                }
            }
            let start = v.to_vec();
            let most = self.most_objective(&start);
            let mut share = first.map_or(1.0, |(_, share)| share);
            let mut falls = false;
            for halving in 0..=HALVINGS {
                support.iter().zip(&step).for_each(|(&i, step)| v[i] = start[i] + share * step);
                // If a coefficient leaves, the remaining gradient is that of another support.
                let leaves = first.filter(|_| halving == 0);
                if let Some((i, _)) = leaves {
                    v[i] = 0.0;
                }
                falls = self.objective(v).0 <= most && (leaves.is_some() || norm(self.wanted(v).1) < before);
                if falls {
                    break;
                }
                share *= 0.5;
            }
            if !falls {
                v.copy_from_slice(&start);
                return;
            }
        }
    }

    /// The objective, and the sum of the sizes of its terms.
    fn objective(&self, v: &[f64]) -> (f64, f64) {
        let gradient = self.gradient(v);
        let penalty: f64 = self.parts.iter().map(|part| part.rule.value(&v[part.range()])).sum();
        // v'Mv is v'(b - gradient).
        let terms = v.iter().zip(&self.target).zip(&gradient).map(|((v, b), left)| 0.5 * v * (b + left));
        let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
        (penalty - sum, penalty + size)
    }

    /// The objective, and what rounding may add to it.
    fn most_objective(&self, v: &[f64]) -> f64 {
        let (value, size) = self.objective(v);
        value + 8.0 * f64::EPSILON * (v.len() + 1) as f64 * size
    }

    /// The part that holds column i.
    fn part(&self, i: usize) -> &Part<'_> {
        let after = self.parts.partition_point(|part| part.first <= i);
        &self.parts[after - 1]
    }

    /// Returns true if column i keeps its sign in a Newton step.
    fn watched(&self, i: usize) -> bool {
        let part = self.part(i);
        part.rule.l1 > 0.0 || part.rule.signs[i - part.first].sides().len() == 1
    }

    /// The columns on which the objective is smooth, and minus its gradient there: coefficients that are not zero, and those that nothing holds at zero.
    fn wanted(&self, v: &[f64]) -> (Vec<usize>, Vec<f64>) {
        let gradient = self.gradient(v);
        let (mut support, mut wanted) = (Vec::new(), Vec::new());
        for part in &self.parts {
            let range = part.range();
            let length = norm(v[range.clone()].iter().copied());
            for i in range {
                let held = self.watched(i) || (part.rule.group > 0.0 && length == 0.0);
                if v[i] != 0.0 || !held {
                    let sign = if v[i] == 0.0 { 0.0 } else { v[i].signum() };
                    let along = if length > 0.0 { v[i] / length } else { 0.0 };
                    support.push(i);
                    wanted.push(gradient[i] - part.rule.l1 * sign - part.rule.group * along);
                }
            }
        }
        (support, wanted)
    }

    /// M and the curvature of the norms, `group / |v| (I - v v' / |v|^2)`, on a support.
    fn hessian(&self, v: &[f64], support: &[usize]) -> Mat<f64> {
        let mut hessian = Mat::from_fn(support.len(), support.len(), |a, b| self.matrix.column(support[b])[support[a]]);
        let lengths: Vec<f64> = self.parts.iter().map(|part| norm(v[part.range()].iter().copied())).collect();
        let place = |i: usize| self.parts.partition_point(|part| part.first <= i) - 1;
        for (a, &i) in support.iter().enumerate() {
            let part = place(i);
            let (length, group) = (lengths[part], self.parts[part].rule.group);
            if group == 0.0 || length == 0.0 {
                continue;
            }
            for (b, &k) in support.iter().enumerate().filter(|(_, k)| place(**k) == part) {
                let round = f64::from(u8::from(a == b)) - (v[i] / length) * (v[k] / length);
                hessian[(a, b)] += group / length * round;
            }
        }
        hessian
    }

    /// Trace of `M (M + curvature)^-1` on the support of v: the degrees of freedom of the fit.
    pub(super) fn degrees_of_freedom(&self, v: &[f64]) -> f64 {
        let (support, _) = self.wanted(v);
        let hessian = self.hessian(v, &support);
        let matrix = Mat::from_fn(support.len(), support.len(), |a, b| self.matrix.column(support[b])[support[a]]);
        cholesky::trace_of_ratio(&matrix, &hessian, 8.0 * f64::EPSILON * (v.len() + 1) as f64)
    }
}
