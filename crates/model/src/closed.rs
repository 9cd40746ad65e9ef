//! Models closed for simulation: all columns that can be computed are computed, and simulated values never come from
//! the recording.
//!
//! A column of a model is an alias for an expression over the fields of a log. In a simulation the equations advance
//! some columns. [`Model::closed`] writes out every other column that follows from them, and from inputs and time. A
//! rollout, a free run, a step and exported code then compute it. Only the remaining columns are read from the
//! recording or given by a caller.

mod definitions;
mod error;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use fleetfoot_library::{Expr, Filter, FilterKind};

pub use error::ClosedError;

use crate::{Column, Equation, Model, Prediction, Rule};
use definitions::{Definitions, Meaning};

/// A delay of more rows than these is refused.
const MOST_ROWS: f64 = 1e6;
/// Delays that differ from whole rows by a smaller share of a row are whole rows.
const SAME: f64 = 1e-9;

/// A model in which everything is computed that can be computed.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Closed {
    /// The model: its columns in their order, behind them those that the computed ones need. The expressions that a
    /// simulation evaluates (right sides, candidate functions, partitions) contain no computed column.
    pub model: Model,
    /// First-order lags that the model reads: further states, in the order of their columns.
    pub lags: Vec<FirstOrderLag>,
    /// Definitions of the computed columns, over the columns of the model.
    pub computed: Vec<(String, Expr)>,
}

/// A first-order lag of something that a simulation computes: `y[k+1] = y[k] + (1 - exp(-h/c)) (x[k] - y[k])` for a step of h seconds.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstOrderLag {
    /// Index of its column among those of the closed model.
    pub column: usize,
    /// Its subject is y, its right side x.
    pub equation: Equation,
    /// The time constant c, seconds.
    pub constant: f64,
}

impl Model {
    /// Columns that a simulation of the model may read beside the model's columns. They are fields that a computed
    /// column needs and no column stands for, and filters inside of computed columns. A recording that a model is
    /// simulated on has them.
    pub fn auxiliary_columns(&self) -> Vec<Column> {
        auxiliary_columns(&self.columns, &self.equations)
    }

    /// Writes out columns that follow from states, inputs and time, for steps of `step` seconds (the unit of delays).
    /// Columns in `driven` are computed as the states are.
    ///
    /// Columns that equations advance are simulated. In the source of any other column, each part that is the source of
    /// another column is replaced by that column: simulated ones first, then inputs; also at earlier rows. The column
    /// is computed if the result contains a state, an input, or nothing but time. Fields that no column stands for
    /// become auxiliary columns. A column that reads later rows of inputs alone stays as recorded.
    ///
    /// A first-order lag `lag1(x, c)` of computed values is a state ([`Closed::lags`]); `delay(x, d)` is linear between
    /// rows.
    ///
    /// # Errors
    /// A value that the equations read would be needed before it is simulated. Or it is a filter that cannot be
    /// simulated, or a delay of an unknown number of rows.
    pub fn closed(&self, step: f64, driven: &[String]) -> Result<Closed, ClosedError> {
        let definitions = Definitions::of(&self.columns, &self.equations);
        Closing::new(&definitions, step, driven).close(self)
    }
}

/// [`Model::auxiliary_columns`] of a model of these columns and equations.
pub fn auxiliary_columns(columns: &[Column], equations: &[Equation]) -> Vec<Column> {
    Definitions::of(columns, equations).columns.split_off(columns.len())
}

/// Refuses candidate functions that a simulation could not evaluate: those of a system of equations that is not fitted yet.
///
/// # Errors
/// As [`Model::closed`].
pub fn check_simulated(
    columns: &[Column],
    equations: &[Equation],
    step: f64,
    functions: &[Expr],
) -> Result<(), ClosedError> {
    let definitions = Definitions::of(columns, equations);
    let closing = Closing::new(&definitions, step, &[]);
    functions.iter().try_for_each(|function| closing.written_out(function).map(|_| ()))
}

struct Closing<'a> {
    known: &'a Definitions,
    step: f64,
    driven: &'a [String],
    index: HashMap<&'a str, usize>,
    /// True for a column that changes with simulated or driven values.
    moving: Vec<bool>,
}

