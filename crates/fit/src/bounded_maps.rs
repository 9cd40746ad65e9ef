//! Contraction and passivity of the maps of piecewise-affine models, for texts, JSON and report pages.

use fleetfoot_pwa::{PassiveRegion, Passivity, Score, Stability, StableRegion};
use fleetfoot_report::words::{number, ratio};
use serde::{Deserialize, Serialize};

use crate::text_table::TextTable;

/// Contraction of the maps of a partition's regions in one metric, before and after bounding; one number a region.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BoundedMaps {
    /// The bound of the norms over one sampling period.
    pub bound: f64,
    /// Variables that the maps advance by one sampling period.
    pub variables: Vec<String>,
    /// States that act as inputs.
    pub inputs: Vec<String>,
    /// The metric by rows, in the units of the variables.
    pub metric: Vec<f64>,
    /// Regions whose maps had to move.
    pub moved: usize,
    /// Spectral radii of the free maps.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub free_radii: Vec<f64>,
    /// Their norms.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub free_norms: Vec<f64>,
    /// Spectral radii of the maps that are written.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub radii: Vec<f64>,
    /// Their norms: at most the bound.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub norms: Vec<f64>,
    /// Relative duality gaps.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub gaps: Vec<f64>,
    /// Energy gain of the maps at their ports; `None` unless they are passive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passivity: Option<PassiveMaps>,
}

/// Energy gain of the maps of a partition's regions at their ports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PassiveMaps {
    /// The ports.
    pub ports: Vec<PassivePort>,
    /// Norms of the free maps: the energy that they give, over the allowed energy.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub free_norms: Vec<f64>,
    /// Those of the maps that are written: at most 1.
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    pub norms: Vec<f64>,
}

/// A port at which maps are passive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PassivePort {
    /// The input.
    pub input: String,
    /// The state with which it is a power.
    pub state: String,
    /// Allowed energy gain per sample.
    pub shortage: Option<f64>,
}

impl From<&Stability> for BoundedMaps {
    fn from(stability: &Stability) -> Self {
        let each = |of: fn(&StableRegion) -> f64| stability.regions.iter().map(of).collect();
        Self {
            bound: stability.bound,
            variables: stability.variables.clone(),
            inputs: stability.inputs.clone(),
            metric: stability.metric.clone(),
            moved: stability.moved(),
            free_radii: each(|one| one.free_radius),
            free_norms: each(|one| one.free_norm),
            radii: each(|one| one.radius),
            norms: each(|one| one.norm),
            gaps: each(|one| one.gap),
            passivity: stability.passivity.as_ref().map(PassiveMaps::from),
        }
    }
}

impl From<&Passivity> for PassiveMaps {
    fn from(passivity: &Passivity) -> Self {
        let port = |port: &fleetfoot_pwa::Port| PassivePort {
            input: port.input.clone(),
            state: port.output.clone(),
            shortage: port.shortage,
        };
        let each = |of: fn(&PassiveRegion) -> f64| passivity.regions.iter().map(of).collect();
        Self {
            ports: passivity.ports.iter().map(port).collect(),
            free_norms: each(|one| one.free),
            norms: each(|one| one.norm),
        }
    }
}

/// A partition whose maps are bounded, and the cost in one-step error.
#[derive(Debug, Clone)]
pub struct BoundedCandidate {
    /// Its specification.
    pub partition: String,
    /// Contraction of its maps.
    pub maps: BoundedMaps,
    /// The held-out loss without bounds.
    pub free_loss: f64,
    /// The held-out loss.
    pub loss: f64,
}

impl BoundedCandidate {
    /// Those among candidates; `held_out`: true if their losses are of held-out rows.
    pub fn of(candidates: &[Score], held_out: bool) -> Vec<Self> {
        let of = |score: &Score| {
            Some(Self {
                partition: score.specification.to_string(),
                maps: score.stability.as_ref()?.into(),
                free_loss: score.free_loss,
                loss: if held_out { score.loss } else { unexplained(&score.r2) },
            })
        };
        candidates.iter().filter_map(of).collect()
    }

    /// Tables of the candidates: contraction, and passivity where the maps are passive.
    pub fn tables(candidates: &[Self]) -> Vec<TextTable> {
        let Some(first) = candidates.first() else { return Vec::new() };
        let contracting = TextTable {
            caption: first.maps.in_words(),
            header: ["partition", "moved", "free radius", "radius", "norm", "free loss", "loss"].to_vec(),
            rows: candidates.iter().map(Self::contracting).collect(),
        };
        let passive = first.maps.passivity.as_ref().map(|passivity| TextTable {
            caption: passivity.in_words(),
            header: ["partition", "moved", "shortage", "free norm", "norm", "free loss", "loss"].to_vec(),
            rows: candidates.iter().filter_map(Self::passive).collect(),
        });
        std::iter::once(contracting).chain(passive).collect()
    }

    fn contracting(&self) -> Vec<String> {
        let maps = &self.maps;
        let greatest = [&maps.free_radii, &maps.radii, &maps.norms].map(|each| fixed(greatest(each)));
        self.row(greatest)
    }

    fn passive(&self) -> Option<Vec<String>> {
        let passivity = self.maps.passivity.as_ref()?;
        let shortages = passivity.ports.iter().map(|port| number(port.shortage.unwrap_or(f64::NAN)));
        let shortages = shortages.collect::<Vec<_>>().join(", ");
        let [free, norm] = [&passivity.free_norms, &passivity.norms].map(|each| fixed(greatest(each)));
        Some(self.row([shortages, free, norm]))
    }

    fn row(&self, cells: [String; 3]) -> Vec<String> {
        let moved = format!("{} of {}", self.maps.moved, self.maps.norms.len());
        let begun = [self.partition.clone(), moved].into_iter();
        begun.chain(cells).chain([ratio(self.free_loss), ratio(self.loss)]).collect()
    }
}

impl BoundedMaps {
    /// One sentence: the bound, the variables and the inputs.
    pub fn in_words(&self) -> String {
        let inputs = match self.inputs.as_slice() {
            [] => String::new(),
            inputs => format!("; {} act as inputs", inputs.join(", ")),
        };
        format!(
            "stable: all regions' maps of {} over one sampling period contract by {} in one metric{inputs}; greatest of the regions",
            self.variables.join(", "),
            self.bound
        )
    }
}

impl PassiveMaps {
    /// One sentence: the ports at which the maps are passive.
    pub fn in_words(&self) -> String {
        let ports: Vec<String> = self.ports.iter().map(|port| format!("{}:{}", port.input, port.state)).collect();
        format!(
            "passive at {}: in one storage function each region's map has a norm of at most 1; greatest of the regions",
            ports.join(", ")
        )
    }
}

/// The share of the targets' variance that is left.
pub fn unexplained(r2: &[f64]) -> f64 {
    1.0 - r2.iter().sum::<f64>() / r2.len() as f64
}

/// Four decimals, unless there are many digits before them.
fn fixed(value: f64) -> String {
    if value < 1e4 { format!("{value:.4}") } else { number(value) }
}

fn greatest(each: &[f64]) -> f64 {
    each.iter().copied().fold(0.0, f64::max)
}
