//! The words of Python in messages of the engine: arguments in the place of flags, estimators and methods in the place of commands.

use fleetfoot::data::setting::{Command, Kind, Setting, Wording};

/// Wording of messages by arguments.
pub(crate) struct Arguments;

impl Wording for Arguments {
    fn setting(&self, setting: Setting, value: Option<&str>) -> String {
        let name = argument(setting.name);
        match value {
            Some(value) => format!("{name}={}", value.split(" | ").map(literal).collect::<Vec<_>>().join(" | ")),
            None if setting.kind == Kind::Switch => format!("{name}=True"),
            None => format!("{name}="),
        }
    }

    fn section(&self, section: &str, entry: Option<&str>, value: Option<&str>) -> String {
        let Some(entry) = entry else {
            return if OF_RECIPES.contains(&section) { format!("[{section}]") } else { section.to_owned() };
        };
        let name =
            if named_by_user(section) { format!("{section}[{}]", literal(entry)) } else { argument(entry).to_owned() };
        value.map_or_else(|| name.clone(), |value| format!("{name}={}", literal(value)))
    }

    fn assigned(&self, place: &str, text: &str) -> String {
        format!("{}={}", place.trim_end_matches('='), literal(&format!("\"{text}\"")))
    }

    fn clock(&self, column: &str, unit: &str) -> String {
        format!("recipe={{\"time\": {{\"column\": \"{column}\", \"unit\": \"{unit}\"}}}}")
    }

    fn value(&self, value: &str) -> String {
        literal(value)
    }

    fn command(&self, command: Command, setting: Option<&str>) -> String {
        let name = match command.0 {
            "fit pwa" => "PWA",
            "fit sindy" => "SINDy",
            "fit narx" => "NARX",
            "fit network" => "Network",
            "fit sparse" => "BlockSparse",
            "fit parameters" => "Parameters",
            "control lqr" => "Model.lqr",
            "control mpc" => "Model.mpc",
            "filter" => "Model.filter",
            "fleetfoot score" => "Model.score",
            "fleetfoot rollout" => "Model.rollout",
            "fleetfoot info --values" => return "fleetfoot.info(path, values=True)".to_owned(),
            "fleetfoot stats drop" => "Stats.drop",
            "fleetfoot stats info" => "Stats",
            "fleetfoot stats merge" => "fleetfoot.merge",
            "fleetfoot init" => "fleetfoot init",
            other => return call(&other.replace(' ', "."), setting),
        };
        call(name, setting)
    }
}

fn call(name: &str, setting: Option<&str>) -> String {
    setting.map_or_else(|| name.to_owned(), |setting| format!("{name}({setting})"))
}

/// Sections that are no argument of any call: they stand in a recipe.
const OF_RECIPES: [&str; 5] = ["clocks", "[episodes]", "files", "join", "prepare"];

/// Returns true if the user gives the names of a section's entries: of states, of constraints.
fn named_by_user(section: &str) -> bool {
    ["states", "inputs", "latents", "tasks", "parameters", "columns", "constraints", "join", "files", "clocks"]
        .contains(&section)
}

/// The argument of a setting, where its name is another one in Python.
fn argument(setting: &str) -> &str {
    match setting {
        "lambda" => "lam",
        "predict" => "target",
        "time" => "t",
        "outputs" => "feature_names",
        "key" => "keys",
        "episode" => "episodes",
        "file" => "files",
        "plane" => "axes",
        "functions" => "library",
        other => other,
    }
}

/// A value as Python writes it.
fn literal(value: &str) -> String {
    let unquoted = value.strip_prefix('"').and_then(|value| value.strip_suffix('"')).unwrap_or(value);
    match unquoted {
        "true" => "True".to_owned(),
        "false" => "False".to_owned(),
        number if number.parse::<f64>().is_ok() && unquoted == value => number.to_owned(),
        text if text.contains('\'') && !text.contains('"') => format!("\"{text}\""),
        text => format!("'{}'", text.replace('\'', "\\'")),
    }
}
