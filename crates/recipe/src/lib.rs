//! The settings of a recipe: the meaning of a log's fields, and the options of every command.
//!
//! A [`Recipe`] is read from TOML, or from the flags of a command ([`Settings`]); [`starter_recipe`] drafts one from
//! the content of a log. The crates above resolve it for a recording.
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
mod error;
mod groups;
mod init;
mod list;
mod recipe;
mod request;
mod schema;
pub mod wildcard;

pub use aliases::{Aliases, aliases_of_model};
pub use attitude::named_rotations;
pub use error::Error;
pub use groups::{GroupRule, GroupWords};
pub use init::{draft_of_odometry, draft_of_topics, is_named_angle, starter_recipe, starter_recipe_of_runs};
pub use list::items;
pub use recipe::{
    ActivationWord, AttitudeForm, AutoSection, BodySection, CellWord, ClockSection, ConstraintSection, ControlSchedule,
    ControlSection, Criterion, Derivative, Effort, EpisodeRule, EstimateKind, EstimateMethod, EstimateSection,
    FilterNoise, FilterSection, FilterSwitching, Frame, Gap, GivenAs, Gravity, HiddenLayers, Input, InputTable, Join,
    JoinTable, JointSection, Kind, Lags, LatentSection, LibrarySection, Limits, MOST_STEPS, ModelSection, Mounting,
    NarxSection, NarxSelection, NarxTerms, NetworkSection, Normalize, Objective, OutsideRanges, Over, ParameterSection,
    PartitionChoice, PhaseColumn, Port, PortList, PrepareMethod, PrepareSection, PwaSection, Recipe, ResimulateSection,
    SensorKind, SensorSection, Settings, SindyOptimizer, SindySection, SmoothStates, SpanDerivative, SparseSection,
    State, TaskSection, Time, Tunable, UnseenLabels, seed, whole,
};
pub use request::{Cause, RequestError};
