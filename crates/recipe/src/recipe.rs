//! The recipe: the meaning of a log's fields, in TOML.
//!
//! Flags of the command line are written into the recipe before it is used, so the recipe that a model carries is
//! complete.

mod alias;
mod auto;
mod body;
mod bounds;
mod clocks;
mod control;
mod criterion;
mod derivative;
mod estimate;
mod filter;
mod lags;
mod narx;
mod network;
mod objective;
mod phase;
mod ports;
mod prepare;
mod pwa;
mod resimulate;
mod settings;
mod sindy;
mod sparse;

use std::{collections::BTreeMap, path::Path};

use alias::also;
pub use auto::AutoSection;
pub use body::{AttitudeForm, BodySection, EstimateKind, Gravity, JointSection, Mounting, SensorKind, SensorSection};
pub use bounds::whole;
pub use clocks::ClockSection;
pub use control::{ControlSchedule, ControlSection};
pub use criterion::Criterion;
pub use derivative::{Derivative, Over, SpanDerivative};
pub use estimate::{EstimateMethod, EstimateSection};
pub use filter::{FilterNoise, FilterSection, FilterSwitching};
use fleetfoot_data::setting::RECIPE;
use fleetfoot_data::{did_you_mean, nearest};
use indexmap::IndexMap;
pub use lags::Lags;
pub use narx::{Effort, GivenAs, NarxSection, NarxSelection, NarxTerms};
pub use network::{ActivationWord, CellWord, HiddenLayers, NetworkSection};
pub use objective::{MOST_STEPS, Objective};
pub use phase::PhaseColumn;
pub use ports::{Port, PortList};
pub use prepare::{Limits, PrepareMethod, PrepareSection};
pub use pwa::{OutsideRanges, PartitionChoice, PwaSection, UnseenLabels};
pub use resimulate::ResimulateSection;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use settings::{Settings, Tunable, seed};
pub use sindy::{LibrarySection, Normalize, ParameterSection, SindyOptimizer, SindySection, SmoothStates};
pub use sparse::{ConstraintSection, LatentSection, SparseSection, TaskSection};

use crate::error::Error;

