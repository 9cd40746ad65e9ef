//! Fits that a statistic can serve.

use fleetfoot_data::setting::PARTITION;
use fleetfoot_dataset::StatisticFile;

use crate::{narx, pwa};

/// Fits that need no logs, for people: the methods, each with its regions.
pub fn serves(file: &StatisticFile) -> Vec<String> {
    let mut methods = vec!["fit sparse".to_owned()];
    let mut add = |method: &str, regions: Vec<String>| {
        if !regions.is_empty() {
            methods.push(format!("fit {method} ({})", PARTITION.to(regions.join(" | "))));
        }
    };
    let groups = file.equations.iter().flat_map(|equations| &equations.groups);
    let mut regions: Vec<String> = Vec::new();
    for group in groups {
        if !regions.iter().any(|known| known == group.name()) {
            regions.push(group.name().to_owned());
        }
    }
    add("sindy", regions);
    add("pwa", pwa::served(file));
    add("narx", narx::served(file));
    methods
}
