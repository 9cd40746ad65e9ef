//! The window of a recurrent cell: functions of a library at the same rows back.

use fleetfoot_data::setting::{CELL, LAGS};
use fleetfoot_library::Expr;

use crate::error::Error;

/// A function that reads one row, and the same at other rows back.
struct Class {
    /// The function at the latest row.
    latest: Expr,
    /// Rows back of the latest, and place in the library, of every member.
    members: Vec<(i32, usize)>,
}

/// The row that a function reads; `None` if it reads several, or none.
fn row(function: &Expr) -> Option<i32> {
    let reads = function.reads();
    let (_, first) = reads.first()?;
    reads.iter().all(|(_, lag)| lag == first).then_some(*first)
}

/// Functions of one row each, those that are the same but for the row together.
fn classes(functions: &[Expr]) -> Vec<Class> {
    let mut classes: Vec<Class> = Vec::new();
    for (place, function) in functions.iter().enumerate() {
        let Some(lag) = row(function) else { continue };
        match classes.iter_mut().find(|class| function.lag_behind(&class.latest).is_some()) {
            None => classes.push(Class { latest: function.clone(), members: vec![(lag, place)] }),
            Some(class) => {
                if class.members.iter().all(|(known, _)| lag < *known) {
                    class.latest = function.clone();
                }
                class.members.push((lag, place));
            }
        }
    }
    classes
}

/// Places of the functions that the steps of a cell read, steps x columns, the oldest first. A column is a function of one row that the library has at other rows, too; its
/// last step is the latest of them. Steps are those that all columns have. Empty if there is none before the last.
pub(super) fn steps(functions: &[Expr]) -> Vec<Vec<usize>> {
    let mut columns = classes(functions);
    columns.retain(|class| class.members.len() > 1);
    for Class { members, .. } in &mut columns {
        members.sort_unstable();
        let latest = members[0].0;
        members.iter_mut().for_each(|(lag, _)| *lag -= latest);
    }
    let Some(first) = columns.first() else { return Vec::new() };
    let at = |class: &Class, lag: i32| class.members.iter().find(|member| member.0 == lag).map(|member| member.1);
    let step = |&(lag, _): &(i32, usize)| columns.iter().map(|class| at(class, lag)).collect::<Option<Vec<usize>>>();
    let steps: Vec<Vec<usize>> = first.members.iter().rev().filter_map(step).collect();
    if steps.len() > 1 { steps } else { Vec::new() }
}

/// The error of functions without steps.
pub(super) fn missing() -> Error {
    Error::missing(format!(
        "{CELL}: a recurrent cell reads past rows, and the functions have no column with past rows; give {}, or remove {CELL}",
        LAGS.to(10)
    ))
}

/// The same functions at as many rows back each: as many as the one that has most.
pub(super) fn even(functions: &[Expr]) -> Vec<Expr> {
    let classes = classes(functions);
    let rows = classes.iter().map(|class| class.members.len()).max().unwrap_or(0);
    (0..rows).flat_map(|lag| classes.iter().map(move |class| class.latest.shifted(lag as i32))).collect()
}

#[cfg(test)]
mod tests {
    use fleetfoot_library::Scope;

    use super::*;

    fn parsed(texts: &str) -> Vec<Expr> {
        texts.split("; ").map(|text| Expr::parse(text, &Scope::open()).unwrap()).collect()
    }

    #[test]
    fn steps_are_rows_of_all_columns() {
        let library =
            parsed("x; cos(a); u; lag(x, 1); lag(cos(a), 1); lag(u, 1); lag(x, 2); lag(cos(a), 2); lag(u, 2)");
        assert_eq!(steps(&library), [[6, 7, 8], [3, 4, 5], [0, 1, 2]]);
        // Every fifth row, a late input, a constant row, products of several rows, an input without past rows.
        let library = parsed("x; lag(x, 5); lag(x, 10); lag(u, 7); lag(u, 12); x*lag(x, 5); v; x*v");
        assert_eq!(steps(&library), [[1, 4], [0, 3]]);
        // Products within a row are columns.
        let library = parsed("x; x*u; lag(x, 1); lag(x, 1)*lag(u, 1)");
        assert_eq!(steps(&library), [[2, 3], [0, 1]]);
    }

    #[test]
    fn rows_without_a_past_have_no_steps() {
        for library in ["x; v; u", "x; lag(v, 1)", "x; lag(x, 1); u; lag(u, 2)", "x*lag(x, 1)"] {
            assert!(steps(&parsed(library)).is_empty(), "{library}");
        }
        assert!(steps(&[]).is_empty());
    }

    #[test]
    fn even_pasts_have_the_longest() {
        let library = parsed("x; u; lag(u, 1); lag(u, 2)");
        assert_eq!(even(&library), parsed("x; u; lag(x, 1); lag(u, 1); lag(x, 2); lag(u, 2)"));
        assert_eq!(steps(&even(&library)).len(), 3);
    }
}
