//! Open spans of derivatives, `over = "auto"`: chosen by rollouts of rows that did not train.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_library::Expr;
use fleetfoot_model::Model;
use fleetfoot_recipe::{Derivative, Kind, Recipe};
use fleetfoot_task::EquationTask;

use super::{Frozen, SindyOptions, Solver, coefficients};
use crate::{
    error::Error,
    folds::smoothed_rows,
    rollout_choice::{HeldOut, RolloutCandidate, RolloutChoice, RolloutRule, candidates, open_spans, terms},
    sindy::Evidence,
};

/// Compares the spans that may be, all open states together, on rows that are opened for central differences: equations are found on the training rows of each fold and simulated over the others.
///
/// # Errors
/// Those of the recipe and of finding equations; numbers inside expressions that are to be estimated too; every candidate diverges.
pub(super) fn by_rollouts(
    recipe: &Recipe,
    options: &SindyOptions,
    rule: RolloutRule,
    (dataset, task): (&Dataset, &EquationTask),
    progress: &dyn Progress,
) -> Result<RolloutChoice, Error> {
    if let Some(name) = recipe.parameters.keys().next() {
        return Err(Error::conflict(format!(
            "over = \"auto\" and [parameters] {name}: a span is chosen where all expressions are known; write a number of rows, or a number for {name}"
        )));
    }
    let view = dataset.view()?;
    let held = HeldOut::new((&view, smoothed_rows(recipe.time.smoothed, dataset.step())), rule, "over = \"auto\"")?;
    let mut found = Vec::new();
    for over in candidates(recipe) {
        let task = spanned(task, recipe, over);
        let mut size = 0;
        let errors = held.errors(progress, |train| {
            let model = equations(recipe, &task, options, dataset.step(), train, progress)?;
            size = size.max(terms(&model));
            Ok(vec![model])
        })?;
        let partition = recipe.model.partition.clone().unwrap_or_else(|| "average".into());
        found.extend(errors.into_iter().map(|folds| RolloutCandidate {
            partition: partition.clone(),
            over,
            size,
            folds,
        }));
    }
    RolloutChoice::new(rule, found)
}

/// The equations that some rows give.
pub(super) fn equations(
    recipe: &Recipe,
    task: &EquationTask,
    options: &SindyOptions,
    step: f64,
    rows: &dyn Source,
    progress: &dyn Progress,
) -> Result<Model, Error> {
    let frozen = Frozen { task: task.clone(), parameters: Vec::new() };
    let evidence = Evidence::of_rows(recipe, options.seed, frozen, step, rows, progress)?;
    let mut notes = Vec::new();
    let solver = Solver::new(&evidence, options, false, &mut notes)?;
    let regions: Vec<_> = (0..evidence.scan.regions())
        .map(|region| solver.solve(region, &mut notes, progress))
        .collect::<Result<_, _>>()?;
    let chosen: Vec<_> = regions.iter().map(|region| coefficients(region, |found| &found.step)).collect();
    let provenance = evidence.provenance("sindy", recipe, options.seed);
    Ok(evidence.task.model(&evidence.scan, evidence.partition.as_ref(), &chosen, provenance))
}

/// The task with its open spans settled.
fn spanned(task: &EquationTask, recipe: &Recipe, over: Option<u32>) -> EquationTask {
    let mut task = task.clone();
    for name in open_spans(recipe) {
        let angle = recipe.states.get(&name).is_some_and(|state| state.kind == Some(Kind::Angle));
        let measured = Derivative::settled(&Expr::column(name.as_str()), angle, over);
        let equations = task.equations.iter_mut().filter(|one| one.subject == name && one.target.is_some());
        for equation in equations {
            let latents = equation.right.columns();
            let own = task.fitted.iter_mut().find(|own| latents.iter().any(|latent| **latent == *own.latent));
            let Some(own) = own else { continue };
            own.measure(measured.clone());
            equation.target = Some(measured.clone());
            if over.is_some() {
                (own.central, own.difference) = (None, None);
            }
            own.label = equation.label();
        }
    }
    task
}
