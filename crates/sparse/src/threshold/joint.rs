//! All targets at once, under one rule: the answers of pysindy's optimisers for several targets, iteration by
//! iteration.

use fleetfoot_stats::Compressed;

use super::{
    Frols, FrolsChoice, Sr3, Status, Step, Stlsq, Terms, ThresholdError,
    error::not_negative,
    frols::Entered,
    prepared::{Prepared, Solved},
    stlsq::nonzero,
};
use crate::{SparseError, kernel::norm};

/// Models of q targets on p candidate columns.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Joint {
    /// The model of each target (q).
    pub steps: Vec<Step>,
    /// Coefficients before the last refit (q x p), which decided the support.
    pub decided: Vec<Vec<f64>>,
    /// Coefficients (q x p) that each iteration left. STLSQ and SR3: the first entry is where they start.
    pub history: Vec<Vec<Vec<f64>>>,
    /// SR3: the relaxed coefficients w of the last iteration (q x p); else empty.
    pub relaxed: Vec<Vec<f64>>,
    /// Forward regression: error reduction ratios of the terms in order of entry, one more than the most terms (q).
    pub ratios: Vec<Vec<f64>>,
    /// Iterations made: the most of any target.
    pub iterations: usize,
    /// True if the rule ended the iteration, and not the limit on their number.
    pub converged: bool,
}

impl Stlsq {
    /// Models of all targets, each with its own options and terms.
    ///
    /// As in pysindy, first guesses end the iteration when the first regression keeps the terms of all of them.
    ///
    /// # Errors
    /// As [`optimize`](super::optimize), and when there are not as many options and terms as targets.
    pub fn jointly(problem: &Compressed, each: &[(Self, Terms)]) -> Result<Joint, ThresholdError> {
        check_number(problem, each.len())?;
        let mut runs = Vec::with_capacity(each.len());
        for (target, (stlsq, terms)) in each.iter().enumerate() {
            stlsq.check(problem.columns())?;
            let prepared = Prepared::new(problem, terms, stlsq.scaling, stlsq.alpha)?;
            prepared.check_target(target)?;
            let start = match &stlsq.initial {
                Some(guess) => guess.clone(),
                None => spread(problem, &prepared.open, &prepared.refit(&prepared.open, target).values),
            };
            let mut history = vec![start];
            let run = Self { initial: None, ..stlsq.clone() }.watched(
                &prepared,
                target,
                stlsq.threshold,
                |active, values| history.push(spread(problem, active, values)),
            );
            runs.push(Iterated { step: run.step, history, prepared });
        }
        let guessed = |stlsq: &Self, run: &Iterated<'_>| {
            stlsq.initial.as_ref().is_some_and(|guess| nonzero(guess) == nonzero(at(&run.history, 1)))
        };
        if each.iter().zip(&runs).all(|((stlsq, _), run)| guessed(stlsq, run)) {
            for (target, (run, (stlsq, _))) in runs.iter_mut().zip(each).enumerate() {
                run.end_at_first(target, stlsq.unbias);
            }
        }
        let converged = runs.iter().all(|run| run.step.status != Status::MaxIterations);
        let (steps, histories) = runs.into_iter().map(|run| (run.step, run.history)).unzip();
        Ok(Joint::of(steps, histories, converged))
    }
}

/// One target's STLSQ.
struct Iterated<'a> {
    step: Step,
    history: Vec<Vec<f64>>,
    prepared: Prepared<'a>,
}

impl Iterated<'_> {
    /// The model of the first iteration.
    fn end_at_first(&mut self, target: usize, unbias: bool) {
        self.history.truncate(2);
        let (prepared, first) = (&self.prepared, at(&self.history, 1));
        let support: Vec<usize> = prepared.open.iter().copied().filter(|&j| first[j] != 0.0).collect();
        let solved = match unbias {
            true => prepared.refit(&support, target),
            false => Solved { values: support.iter().map(|&j| first[j]).collect(), confounded: Vec::new() },
        };
        self.step = prepared.step(target, support, solved, !unbias);
    }
}

