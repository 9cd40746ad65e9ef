//! A small imperative language: what the exporters print as C, Rust and Python, and what is counted and checked before.
//!
//! Values are real numbers; indices are natural numbers. There are tables (constant), arrays (local or parameters), loops with
//! known bounds and no recursion, so that memory and work are known when the code is written.

use fleetfoot_library::{Binary, Unary};

/// Tables and functions, in an order in which each uses earlier ones only.
#[derive(Debug, Default)]
pub(super) struct Code {
    pub(super) tables: Vec<Table>,
    pub(super) functions: Vec<Function>,
}

/// In front of the names of tables, so that no other array is taken for one.
pub(super) const TABLE: char = '$';

/// A constant array.
#[derive(Debug)]
pub(super) struct Table {
    /// With [`TABLE`] in front.
    pub(super) name: String,
    pub(super) comment: String,
    pub(super) values: Values,
    /// Values in a row, where the table is a matrix.
    pub(super) row: usize,
}

impl Table {
    /// The name without its mark.
    pub(super) fn plain_name(&self) -> &str {
        self.name.strip_prefix(TABLE).unwrap_or(&self.name)
    }
}

#[derive(Debug)]
pub(super) enum Values {
    Reals(Vec<f64>),
    Indices(Vec<usize>),
}

/// A function; it gives a code (see [`Outcome`]) or nothing.
#[derive(Debug)]
pub(super) struct Function {
    pub(super) name: &'static str,
    pub(super) gives: bool,
    pub(super) parameters: Vec<Parameter>,
    pub(super) body: Vec<Statement>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameter {
    pub(super) name: &'static str,
    pub(super) kind: Kind,
}

/// How a parameter is passed; arrays with their length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    In(usize),
    Out(usize),
    Value,
}

#[derive(Debug, Clone)]
pub(super) enum Real {
    Number(f64),
    Local(String),
    At(String, Index),
    Unary(Unary, Box<Real>),
    Binary(Binary, Box<Real>, Box<Real>),
    /// From the left.
    Sum(Vec<Real>),
}

/// `constant + sum of factor * variable`.
#[derive(Debug, Clone, Default)]
pub(super) struct Index {
    pub(super) constant: usize,
    pub(super) terms: Vec<(usize, Variable)>,
}

#[derive(Debug, Clone)]
pub(super) enum Variable {
    Local(String),
    /// An element of a table of indices.
    Table(String, Index),
}

#[derive(Debug, Clone)]
pub(super) enum Condition {
    Less(Real, Real),
    /// The first is not below the second.
    AtLeast(Real, Real),
    Equal(Real, Real),
    /// Not within `[low, high]`; true for NaN.
    Outside(Real, Real, Real),
    /// NaN or infinite.
    NotFinite(Real),
    Same(Index, Index),
    /// The code of a call is neither a region nor a region left.
    Failed(String),
}

/// A variable that is assigned.
#[derive(Debug, Clone)]
pub(super) enum Place {
    Local(String),
    At(String, Index),
}

#[derive(Debug, Clone)]
pub(super) enum Statement {
    Comment(String),
    /// A constant.
    Let(String, Real),
    /// A variable.
    Variable(String, Real),
    /// An array of zeros.
    Array(String, usize),
    Set(Place, Real),
    Add(Place, Real),
    /// A variable that holds an index.
    Counter(String, Index),
    SetCounter(String, Index),
    For {
        index: String,
        from: Index,
        to: Index,
        /// The most turns it can take.
        turns: usize,
        body: Vec<Statement>,
    },
    If(Condition, Vec<Statement>, Vec<Statement>),
    /// `let result = function(arguments)`.
    Call {
        result: String,
        function: &'static str,
        arguments: Vec<Argument>,
    },
    Return(Outcome),
}

#[derive(Debug, Clone)]
pub(super) enum Argument {
    In(String),
    Out(String),
    Value(Real),
}

/// What a function gives.
#[derive(Debug, Clone)]
pub(super) enum Outcome {
    /// The region, or `-1 - region` where the counter `outside` is not 0.
    Region {
        region: Index,
        outside: Option<String>,
    },
    NoRegion,
    NotFinite,
    /// What a call gave.
    Same(String),
}

impl Index {
    pub(super) fn constant(constant: usize) -> Self {
        Self { constant, terms: Vec::new() }
    }

    pub(super) fn local(name: &str) -> Self {
        Self { constant: 0, terms: vec![(1, Variable::Local(name.to_owned()))] }
    }

    pub(super) fn table(name: &str, at: Index) -> Self {
        Self { constant: 0, terms: vec![(1, Variable::Table(name.to_owned(), at))] }
    }

    pub(super) fn times(mut self, factor: usize) -> Self {
        self.constant *= factor;
        for term in &mut self.terms {
            term.0 *= factor;
        }
        if factor == 0 {
            self.terms.clear();
        }
        self
    }

    pub(super) fn plus(mut self, other: impl Into<Index>) -> Self {
        let other = other.into();
        self.constant += other.constant;
        self.terms.extend(other.terms);
        self
    }
}

impl From<usize> for Index {
    fn from(constant: usize) -> Self {
        Self::constant(constant)
    }
}

impl Real {
    pub(super) fn local(name: &str) -> Self {
        Self::Local(name.to_owned())
    }

    pub(super) fn at(name: &str, index: impl Into<Index>) -> Self {
        Self::At(name.to_owned(), index.into())
    }

    pub(super) fn binary(function: Binary, a: Real, b: Real) -> Self {
        Self::Binary(function, Box::new(a), Box::new(b))
    }

    pub(super) fn times(self, other: Real) -> Self {
        Self::binary(Binary::Mul, self, other)
    }

    pub(super) fn plus(self, other: Real) -> Self {
        Self::binary(Binary::Add, self, other)
    }

    pub(super) fn minus(self, other: Real) -> Self {
        Self::binary(Binary::Sub, self, other)
    }

    pub(super) fn unary(function: Unary, x: Real) -> Self {
        Self::Unary(function, Box::new(x))
    }
}

impl Place {
    pub(super) fn at(name: &str, index: impl Into<Index>) -> Self {
        Self::At(name.to_owned(), index.into())
    }
}

impl Statement {
    pub(super) fn set(name: &str, index: impl Into<Index>, value: Real) -> Self {
        Self::Set(Place::at(name, index), value)
    }

    pub(super) fn add(name: &str, index: impl Into<Index>, value: Real) -> Self {
        Self::Add(Place::at(name, index), value)
    }

    /// A loop over `0..count`.
    pub(super) fn each(index: &str, count: usize, body: Vec<Statement>) -> Self {
        Self::For { index: index.to_owned(), from: 0.into(), to: count.into(), turns: count, body }
    }
}
