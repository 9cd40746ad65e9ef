//! The pilot sample: rows that fix a pass's coordinates before it begins.

use std::ops::Range;

use faer::MatRef;
use fleetfoot_data::{Block, Episode, Error, Halo, Source, sample_ranges};
use fleetfoot_library::DesignRows;

use super::{Columns, RowError};
use crate::{Preconditioner, TILE_ROWS};

/// Rows of the sample, and of one of its runs.
const ROWS: usize = 20_000;
const RUNS: usize = 64;
/// Numbers of a sample that a factor is made of, where its columns are few beside its rows.
const VALUES: usize = 2_000_000;

/// Hands on a strided sample of some 20,000 rows of a source, tile by tile in order: the episode, a block that was read, and the range of its core rows that is
/// the tile.
///
/// # Errors
/// Those of reading and of `take`.
pub fn pilot_tiles<E: From<Error>>(
    source: &dyn Source,
    halo: Halo,
    mut take: impl FnMut(&Episode, &Block, Range<usize>) -> Result<(), E>,
) -> Result<(), E> {
    for (episode, range) in sample_ranges(source.episodes(), ROWS, RUNS) {
        let block = source.read(episode, range, halo)?;
        for from in (0..block.rows).step_by(TILE_ROWS) {
            take(&source.episodes()[episode], &block, from..(from + TILE_ROWS).min(block.rows))?;
        }
    }
    Ok(())
}

impl Columns {
    /// The columns of neighbouring groups on the complete rows of the pilot, one vector a column.
    ///
    /// # Errors
    /// Those of reading, and of values that cannot be summed.
    pub fn pilot<E>(&self, groups: Range<usize>, source: &dyn Source) -> Result<Vec<Vec<f64>>, E>
    where
        E: From<Error> + From<RowError>,
    {
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); self.width(groups.clone())];
        let mut rows = DesignRows::default();
        pilot_tiles(source, self.halo(), |episode, block, range| {
            let tile = self.evaluate(block, episode, range, &mut rows)?;
            let columns = tile.columns(groups.clone());
            values.iter_mut().zip(columns).for_each(|(all, some)| all.extend_from_slice(some));
            Ok::<_, E>(())
        })?;
        Ok(values)
    }
}

impl Preconditioner {
    /// Of a pilot's columns, the first of which are regressors. A factor costs rows x columns^2: the more columns, the fewer rows, but always several times their
    /// number.
    pub fn of_pilot(columns: &[Vec<f64>], regressors: usize) -> Self {
        let d = columns.len();
        let wanted = (VALUES / d.max(1)).max(4 * d).min(ROWS);
        let stride = columns.first().map_or(0, Vec::len).div_ceil(wanted).max(1);
        let joined: Vec<f64> = columns.iter().flat_map(|column| column.iter().step_by(stride).copied()).collect();
        Self::from_pilot(MatRef::from_column_major_slice(&joined, joined.len() / d.max(1), d), regressors)
    }
}
