//! Common interface of the robots, for any parameters.

use std::any::type_name;

use fleetfoot_sim::{ParameterError, Scenario, excitation::Axis};
use serde::{Serialize, de::DeserializeOwned};
use toml::Table;

use super::recipes::RecipeParts;

/// Common facts about all worlds of one robot, whose parameters are a `P`.
pub(super) struct Kind<P> {
    /// As the user calls it, and the beginning of its files' names.
    pub(super) name: &'static str,
    /// The parameter that `--speed` sets, as the path of a key.
    pub(super) speed: Option<&'static str>,
    /// Excites the robot by a kind of signal over ranges that suit it; `None` if nothing but its controller drives it.
    pub(super) excite: Option<Excite<P>>,
    /// The columns, with their ranges and bins, that runs should spread over evenly.
    pub(super) spread: &'static [(&'static str, Axis)],
    /// True if its logs are tables by default, and no messages.
    pub(super) tables: bool,
    /// Recipe of its logs.
    pub(super) recipe: RecipeParts,
    /// Default length of a run, seconds.
    pub(super) seconds: f64,
    /// The scenario of some parameters, which it checks.
    pub(super) scenario: fn(P) -> Result<Box<dyn Scenario>, ParameterError>,
}

/// Sets the excitation to one of [`fleetfoot_sim::Excitation::KINDS`].
type Excite<P> = fn(&mut P, &str) -> Result<(), ParameterError>;

/// A robot whose parameters' type is not known.
pub(super) trait Robot: Send + Sync {
    fn name(&self) -> &'static str;
    fn speed(&self) -> Option<&'static str>;
    fn excitable(&self) -> bool;
    fn spread(&self) -> &'static [(&'static str, Axis)];
    fn tables(&self) -> bool;
    fn seconds(&self) -> f64;
    fn recipe(&self) -> &RecipeParts;
    /// The name of the parameters' type.
    fn type_name(&self) -> &'static str;
    /// The default parameters.
    fn defaults(&self) -> Result<Table, String>;
    /// All parameters where a text gives some, checked.
    fn parse(&self, text: &str) -> Result<Table, String>;
    /// The parameters of a table, checked, with their scenario.
    fn build(&self, table: &Table) -> Result<(Table, Box<dyn Scenario>), String>;
    /// The parameters of a table with the excitation of a kind.
    fn excite(&self, table: &Table, kind: &str) -> Result<Table, String>;
}

impl<P: Serialize> Kind<P> {
    /// Allowed parameters, all of them, with their scenario.
    fn checked(&self, parameters: P) -> Result<(Table, Box<dyn Scenario>), String> {
        let table = Table::try_from(&parameters).map_err(|error| error.to_string())?;
        let scenario = (self.scenario)(parameters).map_err(|error| error.to_string())?;
        Ok((table, scenario))
    }
}

impl<P: Serialize + DeserializeOwned + Default + 'static> Robot for Kind<P> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn speed(&self) -> Option<&'static str> {
        self.speed
    }

    fn excitable(&self) -> bool {
        self.excite.is_some()
    }

    fn spread(&self) -> &'static [(&'static str, Axis)] {
        self.spread
    }

    fn tables(&self) -> bool {
        self.tables
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }

    fn recipe(&self) -> &RecipeParts {
        &self.recipe
    }

    fn type_name(&self) -> &'static str {
        type_name::<P>()
    }

    fn defaults(&self) -> Result<Table, String> {
        Table::try_from(P::default()).map_err(|error| error.to_string())
    }

    fn parse(&self, text: &str) -> Result<Table, String> {
        let parameters: P = toml::from_str(text).map_err(|error| error.to_string())?;
        Ok(self.checked(parameters)?.0)
    }

    fn build(&self, table: &Table) -> Result<(Table, Box<dyn Scenario>), String> {
        self.checked(parameters_of(table)?)
    }

    fn excite(&self, table: &Table, kind: &str) -> Result<Table, String> {
        let mut parameters: P = parameters_of(table)?;
        let Some(excite) = self.excite else { return Err("this robot has no excitation that could be chosen".into()) };
        excite(&mut parameters, kind).map_err(|error| error.to_string())?;
        Ok(self.checked(parameters)?.0)
    }
}

/// Parameters from a table, by its text. Every robot's parameters are then read by one deserializer; reading the table
/// itself would compile a second one for each of them.
fn parameters_of<P: DeserializeOwned>(table: &Table) -> Result<P, String> {
    toml::from_str(&table.to_string()).map_err(|error| error.message().to_owned())
}
