//! A piece as a Parquet file.

use std::{collections::BTreeSet, path::Path};

use fleetfoot_data::ColumnKind;
use fleetfoot_data::setting::COLUMNS;
use fleetfoot_dataset::{Error, PREPARED};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

use crate::{channel::Curve, columns::Planned};

/// File names, each given once.
#[derive(Default)]
pub(crate) struct Names {
    given: BTreeSet<String>,
}

impl Names {
    /// A name for a piece of an episode: the episode's without its file's ending, with a number where there are several of it.
    pub(crate) fn next(&mut self, episode: &str) -> String {
        let (file, number) = episode.split_once('#').map_or((episode, None), |(file, number)| (file, Some(number)));
        let stem = Path::new(file).with_extension("");
        let plain = |letter: char| if letter.is_alphanumeric() || "-_".contains(letter) { letter } else { '_' };
        let stem: String = stem.to_string_lossy().trim_start_matches(['.', '/']).chars().map(plain).collect();
        let stem = number.map_or_else(|| stem.clone(), |number| format!("{stem}_{number}"));
        let numbered = (2..).map(|at: usize| format!("{stem}-{at}"));
        let free =
            std::iter::once(stem.clone()).chain(numbered).find(|name| !self.given.contains(name)).unwrap_or(stem);
        self.given.insert(free.clone());
        format!("{free}{PREPARED}")
    }
}

/// A column as it is written.
pub(crate) enum Written<'a> {
    Numbers(Vec<f64>),
    Text(Vec<&'a str>),
}

/// The names that are written, in order.
pub(crate) fn columns(planned: &[Planned], time: &str) -> Result<Vec<WriteColumn>, Error> {
    let mut columns = vec![WriteColumn::new(time, WriteKind::Stamp)];
    for planned in planned {
        let kind = if matches!(planned.kind, ColumnKind::Category(_)) { WriteKind::Text } else { WriteKind::Float };
        let with_unit = |name: String, unit: &Option<String>| {
            let plain = WriteColumn::new(name, kind);
            unit.iter().fold(plain, |column, unit| column.with_unit(unit))
        };
        let (names, units) = (planned.names(), planned.units());
        columns.extend(names.iter().zip(&units).map(|(name, unit)| with_unit(name.clone(), unit)));
        if planned.has_deviations() {
            columns.extend(names.iter().zip(&units).map(|(name, unit)| with_unit(format!("{name}_deviation"), unit)));
        }
    }
    unique(columns, "a column of the log has the name of a derivative")
}

/// The columns, if each has a unique name; `why`: reason for which two may share one.
pub(crate) fn unique(columns: Vec<WriteColumn>, why: &str) -> Result<Vec<WriteColumn>, Error> {
    let mut seen = BTreeSet::new();
    match columns.iter().find(|column| !seen.insert(column.name.as_str())) {
        None => Ok(columns),
        Some(twice) => {
            let name = twice.name.clone();
            let problem = format!("`{name}` would be written twice: {why}; give it another name in {COLUMNS}");
            Err(Error::name_taken(name, problem))
        }
    }
}

/// Written values of a column, in the order of [`columns`]; `values`: those of the written rows.
pub(crate) fn values<'a>(planned: &'a Planned, values: Vec<f64>, curve: Option<Curve>) -> Vec<Written<'a>> {
    if let Some(curve) = curve {
        return curve.derivatives.into_iter().chain(curve.deviations).map(Written::Numbers).collect();
    }
    let ColumnKind::Category(names) = &planned.kind else { return vec![Written::Numbers(values)] };
    let name = |code: &f64| if *code >= 0.0 { names.get(*code as usize).map_or("", String::as_str) } else { "" };
    vec![Written::Text(values.iter().map(name).collect())]
}

/// Writes a file.
pub(crate) fn write(
    path: &Path,
    columns: Vec<WriteColumn>,
    stamps: &[i64],
    rows: &[Written<'_>],
    options: &WriteOptions,
) -> Result<(), Error> {
    let mut writer = ParquetWriter::create(path, columns, options)?;
    let all = rows.iter().map(|column| match column {
        Written::Numbers(numbers) => Values::Float(numbers),
        Written::Text(texts) => Values::Text(texts),
    });
    writer.write(&std::iter::once(Values::Integer(stamps)).chain(all).collect::<Vec<_>>())?;
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests {
    use fleetfoot_dataset::is_prepared;

    use super::*;

    #[test]
    fn names_are_given_once() {
        let mut names = Names::default();
        let given = ["run.csv", "run.csv", "a/run.csv#2", "../x y.mcap"].map(|episode| names.next(episode));
        assert_eq!(given, ["run.clean.parquet", "run-2.clean.parquet", "a_run_2.clean.parquet", "x_y.clean.parquet"]);
        assert!(given.iter().all(|name| is_prepared(name)) && !is_prepared("run.parquet"));
    }
}
