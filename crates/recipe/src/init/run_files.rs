//! A recipe for runs of several files: `[files]` joins them, and their columns are called `topic.column`.

use std::fmt::Write;

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_log::{ClockInfo, DetectedRuns, Error, inspect};

use super::{
    columns_heading, episodes_section, heading, is_angle, key, method_section, model_section, names::Names,
    short::short_names, states_heading, text, unit,
};

/// Words in a file's name that mark its columns. Commands are inputs; states are measured values of the robot's place
/// and motion.
const COMMANDS: [&str; 6] = ["cmd", "command", "control", "input", "setpoint", "action"];
const STATES: [&str; 7] = ["odom", "state", "pose", "joint", "position", "velocity", "mocap"];

/// The recipe's text, with a draft: the states are the columns of one file, the inputs those of commands.
///
/// # Errors
/// A file that cannot be read.
pub fn starter_recipe_of_runs(runs: &DetectedRuns) -> Result<String, Error> {
    let mut topics = Vec::new();
    let mut clocks = Vec::new();
    for (topic, path) in runs.runs.first().map_or(&[][..], |run| &run.files) {
        let info = inspect(path)?;
        let is_clock = |name: &str| {
            info.clock.as_ref().is_some_and(|clock| clock.column == name || clock.beside.as_deref() == Some(name))
        };
        let columns = info.columns.iter().filter(|column| column.unsupported.is_none() && !is_clock(&column.name));
        let columns = columns.map(|column| Column {
            name: format!("{topic}.{}", column.name),
            unit: column.unit.clone(),
            kind: column.kind.clone(),
        });
        topics.push((topic.as_str(), columns.collect::<Vec<Column>>()));
        clocks.extend(info.clock.clone().map(|clock| (topic.as_str(), clock)));
    }
    Ok(recipe(runs, &topics, &clocks))
}

fn recipe(runs: &DetectedRuns, topics: &[(&str, Vec<Column>)], clocks: &[(&str, ClockInfo)]) -> String {
    let is_of = |topic: &str, words: &[&str]| words.iter().any(|word| topic.to_lowercase().contains(word));
    let is_command = |topic: &str| is_of(topic, &COMMANDS);
    let measured = || topics.iter().map(|(topic, _)| *topic).filter(|topic| !is_command(topic));
    let base = measured().find(|topic| is_of(topic, &STATES)).or_else(|| measured().next());
    let base = base.or(topics.first().map(|(topic, _)| *topic)).unwrap_or_default();
    let all: Vec<&Column> = topics.iter().flat_map(|(_, columns)| columns).collect();
    let short = short_names(&all);
    let mut names = Names::default();
    let mut out = String::new();
    let folder = runs.runs.first().map(|run| run.folder.file_name().unwrap_or_default().to_string_lossy());
    heading(&mut out, &folder.unwrap_or_default());
    let _ = writeln!(
        out,
        "# The files of a run, a topic each; every folder that has them is a run. A pattern may hold * and folders."
    );
    let _ = writeln!(out, "[files]");
    for (topic, pattern) in &runs.patterns {
        let _ = writeln!(out, "{} = {}", key(topic), text(pattern));
    }
    out.push('\n');
    columns_heading(&mut out);
    let (mut states, mut inputs) = (Vec::new(), Vec::new());
    let mut at = 0;
    for (topic, columns) in topics {
        let _ = writeln!(out, "# {topic}");
        for column in columns {
            let name = names.take(&short[at]);
            at += 1;
            let is_number = matches!(column.kind, ColumnKind::Float | ColumnKind::Integer);
            let is_input = is_command(topic) && *topic != base;
            let mark = if is_number && (*topic == base || is_input) { "" } else { "# " };
            let _ = writeln!(out, "{mark}{} = {}{}", key(&name), text(&column.name), unit(column));
            if mark.is_empty() {
                let details = if is_angle(&column.name) { "{ kind = \"angle\" }" } else { "{}" };
                if is_input { inputs.push(name) } else { states.push((name, details)) }
            }
        }
    }
    out.push('\n');
    let columns: Vec<Column> = all.into_iter().cloned().collect();
    states_heading(&mut out, &columns);
    for (name, details) in &states {
        let _ = writeln!(out, "{} = {details}", key(name));
    }
    let _ = writeln!(out, "\n# Inputs: columns that drive the model.\n[inputs]");
    for name in &inputs {
        let _ = writeln!(out, "{} = {{}}", key(name));
    }
    let _ = writeln!(out, "\n# Every file has its own clock:");
    for (topic, clock) in clocks {
        let _ = writeln!(out, "#   {topic}: {}", clock.column.replace(['\n', '\r'], " "));
    }
    let _ = writeln!(out, "[time]");
    let _ = writeln!(
        out,
        "base = {}   # its rows are the rows; the other files are joined to them; or rate = 100",
        text(base)
    );
    model_section(&mut out);
    method_section(&mut out);
    episodes_section(&mut out);
    out
}
