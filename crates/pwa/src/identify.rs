//! From rows to a scored piecewise-affine model (paper, II-E): segment, regress, choose, measure.

use std::collections::BTreeMap;

use fleetfoot_data::{Progress, Source};
use fleetfoot_model::{Lattice, Model, Rule};
use fleetfoot_stats::{
    Basis, Chunk, Concentration, Estimate, FoldLayout, Grid, Mahalanobis, Preconditioner, SquareRoot,
};

use crate::{
    Error, Options, Problem, Specification, Stability,
    errors::{Errors, Measure, PartErrors},
    fit::{Base, Roots, Solver},
    lattice::{Sets, Tree, bytes as cell_bytes, described},
    notes::confounded,
    partition::{Prepared, join_cells, prepare},
    regions::{Candidate, Segmentation},
    rows::Rows,
    scan::{Scan, sum},
    select::{Order, choose, effective_rows, evaluate, fitted},
    stable::Loop,
    survey::{Survey, example_bytes, examples, kept_bytes},
    tsqr::factor_regions,
};

/// Bytes that all stored statistics may take.
pub(crate) const STATS_BUDGET: usize = 192 << 20;

/// A model and how it was found.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Identification {
    /// The chosen model.
    pub model: Model,
    /// With [`Options::keep_all`] the models of all candidates, in their order; else empty.
    pub models: Vec<Model>,
    /// Every partition that was tried, in the order asked for.
    pub candidates: Vec<Score>,
    /// Index of the chosen one.
    pub chosen: usize,
    /// The rule that chose it, for people; `None` where there was nothing to choose from, or the caller chose.
    pub rule: Option<&'static str>,
    /// Left sides of the fitted equations.
    pub targets: Vec<String>,
    /// Standard deviation of each target (population).
    pub sigma: Vec<f64>,
    /// Rows used.
    pub rows: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub at_border: u64,
    /// Rows with a missing value.
    pub incomplete: u64,
    /// Rows that count as independent.
    pub effective_rows: f64,
    /// Whether the scores are of rows that did not train (cross-validation).
    pub held_out: bool,
    /// Which rows were held out, for people; `None` where none were.
    pub fold_rule: Option<String>,
    /// What the intervals of the scores compare.
    pub basis: Basis,
    /// Condition number of the standardised regressors of the one-region regression.
    pub condition: f64,
    /// Condition number of its preconditioned Gram matrix: near 1 while the pilot sample is representative.
    pub preconditioned: f64,
    /// For each target the few rows that hold most of its variance, where they do; empty where that is not known.
    pub concentrated: Vec<Option<Concentration>>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Scores of one partition.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Score {
    /// The partition.
    pub specification: Specification,
    /// Its regions.
    pub regions: usize,
    /// Shrinkage used, rows.
    pub shrinkage: f64,
    /// Mean absolute error of each target over that of the null model on the same rows (Table I's printed numbers).
    pub over_null: Vec<f64>,
    /// The same with 95 % intervals over [`Identification::basis`].
    pub over_null_interval: Vec<Estimate>,
    /// Sums of absolute errors of each target over the parts that the intervals compare: parts x targets.
    pub absolute: Vec<Vec<f64>>,
    /// Mean absolute error of each target over the target's standard deviation.
    pub over_sigma: Vec<f64>,
    /// Coefficient of determination of each target.
    pub r2: Vec<f64>,
    /// Mean Mahalanobis score of the error vector under the covariance of the targets (equation (10)).
    pub mahalanobis: f64,
    /// Cross-validated squared error over variance, mean over targets and folds; NaN without folds.
    pub loss: f64,
    /// Its standard error across folds.
    pub standard_error: f64,
    /// The same loss, fold by fold.
    pub losses: Vec<f64>,
    /// Bayesian information criterion.
    pub bic: f64,
    /// What it costs that maps meet at their borders, where they do.
    pub continuity: Option<Continuity>,
    /// How its maps contract, where [`Options::stability`] asks for it.
    pub stability: Option<Stability>,
    /// The loss of the free models in place of the bounded ones; the same where nothing is bounded, and of the training rows where none are held out.
    pub free_loss: f64,
    /// For a refined partition the objective after every pass over the rows that it was refined on: it falls. Empty for the others.
    pub objective: Vec<f64>,
}

/// What it costs that the maps of neighbouring regions meet at their border.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Continuity {
    /// Borders between rows.
    pub borders: usize,
    /// Numbers that are free, of each target.
    pub numbers: usize,
    /// The loss of as many maps that need not meet; NaN without folds.
    pub apart: f64,
    /// The largest difference of two maps at a border, in standard deviations of the target: rounding.
    pub jump: f64,
}

