//! Running code without a compiler, with a bound on its rounding errors.
//!
//! Every value carries a first-order bound of its rounding error (in units of the roundoff): the standard running error
//! analysis (Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 3.3). The bounds are the tolerances
//! of the test vectors: an expected value with cancellation is given the room that it needs, and no more. A run near a
//! border (of a region, of a step, of a training range) is no good as a test vector if rounding could carry it across.

use std::collections::HashMap;

use fleetfoot_library::{Binary, Unary};

use crate::code::{
    Argument, Code, Condition, Function, Index, Kind, Outcome, Place, Real, Statement, Values, Variable,
};

/// A value and the bound of its error, in units of the roundoff.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Bounded {
    pub(crate) value: f64,
    pub(crate) error: f64,
}

/// Codes of failures.
pub(crate) const NO_REGION: i64 = -32767;
/// See [`NO_REGION`].
pub(crate) const NOT_FINITE: i64 = -32766;

/// Result of a run.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub(crate) code: i64,
    /// Output arrays by name.
    pub(crate) outputs: Vec<(&'static str, Vec<Bounded>)>,
    /// True if rounding could have taken another branch.
    pub(crate) ambiguous: bool,
}

pub(crate) struct Interpreter<'a> {
    code: &'a Code,
    tables: HashMap<&'a str, Vec<Bounded>>,
    indices: HashMap<&'a str, &'a [usize]>,
    /// Half the distance from 1 to the next number, with room for libraries' functions.
    roundoff: f64,
    ambiguous: bool,
}

#[derive(Default)]
struct Frame {
    reals: HashMap<String, Bounded>,
    arrays: HashMap<String, Vec<Bounded>>,
    counters: HashMap<String, usize>,
    codes: HashMap<String, i64>,
}

impl<'a> Interpreter<'a> {
    pub(crate) fn new(code: &'a Code, roundoff: f64) -> Self {
        let (mut tables, mut indices) = (HashMap::new(), HashMap::new());
        for table in &code.tables {
            match &table.values {
                Values::Reals(values) => {
                    tables.insert(table.name.as_str(), values.iter().map(|&v| rounded(v)).collect());
                }
                Values::Indices(values) => {
                    indices.insert(table.name.as_str(), values.as_slice());
                }
            }
        }
        Self { code, tables, indices, roundoff, ambiguous: false }
    }

    /// Calls a function with arrays and values by name; `None` for a function that is not there.
    pub(crate) fn call(&mut self, name: &str, arrays: &[(&str, &[f64])], values: &[(&str, f64)]) -> Option<Run> {
        let code = self.code;
        let function = code.functions.iter().find(|function| function.name == name)?;
        let mut frame = Frame::default();
        for (name, values) in arrays {
            let values = values.iter().map(|&value| Bounded { value, error: 0.0 }).collect();
            frame.arrays.insert((*name).to_owned(), values);
        }
        for &(name, value) in values {
            frame.reals.insert(name.to_owned(), Bounded { value, error: 0.0 });
        }
        for parameter in &function.parameters {
            if let Kind::Out(length) = parameter.kind {
                frame.arrays.entry(parameter.name.to_owned()).or_insert_with(|| vec![Bounded::default(); length]);
            }
        }
        self.ambiguous = false;
        let result = self.run(function, &mut frame);
        let outputs = function
            .parameters
            .iter()
            .filter(|parameter| matches!(parameter.kind, Kind::Out(_)))
            .filter_map(|parameter| Some((parameter.name, frame.arrays.remove(parameter.name)?)))
            .collect();
        Some(Run { code: result, outputs, ambiguous: self.ambiguous })
    }

    fn run(&mut self, function: &Function, frame: &mut Frame) -> i64 {
        self.block(&function.body, frame).unwrap_or(0)
    }

    fn block(&mut self, statements: &[Statement], frame: &mut Frame) -> Option<i64> {
        for statement in statements {
            let result = self.statement(statement, frame);
            if result.is_some() {
                return result;
            }
        }
        None
    }

