//! Some of a source's episodes as a source.

use std::ops::Range;

use fleetfoot_data::{Block, Column, Episode, Error, Halo, Source};

/// Some of a source's episodes.
pub(crate) struct Subset<'a> {
    inner: &'a dyn Source,
    places: Vec<usize>,
    episodes: Vec<Episode>,
}

impl<'a> Subset<'a> {
    pub(crate) fn new(inner: &'a dyn Source, places: Vec<usize>) -> Self {
        let episodes = places.iter().map(|&episode| inner.episodes()[episode].clone()).collect();
        Self { inner, places, episodes }
    }
}

impl Source for Subset<'_> {
    fn columns(&self) -> &[Column] {
        self.inner.columns()
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        self.inner.read(self.places[episode], rows, halo)
    }
}
