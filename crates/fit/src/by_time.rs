//! Rows held out by time: the last of the recording, which no span beside them trained.
//!
//! Spans that are held out in turn have neighbours on both sides, and a motion that repeats or drifts is in those too. The end of a recording has none behind it.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Baseline, Error as DynamicsError, ScoreOptions, TargetScore, score};
use serde::Serialize;

use crate::{
    error::Error,
    method::{Data, Method},
    spans::Spans,
};

/// One row in so many is held out, the last ones.
const SHARE: usize = 5;

/// Errors one step ahead on the last rows, of the chosen model fitted to the rows before them.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ByTime {
    /// Rows that were held out.
    pub rows: u64,
    /// The fitted equations.
    pub targets: Vec<TargetByTime>,
}

/// The errors of one equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TargetByTime {
    /// The left side of the equation.
    pub target: String,
    /// Root mean squared error.
    pub rmse: f64,
    /// Squared error over that of the mean of the training rows.
    pub share: f64,
}

impl TargetByTime {
    fn new(target: &TargetScore) -> Self {
        let mean = target.baselines.iter().find(|own| own.baseline == Baseline::Null).map_or(f64::NAN, |own| own.rmse);
        Self { target: target.name.clone(), rmse: target.rmse, share: (target.rmse / mean).powi(2) }
    }
}

impl ByTime {
    /// The errors beside those of spans that were held out in turn, each a share of the squared error of the mean, and the worse of both.
    pub fn in_words(&self, by_spans: impl Fn(&str) -> Option<f64>) -> String {
        let told = |own: &TargetByTime| match by_spans(&own.target).filter(|share| share.is_finite()) {
            Some(spans) => {
                let worse = short(own.share.max(spans));
                format!("{} {} (spans {}; the worse {worse})", own.target, short(own.share), short(spans))
            }
            None => format!("{} {}", own.target, short(own.share)),
        };
        format!(
            "held out by time, the last {} rows, squared error over that of the mean: {}",
            self.rows,
            self.targets.iter().map(told).collect::<Vec<_>>().join(", ")
        )
    }
}

/// Three digits.
fn short(share: f64) -> String {
    if (1e-3..1e3).contains(&share) { format!("{share:.3}") } else { format!("{share:.1e}") }
}

/// The errors of the chosen model on the last rows; `None` where those before them are too few to fit it.
pub(crate) fn by_time<M: Method>(
    method: &M,
    data: Data<'_, M::Task>,
    found: &M::Found,
    smoothed: usize,
    progress: &dyn Progress,
) -> Result<Option<ByTime>, Error> {
    let rows = data.rows()?;
    let (train, test) = Spans::last(rows, SHARE, smoothed)?;
    let Some(model) = method.held_out_by_time(Data { rows: Some(&train), kept: None, ..data }, found, progress) else {
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
