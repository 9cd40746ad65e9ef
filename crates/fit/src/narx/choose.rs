//! Choice of partition, order and terms: as given, by one-step errors, or by free runs.

use std::collections::BTreeMap;

use faer::Mat;
use fleetfoot_data::setting::{FOLDS, SELECT, WHERE};
use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_recipe::{Criterion, NarxSelection};
use fleetfoot_sparse::{
    narx::{NarxFold, NarxOrder, OrderChoice, OrderOptions, OrderSearch, search_orders},
    threshold::{Criterion as By, CriterionOptions},
};
use fleetfoot_sums::system::{SystemPlan, SystemScan};
use fleetfoot_task::EquationTask;

use super::{
    GivenOrder, NarxCandidate, NarxOptions, NarxSearch, OrderRule, TermRule,
    candidate::{best, best_within_one_standard_error, mark},
    choice::Choice,
    look::Look,
    options::USUAL,
    select::{By as Compared, Job, Selection, Tried},
    summed::{Evidence, folds_of_chunks},
    task::NarxTask,
    terms::{EquationTerms, Problems, Support, Trails, choice},
    training::Fit,
};
use crate::{error::Error, spans::Spans};

/// The shortest span has as many rows for every lag that is looked for.
const ROWS_PER_LAG: usize = 8;

/// The chosen model.
pub(crate) struct Chosen {
    /// Index among the partitions.
    pub partition: usize,
    pub(crate) order: NarxOrder,
    /// The system of the candidates below.
    pub(crate) task: EquationTask,
    pub(crate) whole: SystemScan,
    pub regions: Option<SystemScan>,
    /// Of every region (outer) and equation.
    pub(crate) terms: Vec<Vec<EquationTerms>>,
    /// Candidates of the order.
    pub(crate) candidates: usize,
    pub(crate) record: ChoiceRecord,
    /// The other models of the front by their number of coefficients, of which each has another, where they are wanted.
    pub(crate) rivals: Vec<(usize, Chosen)>,
}

/// The choice, its candidates and its searches.
#[derive(Default)]
pub(crate) struct ChoiceRecord {
    pub(crate) text: Option<String>,
    pub(crate) tried: Vec<NarxCandidate>,
    pub(crate) held_out: Option<NarxCandidate>,
    pub(crate) search: Option<NarxSearch>,
    pub(crate) orders: Option<OrderSearch>,
}

/// The spans in which no output moves, for people: they count for nothing, as any model that rests is perfect there.
///
/// # Errors
/// Fewer than two spans are left: models cannot be compared, and no model is tested on held-out rows.
fn resting(tried: &[Tried], folds: usize) -> Result<String, Error> {
    let rests =
        |fold: &usize| tried.iter().any(|tried| tried.candidate.folds.get(*fold).is_some_and(|error| error.is_nan()));
    let resting = (0..folds).filter(rests).count();
    match resting {
        0 => Ok(String::new()),
        count if folds - count < 2 => Err(Error::undetermined(format!(
            "{count} of {folds} held-out spans have constant outputs, which cannot rank models: leave out the rows at rest (for example {given_where}), give longer logs, or choose by one-step errors of all rows ({given_select})",
            given_select = SELECT.to("bic"),
            given_where = WHERE.to("time() > 2")
        ))),
        count => Ok(format!(" ({count} of them are ignored: their outputs do not vary)")),
    }
}

