//! Straight-line code: a program as a list of statements, each assigned once.

use crate::{
    Binary, Leaf, Program, Unary,
    program::{Operand, Operation, Target},
};

/// Statements of a [`Program`] that can be printed in any language: every statement assigns a new value, which later
/// ones use; no value is overwritten.
///
/// The operations and their order are the program's, so that code printed from them rounds as the program does.
#[derive(Debug, Clone, PartialEq)]
pub struct StraightLine {
    /// Inputs, in the order of [`Program::leaves`].
    pub leaves: Vec<Leaf>,
    /// The operations; arguments come before their uses.
    pub statements: Vec<Statement>,
    /// Value of each of the program's outputs.
    pub outputs: Vec<Argument>,
}

/// One operation of [`StraightLine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Statement {
    /// A function of one argument.
    Unary(Unary, Argument),
    /// A function of two arguments.
    Binary(Binary, Argument, Argument),
}

/// A value within [`StraightLine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Argument {
    /// A constant.
    Number(f64),
    /// A leaf, by its index.
    Leaf(usize),
    /// An earlier statement, by its index.
    Statement(usize),
}

impl Program {
    /// The program as statements that are assigned once.
    pub fn straight_line(&self) -> StraightLine {
        let mut registers = vec![Argument::Number(f64::NAN); self.registers];
        let mut outputs = vec![Argument::Number(f64::NAN); self.outputs];
        let mut statements = Vec::with_capacity(self.tape.len());
        for instruction in &self.tape {
            let read = |operand: Operand| match operand {
                Operand::Constant(value) => Argument::Number(value),
                Operand::Leaf(leaf) => Argument::Leaf(leaf),
                Operand::Register(register) => registers[register],
                Operand::Output(output) => outputs[output],
            };
            let value = match instruction.operation {
                Operation::Copy(source) => read(source),
                Operation::Unary(function, x) => {
                    statements.push(Statement::Unary(function, read(x)));
                    Argument::Statement(statements.len() - 1)
                }
                Operation::Binary(function, a, b) => {
                    statements.push(Statement::Binary(function, read(a), read(b)));
                    Argument::Statement(statements.len() - 1)
                }
            };
            match instruction.target {
                Target::Register(register) => registers[register] = value,
                Target::Output(output) => outputs[output] = value,
            }
        }
        StraightLine { leaves: self.leaves.clone(), statements, outputs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Expr, Scope};

    #[test]
    fn statements_give_the_bits_of_the_expressions() {
        let scope = Scope::open();
        let texts = ["x", "sin(x)*y + x^7", "sin(x)*y", "2.5", "lag(x, 2) - time()/y", "max(x, y)^-3", "sin(x)*y"];
        let exprs: Vec<Expr> = texts.iter().map(|text| Expr::parse(text, &scope).unwrap()).collect();
        let code = Program::compile(&exprs, &["x", "y"]).unwrap().straight_line();
        let leaf = |leaf: Leaf| match leaf {
            Leaf::Column { column, lag } => 0.3 + column as f64 + 0.7 * f64::from(lag),
            Leaf::Time { lag } => 5.5 - f64::from(lag),
        };
        let mut values: Vec<f64> = Vec::new();
        let read = |values: &[f64], argument: Argument| match argument {
            Argument::Number(value) => value,
            Argument::Leaf(index) => leaf(code.leaves[index]),
            Argument::Statement(index) => values[index],
        };
        for statement in &code.statements {
            values.push(match *statement {
                Statement::Unary(function, x) => function.apply(read(&values, x)),
                Statement::Binary(function, a, b) => function.apply(read(&values, a), read(&values, b)),
            });
        }
        for (expr, &output) in exprs.iter().zip(&code.outputs) {
            let column = |name: &str, lag| leaf(Leaf::Column { column: usize::from(name == "y"), lag });
            let expected = expr.value(column, |lag| leaf(Leaf::Time { lag }));
            assert_eq!(read(&values, output).to_bits(), expected.to_bits(), "{expr}");
        }
        assert_eq!(code.outputs[2], code.outputs[6], "shared values are computed once");
    }
}
