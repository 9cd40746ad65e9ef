//! Cost of code: memory exactly, operations by counting, the program's size by estimate.

use std::collections::BTreeSet;

use fleetfoot_library::{Binary, Unary};
use serde::{Serialize, Serializer};

use crate::{
    code::{Argument, Code, Condition, Function, Real, Statement, Values},
    options::Precision,
};

/// Operations of one call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Operations {
    /// Multiplications.
    pub multiplications: u64,
    /// Additions and subtractions.
    pub additions: u64,
    /// Divisions.
    pub divisions: u64,
    /// Comparisons of numbers.
    pub comparisons: u64,
    /// Calls of elementary functions (`sin`, `exp`, `pow`, `sqrt`, ...).
    pub functions: u64,
}

/// Cost of a model's code.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Cost {
    /// Bytes of constant tables.
    pub tables: usize,
    /// Bytes of machine code, estimated: twelve an operation that is written down.
    pub code: usize,
    /// Bytes of a model's variable: states, earlier values, time.
    pub model: usize,
    /// Bytes of local arrays on the deepest chain of calls.
    pub stack: usize,
    /// Functions by name, with the operations of one call at most.
    #[serde(serialize_with = "by_name")]
    pub calls: Vec<(String, Operations)>,
}

fn by_name<S: Serializer>(calls: &[(String, Operations)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(calls.iter().map(|(name, operations)| (name, operations)))
}

/// Elementary functions that code uses.
#[derive(Debug, Default)]
pub(crate) struct Used {
    pub(crate) unary: BTreeSet<Unary>,
    pub(crate) binary: BTreeSet<Binary>,
}

impl Operations {
    fn add(&mut self, other: &Self, times: u64) {
        self.multiplications += times * other.multiplications;
        self.additions += times * other.additions;
        self.divisions += times * other.divisions;
        self.comparisons += times * other.comparisons;
        self.functions += times * other.functions;
    }

    /// The larger of each.
    fn most(self, other: Self) -> Self {
        Self {
            multiplications: self.multiplications.max(other.multiplications),
            additions: self.additions.max(other.additions),
            divisions: self.divisions.max(other.divisions),
            comparisons: self.comparisons.max(other.comparisons),
            functions: self.functions.max(other.functions),
        }
    }

    fn total(self) -> u64 {
        self.multiplications + self.additions + self.divisions + self.comparisons + self.functions
    }

    fn real(&mut self, value: &Real) {
        match value {
            Real::Number(_) | Real::Local(_) | Real::At(..) => {}
            Real::Unary(function, x) => {
                self.real(x);
                match function {
                    Unary::Neg => self.additions += 1,
                    Unary::Abs | Unary::Sign | Unary::Step => self.comparisons += 1,
                    _ => self.functions += 1,
                }
            }
            Real::Binary(function, a, b) => {
                self.real(a);
                self.real(b);
                match function {
                    Binary::Add | Binary::Sub => self.additions += 1,
                    Binary::Mul => self.multiplications += 1,
                    Binary::Div => self.divisions += 1,
                    Binary::Min | Binary::Max => self.comparisons += 1,
                    Binary::Pow | Binary::Atan2 => self.functions += 1,
                }
            }
            Real::Sum(terms) => {
                terms.iter().for_each(|term| self.real(term));
                self.additions += terms.len().saturating_sub(1) as u64;
            }
        }
    }

    fn condition(&mut self, condition: &Condition) {
        match condition {
            Condition::Less(a, b) | Condition::AtLeast(a, b) => {
                self.real(a);
                self.real(b);
                self.comparisons += 1;
            }
            Condition::Equal(..) | Condition::Outside(..) | Condition::NotFinite(_) => self.comparisons += 2,
            Condition::Same(..) | Condition::Failed(_) => {}
        }
    }
}

/// Operations of statements; loops count `turns` times, or once with `written`, which counts the written code.
fn operations(statements: &[Statement], code: &Code, written: bool) -> Operations {
    let mut sum = Operations::default();
    for statement in statements {
        match statement {
            Statement::Let(_, value) | Statement::Variable(_, value) | Statement::Set(_, value) => sum.real(value),
            Statement::Add(_, value) => {
                sum.real(value);
                sum.additions += 1;
            }
            Statement::For { turns, body, .. } => {
                sum.add(&operations(body, code, written), if written { 1 } else { *turns as u64 });
            }
            Statement::If(condition, then, otherwise) => {
                sum.condition(condition);
                let (then, otherwise) = (operations(then, code, written), operations(otherwise, code, written));
                if written {
                    sum.add(&then, 1);
                    sum.add(&otherwise, 1);
                } else {
                    sum.add(&then.most(otherwise), 1);
                }
            }
            Statement::Call { function, arguments, .. } => {
                for argument in arguments {
                    if let Argument::Value(value) = argument {
                        sum.real(value);
                    }
                }
                let called = code.functions.iter().find(|other| other.name == *function);
                if let (Some(called), false) = (called, written) {
                    sum.add(&operations(&called.body, code, written), 1);
                }
            }
            Statement::Comment(_)
            | Statement::Array(..)
            | Statement::Counter(..)
            | Statement::SetCounter(..)
            | Statement::Return(_) => {}
        }
    }
    sum
}

/// Statements with their loops and branches counted as one each: moves and calls take memory as well.
fn lines(statements: &[Statement]) -> u64 {
    let inner = |statement: &Statement| match statement {
        Statement::For { body, .. } => 1 + lines(body),
        Statement::If(_, then, otherwise) => lines(then) + lines(otherwise),
        Statement::Comment(_) => 0,
        _ => 1,
    };
    statements.iter().map(inner).sum()
}

/// Numbers in local arrays and named values, with those of the deepest call.
fn stack(statements: &[Statement], code: &Code) -> usize {
    let (mut frame, mut deepest) = (0, 0);
    for statement in statements {
        match statement {
            Statement::Array(_, length) => frame += length,
            Statement::Let(..) | Statement::Variable(..) => frame += 1,
            Statement::For { body, .. } => deepest = deepest.max(stack(body, code)),
            Statement::If(_, then, otherwise) => deepest = deepest.max(stack(then, code)).max(stack(otherwise, code)),
            Statement::Call { function, .. } => {
                let called = code.functions.iter().find(|other| other.name == *function);
                deepest = deepest.max(called.map_or(0, |called| stack(&called.body, code)));
            }
            _ => {}
        }
    }
    frame + deepest
}

impl Cost {
    /// Of code whose model variable has `kept` numbers.
    pub(crate) fn of(code: &Code, precision: Precision, kept: usize) -> Self {
        let bytes = precision.bytes();
        let table = |values: &Values| match values {
            Values::Reals(values) => values.len() * bytes,
            Values::Indices(values) => {
                let most = values.iter().copied().max().unwrap_or(0);
                values.len()
                    * if most > usize::from(u16::MAX) {
                        4
                    } else if most > usize::from(u8::MAX) {
                        2
                    } else {
                        1
                    }
            }
        };
        let written = |f: &Function| operations(&f.body, code, true).total() + lines(&f.body);
        Self {
            tables: code.tables.iter().map(|t| table(&t.values)).sum(),
            code: usize::try_from(12 * code.functions.iter().map(written).sum::<u64>()).unwrap_or(usize::MAX),
            model: kept * bytes,
            stack: code.functions.iter().map(|f| stack(&f.body, code)).max().unwrap_or(0) * bytes,
            calls: code
                .functions
                .iter()
                .map(|function| (function.name.to_owned(), operations(&function.body, code, false)))
                .collect(),
        }
    }

    /// The table, one line an entry.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![
            format!("flash: {} bytes of tables, about {} bytes of code", self.tables, self.code),
            format!("RAM:   {} bytes for a model, up to {} bytes of stack in a call", self.model, self.stack),
            format!(
                "{:<18} {:>10} {:>10} {:>10} {:>11} {:>10}",
                "a call, at most", "mul", "add", "div", "compare", "functions"
            ),
        ];
        lines.extend(self.calls.iter().map(|(name, o)| {
            format!(
                "{name:<18} {:>10} {:>10} {:>10} {:>11} {:>10}",
                o.multiplications, o.additions, o.divisions, o.comparisons, o.functions
            )
        }));
        lines
    }
}

impl Used {
    pub(crate) fn of(code: &Code) -> Self {
        let mut used = Self::default();
        for function in &code.functions {
            crate::walk::reals(&function.body, &mut |value| match value {
                Real::Unary(function, _) => {
                    used.unary.insert(*function);
                }
                Real::Binary(function, ..) => {
                    used.binary.insert(*function);
                }
                _ => {}
            });
        }
        used
    }

    /// Returns true if a library of elementary functions is needed; `abs` and the sign need none.
    pub(crate) fn library(&self) -> bool {
        let plain = |f: &Unary| matches!(f, Unary::Neg | Unary::Sign | Unary::Step | Unary::Abs);
        self.unary.iter().any(|f| !plain(f)) || self.binary.iter().any(|f| matches!(f, Binary::Pow | Binary::Atan2))
    }
}