impl Fit<'_> {
    pub(crate) fn choose(&self, partitions: &[Choice], progress: &dyn Progress) -> Result<Chosen, Error> {
        let fixed = |order: NarxOrder| {
            partitions.len() == 1 && !self.options.terms.is_free() && self.options.order == OrderRule::Fixed(order)
        };
        match (self.options.selection, self.options.order) {
            (_, OrderRule::Fixed(order)) if fixed(order) => {
                let task = self.evidence.candidates(self.base, &[order])?;
                let whole = self.scan(&task.task, None, progress)?;
                self.check(&whole, self.base.candidates(order))?;
                let terms = match self.options.terms {
                    TermRule::Count(count) => Some(count),
                    _ => None,
                };
                self.by_rule(task, whole, &partitions[0], order, terms, ChoiceRecord::default(), progress)
            }
            (NarxSelection::FreeRun, _) => self.by_free_runs(partitions, progress),
            (NarxSelection::OneStep(criterion), rule) => {
                let orders = self.orders(rule)?;
                if partitions.len() > 1 {
                    return self.by_one_step_of_several(partitions, &orders, criterion, progress);
                }
                self.by_one_step(&partitions[0], &orders, criterion, progress)
            }
        }
    }

    /// The orders of a rule that looks for none.
    fn orders(&self, rule: OrderRule) -> Result<Vec<NarxOrder>, Error> {
        Ok(match rule {
            OrderRule::Fixed(order) => vec![order],
            OrderRule::UpTo(order) => self.base.with(&[order])?.library.orders(),
            OrderRule::Look(given) => vec![given.or(USUAL)],
        })
    }

    /// The terms that forward regression takes on all rows, of one order.
    #[expect(clippy::too_many_arguments, reason = "what was scanned, and what of it is wanted")]
    fn by_rule(
        &self,
        task: NarxTask,
        whole: SystemScan,
        partition: &Choice,
        order: NarxOrder,
        terms: Option<usize>,
        record: ChoiceRecord,
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let partition = partition.partition.as_ref();
        let regions = partition.map(|partition| self.scan(&task.task, Some(partition), progress)).transpose()?;
        let columns = task.library.columns(order);
        let candidates = columns.len();
        let rule = match (self.options.terms, terms) {
            (TermRule::Auto(_), Some(count)) => TermRule::Count(count),
            (rule, _) => rule,
        };
        let by = match self.options.selection {
            NarxSelection::FreeRun => fleetfoot_sparse::threshold::FrolsChoice::Last,
            NarxSelection::OneStep(criterion) => choice(criterion),
        };
        let trails = Trails::new(&Problems::all(&whole, regions.as_ref()), columns, rule, by)?;
        let terms = trails.terms(terms.filter(|_| rule != TermRule::All));
        Ok(Chosen {
            partition: 0,
            order,
            task: task.task,
            whole,
            regions,
            terms,
            candidates,
            record,
            rivals: Vec::new(),
        })
    }

    /// Simulations of spans that did not train decide.
    fn by_free_runs(&self, partitions: &[Choice], progress: &dyn Progress) -> Result<Chosen, Error> {
        let source = self.evidence.rows()?;
        self.check_rows(progress)?;
        let (cut, folds) = Spans::folds(source, self.options.folds, self.smoothed())?;
        let held = held(&cut, &folds, self.options.folds)?;
        let fold_of: BTreeMap<EpisodeId, usize> =
            cut.episodes().iter().zip(&folds).map(|(episode, &fold)| (episode.id, fold)).collect();
        // The longest span of every fold has room for the lags.
        let longest = |spans: &Spans<'_>| spans.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
        let room = held.iter().map(longest).min().unwrap_or(0) / ROWS_PER_LAG;
        let first = match self.options.order {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) => order.reach(),
            OrderRule::Look(given) => self.options.most_lags(given, room.max(1)),
        };
        let anew = self.anew(partitions, (&cut, &folds), progress)?;
        let by =
            if matches!(self.options.order, OrderRule::Look(_)) { Compared::Search } else { Compared::Simulations };
        let selection = Selection {
            base: self.base,
            partitions,
            anew: &anew,
            cut: &cut,
            held: &held,
            fold_of: &fold_of,
            first: first.saturating_sub(1),
            step: self.step,
            by,
        };
        let (tried, search) = match self.options.order {
            OrderRule::Look(given) => {
                let rows = cut.rows();
                let outputs = self.base.outputs();
                let look =
                    Look { selection: &selection, options: self.options, given, rows, outputs, most_lags: first };
                let (tried, search) = look.run(progress)?;
                (tried, Some(search))
            }
            rule => {
                let orders = self.orders(rule)?;
                let jobs: Vec<Job> = orders.iter().map(|&order| Job { order, terms: self.options.terms }).collect();
                (selection.run(&jobs, progress)?, None)
            }
        };
        let resting = resting(&tried, self.options.folds)?;
        let candidates = tried.iter().map(|tried| &tried.candidate);
        // A caller who names the orders compares a few; a search looks at hundreds.
        let looked = search.is_some();
        let chosen = if looked { best_within_one_standard_error(candidates) } else { best(candidates) };
        let Some(at) = chosen else {
            return Err(Error::undetermined(format!(
                "none of {} models can be simulated through the spans that did not train: all diverge, or the spans are shorter than the lags; choose by {given_select}, \
                 or try other lags, fewer terms or fewer {FOLDS}",
                tried.len(),
                given_select = SELECT.to("bic")
            )));
        };
        let mut all: Vec<NarxCandidate> = tried.iter().map(|tried| tried.candidate.clone()).collect();
        mark(&mut all, at);
        let record = ChoiceRecord {
            text: Some(format!(
                "free runs of {} spans that did not train{resting}, of {} models: {}",
                self.options.folds,
                tried.len(),
                if looked {
                    "the fewest terms within one standard error of the least error"
                } else {
                    "the least error, and of those within 0.1 % of it the fewest terms"
                }
            )),
            held_out: Some(all[at].clone()),
            search,
            tried: all,
            orders: None,
        };
        self.with_rivals(&tried, at, partitions, record, progress)
    }

    /// One-step errors of several partitions and orders decide, of one scan a partition.
    fn by_one_step_of_several(
        &self,
        partitions: &[Choice],
        orders: &[NarxOrder],
        criterion: Criterion,
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let source = self.evidence.rows()?;
        self.check_rows(progress)?;
        let (cut, folds) = Spans::folds(source, self.options.folds, self.smoothed())?;
        let held = held(&cut, &folds, self.options.folds)?;
        let fold_of: BTreeMap<EpisodeId, usize> =
            cut.episodes().iter().zip(&folds).map(|(episode, &fold)| (episode.id, fold)).collect();
        let anew = self.anew(partitions, (&cut, &folds), progress)?;
        let selection = Selection {
            base: self.base,
            partitions,
            anew: &anew,
            cut: &cut,
            held: &held,
            fold_of: &fold_of,
            first: 0,
            step: self.step,
            by: Compared::OneStep,
        };
        let jobs: Vec<Job> = orders.iter().map(|&order| Job { order, terms: self.options.terms }).collect();
        let tried = selection.run(&jobs, progress)?;
        let mut all: Vec<NarxCandidate> = tried.iter().map(|tried| tried.candidate.clone()).collect();
        let spans = self.options.folds;
        let least = |of: &dyn Fn(&NarxCandidate) -> Option<f64>| {
            let known = all.iter().enumerate().filter_map(|(at, score)| Some((at, of(score)?)));
            known.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
        };
        let (chosen, rule) = match criterion {
            Criterion::OneStandardError => (
                best_within_one_standard_error(all.iter()),
                format!(
                    "the fewest terms within one standard error of the least one-step error of {spans} held-out spans"
                ),
            ),
            Criterion::CrossValidation => {
                (best(all.iter()), format!("the least one-step error of {spans} held-out spans"))
            }
            Criterion::Aic => (least(&|score| score.aic), "the least AIC of one-step errors".into()),
            Criterion::Bic | Criterion::Ebic => (least(&|score| score.bic), "the least BIC of one-step errors".into()),
        };
        let Some(at) = chosen else {
            return Err(Error::undetermined(format!(
                "none of {} models has a one-step error: no row that is held out has all lags; try fewer {FOLDS} or other lags",
                all.len()
            )));
        };
        mark(&mut all, at);
        let record = ChoiceRecord {
            text: Some(format!("{rule}, of {} models", all.len())),
            held_out: Some(all[at].clone()),
            tried: all,
            ..ChoiceRecord::default()
        };
        self.with_rivals(&tried, at, partitions, record, progress)
    }

    /// Refuses orders that the rows cannot carry before anything is simulated: the lags alone say which rows there are.
    fn check_rows(&self, progress: &dyn Progress) -> Result<(), Error> {
        let order = match self.options.order {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) => order,
            OrderRule::Look(given) => given.or(NarxOrder { outputs: 1, inputs: 1, degree: 1, direct: false, every: 1 }),
        };
        let lags = self.base.with(&[NarxOrder { degree: 1, ..order }])?;
        let whole = self.scan(&lags.task, None, progress)?;
        self.check(&whole, self.base.candidates(order))
    }

    /// The chosen model, and the others of the front where they are wanted.
    fn with_rivals(
        &self,
        tried: &[Tried],
        at: usize,
        partitions: &[Choice],
        record: ChoiceRecord,
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let written = |at: usize, record| {
            let tried: &Tried = &tried[at];
            self.written(tried, &partitions[tried.candidate.partition], record, progress)
        };
        let front: Vec<usize> = match self.rivals {
            true => (0..tried.len()).filter(|&other| other != at && record.tried[other].front).collect(),
            false => Vec::new(),
        };
        let mut chosen = written(at, record)?;
        for other in front {
            chosen.rivals.push((tried[other].candidate.coefficients, written(other, ChoiceRecord::default())?));
        }
        Ok(chosen)
    }

    /// A tried model, on all training rows that have its lags.
    fn written(
        &self,
        tried: &Tried,
        partition: &Choice,
        record: ChoiceRecord,
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let mut columns: Vec<usize> = tried.supports.iter().flatten().flat_map(|s| s.columns.iter().copied()).collect();
        columns.sort_unstable();
        columns.dedup();
        let functions: Vec<usize> = columns.iter().copied().filter(|&column| column > 0).collect();
        let place =
            |column: usize| if column == 0 { 0 } else { 1 + functions.partition_point(|&other| other < column) };
        let local = |support: &Support| Support {
            columns: support.columns.iter().map(|&column| place(column)).collect(),
            shared: support.shared,
        };
        let supports: Vec<Vec<Support>> =
            tried.supports.iter().map(|region| region.iter().map(local).collect()).collect();
        let task = tried.task.restricted(&functions);
        let whole = self.scan(&task, None, progress)?;
        self.check(&whole, task.candidates())?;
        let regions =
            partition.partition.as_ref().map(|partition| self.scan(&task, Some(partition), progress)).transpose()?;
        let problems = Problems::all(&whole, regions.as_ref());
        let terms = match self.options.terms {
            TermRule::All => problems.refitted(&supports)?,
            _ => problems.ordered(&supports)?,
        };
        let order = tried.candidate.order;
        let candidates = tried.task.library.columns(order).len();
        let partition = tried.candidate.partition;
        Ok(Chosen { partition, order, task, whole, regions, terms, candidates, record, rivals: Vec::new() })
    }

    /// One-step errors decide, from one statistic.
    fn by_one_step(
        &self,
        partition: &Choice,
        orders: &[NarxOrder],
        criterion: Criterion,
        progress: &dyn Progress,
    ) -> Result<Chosen, Error> {
        let task = self.evidence.candidates(self.base, orders)?;
        let whole = self.scan(&task.task, None, progress)?;
        self.check(&whole, task.task.candidates())?;
        let search = self.compared(&task, &whole, orders, criterion, progress)?;
        let best = search.choice();
        let held_out = matches!(criterion, Criterion::CrossValidation | Criterion::OneStandardError);
        let terms = match self.options.terms {
            TermRule::Count(count) => Some(count),
            TermRule::All => None,
            TermRule::Auto(_) => held_out.then(|| best.terms.iter().copied().max().unwrap_or(1)),
        };
        let order = best.order;
        let folds = self.options.folds;
        let text = match criterion {
            Criterion::Aic => "AIC of one-step errors".into(),
            Criterion::Bic => "BIC of one-step errors".into(),
            Criterion::Ebic => "EBIC of one-step errors".into(),
            Criterion::CrossValidation => format!("the least one-step error of {folds} held-out spans"),
            Criterion::OneStandardError => {
                format!("fewest terms within one standard error of the least one-step error of {folds} held-out spans")
            }
        };
        let record = ChoiceRecord { text: Some(text), orders: Some(search), ..ChoiceRecord::default() };
        self.by_rule(task, whole, partition, order, terms, record, progress)
    }

    /// Orders compared on the statistic.
    fn compared(
        &self,
        task: &NarxTask,
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
            OrderChoice::CrossValidation { .. } => self.folds(task, whole, progress)?,
            _ => Vec::new(),
        };
        let max_terms = match self.options.terms {
            TermRule::All => None,
            TermRule::Count(most) | TermRule::Auto(most) => Some(most),
        };
        let mut options = OrderOptions::default();
        (options.max_terms, options.choice) = (max_terms, choice);
        let problem = whole.root(0).compressed(true);
        Ok(search_orders(&problem, &task.library, orders, &folds, &options, progress)?)
    }

    fn folds(&self, task: &NarxTask, whole: &SystemScan, progress: &dyn Progress) -> Result<Vec<NarxFold>, Error> {
        let source = match self.evidence {
            Evidence::Rows(source) => source,
            Evidence::Sums(sums) => return folds_of_chunks(whole, self.options.folds, sums.order, self.smoothed()),
        };
        let (cut, folds) = Spans::folds(source, self.options.folds, self.smoothed())?;
        let scan = SystemPlan::new(task.task.system(), None, &cut)?.scan(&cut, progress)?;
        let fold_of = |unit: usize| {
            let episode = cut.episodes().iter().position(|episode| episode.id == scan.units()[unit].episode);
            episode.map(|episode| folds[episode])
        };
        let weights = |is_held_out: bool| {
            let weight = |unit: usize, fold: usize| f64::from((fold_of(unit) == Some(fold)) == is_held_out);
            Mat::from_fn(scan.units().len(), self.options.folds, weight)
        };
        let problems =
            |is_held_out| scan.roots(0, weights(is_held_out).as_ref()).into_iter().map(|root| root.compressed(true));
        let both = problems(false).zip(problems(true));
        let filled = both.filter(|(train, test)| train.weight > 0.0 && test.weight > 0.0);
        Ok(filled.map(|(train, test)| NarxFold { train, test }).collect())
    }
}

/// The spans of every fold.
fn held<'a>(cut: &'a Spans<'a>, folds: &[usize], count: usize) -> Result<Vec<Spans<'a>>, Error> {
    (0..count)
        .map(|fold| {
            let episodes = (0..folds.len()).filter(|&e| folds[e] == fold);
            Ok(Spans::new(cut, episodes.map(|e| (e, 0..cut.episodes()[e].rows)).collect(), 1)?)
        })
        .collect()
}

impl NarxOptions {
    /// The most lags that a search may come to, where the spans have room for `room`.
    fn most_lags(&self, given: GivenOrder, room: usize) -> usize {
        let grid = self.effort.lags().iter().copied().max().unwrap_or(1).min(room).max(USUAL.outputs);
        given.or(NarxOrder { outputs: grid, inputs: grid, ..USUAL }).reach()
    }
}
