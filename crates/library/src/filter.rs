//! Filters: columns that remember, each named by its own definition.
//!
//! The output of `lag1(m1, tau)` is a column of exactly that name: a [`Filtered`](crate::Filtered) source provides it, and a program, a view or a
//! model reads it like any other. The second argument is constant in time: an expression of numbers and parameters.

use std::fmt::{self, Display, Formatter};

use crate::{Expr, Node};

/// What a filter does to its input x, with the constant c in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FilterKind {
    /// First-order lag, `dy/dt = (x - y)/c`, exact for x held from its row to the next:
    /// `y[k+1] = y[k] + (1 - exp(-dt/c)) (x[k] - y[k])`, `dt = t[k+1] - t[k]`; `y = x` at an episode's first row and at the first after missing
    /// ones.
    Lag1,
    /// The derivative of [`FilterKind::Lag1`] with respect to c, by the differentiated recursion; 0 where the lag starts.
    Lag1Slope,
    /// `x(t - c)`, linear between rows; missing before the first row.
    Delay,
    /// The derivative of [`FilterKind::Delay`] with respect to c: minus the slope of x between its rows, at a row the mean of both sides.
    DelaySlope,
    /// 0 where x is there at every row from c seconds ago to now, missing elsewhere: where [`FilterKind::Delay`] has a value for every shorter delay.
    Present,
}

impl FilterKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Lag1, Self::Lag1Slope, Self::Delay, Self::DelaySlope, Self::Present];

    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lag1 => "lag1",
            Self::Lag1Slope => "lag1_slope",
            Self::Delay => "delay",
            Self::DelaySlope => "delay_slope",
            Self::Present => "present",
        }
    }

    /// The kind of this name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// A filter with its input and its constant.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Filter {
    /// What it does.
    pub kind: FilterKind,
    /// What goes in.
    pub input: Expr,
    /// Seconds, constant in time: an expression of numbers and parameters.
    pub constant: Expr,
}

impl Filter {
    /// The longest name of a filter's column, bytes: a longer definition is not read.
    pub const MAX_NAME: usize = 16_384;

    /// A filter of an input, with a constant in seconds.
    pub fn new(kind: FilterKind, input: impl Into<Expr>, constant: impl Into<Expr>) -> Self {
        Self { kind, input: input.into(), constant: constant.into() }
    }

    /// The filter that a column's name defines; `None` for the name of a plain column.
    pub fn of(name: &str) -> Option<Self> {
        let call = |kind: &FilterKind| name.strip_prefix(kind.name()).is_some_and(|rest| rest.starts_with('('));
        if name.len() > Self::MAX_NAME || !name.ends_with(')') || !FilterKind::ALL.iter().any(call) {
            return None;
        }
        crate::parse::filter_of(name).filter(|filter| filter.to_string() == name)
    }

    /// The column that holds the filter's output.
    pub fn column(&self) -> Expr {
        Expr::column(self.to_string())
    }

    /// The columns that the input and the constant read in the end, those beneath inner filters too; parameters are among them.
    pub fn sources(&self) -> Vec<std::sync::Arc<str>> {
        let mut names = self.input.sources();
        names.extend(self.constant.sources().into_iter().filter(|name| !names.contains(name)).collect::<Vec<_>>());
        names
    }

    /// Filters inside each other, itself counted.
    pub(crate) fn levels(&self) -> usize {
        1 + self.input.filters().iter().map(Self::levels).max().unwrap_or(0)
    }

    /// [`Expr::substituted`] of both arguments.
    pub(crate) fn substituted(&self, replace: &mut dyn FnMut(&str) -> Option<Expr>) -> Self {
        let input = self.input.substituted_by(replace);
        Self { kind: self.kind, input, constant: self.constant.substituted_by(replace) }
    }

    /// The derivative of the output with respect to a parameter. Every filter is linear in its input; what has no closed recursion (the
    /// derivative of a slope with respect to its own constant) is NaN.
    pub(crate) fn sensitivity(&self, parameter: &str) -> Expr {
        let of_input = self.input.sensitivity(parameter);
        let of_constant = self.constant.sensitivity(parameter);
        let slope = match self.kind {
            FilterKind::Present => return Expr::number(0.0),
            FilterKind::Lag1 => Self { kind: FilterKind::Lag1Slope, ..self.clone() }.column(),
            FilterKind::Delay => Self { kind: FilterKind::DelaySlope, ..self.clone() }.column(),
            FilterKind::Lag1Slope | FilterKind::DelaySlope => Expr::number(f64::NAN),
        };
        let through = match of_input.as_number() {
            // What does not change passes a lag and a delay as it is, and has no slope.
            Some(value) if matches!(self.kind, FilterKind::Lag1 | FilterKind::Delay) => Expr::number(value),
            Some(_) => Expr::number(0.0),
            None => Self { input: of_input, ..self.clone() }.column(),
        };
        match of_constant.as_number() {
            Some(0.0) => through,
            _ => (through + slope * of_constant).simplified(),
        }
    }
}

impl Display for Filter {
    /// The name of its column.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}({}, {})", self.kind.name(), self.input, self.constant)
    }
}

impl Expr {
    /// The filters among its columns, each once, in the order of their first appearance; those inside filters are not listed.
    pub fn filters(&self) -> Vec<Filter> {
        self.columns().iter().filter_map(|name| Filter::of(name)).collect()
    }

    /// The columns that it reads in the end: a filter's column stands for those of its definition, parameters included. Each once.
    pub fn sources(&self) -> Vec<std::sync::Arc<str>> {
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

    /// Whether it has the same value at every row, whatever its names stand for: it reads neither time, nor another row, nor a filter.
    pub(crate) fn is_constant(&self) -> bool {
        self.fold(|part, arguments: &[bool]| match part.node() {
            Node::Time { .. } => false,
            Node::Column { name, lag } => *lag == 0 && Filter::of(name).is_none(),
            _ => arguments.iter().all(|&constant| constant),
        })
    }
}
