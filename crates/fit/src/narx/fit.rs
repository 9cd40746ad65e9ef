//! `fit narx`: rows, partitions, choice, terms, model, scores.

use std::sync::Arc;

use faer::Mat;
use fleetfoot_data::setting::{DECIMATE, EFFORT, FREE_RUN, ROLLOUT};
use fleetfoot_data::{Progress, Source, Work};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, StatisticFile, open};
use fleetfoot_library::Expr;
use fleetfoot_model::{Model, Partition};
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_sums::system::{SystemPlan, SystemScan};
use fleetfoot_task::{EquationTask, Provenance};

use super::{
    NarxEquation, NarxOptions, NarxRegion, NarxReport, NarxTerm, OrderRule,
    choice::Choice,
    choose::Chosen,
    options::USUAL,
    partitions::start_note,
    runs::free_runs_by_file,
    scores::scores,
    summed::{Evidence, Sums, by_single_steps},
    task::{NarxBase, one_row_ahead},
    terms::{EquationTerms, coefficients},
    training::Fit,
};
use crate::{
    beneath::beneath,
    error::Error,
    folds::smoothed_rows,
    incomplete::in_no_region,
    method::{Data, FitRequest, Fitted, Method, Opened, Rival, RowFacts},
    objective::{Beginning, Coefficients, Refinement},
    plan::FitPlan,
    sindy::coefficients_of,
    spans::Spans,
    summary::FitSummary,
    worth::{no_better, verdict},
};

/// `fit narx`: one scan for all orders, one more a partition, and simulations. Of a statistic: no pass, and no
/// simulation of training rows.
#[derive(Debug, Clone)]
pub struct Narx {
    pub(super) options: NarxOptions,
    /// Files to run the model on that did not train it.
    free_run: Logs,
    /// True to keep the other models of the front.
    rivals: bool,
}

/// The statistic that an autoregression is fitted to.
pub struct Scanned {
    file: Arc<StatisticFile>,
    recipe: Recipe,
}

/// Partition, order and terms that were chosen.
pub struct Solution {
    chosen: Chosen,
    partition: Choice,
    model: Model,
    rivals: Vec<Rival>,
    provenance: Provenance,
}