/// Settings of a user about the recordings and the model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Recipe {
    /// Short names: alias = a field of the log, or an expression over fields and earlier aliases.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub columns: IndexMap<String, String>,
    /// States that the model advances in time.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub states: IndexMap<String, State>,
    /// Inputs from outside.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub inputs: IndexMap<String, Input>,
    /// Unknown functions, each a library over its own variables, that the equations of `[tasks]` and `[states]` may share.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub latents: IndexMap<String, LatentSection>,
    /// Tasks on which the latents are regressed.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub tasks: IndexMap<String, TaskSection>,
    /// Constraints between the latents.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub constraints: IndexMap<String, ConstraintSection>,
    /// Options of a piecewise-affine fit: defaults of the flags of `fit pwa`.
    #[serde(skip_serializing_if = "is_default")]
    pub pwa: PwaSection,
    /// Options of a sparse regression: defaults of the flags of `fit sparse`.
    #[serde(skip_serializing_if = "is_default")]
    pub sparse: SparseSection,
    /// Candidate functions of the equations of `fit sindy`.
    #[serde(skip_serializing_if = "is_default")]
    pub library: LibrarySection,
    /// Numbers inside expressions that are not known.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub parameters: IndexMap<String, ParameterSection>,
    /// Options of the estimation of parameters in given equations: defaults of the flags of `fit parameters`.
    #[serde(skip_serializing_if = "is_default")]
    pub estimate: EstimateSection,
    /// Options of an equation fit: defaults of the flags of `fit sindy`.
    #[serde(skip_serializing_if = "is_default")]
    pub sindy: SindySection,
    /// Options of an autoregression: defaults of the flags of `fit narx`.
    #[serde(skip_serializing_if = "is_default")]
    pub narx: NarxSection,
    /// Training and choice of a network: defaults of the flags of `fit network`.
    #[serde(skip_serializing_if = "is_default")]
    pub network: NetworkSection,
    /// Design of a controller: defaults of the flags of `control lqr` and `control mpc`.
    #[serde(skip_serializing_if = "is_default")]
    pub control: ControlSection,
    /// Options of the preparation of channels: defaults of the flags of `prepare`.
    #[serde(skip_serializing_if = "is_default")]
    pub prepare: PrepareSection,
    /// Options of a filter by a model: defaults of the flags of `filter`.
    #[serde(skip_serializing_if = "is_default")]
    pub filter: FilterSection,
    /// Options of recordings that a model follows: defaults of the flags of `resimulate`.
    #[serde(skip_serializing_if = "is_default")]
    pub resimulate: ResimulateSection,
    /// Options of the search by `auto`: defaults of its flags.
    #[serde(skip_serializing_if = "is_default")]
    pub auto: AutoSection,
    /// Options of the preparation of single states and inputs: the entries of `[prepare]` that concern a channel, with
    /// other values.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub channels: IndexMap<String, PrepareSection>,
    /// A rigid body whose motion `prepare` fuses of the sensors that `[sensor]` names.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<BodySection>,
    /// Joints whose motion `prepare` fuses, by name.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub joint: IndexMap<String, JointSection>,
    /// The sensors of the body and of joints, by name.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub sensor: IndexMap<String, SensorSection>,
    /// The clock and the episodes.
    #[serde(skip_serializing_if = "is_default")]
    pub time: Time,
    /// Clocks of other computers, by name, and the columns that compare them with the clock of the other topics. A
    /// clock may be compared with those before it.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub clocks: IndexMap<String, ClockSection>,
    /// Resampling of fields of other channels to the stamps of the base, by field or wildcard, in place of the rule of
    /// their types.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub join: IndexMap<String, Join>,
    /// The files of a run, a file a topic, joined as topics of one log are: topics, and the names of their files in the
    /// run's folder (`imu = "imu*.csv"`).
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub files: IndexMap<String, String>,
    /// Topics as this recipe calls them, and as the files do.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub rename: IndexMap<String, String>,
    /// Predicted quantity, and candidate functions.
    #[serde(skip_serializing_if = "is_default")]
    pub model: ModelSection,
    /// Labels for the episodes of matching files.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub episodes: Vec<EpisodeRule>,
    /// Folder of decoded columns of robot logs; no part of a written recipe.
    #[serde(skip)]
    pub cache: Option<fleetfoot_log::Cache>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A state.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct State {
    /// Field or expression, when the name is not an alias or a field itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Measurement of its derivative. `auto` is a central difference, whose order `fit sindy` chooses by the data.
    /// Others: `central`, `central4`, `central6` (of order 2, 4, 6), `forward`, `backward`, or a field or expression.
    /// The mean slope over a span is `{ over = 20 }` or `{ over = "auto" }`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub derivative: Option<Derivative>,
    /// Its derivative is this expression: integrated, never fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known: Option<String>,
    /// Its predicted quantity, over columns and latents: `(T*cos(alpha) - D)/m - 9.80665*sin(gamma)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equation: Option<String>,
    /// Known part of the right side, an expression over columns and parameters: only the rest is fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nominal: Option<String>,
    /// Candidate functions of its equation, in place of `[library]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub library: Option<Vec<String>>,
    /// Terms that its equation always has.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fixed: Vec<String>,
    /// True to have it in the library and the partition; the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub regressor: Option<bool>,
    /// `angle`, `quaternion`, `rotation-vector` or `linear`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<Kind>,
    /// Unit, if the file lacks it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Of a rotation: the columns of its parts, fields or aliases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<Vec<String>>,
    /// Of a rotation: which part each of the columns is, `wxyz` or `xyzw`, where their names do not end in these letters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// Of a rotation: its three rates, rad/s, states, inputs or expressions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Vec<String>>,
    /// Of a rotation: the axes that the rates are about, `body` (default) or `world`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<Frame>,
    /// The rotation and the letter of this state's part, `attitude.w`, in a written-out rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
}

/// The axes of vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Frame {
    /// Those of the body.
    Body,
    /// Those of the world.
    World,
}

