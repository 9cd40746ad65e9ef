//! A pass over all rows for the borders of regions that were refined on a sample. Some ten thousand rows determine
//! separators and maps well. The side of a border on which a row lies depends on the rows beside it, all of them.

use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::{Chunk, scan::scan};

use crate::{
    Error,
    refined::{Near, Open},
    rows::{Rows, Tile},
    segmentation::Segmentation,
};

/// Draws the borders that are open, of all partitions and folds, in one pass.
///
/// # Errors
/// Those of reading; cancelled.
pub(crate) fn close(
    rows: &Rows,
    segmentation: &mut Segmentation,
    source: &dyn Source,
    chunks: &[Chunk],
    progress: &dyn Progress,
) -> Result<(), Error> {
    let open: Vec<(usize, Open)> = std::mem::take(&mut segmentation.open);
    if open.is_empty() {
        return Ok(());
    }
    progress.stage("borders");
    let shape = (rows.partition, rows.regressors, rows.targets);
    // Rows, and their weight.
    let begin = || open.iter().map(|(_, open)| (open.begin(), 0.0)).collect::<Vec<(Near, f64)>>();
    let mut all = begin();
    let given = &*segmentation;
    scan(
        &rows.columns,
        source,
        chunks,
        progress,
        begin,
        |part, place, tile| {
            let tile = Tile::new(tile);
            let columns = tile.example();
            let weight = tile.weights().map_or(tile.len() as f64, |weights| weights.iter().sum());
            for ((near, total), (at, open)) in part.iter_mut().zip(&open) {
                let held = given.sets[*at].checked_sub(1);
                if held.is_none_or(|fold| place.chunk.fold.trains(fold as u16)) {
                    let partition = &given.partitions[*at];
                    let units = (partition.centre.as_slice(), partition.scale.as_slice());
                    open.gather(near, &columns[..rows.example_width()], shape, units);
                    *total += weight;
                }
            }
            Ok::<_, Error>(())
        },
        |_, _, part| {
            for ((near, total), (more, weight)) in all.iter_mut().zip(part) {
                near.merge(more);
                *total += weight;
            }
            Ok(())
        },
    )?;
    for ((at, open), (near, weight)) in open.into_iter().zip(all) {
        segmentation.partitions[at].rule = open.closed(&near, weight);
    }
    Ok(())
}
