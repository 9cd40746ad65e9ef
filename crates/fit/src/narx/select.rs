//! Choice of partition, order and number of terms by simulations of rows that did not train.
//!
//! One-step errors flatter an autoregression: the outputs hardly move within a row. Its quality shows when it feeds on
//! its own predictions.

use std::{borrow::Cow, collections::BTreeMap, ops::Range, sync::Arc};

use faer::Mat;
use fleetfoot_data::{EpisodeId, Progress, Silent, Stages, parallel_map};
use fleetfoot_dynamics::{Error as RunError, FreeRunOptions, free_run};
use fleetfoot_model::Partition;
use fleetfoot_sparse::{inference::system_effective_rows, narx::NarxOrder, threshold::FrolsChoice};
use fleetfoot_stats::{aic, bic};
use fleetfoot_sums::system::{System, SystemPlan, SystemScan};
use fleetfoot_task::Provenance;

use super::{
    TermRule,
    candidate::NarxCandidate,
    choice::Choice,
    runs::mean_of_moving,
    task::{NarxBase, NarxTask},
    terms::{Problems, Support, Trails, coefficients},
};
use crate::{error::Error, spans::Spans};

/// Errors by which models are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum By {
    /// Simulations, of models of one scan after another.
    Search,
    /// Simulations of models of one scan, which have information criteria of the same rows.
    Simulations,
    /// One-step errors of models of one scan.
    OneStep,
}

/// An order to try.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Job {
    pub(crate) order: NarxOrder,
    /// Number of terms.
    pub(crate) terms: TermRule,
}

impl Job {
    /// Numbers of terms of an order with `candidates` candidates.
    pub(crate) fn counts(&self, candidates: usize) -> Vec<usize> {
        match self.terms {
            TermRule::All => vec![candidates],
            TermRule::Count(count) => vec![count.min(candidates)],
            TermRule::Auto(most) => (1..=most.min(candidates)).collect(),
        }
    }
}

/// A tried model, with the settings to make it again.
#[derive(Debug, Clone)]
pub(crate) struct Tried {
    pub(crate) candidate: NarxCandidate,
    pub(crate) task: Arc<NarxTask>,
    /// Of every region (outer) and equation.
    pub(crate) supports: Vec<Vec<Support>>,
}

/// Everything that the candidates share.
pub(crate) struct Selection<'a> {
    pub(crate) base: &'a NarxBase,
    pub(crate) partitions: &'a [Choice],
    /// Of every partition whose regions fit the dynamics: those of the training rows of every fold. Empty for the others.
    pub(crate) anew: &'a [Vec<Partition>],
    /// The training rows, cut into spans.
    pub(crate) cut: &'a Spans<'a>,
    /// The spans of every fold.
    pub(crate) held: &'a [Spans<'a>],
    pub(crate) fold_of: &'a BTreeMap<EpisodeId, usize>,
    /// First rows of a span that are not scored, so that models with few lags and with many are compared on the same
    /// rows.
    pub(crate) first: usize,
    pub(crate) step: f64,
    pub(crate) by: By,
}

/// The statistics of one partition.
struct Sets<'a> {
    task: &'a NarxTask,
    /// Of the rows that train for every fold.
    folds: Vec<Training<'a>>,
    all: Problems,
}

/// The rows that train for a fold.
struct Training<'a> {
    partition: Option<&'a Partition>,
    scan: Cow<'a, SystemScan>,
    problems: Problems,
    /// Of the rows that the fold holds out, where one-step errors decide.
    testing: Option<Problems>,
}

impl Training<'_> {
    /// Returns true if the fold has regions made on its training rows instead of those of all rows.
    fn is_anew(&self) -> bool {
        matches!(self.scan, Cow::Owned(_))
    }
}

/// The terms of a model that is tried: how many of each equation, and which.
struct Wanted {
    count: usize,
    supports: Vec<Vec<Support>>,
}

/// Squared relative errors of every output over free runs; `None` where no run could begin.
type Squares = Option<Vec<f64>>;

/// Held-out error of a model on a fold.
#[derive(Debug, Clone)]
enum Held {
    Simulated(Squares),
    /// Squared one-step error over the variance; `None` where the fold has no rows.
    OneStep(Option<f64>),
}

