//! Piecewise identification: partitions, regression per region, model order.
//!
//! After Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot".
//! The state space is cut into regions by simple statistics of the observations, and every region gets an affine model
//! by least squares. The number of regions is chosen by the held-out error. [`identify`] does it in three passes over
//! the rows, whatever the number of partitions, regions and folds.
//!
//! ```
//! use fleetfoot_data::Silent;
//! use fleetfoot_pwa::{KMeansOptions, Points, Start, kmeans};
//!
//! // Two clusters on a line, centred and scaled by 0 and 1.
//! let x = [0.0, 0.1, 0.2, 5.0, 5.1, 5.2];
//! let points = Points::from_columns(&[&x], &[0.0], &[1.0])?;
//! let options = KMeansOptions { k: 2, ..KMeansOptions::default() };
//! let found = kmeans(&points, Start::PlusPlus { seed: 0, restarts: 3 }, &options, &Silent)?;
//! let mut centroids = found.centroids.clone();
//! centroids.sort_by(f64::total_cmp);
//! assert!((centroids[0] - 0.1).abs() < 1e-6 && (centroids[1] - 5.1).abs() < 1e-6);
//! # Ok::<(), fleetfoot_pwa::KMeansError>(())
//! ```

mod assemble;
mod assignment;
mod borders;
mod budget;
mod complete;
mod continuous;
mod cuts;
mod effective;
mod error;
mod errors;
mod examples;
mod fit;
mod identification;
mod identify;
mod kept;
mod kmeans;
mod labels;
mod lagged;
mod lattice;
mod levels;
mod memory;
mod notes;
mod pairs;
mod partition;
mod partition_note;
mod phase;
mod plans;
mod port;
mod problem;
mod refined;
mod region_model;
mod regions;
mod residual;
mod rows;
mod scan;
mod segmentation;
mod select;
mod specification;
mod stable;
mod strides;
mod summed;
mod survey;
mod tree;
mod tsqr;
mod walks;

pub use continuous::Continuity;
pub use error::Error;
pub use identification::{Identification, Score};
pub use identify::identify;
pub use kmeans::{
    Assigned, Assigner, KMeans, KMeansError, KMeansOptions, KMeansRows, KMeansRun, KMeansStep, Points, Start, Units,
    assign_rows, distances_to, kmeans, kmeans_from, plus_plus_draws, starting_centroids,
};
pub use memory::{Cost, cost};
pub use partition::{Partitioned, partition};
pub use partition_note::{Finding, PartitionNote, SampleMethod};
pub use phase::{Phase, PhaseKind};
pub use plans::system;
pub use port::Port;
pub use problem::{Options, Outside, Problem, Selection, Shrinkage};
pub use specification::{Specification, SpecificationError, Within};
pub use stable::{Contracting, PassiveRegion, Passivity, RegionWeight, Stability, StableRegion};
pub use summed::{Summed, SummedPartition, SummedRows, identify_summed};
