//! The one pass over the rows that a page is drawn of. What is kept of them is binned: it does not grow with them.

use fleetfoot_data::{Episode, EpisodeId, Progress};
use fleetfoot_dynamics::Predicted;
use fleetfoot_model::{Model, Transitions};

use super::{
    coverage::{self, Coverage},
    logs::Seen,
    series::{self, Target},
};
use crate::{Error, Logs, PredictedRows, Recipe, predict_rows};

/// Regions whose transitions are counted: of more there is no map that one could read.
const REGIONS: usize = 64;

/// What a pass over the rows saw.
pub(super) struct Passed {
    /// The episode that is drawn over time.
    pub(super) episode: Episode,
    pub(super) targets: Vec<Target>,
    pub(super) columns: Vec<Coverage>,
    /// Which region of the first partition followed which, where there are several.
    pub(super) transitions: Option<Transitions>,
    /// The region of the last row, and its episode.
    last: Option<(EpisodeId, u32)>,
}

impl Passed {
    /// Goes over the rows; of the episode with this identity they are drawn over time.
    pub(super) fn over(
        model: &Model,
        changes: &Recipe,
        logs: &Logs,
        drawn: EpisodeId,
        seen: &Seen,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, Error> {
        let Some(episode) = seen.episodes.iter().find(|episode| episode.id == drawn) else { return Ok(None) };
        let regions = model.latents.first().map_or(0, |latent| model.partitions[latent.partition].rule.count());
        let counted = (2..=REGIONS).contains(&regions);
        let mut passed = Self {
            episode: episode.clone(),
            targets: series::targets(model, episode.rows),
            columns: Vec::new(),
            transitions: counted.then(|| Transitions { counts: vec![vec![0; regions]; regions] }),
            last: None,
        };
        predict_rows(model, changes, logs, progress, |_, rows| {
            passed.take(model, rows);
            Ok(())
        })?;
        Ok(Some(passed))
    }

    fn take(&mut self, model: &Model, rows: &PredictedRows<'_>) {
        if self.columns.is_empty() {
            self.columns = coverage::columns(model, rows.columns);
            self.targets.iter_mut().for_each(|target| target.left.meet(&self.columns));
        }
        self.columns.iter_mut().for_each(|column| column.take(rows.block.core(column.place)));
        let goes_on = self.last.is_some_and(|(episode, _)| episode == rows.episode.id);
        let time = (rows.episode.id == self.episode.id).then(|| seconds(rows));
        for (place, target) in self.targets.iter_mut().enumerate() {
            target.take(place, rows.predicted, time.as_deref());
            let residual = Predicted::equation(&rows.predicted.residual, rows.predicted.rows, place);
            target.left.take(residual, target.sigma, &self.columns, rows.block, goes_on);
        }
        self.follow(rows.episode.id, &rows.predicted.region);
    }

    /// Counts which region follows which.
    fn follow(&mut self, episode: EpisodeId, regions: &[u32]) {
        for &region in regions {
            if let (Some(counted), Some((before, from))) = (&mut self.transitions, self.last)
                && before == episode
                && let Some(count) = counted.counts.get_mut(from as usize).and_then(|row| row.get_mut(region as usize))
            {
                *count += 1;
            }
            self.last = Some((episode, region));
        }
    }
}

/// Seconds since the start of the episode.
fn seconds(rows: &PredictedRows<'_>) -> Vec<f64> {
    rows.stamps.iter().map(|&stamp| (stamp - rows.episode.start) as f64 * 1e-9).collect()
}