/// Kind of a column's quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(transform = also("axis-angle", "rotation-vector"))]
pub enum Kind {
    /// A real number.
    Linear,
    /// An angle in radians: differences wrap, regressors and partitions see its cosine and sine.
    Angle,
    /// A unit quaternion in four columns. Its equations are the kinematics, given its rates; it stays of unit length,
    /// and q and -q are the same. The library names it by `rotate(NAME, v)` and the like.
    Quaternion,
    /// A rotation vector, axis times angle in radians, in three columns: as a quaternion. Turns more or less are the same.
    #[serde(alias = "axis-angle")]
    RotationVector,
}

/// An input: `u = "field"` or `u = { column = "field", kind = "angle" }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected a field or expression in quotes, or a table { column = ..., kind = ..., unit = ... }"
)]
pub enum Input {
    /// A field or expression.
    Text(String),
    /// With details.
    Table(InputTable),
}

/// Details of an input.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InputTable {
    /// Field or expression, when the name is not an alias or a field itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// `angle` or `linear`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<Kind>,
    /// Unit, if the file lacks it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// The clock and the episodes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Time {
    /// The column of the stamps; found by its name when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// The unit of numeric stamps: s, ms, us, ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Rows are this many seconds apart; the file has no time column, or it is not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dt: Option<f64>,
    /// The gap that ends an episode: seconds, `auto` (five median periods) or `none`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gap: Option<Gap>,
    /// Comparisons that hold of every row that is used, joined by `and`; `all` (or nothing) for all rows.
    #[serde(rename = "where", skip_serializing_if = "Option::is_none")]
    pub only: Option<String>,
    /// The clock of robot logs: `header`, `log` or `publish`; the headers' where every channel has one, else the log's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stamp: Option<String>,
    /// The topic whose messages make the rows; that of the first state when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<String>,
    /// Rows a second, instead of a base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Seconds by which messages may be out of order; 0.05 when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reorder: Option<f64>,
    /// Seconds over which `prepare` has smoothed these logs: so far apart are held-out and training rows at least, where folds are spans of an episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothed: Option<f64>,
}

/// Resampling of a field to the stamps of the base: `"hold"` or `{ kind = "hold", max_gap = 1.0 }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected \"linear\", \"hold\", \"angle\" or \"slerp\", or a table { kind = ..., max_gap = ... }"
)]
pub enum Join {
    /// The kind.
    Kind(String),
    /// With details.
    Table(JoinTable),
}

/// Details of a join.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JoinTable {
    /// `linear`, `hold`, `angle` or `slerp`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// The longest gap that is bridged: seconds, `auto` (five median periods of the channel) or `none`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gap: Option<Gap>,
}

impl Join {
    /// The details, however they were written.
    pub fn table(&self) -> JoinTable {
        match self {
            Self::Kind(kind) => JoinTable { kind: Some(kind.clone()), max_gap: None },
            Self::Table(table) => table.clone(),
        }
    }
}

/// A gap in seconds, or a word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected seconds, \"auto\" or \"none\"")]
pub enum Gap {
    /// Seconds.
    Seconds(f64),
    /// `auto` or `none`.
    Word(String),
}

/// Predicted quantity, and candidate functions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSection {
    /// `derivative` (default), `next`, `delta`, or a column (plain regression).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predict: Option<String>,
    /// Total degree of the polynomial library; 1 (affine) by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degree: Option<u32>,
    /// Past rows of every state and input beside the present one: `3`, or every 5th of the last 50,
    /// `{ last = 50, every = 5 }`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lags: Option<Lags>,
    /// Non-negative row weights: a field or expression.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weight: Option<String>,
    /// Partitions: `kmeans:10`, `null,average,zscore:1.5,kmeans:2,5,10`, `refined:2..20`, `lattice:2..50`, `tree:1..6`, `labels:COLUMN+kmeans:3`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub partition: Option<String>,
    /// Partition columns, in place of the states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub partition_on: Option<Vec<String>>,
}

/// Labels for the episodes of matching files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EpisodeRule {
    /// A glob over the file's name.
    #[serde(rename = "match")]
    pub pattern: String,
    /// The labels.
    #[serde(flatten)]
    #[schemars(with = "BTreeMap<String, serde_json::Value>")]
    pub labels: BTreeMap<String, toml::Value>,
}

