//! The one pass over the rows behind a page: a reduction over chunks, on all threads. Sums are binned: they do not grow
//! with the rows.

use std::ops::Range;

use fleetfoot_data::{Block, Episode, EpisodeId, Progress, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_dynamics::{Predicted, Predictor, PredictorWorkspace, RowStatus};
use fleetfoot_fit::Error;
use fleetfoot_model::{Model, Transitions};
use fleetfoot_stats::{Chunk, Grid, reduce};

use crate::{
    coverage,
    coverage::Coverage,
    missing::Lost,
    target::{Target, targets},
};

/// Regions whose transitions are counted: a larger map could not be read.
const REGIONS: usize = 64;
/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// Results of a pass over the rows, or over some of them.
#[derive(Clone)]
pub(crate) struct Passed {
    /// The episode that is drawn over time.
    pub(crate) episode: Episode,
    pub(crate) targets: Vec<Target>,
    pub(crate) columns: Vec<Coverage>,
    /// Rows that a missing value takes from the scores.
    pub(crate) lost: Lost,
    /// Transitions between the regions of the first partition, if there are several.
    pub(crate) transitions: Option<Transitions>,
    /// The regions of the first and of the last row.
    ends: Option<[u32; 2]>,
}

/// Memory of a tile.
#[derive(Default)]
struct Tile {
    workspace: PredictorWorkspace,
    predicted: Predicted,
    seconds: Vec<f64>,
}

impl Passed {
    /// Goes over the rows; of the episode with this identity they are drawn over time.
    pub(crate) fn over(
        model: &Model,
        dataset: &Dataset,
        drawn: EpisodeId,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, Error> {
        let Some(episode) = dataset.episodes().iter().find(|episode| episode.id == drawn) else { return Ok(None) };
        let view = dataset.view()?;
        let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
        let predictor = Predictor::new(model, &names)?;
        let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
        let columns = coverage::columns(model, view.columns());
        let nothing = Self::nothing(model, episode, columns, Lost::new(view.episodes()));
        let (mut all, mut before) = (nothing.clone(), None);
        progress.stage("predict");
        reduce(
            &view,
            &chunks,
            predictor.halo(),
            progress,
            || (nothing.clone(), Tile::default()),
            |(part, tile), chunk, block, rows| -> Result<(), Error> {
                predictor.predict(block, rows.clone(), &mut tile.workspace, &mut tile.predicted);
                part.take(chunk.episode, &view.episodes()[chunk.episode], block, rows, tile);
                Ok(())
            },
            |chunk: &Chunk, (part, _)| {
                all.append(&part, before.replace(chunk.episode) == Some(chunk.episode));
                Ok(())
            },
        )?;
        Ok(Some(all))
    }

    /// Before any row.
    fn nothing(model: &Model, episode: &Episode, columns: Vec<Coverage>, lost: Lost) -> Self {
        let regions = model.latents.first().map_or(0, |latent| model.partitions[latent.partition].rule.count());
        let counted = (2..=REGIONS).contains(&regions);
        Self {
            targets: targets(model, episode, &columns),
            episode: episode.clone(),
            columns,
            lost,
            transitions: counted.then(|| Transitions { counts: vec![vec![0; regions]; regions] }),
            ends: None,
        }
    }

    /// Takes the rows of a tile that were predicted last.
    fn take(&mut self, index: usize, episode: &Episode, block: &Block, rows: Range<usize>, tile: &mut Tile) {
        let value = |column: usize| &block.core(column)[rows.clone()];
        let seconds = |row: usize| (block.stamps()[rows.start + row] - episode.start) as f64 * 1e-9;
        let before = self.lost.before(index);
        self.columns.iter_mut().for_each(|column| column.take(value(column.place), |row| before + seconds(row)));
        let predicted = &tile.predicted;
        for row in (0..predicted.rows).filter(|&row| predicted.status[row] == RowStatus::Missing) {
            self.lost.add(index, seconds(row));
        }
        let time = (episode.id == self.episode.id).then(|| {
            let stamps = &block.stamps()[rows.clone()];
            tile.seconds.clear();
            tile.seconds.extend(stamps.iter().map(|&stamp| (stamp - episode.start) as f64 * 1e-9));
            tile.seconds.as_slice()
        });
        for (place, target) in self.targets.iter_mut().enumerate() {
            target.take(place, predicted, time);
            let errors = Predicted::equation(&predicted.residual, predicted.rows, place);
            target.left.take(errors, target.sigma, &self.columns, &value);
        }
        self.follow(&predicted.region);
    }

    /// Counts which region follows which.
    fn follow(&mut self, regions: &[u32]) {
        for &region in regions {
            if let Some([_, last]) = self.ends {
                self.step(last, region);
            }
            self.ends = Some([self.ends.map_or(region, |[first, _]| first), region]);
        }
    }

    fn step(&mut self, from: u32, to: u32) {
        let row = self.transitions.as_mut().and_then(|counted| counted.counts.get_mut(from as usize));
        if let Some(count) = row.and_then(|row| row.get_mut(to as usize)) {
            *count += 1;
        }
    }

    /// Merges the rows behind these; `goes_on`: true if they follow in the same episode.
    fn append(&mut self, other: &Self, goes_on: bool) {
        self.columns.iter_mut().zip(&other.columns).for_each(|(column, other)| column.merge(other));
        self.targets.iter_mut().zip(&other.targets).for_each(|(target, other)| target.append(other, goes_on));
        self.lost.merge(&other.lost);
        if let (Some(transitions), Some(others)) = (&mut self.transitions, &other.transitions) {
            transitions
                .counts
                .iter_mut()
                .flatten()
                .zip(others.counts.iter().flatten())
                .for_each(|(count, other)| *count += other);
        }
        if let (true, Some([_, last]), Some([first, _])) = (goes_on, self.ends, other.ends) {
            self.step(last, first);
        }
        self.ends = match (self.ends, other.ends) {
            (Some([first, _]), Some([_, last])) => Some([first, last]),
            (ends, other) => other.or(ends),
        };
    }
}
