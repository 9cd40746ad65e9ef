//! A bounded sample of the rows: the beginnings of episodes, in memory.

use fleetfoot_data::{Halo, Progress, Source};
use fleetfoot_dataset::Error;

use crate::Channel;

/// Rows of a stretch, and numbers of all stretches, at most.
const STRETCH: usize = 20_000;
const NUMBERS: usize = 1 << 23;
/// One of so many values may be a gross error.
const OUTERMOST: usize = 100;
/// Deviation of a change from multiples of a step, in steps, by rounding.
const ROUNDING: f64 = 0.1;

/// Stretches of consecutive rows.
pub(crate) struct Sample {
    pub(crate) stretches: Vec<Stretch>,
}

/// Consecutive rows of an episode.
pub(crate) struct Stretch {
    /// Seconds since the first row.
    pub(crate) time: Vec<f64>,
    /// Values by channel.
    pub(crate) columns: Vec<Vec<f64>>,
}

impl Sample {
    /// Reads the beginnings of episodes, the longest first.
    pub(crate) fn read(view: &dyn Source, channels: &[Channel], progress: &dyn Progress) -> Result<Self, Error> {
        progress.stage("sample");
        let mut order: Vec<usize> = (0..view.episodes().len()).collect();
        order.sort_by_key(|&at| std::cmp::Reverse(view.episodes()[at].rows));
        let mut left = (NUMBERS / channels.len().max(1)).max(1);
        let mut stretches = Vec::new();
        for at in order {
            let rows = view.episodes()[at].rows.min(STRETCH).min(left);
            if rows < 2 || progress.cancelled() {
                break;
            }
            let block = view.read(at, 0..rows, Halo::default())?;
            let start = block.stamps()[0];
            stretches.push(Stretch {
                time: block.stamps().iter().map(|stamp| (stamp - start) as f64 * 1e-9).collect(),
                columns: channels.iter().map(|channel| block.core(channel.place).to_vec()).collect(),
            });
            left -= rows;
        }
        Ok(Self { stretches })
    }

    /// Seconds between rows, in the median.
    pub(crate) fn period(&self) -> f64 {
        let steps = self.stretches.iter().flat_map(|stretch| stretch.time.windows(2).map(|pair| pair[1] - pair[0]));
        let mut steps: Vec<f64> = steps.collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// The step of a channel from row to row that four of five steps do not exceed: rests and gross errors do not
    /// affect it. NaN without two rows that have values.
    pub(crate) fn usual_step(&self, channel: usize) -> f64 {
        let mut steps: Vec<f64> = self.steps(channel).collect();
        if steps.is_empty() {
            return f64::NAN;
        }
        let place = steps.len() * 4 / 5;
        *steps.select_nth_unstable_by(place, f64::total_cmp).1
    }

    /// The width of a channel's range without the least and the greatest hundredth of its values, at least one each:
    /// single gross errors do not affect it. NaN of fewer than three values.
    pub(crate) fn usual_span(&self, channel: usize) -> f64 {
        let values = self.stretches.iter().flat_map(|stretch| &stretch.columns[channel]).copied();
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        let rest = (values.len() / OUTERMOST).max(1);
        if values.len() < 2 * rest + 1 {
            return f64::NAN;
        }
        let last = values.len() - 1 - rest;
        let mut at = |place: usize| *values.select_nth_unstable_by(place, f64::total_cmp).1;
        at(last) - at(rest)
    }

    /// The step of the grid on which the values of a channel lie: nearly all changes are multiples of the median
    /// change, which one step is. `None` of values without a grid, or that skip its levels, as targets do.
    pub(crate) fn grid(&self, channel: usize) -> Option<f64> {
        let mut changes: Vec<f64> = self.steps(channel).filter(|step| *step > 0.0).collect();
        if changes.is_empty() {
            return None;
        }
        let middle = changes.len() / 2;
        let step = *changes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let is_off = |change: &&f64| (*change / step - (*change / step).round()).abs() > ROUNDING;
        (changes.iter().filter(is_off).count() <= changes.len() / OUTERMOST).then_some(step)
    }

    /// Absolute changes of a channel from row to row.
    fn steps(&self, channel: usize) -> impl Iterator<Item = f64> {
        let steps = move |stretch: &Stretch| {
            stretch.columns[channel].windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect::<Vec<_>>()
        };
        self.stretches.iter().flat_map(steps).filter(|step| step.is_finite())
    }
}
