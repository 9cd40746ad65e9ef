//! A recipe resolved to an autoregression: the equations of the outputs one row ahead, over the lags of outputs and inputs.

use fleetfoot_data::setting::{
    CONSTRAINTS, DIRECT, FIT_NARX, FIT_SINDY, FIT_SPARSE, LAGS_IN, LAGS_OUT, LIBRARY, LIBRARY_SECTION, OUTPUTS,
    PARAMETERS, PREDICT, STATES_SECTION,
};
use fleetfoot_library::Expr;
use fleetfoot_model::{ClosedError, Role};
use fleetfoot_recipe::Recipe;
use fleetfoot_sparse::narx::{Addend, NarxLibrary, NarxOrder};
use fleetfoot_task::{EquationTask, seen};

use super::{GivenOrder, NarxOptions, OrderRule};
use crate::error::Error;

/// The equations `next(y) = f(lags)` of a recipe's states, while the order is not known.
#[derive(Debug, Clone)]
pub struct NarxBase {
    pub(crate) task: EquationTask,
    candidates: Candidates,
}

/// Construction of the candidates.
#[derive(Debug, Clone)]
enum Candidates {
    /// Products of lags.
    Polynomial { outputs: Vec<Expr>, inputs: Vec<Expr> },
    /// Lags of given functions.
    Additive(Vec<Addend>),
}

/// The same with the candidates of some orders.
#[derive(Debug, Clone)]
pub(crate) struct NarxTask {
    /// The system with all candidates.
    pub(crate) task: EquationTask,
    /// Candidates by order.
    pub(crate) library: NarxLibrary,
}

/// The recipe as `fit sindy` reads it, the lags left to [`NarxBase::with`].
pub(crate) fn one_row_ahead(recipe: &Recipe, options: &NarxOptions) -> Result<Recipe, Error> {
    let refuse = |what: &str, mend: String| Err(Error::conflict(format!("{what}: {mend}")));
    if recipe.states.values().any(|state| state.library.is_some() || !state.fixed.is_empty()) {
        return refuse(
            "a state has a separate library or fixed terms",
            format!(
                "{FIT_NARX} has one library for all outputs ({LIBRARY_SECTION} functions, {LIBRARY}); or run {FIT_SINDY} with {given_predict}",
                given_predict = PREDICT.to("next")
            ),
        );
    }
    if !recipe.parameters.is_empty() {
        return refuse(
            &format!("the recipe has {PARAMETERS}"),
            format!("they are estimated by {FIT_SINDY}; put numbers in their place"),
        );
    }
    if !recipe.constraints.is_empty() {
        return refuse(
            &format!("the recipe has {CONSTRAINTS}"),
            format!("{FIT_SINDY} and {FIT_SPARSE} keep them; remove them"),
        );
    }
    match recipe.model.predict.as_deref() {
        None | Some("next") => {}
        Some(other) => {
            return refuse(
                &PREDICT.to(other).to_string(),
                format!("an autoregression gives the next value of its outputs; remove it, or run {FIT_SINDY}"),
            );
        }
    }
    if recipe.states.is_empty() {
        return refuse("no outputs", format!("name them in the recipe ({STATES_SECTION}) or with {OUTPUTS}"));
    }
    let mut recipe = recipe.clone();
    // Of several partitions only a label has to be known there: it is one more column.
    recipe.model.partition = options.partitions.iter().find(|p| p.label().is_some()).map(ToString::to_string);
    recipe.model.predict = Some("next".into());
    // The candidates have them.
    recipe.model.lags = None;
    if recipe.library.functions.is_empty() {
        recipe.library.functions = vec!["1".into()];
    }
    Ok(recipe)
}

impl NarxBase {
    /// The outputs and inputs of a task whose library is the constant, or functions of one row, as [`one_row_ahead`] asks for.
    ///
    /// # Errors
    /// A function of several rows.
    pub(crate) fn new(task: EquationTask, recipe: &Recipe) -> Result<Self, Error> {
        let regressor = |name: &str| recipe.states.get(name).is_none_or(|state| state.regressor != Some(false));
        let of = |role: Role| -> Vec<Expr> {
            task.columns
                .iter()
                .filter(|column| column.role == role && regressor(&column.name))
                .flat_map(|column| seen(column, &task.columns))
                .collect()
        };
        let candidates = if recipe.library.functions.is_empty() {
            Candidates::Polynomial { outputs: of(Role::State), inputs: of(Role::Input) }
        } else {
            Candidates::Additive(
                task.functions.iter().map(|function| addend(function, &task)).collect::<Result<_, _>>()?,
            )
        };
        Ok(Self { task, candidates })
    }