    fn statement(&mut self, statement: &Statement, frame: &mut Frame) -> Option<i64> {
        match statement {
            Statement::Comment(_) => {}
            Statement::Let(name, value) | Statement::Variable(name, value) => {
                let value = self.real(value, frame);
                frame.reals.insert(name.clone(), value);
            }
            Statement::Array(name, length) => {
                frame.arrays.insert(name.clone(), vec![Bounded::default(); *length]);
            }
            Statement::Set(place, value) => {
                let value = self.real(value, frame);
                self.store(place, value, frame);
            }
            Statement::Add(place, value) => {
                let value = self.real(value, frame);
                let old = match place {
                    Place::Local(name) => frame.reals[name],
                    Place::At(name, at) => self.element(name, self.index(at, frame), frame),
                };
                self.store(place, binary(Binary::Add, old, value), frame);
            }
            Statement::Counter(name, value) | Statement::SetCounter(name, value) => {
                let value = self.index(value, frame);
                frame.counters.insert(name.clone(), value);
            }
            Statement::For { index, from, to, body, .. } => {
                for at in self.index(from, frame)..self.index(to, frame) {
                    frame.counters.insert(index.clone(), at);
                    let result = self.block(body, frame);
                    if result.is_some() {
                        return result;
                    }
                }
            }
            Statement::If(condition, then, otherwise) => {
                let branch = if self.holds(condition, frame) { then } else { otherwise };
                return self.block(branch, frame);
            }
            Statement::Call { result, function, arguments } => self.nested(result, function, arguments, frame),
            Statement::Return(outcome) => return Some(self.outcome(outcome, frame)),
        }
        None
    }

    fn nested(&mut self, result: &str, name: &str, arguments: &[Argument], frame: &mut Frame) {
        let code = self.code;
        let Some(function) = code.functions.iter().find(|function| function.name == name) else {
            frame.codes.insert(result.to_owned(), NOT_FINITE);
            return;
        };
        let mut inner = Frame::default();
        for (parameter, argument) in function.parameters.iter().zip(arguments) {
            match argument {
                Argument::In(array) | Argument::Out(array) => {
                    inner.arrays.insert(parameter.name.to_owned(), frame.arrays[array].clone());
                }
                Argument::Value(value) => {
                    let value = self.real(value, frame);
                    inner.reals.insert(parameter.name.to_owned(), value);
                }
            }
        }
        let given = self.run(function, &mut inner);
        for (parameter, argument) in function.parameters.iter().zip(arguments) {
            if let (Argument::Out(array), Some(values)) = (argument, inner.arrays.remove(parameter.name)) {
                frame.arrays.insert(array.clone(), values);
            }
        }
        frame.codes.insert(result.to_owned(), given);
    }

    fn outcome(&self, outcome: &Outcome, frame: &Frame) -> i64 {
        match outcome {
            Outcome::Region { region, outside } => {
                let region = self.index(region, frame) as i64;
                let left = outside.as_ref().is_some_and(|outside| frame.counters[outside] != 0);
                if left { -1 - region } else { region }
            }
            Outcome::NoRegion => NO_REGION,
            Outcome::NotFinite => NOT_FINITE,
            Outcome::Same(code) => frame.codes[code],
        }
    }

    fn index(&self, index: &Index, frame: &Frame) -> usize {
        let term = |(factor, variable): &(usize, Variable)| {
            factor
                * match variable {
                    Variable::Local(name) => frame.counters[name],
                    Variable::Table(name, at) => self.indices[name.as_str()][self.index(at, frame)],
                }
        };
        index.constant + index.terms.iter().map(term).sum::<usize>()
    }

    fn element(&self, name: &str, at: usize, frame: &Frame) -> Bounded {
        match self.tables.get(name) {
            Some(table) => table[at],
            None => frame.arrays[name][at],
        }
    }

    fn store(&self, place: &Place, value: Bounded, frame: &mut Frame) {
        match place {
            Place::Local(name) => {
                frame.reals.insert(name.clone(), value);
            }
            Place::At(name, at) => {
                let at = self.index(at, frame);
                if let Some(array) = frame.arrays.get_mut(name) {
                    array[at] = value;
                }
            }
        }
    }

    fn real(&mut self, value: &Real, frame: &Frame) -> Bounded {
        match value {
            Real::Number(value) => rounded(*value),
            Real::Local(name) => frame.reals[name],
            Real::At(name, at) => self.element(name, self.index(at, frame), frame),
            Real::Unary(function, x) => {
                let x = self.real(x, frame);
                let borders: &[f64] = match function {
                    Unary::Sign | Unary::Step | Unary::Log | Unary::Sqrt => &[0.0],
                    Unary::Asin | Unary::Acos => &[-1.0, 1.0],
                    _ => &[],
                };
                let doubt = borders.iter().any(|&border| self.near(x, Bounded { value: border, error: 0.0 }));
                let y = unary(*function, x);
                let jump = *function == Unary::Wrap
                    && self.near(Bounded { value: y.value.abs(), ..y }, rounded(std::f64::consts::PI));
                self.ambiguous |= doubt || jump;
                y
            }
            Real::Binary(function, a, b) => {
                let (a, b) = (self.real(a, frame), self.real(b, frame));
                if *function == Binary::Atan2 && b.value < 0.0 && self.near(a, Bounded::default()) {
                    self.ambiguous = true;
                }
                if matches!(function, Binary::Min | Binary::Max) && !self.near(a, b) {
                    // Rounding does not change which of the two it is: a unit of a network that is not active is zero, without an error.
                    let value = function.apply(a.value, b.value);
                    return if value == b.value { b } else { Bounded { value, ..a } };
                }
                binary(*function, a, b)
            }
            Real::Sum(terms) => {
                let mut sum: Option<Bounded> = None;
                for term in terms {
                    let term = self.real(term, frame);
                    sum = Some(sum.map_or(term, |sum| binary(Binary::Add, sum, term)));
                }
                sum.unwrap_or_default()
            }
        }
    }

