//! The regions of all rows of a source.

use fleetfoot_data::setting::{FIT_NARX, FIT_PWA};
use fleetfoot_data::{Progress, Source};
use fleetfoot_model::Partition;
use fleetfoot_pwa::{Options, Problem, Specification};

use crate::error::Error;

/// Default options of the clustering, with a seed.
pub(crate) fn clustering(seed: u64) -> Options {
    let mut options = Options::default();
    options.seed = seed;
    options
}

/// The regions of all rows of a source, found as the options say.
///
/// # Errors
/// Those of reading; more regions than rows.
pub(crate) fn regions(
    problem: &Problem,
    specification: Specification,
    mut options: Options,
    source: &dyn Source,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Partition, Error> {
    if specification.fits_targets() {
        notes.push(format!(
            "{specification}: its regions were fitted to all of these rows, so held-out errors within them are too small; {FIT_PWA} and {FIT_NARX} on logs make new regions for every fold"
        ));
    }
    options.partitions = vec![specification];
    let mut partitions = fleetfoot_pwa::partition(problem, &options, source, progress)?;
    notes.append(&mut partitions.notes);
    Ok(partitions.partitions.pop().map_or_else(Partition::whole, |(_, partition)| partition))
}
