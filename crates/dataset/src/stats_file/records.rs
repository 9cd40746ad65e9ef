//! Sections of a `.stats` file beside its numbers, as they stand in the file.

use std::collections::BTreeMap;

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_stats::Preconditioner;
use fleetfoot_sums::structured::{Candidates, Plan, Regression, Task, Term};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::container::Sections;
use crate::statistic_error::StatisticError;

/// Names of latents stand in every term of the plan's text: with this bound a small file has no huge text.
const LONGEST_NAME: usize = 1000;

/// Hash of the plan, the version that wrote it, and the command that left it unfinished.
#[derive(Serialize, Deserialize)]
pub(super) struct HeadRecord {
    pub(super) version: String,
    pub(super) plan: String,
    pub command: Option<[u8; 32]>,
}

/// A plan as texts.
#[derive(Serialize, Deserialize)]
pub(super) struct PlanRecord {
    chunk_rows: u64,
    latents: Vec<(String, Vec<String>)>,
    tasks: Vec<TaskRecord>,
    weight: Option<String>,
    also: Vec<String>,
    preconditioners: Vec<Vec<u8>>,
}

#[derive(Serialize, Deserialize)]
struct TaskRecord {
    name: String,
    target: String,
    terms: Vec<(u32, String)>,
    prior: bool,
}

/// Origin of the columns.
#[derive(Serialize, Deserialize)]
pub(super) struct SourceRecord {
    pub recipe: String,
    pub fields: Vec<FieldRecord>,
    pub(super) columns: Vec<(String, String, Option<String>)>,
}

/// A field of a log.
#[derive(Serialize, Deserialize)]
pub(super) struct FieldRecord {
    name: String,
    unit: Option<String>,
    kind: KindRecord,
}

#[derive(Serialize, Deserialize)]
enum KindRecord {
    Float,
    Integer,
    Boolean,
    Category,
}

/// A file that was scanned.
#[derive(Serialize, Deserialize)]
pub(super) struct FileEntry {
    pub(super) name: String,
    pub(super) hash: [u8; 32],
    pub(super) bytes: u64,
}

/// An episode of it.
#[derive(Serialize, Deserialize)]
pub(super) struct EpisodeEntry {
    pub(super) id: [u8; 16],
    pub(super) file: u32,
    pub(super) number: u32,
    pub(super) labels: BTreeMap<String, String>,
    pub(super) rows: u64,
    pub(super) start: i64,
    pub(super) end: i64,
    pub(super) period: f64,
    pub(super) marks: BTreeMap<String, Vec<u64>>,
    /// Complete, at the border, incomplete; `None` where the scan met no row.
    pub(super) counts: Option<[u64; 3]>,
    pub(super) ranges: Option<Vec<[f64; 2]>>,
}

pub(crate) fn to_bytes<T: Serialize>(record: &T) -> Vec<u8> {
    // Plain structures in memory always serialise.
    postcard::to_stdvec(record).unwrap_or_default()
}

/// Reads a record that fills all of `bytes`.
pub(super) fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    match postcard::take_from_bytes(bytes) {
        Ok((record, [])) => Ok(record),
        Ok((_, rest)) => Err(format!("{} bytes too many", rest.len())),
        Err(error) => Err(error.to_string()),
    }
}

/// The record that is a section.
pub(super) fn record<T: serde::de::DeserializeOwned>(
    sections: &mut Sections<'_>,
    name: &str,
) -> Result<T, StatisticError> {
    let bytes = sections.next(name)?;
    from_bytes(bytes).map_err(|problem| sections.damaged(&format!("section `{name}`"), &problem))
}

impl FieldRecord {
    pub(super) fn new(field: &Column) -> Self {
        let kind = match field.kind {
            ColumnKind::Float => KindRecord::Float,
            ColumnKind::Integer => KindRecord::Integer,
            ColumnKind::Boolean => KindRecord::Boolean,
            ColumnKind::Category(_) => KindRecord::Category,
        };
        Self { name: field.name.clone(), unit: field.unit.clone(), kind }
    }

    pub(super) fn into_column(self) -> Column {
        let kind = match self.kind {
            KindRecord::Float => ColumnKind::Float,
            KindRecord::Integer => ColumnKind::Integer,
            KindRecord::Boolean => ColumnKind::Boolean,
            // The list of texts belongs to the logs; a statistic has no texts.
            KindRecord::Category => ColumnKind::Category(Vec::new()),
        };
        Column { name: self.name, unit: self.unit, kind }
    }
}