impl Identification {
    /// Absolute error of candidate `a` over that of candidate `b`, for each target, on the same rows: its interval is that of the paired parts, so that
    /// what makes a part hard for both does not widen it.
    pub fn error_ratio(&self, a: usize, b: usize) -> Vec<Estimate> {
        let (a, b) = (&self.candidates[a].absolute, &self.candidates[b].absolute);
        (0..self.targets.len()).map(|t| Estimate::of_ratio(a.iter().zip(b).map(|(a, b)| (a[t], b[t])))).collect()
    }
}

/// Identifies a piecewise-affine model of the rows of a source whose columns are the problem's.
///
/// Three passes over the rows: a survey for the partitions (kept rows are clustered), one scan for the Grams of all regions, folds and partitions (and of the
/// cells that regions are joined of), and one for absolute errors.
pub fn identify(
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Identification, Error> {
    let bound = options.stability.map(|bound| Loop::new(problem, bound)).transpose()?;
    let Prepared { rows, grid, folds, chunks, survey, mut segmentation } = prepare(problem, options, source, progress)?;
    let preconditioner = rows.coordinates(source)?;
    progress.stage("regression");
    let plan = plan_hash(problem, (&grid, folds.as_ref()), &segmentation, &preconditioner);
    let mut scanned = sum(&rows, &segmentation, &preconditioner, source, &chunks, &plan, progress)?;
    let joined = join_cells(&mut segmentation, &mut scanned, &preconditioner)?;
    let fit = Fit {
        problem,
        options,
        rows: &rows,
        folds: folds.as_ref(),
        survey: &survey,
        segmentation: &segmentation,
        scan: &scanned,
        joined: joined.as_ref(),
        preconditioner: &preconditioner,
        bound,
    };
    fit.finish(source, &chunks, progress)
}

/// What an identification will keep in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Cost {
    /// Rows that are kept to find regions: all, or as many as the memory allows.
    pub clustered_rows: usize,
    /// Bytes, about: kept rows, stored statistics, blocks in flight.
    pub bytes: usize,
}

/// Tells beforehand what [`identify`] will keep in memory for `rows` rows.
pub fn cost(problem: &Problem, options: &Options, rows: usize) -> Cost {
    let targets = problem.equations.iter().filter(|equation| equation.target.is_some()).count();
    let width = problem.library.len() + targets;
    let per_row = kept_bytes(problem.partition_columns.len(), 0);
    let any = |wanted: fn(&Specification) -> bool| options.partitions.iter().any(wanted);
    let clustered = if any(Specification::is_clustered) { rows.min(options.memory / per_row.max(1)) } else { 0 };
    let per_example = example_bytes(problem.partition_columns.len(), width);
    let refined = if any(Specification::fits_targets) || options.continuous {
        examples(rows, per_example, options.memory)
    } else {
        0
    };
    let shape = (problem.library.len(), targets);
    let joined = options.partitions.iter().filter_map(Specification::joined).max();
    let cells = joined.map_or(0, |regions| cell_bytes(rows, shape, regions, options.folds));
    let regions: usize =
        options.partitions.iter().map(expected_regions).sum::<usize>() * (1 + usize::from(options.folds)) + 1;
    let statistics = (rows.div_ceil(256) * regions * gram_bytes(width)).min(STATS_BUDGET);
    let blocks = 2 * fleetfoot_data::thread_count() * 65_536 * 8 * (problem.columns.len() + 1);
    Cost {
        clustered_rows: clustered.max(refined),
        bytes: clustered * per_row + refined * per_example + statistics + cells + blocks,
    }
}

pub(crate) fn gram_bytes(width: usize) -> usize {
    8 * (width + 4) * (width + 4) / 2
}

pub(crate) fn expected_regions(specification: &Specification) -> usize {
    match specification {
        Specification::Null | Specification::Average => 0,
        Specification::ZScore(_) => 2,
        Specification::KMeans(k) | Specification::Refined(k) => *k,
        Specification::Tree(depth) => 1 << depth,
        // The sums of cells are bounded by themselves.
        Specification::Lattice(_) => 0,
        Specification::Labels { .. } => 10 * specification.clusters().unwrap_or(1),
    }
}

fn plan_hash(
    problem: &Problem,
    cut: (&Grid, Option<&FoldLayout>),
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
) -> String {
    let mut text = format!("{cut:?}\n{:?}\n", problem.weight.as_ref().map(ToString::to_string));
    for function in &problem.library {
        text.push_str(&format!("{function}\n"));
    }
    for target in problem.equations.iter().filter_map(|equation| equation.target.as_ref()) {
        text.push_str(&format!("= {target}\n"));
    }
    let cells = segmentation.lattices.iter().map(|lattice| &lattice.partition);
    let own = segmentation.partitions.iter().filter(|partition| !matches!(partition.rule, Rule::Joined { .. }));
    for partition in own.chain(cells) {
        text.push_str(&format!("{:?} {:?} {:?}\n", partition.rule, partition.centre, partition.scale));
    }
    fleetfoot_stats::plan_hash(&text, preconditioner)
}

