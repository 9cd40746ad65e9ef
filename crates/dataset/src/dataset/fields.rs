//! The fields of logs, and rows seen through expressions over them.

use fleetfoot_data::setting::{EPISODES, JOIN, PREPARE};

use fleetfoot_data::{Column, Source, did_you_mean, nearest};
use fleetfoot_library::{Expr, ParseErrorKind};
use fleetfoot_log::{ArrayInfo, ColumnInfo, FileInfo, Log, TopicInfo};
use fleetfoot_recipe::{Error as RecipeError, Recipe, wildcard::is_match};

use super::{
    beside::of_other_file,
    selection::{label_names, renames},
};
use crate::{error::Error, logs::Logs};

/// Elements that `[*]` takes of an array at most.
const MOST_ELEMENTS: usize = 4096;

/// Names that a message proposes.
const MOST_NAMES: usize = 3;

/// The fields of the first log, and the labels that the recipe gives to episodes; and what a file says of its topics.
pub(crate) fn fields(recipe: &Recipe, logs: &Logs) -> Result<(Vec<Column>, Option<FileInfo>), Error> {
    let (logs, _) = logs.by(recipe)?;
    let column =
        |info: &ColumnInfo| Column { name: info.name.clone(), unit: info.unit.clone(), kind: info.kind.clone() };
    let Some(first) = logs.all().first() else { return Err(Error::missing("no file is given".into())) };
    let (mut fields, info) = match first {
        Log::File(file) => {
            let info = logs.info(file)?.renamed(&renames(recipe));
            let mut columns: Vec<Column> = info.columns.iter().map(column).collect();
            columns.extend(elements(&recipe.to_toml(), &info.arrays));
            (columns, Some(info))
        }
        Log::Run(run) => {
            let info = fleetfoot_log::inspect_run(run)?;
            (info.columns.iter().map(column).collect(), Some(info))
        }
        Log::Table(table) => (table.columns().to_vec(), None),
    };
    for label in label_names(recipe) {
        if fields.iter().any(|field| field.name == label) {
            let problem = format!(
                "the label `{label}` of {EPISODES} is the name of a field of {} too; rename the label",
                first.path().display()
            );
            return Err(Error::name_taken(label, problem));
        }
        fields.push(Column::float(label));
    }
    Ok((fields, info))
}

/// The elements of long arrays that a recipe names, alone or by `[*]`: they are not listed among the fields.
fn elements(recipe: &str, arrays: &[ArrayInfo]) -> Vec<Column> {
    let mut names: Vec<String> = Vec::new();
    for ArrayInfo { name, longest, .. } in arrays {
        for (at, _) in recipe.match_indices(name.as_str()) {
            let Some(rest) = recipe[at + name.len()..].strip_prefix('[') else { continue };
            let Some((index, rest)) = rest.split_once(']') else { continue };
            // Text behind the index, of an array of structures.
            let end =
                rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '.' | '_' | '[' | ']'))).unwrap_or(rest.len());
            let part = &rest[..end];
            match (index, index.parse::<usize>()) {
                ("*", _) => {
                    names.extend((0..(*longest).min(MOST_ELEMENTS)).map(|index| format!("{name}[{index}]{part}")))
                }
                (_, Ok(index)) if index < *longest => names.push(format!("{name}[{index}]{part}")),
                _ => {}
            }
        }
    }
    names.sort_unstable();
    names.dedup();
    names.into_iter().map(Column::float).collect()
}

/// Notes on patterns of `[join]` that match no field of the first log, and so have no effect.
pub(crate) fn idle_joins(recipe: &Recipe, read: &[String], logs: &Logs) -> Result<Vec<String>, Error> {
    let is_open = |pattern: &&String| !read.iter().any(|name| is_match(pattern, name));
    let open: Vec<&String> = recipe.join.keys().filter(is_open).collect();
    if open.is_empty() {
        return Ok(Vec::new());
    }
    let (fields, _) = fields(recipe, logs)?;
    let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    let warning = |pattern: &String| {
        let start = pattern.find('*').map_or("", |star| &pattern[..star]);
        // Read ones are what is meant before others.
        let mut below: Vec<String> =
            read.iter().filter(|name| !start.is_empty() && name.starts_with(start)).cloned().collect();
        if below.is_empty() {
            below = names
                .iter()
                .filter(|name| !start.is_empty() && name.starts_with(start))
                .map(|name| (*name).to_owned())
                .collect();
        }
        below.truncate(MOST_NAMES);
        let meant = if below.is_empty() { nearest(pattern, names.iter().copied()) } else { below };
        let star = if start.is_empty() {
            ""
        } else {
            "; a star stands for one part between dots, or for what is in one pair of brackets"
        };
        format!("{JOIN} \"{pattern}\" matches no field, so that it changes nothing{star}{}", did_you_mean(&meant))
    };
    let idle = open.into_iter().filter(|pattern| !names.iter().any(|name| is_match(pattern, name)));
    Ok(idle.map(warning).collect())
}