    /// The task with the candidates of any of these orders.
    ///
    /// # Errors
    /// More candidates than a library may have.
    pub(crate) fn with(&self, orders: &[NarxOrder]) -> Result<NarxTask, Error> {
        let library = match &self.candidates {
            Candidates::Polynomial { outputs, inputs } => NarxLibrary::of_orders(outputs, inputs, orders)?,
            Candidates::Additive(addends) => NarxLibrary::additive(addends, orders),
        };
        Ok(NarxTask { task: with_functions(&self.task, library.functions().to_vec()), library })
    }

    /// Candidates of an order, the constant among them.
    pub(crate) fn candidates(&self, order: NarxOrder) -> usize {
        match &self.candidates {
            Candidates::Polynomial { outputs, inputs } => {
                let variables =
                    outputs.len() * order.outputs + inputs.len() * (order.inputs + usize::from(order.direct));
                // C(variables + degree, degree)
                (1..=order.degree).fold(1usize, |count, d| count.saturating_mul(variables + d) / d)
            }
            Candidates::Additive(addends) => 1 + NarxLibrary::additive(addends, &[order]).functions().len(),
        }
    }

    /// Functions that every row needs, for any order.
    pub(crate) fn row_functions(&self) -> Vec<Expr> {
        let mut functions = self.task.row_functions();
        if let Candidates::Polynomial { outputs, inputs } = &self.candidates {
            functions.extend(outputs.iter().chain(inputs).cloned());
        }
        functions
    }

    /// Number of expressions of outputs whose lags are candidates; an angle has its cosine and its sine.
    pub(crate) fn seen_outputs(&self) -> usize {
        match &self.candidates {
            Candidates::Polynomial { outputs, .. } => outputs.len(),
            Candidates::Additive(_) => 0,
        }
    }

    /// Number of inputs whose lags are candidates.
    pub(crate) fn inputs(&self) -> usize {
        match &self.candidates {
            Candidates::Polynomial { inputs, .. } => inputs.len(),
            Candidates::Additive(_) => 0,
        }
    }

    /// The inputs, for people.
    pub(crate) fn input(&self, at: usize) -> String {
        match &self.candidates {
            Candidates::Polynomial { inputs, .. } => inputs[at].to_string(),
            Candidates::Additive(_) => String::new(),
        }
    }

    /// The same with inputs that are so many rows late.
    pub(crate) fn delayed(&self, rows: &[usize]) -> Self {
        let mut delayed = self.clone();
        if let Candidates::Polynomial { inputs, .. } = &mut delayed.candidates {
            inputs.iter_mut().zip(rows).for_each(|(input, &rows)| *input = input.shifted(rows as i32));
        }
        delayed
    }

    /// The equations over so many lags of every output, and then of every input, lag by lag. Inputs begin with those of
    /// the predicted row.
    pub(crate) fn lags(&self, outputs: usize, inputs: usize) -> EquationTask {
        let functions = match &self.candidates {
            Candidates::Polynomial { outputs: signals, inputs: given } => {
                let of = |exprs: &[Expr], first: i32, lags: usize| {
                    let lagged =
                        exprs.iter().flat_map(|expr| (0..lags).map(move |lag| expr.shifted(first + lag as i32)));
                    lagged.collect::<Vec<Expr>>()
                };
                [of(signals, 0, outputs), of(given, -1, inputs)].concat()
            }
            Candidates::Additive(_) => Vec::new(),
        };
        with_functions(&self.task, functions)
    }