/// The text of an expression that reads back to an equal one.
pub(super) fn print(expr: &Expr) -> Result<String, StatisticError> {
    let text = expr.to_string();
    match Expr::parse(&text, &Scope::open()) {
        Ok(again) if again == *expr => Ok(text),
        _ => Err(StatisticError::Unprintable { text }),
    }
}

/// Reads the text of [`print`].
pub(super) fn parse(text: &str) -> Result<Expr, String> {
    Expr::parse(text, &Scope::open()).map_err(|error| format!("`{text}`: {error}"))
}

pub(super) fn print_all(expressions: &[Expr]) -> Result<Vec<String>, StatisticError> {
    expressions.iter().map(print).collect()
}

pub(super) fn parse_all(texts: &[String]) -> Result<Vec<Expr>, String> {
    texts.iter().map(|text| parse(text)).collect()
}

impl PlanRecord {
    pub(super) fn new(plan: &Plan) -> Result<Self, StatisticError> {
        let Regression { latents, tasks, weight } = &plan.regression;
        let task = |task: &Task| {
            let terms = task.terms.iter().map(|term| Ok((term.latent as u32, print(&term.coefficient)?)));
            Ok(TaskRecord {
                name: task.name.clone(),
                target: print(&task.target)?,
                terms: terms.collect::<Result<_, StatisticError>>()?,
                prior: task.prior,
            })
        };
        Ok(Self {
            chunk_rows: plan.chunk_rows as u64,
            latents: latents
                .iter()
                .map(|latent| Ok((latent.name.clone(), print_all(&latent.functions)?)))
                .collect::<Result<_, StatisticError>>()?,
            tasks: tasks.iter().map(task).collect::<Result<_, StatisticError>>()?,
            weight: weight.as_ref().map(print).transpose()?,
            also: print_all(&plan.also)?,
            preconditioners: plan.preconditioners.iter().map(Preconditioner::to_bytes).collect(),
        })
    }

    pub(super) fn into_plan(self) -> Result<Plan, String> {
        let mut latents = Vec::new();
        for (name, functions) in self.latents {
            if name.len() > LONGEST_NAME {
                return Err(format!("a name of {} bytes", name.len()));
            }
            latents.push(Candidates { functions: parse_all(&functions)?, name });
        }
        let mut tasks: Vec<Task> = Vec::new();
        for task in self.tasks {
            let mut terms: Vec<Term> = Vec::new();
            for (latent, coefficient) in task.terms {
                let latent = latent as usize;
                if latent >= latents.len() || terms.iter().any(|term| term.latent == latent) {
                    return Err(format!("task {} has a latent twice, or an unknown one", task.name));
                }
                terms.push(Term { latent, coefficient: parse(&coefficient)? });
            }
            tasks.push(Task { name: task.name, target: parse(&task.target)?, terms, prior: task.prior });
        }
        if self.preconditioners.len() != tasks.len() {
            return Err(format!("{} tasks and {} preconditioners", tasks.len(), self.preconditioners.len()));
        }
        let mut preconditioners = Vec::new();
        for (bytes, task) in self.preconditioners.iter().zip(&tasks) {
            let preconditioner =
                Preconditioner::from_bytes(bytes).map_err(|error| format!("task {}: {error}", task.name))?;
            let columns: usize = task.terms.iter().map(|term| latents[term.latent].functions.len()).sum();
            if (preconditioner.regressors(), preconditioner.targets()) != (columns, 1) {
                return Err(format!("task {} has {columns} columns and its preconditioner has others", task.name));
            }
            preconditioners.push(preconditioner);
        }
        Ok(Plan {
            regression: Regression { latents, tasks, weight: self.weight.as_deref().map(parse).transpose()? },
            also: parse_all(&self.also)?,
            chunk_rows: usize::try_from(self.chunk_rows).map_err(|error| error.to_string())?,
            preconditioners,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expressions_read_back_equal_or_are_refused() {
        for text in [
            "m*V_dot + m*9.80665*sin(gamma)",
            "-(x - y)^3/2",
            "`a b`*lag(x, 2)",
            "1e-300*x^-2",
            "max(x, atan2(y, 0.1))",
            "-1",
        ] {
            let expr = Expr::parse(text, &Scope::open()).unwrap();
            assert_eq!(parse(&print(&expr).unwrap()).unwrap(), expr, "{text}");
        }
    }

    #[test]
    fn records_with_trailing_bytes_are_refused() {
        let mut bytes = to_bytes(&(1u8, "x"));
        assert!(from_bytes::<(u8, String)>(&bytes).is_ok());
        bytes.push(0);
        assert!(from_bytes::<(u8, String)>(&bytes).unwrap_err().contains("too many"));
        assert!(from_bytes::<(u8, String)>(&bytes[..1]).is_err());
    }
}
