//! One-step and free-run scores of an autoregression.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{FreeRun, FreeRunOptions, ScoreOptions, Scores, free_run, score};
use fleetfoot_model::Model;

use crate::error::Error;

/// Scores on some rows.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct NarxScores {
    /// One row ahead, beside the null model and persistence.
    pub one_step: Scores,
    /// Whole episodes, simulated.
    pub free_run: FreeRun,
}

/// One-step and free-run scores; `None` where no row can be scored.
pub(super) fn scores(model: &Model, source: &dyn Source, progress: &dyn Progress) -> Result<Option<NarxScores>, Error> {
    let free_run = match free_run(model, source, &FreeRunOptions::default(), progress) {
        Ok(free_run) => free_run,
        Err(fleetfoot_dynamics::Error::NoCompleteRow { .. }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let one_step = score(model, source, &ScoreOptions::default(), progress)?;
    Ok((one_step.rows > 0).then_some(NarxScores { one_step, free_run }))
}