impl<'a> Closing<'a> {
    fn new(known: &'a Definitions, step: f64, driven: &'a [String]) -> Self {
        let index: HashMap<&str, usize> =
            known.columns.iter().enumerate().map(|(c, column)| (column.name.as_str(), c)).collect();
        let mut closing = Self { known, step, driven, index, moving: Vec::new() };
        closing.moving = (0..known.columns.len()).map(|c| closing.moves(c)).collect();
        closing
    }

    fn moves(&self, column: usize) -> bool {
        let known = self.known;
        known.simulated[column]
            || self.driven.contains(&known.columns[column].name)
            || match &known.meanings[column] {
                Meaning::Given => false,
                Meaning::Computed(expression) | Meaning::Filter { input: expression, .. } => {
                    expression.columns().iter().any(|name| self.index.get(&**name).is_some_and(|&c| self.moves(c)))
                }
            }
    }

    /// The expression that the values of a column follow from; `None` for one that is given, simulated or driven.
    fn meaning(&self, column: usize) -> &Meaning {
        let meaning = &self.known.meanings[column];
        let looks_ahead = |expression: &Expr| expression.reads().iter().any(|(_, lag)| *lag < 0);
        match meaning {
            _ if self.driven.contains(&self.known.columns[column].name) => &Meaning::Given,
            // Recorded columns may be read ahead.
            Meaning::Computed(e) | Meaning::Filter { input: e, .. } if !self.moving[column] && looks_ahead(e) => {
                &Meaning::Given
            }
            meaning => meaning,
        }
    }

    /// A computed column over those that are not; `None` for one of these, first-order lags among them.
    fn definition(&self, column: usize) -> Result<Option<Expr>, ClosedError> {
        match self.meaning(column) {
            Meaning::Given => Ok(None),
            Meaning::Computed(expression) => self.resolved(expression).map(Some),
            Meaning::Filter { filter, input } => match filter.kind {
                FilterKind::Lag1 => Ok(None),
                FilterKind::Delay => Ok(Some(self.delayed(filter, &self.resolved(input)?)?)),
                _ if !self.moving[column] => Ok(None),
                _ => Err(ClosedError::Filter { filter: filter.to_string() }),
            },
        }
    }

    /// Linear between the rows on both sides, as [`FilterKind::Delay`] is.
    fn delayed(&self, filter: &Filter, input: &Expr) -> Result<Expr, ClosedError> {
        let rows = constant(filter)? / self.step;
        if !(rows.is_finite() && (0.0..=MOST_ROWS).contains(&rows)) {
            return Err(ClosedError::Delay { filter: filter.to_string(), step: self.step });
        }
        let near = rows.round();
        if (rows - near).abs() <= SAME * near.max(1.0) {
            return Ok(input.shifted(near as i32));
        }
        let before = input.shifted(rows.ceil() as i32);
        let after = input.shifted(rows.floor() as i32);
        Ok(&before + (after - &before) * Expr::number(rows.ceil() - rows))
    }

    /// An expression with every computed column written out, wherever it looks.
    fn resolved(&self, expression: &Expr) -> Result<Expr, ClosedError> {
        let mut failed = None;
        let out = expression.substituted(|name| {
            let column = *self.index.get(name)?;
            let definition = self.definition(column).unwrap_or_else(|error| {
                failed.get_or_insert(error);
                None
            });
            Some(definition.unwrap_or_else(|| Expr::column(name)))
        });
        failed.map_or(Ok(out), Err)
    }

    /// An expression with every computed column written out; refuses those that are needed before they are known.
    fn written_out(&self, expression: &Expr) -> Result<Expr, ClosedError> {
        for (name, lag) in expression.reads() {
            let Some((name, &column)) = name.and_then(|name| Some((name.clone(), self.index.get(&*name)?))) else {
                continue;
            };
            let Some(definition) = self.definition(column)? else { continue };
            for (state, shift) in definition.reads() {
                let ahead = shift.saturating_add(lag).saturating_neg();
                let Some(state) = state.filter(|_| ahead > 0) else { continue };
                if self.index.get(&*state).is_some_and(|&c| self.moving[c]) {
                    let definition = definition.to_string();
                    let column = name.to_string();
                    return Err(ClosedError::Ahead { column, definition, state: state.to_string(), ahead });
                }
            }
        }
        self.resolved(expression)
    }

