//! The pipeline: rows, partitions, choice, terms, model, scores.

use faer::Mat;
use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_model::{Model, Partition};
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_sums::system::SystemScan;
use fleetfoot_task::EquationTask;

use super::{
    FileRuns, NarxEquation, NarxOptions, NarxRegion, NarxReport, NarxTerm, OrderRule,
    choice::Choice,
    choose::Chosen,
    partitions::start_note,
    runs::free_runs_by_file,
    scores::scores,
    summed::{Evidence, Sums, by_single_steps},
    task::{NarxBase, one_row_ahead},
    terms::{EquationTerms, coefficients},
    training::Fit,
};
use crate::{
    concentration,
    error::Error,
    folds::smoothed_rows,
    incomplete::{in_no_region, incomplete_rows},
    model_file::refuse_not_finite,
    not_finite, objective,
    objective::{Refinement, coefficient, refine},
    sindy::{beneath, coefficients_of},
    spans::Spans,
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

/// Fits an autoregression to files: one scan for all orders, one more a partition, and simulations. To their statistic: no pass, and no simulation of what
/// trained.
///
/// # Errors
/// Those of the recipe, of reading and of partitions; too few rows, and no row to start a simulation from; of a statistic a question that needs rows, and
/// candidates or regions that were not summed.
pub fn fit_narx(
    recipe: &Recipe,
    request: &NarxRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<NarxFitted, Error> {
    let logs = &logs.into();
    let options = NarxOptions::new(recipe)?;
    let (model, mut report) = match logs.is_statistic() {
        true => of_sums(recipe, logs, progress)?,
        false => of_rows(recipe, options.clone(), logs, progress)?,
    };
    // That of a statistic stands beneath what was said.
    let scanned = logs.is_statistic().then(|| Recipe::parse(&model.training.recipe, "the recipe of the model"));
    let whole = scanned.transpose()?.map(|whole| Recipe { cache: recipe.cache.clone(), ..whole });
    let recipe = whole.as_ref().unwrap_or(recipe);
    if !request.free_run.is_empty() {
        let dataset = Dataset::for_every_row(&model, recipe, &request.free_run, options.decimate, progress)?;
        report.files = Some(files(&model, &dataset, options.decimate, progress)?);
        let known = dataset.in_sample(&model);
        if !known.is_empty() {
            report.notes.push(format!("{} of the files to run on trained the model", known.join(", ")));
        }
    }
    if options.decimate > 1 {
        report.notes.push(format!(
            "the model knows every {}th row: its step is {} s; run it on logs of that rate only",
            options.decimate, model.step
        ));
    }
    Ok(NarxFitted { model, report })
}

fn of_rows(
    recipe: &Recipe,
    mut options: NarxOptions,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<(Model, NarxReport), Error> {
    let prepared = one_row_ahead(recipe, &options)?;
    let (dataset, task) = Dataset::for_equations(&prepared, logs, progress)?;
    let base = NarxBase::new(task, recipe)?;
    let view = dataset.view()?;
    let tested = |rows: usize| (rows as f64 * options.test_share).round() as usize;
    let apart = smoothed_rows(options.smoothed, dataset.step());
    let (train, test) = Spans::split(&view, tested, options.decimate, apart)?;
    let step = dataset.step() * options.decimate as f64;
    options.order = base.simulated(options.order, step)?;
    let fit = Fit { recipe, options: &options, base: &base, evidence: Evidence::Rows(&train), step };
    let found = fit.run(progress);
    let functions = || base.row_functions();
    let (model, mut report) = found.map_err(|error| not_finite::with_reasons(error, &dataset, functions()))?;
    refuse_not_finite(&model)?;
    report.notes.splice(0..0, dataset.notes().iter().cloned());
    report.notes.extend(incomplete_rows(report.left_out[1], &dataset, functions())?);
    progress.stage("scores");
    if options.test_share > 0.0 {
        report.test = scores(&model, &test, progress)?;
    }
    Ok((model, report))
}

/// The same from the sums of a statistic, whose recipe stands beneath.
fn of_sums(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Model, NarxReport), Error> {
    let file = logs.statistic()?;
    let mut notes = Vec::new();
    let scanned = Recipe::parse(&file.recipe, "the recipe of the statistic")?;
    let recipe = beneath(recipe, &scanned)?;
    let recipe = by_single_steps(&recipe, &mut notes)?.into_owned();
    let mut options = NarxOptions::new(&recipe)?;
    objective::refuse_statistic(options.objective)?;
    let expanded = recipe.expand(&file.fields)?;
    let task = EquationTask::resolve(&one_row_ahead(&expanded, &options)?, &file.fields)?;
    let base = NarxBase::new(task, &expanded)?;
    options.order = base.simulated(options.order, file.step())?;
    let sums = Sums::new(&file, &scanned, &options)?;
    let fit =
        Fit { recipe: &recipe, options: &options, base: &base, evidence: Evidence::Sums(&sums), step: file.step() };
    let (model, mut report) = fit.run(progress)?;
    refuse_not_finite(&model)?;
    notes.push(
        "errors of free runs need rows, which a statistic has not: `fleetfoot rollout` and --free-run FILE tell them on logs".into(),
    );
    report.notes.splice(0..0, notes);
    Ok((model, report))
}

fn too_short(source: &dyn Source) -> Error {
    let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    Error::too_few_rows(
        longest as u64,
        longest as u64 + 1,
        format!(
            "no episode is long enough to run the model on: the longest has {longest} rows; give longer ones, fewer lags, or a smaller --decimate"
        ),
    )
}

/// Free runs of other files, one by one.
fn files(model: &Model, dataset: &Dataset, every: usize, progress: &dyn Progress) -> Result<FileRuns, Error> {
    let runs = free_runs_by_file(model, dataset, every, progress)?;
    if runs.files.is_empty() {
        return Err(too_short(&dataset.view()?));
    }
    Ok(runs)
}

impl Fit<'_> {
    fn run(&self, progress: &dyn Progress) -> Result<(Model, NarxReport), Error> {
        let mut notes = Vec::new();
        let partitions = self.partitions(&mut notes, progress)?;
        let chosen = self.choose(&partitions, progress)?;
        notes.extend(start_note(&self.options.partitions, &partitions[chosen.partition]));
        let Choice { partition, seed, .. } = &partitions[chosen.partition];
        let partition = partition.as_ref();
        let scan = chosen.regions.as_ref().unwrap_or(&chosen.whole);
        let coefficients = coefficients(&chosen.terms, chosen.task.candidates());
        let model_of = |coefficients: &[Mat<f64>]| {
            chosen.task.model(scan, partition, coefficients, self.provenance(partition, *seed))
        };
        let mut model = model_of(&coefficients);
        let refinement = self.refined(&model, &chosen, progress)?;
        notes.extend(objective::note(self.options.objective, refinement.as_ref()));
        if let Some(found) = refinement.as_ref().filter(|found| found.written) {
            model = model_of(&coefficients_of(&found.fitted.model, &chosen.task, coefficients.len()));
        }
        progress.stage("scores");
        let train = match self.evidence {
            Evidence::Rows(source) => Some(scores(&model, source, progress)?.ok_or_else(|| too_short(source))?),
            Evidence::Sums(_) => None,
        };
        let labels = chosen.task.fitted.iter().map(|equation| equation.label.clone());
        let known = self.evidence.episodes();
        let name = |id: EpisodeId| {
            let name = known.iter().find(|own| own.id == id.to_string())?.name.clone();
            Some(match self.options.decimate {
                0 | 1 => name,
                every => format!("every {every}th row of {name}"),
            })
        };
        notes.extend(concentration::notes(labels.zip(chosen.whole.concentrated().iter().map(Option::as_ref)), name));
        let counts = chosen.whole.counts();
        if let Some(partition) = partition {
            notes.extend(in_no_region(&partition.specification, scan, counts.complete));
        }
        let regions = regions(&chosen, &model, scan, partition, &mut notes);
        let how = chosen.how;
        let report = NarxReport {
            rows: counts.complete,
            episodes: self.evidence.episodes().len(),
            left_out: [counts.at_border, counts.incomplete],
            order: chosen.order,
            direct: chosen.order.direct,
            candidates: chosen.candidates,
            partition: partition.map_or_else(|| "average".into(), |partition| partition.specification.clone()),
            choice: how.text,
            held_out: how.held_out,
            search: how.search,
            tried: how.tried,
            orders: how.orders,
            regions,
            refinement,
            train,
            test: None,
            files: None,
            notes,
        };
        Ok((model, report))
    }

    /// Fits the model to simulations where that is the objective; on the training rows of a fold terms are chosen anew, in the order that was found.
    fn refined(&self, model: &Model, chosen: &Chosen, progress: &dyn Progress) -> Result<Option<Refinement>, Error> {
        let order = OrderRule::Fixed(chosen.order);
        let options = NarxOptions { order, objective: Objective::OneStep, ..self.options.clone() };
        let Evidence::Rows(source) = self.evidence else { return Ok(None) };
        refine(self.options.objective, &(model.clone(), None), (source, self.smoothed()), progress, |source| {
            Ok((Fit { evidence: Evidence::Rows(source), options: &options, ..*self }.run(progress)?.0, None))
        })
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
            .map(|(target, (label, own))| equation(chosen, model, [region, target], label, own))
            .collect(),
    };
    let regions: Vec<NarxRegion> = chosen.terms.iter().enumerate().map(region).collect();
    let shared: Vec<&str> = regions.iter().filter(|r| r.shared).map(|r| r.name.as_str()).collect();
    if !shared.is_empty() {
        notes
            .push(format!("too few rows for terms of their own: regions {} have those of all rows", shared.join(", ")));
    }
    regions
}

/// The terms of an equation, and what the model has for them.
fn equation(
    chosen: &Chosen,
    model: &Model,
    [region, target]: [usize; 2],
    label: &str,
    own: &EquationTerms,
) -> NarxEquation {
    let latent = &chosen.task.fitted[target].latent;
    let term = |&(j, found, err): &(usize, f64, f64)| {
        let function = chosen.task.candidate(j);
        NarxTerm { coefficient: coefficient(model, latent, region, &function).unwrap_or(found), function, err }
    };
    NarxEquation { label: label.to_owned(), terms: own.terms.iter().map(term).collect() }
}
