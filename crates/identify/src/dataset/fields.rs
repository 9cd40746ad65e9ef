//! The fields of logs, and rows seen through expressions over them.

use fleetfoot_data::{Column, Source};
use fleetfoot_library::{Expr, ParseErrorKind};
use fleetfoot_log::{ColumnInfo, FileInfo, Log, TopicInfo};

use super::selection::{label_names, renames};
use crate::{Error, Logs, Recipe};

/// The fields of the first log, and the labels that the recipe gives to episodes; and what a file says of its topics.
pub(crate) fn fields(recipe: &Recipe, logs: &Logs) -> Result<(Vec<Column>, Option<FileInfo>), Error> {
    let Some(first) = logs.all().first() else { return Err(Error::missing("no file is given".into())) };
    let (mut fields, info) = match first {
        Log::File(file) => {
            let info = fleetfoot_log::inspect(file)?.renamed(&renames(recipe));
            let column = |info: &ColumnInfo| Column {
                name: info.name.clone(),
                unit: info.unit.clone(),
                kind: info.kind.clone(),
            };
            (info.columns.iter().map(column).collect::<Vec<_>>(), Some(info))
        }
        Log::Table(table) => (table.columns().to_vec(), None),
    };
    for label in label_names(recipe) {
        if fields.iter().any(|field| field.name == label) {
            let problem = format!(
                "the label `{label}` of [[episodes]] is the name of a field of {} too; rename the label",
                first.path().display()
            );
            return Err(Error::name_taken(label, problem));
        }
        fields.push(Column::float(label));
    }
    Ok((fields, info))
}

/// The error, or, when a name is unknown because its topic cannot be read, why it cannot.
pub(crate) fn explained(error: Error, info: Option<&FileInfo>) -> Error {
    let Some(info) = info else { return error };
    let name = match &error {
        Error::UnknownColumn { name, .. } => name.clone(),
        Error::Expression { source, .. } => match source.kind() {
            ParseErrorKind::UnknownName { name, .. } => name.clone(),
            _ => return error,
        },
        _ => return error,
    };
    let of_name = |topic: &&TopicInfo| {
        name.trim().strip_prefix(topic.name.as_str()).is_some_and(|rest| rest.starts_with(['.', '[']))
    };
    let Some(topic) = info.topics.iter().filter(of_name).max_by_key(|topic| topic.name.len()) else { return error };
    let problem = match (&topic.problem, topic.messages) {
        (Some(problem), _) => problem.clone(),
        (None, Some(0)) => "it has no messages: choose another topic".to_owned(),
        _ => return error,
    };
    let place = info.path.display();
    Error::undetermined(format!("{place}: {} ({}) cannot be read: {problem}", topic.name, topic.type_name))
}

/// The error; where a model of prepared logs lacks a column, that logs must be prepared for it.
pub(crate) fn unprepared(error: Error, recipe: &Recipe) -> Error {
    let unknown = match &error {
        Error::UnknownColumn { .. } => true,
        Error::Expression { source, .. } => matches!(source.kind(), ParseErrorKind::UnknownName { .. }),
        _ => false,
    };
    if !unknown || recipe.time.smoothed.is_none() {
        return error;
    }
    Error::missing(format!(
        "{error}; the model was fitted on logs that `fleetfoot prepare` wrote: prepare these logs with the same recipe, and give what it writes"
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
