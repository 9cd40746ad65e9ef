//! Code in Rust.

use fleetfoot_library::{Binary, Unary};

use crate::{
    code::{Condition, Outcome, Statement},
    names::comment,
    options::Precision,
    print::{Syntax, arguments, index, place, real},
    rust::Rust,
};

impl Syntax for Rust {
    fn number(&self, value: f64) -> String {
        match self.precision {
            Precision::Double => format!("{value:?}"),
            Precision::Float => format!("{:?}", value as f32),
        }
    }

    fn unary(&self, function: Unary, x: &str) -> String {
        let name = match function {
            Unary::Neg => return format!("-({x})"),
            Unary::Log => self.library("log"),
            Unary::Abs => return format!("{}::abs({x})", self.real()),
            Unary::Sign | Unary::Step | Unary::Wrap => function.name().to_owned(),
            Unary::Sin
            | Unary::Cos
            | Unary::Tan
            | Unary::Asin
            | Unary::Acos
            | Unary::Atan
            | Unary::Sinh
            | Unary::Cosh
            | Unary::Tanh
            | Unary::Exp
            | Unary::Sqrt => self.library(function.name()),
        };
        format!("{name}({x})")
    }

    fn binary(&self, function: Binary, a: &str, b: &str) -> String {
        let name = match function {
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div => {
                return format!("({a}) {} ({b})", function.name());
            }
            Binary::Pow => self.library("pow"),
            Binary::Atan2 => self.library("atan2"),
            Binary::Min | Binary::Max => function.name().to_owned(),
        };
        format!("{name}({a}, {b})")
    }

    fn table(&self, table: &str) -> String {
        table.to_ascii_uppercase()
    }

    fn index_table(&self, table: &str, index: &str) -> String {
        format!("{}[{index}] as usize", Syntax::table(self, table))
    }

    fn condition(&self, condition: &Condition) -> String {
        match condition {
            Condition::Less(a, b) => format!("{} < {}", real(self, a), real(self, b)),
            Condition::AtLeast(a, b) => format!("{} >= {}", real(self, a), real(self, b)),
            Condition::Equal(a, b) => format!("{} == {}", real(self, a), real(self, b)),
            Condition::Outside(value, low, high) => {
                let value = real(self, value);
                format!("!({value} >= {} && {value} <= {})", real(self, low), real(self, high))
            }
            Condition::NotFinite(value) => format!("!{}::is_finite({})", self.real(), real(self, value)),
            Condition::Same(a, b) => format!("{} == {}", index(self, a), index(self, b)),
            Condition::Failed(code) => format!("{code} <= NOT_FINITE"),
        }
    }

    fn simple(&self, statement: &Statement) -> Vec<String> {
        let t = self.real();
        let one = match statement {
            Statement::Comment(text) => format!("// {}", comment(text)),
            Statement::Let(name, value) => format!("let {name}: {t} = {};", real(self, value)),
            Statement::Variable(name, value) => format!("let mut {name}: {t} = {};", real(self, value)),
            Statement::Array(name, length) => format!("let mut {name}: [{t}; {length}] = [0.0; {length}];"),
            Statement::Set(to, value) => format!("{} = {};", place(self, to), real(self, value)),
            Statement::Add(to, value) => format!("{} += {};", place(self, to), real(self, value)),
            Statement::Counter(name, value) => format!("let mut {name}: usize = {};", index(self, value)),
            Statement::SetCounter(name, value) => format!("{name} = {};", index(self, value)),
            Statement::Call { result, function, arguments: given } => {
                let borrow = |name: &str, out: bool| match (self.parameters.contains(&name), out) {
                    (true, _) => name.to_owned(),
                    (false, true) => format!("&mut {name}"),
                    (false, false) => format!("&{name}"),
                };
                format!("let {result} = {function}_inner({});", arguments(self, given, &borrow))
            }
            Statement::Return(outcome) => match outcome {
                Outcome::Region { region, outside: None } => format!("return ({}) as i32;", index(self, region)),
                Outcome::Region { region, outside: Some(outside) } => {
                    let region = index(self, region);
                    format!("return if {outside} != 0 {{ -1 - ({region}) as i32 }} else {{ ({region}) as i32 }};")
                }
                Outcome::NoRegion => "return NO_REGION;".into(),
                Outcome::NotFinite => "return NOT_FINITE;".into(),
                Outcome::Same(code) => format!("return {code};"),
            },
            Statement::For { .. } | Statement::If(..) => return Vec::new(),
        };
        vec![one]
    }

    fn open_for(&self, index: &str, from: &str, to: &str) -> String {
        format!("for {index} in {from}..{to} {{")
    }

    fn open_if(&self, condition: &str) -> String {
        format!("if {condition} {{")
    }

    fn open_else(&self) -> &'static str {
        "} else {"
    }

    fn close(&self) -> Option<&'static str> {
        Some("}")
    }

    fn breakable(&self, line: &str) -> bool {
        line.ends_with(';')
    }
}
