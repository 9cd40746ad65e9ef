//! Choice of partition, order and number of terms by simulations of rows that did not train.
//!
//! One-step errors flatter an autoregression: the outputs hardly move within a row. What a model is for is seen when it feeds on its own answers.

use std::{collections::BTreeMap, sync::Arc};

use faer::Mat;
use fleetfoot_data::{EpisodeId, Progress, Silent, parallel_map};
use fleetfoot_dynamics::{Error as RunError, FreeRunOptions, free_run};
use fleetfoot_model::Partition;
use fleetfoot_sparse::{
    narx::NarxOrder,
    system::{System, SystemPlan, SystemScan},
    threshold::FrolsChoice,
};
use serde::Serialize;

use super::{
    TermRule,
    spans::Spans,
    task::{NarxBase, NarxTask},
    terms::{Problems, Support, Trails, coefficients},
};
use crate::{Error, Provenance, json};

/// A model that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NarxCandidate {
    /// Index among the partitions asked for.
    #[serde(skip)]
    pub partition: usize,
    /// The partition, as the user wrote it.
    #[serde(rename = "partition")]
    pub specification: String,
    /// Seed of its clustering.
    pub seed: u64,
    /// Its regions.
    #[serde(skip)]
    pub regions: usize,
    /// Lags and degree.
    #[serde(flatten, serialize_with = "json::tried_order")]
    pub order: NarxOrder,
    /// Most terms of an equation in a region.
    pub terms: usize,
    /// Root relative squared error of free runs of the spans that did not train, the mean of the folds: of these terms, refitted on the other spans. Infinite when
    /// one diverged.
    pub rrse: f64,
    /// That of every fold, the root mean square over the outputs: every fold counts as much, whatever its rows and how far its outputs move.
    pub folds: Vec<f64>,
}

/// A partition to choose from; `None`: one region.
pub(crate) struct Choice {
    pub(crate) partition: Option<Partition>,
    pub(crate) seed: u64,
}

/// Errors that differ by less are the same.
const SAME: f64 = 1e-3;
const ROUNDING: f64 = 1e-9;

/// The least error; of errors that are the same the model with the fewest terms, then the lowest order. `None` when all diverge.
pub(crate) fn best<'a>(tried: impl Iterator<Item = &'a NarxCandidate> + Clone) -> Option<usize> {
    simplest(tried, |_| 0.0)
}

/// The fewest terms within one standard error of the least error, then the lowest order: of hundreds of models that were looked at, the least error alone would take
/// one that suits these very spans. `None` when all diverge.
pub(crate) fn best_within_one_standard_error<'a>(
    tried: impl Iterator<Item = &'a NarxCandidate> + Clone,
) -> Option<usize> {
    simplest(tried, |least| {
        let count = least.folds.len() as f64;
        let scatter: f64 = least.folds.iter().map(|error| (error - least.rrse).powi(2)).sum();
        if count > 1.0 { (scatter / (count - 1.0) / count).sqrt() } else { 0.0 }
    })
}

/// The simplest of the models whose error is that of the best one, or larger by no more than what is allowed; of equally simple ones the best.
fn simplest<'a>(
    tried: impl Iterator<Item = &'a NarxCandidate> + Clone,
    allowed: impl Fn(&NarxCandidate) -> f64,
) -> Option<usize> {
    let finite = || tried.clone().enumerate().filter(|(_, candidate)| candidate.rrse.is_finite());
    let (_, least) = finite().min_by(|a, b| a.1.rrse.total_cmp(&b.1.rrse))?;
    let limit = least.rrse + (least.rrse * SAME + ROUNDING).max(allowed(least));
    let size =
        |c: &NarxCandidate| (c.regions * c.terms, c.order.degree, c.order.outputs + c.order.inputs, c.order.direct);
    let within = finite().filter(|(_, candidate)| candidate.rrse <= limit);
    let simpler = |a: &NarxCandidate, b: &NarxCandidate| size(a).cmp(&size(b)).then(a.rrse.total_cmp(&b.rrse));
    within.min_by(|a, b| simpler(a.1, b.1)).map(|(index, _)| index)
}

