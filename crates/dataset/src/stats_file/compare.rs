//! Comparison of two plans, with the lines that differ.

use fleetfoot_data::setting::{PLAN, STATS_INFO, TIME_SECTION};

use fleetfoot_recipe::Recipe;
use fleetfoot_task::StructuredTask;

use super::{ColumnRecord, EquationStatistic, StatisticFile};
use crate::{condition, error::Error, statistic_error::StatisticError};

/// Lines of a difference that are shown.
const SHOWN: usize = 16;

impl StatisticFile {
    /// The plan for people: one line a fact, columns included, coordinates left out.
    pub fn plan_text(&self) -> String {
        let equations = self.equations.as_ref().map_or_else(String::new, EquationStatistic::text);
        let rows = self.rows_in_use().map_or_else(String::new, |only| format!("rows where {only}\n"));
        format!("{}{equations}{rows}", self.tasks_text())
    }

    /// The condition of the scan's recipe for the rows in use; `None` if all rows are used.
    fn rows_in_use(&self) -> Option<String> {
        let recipe = Recipe::parse(&self.recipe, "the recipe of the statistic").ok()?;
        condition::stated(&recipe).map(str::to_owned)
    }

    /// That a scan by a recipe takes the same rows of its logs.
    pub fn accepts_rows(&self, recipe: &Recipe, left: &str) -> Result<(), Error> {
        let (there, wanted) = (self.rows_in_use(), condition::stated(recipe));
        if there.as_deref() == wanted {
            return Ok(());
        }
        Err(Error::other_statistic(format!(
            "{left} is of the rows where `{}`, and the recipe asks for those where `{}`: scan with the same condition ({entry}), or into another file",
            there.as_deref().unwrap_or("all"),
            wanted.unwrap_or("all"),
            entry = TIME_SECTION.entry("where")
        )))
    }

    /// The part of the plan that `fit sparse` asks for.
    fn tasks_text(&self) -> String {
        format!("{}{}", self.plan.text(), columns_text(&self.columns))
    }

    /// That a statistic has the very same plan, coordinates included.
    pub fn same_plan(&self, left: &str, other: &Self, right: &str) -> Result<(), StatisticError> {
        let refuse = |difference, mend| {
            Err(StatisticError::OtherPlan { left: left.to_owned(), right: right.to_owned(), difference, mend })
        };
        let lines = difference(&self.plan_text(), &other.plan_text(), units(&self.columns, &other.columns));
        if !lines.is_empty() {
            return refuse(
                lines,
                format!(
                    "scan both with one recipe, and the second with {given_plan} of the first",
                    given_plan = PLAN.to("FILE")
                ),
            );
        }
        if self.plan_hash() != other.plan_hash() {
            return refuse(
                "  the same columns, functions and tasks, in other coordinates: each scan chose its own from a sample of its rows".to_owned(),
                format!("scan one of them again with {PLAN} and the other"),
            );
        }
        Ok(())
    }

    /// That a recipe, resolved, asks for what this statistic holds.
    pub fn accepts(&self, task: &StructuredTask, left: &str, right: &str) -> Result<(), Error> {
        self.accepts_chunks(task, None, left, right)
    }

    /// [`StatisticFile::accepts`], and that the chunks are as long as asked for.
    pub fn accepts_chunks(
        &self,
        task: &StructuredTask,
        chunk_rows: Option<usize>,
        left: &str,
        right: &str,
    ) -> Result<(), Error> {
        let mut plan = self.plan.clone();
        plan.regression = task.regression.clone();
        plan.also = task.also.clone();
        plan.chunk_rows = chunk_rows.unwrap_or(plan.chunk_rows);
        let columns: Vec<ColumnRecord> = task
            .aliases
            .iter()
            .map(|(column, source)| ColumnRecord {
                name: column.name.clone(),
                source: source.to_string(),
                unit: column.unit.clone(),
            })
            .collect();
        let wanted = format!("{}{}", plan.text(), columns_text(&columns));
        Self::refuse_difference(&self.tasks_text(), &wanted, units(&self.columns, &columns), [left, right])
    }

    /// Refuses two texts of plans, or units of columns, that differ; `left` and `right` name the two for people.
    ///
    /// # Errors
    /// [`StatisticError::OtherPlan`].
    pub fn refuse_difference(
        plan_text: &str,
        wanted: &str,
        units: Vec<(String, String)>,
        [left, right]: [&str; 2],
    ) -> Result<(), Error> {
        let lines = difference(plan_text, wanted, units);
        if lines.is_empty() {
            return Ok(());
        }
        Err(StatisticError::OtherPlan {
            left: left.to_owned(),
            right: right.to_owned(),
            difference: lines,
            mend: format!("use the recipe of the statistic ({STATS_INFO} shows it), or scan again into another file"),
        }
        .into())
    }
}

fn columns_text(columns: &[ColumnRecord]) -> String {
    columns.iter().map(|column| format!("column {} = {}\n", column.name, column.source)).collect()
}

/// Columns whose units are known on both sides and differ.
fn units(left: &[ColumnRecord], right: &[ColumnRecord]) -> Vec<(String, String)> {
    let mut differing = Vec::new();
    for one in left {
        let other = right.iter().find(|other| other.name == one.name).and_then(|other| other.unit.as_ref());
        if let (Some(a), Some(b)) = (&one.unit, other)
            && a != b
        {
            differing.push((format!("column {} [{a}]", one.name), format!("column {} [{b}]", one.name)));
        }
    }
    differing
}

/// The lines of `left` (`-`) that are not in `right`, and the other way round (`+`); empty when the texts agree.
fn difference(left: &str, right: &str, more: Vec<(String, String)>) -> String {
    if left == right && more.is_empty() {
        return String::new();
    }
    let only = |these: &str, those: &str| -> Vec<String> {
        let those: std::collections::HashSet<&str> = those.lines().collect();
        these.lines().filter(|line| !those.contains(line)).map(str::to_owned).collect()
    };
    let mut lines: Vec<String> = only(left, right).into_iter().map(|line| format!("  - {line}")).collect();
    lines.extend(only(right, left).into_iter().map(|line| format!("  + {line}")));
    for (a, b) in more {
        lines.extend([format!("  - {a}"), format!("  + {b}")]);
    }
    if lines.is_empty() {
        lines.push("  the same lines in another order".to_owned());
    }
    if lines.len() > SHOWN {
        let rest = lines.len() - SHOWN;
        lines.truncate(SHOWN);
        lines.push(format!("  ... and {rest} lines more"));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_shows_the_lines_of_both_sides() {
        assert_eq!(difference("a\nb\n", "a\nb\n", Vec::new()), "");
        assert_eq!(difference("a\nb\n", "a\nc\n", Vec::new()), "  - b\n  + c");
        assert!(difference("a\nb\n", "b\na\n", Vec::new()).contains("order"));
        let units = vec![("V [m/s]".to_owned(), "V [km/h]".to_owned())];
        assert_eq!(difference("a", "a", units), "  - V [m/s]\n  + V [km/h]");
        let long: String = (0..40).map(|line| format!("{line}\n")).collect();
        let shown = difference(&long, "", Vec::new());
        assert!(shown.lines().count() == SHOWN + 1 && shown.ends_with("24 lines more"), "{shown}");
    }
}