    /// The present row and those before it: so many of every output, then of every input, lag by lag.
    pub(crate) fn past(&self, outputs: usize, inputs: usize) -> Vec<Expr> {
        let Candidates::Polynomial { outputs: output_terms, inputs: input_terms } = &self.candidates else {
            return Vec::new();
        };
        let row = |lag: usize| {
            let of = |exprs: &[Expr], lags: usize| -> Vec<Expr> {
                exprs.iter().filter(|_| lag < lags).map(|expr| expr.shifted(lag as i32)).collect()
            };
            [of(output_terms, outputs), of(input_terms, inputs)].concat()
        };
        (0..outputs.max(inputs)).flat_map(row).collect()
    }

    /// Number of outputs.
    pub(crate) fn outputs(&self) -> usize {
        self.task.fitted.len()
    }

    /// The rule with the orders that can run free. Refuses inputs that follow from an output and would be needed before
    /// it is predicted. If the search were to decide about direct inputs, they are excluded.
    pub(crate) fn simulated(&self, rule: OrderRule, step: f64) -> Result<OrderRule, Error> {
        self.check_simulated(false, step)?;
        let Err(refused) = self.check_simulated(true, step) else { return Ok(rule) };
        match rule {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) if order.direct => Err(refused),
            OrderRule::Look(GivenOrder { direct: Some(true), .. }) => Err(refused),
            OrderRule::Look(given) => Ok(OrderRule::Look(GivenOrder { direct: Some(false), ..given })),
            rule => Ok(rule),
        }
    }

    /// Refuses candidates that a free run could not evaluate; `direct`: with inputs that act at once.
    fn check_simulated(&self, direct: bool, step: f64) -> Result<(), Error> {
        let task = self.with(&[NarxOrder { outputs: 1, inputs: 1, degree: 1, direct, every: 1 }])?.task;
        fleetfoot_model::check_simulated(&task.columns, &task.equations, step, &task.functions).map_err(
            |error| match error {
                ClosedError::Ahead { column, definition, state, ahead } => Error::conflict(format!(
                    "the input `{column}` is {definition}, a function of the output `{state}`{}: it is known only when the output is; give it earlier rows \
                     (remove {DIRECT}, or write `lag({column}, {ahead})` as the input), or leave it out of the inputs",
                    if ahead == 1 { String::new() } else { format!(" {} rows ahead", ahead - 1) }
                )),
                other => Error::conflict(other.to_string()),
            },
        )
    }
}

impl NarxTask {
    /// The task with some of the candidates only: columns of problems with the constant first, ascending.
    pub(crate) fn restricted(&self, columns: &[usize]) -> EquationTask {
        let functions = columns.iter().filter_map(|&j| j.checked_sub(1)).map(|j| self.task.functions[j].clone());
        with_functions(&self.task, functions.collect())
    }
}

fn with_functions(task: &EquationTask, functions: Vec<Expr>) -> EquationTask {
    let mut task = task.clone();
    task.functions = functions;
    task.limits.clear();
    task.constant = true;
    for equation in &mut task.fitted {
        equation.allowed = vec![true; task.functions.len() + 1];
        equation.fixed.clear();
    }
    task
}

/// Addend of a library's function: the column that it reads. A column that is neither an output nor computed from one
/// counts as an input.
fn addend(function: &Expr, task: &EquationTask) -> Result<Addend, Error> {
    let several = fleetfoot_library::Program::compile(std::slice::from_ref(function), &names(task))
        .is_ok_and(|program| program.leaves().iter().any(|leaf| leaf.lag() != 0));
    if several || !function.filters().is_empty() {
        return Err(Error::value(format!(
            "{given_library}: {FIT_NARX} makes the lags itself; write functions of one row (y, u, y^2) and set the number of lags by {LAGS_OUT} and \
             {LAGS_IN}",
            given_library = LIBRARY.to(function)
        )));
    }
    let outputs = function.columns().iter().any(|name| is_output(name, task));
    let inputs = function.columns().iter().any(|name| !is_output(name, task));
    Ok(Addend { function: function.clone(), outputs, inputs })
}

fn names(task: &EquationTask) -> Vec<&str> {
    task.columns.iter().map(|column| column.name.as_str()).collect()
}

fn is_output(name: &str, task: &EquationTask) -> bool {
    task.columns.iter().any(|column| column.name == name && column.role == Role::State)
}
