//! A recipe resolved to an autoregression: the equations of the outputs one row ahead, over the lags of outputs and inputs.

use fleetfoot_library::Expr;
use fleetfoot_model::Role;
use fleetfoot_sparse::NarxLibrary;

use super::NarxOptions;
use crate::{EquationTask, Error, Recipe, task::seen};

/// The equations `next(y) = f(lags)` of a recipe's states.
#[derive(Debug, Clone)]
pub(crate) struct NarxTask {
    /// The system with all candidates of the largest order.
    pub(crate) task: EquationTask,
    /// Which of them a smaller order has.
    pub(crate) library: NarxLibrary,
}

/// The recipe as `fit sindy` reads it, the library left to [`NarxTask::new`].
pub(crate) fn one_row_ahead(recipe: &Recipe, options: &NarxOptions) -> Result<Recipe, Error> {
    let refuse = |what: &str, mend: &str| Err(Error::Request(format!("{what}: {mend}")));
    if !recipe.library.functions.is_empty()
        || recipe.states.values().any(|s| s.library.is_some() || !s.fixed.is_empty())
    {
        return refuse(
            "the recipe has a library",
            "`fit narx` makes its own of lags (lags_out, lags_in, degree); give a function of an input as an input, `s = \"sign(v)\"`, or run `fit sindy` with \
             --predict next",
        );
    }
    if !recipe.parameters.is_empty() {
        return refuse("the recipe has [parameters]", "they are estimated by `fit sindy`; put numbers in their place");
    }
    match recipe.model.predict.as_deref() {
        None | Some("next") => {}
        Some(other) => {
            return refuse(
                &format!("--predict {other}"),
                "an autoregression gives the next value of its outputs; leave it away, or run `fit sindy`",
            );
        }
    }
    if recipe.model.lags.is_some() {
        return refuse("--lags", "say how far back outputs and inputs go by --lags-out and --lags-in");
    }
    if recipe.states.is_empty() {
        return refuse("no outputs", "name them in the recipe ([states]) or with --outputs");
    }
    let mut recipe = recipe.clone();
    // Of several partitions only a label has to be known there: it is one more column.
    recipe.model.partition = options.partitions.iter().find(|p| p.label().is_some()).map(ToString::to_string);
    recipe.model.predict = Some("next".into());
    recipe.library.functions = vec!["1".into()];
    Ok(recipe)
}

impl NarxTask {
    /// Lays the candidates of the largest order out over the outputs and inputs of a task whose library is the constant.
    pub(crate) fn new(mut task: EquationTask, recipe: &Recipe, options: &NarxOptions) -> Result<Self, Error> {
        let regressor = |name: &str| recipe.states.get(name).is_none_or(|state| state.regressor != Some(false));
        let of = |role: Role| -> Vec<Expr> {
            task.columns.iter().filter(|column| column.role == role && regressor(&column.name)).flat_map(seen).collect()
        };
        let library = NarxLibrary::new(&of(Role::State), &of(Role::Input), options.order, options.direct)?;
        task.functions = library.functions().to_vec();
        task.constant = true;
        for equation in &mut task.fitted {
            equation.allowed = vec![true; task.functions.len() + 1];
            equation.fixed.clear();
        }
        Ok(Self { task, library })
    }
}
