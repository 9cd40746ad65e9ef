//! A small imperative language, which the exporters print as C, Rust and Python after counting and checking.
//!
//! Values are real numbers; indices are natural numbers. There are tables (constant), arrays (local or parameters) and
//! loops with known bounds, but no recursion. Memory and work are therefore known when the code is written.

use fleetfoot_library::{Binary, Unary};

/// Tables and functions, in an order in which each uses earlier ones only.
#[derive(Debug, Default)]
pub(crate) struct Code {
    pub(crate) tables: Vec<Table>,
    pub(crate) functions: Vec<Function>,
}

/// In front of the names of tables, so that no other array is taken for one.
pub(crate) const TABLE: char = '$';

/// A constant array.
#[derive(Debug)]
pub(crate) struct Table {
    /// With [`TABLE`] in front.
    pub(crate) name: String,
    pub(crate) comment: String,
    pub(crate) values: Values,
    /// Values in a row, where the table is a matrix.
    pub(crate) row: usize,
}

impl Table {
    /// The name without its mark.
    pub(crate) fn plain_name(&self) -> &str {
        self.name.strip_prefix(TABLE).unwrap_or(&self.name)
    }
}

#[derive(Debug)]
pub(crate) enum Values {
    Reals(Vec<f64>),
    Indices(Vec<usize>),
}

/// A function; it gives a code (see [`Outcome`]) or nothing.
#[derive(Debug)]
pub(crate) struct Function {
    pub(crate) name: &'static str,
    pub(crate) gives: bool,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) body: Vec<Statement>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parameter {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
}

/// Passing of a parameter; arrays with their length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    In(usize),
    Out(usize),
    Value,
}

#[derive(Debug, Clone)]
pub(crate) enum Real {
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
pub(crate) struct Index {
    pub(crate) constant: usize,
    pub(crate) terms: Vec<(usize, Variable)>,
}

#[derive(Debug, Clone)]
pub(crate) enum Variable {
    Local(String),
    /// An element of a table of indices.
    Table(String, Index),
}

#[derive(Debug, Clone)]
pub(crate) enum Condition {
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
pub(crate) enum Place {
    Local(String),
    At(String, Index),
}

#[derive(Debug, Clone)]
pub(crate) enum Statement {
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
pub(crate) enum Argument {
    In(String),
    Out(String),
    Value(Real),
}

/// Return value of a function.
#[derive(Debug, Clone)]
pub(crate) enum Outcome {
    /// The region, or `-1 - region` where the counter `outside` is not 0.
    Region {
        region: Index,
        outside: Option<String>,
    },
    NoRegion,
    NotFinite,
    /// The return value of a call.
    Same(String),
}

impl Index {
    pub(crate) fn constant(constant: usize) -> Self {
        Self { constant, terms: Vec::new() }
    }

    pub(crate) fn local(name: &str) -> Self {
        Self { constant: 0, terms: vec![(1, Variable::Local(name.to_owned()))] }
    }

    pub(crate) fn table(name: &str, at: Index) -> Self {
        Self { constant: 0, terms: vec![(1, Variable::Table(name.to_owned(), at))] }
    }

    pub(crate) fn times(mut self, factor: usize) -> Self {
        self.constant *= factor;
        for term in &mut self.terms {
            term.0 *= factor;
        }
        if factor == 0 {
            self.terms.clear();
        }
        self
    }

    pub(crate) fn plus(mut self, other: impl Into<Index>) -> Self {
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
    pub(crate) fn local(name: &str) -> Self {
        Self::Local(name.to_owned())
    }

    pub(crate) fn at(name: &str, index: impl Into<Index>) -> Self {
        Self::At(name.to_owned(), index.into())
    }

    pub(crate) fn binary(function: Binary, a: Real, b: Real) -> Self {
        Self::Binary(function, Box::new(a), Box::new(b))
    }

    pub(crate) fn times(self, other: Real) -> Self {
        Self::binary(Binary::Mul, self, other)
    }

    pub(crate) fn plus(self, other: Real) -> Self {
        Self::binary(Binary::Add, self, other)
    }

    pub(crate) fn minus(self, other: Real) -> Self {
        Self::binary(Binary::Sub, self, other)
    }

    pub(crate) fn unary(function: Unary, x: Real) -> Self {
        Self::Unary(function, Box::new(x))
    }
}

impl Place {
    pub(crate) fn at(name: &str, index: impl Into<Index>) -> Self {
        Self::At(name.to_owned(), index.into())
    }
}

impl Statement {
    pub(crate) fn set(name: &str, index: impl Into<Index>, value: Real) -> Self {
        Self::Set(Place::at(name, index), value)
    }

    pub(crate) fn add(name: &str, index: impl Into<Index>, value: Real) -> Self {
        Self::Add(Place::at(name, index), value)
    }

    /// A loop over `0..count`.
    pub(crate) fn each(index: &str, count: usize, body: Vec<Statement>) -> Self {
        Self::For { index: index.to_owned(), from: 0.into(), to: count.into(), turns: count, body }
    }
}
