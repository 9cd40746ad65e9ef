//! From rows to a scored piecewise-affine model (paper, II-E): segment, regress, choose, measure.

use std::collections::BTreeMap;

use fleetfoot_data::{Canonical, Progress, Source};
use fleetfoot_model::{Lattice, Model, Rule};
use fleetfoot_stats::{Chunk, Estimate, FoldLayout, Grid, Mahalanobis, Preconditioner, SquareRoot};
use fleetfoot_sums::system::SystemScan;

use crate::{
    Error, Identification, Options, Problem, Score, Specification,
    complete::Fit,
    cuts::Cuts,
    effective::with_effective_weights,
    errors::{Errors, Measure, PartErrors},
    fit::{Roots, Solver, held_out_error},
    identification::{coefficients, mark},
    lagged::{Whitening, span},
    levels::described,
    notes::confounded,
    pairs::pairs,
    partition::{Prepared, join_cells, prepare},
    plans::{cut, plans},
    region_model::Base,
    scan::{Wanted, sum},
    segmentation::{Candidate, Segmentation},
    select::{Order, choose, effective_rows, effective_rows_in, evaluate, fitted},
    stable::Loop,
    tsqr::factor_regions,
};

/// Identifies a piecewise-affine model of the rows of a source whose columns are the problem's.
///
/// Three passes over the rows: a survey for the partitions (kept rows are clustered), one scan for the Grams, and one
/// for absolute errors. The Grams are those of all regions, folds and partitions, and of the cells that regions are
/// joined of. Weights take one more pass before these, which normalises their scale.
pub fn identify(
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Identification, Error> {
    let weighed = with_effective_weights(problem, source, progress)?;
    let problem = weighed.as_ref().unwrap_or(problem);
    let bound = Loop::requested(problem, options)?;
    let Prepared { rows, grid, folds, chunks, survey, mut segmentation, phase } =
        prepare(problem, options, source, progress)?;
    let preconditioner = rows.coordinates(source)?;
    progress.stage("regression");
    let plan = plan_hash(problem, (&grid, folds.as_ref()), &segmentation, &preconditioner);
    let plans = plans(problem, &segmentation, &preconditioner, source)?;
    let cut = cut(&segmentation, &plans, options);
    let wanted = Wanted { plans: &plans, cuts: Cuts::new(&chunks), cut: &cut };
    let mut scanned = sum(&rows, &segmentation, &preconditioner, source, &wanted, &plan, progress)?;
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
        phase: phase.as_ref(),
        bound,
    };
    fit.finish(source, &chunks, progress)
}

fn plan_hash(
    problem: &Problem,
    (grid, folds): (&Grid, Option<&FoldLayout>),
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
) -> String {
    let mut canonical = Canonical::default();
    canonical.count(grid.chunk_rows as u64);
    canonical.tag(folds.is_some().into());
    folds.iter().for_each(|folds| folds.encode(&mut canonical));
    let targets = problem.equations.iter().filter_map(|equation| equation.target.as_ref());
    for expressions in [problem.weight.iter().collect::<Vec<_>>(), problem.library.iter().collect(), targets.collect()]
    {
        canonical.count(expressions.len() as u64);
        expressions.iter().for_each(|expression| canonical.text(&expression.to_string()));
    }
    let cells = segmentation.lattices.iter().map(|lattice| &lattice.partition);
    let partitions = segmentation.partitions.iter().filter(|partition| !matches!(partition.rule, Rule::Joined { .. }));
    partitions.chain(cells).for_each(|partition| partition.encode_rule(&mut canonical));
    fleetfoot_stats::plan_hash(canonical.as_bytes(), preconditioner)
}

