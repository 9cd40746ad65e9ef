//! The logs that trained a model, and how their rows are recognised in others.

use std::collections::BTreeMap;

use fleetfoot_data::{Episode, Known};
use fleetfoot_library::{Expr, Scope};

use crate::{Column, Role};

/// Fields whose marks a model keeps.
const FIELDS: usize = 2;
/// Episodes of which it keeps the marks of one field only.
const MANY: usize = 16;

/// An uninterrupted stretch of a log that trained a model.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct TrainedEpisode {
    /// Its identity by content.
    pub id: String,
    /// For people.
    pub name: String,
    /// By field of the log: hashes of some rows' values, by which they are recognised in other logs ([`fleetfoot_data::Mark`]).
    pub marks: BTreeMap<String, Vec<u64>>,
}

impl From<&Episode> for TrainedEpisode {
    fn from(episode: &Episode) -> Self {
        let mut marks: BTreeMap<String, Vec<u64>> = BTreeMap::new();
        for mark in &episode.marks {
            marks.entry(mark.field.to_string()).or_default().push(mark.hash);
        }
        Self { id: episode.id.to_string(), name: episode.name.clone(), marks }
    }
}

/// The fields behind the states of a model, in their order; of a model without states those behind all columns but
/// inputs. Commands are left out: they may be the same in every log.
fn marked_fields(columns: &[Column]) -> Vec<String> {
    let read = |wanted: fn(&Column) -> bool| {
        let mut fields: Vec<String> = Vec::new();
        for column in columns.iter().filter(|column| wanted(column)) {
            let sources = match Expr::parse(&column.source, &Scope::open()) {
                Ok(expression) => expression.sources().iter().map(ToString::to_string).collect(),
                Err(_) => vec![column.source.clone()],
            };
            fields.extend(sources.into_iter().filter(|field| !fields.contains(field)).collect::<Vec<_>>());
        }
        fields
    };
    match read(|column| column.role == Role::State) {
        none if none.is_empty() => read(|column| column.role != Role::Input),
        states => states,
    }
}

/// Keeps only the marks that a model of these columns needs.
pub(crate) fn keep_marks(episodes: &mut [TrainedEpisode], columns: &[Column]) {
    let fields = marked_fields(columns);
    let kept = if episodes.len() > MANY { 1 } else { FIELDS };
    for episode in episodes {
        let there = fields.iter().filter(|field| episode.marks.contains_key(*field)).take(kept);
        let there: Vec<&String> = there.collect();
        episode.marks.retain(|field, _| there.contains(&field));
    }
}

/// Marks of the training rows to search for in other logs.
pub fn known(episodes: &[TrainedEpisode]) -> Known {
    Known {
        fields: episodes.iter().flat_map(|episode| episode.marks.keys().cloned()).collect(),
        episodes: episodes.iter().map(|episode| episode.marks.values().flatten().copied().collect()).collect(),
    }
}
