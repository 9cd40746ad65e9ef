//! From the statistic of a region to the terms of its equations: models of every size, their held-out errors, the choice.

use std::collections::BTreeSet;

use faer::Mat;
use fleetfoot_data::Progress;
use fleetfoot_data::setting::SINDY;
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Criterion, SindyOptimizer};
use fleetfoot_sparse::{
    bolasso::{BootstrapUnit, multinomial_counts},
    group::{GroupLasso, Groups},
    inference::system_effective_rows,
    select::Folds,
    threshold::{
        Choice, Criterion as Information, CriterionOptions, EnsembleOptions, FoldProblem, FoldScores, Frols,
        FrolsChoice, Optimizer, PenalisedPath, Rivals, Scaling, Sr3, Ssr, Step, Stlsq, Sweep, SweepOptions, Terms,
        Thresholds, ensemble, optimize, score_supports, sweep,
    },
};
use fleetfoot_stats::{Compressed, Fold, Key, Purge, blocks};
use fleetfoot_sums::system::SystemScan;
use fleetfoot_task::EquationTask;

use super::options::{Ensemble, SindyOptions};
use crate::{
    error::Error,
    folds::{FoldRule, purge},
    sindy::Evidence,
};

/// Thresholds that are tried at most: of a large library each costs a factorisation of the size of the library, in every fold.
const THRESHOLDS: usize = 60;
const THRESHOLDS_OF_MANY: usize = 24;
const MANY: usize = 300;

/// Thresholds that are tried at most with so many candidates.
pub(super) fn most_thresholds(candidates: usize) -> usize {
    if candidates > MANY { THRESHOLDS_OF_MANY } else { THRESHOLDS }
}

/// Solution of one equation in one region.
pub(super) struct Solved {
    /// The model that was taken.
    pub(super) step: Step,
    /// Models of every size, where there are several.
    pub(super) sweep: Sweep,
    /// Mean squared error on held-out rows and the share of the variance that is explained there; NaN without folds.
    pub(super) held_out: [f64; 2],
    /// Share of an ensemble's members that have each candidate.
    pub(super) inclusion: Option<Vec<f64>>,
}

/// Folds of a region, and the error of the training means on the held-out rows, summed (targets).
struct HeldOut {
    folds: Vec<FoldProblem>,
    null: Vec<f64>,
}

impl HeldOut {
    /// The held-out mean squared error of a model, and the share of the null model's squared error that it explains.
    fn scores(&self, scores: &FoldScores, model: usize, target: usize) -> [f64; 2] {
        let error = |fold: usize| scores.errors[(model, fold)] * self.folds[fold].test.weight;
        let errors: f64 = (0..self.folds.len()).map(error).sum();
        let null = self.null[target];
        [scores.mean[model], if null > 0.0 { 1.0 - errors / null } else { f64::NAN }]
    }
}

/// Solves the regions of some evidence.
pub(super) struct Solver<'a> {
    pub(super) evidence: &'a Evidence,
    pub(super) options: &'a SindyOptions,
    /// True to keep models of other sizes than the chosen one.
    pub(super) front: bool,
    /// True if coefficients keep their bounds.
    bounded: bool,
    folds: Option<Folds>,
    /// The penalty of groups, on request.
    groups: Option<GroupLasso>,
}

impl<'a> Solver<'a> {
    /// Draws the folds; notes say why there are none.
    pub(super) fn new(
        evidence: &'a Evidence,
        options: &'a SindyOptions,
        front: bool,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        let (keys, rows) = keys(&evidence.scan);
        let folds = options.folds.folds(&keys, &rows, options.seed, gap(evidence)?);
        let folds = match folds {
            Ok(folds) => Some(folds),
            Err(error) if options.folds == FoldRule::Auto => {
                notes.push(format!("no held-out errors: {error}"));
                None
            }
            Err(error) => return Err(error.into()),
        };
        let groups = (options.optimizer == SindyOptimizer::GroupLasso).then(|| group_lasso(&evidence.task, options));
        Ok(Self { evidence, options, front, bounded: true, folds, groups: groups.transpose()? })
    }

    /// The same without the bounds of coefficients, on the same folds; no front.
    pub(super) fn free(self) -> Self {
        Self { bounded: false, front: false, ..self }
    }

