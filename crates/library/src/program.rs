//! Programs: expressions compiled together into a flat tape.

use std::{collections::HashMap, ops::Range};

use fleetfoot_data::{Block, Halo, did_you_mean, nearest};

use crate::{Binary, Expr, Node, Unary};

/// Expressions compiled into one tape of instructions: what they share is computed once, and the values of later use
/// stay in few registers. An output that others are built from is read where it was written, without a copy.
///
/// Evaluation ([`Program::evaluate`], [`Program::evaluate_row`]) gives the same bits for any range of rows and any tiling, and the bits of
/// [`Expr::value`] (all NaN taken as one).
#[derive(Debug, Clone)]
pub struct Program {
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) tape: Vec<Instruction>,
    pub(crate) registers: usize,
    pub(crate) outputs: usize,
}

/// Input of a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Leaf {
    /// A column, by its index among the columns that the program was compiled for, `lag` rows earlier (negative: later).
    Column {
        /// Index of the column.
        column: usize,
        /// Rows back in time.
        lag: i32,
    },
    /// Seconds from the start of the episode, `lag` rows earlier (negative: later).
    Time {
        /// Rows back in time.
        lag: i32,
    },
}

impl Leaf {
    /// Rows back in time.
    pub fn lag(&self) -> i32 {
        match *self {
            Self::Column { lag, .. } | Self::Time { lag } => lag,
        }
    }
}

/// An expression uses a column that is not there.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no column `{name}`{}", did_you_mean(nearest))]
pub struct UnknownColumn {
    /// The name.
    pub name: String,
    /// Columns whose names resemble it.
    pub nearest: Vec<String>,
}

/// One step of the tape: `target = operation(arguments)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Instruction {
    pub(crate) operation: Operation,
    pub(crate) target: Target,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Operation {
    Copy(Operand),
    Unary(Unary, Operand),
    Binary(Binary, Operand, Operand),
}

/// Source of an instruction's argument. A tape reads only values that it wrote before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Operand {
    Constant(f64),
    Leaf(usize),
    Register(usize),
    Output(usize),
}

/// Destination of an instruction's value, distinct from the sources of the same instruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Target {
    Register(usize),
    Output(usize),
}

impl Program {
    /// Compiles expressions for recordings with these columns; the outputs are the expressions' values in order.
    ///
    /// # Errors
    /// [`UnknownColumn`], with the nearest names.
    pub fn compile(exprs: &[Expr], columns: &[&str]) -> Result<Self, UnknownColumn> {
        let mut index = HashMap::with_capacity(columns.len());
        for (i, &name) in columns.iter().enumerate() {
            index.entry(name).or_insert(i);
        }
        let mut graph = Graph::default();
        let mut compiled = HashMap::new();
        let mut missing = None;
        let outputs: Vec<usize> = exprs
            .iter()
            .map(|expr| {
                expr.fold_with(&mut compiled, |part, arguments| {
                    graph.add(part.node(), arguments, &index).unwrap_or_else(|name| {
                        missing.get_or_insert(name);
                        graph.constant(f64::NAN)
                    })
                })
            })
            .collect();
        if let Some(name) = missing {
            let nearest = nearest(&name, columns.iter().copied());
            return Err(UnknownColumn { name, nearest });
        }
        Ok(graph.schedule(&outputs))
    }

    /// Inputs of the program, in the order in which [`Program::evaluate`] takes them.
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// Rows needed before and after a row.
    pub fn halo(&self) -> Halo {
        let lags = || self.leaves.iter().map(|leaf| i64::from(leaf.lag()));
        Halo {
            before: lags().max().map_or(0, |lag| lag.max(0) as usize),
            after: lags().min().map_or(0, |lag| (-lag).max(0) as usize),
        }
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Instructions of the tape.
    pub fn instructions(&self) -> usize {
        self.tape.len()
    }

    /// Intermediate values alive at once.
    pub fn registers(&self) -> usize {
        self.registers
    }

    /// The core rows of a block, counted from the core's first, for which every lag stays inside the block.
    ///
    /// A block that was read with [`Program::halo`] is cut only at the borders of its episode: the rows that are missing here
    /// are those whose lags or differences would cross one.
    pub fn valid_rows(&self, block: &Block) -> Range<usize> {
        let halo = self.halo();
        let start = halo.before.saturating_sub(block.before);
        let end = (block.rows + block.after).saturating_sub(halo.after).min(block.rows);
        if start < end { start..end } else { 0..0 }
    }
}

/// The distinct values of all expressions, arguments before what uses them.
#[derive(Default)]
struct Graph {
    leaves: Vec<Leaf>,
    leaf_index: HashMap<Leaf, usize>,
    values: Vec<Value>,
    known: HashMap<Value, usize>,
}

/// A distinct value; arguments by index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Value {
    /// By the bits.
    Constant(u64),
    Leaf(usize),
    Unary(Unary, usize),
    Binary(Binary, usize, usize),
}

impl Value {
    fn arguments(self) -> impl Iterator<Item = usize> {
        let (first, second) = match self {
            Self::Constant(_) | Self::Leaf(_) => (None, None),
            Self::Unary(_, x) => (Some(x), None),
            Self::Binary(_, a, b) => (Some(a), Some(b)),
        };
        first.into_iter().chain(second)
    }
}

