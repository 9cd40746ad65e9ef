//! The search for an order, the cheapest first: linear models of many lags, then forward regression on the best of
//! these lags up to the third degree. Then follow the orders next to the best one, until none of them is better or the
//! effort is spent.

use std::collections::BTreeSet;

use fleetfoot_data::Progress;
use fleetfoot_recipe::Effort;
use fleetfoot_sparse::narx::NarxOrder;
use serde::Serialize;

use super::{
    GivenOrder, NarxOptions, TermRule,
    candidate::best,
    effort::Budget,
    options::USUAL,
    select::{Job, Selection, Tried},
};
use crate::error::Error;

/// The highest degree that is looked for.
const MOST_DEGREE: usize = 3;
/// Fixed cost of a simulated step, beside its terms; unit: terms.
const STEP: u64 = 20;
/// Products of a scan that cost as much as a term of a simulation.
const PRODUCTS: u64 = 100;
/// Training rows that a candidate needs.
const ROWS_PER_CANDIDATE: usize = 5;

/// Search for lags and degree: work, stages, and orders that the limit cut.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NarxSearch {
    /// The effort.
    pub effort: Effort,
    /// Terms that were to be evaluated at most: of free runs, and of the statistics behind them.
    pub limit: u64,
    /// The estimate of those that were evaluated, made before the runs: the same input gives the same.
    pub spent: u64,
    /// The stages, in their order.
    pub stages: Vec<NarxStage>,
    /// Orders that the limit cut, the cheapest first.
    #[serde(serialize_with = "crate::json::narx::cut")]
    pub cut: Vec<NarxOrder>,
}

/// A stage of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NarxStage {
    /// Name of the stage, for people.
    pub name: String,
    /// Orders.
    pub orders: usize,
    /// Models: orders, numbers of terms and partitions.
    pub models: usize,
    /// The least held-out error among them; infinite when all diverged.
    pub rrse: f64,
}

/// Searches for the parts of the order that are not given.
pub(crate) struct Look<'a> {
    pub(crate) selection: &'a Selection<'a>,
    pub(crate) options: &'a NarxOptions,
    pub(crate) given: GivenOrder,
    /// Rows that train.
    pub(crate) rows: usize,
    pub(crate) outputs: usize,
    /// The most lags that the spans leave room for.
    pub(crate) most_lags: usize,
}

