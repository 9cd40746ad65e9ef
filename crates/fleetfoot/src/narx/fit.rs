//! The pipeline: rows, partitions, choice, terms, model, scores.

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{FreeRunOptions, ScoreOptions, free_run, score};
use fleetfoot_model::{Model, Partition};
use fleetfoot_pwa::{Problem, Specification};
use fleetfoot_sparse::{
    Criterion as By, CriterionOptions, FrolsChoice, NarxFold, NarxOrder, OrderChoice, OrderOptions, OrderSearch,
    System, SystemPlan, SystemScan, search_orders,
};

use super::{
    NarxCandidate, NarxEquation, NarxOptions, NarxRegion, NarxReport, NarxScores, NarxSelection, NarxTerm, TermRule,
    select::{Choice, Selection, best},
    spans::Spans,
    task::{NarxTask, one_row_ahead},
    terms::{EquationTerms, Problems, Trails, choice},
};
use crate::{
    Criterion, Dataset, Error, Logs, Provenance, Recipe, left_out::left_out, not_finite, output::refuse_not_finite,
};

/// What is asked of a fit beside the recipe.
#[derive(Debug, Clone, Default)]
pub struct NarxRequest {
    /// Files to run the model on that did not train it.
    pub free_run: Logs,
}

/// An autoregression and what it is worth.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct NarxFitted {
    /// The model.
    pub model: Model,
    /// What was found.
    pub report: NarxReport,
}

