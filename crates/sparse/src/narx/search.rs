//! Choice of lags and degree from one statistic.

use faer::MatRef;
use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_stats::Compressed;

use super::{NarxLibrary, NarxOrder};
use crate::threshold::{
    Criterion, CriterionOptions, Frols, FrolsChoice, Optimizer, Terms, ThresholdError, Trail, criteria_of_steps,
    optimize,
};

/// A training set and the rows that it did not see, both with the constant as their first column.
#[derive(Debug, Clone)]
pub struct NarxFold {
    /// Training rows.
    pub train: Compressed,
    /// Held-out rows, which are predicted one step ahead.
    pub test: Compressed,
}

/// Criterion by which orders are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum OrderChoice {
    /// The least value of an information criterion, added up over the targets.
    Criterion(Criterion, CriterionOptions),
    /// One-step errors on rows that did not train, over the variance of the target on those that did.
    CrossValidation {
        /// True: the order with the fewest terms within one standard error of the best is chosen. False: the best.
        one_standard_error: bool,
    },
}

/// Options for the comparison of orders.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OrderOptions {
    /// The most terms of an equation, taken by forward regression, their number being chosen with the order; `None`: all candidates of the order.
    pub max_terms: Option<usize>,
    /// Criterion of the comparison.
    pub choice: OrderChoice,
}

impl Default for OrderOptions {
    fn default() -> Self {
        Self { max_terms: None, choice: OrderChoice::Criterion(Criterion::Bic, CriterionOptions::default()) }
    }
}

/// One order, with the best number of terms for it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OrderScore {
    /// The order.
    pub order: NarxOrder,
    /// Its candidates, the constant included.
    pub candidates: usize,
    /// Terms of every target's equation.
    pub terms: Vec<usize>,
    /// Sum of squared one-step errors of every target on all rows.
    pub rss: Vec<f64>,
    /// Value of the criterion; the least is the best.
    pub value: f64,
    /// Standard error of the value over the folds; `None` for a criterion.
    pub standard_error: Option<f64>,
}

/// All orders.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OrderSearch {
    /// One entry an order, in the order asked for.
    pub scores: Vec<OrderScore>,
    /// Index of the chosen one.
    pub chosen: usize,
}

impl OrderSearch {
    /// The chosen order.
    pub fn choice(&self) -> &OrderScore {
        &self.scores[self.chosen]
    }
}

/// Compares orders up to the library's ([`NarxLibrary::orders`], say) on one statistic, without another pass: `problem` has the constant and then the library's
/// functions, and one target an output. `folds` are needed for cross-validation alone.
///
/// The same bits on any number of threads.
///
/// # Errors
/// Those of [`optimize`]; no orders, and cross-validation without folds.
pub fn search_orders(
    problem: &Compressed,
    library: &NarxLibrary,
    orders: &[NarxOrder],
    folds: &[NarxFold],
    options: &OrderOptions,
    progress: &dyn Progress,
) -> Result<OrderSearch, ThresholdError> {
    let (what, mend) = ("cross-validation has no folds", "give at least two, or choose by an information criterion");
    if matches!(options.choice, OrderChoice::CrossValidation { .. }) && folds.len() < 2 {
        return Err(ThresholdError::Nothing { what, mend });
    }
    if orders.is_empty() {
        return Err(ThresholdError::Nothing { what: "no order to compare", mend: "name at least one" });
    }
    let scores = parallel_map(orders.len(), progress, |i| {
        let columns = library.columns(orders[i]);
        score(problem, orders[i], &columns, folds, options)
    })?;
    let best = least(scores.iter().map(|score| score.value));
    let OrderChoice::CrossValidation { one_standard_error: true } = options.choice else {
        return Ok(OrderSearch { scores, chosen: best });
    };
    let limit = scores[best].value + scores[best].standard_error.unwrap_or(0.0);
    let within = (0..scores.len()).filter(|&i| scores[i].value <= limit);
    let size = |i: &usize| (scores[*i].terms.iter().sum::<usize>(), scores[*i].candidates);
    let chosen = within.min_by_key(size).unwrap_or(best);
    Ok(OrderSearch { scores, chosen })
}