impl Graph {
    /// The value of a node whose arguments are known; the name of a column that is not.
    fn add(&mut self, node: &Node, arguments: &[usize], columns: &HashMap<&str, usize>) -> Result<usize, String> {
        Ok(match (node, arguments) {
            (Node::Column { name, lag }, _) => match columns.get(&**name) {
                Some(&column) => self.leaf(Leaf::Column { column, lag: *lag }),
                None => return Err(name.to_string()),
            },
            (Node::Time { lag }, _) => self.leaf(Leaf::Time { lag: *lag }),
            (Node::Unary(function, _), &[x]) => self.unary(*function, x),
            (Node::Binary(function, ..), &[a, b]) => self.binary(*function, a, b),
            (Node::Power(_, k), &[x]) => {
                let power = self.power(x, k.unsigned_abs());
                if *k < 0 {
                    let one = self.constant(1.0);
                    self.binary(Binary::Div, one, power)
                } else {
                    power
                }
            }
            (Node::Number(value), _) => self.constant(*value),
            _ => unreachable!("one argument for each child"),
        })
    }

    /// `x^k = x^floor(k/2) * x^ceil(k/2)`: at most two new values a level.
    fn power(&mut self, x: usize, k: u32) -> usize {
        match k {
            0 => self.constant(1.0),
            1 => x,
            _ => {
                // x^a and x^(a+1) for the leading bits a of k are all that the recursion meets. Where the second is
                // not needed, the schedule leaves it out.
                let (mut low, mut high) = (x, self.binary(Binary::Mul, x, x));
                for bit in (0..k.ilog2()).rev() {
                    let between = self.binary(Binary::Mul, low, high);
                    (low, high) = if k >> bit & 1 == 0 {
                        (self.binary(Binary::Mul, low, low), between)
                    } else {
                        (between, self.binary(Binary::Mul, high, high))
                    };
                }
                low
            }
        }
    }

    fn leaf(&mut self, leaf: Leaf) -> usize {
        let next = self.leaves.len();
        let index = *self.leaf_index.entry(leaf).or_insert(next);
        if index == next {
            self.leaves.push(leaf);
        }
        self.intern(Value::Leaf(index))
    }

    fn constant(&mut self, value: f64) -> usize {
        self.intern(Value::Constant(value.to_bits()))
    }

    fn unary(&mut self, function: Unary, x: usize) -> usize {
        match self.values[x] {
            Value::Constant(x) => self.constant(function.apply(f64::from_bits(x))),
            _ => self.intern(Value::Unary(function, x)),
        }
    }

    fn binary(&mut self, function: Binary, a: usize, b: usize) -> usize {
        match (self.values[a], self.values[b]) {
            (Value::Constant(a), Value::Constant(b)) => {
                self.constant(function.apply(f64::from_bits(a), f64::from_bits(b)))
            }
            _ if function.commutes() && a > b => self.intern(Value::Binary(function, b, a)),
            _ => self.intern(Value::Binary(function, a, b)),
        }
    }

    fn intern(&mut self, value: Value) -> usize {
        *self.known.entry(value).or_insert_with(|| {
            self.values.push(value);
            self.values.len() - 1
        })
    }

    /// Gives each value that the outputs need a place, and writes the tape.
    fn schedule(self, outputs: &[usize]) -> Program {
        let (needed, mut readers) = self.readers(outputs);
        let mut place: Vec<Option<Operand>> = vec![None; self.values.len()];
        for (output, &value) in outputs.iter().enumerate() {
            if let (Value::Unary(..) | Value::Binary(..), None) = (self.values[value], place[value]) {
                place[value] = Some(Operand::Output(output));
            }
        }
        let (mut tape, mut registers, mut free) = (Vec::new(), 0, Vec::new());
        for (at, &value) in self.values.iter().enumerate().filter(|&(at, _)| needed[at]) {
            let operation = match value {
                Value::Constant(bits) => {
                    place[at] = Some(Operand::Constant(f64::from_bits(bits)));
                    continue;
                }
                Value::Leaf(leaf) => {
                    place[at] = Some(Operand::Leaf(leaf));
                    continue;
                }
                Value::Unary(function, x) => Operation::Unary(function, written(&place, x)),
                Value::Binary(function, a, b) => Operation::Binary(function, written(&place, a), written(&place, b)),
            };
            // The target is chosen before the arguments' registers are free again: an instruction never overwrites what it reads.
            let target = match place[at] {
                Some(Operand::Output(output)) => Target::Output(output),
                _ => {
                    let register = free.pop().unwrap_or_else(|| {
                        registers += 1;
                        registers - 1
                    });
                    place[at] = Some(Operand::Register(register));
                    Target::Register(register)
                }
            };
            tape.push(Instruction { operation, target });
            for argument in value.arguments() {
                readers[argument] -= 1;
                if let (0, Some(Operand::Register(register))) = (readers[argument], place[argument]) {
                    free.push(register);
                }
            }
        }
        // Outputs that are leaves or constants, or repeat another output.
        for (output, &value) in outputs.iter().enumerate() {
            let source = written(&place, value);
            if source != Operand::Output(output) {
                tape.push(Instruction { operation: Operation::Copy(source), target: Target::Output(output) });
            }
        }
        Program { leaves: self.leaves, tape, registers, outputs: outputs.len() }
    }

    /// For each value: true if the outputs need it, and its number of uses as an argument of needed values.
    fn readers(&self, outputs: &[usize]) -> (Vec<bool>, Vec<u32>) {
        let mut needed = vec![false; self.values.len()];
        let mut readers = vec![0u32; self.values.len()];
        for &value in outputs {
            needed[value] = true;
        }
        // Arguments come before what uses them.
        for (at, value) in self.values.iter().enumerate().rev() {
            if needed[at] {
                for argument in value.arguments() {
                    needed[argument] = true;
                    readers[argument] += 1;
                }
            }
        }
        (needed, readers)
    }
}

/// The place of a value that comes earlier on the tape.
fn written(place: &[Option<Operand>], value: usize) -> Operand {
    place[value].unwrap_or_else(|| unreachable!("arguments come before what uses them"))
}