/// All that is known when the statistic is complete.
pub(crate) struct Fit<'a> {
    pub(crate) problem: &'a Problem,
    pub(crate) options: &'a Options,
    pub(crate) rows: &'a Rows,
    folds: Option<&'a FoldLayout>,
    pub(crate) survey: &'a Survey,
    pub(crate) segmentation: &'a Segmentation,
    pub(crate) scan: &'a Scan,
    /// Sums of the cells and their trees, where there are any.
    joined: Option<&'a (Sets, Vec<Tree>)>,
    preconditioner: &'a Preconditioner,
    /// What the models' maps are bounded by.
    bound: Option<Loop>,
}

impl Fit<'_> {
    fn finish(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Identification, Error> {
        let solver = Solver {
            stats: &self.scan.stats,
            preconditioner: self.preconditioner,
            partitions: &self.segmentation.partitions,
            cells: self.joined.map(|(sets, _)| sets),
        };
        let too_few = || Error::TooFewRows {
            complete: self.survey.counts.complete,
            regressors: self.rows.regressors + 1,
            at_border: self.survey.counts.at_border,
            incomplete: self.survey.counts.incomplete,
        };
        let base = solver.base(None).filter(|base| base.root.weight > 0.0).ok_or_else(too_few)?;
        let independent = effective_rows(&self.scan.stats, self.preconditioner, &base);
        let folds = if self.options.folds > 1 { self.options.folds } else { 0 };
        let regions = |partition: usize| self.segmentation.partitions[partition].rule.count();
        let candidates = (self.segmentation.candidates.as_slice(), &regions as &dyn Fn(usize) -> usize);
        let rule = (folds, self.options.shrinkage);
        let mut orders = evaluate(&solver, candidates, rule, self.bound.as_ref(), &base, independent)?;
        let specifications: Vec<&Specification> =
            self.segmentation.candidates.iter().map(|c| &c.specification).collect();
        let (chosen, rule) = choose(self.options.selection, &specifications, &orders);
        let kept: Vec<usize> = if self.options.keep_all { (0..orders.len()).collect() } else { vec![chosen] };
        let mut roots = Vec::with_capacity(kept.len());
        for &candidate in &kept {
            let order = &mut orders[candidate];
            let solved = order.training.take();
            let again = || solver.training(self.segmentation.candidates[candidate].full, None);
            let mut of_regions = solved.unwrap_or_else(again);
            if self.options.tsqr {
                progress.stage("TSQR");
                of_regions = self.refit(order, candidate, source, chunks, progress)?.unwrap_or(of_regions);
            }
            roots.push(of_regions);
        }
        progress.stage("errors");
        let errors = self.measure(&orders, &kept, &base, &solver).run(source, chunks, progress)?;
        let q = self.rows.targets;
        let sigma: Vec<f64> =
            (0..q).map(|t| (self.survey.scales.get(t, t) / self.survey.scales.weight).sqrt()).collect();
        let (basis, parts) =
            errors.compared(self.folds.map_or(source.episodes().len() > 1, FoldLayout::whole_episodes));
        let candidates = self.scores(&orders, &errors, &parts, &sigma);
        let mut models: Vec<Model> = kept
            .iter()
            .zip(errors.residuals.iter().zip(&roots))
            .map(|(&kept, (residuals, roots))| self.model(&orders[kept], kept, &errors, residuals, source, roots))
            .collect();
        for (model, walks) in models.iter_mut().zip(&errors.walks) {
            if let (Some(partition), Some(walks)) = (model.partitions.first_mut(), walks) {
                partition.transitions = Some(walks.transitions());
            }
        }
        for (model, &kept) in models.iter_mut().zip(&kept) {
            if let Some(partition) = model.partitions.first_mut() {
                partition.lattice = self.lattice(kept, &orders, base.root.weight);
            }
        }
        let model = if self.options.keep_all { models[chosen].clone() } else { models.remove(0) };
        let mut notes = self.segmentation.notes.clone();
        confounded(self.problem, &base, &mut notes);
        self.empty_balls(&solver, &mut notes);
        Ok(Identification {
            model,
            models,
            candidates,
            chosen,
            rule,
            targets: self.problem.equations.iter().filter(|e| e.target.is_some()).map(|e| e.label()).collect(),
            sigma,
            rows: self.survey.counts.complete,
            at_border: self.survey.counts.at_border,
            incomplete: self.survey.counts.incomplete,
            effective_rows: independent,
            held_out: self.options.folds > 1,
            fold_rule: self.folds.map(FoldLayout::in_words),
            basis,
            condition: base.average.condition,
            preconditioned: base.root.condition,
            concentrated: self.survey.concentrated(source.episodes(), chunks),
            notes,
        })
    }

    /// What the model of a candidate that is joined of cells tells of the tree.
    fn lattice(&self, candidate: usize, orders: &[Order], weight: f64) -> Option<Lattice> {
        let (candidates, (_, trees)) = (&self.segmentation.candidates, self.joined?);
        candidates[candidate].specification.joined()?;
        let level =
            |one: &Candidate| one.specification.joined().is_some() || one.specification == Specification::Average;
        let tried: Vec<&Order> =
            candidates.iter().zip(orders).filter(|(one, _)| level(one)).map(|(_, order)| order).collect();
        Some(described(trees.first()?, orders[candidate].full.len(), &tried, (weight, self.rows.targets)))
    }

    /// Fits a candidate again by TSQR.
    fn refit(
        &self,
        order: &mut Order,
        candidate: usize,
        source: &dyn Source,
        chunks: &[Chunk],
        progress: &dyn Progress,
    ) -> Result<Option<BTreeMap<u32, SquareRoot>>, Error> {
        let candidate = &self.segmentation.candidates[candidate];
        let factor = |partition| factor_regions(self.rows, self.segmentation, partition, source, chunks, progress);
        let Some(base) = factor(0)?.remove(&0).map(Base::new) else { return Ok(None) };
        let roots = factor(candidate.full)?;
        order.full = fitted(candidate, None, order.full.len(), &base, &roots, order.shrinkage).models;
        if let (Some(bound), Some((told, _))) = (&self.bound, &mut order.stability) {
            *told = bound.bound(&mut order.full, &base, &roots, order.shrinkage)?;
        }
        Ok(Some(roots))
    }

    fn measure<'m>(
        &'m self,
        orders: &'m [Order],
        kept: &'m [usize],
        base: &'m Base,
        solver: &Solver<'_>,
    ) -> MeasureInput<'m> {
        let folds = if self.options.folds > 1 { self.options.folds } else { 0 };
        let fold_means = (0..folds)
            .map(|fold| solver.base(Some(fold)).map_or_else(|| base.root.mean_y.clone(), |base| base.root.mean_y))
            .collect();
        let q = self.rows.targets;
        MeasureInput {
            fit: self,
            orders,
            kept,
            mean: base.root.mean_y.clone(),
            fold_means,
            metric: Mahalanobis::of_covariance(&self.survey.scales.covariance(0..q), q),
        }
    }

    fn scores(&self, orders: &[Order], errors: &Errors, parts: &[PartErrors], sigma: &[f64]) -> Vec<Score> {
        let q = self.rows.targets;
        orders
            .iter()
            .zip(&errors.candidates)
            .zip(&self.segmentation.candidates)
            .enumerate()
            .map(|(index, ((order, sums), candidate))| Score {
                specification: candidate.specification.clone(),
                regions: order.full.len(),
                shrinkage: order.shrinkage,
                over_null: (0..q).map(|t| sums.absolute[t] / errors.null.absolute[t]).collect(),
                over_null_interval: (0..q)
                    .map(|t| Estimate::of_ratio(parts.iter().map(|p| (p.candidates[index][t], p.null[t]))))
                    .collect(),
                absolute: parts.iter().map(|part| part.candidates[index][..q].to_vec()).collect(),
                over_sigma: (0..q).map(|t| sums.absolute[t] / errors.weight / sigma[t]).collect(),
                r2: (0..q).map(|t| 1.0 - sums.squared[t] / (errors.weight * sigma[t] * sigma[t])).collect(),
                mahalanobis: sums.mahalanobis / errors.weight,
                loss: order.loss,
                standard_error: order.standard_error,
                losses: order.losses.clone(),
                bic: order.bic,
                continuity: order.continuity,
                stability: order.stability.as_ref().map(|(told, _)| told.clone()),
                free_loss: order.stability.as_ref().map_or(order.loss, |(_, free)| *free),
                objective: candidate.objective.clone(),
            })
            .collect()
    }
}

/// Owns what a [`Measure`] borrows.
struct MeasureInput<'m> {
    fit: &'m Fit<'m>,
    orders: &'m [Order],
    kept: &'m [usize],
    mean: Vec<f64>,
    fold_means: Vec<Vec<f64>>,
    metric: Mahalanobis,
}

impl MeasureInput<'_> {
    fn run(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Errors, Error> {
        Measure {
            rows: self.fit.rows,
            segmentation: self.fit.segmentation,
            orders: self.orders,
            kept: self.kept,
            mean: &self.mean,
            fold_means: &self.fold_means,
            whitening: self.metric.whitening(),
        }
        .run(source, chunks, progress)
    }
}
