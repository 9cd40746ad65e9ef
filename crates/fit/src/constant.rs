//! Targets that do not vary: any model is perfect on them, so that a log of nothing looks like a success.

use fleetfoot_stats::Gram;
use fleetfoot_task::EquationTask;

use crate::error::Error;

/// Refuses the fitted equations of a task whose target has one value in all rows; `moments` begin with the targets. A rate that is constant and not zero is fine: its
/// state varies.
///
/// # Errors
/// The target and its value, as in `fit pwa`.
pub(crate) fn refuse_constant_targets(task: &EquationTask, moments: &Gram) -> Result<(), Error> {
    let is_rest = |at: usize| moments.is_constant(at) && !(task.is_rate(at) && moments.mean[at] != 0.0);
    match (0..task.fitted.len()).find(|&at| is_rest(at)) {
        Some(at) => Err(constant_target(&task.fitted[at].label, moments.mean[at])),
        None => Ok(()),
    }
}

/// A target that has this value in all rows.
pub(crate) fn constant_target(target: &str, value: f64) -> Error {
    fleetfoot_pwa::Error::ConstantTarget { target: target.to_owned(), value }.into()
}