/// An order to try.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Job {
    pub(crate) order: NarxOrder,
    /// How many of its terms.
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

/// A model that was tried, with what it takes to make it again.
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
    /// The training rows, cut into spans.
    pub(crate) cut: &'a Spans<'a>,
    /// The spans of every fold.
    pub(crate) held: &'a [Spans<'a>],
    pub(crate) fold_of: &'a BTreeMap<EpisodeId, usize>,
    /// Rows of a span that nobody predicts, so that models with few lags and with many are compared on the same rows.
    pub(crate) first: usize,
    pub(crate) step: f64,
}

/// The statistics of one partition.
struct Sets<'a> {
    choice: &'a Choice,
    task: &'a NarxTask,
    scan: &'a SystemScan,
    folds: Vec<Problems>,
    all: Problems,
}

/// Squared relative errors of every output over free runs; `None` where no run could begin.
type Squares = Option<Vec<f64>>;

impl Selection<'_> {
    /// Tries every order and number of terms with every partition. Terms are chosen on all spans; the spans of every fold are simulated by the same terms, refitted on
    /// the others. One scan of the union of all candidates serves every order, and one a partition more; lags do not reach over the borders of spans.
    pub(crate) fn run(&self, jobs: &[Job], progress: &dyn Progress) -> Result<Vec<Tried>, Error> {
        if jobs.is_empty() {
            return Ok(Vec::new());
        }
        let orders: Vec<NarxOrder> = jobs.iter().map(|job| job.order).collect();
        let task = Arc::new(self.base.with(&orders)?);
        let whole = self.scan(&task, None, progress)?;
        let mut found = Vec::new();
        for (index, choice) in self.partitions.iter().enumerate() {
            let partition = choice.partition.as_ref();
            let regions = partition.map(|partition| self.scan(&task, Some(partition), progress)).transpose()?;
            let mut folds = self.training_sets(&whole, regions.as_ref());
            let Some(all) = folds.pop() else { continue };
            let sets = Sets { choice, task: &task, scan: regions.as_ref().unwrap_or(&whole), folds, all };
            progress.stage("free runs");
            let supports = parallel_map(jobs.len(), &Silent, |job| supports(&sets, &jobs[job]))?;
            let count = self.held.len();
            let runs = parallel_map(jobs.len() * count, progress, |at| {
                let (job, fold) = (at / count, at % count);
                supports[job].iter().map(|support| self.squares(&sets, support, fold)).collect::<Result<Vec<_>, _>>()
            })?;
            for ((job, supports), runs) in jobs.iter().zip(supports).zip(runs.chunks(count)) {
                found.extend(supports.into_iter().enumerate().map(|(k, supports)| {
                    let folds: Vec<&Squares> = runs.iter().map(|fold| &fold[k]).collect();
                    let candidate = candidate(index, choice, job.order, &supports, &folds);
                    Tried { candidate, task: Arc::clone(&task), supports }
                }));
            }
        }
        Ok(found)
    }

    fn scan(
        &self,
        task: &NarxTask,
        partition: Option<&Partition>,
        progress: &dyn Progress,
    ) -> Result<SystemScan, Error> {
        progress.stage("scan");
        let system = System { partition: partition.cloned(), ..task.task.system() };
        Ok(SystemPlan::new(system, None, self.cut)?.scan(self.cut, progress)?)
    }

    /// The problems of every fold's training rows, and of all rows behind them.
    fn training_sets(&self, whole: &SystemScan, regions: Option<&SystemScan>) -> Vec<Problems> {
        let weights = |scan: &SystemScan| {
            let fold = |unit: usize| self.fold_of.get(&scan.units()[unit].episode).copied();
            let trains = |unit: usize, f: usize| f == self.held.len() || fold(unit) != Some(f);
            Mat::from_fn(scan.units().len(), self.held.len() + 1, |unit, f| f64::from(trains(unit, f)))
        };
        Problems::sets(whole, regions, &weights)
    }

    /// Free runs of the spans of a fold by a model of the others with these terms.
    fn squares(&self, sets: &Sets<'_>, supports: &[Vec<Support>], fold: usize) -> Result<Squares, Error> {
        let terms = sets.folds[fold].refitted(supports)?;
        let coefficients = coefficients(&terms, sets.task.task.candidates());
        let provenance = Provenance { step: self.step, ..Provenance::default() };
        let model = sets.task.task.trial(sets.scan, sets.choice.partition.as_ref(), &coefficients, provenance);
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
fn supports(sets: &Sets<'_>, job: &Job) -> Result<Vec<Vec<Vec<Support>>>, Error> {
    let columns = sets.task.library.columns(job.order);
    let counts = job.counts(columns.len());
    let trails = Trails::new(&sets.all, columns, job.terms, FrolsChoice::Last)?;
    let mut found: Vec<Vec<Vec<Support>>> = counts.into_iter().map(|count| trails.supports(Some(count))).collect();
    found.dedup();
    Ok(found)
}

/// The root mean square over the outputs; infinite where no run could begin.
fn relative(squares: &Squares) -> f64 {
    let Some(outputs) = squares else { return f64::INFINITY };
    (outputs.iter().sum::<f64>() / outputs.len() as f64).sqrt()
}

fn candidate(
    partition: usize,
    choice: &Choice,
    order: NarxOrder,
    supports: &[Vec<Support>],
    folds: &[&Squares],
) -> NarxCandidate {
    let folds: Vec<f64> = folds.iter().map(|squares| relative(squares)).collect();
    let mean = folds.iter().sum::<f64>() / folds.len() as f64;
    NarxCandidate {
        partition,
        specification: choice.partition.as_ref().map_or_else(|| "average".into(), |p| p.specification.clone()),
        seed: choice.seed,
        regions: choice.partition.as_ref().map_or(1, |partition| partition.rule.count()),
        order,
        terms: supports.iter().flatten().map(|support| support.columns.len()).max().unwrap_or(0),
        rrse: if mean.is_nan() { f64::INFINITY } else { mean },
        folds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EquationTask, NarxOptions, Recipe, narx::task::one_row_ahead};
    use fleetfoot_data::{Column, MemorySource, Source, mix, with_threads};

    fn noise(seed: u64, row: u64) -> f64 {
        mix(mix(seed).wrapping_add(row)) as f64 / u64::MAX as f64 * 2.0 - 1.0
    }

    /// `y(k) = 0.7 y(k-1) + 0.5 u(k-1) + noise`.
    fn recording(rows: usize) -> (Vec<f64>, Vec<f64>) {
        let u: Vec<f64> = (0..rows as u64).map(|row| noise(1, row)).collect();
        let mut y = vec![0.2];
        for k in 1..rows {
            y.push(0.7 * y[k - 1] + 0.5 * u[k - 1] + 0.1 * noise(2, k as u64));
        }
        (y, u)
    }

    /// Least squares of two terms by the normal equations, on the rows of every span but one, and the free run through that one.
    fn by_hand(y: &[f64], u: &[f64], spans: &[std::ops::Range<usize>], held: usize) -> f64 {
        let (mut g, mut c) = ([0.0; 3], [0.0; 2]);
        for span in spans.iter().enumerate().filter(|(s, _)| *s != held).map(|(_, span)| span.clone()) {
            for k in span.start..span.end - 1 {
                g = [g[0] + y[k] * y[k], g[1] + y[k] * u[k], g[2] + u[k] * u[k]];
                c = [c[0] + y[k] * y[k + 1], c[1] + u[k] * y[k + 1]];
            }
        }
        let size = g[0] * g[2] - g[1] * g[1];
        let (a, b) = ((g[2] * c[0] - g[1] * c[1]) / size, (g[0] * c[1] - g[1] * c[0]) / size);
        let span = spans[held].clone();
        let measured = &y[span.start + 1..span.end];
        let mean = measured.iter().sum::<f64>() / measured.len() as f64;
        let (mut run, mut error) = (y[span.start], 0.0);
        for k in span.start..span.end - 1 {
            run = a * run + b * u[k];
            error += (y[k + 1] - run).powi(2);
        }
        (error / measured.iter().map(|y| (y - mean).powi(2)).sum::<f64>()).sqrt()
    }

    #[test]
    fn the_held_out_error_is_that_of_the_same_terms_refitted_on_the_other_spans() {
        let (y, u) = recording(300);
        let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
        source.push_uniform("run", 1.0, vec![y.clone(), u.clone()]);
        let recipe = Recipe::parse("[states]\ny = {}\n[inputs]\nu = \"u\"\n", "test").unwrap();
        let options = NarxOptions::new(&recipe).unwrap();
        let task = EquationTask::resolve(&one_row_ahead(&recipe, &options).unwrap(), source.columns()).unwrap();
        let base = NarxBase::new(task, &recipe).unwrap();
        let spans = [0..90, 90..200, 200..300];
        let cut = Spans::new(&source, spans.iter().map(|span| (0, span.clone())).collect(), 1).unwrap();
        let held: Vec<Spans<'_>> =
            spans.iter().map(|span| Spans::new(&source, vec![(0, span.clone())], 1).unwrap()).collect();
        let fold_of = cut.episodes().iter().enumerate().map(|(fold, episode)| (episode.id, fold)).collect();
        let partitions = [Choice { partition: None, seed: 0 }];
        let selection = Selection {
            base: &base,
            partitions: &partitions,
            cut: &cut,
            held: &held,
            fold_of: &fold_of,
            first: 0,
            step: 1.0,
        };
        let job =
            Job { order: NarxOrder { outputs: 1, inputs: 1, degree: 2, direct: false }, terms: TermRule::Auto(4) };
        let tried = with_threads(1, || selection.run(&[job], &Silent)).unwrap();
        let of = |tried: &[Tried]| tried.iter().map(|tried| tried.candidate.clone()).collect::<Vec<_>>();
        assert_eq!(of(&tried), of(&with_threads(3, || selection.run(&[job], &Silent)).unwrap()));
        // Forward regression takes y and u on all rows; what is held out is their error, whatever it would take on a part of them.
        let two = &tried[1];
        let mut columns = two.supports[0][0].columns.clone();
        columns.sort_unstable();
        assert_eq!(columns, [1, 2]);
        for (fold, error) in two.candidate.folds.iter().enumerate() {
            let exact = by_hand(&y, &u, &spans, fold);
            assert!((error - exact).abs() < 1e-10, "{fold}: {error} {exact}");
        }
        assert!((two.candidate.rrse - two.candidate.folds.iter().sum::<f64>() / 3.0).abs() < 1e-15);
    }

    #[test]
    fn the_simplest_within_one_standard_error_or_the_least_error() {
        let of = |terms: usize, folds: [f64; 2]| NarxCandidate {
            partition: 0,
            specification: "average".into(),
            seed: 0,
            regions: 1,
            order: NarxOrder { outputs: 1, inputs: 1, degree: 2, direct: false },
            terms,
            rrse: (folds[0] + folds[1]) / 2.0,
            folds: folds.to_vec(),
        };
        // The best has 0.2 with a standard error of 0.05.
        let tried =
            [of(3, [0.3, 0.5]), of(5, [0.24, 0.2]), of(5, [0.2, 0.26]), of(9, [0.15, 0.25]), of(1, [f64::INFINITY; 2])];
        assert_eq!(best(tried.iter()), Some(3));
        assert_eq!(best_within_one_standard_error(tried.iter()), Some(1), "the better of two that are as simple");
        assert_eq!(best_within_one_standard_error(tried[4..].iter()), None);
        // Errors of rounding are the same.
        let exact = [of(4, [1e-13, 3e-13]), of(3, [2e-12, 1e-11])];
        assert_eq!((best(exact.iter()), best_within_one_standard_error(exact.iter())), (Some(1), Some(1)));
    }
}