impl EpisodeRule {
    /// The rule that gives a file its labels; `None` where it has none.
    pub fn of_file(file: &str, labels: &BTreeMap<String, String>) -> Option<Self> {
        let value = |text: &String| toml::Value::String(text.clone());
        let labels: BTreeMap<_, _> = labels.iter().map(|(name, text)| (name.clone(), value(text))).collect();
        (!labels.is_empty()).then(|| Self { pattern: glob::Pattern::escape(file), labels })
    }
}

impl Recipe {
    /// Reads a recipe from TOML text; `name` is its origin, for messages.
    pub fn parse(text: &str, name: &str) -> Result<Self, Error> {
        let refused = |problem: String| Error::Recipe { name: name.to_owned(), problem };
        let recipe: Self = toml::from_str(text).map_err(|error| refused(with_meant(error.to_string())))?;
        recipe.check_bounds().map_err(refused)?;
        Ok(recipe)
    }

    /// Reads a recipe from a file.
    ///
    /// # Errors
    /// A file that cannot be read, that is a log, or that holds no recipe.
    pub fn read(path: &Path) -> Result<Self, Error> {
        if fleetfoot_log::Format::of(path).is_some() {
            return Err(Error::Recipe {
                name: path.display().to_string(),
                problem: format!(
                    "this is a log, and {RECIPE} (-c) names a recipe: write `-c robot.toml`, and the log without an option"
                ),
            });
        }
        let text = std::fs::read_to_string(path).map_err(|error| Error::Recipe {
            name: path.display().to_string(),
            problem: format!("cannot be read: {error}"),
        })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads a recipe from JSON of the same shape; `name` is its origin, for messages.
    ///
    /// # Errors
    /// A text that cannot be understood, with the place in the recipe as TOML.
    pub fn from_json(text: &str, name: &str) -> Result<Self, Error> {
        let refused = |problem: String| Error::Recipe { name: name.to_owned(), problem };
        let recipe: Self = serde_json::from_str(text).map_err(|problem: serde_json::Error| {
            // TOML tells the line that is at fault, JSON of one line does not.
            let value: Option<serde_json::Value> = serde_json::from_str(text).ok();
            let message_text =
                value.and_then(|value| toml::to_string(&value).ok()).and_then(|toml| Self::parse(&toml, name).err());
            message_text.unwrap_or_else(|| refused(problem.to_string()))
        })?;
        recipe.check_bounds().map_err(refused)?;
        Ok(recipe)
    }

    /// The recipe as TOML.
    pub fn to_toml(&self) -> String {
        // Plain tables of strings and numbers always serialise.
        toml::to_string(self).unwrap_or_default()
    }
}

/// The message of a key that does not exist, with the keys that may have been meant.
fn with_meant(problem: String) -> String {
    let meant = || {
        let (key, known) = problem.split_once("unknown field `")?.1.split_once("`, expected ")?;
        Some(did_you_mean(&nearest(key, known.split('`').skip(1).step_by(2))))
    };
    let meant = meant().unwrap_or_default();
    format!("{}{meant}", if meant.is_empty() { &problem } else { problem.trim_end() })
}

impl Input {
    /// The details, however they were written.
    pub fn table(&self) -> InputTable {
        match self {
            Self::Text(text) => InputTable { column: Some(text.clone()), ..InputTable::default() },
            Self::Table(table) => table.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        groups::GroupWords,
        recipe::{SensorKind, Tunable},
    };

    const TEXT: &str = r#"
[columns]
vx = "/odom.twist.twist.linear.x"
yaw = "yaw(/odom.pose.pose.orientation)"
[states]
x = { known = "vx*cos(yaw) - vy*sin(yaw)", regressor = false }
vx = { derivative = "auto" }
yaw = { kind = "angle" }
[inputs]
u = "/cmd_vel.linear.x"
[time]
max_gap = 0.5
[[episodes]]
match = "grass_*"
terrain = "grass"
"#;

    #[test]
    fn recipes_round_trip_in_order() {
        let recipe = Recipe::parse(TEXT, "test").unwrap();
        assert_eq!(recipe.states.keys().collect::<Vec<_>>(), ["x", "vx", "yaw"]);
        assert_eq!(recipe.states["yaw"].kind, Some(Kind::Angle));
        assert_eq!(recipe.time.max_gap, Some(Gap::Seconds(0.5)));
        assert_eq!(Recipe::parse(&recipe.to_toml(), "again").unwrap(), recipe);
    }

    #[test]
    fn sensors_of_a_body_round_trip() {
        let text = "[body]\ngravity = [0.0, 0.0, -9.81]\n[sensor.mocap]\nkind = \"pose\"\nchannels = [\"x\"]\nlever = \"auto\"\nmounting = [0.0, 0.0, 0.0, 1.0]\ndelay = 0.01\n";
        let recipe = Recipe::parse(text, "test").unwrap();
        assert_eq!(recipe.sensor["mocap"].kind, SensorKind::Pose);
        assert_eq!(Recipe::parse(&recipe.to_toml(), "again").unwrap(), recipe);
        let error = Recipe::parse("[sensor.a]\nkind = \"pose\"\n", "robot.toml").unwrap_err().to_string();
        assert!(error.contains("channels"), "{error}");
        let error = Recipe::parse(&text.replace("\"auto\"", "true"), "robot.toml").unwrap_err().to_string();
        assert!(error.contains("list of numbers"), "{error}");
    }

    #[test]
    fn json_recipe_is_equal_and_locates_errors() {
        let recipe = Recipe::parse(TEXT, "test").unwrap();
        let json = serde_json::to_string(&recipe).unwrap();
        assert_eq!(Recipe::from_json(&json, "json").unwrap(), recipe);
        let error =
            Recipe::from_json(r#"{"pwa": {"seed": 1, "select": "best"}}"#, "the recipe").unwrap_err().to_string();
        assert!(error.contains("select = \"best\"") && error.contains("`rollout`"), "{error}");
        assert!(Recipe::from_json("{", "the recipe").unwrap_err().to_string().contains("the recipe"));
    }

    #[test]
    fn flags_override_the_recipe_and_conflicting_entries() {
        let text = "[pwa]\nfolds = 4\nseed = 3\n[sindy]\nterms = 3\nridge = 0.1\n[sparse]\nstability = true\n[latents]\nT = { of = [\"x\"], prior_strength = 2.0 }\n";
        let mut recipe = Recipe::parse(text, "test").unwrap();
        recipe.override_with(PwaSection { folds: Some(8), tsqr: Some(false), ..PwaSection::default() });
        let expected = PwaSection { folds: Some(8), tsqr: Some(false), seed: Some(3), ..PwaSection::default() };
        assert_eq!(recipe.pwa, expected);
        recipe.override_with(SindySection { threshold: Some(Tunable::Number(0.5)), ..SindySection::default() });
        assert_eq!((recipe.sindy.terms, recipe.sindy.ridge), (None, Some(0.1)));
        recipe.override_with(SindySection { terms: Some(2), ..SindySection::default() });
        assert_eq!((recipe.sindy.terms, recipe.sindy.threshold.clone()), (Some(2), None));
        recipe.override_with(SparseSection {
            bolasso: Some("chunks".into()),
            prior_strength: Some(0.5),
            ..SparseSection::default()
        });
        assert_eq!((recipe.sparse.stability, recipe.latents["T"].prior_strength), (None, None));
        recipe.override_with(SparseSection { stability: Some(true), ..SparseSection::default() });
        assert_eq!((recipe.sparse.stability, recipe.sparse.bolasso.clone()), (Some(true), None));
        let groups = Some(GroupWords::Word("signal".into()));
        recipe.override_with(SparseSection { groups: groups.clone(), ..SparseSection::default() });
        assert_eq!((recipe.sparse.stability, &recipe.sparse.groups), (None, &groups));
        recipe.override_with(SparseSection { bolasso: Some("rows".into()), ..SparseSection::default() });
        assert_eq!((recipe.sparse.bolasso.as_deref(), &recipe.sparse.groups), (Some("rows"), &None));
    }

    #[test]
    fn typing_errors_are_reported_with_their_line() {
        let error = Recipe::parse("[states]\nx = { regresor = false }\n", "robot.toml").unwrap_err().to_string();
        assert!(error.contains("robot.toml") && error.contains("regresor") && error.contains("line 2"), "{error}");
        assert!(error.contains("did you mean `regressor`"), "{error}");
        let error = Recipe::parse("[state]\nx = {}\n", "robot.toml").unwrap_err().to_string();
        assert!(error.contains("did you mean `states`"), "{error}");
    }
}
