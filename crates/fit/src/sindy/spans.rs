//! Open spans of derivatives, `over = "auto"`, settled.

use fleetfoot_library::Expr;
use fleetfoot_recipe::{Derivative, Kind, Recipe};
use fleetfoot_task::EquationTask;

use crate::rollout_choice::open_spans;

/// The task with its open spans settled.
pub(super) fn spanned(task: &EquationTask, recipe: &Recipe, over: Option<u32>) -> EquationTask {
    let mut task = task.clone();
    for name in open_spans(recipe) {
        let angle = recipe.states.get(&name).is_some_and(|state| state.kind == Some(Kind::Angle));
        let measured = Derivative::settled(&Expr::column(name.as_str()), angle, over);
        let equations = task.equations.iter_mut().filter(|one| one.subject == name && one.target.is_some());
        for equation in equations {
            let latents = equation.right.columns();
            let fitted =
                task.fitted.iter_mut().find(|candidate| latents.iter().any(|latent| **latent == *candidate.latent));
            let Some(fitted) = fitted else { continue };
            fitted.measure(measured.clone());
            equation.target = Some(measured.clone());
            if over.is_some() {
                (fitted.central, fitted.difference) = (None, None);
            }
            fitted.label = equation.label();
        }
    }
    task
}