impl Method for Narx {
    const NAME: &'static str = "narx";
    type Report = NarxReport;
    type Task = NarxBase;
    type Sums = Option<Scanned>;
    type Solution = Solution;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        Ok(Self { options: NarxOptions::new(recipe)?, free_run: request.free_run.clone(), rivals: request.rivals })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let options = &self.options;
        let prepared = one_row_ahead(recipe, options)?;
        let (task, reading, notes) = match open::estimate_equations(&prepared, logs, progress)? {
            Some((task, columns, cost)) => (task, ReadPlan::of_messages(logs, columns, &cost), Vec::new()),
            None => {
                let (dataset, task) = Dataset::for_equations(&prepared, logs, progress)?;
                (task, ReadPlan::of_tables(logs, &dataset), dataset.notes().to_vec())
            }
        };
        let base = NarxBase::new(task, recipe)?;
        let (order, looked) = match options.order {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) => (order, None),
            OrderRule::Look(given) => (given.or(USUAL), Some(options.effort.limit() as f64)),
        };
        let (candidates, outputs) = (base.candidates(order), base.outputs());
        let regions = options.partitions.iter().map(|partition| partition.clusters().unwrap_or(1)).max().unwrap_or(1);
        let most = if looked.is_some() { options.effort.most_candidates() } else { candidates };
        let rows = reading.rows / options.decimate;
        let operations =
            rows as f64 * (candidates as f64).powi(2) + (options.folds as f64) * (candidates as f64).powi(3);
        let mut details = vec![match options.order {
            OrderRule::Fixed(order) => format!("order: {order}"),
            OrderRule::UpTo(order) => format!("orders up to {order}"),
            OrderRule::Look(_) => format!(
                "orders are searched within effort {}: up to {most} candidates an order, {:.1e} terms evaluated",
                options.effort.word(),
                options.effort.limit() as f64
            ),
        }];
        details.push(format!("{} held-out spans in turn", options.folds));
        Ok(FitPlan {
            equations: base.task.fitted.iter().map(|equation| equation.label.clone()).collect(),
            candidates: most,
            regions,
            passes: 1 + options.partitions.len(),
            simulations: self.simulations(),
            smoothing: None,
            memory: SystemPlan::memory(&base.with(&[order])?.task.system(), regions, rows),
            work: Work {
                operations: looked.unwrap_or(operations * outputs as f64),
                parts: outputs.max(1),
                mend: format!(
                    "fewer lags, a lower degree or {given_effort} make it shorter",
                    given_effort = EFFORT.to("low")
                ),
            },
            details,
            reading,
            notes,
        })
    }

    fn objective(&self) -> Objective {
        self.options.objective
    }

    fn open(&mut self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Dataset, NarxBase), Error> {
        let (dataset, task) = Dataset::for_equations(&one_row_ahead(recipe, &self.options)?, logs, progress)?;
        Ok((dataset, NarxBase::new(task, recipe)?))
    }

    fn above(recipe: &Recipe, scanned: &Recipe, _: &StatisticFile, notes: &mut Vec<String>) -> Result<Recipe, Error> {
        Ok(by_single_steps(&beneath(recipe, scanned)?, notes)?.into_owned())
    }

    fn of_statistic(
        &self,
        recipe: &Recipe,
        scanned: &Recipe,
        file: &Arc<StatisticFile>,
        notes: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(NarxBase, Self::Sums), Error> {
        let expanded = recipe.expand(&file.fields)?;
        let task = EquationTask::resolve(&one_row_ahead(&expanded, &self.options)?, &file.fields)?;
        notes.push(
            format!("errors of free runs need rows, which a statistic lacks: {ROLLOUT} and {given_free_run} report them on logs", given_free_run = FREE_RUN.to("FILE")),
        );
        Ok((NarxBase::new(task, &expanded)?, Some(Scanned { file: file.clone(), recipe: scanned.clone() })))
    }

    fn split<'a>(&self, rows: &'a dyn Source, step: f64) -> Result<Option<[Spans<'a>; 2]>, Error> {
        let tested = |rows: usize| (rows as f64 * self.options.test_share).round() as usize;
        let apart = smoothed_rows(self.options.smoothed, step);
        let (train, test) = Spans::split(rows, tested, self.options.decimate, apart)?;
        Ok(Some([train, test]))
    }

    fn every(&self) -> usize {
        self.options.decimate
    }

    fn sum(&self, _: Data<'_, NarxBase>, _: &mut Vec<String>, _: &dyn Progress) -> Result<Self::Sums, Error> {
        Ok(None)
    }

    /// Nothing is summed before orders are looked for, but inputs that act late are found.
    fn sum_logs(
        &self,
        opened: &mut Opened<NarxBase>,
        _: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self::Sums, Error> {
        let Opened { recipe, task, dataset } = opened;
        let view = dataset.view()?;
        let split = self.split(&view, dataset.step())?;
        let rows: &dyn Source = split.as_ref().map_or(&view, |[train, _]| train);
        let step = dataset.step() * self.every() as f64;
        let evidence = Evidence::Rows(rows);
        let fit = Fit { recipe, options: &self.options, base: task, evidence, step, rivals: false };
        let count = rows.episodes().iter().map(|episode| episode.rows).sum();
        let delays = fit.delays(count, progress)?;
        for (input, &late) in delays.iter().enumerate().filter(|(_, late)| **late > 0) {
            let (name, seconds) = (task.input(input), late as f64 * step);
            notes.push(format!(
                "{name} acts with a delay of at least {late} rows ({seconds:.4} s): its lags begin there"
            ));
        }
        *task = task.delayed(&delays);
        Ok(None)
    }

    fn find(
        &self,
        data: Data<'_, NarxBase>,
        sums: &Self::Sums,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Solution>, Error> {
        let mut options = self.options.clone();
        options.order = data.task.simulated(options.order, data.step)?;
        let summed =
            sums.as_ref().map(|statistic| Sums::new(&statistic.file, &statistic.recipe, &options)).transpose()?;
        let evidence = match &summed {
            Some(sums) => Evidence::Sums(sums),
            None => Evidence::Rows(data.rows()?),
        };
        let fit = Fit {
            recipe: data.recipe,
            options: &options,
            base: data.task,
            evidence,
            step: data.step,
            rivals: self.rivals,
        };
        Ok(vec![fit.find(notes, progress)?])
    }

    fn model(solution: &Solution) -> &Model {
        &solution.model
    }

    /// Terms are chosen anew, in the order that was found.
    fn again(
        &self,
        data: Data<'_, NarxBase>,
        solution: &Solution,
        progress: &dyn Progress,
    ) -> Result<Beginning, Error> {
        let order = OrderRule::Fixed(solution.chosen.order);
        let options = NarxOptions { order, objective: Objective::OneStep, ..self.options.clone() };
        let again = Self { options, free_run: Logs::default(), rivals: false };
        let mut models = again.trials(data, progress)?;
        Ok((models.swap_remove(0).1, None))
    }

    fn held_out_by_time(
        &self,
        data: Data<'_, NarxBase>,
        solution: &Solution,
        progress: &dyn Progress,
    ) -> Option<Result<Model, Error>> {
        (self.options.test_share == 0.0).then(|| Ok(self.again(data, solution, progress)?.0))
    }

    fn refine(
        &self,
        _: Data<'_, NarxBase>,
        _: &Self::Sums,
        solution: &mut Solution,
        refinement: &mut Refinement,
    ) -> Result<(), Error> {
        if refinement.written {
            let chosen = &solution.chosen;
            let coefficients = coefficients_of(&refinement.fitted.model, &chosen.task, chosen.terms.len());
            solution.model = chosen.model(&solution.partition, &coefficients, solution.provenance.clone());
        }
        Ok(())
    }

    fn expressions(&self, task: &NarxBase) -> Vec<Expr> {
        task.row_functions()
    }

    fn facts(&self, _: Data<'_, NarxBase>, _: &Self::Sums, solution: &Solution) -> RowFacts {
        let (labels, whole) = (solution.chosen.labels(), &solution.chosen.whole);
        let counts = whole.counts();
        RowFacts {
            episodes: solution.provenance.episodes.len(),
            left_out: vec![counts.at_border, counts.incomplete],
            concentrated: labels.zip(whole.concentrated().iter().cloned()).collect(),
        }
    }

    fn report(
        &self,
        data: Data<'_, NarxBase>,
        _: &Self::Sums,
        solution: Solution,
        mut summary: FitSummary,
        progress: &dyn Progress,
    ) -> Result<Fitted<NarxReport>, Error> {
        progress.stage("scores");
        let Solution { chosen, partition, model, rivals, .. } = solution;
        let train = match data.rows {
            Some(rows) => Some(scores(&model, rows, progress)?.ok_or_else(|| too_short(rows))?),
            None => None,
        };
        let test = match data.kept.filter(|_| self.options.test_share > 0.0) {
            Some(kept) => scores(&model, kept, progress)?,
            None => None,
        };
        let scan = chosen.regions.as_ref().unwrap_or(&chosen.whole);
        let partition = partition.partition.as_ref();
        let regions = regions(&chosen, &model, scan, partition, &mut summary.notes);
        let decimate = self.options.decimate;
        let mut files = None;
        if !self.free_run.is_empty() {
            let dataset = Dataset::for_every_row(&model, data.recipe, &self.free_run, decimate, progress)?;
            let runs = free_runs_by_file(&model, &dataset, decimate, progress)?;
            if runs.files.is_empty() {
                return Err(too_short(&dataset.view()?));
            }
            files = Some(runs);
            let known = dataset.in_sample(&model);
            if !known.is_empty() {
                summary.notes.push(format!("{} of the files to run on trained the model", known.join(", ")));
            }
        }
        if decimate > 1 {
            summary.notes.push(format!(
                "the model was fitted to every {decimate}th row: its step is {} s; run it only on logs of that rate",
                model.step
            ));
        }
        let mut record = chosen.record;
        // Reported held-out errors are those of the written model; the one-step model is another.
        if summary.refinement.as_ref().is_some_and(|refinement| refinement.written) {
            record.held_out = None;
        }
        if let Some(held_out) = &record.held_out {
            let outputs: Vec<String> = chosen.task.fitted.iter().map(|equation| equation.label.clone()).collect();
            let share = (outputs.join(", "), held_out.rrse * held_out.rrse);
            summary.verdict = verdict("simulated", [share.clone()], None);
            summary.notes.extend(no_better("simulated", [share]));
        }
        let report = NarxReport {
            rows: chosen.whole.counts().complete,
            order: chosen.order,
            direct: chosen.order.direct,
            candidates: chosen.candidates,
            partition: partition.map_or_else(|| "average".into(), |partition| partition.specification.clone()),
            choice: record.text,
            linear: super::report::linear(record.held_out.as_ref(), &record.tried),
            held_out: record.held_out,
            search: record.search,
            tried: record.tried,
            orders: record.orders,
            regions,
            train,
            test,
            files,
            summary,
        };
        Ok(Fitted { value: None, model, rivals, report })
    }
}

fn too_short(source: &dyn Source) -> Error {
    let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    Error::too_few_rows(
        longest as u64,
        longest as u64 + 1,
        format!(
            "no episode is long enough to run the model on: the longest has {longest} rows; give longer ones, fewer lags, or a smaller {DECIMATE}"
        ),
    )
}

impl Fit<'_> {
    fn find(&self, notes: &mut Vec<String>, progress: &dyn Progress) -> Result<Solution, Error> {
        let mut partitions = self.partitions(notes, progress)?;
        let chosen = self.choose(&partitions, progress)?;
        notes.extend(start_note(&self.options.partitions, &partitions[chosen.partition]));
        let rivals = chosen.rivals.iter().map(|(coefficients, partition)| Rival {
            name: format!("coefficients{coefficients}"),
            model: self.model_of(partition, &partitions[partition.partition]),
        });
        let rivals = rivals.collect();
        let partition = partitions.swap_remove(chosen.partition);
        if let Some(specification) = &partition.partition {
            let scan = chosen.regions.as_ref().unwrap_or(&chosen.whole);
            notes.extend(in_no_region(&specification.specification, scan, chosen.whole.counts().complete));
        }
        let provenance = self.provenance(partition.partition.as_ref(), partition.seed);
        let model = self.model_of(&chosen, &partition);
        Ok(Solution { chosen, partition, model, rivals, provenance })
    }

    fn model_of(&self, chosen: &Chosen, partition: &Choice) -> Model {
        let coefficients = coefficients(&chosen.terms, chosen.task.candidates());
        let provenance = self.provenance(partition.partition.as_ref(), partition.seed);
        chosen.model(partition, &coefficients, provenance)
    }
}

