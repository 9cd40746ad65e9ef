//! Pairs of regions that have the same map: the likelihood ratio of two maps against one.

use std::collections::BTreeMap;

use fleetfoot_data::{Silent, parallel_map};
use fleetfoot_model::{RegionPair, Transitions};
use fleetfoot_stats::{Gram, Leftover, Preconditioner, same_coefficients};

use crate::Error;

/// Regions, and columns of a Gram matrix, up to which all pairs are compared; of more those that pass rows to each other.
const ALL_REGIONS: usize = 64;
const ALL_COLUMNS: usize = 200;

/// Compares the regions of some Gram matrices (regions without rows are missing), pair by pair, ascending.
/// `independent`: the share of the rows that counts as independent. If regions are equally noisy, the diagonal of this
/// comparison is the error growth by which cells of a lattice are joined.
///
/// # Errors
/// Cancelled.
pub(crate) fn pairs(
    regions: &BTreeMap<u32, Gram>,
    transitions: &Transitions,
    preconditioner: &Preconditioner,
    independent: f64,
) -> Result<Vec<RegionPair>, Error> {
    let all = regions.len() <= ALL_REGIONS && preconditioner.dimension() <= ALL_COLUMNS;
    let passes = |from: u32, to: u32| transitions.counts[from as usize][to as usize] > 0;
    let seen: Vec<(u32, &Gram)> = regions.iter().map(|(&region, gram)| (region, gram)).collect();
    let leftovers: Vec<Leftover> =
        parallel_map(seen.len(), &Silent, |at| Ok::<_, Error>(preconditioner.leftover(seen[at].1)))?;
    let tests: Vec<[usize; 2]> = (0..seen.len())
        .flat_map(|a| (a + 1..seen.len()).map(move |b| [a, b]))
        .filter(|&[a, b]| all || passes(seen[a].0, seen[b].0) || passes(seen[b].0, seen[a].0))
        .collect();
    parallel_map(tests.len(), &Silent, |at| {
        let [a, b] = tests[at];
        let test =
            same_coefficients(preconditioner, [seen[a].1, seen[b].1], [&leftovers[a], &leftovers[b]], independent);
        let (statistic, freedom, p) =
            test.map_or((f64::NAN, 0, f64::NAN), |test| (test.statistic, test.freedom, test.p));
        Ok(RegionPair { regions: [seen[a].0, seen[b].0], statistic, freedom, p })
    })
}