/// The error, or, when a name is unknown because its topic cannot be read, why it cannot.
pub(crate) fn explained(error: RecipeError, info: Option<&FileInfo>, logs: &Logs) -> Error {
    let Some(info) = info else { return error.into() };
    let is_run = !info.format.is_log() && !info.topics.is_empty();
    let named = |error: RecipeError| match error {
        RecipeError::UnknownColumn { place, name, candidates } => {
            if let Some(note) = of_other_file(&place, &name, info, logs) {
                return note;
            }
            RecipeError::UnknownColumn { place: format!("{}: {place}", info.path.display()), name, candidates }.into()
        }
        RecipeError::Expression { place, text, source } if is_run => {
            RecipeError::Expression { place: format!("{}: {place}", info.path.display()), text, source }.into()
        }
        other => other.into(),
    };
    let name = match &error {
        RecipeError::UnknownColumn { name, .. } => name.clone(),
        RecipeError::Expression { source, .. } => match source.kind() {
            ParseErrorKind::UnknownName { name, .. } => name.clone(),
            _ => return error.into(),
        },
        _ => return error.into(),
    };
    let of_name = |topic: &&TopicInfo| {
        name.trim().strip_prefix(topic.name.as_str()).is_some_and(|rest| rest.starts_with(['.', '[']))
    };
    let Some(topic) = info.topics.iter().filter(of_name).max_by_key(|topic| topic.name.len()) else {
        return named(error);
    };
    let problem = match (&topic.problem, topic.messages) {
        (Some(problem), _) => problem.clone(),
        (None, Some(0)) => "it has no messages: choose another topic".to_owned(),
        _ => return named(error),
    };
    let place = info.path.display();
    Error::undetermined(format!("{place}: {} ({}) cannot be read: {problem}", topic.name, topic.type_name))
}

/// The error; where a model of prepared logs lacks a column, that logs must be prepared for it.
pub(crate) fn unprepared(error: Error, recipe: &Recipe) -> Error {
    let unknown = match &error {
        Error::Recipe(RecipeError::UnknownColumn { .. }) => true,
        Error::Recipe(RecipeError::Expression { source, .. }) => {
            matches!(source.kind(), ParseErrorKind::UnknownName { .. })
        }
        _ => false,
    };
    if !unknown || recipe.time.smoothed.is_none() {
        return error;
    }
    Error::missing(format!(
        "{error}; the model was fitted on logs that {PREPARE} wrote: prepare these logs with the same recipe, and give what it writes"
    ))
}

/// Aliases, each with what its numbers stand for, which is known once all files are open.
pub(crate) fn described(source: &dyn Source, aliases: &[(Column, Expr)]) -> Vec<(Column, Expr)> {
    let mut aliases = aliases.to_vec();
    for (column, expression) in &mut aliases {
        if let Some(field) = expression.as_column().and_then(|name| source.column_index(name)) {
            column.kind = source.columns()[field].kind.clone();
        }
    }
    aliases
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recipe_names_elements_of_long_arrays() {
        let mut info = ArrayInfo::default();
        (info.name, info.longest) = ("/load_cell_data.data".into(), 120);
        let names = |text: &str, info: &ArrayInfo| {
            elements(text, std::slice::from_ref(info)).into_iter().map(|column| column.name).collect::<Vec<_>>()
        };
        let recipe = "f = \"/load_cell_data.data[0] + /load_cell_data.data[7]\"\nx = \"/load_cell_data.data[120]\"";
        assert_eq!(names(recipe, &info), ["/load_cell_data.data[0]", "/load_cell_data.data[7]"]);
        info.longest = 3;
        assert_eq!(names("q = \"/load_cell_data.data[*]\"", &info).len(), 3);
        assert_eq!(names("q = \"/load_cell_data.data[*].f.x\"", &info)[2], "/load_cell_data.data[2].f.x");
    }
}
