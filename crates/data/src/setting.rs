//! Names of settings, of sections of a recipe, and of commands in messages.
//!
//! A library never writes `--folds`. It writes the constant, and the front end words it: the command line as
//! `--folds 2`, Python as `folds=2`. A front end sets its wording by [`word_as`] when it starts. The default is
//! that of the command line.
//!
//! ```
//! use fleetfoot_data::setting::{FIT_SINDY, FOLDS, SINDY};
//!
//! assert_eq!(format!("ask for fewer folds ({FOLDS})"), "ask for fewer folds (--folds)");
//! assert_eq!(format!("{}: too many", FOLDS.to(99)), "--folds 99: too many");
//! assert_eq!(format!("{}: too many", SINDY.entry("folds").is(99)), "[sindy] folds = 99: too many");
//! assert_eq!(format!("run {}", FIT_SINDY.with(FOLDS.to(2))), "run `fit sindy --folds 2`");
//! ```

use std::{
    fmt::{self, Display},
    sync::{PoisonError, RwLock},
};

/// Wording of settings, sections and commands in a front end.
pub trait Wording: Send + Sync {
    /// A setting, with its value where the message has one.
    fn setting(&self, setting: Setting, value: Option<&str>) -> String;
    /// A section of the recipe; an entry of it; an entry with its value.
    fn section(&self, section: &str, entry: Option<&str>, value: Option<&str>) -> String;
    /// A place, worded already, with the text that stands there.
    fn assigned(&self, place: &str, text: &str) -> String;
    /// Wording of a clock and the unit of its numbers.
    fn clock(&self, column: &str, unit: &str) -> String;
    /// A value of a recipe.
    fn value(&self, value: &str) -> String;
    /// A command, with a setting that is worded already.
    fn command(&self, command: Command, setting: Option<&str>) -> String;
}

static WORDING: RwLock<&'static dyn Wording> = RwLock::new(&Flags);

/// Gives all messages of this process the words of a front end. The last call holds: the command within the Python
/// package has the words of the command line.
pub fn word_as(wording: &'static dyn Wording) {
    *WORDING.write().unwrap_or_else(PoisonError::into_inner) = wording;
}

fn wording() -> &'static dyn Wording {
    *WORDING.read().unwrap_or_else(PoisonError::into_inner)
}

/// The words of the command line: flags, sections of the recipe, commands.
pub struct Flags;

impl Wording for Flags {
    fn setting(&self, setting: Setting, value: Option<&str>) -> String {
        let between = if setting.kind == Kind::Optional { '=' } else { ' ' };
        let flag = setting.name.replace('_', "-");
        value.map_or_else(|| format!("--{flag}"), |value| format!("--{flag}{between}{}", in_shell(value)))
    }

    fn section(&self, section: &str, entry: Option<&str>, value: Option<&str>) -> String {
        let value = value.map_or_else(String::new, |value| format!(" = {value}"));
        entry.map_or_else(|| format!("[{section}]"), |entry| format!("[{section}] {entry}{value}"))
    }

    fn assigned(&self, place: &str, text: &str) -> String {
        format!("{place} = \"{text}\"")
    }

    fn clock(&self, column: &str, unit: &str) -> String {
        let entry = TIME_SECTION.entry("column").is(format_args!("{column:?}"));
        format!("{} {}; in a recipe {entry}, unit = \"{unit}\"", TIME.to(column), TIME_UNIT.to(unit))
    }

    fn value(&self, value: &str) -> String {
        value.to_owned()
    }

    fn command(&self, command: Command, setting: Option<&str>) -> String {
        setting.map_or_else(|| format!("`{}`", command.0), |setting| format!("`{} {setting}`", command.0))
    }
}

/// A place, worded already, with the text that stands there: `--phase = "foo"`.
pub fn assigned(place: &str, text: &str) -> String {
    wording().assigned(place, text)
}

/// Wording of a clock and the unit of its numbers: `--time t --time-unit ms`.
pub fn clock(column: &str, unit: &str) -> String {
    wording().clock(column, unit)
}

/// A value as a recipe has it: `true`, `"length"`.
pub fn value(value: &str) -> String {
    wording().value(value)
}

/// A value as a shell takes it: in quotes where it has spaces or brackets. Choices are separated by ` | `.
fn in_shell(value: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "._-+,:=/%~".contains(letter);
    match value {
        choices if choices.split(" | ").all(|one| one.chars().all(plain)) => value.to_owned(),
        quoted if quoted.contains('\'') || !quoted.contains(['"', '$', '`', '{']) => format!("\"{value}\""),
        _ => format!("'{value}'"),
    }
}

/// Kind of a setting's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A value.
    Value,
    /// Nothing: it is given or not.
    Switch,
    /// A value, or nothing for the usual one: a flag has `=` before it.
    Optional,
}

/// A setting: a flag of a command, an entry of a section of the recipe, an argument in Python.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setting {
    /// Its name, with underscores.
    pub name: &'static str,
    /// Kind of its value.
    pub kind: Kind,
}

impl Setting {
    /// The setting with a value, as a user gives it.
    pub fn to(self, value: impl Display) -> Given {
        Given { setting: self, value: value.to_string() }
    }
}

impl Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().setting(*self, None))
    }
}

/// A setting with its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Given {
    setting: Setting,
    value: String,
}

impl Display for Given {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().setting(self.setting, Some(&self.value)))
    }
}

/// A section of the recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section<'a>(pub &'a str);

impl Section<'_> {
    /// An entry of it: a setting, or a name of the user's, such as a state.
    pub fn entry(self, name: impl Display) -> Entry {
        Entry { section: self.0.to_owned(), name: name.to_string(), value: None }
    }
}

