//! Worlds: every physical parameter of a simulated robot, its surroundings and its sensors, as TOML.

use std::{fmt, path::Path};

use fleetfoot_control::controller::Regulator;
use fleetfoot_data::setting::CONTROLLER;
use fleetfoot_data::{did_you_mean, nearest_one};
use fleetfoot_fit::Error;
use fleetfoot_log::Format as LogFormat;
use fleetfoot_sim::Scenario;
use toml::{Table, Value};

use super::{robot::Robot, robots::ROBOTS, world_file};

/// Keys of a log's metadata.
pub(super) const SCENARIO: &str = "fleetfoot.scenario";
pub(super) const WORLD: &str = "fleetfoot.world";

/// The names of the robots that can be simulated.
pub fn robots() -> Vec<&'static str> {
    ROBOTS.iter().map(|robot| robot.name()).collect()
}

/// A robot and all its parameters, checked.
#[derive(Clone)]
pub struct World {
    pub(super) robot: &'static dyn Robot,
    table: Table,
}

impl fmt::Debug for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("World").field("robot", &self.robot.name()).field("table", &self.table).finish()
    }
}

impl World {
    /// The default world of a robot.
    ///
    /// # Errors
    /// A robot that is not in [`robots`].
    pub fn of(robot: &str) -> Result<Self, Error> {
        match ROBOTS.iter().find(|known| known.name() == robot) {
            Some(&robot) => Self::default_of(robot),
            None => {
                Err(Error::unknown(robot, format!("there is no robot `{robot}`; there are {}", robots().join(", "))))
            }
        }
    }

    pub(super) fn default_of(robot: &'static dyn Robot) -> Result<Self, Error> {
        let table = robot.defaults().map_err(|problem| world_error(robot.name(), &problem))?;
        Ok(Self { robot, table })
    }

    /// The same robot with the parameters that a TOML text gives, the default ones where it is silent; `name` is its origin, for messages.
    ///
    /// # Errors
    /// A text that is no TOML; unknown keys, with the nearest known one and the line; values that are not allowed.
    pub fn parse(&self, text: &str, name: &str) -> Result<Self, Error> {
        let table = self.robot.parse(text).map_err(|problem| world_error(name, &problem))?;
        Ok(Self { robot: self.robot, table })
    }

    /// The same robot with the parameters of a TOML file, or of the world that a generated log was made in.
    ///
    /// # Errors
    /// A file that cannot be read, a log that has no world or another robot's, and those of [`World::parse`].
    pub fn read(&self, path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let is_log = matches!(LogFormat::of(path), Some(LogFormat::Mcap(_) | LogFormat::Parquet));
        if !is_log {
            let text = std::fs::read_to_string(path);
            return self.parse(&text.map_err(|error| world_error(&name, &format!("cannot be read: {error}")))?, &name);
        }
        let mut metadata = fleetfoot_log::metadata(path)?;
        match (metadata.remove(SCENARIO), metadata.remove(WORLD)) {
            (Some(robot), Some(world)) if robot == self.robot() => self.parse(&world, &name),
            (Some(robot), _) => {
                Err(world_error(&name, &format!("it is the log of a {robot}, not of a {}", self.robot())))
            }
            _ => Err(world_error(&name, "this log has no world, as fleetfoot did not generate it")),
        }
    }