impl Sr3 {
    /// Models of all targets, each with its own options and terms, under one stopping rule: the iteration ends when the step of all coefficients together
    /// is below the tolerance of the first.
    ///
    /// # Errors
    /// As [`optimize`](super::optimize), and when there are not as many options and terms as targets.
    pub fn jointly(problem: &Compressed, each: &[(Self, Terms)]) -> Result<Joint, ThresholdError> {
        check_number(problem, each.len())?;
        let mut runs = Vec::with_capacity(each.len());
        for (target, (sr3, terms)) in each.iter().enumerate() {
            let prepared = sr3.prepared(problem, terms)?;
            prepared.check_target(target)?;
            let start = spread(problem, &prepared.open, &sr3.start(&prepared, target));
            let (mut sparse, mut dense, mut moved) = (vec![start.clone()], vec![start], vec![f64::INFINITY]);
            // Only where nothing moves any more is a target's own iteration at its end.
            let to_the_end = Self { tolerance: f64::MIN_POSITIVE, unbias: false, ..sr3.clone() };
            to_the_end.watched(&prepared, target, sr3.lambda, |v, w, step| {
                sparse.push(spread(problem, &prepared.open, v));
                dense.push(spread(problem, &prepared.open, w));
                moved.push(step);
            });
            runs.push((sparse, dense, moved, prepared));
        }
        let most = runs.iter().map(|run| run.0.len()).max().unwrap_or(1);
        let step = |k: usize| norm(runs.iter().map(|(_, _, moved, _)| moved.get(k).copied().unwrap_or(0.0)));
        let tolerance = each.first().map_or(0.0, |(sr3, _)| sr3.tolerance);
        let stop = (1..most).find(|&k| step(k) < tolerance);
        let last = stop.unwrap_or(most - 1);
        let (mut steps, mut histories, mut relaxed) = (Vec::new(), Vec::new(), Vec::new());
        for (target, ((mut sparse, dense, _, prepared), (sr3, _))) in runs.into_iter().zip(each).enumerate() {
            let v = at(&sparse, last).clone();
            let support: Vec<usize> =
                prepared.open.iter().copied().filter(|&j| v[j] != 0.0 || prepared.fixed[j]).collect();
            let solved = match sr3.unbias {
                true => prepared.refit(&support, target),
                false => Solved { values: support.iter().map(|&j| v[j]).collect(), confounded: Vec::new() },
            };
            steps.push(Step { parameter: sr3.lambda, ..prepared.step(target, support, solved, false) });
            relaxed.push(at(&dense, last).clone());
            sparse.truncate(last + 1);
            histories.push(sparse);
        }
        let joint = Joint::of(steps, histories, stop.is_some());
        Ok(Joint { relaxed, ..joint })
    }
}