impl Look<'_> {
    /// All models that were tried.
    pub(crate) fn run(&self, progress: &dyn Progress) -> Result<(Vec<Tried>, NarxSearch), Error> {
        let effort = self.options.effort;
        let mut state = State {
            budget: Budget::new(effort),
            tried: Vec::new(),
            seen: BTreeSet::new(),
            linear: BTreeSet::new(),
            stages: Vec::new(),
        };
        let linear = self.fits(self.linear());
        self.stage("linear, all terms", linear, self.rule(true), 0.25, &mut state, progress)?;
        let seeds = self.fits(self.seeds(&state.tried));
        self.stage("terms by forward regression", seeds, self.rule(false), 0.75, &mut state, progress)?;
        for _ in 0..effort.rounds() {
            let Some(at) = best(state.tried.iter().map(|tried| &tried.candidate)) else { break };
            let next = self.fits(self.neighbours(state.tried[at].candidate.order));
            let next = next.into_iter().filter(|order| !state.seen.contains(order)).collect();
            let before = state.tried.len();
            self.stage("next to the best", next, self.rule(false), 1.0, &mut state, progress)?;
            let better = best(state.tried.iter().map(|tried| &tried.candidate)).is_some_and(|at| at >= before);
            if !better {
                break;
            }
        }
        let Budget { spent, cut, .. } = state.budget;
        let cut = cut.into_iter().filter(|order| !state.seen.contains(order)).collect();
        let search = NarxSearch { effort, limit: effort.limit(), spent, stages: state.stages, cut };
        Ok((state.tried, search))
    }

    /// Terms of a stage: a linear model has all of them where their number is free.
    fn rule(&self, all: bool) -> TermRule {
        match self.options.terms {
            TermRule::Auto(_) if all => TermRule::All,
            rule => rule,
        }
    }

    fn stage(
        &self,
        name: &str,
        orders: Vec<NarxOrder>,
        terms: TermRule,
        share: f64,
        state: &mut State,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let cost = |order: NarxOrder| self.cost(&Job { order, terms });
        let always = |order: NarxOrder| {
            let usual = self.given.or(USUAL);
            (order == usual || order == NarxOrder { degree: 1, ..usual }) && self.is_usual(order)
        };
        let orders = state.budget.admit(orders, share, cost, always);
        if orders.is_empty() {
            return Ok(());
        }
        let mut jobs: Vec<Job> = orders.iter().map(|&order| Job { order, terms }).collect();
        jobs.extend(self.linear_beside(&orders, state));
        let tried = self.selection.run(&jobs, progress)?;
        let rrse = tried.iter().map(|tried| tried.candidate.rrse).fold(f64::INFINITY, f64::min);
        state.stages.push(NarxStage { name: name.into(), orders: orders.len(), models: tried.len(), rrse });
        if !matches!((terms, self.options.terms), (TermRule::All, TermRule::Auto(_))) {
            state.seen.extend(&orders);
        }
        state.tried.extend(tried);
        Ok(())
    }

    /// The linear models with all terms of the lags of these orders, if not tried yet: they compete with every order.
    fn linear_beside(&self, orders: &[NarxOrder], state: &mut State) -> Vec<Job> {
        let linear = orders.iter().map(|&order| NarxOrder { degree: 1, ..order });
        let new: Vec<NarxOrder> = linear.filter(|&order| state.linear.insert(order)).collect();
        let terms = self.rule(true);
        // The stage of linear models has tried them itself.
        let is_first = state.stages.is_empty();
        new.into_iter().filter(|_| !is_first).map(|order| Job { order, terms }).collect()
    }

    /// An estimate of the work of an order, in terms that are evaluated.
    fn cost(&self, job: &Job) -> u64 {
        let candidates = self.candidates(job.order);
        let terms: u64 = job.counts(candidates).iter().map(|&count| STEP + (count * self.outputs) as u64).sum();
        let scan = (candidates as u64).saturating_mul(candidates as u64) / PRODUCTS;
        (self.rows as u64 * self.selection.partitions.len() as u64).saturating_mul(terms.saturating_add(scan))
    }

    /// Those that the rows can carry and that the effort allows, and the usual order with its linear part.
    fn fits(&self, orders: Vec<NarxOrder>) -> Vec<NarxOrder> {
        let fits = |order: &NarxOrder| {
            self.is_usual(*order)
                || (order.reach() <= self.most_lags && self.candidates(*order) <= self.most_candidates())
        };
        orders.into_iter().filter(fits).collect()
    }

    fn candidates(&self, order: NarxOrder) -> usize {
        self.selection.base.candidates(order)
    }

    fn most_candidates(&self) -> usize {
        self.options.effort.most_candidates().min(self.rows / ROWS_PER_CANDIDATE)
    }

    /// Orders that are tried whatever they cost: the usual one with its linear part. Products of many lags that were given are not, unless their degree is
    /// given too.
    fn is_usual(&self, order: NarxOrder) -> bool {
        let chosen = (self.given.outputs.is_none() && self.given.inputs.is_none()) || self.given.degree.is_some();
        order.is_within(self.given.or(USUAL))
            && (order.degree == 1 || chosen || self.candidates(order) <= self.most_candidates())
    }

    /// Linear models of all lags that are not given.
    fn linear(&self) -> Vec<NarxOrder> {
        let grid = self.options.effort.lags();
        let lags = |given: Option<usize>| given.map_or_else(|| grid.to_vec(), |lags| vec![lags]);
        let (mut orders, every) = (Vec::new(), self.given.or(USUAL).every);
        for direct in self.directs() {
            for &outputs in &lags(self.given.outputs) {
                let mut inputs = lags(self.given.inputs);
                if direct && self.given.inputs.is_none() {
                    inputs.push(0);
                }
                orders.extend(inputs.iter().map(|&inputs| NarxOrder { outputs, inputs, degree: 1, direct, every }));
            }
        }
        orders.retain(|order| order.outputs + order.inputs > 0 || order.direct);
        orders
    }

    fn directs(&self) -> Vec<bool> {
        self.given.direct.map_or_else(|| vec![false, true], |direct| vec![direct])
    }

    /// Degrees that forward regression tries.
    fn degrees(&self) -> Vec<usize> {
        match self.given.degree {
            Some(degree) => vec![degree],
            None => (1..=MOST_DEGREE).collect(),
        }
    }

    /// The lags of the best linear models, one and two lags beside them, at all degrees.
    fn seeds(&self, tried: &[Tried]) -> Vec<NarxOrder> {
        let mut ranked: Vec<&Tried> = tried.iter().filter(|tried| tried.candidate.rrse.is_finite()).collect();
        ranked.sort_by(|a, b| a.candidate.rrse.total_cmp(&b.candidate.rrse));
        let mut lags: Vec<NarxOrder> = Vec::new();
        for order in ranked.iter().map(|tried| tried.candidate.order) {
            if lags.len() < self.options.effort.seeds() && !lags.contains(&order) {
                lags.push(order);
            }
        }
        for (lag, direct) in
            [1, 2].into_iter().flat_map(|lag| self.directs().into_iter().map(move |direct| (lag, direct)))
        {
            lags.push(self.given.or(NarxOrder { outputs: lag, inputs: lag, degree: 1, direct, every: 1 }));
        }
        let degrees = self.degrees();
        let at = |order: &NarxOrder| degrees.iter().map(|&degree| NarxOrder { degree, ..*order }).collect::<Vec<_>>();
        let mut orders: Vec<NarxOrder> = lags.iter().flat_map(at).collect();
        // Without a choice of terms the linear models have been tried.
        if !matches!(self.options.terms, TermRule::Auto(_)) {
            orders.retain(|order| order.degree > 1);
        }
        orders
    }

    /// One lag more or less, one degree more or less, inputs at once or not; given parts stay.
    fn neighbours(&self, order: NarxOrder) -> Vec<NarxOrder> {
        let mut orders = vec![order];
        let steps = |value: usize| [value.saturating_sub(1), value + 1];
        if self.given.outputs.is_none() {
            orders.extend(steps(order.outputs).map(|outputs| NarxOrder { outputs, ..order }));
        }
        if self.given.inputs.is_none() {
            orders.extend(steps(order.inputs).map(|inputs| NarxOrder { inputs, ..order }));
        }
        if self.given.outputs.is_none() && self.given.inputs.is_none() {
            orders.push(NarxOrder { outputs: order.outputs + 1, inputs: order.inputs + 1, ..order });
        }
        if self.given.degree.is_none() {
            orders.extend(steps(order.degree).map(|degree| NarxOrder { degree, ..order }));
        }
        if self.given.direct.is_none() {
            orders.push(NarxOrder { direct: !order.direct, ..order });
        }
        orders.retain(|order| {
            let reads = order.outputs > 0 && (order.inputs > 0 || order.direct || self.given.inputs == Some(0));
            (reads || self.given.outputs.is_some())
                && (1..=MOST_DEGREE.max(self.given.degree.unwrap_or(0))).contains(&order.degree)
        });
        orders
    }
}

struct State {
    budget: Budget,
    tried: Vec<Tried>,
    /// Orders whose terms were chosen by forward regression.
    seen: BTreeSet<NarxOrder>,
    /// Linear models that were tried with all terms.
    linear: BTreeSet<NarxOrder>,
    stages: Vec<NarxStage>,
}
