//! Code in C99.

use fleetfoot_library::{Binary, Unary};

use crate::{
    code::{Code, Condition, Function, Kind, Outcome, Statement, Table, Values},
    options::Precision,
    print::{Syntax, arguments, block, index, place, real},
};

/// C with one kind of real numbers.
pub(crate) struct C<'a> {
    pub(crate) precision: Precision,
    pub(crate) prefix: &'a str,
}

impl C<'_> {
    /// The type of real numbers.
    pub(crate) fn real(&self) -> &'static str {
        match self.precision {
            Precision::Float => "float",
            Precision::Double => "double",
        }
    }

    /// The name of a function of the standard library for this type.
    pub(crate) fn library(&self, name: &str) -> String {
        match self.precision {
            Precision::Float => format!("{name}f"),
            Precision::Double => name.to_owned(),
        }
    }

    pub(crate) fn upper(&self) -> String {
        self.prefix.to_ascii_uppercase()
    }

    /// `FLT_MAX` or `DBL_MAX`.
    pub(crate) fn largest(&self) -> &'static str {
        match self.precision {
            Precision::Float => "FLT_MAX",
            Precision::Double => "DBL_MAX",
        }
    }

    /// A constant table.
    pub(crate) fn table(&self, table: &Table, out: &mut String) {
        let (kind, values): (&str, Vec<String>) = match &table.values {
            Values::Reals(values) => (self.real(), values.iter().map(|&value| self.number(value)).collect()),
            Values::Indices(values) => (index_type(values), values.iter().map(usize::to_string).collect()),
        };
        *out += &format!("/* {} */\n", crate::names::comment(&table.comment));
        *out += &format!("static const {kind} {}_{}[{}] = {{\n", self.prefix, table.plain_name(), values.len());
        crate::layout::rows(&values, table.row, out);
        *out += "};\n\n";
    }

    /// The head of a function.
    pub(crate) fn head(&self, function: &Function) -> String {
        let parameters: Vec<String> = function
            .parameters
            .iter()
            .map(|parameter| match parameter.kind {
                Kind::In(length) => format!("const {} {}[{length}]", self.real(), parameter.name),
                Kind::Out(length) => format!("{} {}[{length}]", self.real(), parameter.name),
                Kind::Value => format!("{} {}", self.real(), parameter.name),
            })
            .collect();
        let gives = if function.gives { "int" } else { "void" };
        format!("static {gives} {}_{}_({})", self.prefix, function.name, parameters.join(", "))
    }

    /// Tables and functions.
    pub(crate) fn code(&self, code: &Code, out: &mut String) {
        for table in &code.tables {
            self.table(table, out);
        }
        for function in &code.functions {
            *out += &format!("{}\n{{\n", self.head(function));
            for parameter in &function.parameters {
                if !crate::walk::uses(&function.body, parameter.name) {
                    *out += &format!("    (void){};\n", parameter.name);
                }
            }
            block(self, &function.body, 1, out);
            *out += "}\n\n";
        }
    }

    /// Small functions that C lacks, those in use.
    pub(crate) fn helpers(&self, used: &crate::cost::Used, out: &mut String) {
        let (t, p) = (self.real(), self.prefix);
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let mut helper = |wanted: bool, text: String| {
            if wanted {
                *out += &text;
                *out += "\n";
            }
        };
        helper(
            used.unary.contains(&Unary::Sign),
            format!(
                "static {t} {p}_sign_({t} x)\n{{\n    return (x > {zero}) ? {one} : ((x < {zero}) ? -{one} : x);\n}}\n"
            ),
        );
        helper(
            used.unary.contains(&Unary::Step),
            format!(
                "static {t} {p}_step_({t} x)\n{{\n    return (x > {zero}) ? {one} : ((x <= {zero}) ? {zero} : x);\n}}\n"
            ),
        );
        let (turn, half, ceil) =
            (self.number(std::f64::consts::TAU), self.number(std::f64::consts::PI), self.library("ceil"));
        helper(
            used.unary.contains(&Unary::Wrap),
            format!(
                "/* The angle in (-pi, pi]. */\nstatic {t} {p}_wrap_({t} x)\n{{\n    {t} y = x - {turn} * {ceil}((x - {half}) / {turn});\n    if (y > {half}) {{\n        y -= {turn};\n    }}\n    if (y <= -{half}) {{\n        y += {turn};\n    }}\n    return y;\n}}\n"
            ),
        );
        for (function, name, operator) in [(Binary::Min, "min", "<"), (Binary::Max, "max", ">")] {
            helper(
                used.binary.contains(&function),
                format!(
                    "/* Not a number if either is not. */\nstatic {t} {p}_{name}_({t} a, {t} b)\n{{\n    return (a {operator} b) ? a : ((b {operator}= a) ? b : (a + b));\n}}\n"
                ),
            );
        }
    }
}