    fn close(&self, model: &Model) -> Result<Closed, ClosedError> {
        let mut closed = Closed { model: model.clone(), lags: Vec::new(), computed: Vec::new() };
        if self.known.meanings.iter().all(|meaning| matches!(meaning, Meaning::Given)) {
            return Ok(closed);
        }
        closed.model.columns.clone_from(&self.known.columns);
        for equation in &mut closed.model.equations {
            match self.written_out(&equation.right) {
                Ok(right) => equation.right = right,
                // Predictions of recorded rows may look at the rows around them.
                Err(_) if equation.prediction == Prediction::Value => {}
                Err(error) => return Err(error),
            }
        }
        for (index, library) in closed.model.libraries.iter_mut().enumerate() {
            for (j, function) in library.iter_mut().enumerate() {
                match self.written_out(function) {
                    Ok(written) => *function = written,
                    Err(error) if is_used(model, index, j) => return Err(error),
                    Err(_) => {}
                }
            }
        }
        for partition in &mut closed.model.partitions {
            let label = matches!(partition.rule, Rule::Labels { .. }).then_some(partition.columns.len());
            for (at, column) in partition.columns.iter_mut().enumerate() {
                let written = self.written_out(column)?;
                // A label is known by the column that it was given as.
                if label != Some(at + 1) || written.as_column().is_none() {
                    *column = written;
                }
            }
        }
        closed.lags = self.lags(&closed.model)?;
        for (column, known) in self.known.columns.iter().enumerate() {
            if let Ok(Some(definition)) = self.definition(column) {
                closed.computed.push((known.name.clone(), definition));
            }
        }
        Ok(closed)
    }

    /// The first-order lags that a closed model reads, and those that they read.
    fn lags(&self, model: &Model) -> Result<Vec<FirstOrderLag>, ClosedError> {
        let rights = model.equations.iter().map(|equation| &equation.right);
        let used: Vec<&Expr> = (0..model.libraries.len())
            .flat_map(|l| (0..model.libraries[l].len()).map(move |j| (l, j)))
            .filter(|&(library, j)| is_used(model, library, j))
            .map(|(library, j)| &model.libraries[library][j])
            .collect();
        let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
        let mut names: Vec<_> = rights.chain(used).chain(partitions).flat_map(Expr::columns).collect();
        let mut lags: Vec<FirstOrderLag> = Vec::new();
        while let Some(name) = names.pop() {
            let Some(&column) = self.index.get(&*name) else { continue };
            let Meaning::Filter { filter, input } = self.meaning(column) else { continue };
            if filter.kind != FilterKind::Lag1 || lags.iter().any(|lag| lag.column == column) {
                continue;
            }
            let right = self.written_out(input)?;
            let moves = |name: &str| self.index.get(name).is_some_and(|&c| self.moving[c]);
            for (state, lag) in right.reads() {
                if let Some(state) = state.filter(|state| lag < 0 && moves(state)) {
                    let (column, definition) = (name.to_string(), filter.to_string());
                    let ahead = lag.saturating_neg();
                    return Err(ClosedError::Ahead { column, definition, state: state.to_string(), ahead });
                }
            }
            names.extend(right.columns());
            let equation =
                Equation { subject: name.to_string(), prediction: Prediction::Next, right, target: None, unit: None };
            lags.push(FirstOrderLag { column, equation, constant: constant(filter)? });
        }
        lags.sort_by_key(|lag| lag.column);
        Ok(lags)
    }
}

/// Returns true if any latent depends on a function.
fn is_used(model: &Model, library: usize, function: usize) -> bool {
    model.latents.iter().any(|latent| latent.library == library && latent.reads(function))
}

/// The seconds of a filter.
fn constant(filter: &Filter) -> Result<f64, ClosedError> {
    let value = filter.constant.simplified().as_number().filter(|seconds| *seconds >= 0.0 && seconds.is_finite());
    value
        .filter(|seconds| *seconds > 0.0 || filter.kind == FilterKind::Delay)
        .ok_or_else(|| ClosedError::Filter { filter: filter.to_string() })
}