    /// Rule by which rows are held out, for people; `None` without folds.
    pub(super) fn fold_rule(&self) -> Option<&str> {
        self.folds.as_ref().map(Folds::rule)
    }

    /// Number of folds.
    pub(super) fn folds(&self) -> usize {
        self.folds.as_ref().map_or(0, Folds::len)
    }

    /// The equations of a region.
    pub(super) fn solve(
        &self,
        region: usize,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Solved>, Error> {
        let (scan, task) = (&self.evidence.scan, &self.evidence.task);
        let problem = self.known(scan.root(region).compressed(task.constant));
        let terms = if self.bounded { task.terms() } else { task.free_terms() };
        let held = self.held_out(region);
        let sweeps = self.sweep(region, &problem, &held.folds, &terms, progress)?;
        let by_ratio = self.by_ratio(&problem, &terms)?;
        let mut solved = Vec::with_capacity(sweeps.len());
        for (target, mut sweep) in sweeps.into_iter().enumerate() {
            if let Some(chosen) = by_ratio.get(target) {
                sweep.chosen = of_support(&sweep, chosen);
            } else if let Some(most) = self.options.terms {
                sweep.chosen = of_size(&sweep, most);
            }
            solved.push(Solved {
                step: sweep.choice().clone(),
                held_out: sweep.folds.as_ref().map_or([f64::NAN; 2], |folds| held.scores(folds, sweep.chosen, target)),
                sweep,
                inclusion: None,
            });
        }
        if let Some((what, members)) = self.options.ensemble {
            self.agree(region, (&problem, &held), &terms, (what, members), &mut solved, progress)?;
        }
        for (equation, solved) in task.fitted.iter().zip(&solved) {
            if solved.step.support.is_empty() {
                let place = if scan.regions() > 1 {
                    format!(" in region {}", self.evidence.region_name(region))
                } else {
                    String::new()
                };
                notes.push(format!(
                    "{}{place}: no term is left, the learnt part is 0; {}",
                    equation.label,
                    self.options.mend_of_no_terms()
                ));
            }
        }
        Ok(solved)
    }

    fn sweep(
        &self,
        region: usize,
        problem: &Compressed,
        folds: &[FoldProblem],
        terms: &[Terms],
        progress: &dyn Progress,
    ) -> Result<Vec<Sweep>, Error> {
        let options = self.options;
        let choice = match options.criterion {
            _ if options.threshold.is_some() || options.optimizer == SindyOptimizer::LeastSquares => Choice::Optimizer,
            Criterion::OneStandardError => Choice::Auto,
            Criterion::CrossValidation if folds.is_empty() => Choice::Auto,
            Criterion::CrossValidation => Choice::LeastError,
            Criterion::Aic => Choice::Criterion(Information::Aic),
            Criterion::Bic => Choice::Criterion(Information::Bic),
            Criterion::Ebic => Choice::Criterion(Information::Ebic),
        };
        let by_criterion = matches!(choice, Choice::Criterion(_)) || (choice == Choice::Auto && folds.is_empty());
        let criteria = match by_criterion {
            true => CriterionOptions {
                observations: Some(independent(self.evidence, region, problem, &self.evidence.task.free_terms())?),
                ..CriterionOptions::default()
            },
            false => CriterionOptions::default(),
        };
        let every = Thresholds::Changes { most: most_thresholds(problem.columns()) };
        let (overlap, rivals) = (self.overlap(), self.rivals());
        let optimizer = self.optimizer(problem.columns());
        let thresholds = match options.threshold {
            Some(threshold) => Thresholds::List(vec![optimizer.parameter_of_threshold(threshold)]),
            None => every.clone(),
        };
        let with = |thresholds| {
            let options = SweepOptions { thresholds, rivals, choice, criteria, overlap };
            sweep(problem, folds, terms, &optimizer, &options, progress)
        };
        let mut sweeps = with(thresholds)?;
        if self.front && options.threshold.is_some() {
            // The models of other thresholds stand beside the one that was asked for.
            for (sweep, others) in sweeps.iter_mut().zip(with(every)?) {
                beside(sweep, others);
            }
        }
        Ok(sweeps)
    }

    fn overlap(&self) -> bool {
        self.folds.as_ref().is_some_and(Folds::overlap)
    }

    /// Models that compete with those of the optimiser, if one is chosen.
    fn rivals(&self) -> Rivals {
        if self.options.threshold.is_some() || self.options.optimizer == SindyOptimizer::LeastSquares {
            return Rivals::default();
        }
        let backward = self.options.optimizer == SindyOptimizer::Auto;
        Rivals { backward, zero: true, alone: self.evidence.task.constant.then_some(0) }
    }

    /// The models that forward regression chooses itself, on request: of all targets together, as pysindy does.
    fn by_ratio(&self, problem: &Compressed, terms: &[Terms]) -> Result<Vec<Step>, Error> {
        match (self.optimizer(problem.columns()), self.options.kappa) {
            (Optimizer::Frols(frols), Some(kappa)) => {
                let choice = FrolsChoice::LeastRatio { kappa };
                Ok(Frols { choice, ..frols }.jointly(problem, terms)?.steps)
            }
            _ => Ok(Vec::new()),
        }
    }

    /// The optimiser; its threshold is given where it is used alone.
    fn optimizer(&self, candidates: usize) -> Optimizer {
        let (options, scaling) = (self.options, self.options.scaling);
        let most = options.terms.unwrap_or(candidates);
        match options.optimizer {
            SindyOptimizer::Auto | SindyOptimizer::Stlsq => {
                let max_iterations = options.max_iterations;
                Optimizer::Stlsq(Stlsq { alpha: options.ridge, scaling, max_iterations, ..Stlsq::default() })
            }
            SindyOptimizer::Sr3 => {
                Optimizer::Sr3(Sr3 { scaling, unbias: true, max_iterations: 10_000, ..Sr3::default() })
            }
            SindyOptimizer::Ssr => {
                Optimizer::Ssr(Ssr { alpha: options.ridge, max_removals: candidates, scaling, ..Ssr::default() })
            }
            SindyOptimizer::Frols => {
                // Of units only its own choice knows.
                let scaling = if options.kappa.is_some() { scaling } else { Scaling::Physical };
                Optimizer::Frols(Frols { max_terms: most, scaling, choice: FrolsChoice::Last, ..Frols::default() })
            }
            SindyOptimizer::Lasso | SindyOptimizer::GroupLasso => {
                let estimator = self.groups.clone().map_or_else(Default::default, Into::into);
                Optimizer::Path(PenalisedPath { estimator, max_terms: options.terms, ..PenalisedPath::default() })
            }
            SindyOptimizer::LeastSquares => Optimizer::LeastSquares,
        }
    }

    /// The optimiser with the parameter of a model.
    fn tuned(&self, step: &Step, candidates: usize) -> Result<Optimizer, Error> {
        match self.optimizer(candidates) {
            Optimizer::Stlsq(stlsq) => Ok(Optimizer::Stlsq(Stlsq { threshold: step.parameter, ..stlsq })),
            Optimizer::Sr3(sr3) => Ok(Optimizer::Sr3(Sr3 { lambda: step.parameter, ..sr3 })),
            Optimizer::Frols(frols) => Ok(Optimizer::Frols(Frols { max_terms: step.terms().max(1), ..frols })),
            _ => Err(Error::conflict(format!(
                "{entry}: the members of an ensemble are made by stlsq, sr3 or frols, not {}; take one of these, or remove the ensemble",
                self.options.optimizer.name(),
                entry = SINDY.entry("ensemble")
            ))),
        }
    }

    /// A problem whose targets are known as well as those of the evidence.
    fn known(&self, problem: Compressed) -> Compressed {
        problem.known_to(&self.evidence.resolution)
    }

    /// The folds that have rows of the region on both sides.
    fn held_out(&self, region: usize) -> HeldOut {
        let targets = self.evidence.task.fitted.len();
        let mut held = HeldOut { folds: Vec::new(), null: vec![0.0; targets] };
        let Some(folds) = &self.folds else { return held };
        let (scan, constant) = (&self.evidence.scan, self.evidence.task.constant);
        let train = scan.roots(region, folds.train());
        let test = scan.roots(region, folds.test());
        for (fold, (train, test)) in train.into_iter().zip(test).enumerate() {
            if train.weight <= 0.0 || test.weight <= 0.0 {
                continue;
            }
            for (t, null) in held.null.iter_mut().enumerate() {
                *null += test.total[t] + test.weight * (test.mean_y[t] - train.mean_y[t]).powi(2);
            }
            let resolution = self.evidence.resolution_of(|unit| folds.test()[(unit, fold)]);
            held.folds.push(FoldProblem {
                train: self.known(train.compressed(constant)),
                test: test.compressed(constant).known_to(&resolution),
            });
        }
        held
    }

    /// Keeps the terms that the members of an ensemble agree on, with least squares on all rows.
    fn agree(
        &self,
        region: usize,
        (problem, held): (&Compressed, &HeldOut),
        terms: &[Terms],
        (what, members): (Ensemble, usize),
        solved: &mut [Solved],
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let task = &self.evidence.task;
        let replicates = match what {
            Ensemble::Units(unit) => {
                let weights = draws(&self.evidence.scan, unit, members, self.options.seed);
                let roots = self.evidence.scan.roots(region, weights.as_ref());
                let some = roots.into_iter().filter(|root| root.weight > 0.0);
                some.map(|root| root.compressed(task.constant)).collect()
            }
            Ensemble::Library => Vec::new(),
        };
        for (target, solution) in solved.iter_mut().enumerate() {
            let open = task.fitted[target].allowed.iter().filter(|allowed| **allowed).count();
            let free = open - task.fitted[target].fixed.len();
            let options = match what {
                Ensemble::Units(_) => {
                    EnsembleOptions { probability: self.options.inclusion, ..EnsembleOptions::default() }
                }
                Ensemble::Library => EnsembleOptions {
                    // A fifth of the candidates, one at least.
                    leave_out: (free / 5).max(1),
                    draws: members,
                    seed: self.options.seed,
                    probability: self.options.inclusion,
                },
            };
            let system = one(problem, target);
            let replicates: Vec<Compressed> = replicates.iter().map(|replicate| one(replicate, target)).collect();
            let optimizer = self.tuned(&solution.step, problem.columns())?;
            let terms = std::slice::from_ref(&terms[target]);
            let mut agreed = ensemble(&system, &replicates, terms, &optimizer, &options, progress)?;
            let Some(agreed) = agreed.pop() else { continue };
            let parameter = solution.step.parameter;
            solution.step = agreed.model;
            solution.step.parameter = parameter;
            if !held.folds.is_empty() {
                let (model, place) = (std::slice::from_ref(&solution.step), (target, &terms[0]));
                let scores = score_supports(model, &held.folds, place, &optimizer, self.overlap(), progress)?;
                solution.held_out = held.scores(&scores, 0, target);
            }
            solution.inclusion = Some(agreed.inclusion);
        }
        Ok(())
    }
}

/// The group lasso on the candidates of all equations.
fn group_lasso(task: &EquationTask, options: &SindyOptions) -> Result<GroupLasso, Error> {
    let one = Expr::number(1.0);
    let functions = task.constant.then_some(&one).into_iter().chain(&task.functions);
    let functions: Vec<(usize, &Expr)> = functions.map(|function| (0, function)).collect();
    Ok(GroupLasso { l1_ratio: options.l1_ratio, ..GroupLasso::new(Groups::new(options.groups.labels(&functions)?)) })
}

/// One target of a problem.
fn one(problem: &Compressed, target: usize) -> Compressed {
    Compressed {
        z: problem.z.as_ref().subcols(target, 1).to_owned(),
        residual: vec![problem.residual[target]],
        total: vec![problem.total[target]],
        resolution: vec![problem.resolution[target]],
        ..problem.clone()
    }
}

/// Keys of the units of a scan, for folds.
pub(crate) fn keys(scan: &SystemScan) -> (Vec<Key>, Vec<u64>) {
    let key = |unit: &fleetfoot_sums::system::Unit| Key {
        episode: unit.episode,
        chunk: unit.chunk,
        fold: Fold::default(),
        partition: 0,
        region: 0,
    };
    scan.units().iter().map(|unit| (key(unit), unit.rows)).unzip()
}

/// Rows that count as independent, by the residuals of least squares on all candidates.
fn independent(evidence: &Evidence, region: usize, problem: &Compressed, terms: &[Terms]) -> Result<f64, Error> {
    let mut coefficients = Mat::zeros(problem.columns(), problem.targets());
    for (target, terms) in terms.iter().enumerate() {
        let steps = optimize(problem, target, &Optimizer::LeastSquares, terms)?;
        let values = &steps.choice().coefficients;
        values.iter().enumerate().for_each(|(j, &value)| coefficients[(j, target)] = value);
    }
    Ok(system_effective_rows(&evidence.scan, region, evidence.task.constant, coefficients.as_ref()))
}

/// The gap beside held-out rows, or windows: those that share samples are never on both sides.
fn gap(evidence: &Evidence) -> Result<Purge, Error> {
    let shared = match &evidence.weak {
        None => evidence.shared_rows,
        Some(weak) => weak.overlap() + evidence.shared_rows.div_ceil(weak.stride()),
    };
    Ok(purge(shared, correlated(evidence)?))
}

/// Rows over which these residuals are correlated; `None` in several regions, whose rows are no neighbours.
fn correlated(evidence: &Evidence) -> Result<Option<f64>, Error> {
    if evidence.scan.regions() > 1 {
        return Ok(None);
    }
    let problem = evidence.scan.root(0).compressed(evidence.task.constant);
    let rows = independent(evidence, 0, &problem, &evidence.task.free_terms())?;
    Ok(Some(problem.weight / rows))
}

/// Number of draws of every unit (units x members).
fn draws(scan: &SystemScan, unit: BootstrapUnit, members: usize, seed: u64) -> Mat<f64> {
    let units = scan.units();
    let groups: Vec<usize> = match unit {
        BootstrapUnit::Episode => {
            let episodes: BTreeSet<_> = units.iter().map(|unit| unit.episode).collect();
            let order: Vec<_> = episodes.into_iter().collect();
            units.iter().map(|unit| order.binary_search(&unit.episode).unwrap_or(0)).collect()
        }
        _ => blocks(units.iter().map(|unit| (unit.episode, unit.rows))),
    };
    let count = groups.iter().max().map_or(0, |last| last + 1);
    let counts: Vec<Vec<f64>> = (0..members).map(|member| multinomial_counts(seed, member, count)).collect();
    Mat::from_fn(units.len(), members, |unit, member| counts[member][groups[unit]])
}

/// The model with the terms of another; the one that was chosen where there is none.
fn of_support(sweep: &Sweep, wanted: &Step) -> usize {
    sweep.trail.steps.iter().position(|step| step.support == wanted.support).unwrap_or(sweep.chosen)
}

/// The model with the most terms up to a number, the least error among those; of none so small, the smallest.
fn of_size(sweep: &Sweep, most: usize) -> usize {
    let steps = &sweep.trail.steps;
    let better = |a: &usize, b: &usize| {
        let (a, b) = (&steps[*a], &steps[*b]);
        a.terms().cmp(&b.terms()).then(b.rss.total_cmp(&a.rss))
    };
    let all = 0..steps.len();
    let small = all.clone().filter(|&k| steps[k].terms() <= most).max_by(better);
    small.or_else(|| all.min_by_key(|&k| steps[k].terms())).unwrap_or(0)
}

/// Puts the front of other models beside the one model of `own`.
fn beside(sweep: &mut Sweep, others: Sweep) {
    let mut others = others;
    let chosen = sweep.choice().clone();
    if let (Some(all), Some(one)) = (&mut others.folds, &sweep.folds) {
        let (rows, count) = (all.errors.nrows(), all.errors.ncols());
        all.errors =
            Mat::from_fn(
                rows + 1,
                count,
                |k, fold| if k < rows { all.errors[(k, fold)] } else { one.errors[(0, fold)] },
            );
        all.mean.extend_from_slice(&one.mean);
        all.standard_error.extend_from_slice(&one.standard_error);
    }
    others.trail.steps.push(chosen);
    others.chosen = others.trail.steps.len() - 1;
    others.front = others.trail.front();
    *sweep = others;
}
