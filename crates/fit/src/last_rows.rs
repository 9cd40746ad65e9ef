//! The chosen model fitted once more without the last rows, and its errors there.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Error as DynamicsError, ScoreOptions, score};

use crate::{
    by_time::{ByTime, TargetByTime},
    error::Error,
    method::{Data, Method},
    spans::Spans,
};

/// One row in so many is held out, the last ones.
const SHARE: usize = 5;

/// The errors of the chosen model on the last rows; `None` where those before them are too few to fit it.
pub(crate) fn by_time<M: Method>(
    method: &M,
    data: Data<'_, M::Task>,
    solution: &M::Solution,
    smoothed: usize,
    progress: &dyn Progress,
) -> Result<Option<ByTime>, Error> {
    let rows = data.rows()?;
    let (train, test) = Spans::last(rows, SHARE, smoothed)?;
    let Some(model) = method.held_out_by_time(Data { rows: Some(&train), kept: None, ..data }, solution, progress)
    else {
        return Ok(None);
    };
    let model = match model {
        Ok(model) => model,
        Err(error @ Error::Cancelled(_)) => return Err(error),
        Err(_) => return Ok(None),
    };
    let scores = match score(&model, &test as &dyn Source, &ScoreOptions::default(), progress) {
        Ok(scores) => scores,
        Err(error @ DynamicsError::Data(_)) => return Err(error.into()),
        Err(_) => return Ok(None),
    };
    let targets = scores.targets.iter().map(TargetByTime::new).collect();
    Ok((scores.rows > 0).then_some(ByTime { rows: scores.rows, targets }))
}
