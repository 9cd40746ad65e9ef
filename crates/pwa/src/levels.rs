//! Description, in a model, of the tree of which its regions are a level.

use fleetfoot_model::{Join, Lattice, Level};

use crate::{lattice::Tree, select::Order};

/// Description of the tree of which a model's regions are a level: the joins that follow, and the levels that were
/// tried. `weight`: weight of the rows.
pub(crate) fn described(tree: &Tree, regions: usize, tried: &[&Order], (weight, targets): (f64, usize)) -> Lattice {
    let table = tree.regions(regions);
    let scaled = |error: f64| error / (weight * targets as f64);
    let mut levels: Vec<Level> = tried
        .iter()
        .map(|order| Level {
            regions: order.full.len(),
            training: scaled(tree.error(order.full.len())),
            held_out: order.loss,
            standard_error: order.standard_error,
            bic: order.bic,
        })
        .collect();
    levels.sort_by_key(|level| level.regions);
    levels.dedup_by_key(|level| level.regions);
    let place = |region: u32| table[region as usize];
    let joins = tree.joins(regions).iter();
    let joins = joins.map(|join| Join { kept: place(join.kept), gone: place(join.gone), training: scaled(join.error) });
    Lattice { joins: joins.collect(), levels }
}
