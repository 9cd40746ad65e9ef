//! Filters: columns with memory, each named by its definition.
//!
//! The output of `lag1(m1, tau)` is a column of exactly that name. A [`Filtered`](crate::Filtered) source provides it,
//! and a program, a view or a model reads it like any other. The second argument is constant in time: an expression of
//! numbers and parameters.

use std::fmt::{self, Display, Formatter};

use crate::Expr;

/// Kind of filter, as a function of its input x and its constant c in seconds.
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
    /// Kind of the filter.
    pub kind: FilterKind,
    /// Input of the filter.
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

    /// The column that holds the filter's output.
    pub fn column(&self) -> Expr {
        Expr::column(self.to_string())
    }
}

impl Display for Filter {
    /// The name of its column.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}({}, {})", self.kind.name(), self.input, self.constant)
    }
}