/// Fits an autoregression to files: one scan for all orders, one more a partition, and simulations.
///
/// # Errors
/// Those of the recipe, of reading and of partitions; too few rows, and no row to start a simulation from.
pub fn fit_narx(
    recipe: &Recipe,
    request: &NarxRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<NarxFitted, Error> {
    let options = NarxOptions::new(recipe)?;
    let prepared = one_row_ahead(recipe, &options)?;
    let (dataset, task) = Dataset::for_equations(&prepared, logs, progress)?;
    let narx = NarxTask::new(task, recipe, &options)?;
    let view = dataset.view()?;
    let tested = |rows: usize| (rows as f64 * options.test_share).round() as usize;
    let (train, test) = Spans::split(&view, tested, options.decimate)?;
    let step = dataset.step() * options.decimate as f64;
    let fit = Fit { recipe, options: &options, narx: &narx, source: &train, step };
    let found = fit.run(progress);
    let functions = || narx.task.row_functions();
    let (model, mut report) = found.map_err(|error| not_finite::with_reasons(error, &dataset, functions()))?;
    refuse_not_finite(&model)?;
    report.notes.splice(0..0, dataset.notes().iter().cloned());
    report.notes.extend(left_out(report.left_out[1], &dataset, functions())?);
    progress.stage("scores");
    if options.test_share > 0.0 {
        report.test = scores(&model, &test, progress)?;
    }
    if !request.free_run.is_empty() {
        let dataset = Dataset::for_every_row(&model, recipe, &request.free_run, options.decimate, progress)?;
        let view = dataset.view()?;
        let (rows, _) = Spans::split(&view, |_| 0, options.decimate)?;
        report.files = Some(scores(&model, &rows, progress)?.ok_or_else(|| too_short(&rows))?);
        let known = dataset.in_sample(&model);
        if !known.is_empty() {
            report.notes.push(format!("{} of the files to run on trained the model", known.join(", ")));
        }
    }
    if options.decimate > 1 {
        report.notes.push(format!(
            "the model knows every {}th row: its step is {step} s; run it on logs of that rate only",
            options.decimate
        ));
    }
    Ok(NarxFitted { model, report })
}

fn too_short(source: &dyn Source) -> Error {
    let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    Error::Request(format!(
        "no episode is long enough to run the model on: the longest has {longest} rows; give longer ones, fewer lags, or a smaller --decimate"
    ))
}

/// One-step and free-run scores; `None` where no row can be scored.
fn scores(model: &Model, source: &dyn Source, progress: &dyn Progress) -> Result<Option<NarxScores>, Error> {
    let free_run = match free_run(model, source, &FreeRunOptions::default(), progress) {
        Ok(found) => found,
        Err(fleetfoot_dynamics::Error::NoCompleteRow { .. }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let one_step = score(model, source, &ScoreOptions::default(), progress)?;
    Ok((one_step.rows > 0).then_some(NarxScores { one_step, free_run }))
}

/// A partition, an order, a number of terms: what was chosen.
struct Chosen {
    partition: usize,
    order: NarxOrder,
    /// `None`: by the criterion in every region.
    terms: Option<usize>,
    text: Option<String>,
    tried: Vec<NarxCandidate>,
    orders: Option<OrderSearch>,
}

struct Fit<'a> {
    recipe: &'a Recipe,
    options: &'a NarxOptions,
    narx: &'a NarxTask,
    source: &'a dyn Source,
    step: f64,
}

impl Fit<'_> {
    fn run(&self, progress: &dyn Progress) -> Result<(Model, NarxReport), Error> {
        let mut notes = Vec::new();
        let partitions = self.partitions(&mut notes, progress)?;
        let whole = self.scan(None, progress)?;
        self.check(&whole)?;
        let orders = if self.options.search { self.narx.library.orders() } else { vec![self.options.order] };
        let chosen = self.choose(&whole, &partitions, &orders, progress)?;
        let Choice { partition, seed } = &partitions[chosen.partition];
        let partition = partition.as_ref();
        let regions = partition.map(|partition| self.scan(Some(partition), progress)).transpose()?;
        let columns = self.narx.library.columns(chosen.order);
        let rule = match (self.options.terms, chosen.terms) {
            (TermRule::Auto(_), Some(count)) => TermRule::Count(count),
            (rule, _) => rule,
        };
        let by = match self.options.selection {
            NarxSelection::FreeRun => FrolsChoice::Last,
            NarxSelection::OneStep(criterion) => choice(criterion),
        };
        let trails = Trails::new(&Problems::all(&whole, regions.as_ref()), columns.clone(), rule, by)?;
        let terms = trails.terms(chosen.terms);
        let coefficients: Vec<Mat<f64>> = trails.coefficients(&terms);
        let scan = regions.as_ref().unwrap_or(&whole);
        let model = self.narx.task.model(scan, partition, &coefficients, self.provenance(partition, *seed));
        progress.stage("scores");
        let train = scores(&model, self.source, progress)?.ok_or_else(|| too_short(self.source))?;
        let counts = whole.counts();
        let report = NarxReport {
            rows: counts.complete,
            episodes: self.source.episodes().len(),
            left_out: [counts.at_border, counts.incomplete],
            order: chosen.order,
            direct: self.options.direct,
            candidates: columns.len(),
            partition: partition.map_or_else(|| "average".into(), |partition| partition.specification.clone()),
            choice: chosen.text,
            tried: chosen.tried,
            orders: chosen.orders,
            regions: self.regions(scan, partition, &terms, &mut notes),
            train,
            test: None,
            files: None,
            notes,
        };
        Ok((model, report))
    }

    fn scan(&self, partition: Option<&Partition>, progress: &dyn Progress) -> Result<SystemScan, Error> {
        progress.stage("scan");
        let system = System { partition: partition.cloned(), ..self.narx.task.system() };
        Ok(SystemPlan::new(system, None, self.source)?.scan(self.source, progress)?)
    }

    fn check(&self, whole: &SystemScan) -> Result<(), Error> {
        let counts = whole.counts();
        let needed = match self.options.terms {
            TermRule::All => self.narx.task.candidates(),
            TermRule::Count(count) => count,
            TermRule::Auto(_) => 1,
        };
        if counts.complete as usize > needed {
            return Ok(());
        }
        Err(Error::Request(format!(
            "{} rows have all lags ({} lack them at the border of their episode, {} miss a value), an equation has {needed} terms; give longer episodes, fewer lags \
             or fewer terms",
            counts.complete, counts.at_border, counts.incomplete
        )))
    }

    /// The partitions asked for, on all rows that train; those that cluster once a start.
    fn partitions(&self, notes: &mut Vec<String>, progress: &dyn Progress) -> Result<Vec<Choice>, Error> {
        if self.options.partitions == [Specification::Average] {
            return Ok(vec![Choice { partition: None, seed: self.options.seed }]);
        }
        let task = &self.narx.task;
        let problem = Problem {
            columns: task.columns.clone(),
            library: task.functions.clone(),
            equations: task.equations.clone(),
            partition_columns: task.partition_columns.clone(),
            weight: task.weight.clone(),
            step: self.step,
        };
        let mut options = fleetfoot_pwa::Options::default();
        options.partitions.clone_from(&self.options.partitions);
        let mut choices = Vec::new();
        for start in 0..self.options.starts as u64 {
            options.seed = self.options.seed.wrapping_add(start);
            if start > 0 {
                // Only what is clustered depends on the seed.
                options.partitions.retain(|specification| specification.clusters().is_some());
            }
            if options.partitions.is_empty() {
                break;
            }
            let found = fleetfoot_pwa::partition(&problem, &options, self.source, progress)?;
            let new = found.notes.into_iter().filter(|note| !notes.contains(note)).collect::<Vec<_>>();
            notes.extend(new);
            choices.extend(found.partitions.into_iter().map(|(specification, partition)| Choice {
                partition: (specification != Specification::Average).then_some(partition),
                seed: options.seed,
            }));
        }
        Ok(choices)
    }

    fn choose(
        &self,
        whole: &SystemScan,
        partitions: &[Choice],
        orders: &[NarxOrder],
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let given = match self.options.terms {
            TermRule::Count(count) => Some(count),
            TermRule::All => Some(usize::MAX),
            TermRule::Auto(_) => None,
        };
        let mut chosen =
            Chosen { partition: 0, order: orders[0], terms: given, text: None, tried: Vec::new(), orders: None };
        if orders.len() * partitions.len() == 1 && given.is_some() {
            return Ok(chosen);
        }
        let NarxSelection::OneStep(criterion) = self.options.selection else {
            let selection = Selection { narx: self.narx, options: self.options, source: self.source, step: self.step };
            chosen.tried = selection.run(partitions, orders, progress)?;
            let Some(best) = best(&chosen.tried) else {
                return Err(Error::Request(format!(
                    "none of {} models can be simulated through the spans that did not train: all diverge; choose by --select bic, or try other lags and fewer terms",
                    chosen.tried.len()
                )));
            };
            (chosen.partition, chosen.order) = (best.partition, best.order);
            chosen.terms = given.or(Some(best.terms));
            chosen.text = Some(format!(
                "the least error of free runs of {} spans that did not train, of {} models",
                self.options.folds,
                chosen.tried.len()
            ));
            return Ok(chosen);
        };
        let search = self.by_one_step(whole, orders, criterion, progress)?;
        let best = search.choice();
        chosen.order = best.order;
        let held_out = matches!(criterion, Criterion::CrossValidation | Criterion::OneStandardError);
        chosen.terms = given.or_else(|| held_out.then(|| best.terms.iter().copied().max().unwrap_or(1)));
        chosen.text = Some(match criterion {
            Criterion::Aic => "AIC of one-step errors".into(),
            Criterion::Bic => "BIC of one-step errors".into(),
            Criterion::Ebic => "EBIC of one-step errors".into(),
            Criterion::CrossValidation => format!("the least one-step error of {} held-out spans", self.options.folds),
            Criterion::OneStandardError => {
                format!(
                    "fewest terms within one standard error of the least one-step error of {} held-out spans",
                    self.options.folds
                )
            }
        });
        chosen.orders = Some(search);
        Ok(chosen)
    }

    /// Orders compared on the statistic.
    fn by_one_step(
        &self,
        whole: &SystemScan,
        orders: &[NarxOrder],
        criterion: Criterion,
        progress: &dyn Progress,
    ) -> Result<OrderSearch, Error> {
        let by = |criterion| OrderChoice::Criterion(criterion, CriterionOptions::default());
        let choice = match criterion {
            Criterion::Aic => by(By::Aic),
            Criterion::Bic => by(By::Bic),
            Criterion::Ebic => by(By::Ebic),
            Criterion::CrossValidation => OrderChoice::CrossValidation { one_standard_error: false },
            Criterion::OneStandardError => OrderChoice::CrossValidation { one_standard_error: true },
        };
        let folds = match choice {
            OrderChoice::CrossValidation { .. } => self.folds(progress)?,
            _ => Vec::new(),
        };
        let max_terms = match self.options.terms {
            TermRule::All => None,
            TermRule::Count(most) | TermRule::Auto(most) => Some(most),
        };
        let mut options = OrderOptions::default();
        (options.max_terms, options.choice) = (max_terms, choice);
        let problem = whole.root(0).compressed(true);
        Ok(search_orders(&problem, &self.narx.library, orders, &folds, &options, progress)?)
    }

    fn folds(&self, progress: &dyn Progress) -> Result<Vec<NarxFold>, Error> {
        let (cut, folds) = Spans::folds(self.source, self.options.folds)?;
        let scan = SystemPlan::new(self.narx.task.system(), None, &cut)?.scan(&cut, progress)?;
        let fold_of = |unit: usize| {
            let episode = cut.episodes().iter().position(|episode| episode.id == scan.units()[unit].episode);
            episode.map(|episode| folds[episode])
        };
        let weights = |own: bool| {
            let weight = |unit: usize, fold: usize| f64::from((fold_of(unit) == Some(fold)) == own);
            Mat::from_fn(scan.units().len(), self.options.folds, weight)
        };
        let problems = |own| scan.roots(0, weights(own).as_ref()).into_iter().map(|root| root.compressed(true));
        let both = problems(false).zip(problems(true));
        let filled = both.filter(|(train, test)| train.weight > 0.0 && test.weight > 0.0);
        Ok(filled.map(|(train, test)| NarxFold { train, test }).collect())
    }

    fn provenance(&self, partition: Option<&Partition>, seed: u64) -> Provenance {
        let regions = partition.map_or_else(String::new, |partition| format!(" {}", partition.specification));
        Provenance {
            method: format!("narx{regions}"),
            recipe: self.recipe.to_toml(),
            seed,
            step: self.step,
            episodes: self.source.episodes().iter().map(|e| (e.id.to_string(), e.name.clone())).collect(),
        }
    }

    fn regions(
        &self,
        scan: &SystemScan,
        partition: Option<&Partition>,
        terms: &[Vec<EquationTerms>],
        notes: &mut Vec<String>,
    ) -> Vec<NarxRegion> {
        let regions: Vec<NarxRegion> = terms
            .iter()
            .enumerate()
            .map(|(region, equations)| NarxRegion {
                name: partition.map_or_else(|| "all".into(), |partition| partition.region_name(region)),
                rows: scan.rows(region),
                shared: equations.iter().any(|equation| equation.shared),
                equations: self
                    .narx
                    .task
                    .fitted
                    .iter()
                    .zip(equations)
                    .map(|(e, own)| self.equation(&e.label, own))
                    .collect(),
            })
            .collect();
        let shared: Vec<&str> = regions.iter().filter(|r| r.shared).map(|r| r.name.as_str()).collect();
        if !shared.is_empty() {
            notes.push(format!(
                "too few rows for terms of their own: regions {} have those of all rows",
                shared.join(", ")
            ));
        }
        regions
    }

    fn equation(&self, label: &str, own: &EquationTerms) -> NarxEquation {
        let term = |&(j, coefficient, err): &(usize, f64, f64)| NarxTerm {
            function: self.narx.task.candidate(j),
            coefficient,
            err,
        };
        NarxEquation { label: label.to_owned(), terms: own.terms.iter().map(term).collect() }
    }
}