    /// Returns true if rounding could exchange the order of two values that are not exact.
    fn near(&self, a: Bounded, b: Bounded) -> bool {
        let room = 64.0 * self.roundoff * (a.error + b.error);
        room > 0.0 && (a.value - b.value).abs() <= room
    }

    fn holds(&mut self, condition: &Condition, frame: &Frame) -> bool {
        match condition {
            Condition::Less(a, b) => {
                let (a, b) = (self.real(a, frame), self.real(b, frame));
                self.ambiguous |= self.near(a, b);
                a.value < b.value
            }
            Condition::AtLeast(a, b) => {
                let (a, b) = (self.real(a, frame), self.real(b, frame));
                self.ambiguous |= self.near(a, b);
                a.value >= b.value
            }
            Condition::Equal(a, b) => {
                let (a, b) = (self.real(a, frame), self.real(b, frame));
                self.ambiguous |= self.near(a, b) && a.value.total_cmp(&b.value).is_ne();
                a.value == b.value
            }
            Condition::Outside(value, low, high) => {
                let (value, low, high) = (self.real(value, frame), self.real(low, frame), self.real(high, frame));
                // An exact value on its bound, such as a range of one point, is no matter of rounding.
                let border = |bound: Bounded| value.error > 0.0 && self.near(value, bound);
                self.ambiguous |= border(low) || border(high);
                !(value.value >= low.value && value.value <= high.value)
            }
            Condition::NotFinite(value) => !self.real(value, frame).value.is_finite(),
            Condition::Same(a, b) => self.index(a, frame) == self.index(b, frame),
            Condition::Failed(code) => frame.codes[code] <= NOT_FINITE,
        }
    }
}

/// A constant, rounded to the precision.
fn rounded(value: f64) -> Bounded {
    Bounded { value, error: value.abs() }
}

fn unary(function: Unary, x: Bounded) -> Bounded {
    let value = function.apply(x.value);
    let slope = match function {
        Unary::Neg | Unary::Abs => return Bounded { value, error: x.error },
        Unary::Sign | Unary::Step => return Bounded { value, error: 0.0 },
        Unary::Wrap => 1.0,
        Unary::Sin => x.value.cos(),
        Unary::Cos => x.value.sin(),
        Unary::Tan => 1.0 + value * value,
        Unary::Asin | Unary::Acos => 1.0 / (1.0 - x.value * x.value).sqrt(),
        Unary::Atan => 1.0 / (1.0 + x.value * x.value),
        Unary::Sinh => x.value.cosh(),
        Unary::Cosh => x.value.sinh(),
        Unary::Tanh => 1.0 - value * value,
        Unary::Exp => value,
        Unary::Log => 1.0 / x.value,
        Unary::Sqrt => 0.5 / value,
    };
    let rounding = match function {
        // The angle's turns are rounded too.
        Unary::Wrap => x.value.abs() + 2.0 * std::f64::consts::PI,
        // Libraries' functions are good to a few units in the last place.
        _ => 4.0 * value.abs(),
    };
    Bounded { value, error: slope.abs() * x.error + rounding }
}

fn binary(function: Binary, a: Bounded, b: Bounded) -> Bounded {
    let value = function.apply(a.value, b.value);
    let carried = match function {
        Binary::Add | Binary::Sub => a.error + b.error,
        Binary::Mul => a.error * b.value.abs() + a.value.abs() * b.error,
        Binary::Div => (a.error + value.abs() * b.error) / b.value.abs(),
        Binary::Pow => {
            let of_base = (b.value * value / a.value).abs() * a.error;
            let of_exponent = if b.error > 0.0 { (value * a.value.ln()).abs() * b.error } else { 0.0 };
            of_base + of_exponent + 3.0 * value.abs()
        }
        Binary::Atan2 => {
            let square = a.value * a.value + b.value * b.value;
            (b.value.abs() * a.error + a.value.abs() * b.error) / square + 3.0 * value.abs()
        }
        Binary::Min | Binary::Max => return Bounded { value, error: a.error.max(b.error) },
    };
    Bounded { value, error: carried + value.abs() }
}