impl Display for Section<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().section(self.0, None, None))
    }
}

/// An entry of a section of the recipe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    section: String,
    name: String,
    value: Option<String>,
}

impl Entry {
    /// The entry with its value.
    #[must_use]
    pub fn is(self, value: impl Display) -> Self {
        Self { value: Some(value.to_string()), ..self }
    }
}

impl Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().section(&self.section, Some(&self.name), self.value.as_deref()))
    }
}

/// A command, as a user types it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command(pub &'static str);

impl Command {
    /// The command with a setting.
    pub fn with(self, setting: impl Display) -> Invocation {
        Invocation { command: self, setting: setting.to_string() }
    }
}

impl Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().command(*self, None))
    }
}

/// A command with a setting.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Invocation {
    command: Command,
    setting: String,
}

impl Display for Invocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&wording().command(self.command, Some(&self.setting)))
    }
}

macro_rules! settings {
    ($($constant:ident $name:literal $kind:ident)*) => {
        $(
            #[doc = concat!("The setting `", $name, "`.")]
            pub const $constant: Setting = Setting { name: $name, kind: Kind::$kind };
        )*
        /// All settings that messages name.
        pub const SETTINGS: &[Setting] = &[$($constant),*];
    };
}

macro_rules! named {
    ($kind:ident $what:ty: $($constant:ident $name:literal)*) => {
        $(
            #[doc = concat!("`", $name, "`.")]
            pub const $constant: $what = $kind($name);
        )*
    };
}

settings! {
    ACTIVATION "activation" Value
    APPEND "append" Switch
    BASE "base" Value
    BOLASSO "bolasso" Value
    BY "by" Value
    CACHE "cache" Value
    CELL "cell" Value
    CHUNK_ROWS "chunk_rows" Value
    CONTINUOUS "continuous" Switch
    CONTROLLER "controller" Value
    DECIMATE "decimate" Value
    DEGREE "degree" Value
    DIRECT "direct" Switch
    DT "dt" Value
    EFFORT "effort" Value
    EPISODE "episode" Value
    EVERY "every" Value
    FILE "file" Value
    FIT "fit" Value
    FOLDS "folds" Value
    FORCE "force" Switch
    FREE_RUN "free_run" Value
    FRONT "front" Switch
    GROUPS "groups" Value
    HIDDEN "hidden" Value
    HAMPEL "hampel" Value
    HORIZON "horizon" Value
    INCLUSION "inclusion" Value
    INITIAL "initial" Value
    INPUTS "inputs" Value
    ITERATIONS "iterations" Value
    JSON "json" Switch
    KEEP "keep" Value
    KEY "key" Value
    L1_RATIO "l1_ratio" Value
    LAGS "lags" Value
    LAGS_IN "lags_in" Value
    LAGS_OUT "lags_out" Value
    LAMBDA "lambda" Value
    LIBRARY "library" Value
    MAX_GAP "max_gap" Value
    MEASURED "measured" Value
    MEMORY "memory" Value
    NO_CACHE "no_cache" Switch
    OBJECTIVE "objective" Value
    OUTPUTS "outputs" Value
    PARTITION "partition" Value
    PARTITION_ON "partition_on" Value
    PASSIVE "passive" Value
    PHASE "phase" Value
    PLAN "plan" Value
    PLANE "plane" Value
    PREDICT "predict" Value
    PURGE "purge" Value
    RADIAL "radial" Value
    RATE "rate" Value
    RECIPE "recipe" Value
    RENAME "rename" Value
    SEGMENT "segment" Value
    SELECT "select" Value
    SHRINKAGE "shrinkage" Value
    SMOOTH_STATES "smooth_states" Value
    STABILITY "stability" Switch
    STABLE "stable" Optional
    STAMP "stamp" Value
    STATES "states" Value
    TERMS "terms" Value
    THRESHOLD "threshold" Value
    TIME "time" Value
    TIME_UNIT "time_unit" Value
    TO "to" Value
    TOPIC "topic" Value
    TSQR "tsqr" Switch
    UNSEEN_LABELS "unseen_labels" Value
    WEAK "weak" Value
    WHERE "where" Value
}

named! { Section Section<'static>:
    AUTO "auto" CLOCKS "clocks" CONSTRAINTS "constraints" COLUMNS "columns" CONTROL "control" EPISODES "[episodes]" ESTIMATE "estimate" FILES "files" FILTER_SECTION "filter"
    INPUTS_SECTION "inputs" JOIN "join" LATENTS "latents" LIBRARY_SECTION "library" MODEL "model" NARX "narx" PARAMETERS "parameters" PREPARE_SECTION "prepare"
    PWA "pwa" RESIMULATE_SECTION "resimulate" SINDY "sindy" SPARSE "sparse" STATES_SECTION "states" TASKS "tasks" TIME_SECTION "time"
}

named! { Command Command:
    CONTROL_LQR "control lqr" CONTROL_MPC "control mpc" FILTER "filter" FIT_NARX "fit narx" FIT_NETWORK "fit network" FIT_PARAMETERS "fit parameters" FIT_PWA "fit pwa" FIT_SINDY "fit sindy" FIT_SPARSE "fit sparse"
    INFO "fleetfoot info" INFO_VALUES "fleetfoot info --values" INIT "fleetfoot init" PREPARE "fleetfoot prepare" ROLLOUT "fleetfoot rollout" SCAN "fleetfoot scan"
    SCORE "fleetfoot score" STATS_DROP "fleetfoot stats drop" STATS_INFO "fleetfoot stats info" STATS_MERGE "fleetfoot stats merge"
}