    /// Sets the parameter at a path such as `belt.speed` to a value written as TOML; any other text is taken as a
    /// string.
    ///
    /// Setting a `kind` replaces the table that it is in, because another kind has other parameters: they have their defaults then.
    ///
    /// # Errors
    /// Unknown keys with the nearest known one, and values that are not allowed.
    pub fn set(&mut self, path: &str, value: &str) -> Result<(), Error> {
        let place = format!("{path} = {value}");
        let parsed =
            toml::from_str::<Table>(&format!("value = {value}")).ok().and_then(|mut table| table.remove("value"));
        let value = parsed.unwrap_or_else(|| Value::from(value));
        let mut keys: Vec<&str> = path.split('.').map(str::trim).collect();
        let last = keys.pop().unwrap_or_default();
        let mut table = self.table.clone();
        let mut inner = &mut table;
        for key in keys {
            if !inner.get(key).is_some_and(Value::is_table) {
                let tables = inner.iter().filter(|(_, value)| value.is_table()).map(|(key, _)| key.as_str());
                return Err(world_error(
                    &place,
                    &format!("there is no table `{key}`{}", did_you_mean(nearest_one(key, tables).as_slice())),
                ));
            }
            inner = match inner.get_mut(key) {
                Some(Value::Table(next)) => next,
                _ => return Err(world_error(&place, &format!("`{key}` must be a table"))),
            };
        }
        if last == "kind" {
            inner.clear();
        }
        inner.insert(last.to_owned(), value);
        self.table = self.robot.build(&table).map_err(|problem| world_error(&place, &problem))?.0;
        Ok(())
    }

    /// The same robot with a regulator in the place of its controller.
    ///
    /// # Errors
    /// A robot that takes none, and a regulator that reads columns or drives inputs that the robot does not have.
    pub fn regulate(&mut self, regulator: &Regulator) -> Result<(), Error> {
        let place = &CONTROLLER.to_string();
        let law = Table::try_from(regulator).map_err(|error| world_error(place, &error.to_string()))?;
        let mut table = self.table.clone();
        table.insert("regulator".to_owned(), Value::Table(law));
        self.table = self.robot.build(&table).map_err(|problem| world_error(place, &problem))?.0;
        Ok(())
    }

    /// The robot's name.
    pub fn robot(&self) -> &'static str {
        self.robot.name()
    }

    /// The parameter that a range of speeds sets; `None` if the robot has none such.
    pub fn speed_parameter(&self) -> Option<&'static str> {
        self.robot.speed()
    }

    /// Returns true if [`World::excite`] has an effect.
    pub fn excitable(&self) -> bool {
        self.robot.excitable()
    }

    /// Excites the robot by a kind of signal (one of [`fleetfoot_sim::Excitation::KINDS`]) over ranges that suit it.
    ///
    /// # Errors
    /// An unknown kind, and a robot that is driven by nothing but its controller.
    pub fn excite(&mut self, kind: &str) -> Result<(), Error> {
        let place = format!("excitation {kind}");
        self.table = self.robot.excite(&self.table, kind).map_err(|problem| world_error(&place, &problem))?;
        Ok(())
    }

    /// All parameters as TOML, which [`World::parse`] reads.
    pub fn to_toml(&self) -> String {
        // It was a TOML table all along.
        toml::to_string(&self.table).unwrap_or_default()
    }

    /// All parameters as TOML, each with its description and its unit.
    pub fn to_commented_toml(&self) -> String {
        let name = self.robot.name();
        let mut out = format!(
            "# The world of `fleetfoot generate {name} --world THIS`. Entries that you delete keep the values below.\n"
        );
        out.push_str("# SI units and radians; x forward, y left, z up.\n\n");
        out.push_str(&world_file::commented(&self.table, self.robot.type_name()));
        out
    }

    /// The scenario that the parameters describe.
    ///
    /// # Errors
    /// Parameters that are not allowed.
    pub fn scenario(&self) -> Result<Box<dyn Scenario>, Error> {
        Ok(self.robot.build(&self.table).map_err(|problem| world_error(self.robot.name(), &problem))?.1)
    }
}

/// An error of a world file, with the nearest name when a name is unknown.
fn world_error(name: &str, problem: &str) -> Error {
    let problem = problem.trim_end();
    // Text of serde about an unknown key or word: "unknown field `a`, expected one of `b`, `c`".
    let unknown = ["unknown field", "unknown variant"].iter().find_map(|what| problem.split_once(what));
    let hint = unknown.map(|(_, rest)| {
        let mut names = rest.split('`').skip(1).step_by(2);
        let wanted = names.next().unwrap_or_default();
        did_you_mean(nearest_one(wanted, names).as_slice())
    });
    Error::World { name: name.to_owned(), problem: format!("{problem}{}", hint.unwrap_or_default()) }
}
