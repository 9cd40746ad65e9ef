//! Row rate, per second, that the samples of channels justify.

use std::path::Path;

use crate::{Error, join::Series};

/// Rows for each sample of the fastest channel at most.
const ROWS_PER_SAMPLE: f64 = 100.0;

impl Series {
    /// Samples a second, by the median step or on average, whichever is more; `None` where no run has two samples.
    pub(crate) fn rate(&self) -> Option<f64> {
        let seconds: f64 = self.runs.iter().map(|run| run.end.abs_diff(run.start) as f64 * 1e-9).sum();
        let steps: usize = self.runs.iter().map(|run| run.rows.len() - 1).sum();
        let mean = (seconds > 0.0).then(|| steps as f64 / seconds);
        let median = self.median_step.filter(|&step| step > 0).map(|step| 1e9 / step as f64);
        mean.into_iter().chain(median).reduce(f64::max)
    }
}

/// Refuses a rate far beyond that of the fastest channel, given by names and samples a second.
pub(crate) fn check_rate<'a>(
    path: &Path,
    hz: f64,
    channels: impl Iterator<Item = (&'a str, Option<f64>)>,
) -> Result<(), Error> {
    let known = channels.filter_map(|(name, rate)| Some((name, rate?)));
    let Some((name, fastest)) = known.max_by(|a, b| a.1.total_cmp(&b.1)) else { return Ok(()) };
    let too_high = hz > ROWS_PER_SAMPLE * fastest;
    if !too_high {
        return Ok(());
    }
    Err(Error::RateTooHigh { path: path.into(), hz, name: name.to_owned(), fastest })
}
