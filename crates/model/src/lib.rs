//! The model type: latents, partitions, equations; saved, printed.
//!
//! One type, [`Model`], for all methods. Each of its [`Latent`] functions is a library of candidate functions x a
//! [`Partition`] of the state space into regions x a [`Map`] from the functions' values (affine in most models). Its
//! [`Equation`]s give the predicted quantities from columns and latents. Some equations are given, not fitted
//! (`dx/dt = vx*cos(yaw) - vy*sin(yaw)`).
//!
//! All expressions inside a model are over the model's columns (aliases). The definition of an alias from the fields of
//! a log is part of the model too ([`Column::source`]), so that a model is scored on a new log without further
//! settings.
//!
//! ```
//! use fleetfoot_library::{Expr, Scope};
//! use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training, describe};
//!
//! let column = |name: &str, role| Column::new(name, role);
//! let columns = vec![column("q", Role::State), column("v", Role::State)];
//! let training = Training { state_covariance: vec![1.0, 0.0, 1.0], ..Training::default() };
//! let mut pendulum = Model::new("given", columns, 0.01, training);
//! let scope = Scope::new(["q", "v"]);
//! for (subject, right) in [("q", "v"), ("v", "-9.81*sin(q) - 0.1*v")] {
//!     let right = Expr::parse(right, &scope)?;
//!     let prediction = Prediction::Derivative;
//!     pendulum.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
//! }
//! assert!(describe(&pendulum, 1).contains("d(v)/dt = -9.81*sin(q) - 0.1*v"));
//! let again = Model::from_json(&pendulum.to_json(), "pendulum.json")?;
//! assert_eq!(again, pendulum);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod affine_map;
mod basis;
mod basis_map;
mod canonical;
mod cell;
mod closed;
mod column;
mod equation;
mod file;
mod gaussian;
mod latent;
mod latent_groups;
mod lattice;
mod map;
mod map_array;
mod map_kind;
mod network;
mod partition;
mod phases;
mod print;
mod radial_functions;
mod recurrent;
mod region_pair;
mod residual_correlation;
mod rotation;
mod rotations;
mod summary;
mod trained;
mod transitions;
mod tree;
mod typeset;
mod validate;

pub use affine_map::AffineMap;
pub use basis::{Basis, Definition};
pub use basis_map::BasisMap;
pub use cell::Cell;
pub use closed::{Closed, ClosedError, FirstOrderLag, auxiliary_columns, check_simulated};
pub use column::{Column, Role};
pub use equation::{Equation, Prediction};
pub use file::{FORMAT_VERSION, FileError};
pub use gaussian::Gaussian;
pub use latent::Latent;
pub use latent_groups::{LaggedLatent, LatentGroup, partitions_in_use};
pub use lattice::{Join, Lattice, Level};
pub use map::Map;
pub use map_array::MapArray;
pub use map_kind::MapKind;
pub use network::{Activation, DenseLayer, Network};
pub use partition::{Partition, Rule, UnseenLabel, join};
pub use phases::{Passage, PhaseBins, Phases};
pub use print::{describe, describe_transitions, factor};
pub use radial_functions::RadialFunctions;
pub use recurrent::Recurrent;
pub use region_pair::{RegionPair, holm};
pub use residual_correlation::ResidualCorrelation;
pub use rotation::{RotationKind, RotationPart};
pub use rotations::{Rotation, rotations};
pub use summary::{Estimated, RegionSummary, Summary, Training};
pub use trained::{TrainedEpisode, known};
pub use transitions::Transitions;
pub use tree::{Branch, Cut, Side, Tree};
pub use typeset::{SetEquation, summands};

use fleetfoot_library::Expr;

/// A model of a recording: predicted quantities and their equations.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Model {
    /// The method that made it, as its user wrote it: `pwa kmeans:10`.
    pub method: String,
    /// The columns (aliases) of the model.
    pub columns: Vec<Column>,
    /// Libraries of candidate functions over the columns; the constant is implied.
    pub libraries: Vec<Vec<Expr>>,
    /// Partitions of the state space.
    pub partitions: Vec<Partition>,
    /// Statistics of the training rows in the regions of every partition.
    pub summaries: Vec<Summary>,
    /// Fitted functions.
    pub latents: Vec<Latent>,
    /// Equations of the predicted quantities.
    pub equations: Vec<Equation>,
    /// The sampling period of the training data, seconds: the step of a discrete model, the default step of a continuous one.
    pub step: f64,
    /// Training data of the model, and the scale of their values.
    pub training: Training,
}

impl Model {
    /// A model without latents and equations; the fields are public, [`Model::validate`] checks them.
    ///
    /// Only those marks of the training's episodes stay that are needed to recognise their rows. Means of the states
    /// stay if some are a rotation.
    pub fn new(method: impl Into<String>, columns: Vec<Column>, step: f64, mut training: Training) -> Self {
        trained::keep_marks(&mut training.episodes, &columns);
        if columns.iter().all(|column| column.rotation.is_none()) {
            training.state_mean.clear();
        }
        Self {
            method: method.into(),
            columns,
            libraries: Vec::new(),
            partitions: Vec::new(),
            summaries: Vec::new(),
            latents: Vec::new(),
            equations: Vec::new(),
            step,
            training,
        }
    }

    /// Adds a partition with the statistics of its regions; returns its index.
    pub fn add_partition(&mut self, partition: Partition, regions: Vec<RegionSummary>) -> usize {
        self.partitions.push(partition);
        self.summaries.push(regions.into());
        self.partitions.len() - 1
    }

    /// The index of a column by name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// The unit of a column, where it is known, and of a rotation's angle.
    pub fn unit_of(&self, name: &str) -> Option<&str> {
        match self.column(name) {
            Some(column) => self.columns[column].unit.as_deref(),
            None => self.rotations().iter().any(|rotation| rotation.name == name).then_some("rad"),
        }
    }

    /// Names of the fitted quantities, in the order of the fitted equations (those with a target).
    pub fn outputs(&self) -> Vec<String> {
        self.fitted().map(Equation::label).collect()
    }

    /// The equations whose right side was fitted.
    pub fn fitted(&self) -> impl Iterator<Item = &Equation> {
        self.equations.iter().filter(|equation| equation.target.is_some())
    }

    /// Extrapolation of the maps of a partition beyond the training ranges of a region, in words; `None` for plain affine extrapolation.
    pub fn outside_in_words(&self, partition: usize) -> Option<&'static str> {
        let latent = self.latents.iter().find(|latent| latent.partition == partition && !latent.beyond.is_empty())?;
        Some(match latent.beyond.iter().all(|slope| *slope == 0.0) {
            true => "its map keeps the value at their border",
            false => "its map goes on from their border with the slopes of the one-region model",
        })
    }

    /// True if any equation advances time by one sample instead of integrating a derivative.
    pub fn is_discrete(&self) -> bool {
        self.equations.iter().any(|e| matches!(e.prediction, Prediction::Next | Prediction::Difference))
    }
}
