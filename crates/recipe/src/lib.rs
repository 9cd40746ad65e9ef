//! The words of a recipe: which fields of a log are what, and the settings of every command.
//!
//! A [`Recipe`] is read from TOML, or from the flags of a command ([`Settings`]); [`starter_recipe`] drafts one from what a log holds. What its words mean for a recording
//! is settled by the crates above.
//!
//! ```
//! use fleetfoot_recipe::Recipe;
//!
//! let recipe = Recipe::parse("[states]\nT = {}\n[library]\nfunctions = [\"poly(2)\"]\n", "example")?;
//! assert_eq!(recipe.states.len(), 1);
//! // What a section does not know is an error that tells the place and the nearest name.
//! let wrong = Recipe::parse("[states]\nT = {}\n[sindy]\ntreshold = 0.1\n", "example").unwrap_err();
//! assert!(wrong.to_string().contains("threshold"), "{wrong}");
//! # Ok::<(), fleetfoot_recipe::Error>(())
//! ```

mod aliases;
mod attitude;
mod body;
mod bounds;
mod clocks;
mod control;
mod criterion;
mod derivative;
mod error;
mod estimate;
mod filter;
mod groups;
mod init;
mod lags;
mod list;
mod narx;
mod objective;
mod phase;
mod ports;
mod prepare;
mod pwa;
mod recipe;
mod request;
mod resimulate;
mod settings;
mod sindy;
mod sparse;
pub mod wildcard;

pub use aliases::{Aliases, aliases_of_model};
pub use attitude::named_rotations;
pub use body::{AttitudeForm, BodySection, EstimateKind, Gravity, JointSection, Mounting, SensorKind, SensorSection};
pub use bounds::whole;
pub use clocks::ClockSection;
pub use control::{ControlSchedule, ControlSection};
pub use criterion::Criterion;
pub use derivative::{Derivative, Over, SpanDerivative};
pub use error::Error;
pub use estimate::{EstimateMethod, EstimateSection};
pub use filter::{FilterNoise, FilterSection, FilterSwitching};
pub use groups::{GroupRule, GroupWords};
pub use init::{starter_recipe, starter_recipe_of_runs};
pub use lags::Lags;
pub use list::items;
pub use narx::{Effort, GivenAs, NarxSection, NarxSelection, NarxTerms};
pub use objective::{MOST_STEPS, Objective};
pub use phase::PhaseColumn;
pub use ports::{Port, PortList};
pub use prepare::{Limits, PrepareMethod, PrepareSection};
pub use pwa::{PartitionChoice, PwaSection, UnseenLabels};
pub use recipe::{
    EpisodeRule, Frame, Gap, Input, InputTable, Join, JoinTable, Kind, ModelSection, Recipe, State, Time,
};
pub use request::{Cause, RequestError};
pub use resimulate::ResimulateSection;
pub use settings::{Settings, Tunable, seed};
pub use sindy::{LibrarySection, Normalize, ParameterSection, SindyOptimizer, SindySection, SmoothStates};
pub use sparse::{ConstraintSection, LatentSection, SparseSection, TaskSection};