impl Frols {
    /// Models of all targets.
    ///
    /// With [`FrolsChoice::LeastRatio`] the ratios of a target and of those before it are added up, which is what pysindy's rule is for several targets: the
    /// model of a target depends on the targets that stand before it. The other rules see each target by itself.
    ///
    /// # Errors
    /// As [`optimize`](super::optimize), and when there are not as many terms as targets.
    pub fn jointly(&self, problem: &Compressed, each: &[Terms]) -> Result<Joint, ThresholdError> {
        check_number(problem, each.len())?;
        not_negative("alpha, the ridge,", self.alpha)?;
        let (mut steps, mut histories, mut decided) = (Vec::new(), Vec::new(), Vec::new());
        let mut ratios: Vec<Vec<f64>> = Vec::new();
        for (target, terms) in each.iter().enumerate() {
            terms.refuse_bounds("frols")?;
            let prepared = Prepared::new(problem, terms, self.scaling, 0.0)?;
            prepared.check_target(target)?;
            let entered = Entered::select(&prepared, target, self.max_terms.saturating_add(1));
            let fixed = entered.fixed;
            let count = entered.order.len().min(fixed + self.max_terms);
            ratios.push(entered.err.clone());
            let models: Vec<Step> =
                (fixed..=count).map(|terms| self.step(&prepared, target, &entered, terms)).collect();
            let chosen = match self.choice {
                FrolsChoice::LeastRatio { kappa } => {
                    let weight = if not_negative("kappa", kappa)? > 0.0 { kappa * prepared.condition()? } else { 0.0 };
                    let sum = |k: usize| ratios.iter().map(|err| err.get(k).copied().unwrap_or(0.0)).sum::<f64>();
                    let loss = |k: usize| sum(fixed + k) + weight * (k + 1) as f64;
                    let open = (0..models.len()).filter(|k| fixed + k < entered.err.len());
                    open.min_by(|&a, &b| loss(a).total_cmp(&loss(b))).unwrap_or(models.len() - 1)
                }
                _ => self.choose(&prepared, target, &entered, &models)?,
            };
            let ridged = |terms: usize| {
                let values = entered.coefficients(&prepared, terms, self.alpha);
                spread(problem, &entered.order[..terms], &values)
            };
            let reached = (fixed..=count).filter(|&terms| terms < entered.err.len().max(fixed + 1));
            histories.push(reached.map(ridged).collect());
            decided.push(ridged(fixed + chosen));
            steps.extend(models.into_iter().nth(chosen));
        }
        let joint = Joint::of(steps, histories, true);
        Ok(Joint { decided, ratios, ..joint })
    }
}

impl Joint {
    /// Histories that ended sooner stay where they ended.
    fn of(steps: Vec<Step>, histories: Vec<Vec<Vec<f64>>>, converged: bool) -> Self {
        let most = histories.iter().map(Vec::len).max().unwrap_or(0);
        let history = (0..most).map(|k| histories.iter().map(|history| at(history, k).clone()).collect()).collect();
        let decided = histories.iter().map(|history| at(history, most).clone()).collect();
        let iterations = most.saturating_sub(1);
        Self { steps, decided, history, relaxed: Vec::new(), ratios: Vec::new(), iterations, converged }
    }
}

/// An entry, or the last one. There is always one: the start.
fn at(history: &[Vec<f64>], k: usize) -> &Vec<f64> {
    &history[k.min(history.len() - 1)]
}

/// Values of some columns among zeros (p).
fn spread(problem: &Compressed, columns: &[usize], values: &[f64]) -> Vec<f64> {
    let mut all = vec![0.0; problem.columns()];
    columns.iter().zip(values).for_each(|(&j, &value)| all[j] = value);
    all
}

