//! Definitions of a model's columns in terms of each other.

use fleetfoot_library::{Expr, Filter, Scope};

use crate::{Column, Equation, Prediction, Role};

/// In front of the number of a column, while columns and fields of the same name could be confused.
const MARK: char = '\u{1}';

/// Definitions of a model's columns in terms of each other.
pub(super) struct Definitions {
    /// The model's columns, then those that were added.
    pub(super) columns: Vec<Column>,
    pub(super) simulated: Vec<bool>,
    pub(super) meanings: Vec<Meaning>,
    /// Over the fields; `None` where the text cannot be read.
    sources: Vec<Option<Expr>>,
}

/// Source of a column in a simulation.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Meaning {
    /// From outside, or from an equation of the model.
    Given,
    /// By this expression over columns.
    Computed(Expr),
    /// As a filter of columns; `input` is that of the filter with columns for the filters in it.
    Filter { filter: Filter, input: Expr },
}

impl Definitions {
    pub(super) fn of(columns: &[Column], equations: &[Equation]) -> Self {
        let advanced =
            |column: &Column| equations.iter().any(|e| e.prediction != Prediction::Value && e.subject == column.name);
        let scope = Scope::open();
        let mut known = Self {
            columns: columns.to_vec(),
            simulated: columns.iter().map(advanced).collect(),
            meanings: vec![Meaning::Given; columns.len()],
            sources: columns.iter().map(|column| Expr::parse(&column.source, &scope).ok()).collect(),
        };
        let weights: Vec<u64> = known.sources.iter().map(|source| source.as_ref().map_or(0, weight)).collect();
        let mut order: Vec<usize> = (0..columns.len()).filter(|&c| !known.simulated[c]).collect();
        // Parts before wholes: a column is written in terms of those that are settled.
        order.sort_by_key(|&c| (weights[c], known.rank(c)));
        for column in order {
            known.define(column);
        }
        known
    }

    /// Rank among the columns of one expression: the lowest stands for it.
    fn rank(&self, column: usize) -> (u8, usize) {
        let role = match self.columns[column].role {
            _ if self.simulated[column] => 0,
            Role::State => 1,
            Role::Input => 2,
            Role::Auxiliary => 3,
        };
        (role, column)
    }

    fn define(&mut self, column: usize) {
        let Some(source) = self.sources[column].clone() else { return };
        let marked = source.replaced(|part| self.column_of(part, &source, column));
        if !self.speaks(&marked) {
            return;
        }
        let expression = self.named(&marked);
        self.meanings[column] = match expression.as_column().and_then(Filter::of) {
            Some(filter) => self.filter(filter),
            None => Meaning::Computed(self.with_filters(&expression)),
        };
    }

    /// The column that a part of a column's source is the source of, at the part's lag.
    fn column_of(&self, part: &Expr, source: &Expr, column: usize) -> Option<Expr> {
        let whole = part == source;
        let candidates = self.sources.iter().enumerate().filter(|&(other, _)| {
            // Of two columns that are the same one stands for the other, not both.
            other != column && (!whole || self.rank(other) < self.rank(column))
        });
        let equal = candidates.filter_map(|(other, known)| Some((other, part.lag_behind(known.as_ref()?)?)));
        let (other, lag) = equal.min_by_key(|(other, _)| self.rank(*other))?;
        Some(Expr::lagged(format!("{MARK}{other}"), lag))
    }

    /// Returns true if an expression over marked columns and fields follows from states and inputs, or from time alone.
    fn speaks(&self, marked: &Expr) -> bool {
        let names = marked.sources();
        let is_defined = |column: usize| {
            self.columns[column].role != Role::Auxiliary
                || self.simulated[column]
                || self.meanings[column] != Meaning::Given
        };
        names.is_empty() || names.iter().filter_map(|name| marked_column(name)).any(is_defined)
    }

    /// The same with names: computed columns by their definitions, fields by the columns that hold them.
    fn named(&mut self, marked: &Expr) -> Expr {
        marked.substituted(|name| match marked_column(name) {
            Some(column) => Some(match &self.meanings[column] {
                Meaning::Computed(expression) => expression.clone(),
                _ => Expr::column(self.columns[column].name.as_str()),
            }),
            None if Filter::of(name).is_some() => None,
            None => Some(Expr::column(self.field(name))),
        })
    }

    /// The name of the column that holds a field, added where there is none.
    fn field(&mut self, field: &str) -> String {
        let source = Expr::column(field);
        let added = self.sources.iter().position(|known| known.as_ref() == Some(&source));
        let column = added.unwrap_or_else(|| self.add(field, source, Meaning::Given));
        self.columns[column].name.clone()
    }

    fn add(&mut self, wanted: &str, source: Expr, meaning: Meaning) -> usize {
        let mut name = wanted.to_owned();
        while self.columns.iter().any(|column| column.name == name) {
            name.push('_');
        }
        self.columns.push(Column {
            name,
            source: source.to_string(),
            unit: None,
            role: Role::Auxiliary,
            angle: false,
            rotation: None,
        });
        self.simulated.push(false);
        self.sources.push(Some(source));
        self.meanings.push(meaning);
        self.columns.len() - 1
    }

    fn filter(&mut self, filter: Filter) -> Meaning {
        let input = self.with_filters(&filter.input);
        Meaning::Filter { filter, input }
    }

    /// The expression with columns for the filters in it, added where there are none.
    fn with_filters(&mut self, expression: &Expr) -> Expr {
        expression.substituted(|name| match Filter::of(name) {
            Some(filter) => Some(Expr::column(self.filter_column(filter))),
            None => Some(Expr::column(name)),
        })
    }

    fn filter_column(&mut self, filter: Filter) -> String {
        let same = |meaning: &Meaning| matches!(meaning, Meaning::Filter { filter: known, .. } if *known == filter);
        let column = self.meanings.iter().position(same).unwrap_or_else(|| {
            let name = filter.to_string();
            let over_fields = filter.column().substituted(|name| {
                let column = self.columns.iter().position(|column| column.name == name)?;
                self.sources[column].clone()
            });
            let meaning = self.filter(filter);
            self.add(&name, over_fields, meaning)
        });
        self.columns[column].name.clone()
    }
}

/// Nodes of an expression, those of the filters in it too.
fn weight(expression: &Expr) -> u64 {
    let inner = expression.filters().iter().map(|filter| weight(&filter.input)).fold(0, u64::saturating_add);
    expression.size().saturating_add(inner)
}

/// The column that a name is the mark of.
fn marked_column(name: &str) -> Option<usize> {
    name.strip_prefix(MARK)?.parse().ok()
}
