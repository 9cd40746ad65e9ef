//! Columns in other files of the same folder: files of one run that no `[files]` joins.

use std::path::{Path, PathBuf};

use fleetfoot_data::setting::FILES;
use fleetfoot_log::{FileInfo, Format, inspect, shell_word};
use fleetfoot_recipe::Recipe;

use crate::{error::Error, logs::Logs};

/// Files beside a file that are looked at.
const MOST_FILES: usize = 20;

/// The advice to join files of one run by `[files]`, where a file of the same call has the column that is missing.
fn mend(file: &Path, column: &str) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let topic: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    format!(
        "if they are files of one run, join them: {FILES} in the recipe has a line for each ({topic} = \"{name}\"), the column is `{topic}.{column}` then, and the folder is the data"
    )
}

/// The error of a column that the first log lacks; where a table beside it, of other columns, has it: with what joins the two.
pub(super) fn of_other_file(place: &str, column: &str, info: &FileInfo, logs: &Logs) -> Option<Error> {
    if info.format.is_log() || !info.topics.is_empty() {
        return None;
    }
    let names = |info: &FileInfo| info.columns.iter().map(|its_column| its_column.name.clone()).collect::<Vec<_>>();
    let first = names(info);
    // But for the clock.
    let has_alone = |path: &PathBuf| {
        let names_there = inspect(path).map_or_else(|_| Vec::new(), |info| names(&info));
        names_there.iter().any(|name| name == column)
            && names_there.iter().filter(|name| first.contains(name)).count() < 2
    };
    let is_beside = |path: &PathBuf| {
        let is_table = Format::of(path).is_some_and(|format| !format.is_log());
        is_table && *path != info.path && path.parent() == info.path.parent()
    };
    let other = logs.files().into_iter().filter(is_beside).take(MOST_FILES).find(has_alone)?;
    let (path, other_path) = (info.path.display(), other.display());
    Some(Error::unknown(
        column,
        format!("{path}: {place}: there is no column `{column}`; {other_path} has it: {}", mend(&other, column)),
    ))
}

/// The error of opening; where a file has none of the columns that are read, with what joins it to the others.
pub(super) fn of_no_column(error: fleetfoot_log::Error, recipe: &Recipe, columns: &[String], files: usize) -> Error {
    let fleetfoot_log::Error::MissingColumn { path, column, .. } = &error else { return error.into() };
    let has_one =
        || inspect(path).map_or(true, |info| info.columns.iter().any(|its_column| columns.contains(&its_column.name)));
    if !recipe.files.is_empty() || files < 2 || has_one() {
        return error.into();
    }
    let mend = mend(path, "COLUMN");
    let list = shell_word(&path.to_string_lossy());
    let message = format!(
        "{} has none of the columns that are read (`info {list}` lists its own), as other files do: {mend}",
        path.display()
    );
    Error::unknown(column, message)
}