impl Fit<'_> {
    fn finish(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Identification, Error> {
        let solver = Solver {
            stats: &self.scan.stats,
            preconditioner: self.preconditioner,
            partitions: &self.segmentation.partitions,
            cells: self.joined.map(|(sets, _)| sets),
            statistics: &self.scan.whole,
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
        let candidates = mark(self.scores(&orders, &errors, &parts, &sigma));
        let mut models: Vec<Model> = kept
            .iter()
            .zip(errors.residuals.iter().zip(&roots))
            .map(|(&kept, (scatter, roots))| {
                let initial = (roots, &base.average);
                self.model(&orders[kept], kept, &errors, scatter.as_ref(), source, initial)
            })
            .collect();
        for (((model, walks), &kept), roots) in models.iter_mut().zip(errors.walks).zip(&kept).zip(&roots) {
            if let (Some(partition), Some(walks)) = (model.partitions.first_mut(), walks) {
                let (transitions, phases) = walks.counted(self.options.phase.as_ref().zip(self.phase));
                let rows = self.independent(kept, &orders[kept], roots, (&base, independent));
                let grams = solver.grams(self.segmentation.candidates[kept].full, None);
                partition.pairs = pairs(&grams, &transitions, self.preconditioner, rows / base.root.weight)?;
                (partition.transitions, partition.phases) = (Some(transitions), phases);
            }
        }
        let rows_over = self.rows_over();
        for (model, lagged) in models.iter_mut().zip(&errors.lagged) {
            if let (Some(partition), Some(lagged), Some(rows)) = (model.partitions.first_mut(), lagged, rows_over) {
                partition.correlation = lagged.correlation(rows);
            }
        }
        for (model, &kept) in models.iter_mut().zip(&kept) {
            if let Some(partition) = model.partitions.first_mut() {
                partition.lattice = self.lattice(kept, &orders, base.root.weight);
            }
        }
        let (model, roots) = if self.options.keep_all {
            (models[chosen].clone(), roots.swap_remove(chosen))
        } else {
            (models.remove(0), roots.remove(0))
        };
        let partition_notes = self.segmentation.notes.clone();
        let mut notes: Vec<String> = partition_notes.iter().map(ToString::to_string).collect();
        confounded(self.problem, &base, &mut notes);
        self.empty_regions(&solver, &mut notes);
        notes.extend(self.uncounted(&kept));
        notes.extend(candidates[chosen].no_better());
        notes.extend(self.starved(&kept, &orders, &solver));
        Ok(Identification {
            model,
            models,
            roots,
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
            partition_notes,
        })
    }

    /// The statistic that the models of a candidate are made of, where it has one and no QR takes its place.
    pub(crate) fn statistic(&self, candidate: usize) -> Option<&SystemScan> {
        self.scan.whole[self.segmentation.candidates[candidate].full].as_ref().filter(|_| !self.options.tsqr)
    }

    /// Rows that count as independent by the residuals of a candidate's own model; `independent` by those of one region, where regions are joined of cells.
    fn independent(
        &self,
        candidate: usize,
        order: &Order,
        roots: &BTreeMap<u32, SquareRoot>,
        (base, independent): (&Base, f64),
    ) -> f64 {
        let Candidate { specification, full, .. } = &self.segmentation.candidates[candidate];
        let rows = if specification.joined().is_some() {
            independent
        } else {
            let error = held_out_error(&order.full, roots, self.rows.targets);
            let sums = (&self.scan.stats, self.preconditioner);
            effective_rows_in(sums, *full, &order.full, (&error, base.root.weight))
        };
        rows.min(base.root.weight)
    }

    /// Description of the tree behind a candidate whose regions are joined cells.
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
        if let (Some(bound), Some((stability, _))) = (&self.bound, &mut order.stability) {
            *stability = bound.bound(&mut order.full, &base, &roots, order.shrinkage)?;
        }
        Ok(Some(roots))
    }

    /// Rows over which the targets are measured, if the residuals determine the error of a step.
    fn rows_over(&self) -> Option<usize> {
        span(self.problem.equations.iter().filter(|equation| equation.target.is_some()))
    }

    /// Whitening of a candidate's residuals, if their correlation is kept. A model without regressors has larger
    /// residuals than least squares, and has none.
    fn whitening(&self, candidate: usize, order: &Order, solver: &Solver<'_>) -> Option<Whitening> {
        let Candidate { specification, full, .. } = &self.segmentation.candidates[candidate];
        let is_wanted = self.rows_over().is_some() && *specification != Specification::Null;
        let scales = &self.survey.scales;
        let variances: Vec<f64> = (0..self.rows.targets).map(|t| scales.get(t, t) / scales.weight).collect();
        is_wanted.then(|| Whitening::new(&solver.grams(*full, None), order.full.len(), self.preconditioner, &variances))
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
        let whitening = |&candidate: &usize| self.whitening(candidate, &orders[candidate], solver);
        MeasureInput {
            fit: self,
            scattered: kept.iter().map(|&candidate| self.statistic(candidate).is_none()).collect(),
            whitening: kept.iter().map(whitening).collect(),
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
                coefficients: coefficients(
                    &candidate.specification,
                    order.full.len(),
                    (self.rows.regressors, q),
                    order.continuity,
                ),
                front: false,
                shrinkage: order.shrinkage,
                over_null: (0..q).map(|t| sums.absolute[t] / errors.null.absolute[t]).collect(),
                over_null_interval: (0..q)
                    .map(|t| Estimate::of_errors(parts.iter().map(|p| (p.candidates[index][t], p.null[t]))))
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
                stability: order.stability.as_ref().map(|(stability, _)| stability.clone()),
                free_loss: order.stability.as_ref().map_or(order.loss, |(_, free)| *free),
                objective: candidate.objective.clone(),
            })
            .collect()
    }
}

/// Owned parts that a [`Measure`] borrows.
struct MeasureInput<'m> {
    fit: &'m Fit<'m>,
    orders: &'m [Order],
    kept: &'m [usize],
    mean: Vec<f64>,
    fold_means: Vec<Vec<f64>>,
    metric: Mahalanobis,
    whitening: Vec<Option<Whitening>>,
    scattered: Vec<bool>,
}

impl MeasureInput<'_> {
    fn run(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Errors, Error> {
        Measure {
            rows: self.fit.rows,
            segmentation: self.fit.segmentation,
            orders: self.orders,
            kept: self.kept,
            scattered: &self.scattered,
            mean: &self.mean,
            fold_means: &self.fold_means,
            whitening: self.metric.whitening(),
            phase: self.fit.phase,
            whitening_by_region: &self.whitening,
        }
        .run(source, chunks, progress)
    }
}