/// Inputs of the information criteria: number of independent training rows, and the variance of every output.
struct Scale {
    independent: f64,
    variance: Vec<f64>,
}

impl Selection<'_> {
    /// Tries every order and number of terms with every partition. Terms are chosen on all spans; the spans of every
    /// fold are simulated by the same terms, refitted on the others. Regions that fit the dynamics are made anew on the
    /// other spans, and so many terms are chosen in each of them: otherwise the held-out rows would have shaped the
    /// regions. One scan of the union of all candidates serves every order. A partition takes one more, and so does a
    /// fold whose regions are made anew. Lags do not reach over the borders of spans.
    pub(crate) fn run(&self, jobs: &[Job], progress: &dyn Progress) -> Result<Vec<Tried>, Error> {
        if jobs.is_empty() {
            return Ok(Vec::new());
        }
        let orders: Vec<NarxOrder> = jobs.iter().map(|job| job.order).collect();
        let task = Arc::new(self.base.with(&orders)?);
        let whole = self.scan(&task, None, progress)?;
        let scale = (self.by != By::Search).then(|| scale(&whole)).transpose()?;
        let mut models = Vec::new();
        for (index, choice) in self.partitions.iter().enumerate() {
            let partition = choice.partition.as_ref();
            let regions = partition.map(|partition| self.scan(&task, Some(partition), progress)).transpose()?;
            let sets = self.sets(index, &task, (&whole, regions.as_ref()), progress)?;
            let what = if self.by == By::OneStep { "one-step errors" } else { "free runs" };
            progress.stage(&format!("{what} of {}", choice.specification));
            let wanted = parallel_map(jobs.len(), &Silent, |job| wanted(&sets, &jobs[job]))?;
            let count = self.held.len();
            let runs = parallel_map(jobs.len() * count, progress, |at| {
                let (job, fold) = (at / count, at % count);
                self.runs((&sets, scale.as_ref()), &jobs[job], &wanted[job], fold)
            })?;
            let criteria = parallel_map(jobs.len(), &Silent, |job| criteria(&sets, scale.as_ref(), &wanted[job]))?;
            for (((job, wanted), runs), criteria) in jobs.iter().zip(wanted).zip(runs.chunks(count)).zip(criteria) {
                models.extend(wanted.into_iter().zip(criteria).enumerate().map(
                    |(k, (Wanted { supports, .. }, criteria))| {
                        let folds: Vec<&Held> = runs.iter().map(|fold| &fold[k]).collect();
                        let candidate = candidate((index, choice), job.order, &supports, &folds, criteria);
                        Tried { candidate, task: Arc::clone(&task), supports }
                    },
                ));
            }
        }
        Ok(models)
    }

    /// Training statistics of a partition, from the scans of all rows with and without regions.
    fn sets<'s>(
        &'s self,
        index: usize,
        task: &'s NarxTask,
        (whole, regions): (&'s SystemScan, Option<&'s SystemScan>),
        progress: &dyn Progress,
    ) -> Result<Sets<'s>, Error> {
        let all = Problems::all(whole, regions);
        let partition = self.partitions[index].partition.as_ref();
        let anew = self.anew.get(index).filter(|anew| !anew.is_empty());
        let folds = match anew {
            None => {
                let all = 0..self.held.len();
                let of = |(problems, testing)| Training {
                    partition,
                    scan: Cow::Borrowed(regions.unwrap_or(whole)),
                    problems,
                    testing,
                };
                let training = self.problems(whole, regions, all.clone(), true);
                training.into_iter().zip(self.testing(whole, regions, all)).map(of).collect()
            }
            Some(anew) => {
                let of = |(fold, partition): (usize, &'s Partition)| {
                    let of_fold = Stages::fold(progress, fold, self.held.len());
                    let scan = self.scan(task, Some(partition), &of_fold)?;
                    let mut problems = self.problems(whole, Some(&scan), fold..fold + 1, true);
                    let testing = self.testing(whole, Some(&scan), fold..fold + 1).pop().flatten();
                    Ok(problems.pop().map(|problems| Training {
                        partition: Some(partition),
                        scan: Cow::Owned(scan),
                        problems,
                        testing,
                    }))
                };
                anew.iter().enumerate().map(of).filter_map(Result::transpose).collect::<Result<_, Error>>()?
            }
        };
        Ok(Sets { task, folds, all })
    }

    fn scan(
        &self,
        task: &NarxTask,
        partition: Option<&Partition>,
        progress: &dyn Progress,
    ) -> Result<SystemScan, Error> {
        let of = partition.map_or_else(String::new, |partition| format!(", {}", partition.specification));
        progress.stage(&format!("scan of {} candidates{of}", task.task.functions.len()));
        let system = System { partition: partition.cloned(), ..task.task.system() };
        Ok(SystemPlan::new(system, None, self.cut)?.scan(self.cut, progress)?)
    }

    /// The problems of the rows that train for some folds, or of those that they hold out.
    fn problems(
        &self,
        whole: &SystemScan,
        regions: Option<&SystemScan>,
        folds: Range<usize>,
        train: bool,
    ) -> Vec<Problems> {
        let weights = |scan: &SystemScan| {
            let fold = |unit: usize| self.fold_of.get(&scan.units()[unit].episode).copied();
            let held = |unit: usize, f: usize| fold(unit) == Some(folds.start + f);
            Mat::from_fn(scan.units().len(), folds.len(), |unit, f| f64::from(held(unit, f) != train))
        };
        Problems::sets(whole, regions, &weights)
    }

    /// The problems of the rows that some folds hold out, where one-step errors decide.
    fn testing(&self, whole: &SystemScan, regions: Option<&SystemScan>, folds: Range<usize>) -> Vec<Option<Problems>> {
        if self.by == By::OneStep {
            return self.problems(whole, regions, folds, false).into_iter().map(Some).collect();
        }
        folds.map(|_| None).collect()
    }

    /// Held-out errors on a fold of the models of the other spans, one for each wanted number of terms.
    fn runs(
        &self,
        (sets, scale): (&Sets<'_>, Option<&Scale>),
        job: &Job,
        wanted: &[Wanted],
        fold: usize,
    ) -> Result<Vec<Held>, Error> {
        let training = &sets.folds[fold];
        let anew = if training.is_anew() {
            let columns = sets.task.library.columns(job.order);
            Some(Trails::new(&training.problems, columns, job.terms, FrolsChoice::Last)?)
        } else {
            None
        };
        let of = |wanted: &Wanted| {
            let again = anew.as_ref().map(|trails| trails.supports(Some(wanted.count)));
            let supports = again.as_deref().unwrap_or(&wanted.supports);
            let terms = training.problems.refitted(supports)?;
            let coefficients = coefficients(&terms, sets.task.task.candidates());
            Ok(match (&training.testing, scale) {
                (Some(testing), Some(scale)) => Held::OneStep(testing.loss(&coefficients, &scale.variance)),
                _ => Held::Simulated(self.squares(sets, &coefficients, training, fold)?),
            })
        };
        wanted.iter().map(of).collect()
    }

    /// Free runs of the spans of a fold by a model of the others.
    fn squares(
        &self,
        sets: &Sets<'_>,
        coefficients: &[Mat<f64>],
        training: &Training<'_>,
        fold: usize,
    ) -> Result<Squares, Error> {
        let provenance = Provenance { step: self.step, ..Provenance::default() };
        let model = sets.task.task.trial(&training.scan, training.partition, coefficients, provenance);
        let mut options = FreeRunOptions::default();
        options.first = self.first;
        match free_run(&model, &self.held[fold], &options, &Silent) {
            Ok(run) => Ok(Some(run.outputs.iter().map(|output| output.errors.rrse.powi(2)).collect())),
            Err(RunError::NoCompleteRow { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

/// The terms of an order on all rows, by their number; a number that forward regression does not reach is left out.
fn wanted(sets: &Sets<'_>, job: &Job) -> Result<Vec<Wanted>, Error> {
    let columns = sets.task.library.columns(job.order);
    let counts = job.counts(columns.len());
    let trails = Trails::new(&sets.all, columns, job.terms, FrolsChoice::Last)?;
    let of = |count: usize| Wanted { count, supports: trails.supports(Some(count)) };
    let mut sizes: Vec<Wanted> = counts.into_iter().map(of).collect();
    sizes.dedup_by(|later, earlier| later.supports == earlier.supports);
    Ok(sizes)
}

/// The root mean square over the outputs that move; infinite where no run could begin, NaN where no output moves.
fn relative(squares: &Squares) -> f64 {
    let Some(outputs) = squares else { return f64::INFINITY };
    mean_of_moving(outputs.iter().copied()).sqrt()
}

/// Information criteria of a model on the statistic of all rows.
#[derive(Debug, Clone, Copy)]
struct Criteria {
    coefficients: usize,
    bic: Option<f64>,
    aic: Option<f64>,
}

/// Rows that count as independent, by the residuals of one region with all candidates, and the variance of every output.
fn scale(whole: &SystemScan) -> Result<Scale, Error> {
    let problem = whole.root(0).compressed(true);
    let all = Support { columns: (0..problem.columns()).collect(), shared: true };
    let supports = vec![vec![all; problem.targets()]];
    let constant = problem.select(&[0]);
    let variance = constant.residual.iter().map(|square| square / constant.weight).collect();
    let candidates = problem.columns();
    let terms = Problems { whole: problem, regions: Vec::new() }.refitted(&supports)?;
    let fitted = coefficients(&terms, candidates);
    let independent = fitted.first().map_or(1.0, |fit| system_effective_rows(whole, 0, true, fit.as_ref()));
    Ok(Scale { independent, variance })
}

/// Information criteria, on the statistic of all rows, of the models of an order.
fn criteria(sets: &Sets<'_>, scale: Option<&Scale>, wanted: &[Wanted]) -> Result<Vec<Criteria>, Error> {
    let of = |wanted: &Wanted| {
        let coefficients_of = count(&wanted.supports);
        let Some(scale) = scale else {
            return Ok(Criteria { coefficients: coefficients_of, bic: None, aic: None });
        };
        let terms = sets.all.refitted(&wanted.supports)?;
        let (error, weight) = sets.all.error(&coefficients(&terms, sets.task.task.candidates()));
        Ok(Criteria {
            coefficients: coefficients_of,
            bic: Some(bic(&error, weight, coefficients_of, scale.independent)),
            aic: Some(aic(&error, weight, coefficients_of, scale.independent)),
        })
    };
    wanted.iter().map(of).collect()
}

/// Coefficients of all regions and equations; those of all rows, which starved regions share, count once.
fn count(supports: &[Vec<Support>]) -> usize {
    let functions = supports
        .iter()
        .flatten()
        .filter(|functions| !functions.shared)
        .map(|functions| functions.columns.len())
        .sum::<usize>();
    let shared = supports.iter().filter(|equations| equations.iter().any(|equation| equation.shared));
    functions + shared.map(|equations| equations.iter().map(|equation| equation.columns.len()).sum()).max().unwrap_or(0)
}

fn candidate(
    (partition, choice): (usize, &Choice),
    order: NarxOrder,
    supports: &[Vec<Support>],
    folds: &[&Held],
    criteria: Criteria,
) -> NarxCandidate {
    let (mut simulated, mut losses) = (Vec::new(), Vec::new());
    for fold in folds {
        match fold {
            Held::Simulated(squares) => simulated.push(relative(squares)),
            Held::OneStep(loss) => losses.extend(loss),
        }
    }
    let mean = |folds: &[f64]| folds.iter().sum::<f64>() / folds.len() as f64;
    let rrse = mean_of_moving(simulated.iter().copied());
    NarxCandidate {
        partition,
        specification: choice.partition.as_ref().map_or_else(|| "average".into(), |p| p.specification.clone()),
        seed: choice.seed,
        regions: choice.partition.as_ref().map_or(1, |partition| partition.rule.count()),
        order,
        terms: supports.iter().flatten().map(|support| support.columns.len()).max().unwrap_or(0),
        rrse: if rrse.is_nan() && losses.is_empty() { f64::INFINITY } else { rrse },
        folds: simulated,
        coefficients: criteria.coefficients,
        loss: (!losses.is_empty()).then(|| mean(&losses)),
        losses,
        bic: criteria.bic,
        aic: criteria.aic,
        front: false,
        chosen: false,
    }
}

#[cfg(test)]
mod tests;
