//! A source seen through expressions: its columns are aliases.
//!
//! Everything behind a view speaks of aliases alone. A plain alias shares the buffer of the column that it names; an expression is
//! evaluated when its rows are read. Lags inside an alias look into the halo and never across an episode's border: what they cannot
//! reach is NaN.

use std::ops::Range;

use fleetfoot_data::{Block, Column, Episode, Error, Halo, ScalarBuffer, Source};

use crate::{Expr, Leaf, Program, Scratch, UnknownColumn};

/// A source whose columns are expressions over another source's columns.
pub struct View<'a> {
    inner: Inner<'a>,
    columns: Vec<Column>,
    aliases: Vec<Alias>,
    reach: Halo,
}

/// A source that is lent or kept.
pub(crate) enum Inner<'a> {
    Borrowed(&'a dyn Source),
    Owned(Box<dyn Source + 'a>),
}

impl Inner<'_> {
    pub(crate) fn source(&self) -> &dyn Source {
        match self {
            Self::Borrowed(source) => *source,
            Self::Owned(source) => source.as_ref(),
        }
    }
}

enum Alias {
    Column(usize),
    /// A category column whose codes are replaced by these values.
    Recoded(usize, Vec<f64>),
    Expression(Box<Program>),
}

impl<'a> View<'a> {
    /// Sees `inner` through `aliases`: the column as it shall be called and described, and the expression that gives its values.
    ///
    /// # Errors
    /// An expression reads a column that `inner` does not have.
    pub fn new(inner: &'a dyn Source, aliases: &[(Column, Expr)]) -> Result<Self, UnknownColumn> {
        Self::through(Inner::Borrowed(inner), aliases)
    }

    /// [`View::new`] of a source that the view keeps.
    ///
    /// # Errors
    /// An expression reads a column that `inner` does not have.
    pub fn over(inner: Box<dyn Source + 'a>, aliases: &[(Column, Expr)]) -> Result<Self, UnknownColumn> {
        Self::through(Inner::Owned(inner), aliases)
    }

    fn through(inner: Inner<'a>, aliases: &[(Column, Expr)]) -> Result<Self, UnknownColumn> {
        let names: Vec<String> = inner.source().columns().iter().map(|column| column.name.clone()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut view = Self { inner, columns: Vec::new(), aliases: Vec::new(), reach: Halo::default() };
        for (column, expression) in aliases {
            let program = Program::compile(std::slice::from_ref(expression), &names)?;
            let halo = program.halo();
            view.reach.before = view.reach.before.max(halo.before);
            view.reach.after = view.reach.after.max(halo.after);
            view.columns.push(column.clone());
            view.aliases.push(match expression.as_column() {
                Some(name) => match names.iter().position(|known| *known == name) {
                    Some(index) => Alias::Column(index),
                    None => Alias::Expression(Box::new(program)),
                },
                None => Alias::Expression(Box::new(program)),
            });
        }
        Ok(view)
    }

    /// Replaces the codes of a category column (by its name in the view) by `values`, one per category: two recordings number the
    /// same labels differently. A column that is not a plain field of categories is left as it is.
    pub fn recode(&mut self, column: &str, values: Vec<f64>) {
        if let Some(at) = self.columns.iter().position(|known| known.name == column)
            && let Alias::Column(index) = self.aliases[at]
        {
            self.aliases[at] = Alias::Recoded(index, values);
        }
    }
}

impl Source for View<'_> {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        self.inner.source().episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let wide = Halo { before: halo.before + self.reach.before, after: halo.after + self.reach.after };
        let block = self.inner.source().read(episode, rows, wide)?;
        let before = block.before.min(halo.before);
        let after = block.after.min(halo.after);
        let from = block.before - before;
        let length = before + block.rows + after;
        let seconds = self
            .aliases
            .iter()
            .any(|alias| matches!(alias, Alias::Expression(program) if program.leaves().iter().any(|l| matches!(l, Leaf::Time { .. }))))
            .then(|| block.seconds());
        let mut scratch = Scratch::default();
        let columns = self
            .aliases
            .iter()
            .map(|alias| match alias {
                Alias::Column(index) => block.columns[*index].slice(from, length),
                Alias::Recoded(index, values) => block.columns[*index][from..from + length]
                    .iter()
                    .map(
                        |&code| {
                            if code.is_nan() { f64::NAN } else { values.get(code as usize).copied().unwrap_or(-1.0) }
                        },
                    )
                    .collect(),
                Alias::Expression(program) => {
                    ScalarBuffer::from(evaluate(program, &block, seconds.as_deref(), from..from + length, &mut scratch))
                }
            })
            .collect();
        let time = block.time.slice(from, length);
        Ok(Block { first: block.first, before, rows: block.rows, after, start: block.start, time, columns })
    }
}

/// Values of a one-output program on rows of a block counted with its halo; NaN where a lag reaches beyond the block.
pub(crate) fn evaluate(
    program: &Program,
    block: &Block,
    seconds: Option<&[f64]>,
    rows: Range<usize>,
    scratch: &mut Scratch,
) -> Vec<f64> {
    let mut out = vec![f64::NAN; rows.len()];
    let reach = program.halo();
    let first = rows.start.max(reach.before);
    let last = rows.end.min(block.time.len().saturating_sub(reach.after));
    if first >= last {
        return out;
    }
    let leaves: Vec<&[f64]> = program
        .leaves()
        .iter()
        .map(|leaf| {
            let (values, lag) = match *leaf {
                Leaf::Column { column, lag } => (block.column(column), lag),
                Leaf::Time { lag } => (seconds.unwrap_or_default(), lag),
            };
            // In range: `reach` covers every lag.
            let start = first.saturating_add_signed(-(lag as isize));
            &values[start..start + (last - first)]
        })
        .collect();
    let offset = first - rows.start;
    let length = last - first;
    program.evaluate(&leaves, length, &mut out[offset..offset + length], length, scratch);
    out
}