fn check_number(problem: &Compressed, number: usize) -> Result<(), ThresholdError> {
    let expected = problem.targets();
    if number == expected && number > 0 {
        return Ok(());
    }
    Err(SparseError::Length { what: "the options of the targets", actual: number, expected }.into())
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use fleetfoot_stats::Factor;

    use super::*;
    use crate::threshold::{Optimizer, optimize};

    /// Two targets of six columns, the third and the last the same up to a little.
    fn problem() -> Compressed {
        let value = |i: usize, j: usize| ((i * (2 * j + 3)) as f64 * 0.37).sin() + 0.1 * j as f64;
        let rows = Mat::from_fn(200, 8, |i, j| match j {
            6 => 2.0 * value(i, 0) - 0.5 * value(i, 3) + 0.07 * value(i, 1) + 0.01 * ((i * i) as f64).cos(),
            7 => 0.3 * value(i, 2) + 0.02 * value(i, 5) + 0.2 * ((i * i) as f64).sin(),
            5 => value(i, 2) + 0.05 * value(i, 5),
            j => value(i, j),
        });
        let mut factor = Factor::new(6, 2);
        factor.push(rows.as_ref(), None);
        factor.square_root().compressed(false)
    }

    #[test]
    fn joint_stlsq_matches_single_targets() {
        let problem = problem();
        let stlsq = Stlsq { threshold: 0.1, ..Stlsq::default() };
        let joint = Stlsq::jointly(&problem, &[(stlsq.clone(), Terms::all()), (stlsq.clone(), Terms::all())]).unwrap();
        for target in 0..2 {
            let alone = optimize(&problem, target, &Optimizer::Stlsq(stlsq.clone()), &Terms::all()).unwrap();
            assert_eq!(joint.steps[target].coefficients, alone.choice().coefficients);
            assert_eq!(nonzero(&joint.decided[target]), alone.choice().support);
        }
        assert_eq!(joint.history.len(), joint.iterations + 1);
        // A guess that only one target's first regression meets ends nothing; guesses that all meet do.
        let guessed = |masks: [&Vec<f64>; 2]| {
            let each = masks.map(|mask| (Stlsq { initial: Some(mask.clone()), ..stlsq.clone() }, Terms::all()));
            Stlsq::jointly(&problem, &each).unwrap()
        };
        let first = &joint.history[1];
        let ones = vec![1.0; 6];
        assert_ne!(nonzero(&first[1]), nonzero(&ones));
        assert_eq!(guessed([&first[0], &ones]).steps, joint.steps);
        let ended = guessed([&first[0], &first[1]]);
        assert_eq!((ended.iterations, &ended.decided), (1, first));
        assert!(Stlsq::jointly(&problem, &[(stlsq, Terms::all())]).is_err());
    }

    #[test]
    fn sr3_stops_for_all_targets_at_once() {
        let problem = problem();
        let sr3 = Sr3 { lambda: 0.02, nu: 0.1, tolerance: 1e-3, max_iterations: 500, ..Sr3::default() };
        let joint = Sr3::jointly(&problem, &[(sr3.clone(), Terms::all()), (sr3.clone(), Terms::all())]).unwrap();
        let step = |k: usize| {
            let pairs = joint.history[k].iter().flatten().zip(joint.history[k - 1].iter().flatten());
            norm(pairs.map(|(a, b)| a - b)) / sr3.nu
        };
        let last = joint.iterations;
        assert!(joint.converged && last > 2 && step(last) < 1e-3 && (1..last).all(|k| step(k) >= 1e-3));
        let alone = |target: usize| {
            let options = Sr3 { max_iterations: last, tolerance: f64::MIN_POSITIVE, ..sr3.clone() };
            optimize(&problem, target, &Optimizer::Sr3(options), &Terms::all()).unwrap().choice().coefficients.clone()
        };
        assert_eq!(joint.decided, [alone(0), alone(1)]);
        let cut = Sr3 { max_iterations: 2, ..sr3 };
        assert!(!Sr3::jointly(&problem, &[(cut.clone(), Terms::all()), (cut, Terms::all())]).unwrap().converged);
    }

    #[test]
    fn forward_regression_adds_the_ratios_of_the_targets_before() {
        let problem = problem();
        let frols = Frols { max_terms: 4, ..Frols::default() };
        let joint = frols.jointly(&problem, &[Terms::all(), Terms::all()]).unwrap();
        let alone = |target| optimize(&problem, target, &Optimizer::Frols(frols.clone()), &Terms::all()).unwrap();
        assert_eq!(joint.steps[0].coefficients, alone(0).choice().coefficients);
        let losses: Vec<f64> = (0..5).map(|k| joint.ratios[0][k] + joint.ratios[1][k]).collect();
        let least = (0..5).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap();
        assert_eq!(joint.steps[1].coefficients, alone(1).steps[least].coefficients);
        assert_eq!(joint.history.len(), 5);
        assert!(joint.history[3].iter().all(|coefficients| nonzero(coefficients).len() == 3));
    }
}