/// The smallest type that holds the indices.
fn index_type(values: &[usize]) -> &'static str {
    match values.iter().max() {
        Some(&most) if most > usize::from(u16::MAX) => "uint32_t",
        Some(&most) if most > usize::from(u8::MAX) => "uint16_t",
        _ => "uint8_t",
    }
}

impl Syntax for C<'_> {
    fn number(&self, value: f64) -> String {
        match self.precision {
            Precision::Double => format!("{value:?}"),
            Precision::Float => format!("{:?}f", value as f32),
        }
    }

    fn unary(&self, function: Unary, x: &str) -> String {
        let name = match function {
            Unary::Neg => return format!("-({x})"),
            Unary::Sin => self.library("sin"),
            Unary::Cos => self.library("cos"),
            Unary::Tan => self.library("tan"),
            Unary::Asin => self.library("asin"),
            Unary::Acos => self.library("acos"),
            Unary::Atan => self.library("atan"),
            Unary::Sinh => self.library("sinh"),
            Unary::Cosh => self.library("cosh"),
            Unary::Tanh => self.library("tanh"),
            Unary::Exp => self.library("exp"),
            Unary::Log => self.library("log"),
            Unary::Sqrt => self.library("sqrt"),
            Unary::Abs => self.library("fabs"),
            Unary::Sign => format!("{}_sign_", self.prefix),
            Unary::Step => format!("{}_step_", self.prefix),
            Unary::Wrap => format!("{}_wrap_", self.prefix),
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
            Binary::Min => format!("{}_min_", self.prefix),
            Binary::Max => format!("{}_max_", self.prefix),
        };
        format!("{name}({a}, {b})")
    }

    fn table(&self, table: &str) -> String {
        format!("{}_{table}", self.prefix)
    }

    fn index_table(&self, table: &str, index: &str) -> String {
        format!("{}_{table}[{index}]", self.prefix)
    }

    fn condition(&self, condition: &Condition) -> String {
        match condition {
            Condition::Less(a, b) => format!("{} < {}", real(self, a), real(self, b)),
            Condition::AtLeast(a, b) => format!("{} >= {}", real(self, a), real(self, b)),
            Condition::Equal(a, b) => {
                let (a, b) = (real(self, a), real(self, b));
                format!("({a} <= {b}) && ({a} >= {b})")
            }
            Condition::Outside(value, low, high) => {
                let value = real(self, value);
                format!("!(({value} >= {}) && ({value} <= {}))", real(self, low), real(self, high))
            }
            Condition::NotFinite(value) => {
                let (value, largest) = (real(self, value), self.largest());
                format!("!(({value} >= -{largest}) && ({value} <= {largest}))")
            }
            Condition::Same(a, b) => format!("{} == {}", index(self, a), index(self, b)),
            Condition::Failed(code) => format!("{code} <= {}_NOT_FINITE", self.upper()),
        }
    }

    fn simple(&self, statement: &Statement) -> Vec<String> {
        let t = self.real();
        match statement {
            Statement::Comment(text) => vec![format!("/* {} */", crate::names::comment(text))],
            Statement::Let(name, value) => vec![format!("const {t} {name} = {};", real(self, value))],
            Statement::Variable(name, value) => vec![format!("{t} {name} = {};", real(self, value))],
            Statement::Array(name, length) => vec![format!("{t} {name}[{length}] = {{{}}};", self.number(0.0))],
            Statement::Set(to, value) => vec![format!("{} = {};", place(self, to), real(self, value))],
            Statement::Add(to, value) => vec![format!("{} += {};", place(self, to), real(self, value))],
            Statement::Counter(name, value) => vec![format!("size_t {name} = {};", index(self, value))],
            Statement::SetCounter(name, value) => vec![format!("{name} = {};", index(self, value))],
            Statement::Call { result, function, arguments: given } => {
                let given = arguments(self, given, &|name, _| name.to_owned());
                vec![format!("const int {result} = {}_{function}_({given});", self.prefix)]
            }
            Statement::Return(outcome) => vec![match outcome {
                Outcome::Region { region, outside: None } => format!("return (int)({});", index(self, region)),
                Outcome::Region { region, outside: Some(outside) } => {
                    let region = index(self, region);
                    format!("return ({outside} != 0) ? -1 - (int)({region}) : (int)({region});")
                }
                Outcome::NoRegion => format!("return {}_NO_REGION;", self.upper()),
                Outcome::NotFinite => format!("return {}_NOT_FINITE;", self.upper()),
                Outcome::Same(code) => format!("return {code};"),
            }],
            Statement::For { .. } | Statement::If(..) => Vec::new(),
        }
    }

    fn open_for(&self, index: &str, from: &str, to: &str) -> String {
        format!("for (size_t {index} = {from}; {index} < {to}; ++{index}) {{")
    }

    fn open_if(&self, condition: &str) -> String {
        format!("if ({condition}) {{")
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