fn least(values: impl Iterator<Item = f64>) -> usize {
    values.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
}

/// Models of one target of an order, by number of terms.
fn trail(problem: &Compressed, target: usize, options: &OrderOptions) -> Result<Trail, ThresholdError> {
    let optimizer = match options.max_terms {
        None => Optimizer::LeastSquares,
        Some(max_terms) => Optimizer::Frols(Frols { max_terms, choice: FrolsChoice::Last, ..Frols::default() }),
    };
    optimize(problem, target, &optimizer, &Terms::all())
}

fn score(
    problem: &Compressed,
    order: NarxOrder,
    columns: &[usize],
    folds: &[NarxFold],
    options: &OrderOptions,
) -> Result<OrderScore, ThresholdError> {
    let selected = problem.select(columns);
    let folds: Vec<NarxFold> = folds
        .iter()
        .map(|fold| NarxFold { train: fold.train.select(columns), test: fold.test.select(columns) })
        .collect();
    let targets = selected.targets();
    let mut order_score = OrderScore {
        order,
        candidates: columns.len(),
        terms: Vec::with_capacity(targets),
        rss: Vec::with_capacity(targets),
        value: 0.0,
        standard_error: None,
    };
    // Losses of the folds, their mean over the targets.
    let mut losses = vec![0.0; folds.len()];
    for target in 0..targets {
        let whole = trail(&selected, target, options)?;
        let best = match options.choice {
            OrderChoice::Criterion(criterion, criteria) => {
                let criteria = criteria_of_steps(&whole.steps, &selected, target, columns.len(), &criteria)?;
                let best = criteria.best(criterion);
                order_score.value += criteria.values(criterion)[best];
                best
            }
            OrderChoice::CrossValidation { .. } => {
                let held_out = folds.iter().map(|fold| held_out(fold, target, whole.steps.len(), options));
                let held_out = held_out.collect::<Result<Vec<_>, _>>()?;
                let mean = |k: usize| held_out.iter().map(|losses| losses[k]).sum::<f64>() / held_out.len() as f64;
                let best = least((0..whole.steps.len()).map(mean));
                losses.iter_mut().zip(&held_out).for_each(|(sum, held_out)| *sum += held_out[best] / targets as f64);
                best
            }
        };
        order_score.terms.push(whole.steps[best].terms());
        order_score.rss.push(whole.steps[best].rss);
    }
    if let OrderChoice::CrossValidation { .. } = options.choice {
        let count = losses.len() as f64;
        order_score.value = losses.iter().sum::<f64>() / count;
        let scatter: f64 = losses.iter().map(|loss| (loss - order_score.value).powi(2)).sum();
        order_score.standard_error = Some((scatter / (count - 1.0) / count).sqrt());
    }
    Ok(order_score)
}

/// Relative squared error on the rows that did not train, for every number of terms; a training set that ends earlier keeps its last model.
fn held_out(fold: &NarxFold, target: usize, steps: usize, options: &OrderOptions) -> Result<Vec<f64>, ThresholdError> {
    let trained = trail(&fold.train, target, options)?;
    let variance = fold.train.total[target] / fold.train.weight;
    let p = fold.test.columns();
    let loss = |k: usize| {
        let step = &trained.steps[k.min(trained.steps.len() - 1)];
        // All targets have the same columns: the errors of the others with these coefficients are not looked at.
        let values = step.coefficients.repeat(fold.test.targets());
        let coefficients = MatRef::from_column_major_slice(&values, p, fold.test.targets());
        fold.test.error(coefficients)[target] / fold.test.weight / variance
    };
    Ok((0..steps).map(loss).collect())
}
