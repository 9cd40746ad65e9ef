//! One set of columns out of the columns of many files: kinds joined, categories numbered alike.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use fleetfoot_data::{Column, ColumnKind};

use crate::{Error, table::TableColumn};

/// The columns of a recording, and for each file and column how its category codes become the recording's (`None`: they are the same).
pub(crate) struct ColumnSet {
    pub columns: Vec<Column>,
    pub recode: Vec<Vec<Option<Vec<f64>>>>,
}

/// Joins the selected columns of all files.
pub(crate) fn join(files: &[(&Path, &[TableColumn])]) -> Result<ColumnSet, Error> {
    let count = files.first().map_or(0, |(_, columns)| columns.len());
    let mut columns = Vec::with_capacity(count);
    let mut recode = vec![Vec::with_capacity(count); files.len()];
    for c in 0..count {
        let joined = join_column(files, c)?;
        for ((_, file_column), recode) in files.iter().zip(&mut recode) {
            recode.push(codes(&file_column[c].column.kind, &joined.kind));
        }
        columns.push(joined);
    }
    Ok(ColumnSet { columns, recode })
}

fn join_column(files: &[(&Path, &[TableColumn])], c: usize) -> Result<Column, Error> {
    let mut unit: Option<(&Path, &String)> = None;
    let mut seen: Option<(&Path, ColumnKind)> = None;
    let mut names = BTreeSet::new();
    for (path, columns) in files {
        let TableColumn { column, empty } = &columns[c];
        if let Some(unit_text) = &column.unit {
            match unit {
                Some((first, other)) if other != unit_text => {
                    return Err(disagree(
                        &column.name,
                        (first, format!("in {other}")),
                        (path, format!("in {unit_text}")),
                    ));
                }
                _ => unit = Some((path, unit_text)),
            }
        }
        if *empty {
            continue;
        }
        if let ColumnKind::Category(words) = &column.kind {
            names.extend(words.iter().cloned());
        }
        seen = Some(match seen {
            None => (path, column.kind.clone()),
            Some((first, kind)) => match join_kind(&kind, &column.kind) {
                Some(kind) => (first, kind),
                None => {
                    return Err(disagree(&column.name, (first, word(&kind).into()), (path, word(&column.kind).into())));
                }
            },
        });
    }
    let first = &files[0].1[c].column;
    let kind = match seen {
        Some((_, ColumnKind::Category(_))) => ColumnKind::Category(names.into_iter().collect()),
        Some((_, kind)) => kind,
        None => first.kind.clone(),
    };
    Ok(Column { name: first.name.clone(), unit: unit.map(|(_, unit)| unit.clone()), kind })
}

fn join_kind(a: &ColumnKind, b: &ColumnKind) -> Option<ColumnKind> {
    use ColumnKind::{Boolean, Category, Float, Integer};
    match (a, b) {
        (Category(_), Category(_)) => Some(Category(Vec::new())),
        (Category(_), _) | (_, Category(_)) => None,
        (Boolean, Boolean) => Some(Boolean),
        (Integer | Boolean, Integer | Boolean) => Some(Integer),
        (Float, _) | (_, Float) => Some(Float),
    }
}

fn word(kind: &ColumnKind) -> &'static str {
    match kind {
        ColumnKind::Category(_) => "text",
        _ => "numbers",
    }
}

fn disagree(column: &str, first: (&Path, String), second: (&Path, String)) -> Error {
    Error::ColumnsDisagree {
        column: column.into(),
        first: first.0.into(),
        first_is: first.1,
        second: second.0.into(),
        second_is: second.1,
    }
}

fn codes(kind: &ColumnKind, joined: &ColumnKind) -> Option<Vec<f64>> {
    let (ColumnKind::Category(kind), ColumnKind::Category(joined)) = (kind, joined) else {
        return None;
    };
    if kind == joined {
        return None;
    }
    let places: BTreeMap<&str, usize> = joined.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    Some(kind.iter().map(|name| places.get(name.as_str()).map_or(f64::NAN, |&i| i as f64)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(kind: ColumnKind, unit: Option<&str>, empty: bool) -> TableColumn {
        TableColumn { column: Column { name: "c".into(), unit: unit.map(Into::into), kind }, empty }
    }

    fn category(names: &[&str]) -> ColumnKind {
        ColumnKind::Category(names.iter().map(|&name| name.into()).collect())
    }

    #[test]
    fn categories_are_numbered_alike_in_all_files() {
        let a = [column(category(&["b", "d"]), None, false)];
        let b = [column(category(&["a", "b"]), None, false)];
        let empty = [column(ColumnKind::Float, None, true)];
        let set = join(&[(Path::new("a"), &a), (Path::new("e"), &empty), (Path::new("b"), &b)]).unwrap();
        assert_eq!(set.columns[0].kind, category(&["a", "b", "d"]));
        assert_eq!(set.recode[0][0], Some(vec![1.0, 2.0]));
        assert_eq!(set.recode[1][0], None);
        assert_eq!(set.recode[2][0], Some(vec![0.0, 1.0]));
    }

    #[test]
    fn numbers_widen_and_texts_do_not_mix_with_them() {
        let int = [column(ColumnKind::Integer, Some("m"), false)];
        let float = [column(ColumnKind::Float, None, false)];
        let text = [column(category(&["x"]), None, false)];
        let feet = [column(ColumnKind::Float, Some("ft"), false)];
        let set = join(&[(Path::new("a"), &int), (Path::new("b"), &float)]).unwrap();
        assert_eq!((set.columns[0].kind.clone(), set.columns[0].unit.as_deref()), (ColumnKind::Float, Some("m")));
        let message = join(&[(Path::new("a"), &int), (Path::new("b"), &text)]).err().unwrap().to_string();
        assert!(message.contains("numbers in a") && message.contains("text in b"), "{message}");
        assert!(join(&[(Path::new("a"), &int), (Path::new("b"), &feet)]).is_err());
    }
}
