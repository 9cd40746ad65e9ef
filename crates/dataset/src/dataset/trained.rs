//! Rows that trained the model which the logs were opened for.

use std::{
    collections::{BTreeSet, HashSet},
    sync::atomic::Ordering,
};

use fleetfoot_data::{Halo, Progress, Source, Watch, Watched, parallel_fold};
use fleetfoot_model::Model;

use super::Dataset;
use crate::{blocks::blocks, error::Error};

impl Dataset {
    /// The episodes, by number, that the model was trained on, as a whole or in part. Parts are known once all rows have been read through
    /// [`Dataset::view`], or have been searched ([`Dataset::search`]).
    pub fn trained(&self, model: &Model) -> BTreeSet<usize> {
        let trained: HashSet<&str> = model.training.episodes.iter().map(|known| known.id.as_str()).collect();
        let whole = |episode: &usize| trained.contains(self.episodes()[*episode].id.to_string().as_str());
        let parts = self.watch.iter().flat_map(Watch::seen);
        (0..self.episodes().len()).filter(whole).chain(parts).collect()
    }

    /// Names of the episodes that the model was trained on, as a whole or in part; parts are known once all rows have been read through [`Dataset::view`].
    pub fn in_sample(&self, model: &Model) -> Vec<String> {
        self.trained(model).into_iter().map(|episode| self.episodes()[episode].name.clone()).collect()
    }

    /// Every row has been read through [`Dataset::view`].
    pub fn all_were_read(&self) {
        self.searched.store(true, Ordering::Relaxed);
    }

    /// Looks at every row for those that trained the model, where that has not been done: who reads some rows only does not know what logs they are of.
    ///
    /// # Errors
    /// Those of reading.
    pub fn search(&self, progress: &dyn Progress) -> Result<(), Error> {
        let Some(watch) = self.watch.as_ref().filter(|_| !self.searched.load(Ordering::Relaxed)) else {
            return Ok(());
        };
        progress.stage("training rows");
        let rows = Watched::new(&self.source, Some(watch));
        let pieces = blocks(&rows);
        let read = |piece: usize| {
            let (episode, range) = pieces[piece].clone();
            rows.read(episode, range, Halo::default()).map(drop).map_err(Error::from)
        };
        parallel_fold(pieces.len(), progress, read, |()| Ok(()))?;
        self.all_were_read();
        Ok(())
    }
}