impl Chosen {
    /// The model with these coefficients, region by region (candidates x equations).
    fn model(&self, partition: &Choice, coefficients: &[Mat<f64>], provenance: Provenance) -> Model {
        let scan = self.regions.as_ref().unwrap_or(&self.whole);
        self.task.model(scan, partition.partition.as_ref(), coefficients, provenance)
    }

    fn labels(&self) -> impl Iterator<Item = String> {
        self.task.fitted.iter().map(|equation| equation.label.clone())
    }
}

/// The equations of every region, for people.
fn regions(
    chosen: &Chosen,
    model: &Model,
    scan: &SystemScan,
    partition: Option<&Partition>,
    notes: &mut Vec<String>,
) -> Vec<NarxRegion> {
    let labels = || chosen.task.fitted.iter().map(|equation| &equation.label);
    let region = |(region, equations): (usize, &Vec<EquationTerms>)| NarxRegion {
        name: partition.map_or_else(|| "all".into(), |partition| partition.region_name(region)),
        rows: scan.rows(region),
        shared: equations.iter().any(|equation| equation.shared),
        equations: labels()
            .zip(equations)
            .enumerate()
            .map(|(target, (label, terms))| equation(chosen, model, [region, target], label, terms))
            .collect(),
    };
    let regions: Vec<NarxRegion> = chosen.terms.iter().enumerate().map(region).collect();
    let shared: Vec<&str> = regions.iter().filter(|r| r.shared).map(|r| r.name.as_str()).collect();
    if !shared.is_empty() {
        notes
            .push(format!("too few rows for separate terms: regions {} have the terms of all rows", shared.join(", ")));
    }
    regions
}

/// The report of an equation, with its terms in the model.
fn equation(
    chosen: &Chosen,
    model: &Model,
    [region, target]: [usize; 2],
    label: &str,
    equation_terms: &EquationTerms,
) -> NarxEquation {
    let in_model = Coefficients::new(&chosen.task, model, target);
    let term = |&(j, coefficient, err): &(usize, f64, f64)| NarxTerm {
        coefficient: in_model.of(region, j).unwrap_or(coefficient),
        function: chosen.task.candidate(j),
        err,
    };
    NarxEquation { label: label.to_owned(), terms: equation_terms.terms.iter().map(term).collect() }
}
