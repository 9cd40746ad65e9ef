//! Filters read from the names of their columns, and the columns that expressions read through them.

use std::sync::Arc;

use super::Parser;
use crate::{Expr, Filter, FilterKind, Node, Scope};

impl Filter {
    /// The filter that a column's name defines; `None` for the name of a plain column.
    pub fn of(name: &str) -> Option<Self> {
        let call = |kind: &FilterKind| name.strip_prefix(kind.name()).is_some_and(|rest| rest.starts_with('('));
        if name.len() > Self::MAX_NAME || !name.ends_with(')') || !FilterKind::ALL.iter().any(call) {
            return None;
        }
        defined_by(name).filter(|filter| filter.to_string() == name)
    }

    /// The columns that the input and the constant read in the end, those beneath inner filters too; parameters are among them.
    pub fn sources(&self) -> Vec<Arc<str>> {
        let mut names = self.input.sources();
        names.extend(self.constant.sources().into_iter().filter(|name| !names.contains(name)).collect::<Vec<_>>());
        names
    }

    /// Filters inside each other, itself counted.
    pub(crate) fn levels(&self) -> usize {
        1 + self.input.filters().iter().map(Self::levels).max().unwrap_or(0)
    }
}

impl Expr {
    /// The filters among its columns, each once, in the order of their first appearance; those inside filters are not listed.
    pub fn filters(&self) -> Vec<Filter> {
        self.columns().iter().filter_map(|name| Filter::of(name)).collect()
    }

    /// The columns that it reads in the end: a filter's column stands for those of its definition, parameters included. Each once.
    pub fn sources(&self) -> Vec<Arc<str>> {
        let mut names = Vec::new();
        for name in self.columns() {
            let beneath = Filter::of(&name).map_or_else(|| vec![name], |filter| filter.sources());
            for name in beneath {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        names
    }

    /// Returns true if the expression has the same value at every row, for any values of its names. It then reads
    /// neither time, nor another row, nor a filter.
    pub(crate) fn is_constant(&self) -> bool {
        self.fold(|part, arguments: &[bool]| match part.node() {
            Node::Time { .. } => false,
            Node::Column { name, lag } => *lag == 0 && Filter::of(name).is_none(),
            _ => arguments.iter().all(|&constant| constant),
        })
    }

    /// Returns true if the expression depends on seconds: it reads the time, as differences by stamps do, or a filter.
    pub fn reads_clock(&self) -> bool {
        let timed = self.fold(|part, arguments: &[bool]| {
            matches!(part.node(), Node::Time { .. }) || arguments.iter().any(|&argument| argument)
        });
        timed || !self.filters().is_empty()
    }
}

/// The filter that a name defines, if it is the text of one. Whether the name is the canonical one is for the caller to see.
fn defined_by(name: &str) -> Option<Filter> {
    let scope = Scope::of_name();
    let mut parser = Parser::new(name, &scope);
    let function = parser.name("a filter").ok()?;
    parser.expect("(", "`(`").ok()?;
    let filter = parser.filter(FilterKind::named(&function)?, 0).ok()?;
    parser.peek().is_none().then_some(filter)
}
