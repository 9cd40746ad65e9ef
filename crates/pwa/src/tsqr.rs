//! The regression by TSQR: R factors of the rows themselves, region by region, merged by QR of the stack.
//!
//! About four times the work of the Gram matrix, and no squaring: the accuracy does not depend on how representative the pilot was.

use std::collections::BTreeMap;

use faer::MatRef;
use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::{Chunk, Factor, SquareRoot, scan::scan};

use crate::{
    Error,
    assignment::Assigner,
    rows::{Rows, Tile},
    segmentation::Segmentation,
};

#[derive(Default)]
struct Part {
    factors: BTreeMap<u32, Factor>,
    regions: Vec<u32>,
    gathered: Vec<f64>,
    weights: Vec<f64>,
}

/// Square-root forms of the regions of one partition, from all rows.
pub(crate) fn factor_regions(
    rows: &Rows,
    segmentation: &Segmentation,
    partition: usize,
    source: &dyn Source,
    chunks: &[Chunk],
    progress: &dyn Progress,
) -> Result<BTreeMap<u32, SquareRoot>, Error> {
    let assigner = Assigner::new(segmentation);
    let mut total: BTreeMap<u32, Factor> = BTreeMap::new();
    scan(
        &rows.columns,
        source,
        chunks,
        progress,
        Part::default,
        |part, _, tile| {
            let tile = Tile::new(tile);
            assigner.on(&tile).assign(partition, &mut part.regions);
            let n = tile.len();
            let mut present: Vec<u32> = part.regions.iter().copied().filter(|&region| region != u32::MAX).collect();
            present.sort_unstable();
            present.dedup();
            for region in present {
                let members: Vec<usize> = (0..n).filter(|&row| part.regions[row] == region).collect();
                part.gathered.clear();
                for column in tile.regression().chunks_exact(n) {
                    part.gathered.extend(members.iter().map(|&row| column[row]));
                }
                let weights = tile.weights().map(|weights| {
                    part.weights.clear();
                    part.weights.extend(members.iter().map(|&row| weights[row]));
                    part.weights.as_slice()
                });
                let matrix = MatRef::from_column_major_slice(&part.gathered, members.len(), rows.dimension());
                let factor = part.factors.entry(region).or_insert_with(|| Factor::new(rows.regressors, rows.targets));
                factor.push(matrix, weights);
            }
            Ok::<_, Error>(())
        },
        |_, _, part| {
            for (region, factor) in part.factors {
                match total.entry(region) {
                    std::collections::btree_map::Entry::Occupied(mut sum) => sum.get_mut().merge(&factor),
                    std::collections::btree_map::Entry::Vacant(slot) => {
                        slot.insert(factor);
                    }
                }
            }
            Ok(())
        },
    )?;
    Ok(total.into_iter().map(|(region, factor)| (region, factor.square_root())).collect())
}
