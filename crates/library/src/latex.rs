//! Expressions as LaTeX mathematics.

mod name;

use std::fmt::Write;

use crate::{Binary, Expr, Filter, Node, Unary};

/// How tightly a form binds; an operand in a tighter place needs parentheses.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    /// Fractions and functions: factors of a product, but no bases of powers.
    Factor,
    Atom,
}

/// What is left to write, last first.
enum Job<'a> {
    Expr(&'a Expr, Binding),
    Text(&'static str),
    Owned(String),
}

impl Expr {
    /// The expression in LaTeX's mathematical mode: quotients as fractions, `vx_1` as an upright vx with the subscript 1, Greek
    /// letters by their names, columns of a recording in discrete time as `x_{k-1}` (where a lag occurs, every column has its `k`).
    pub fn to_latex(&self) -> String {
        let discrete = self.fold(|expr, below: &[bool]| match expr.node() {
            Node::Column { lag, .. } | Node::Time { lag } => *lag != 0,
            _ => below.contains(&true),
        });
        let mut out = String::new();
        let mut jobs = vec![Job::Expr(self, Binding::Sum)];
        while let Some(job) = jobs.pop() {
            match job {
                Job::Text(text) => out.push_str(text),
                Job::Owned(text) => out.push_str(&text),
                Job::Expr(expr, least) if binding(expr) < least => {
                    out.push_str("\\left(");
                    jobs.extend([Job::Text("\\right)"), Job::Expr(expr, Binding::Sum)]);
                }
                Job::Expr(expr, _) => write_node(expr, discrete, &mut jobs, &mut out),
            }
        }
        out
    }
}

fn binding(expr: &Expr) -> Binding {
    match expr.node() {
        Node::Number(value) if *value < 0.0 => Binding::Sum,
        Node::Number(value) if number(*value).contains('\\') => Binding::Product,
        Node::Number(_) | Node::Column { .. } | Node::Time { .. } => Binding::Atom,
        Node::Unary(Unary::Neg, _) => Binding::Sum,
        Node::Unary(Unary::Abs | Unary::Sqrt, _) => Binding::Atom,
        Node::Unary(..) | Node::Power(..) => Binding::Factor,
        Node::Binary(Binary::Add | Binary::Sub, ..) => Binding::Sum,
        Node::Binary(Binary::Mul, ..) => Binding::Product,
        Node::Binary(..) => Binding::Factor,
    }
}

/// Writes up to the first argument and queues the rest.
fn write_node<'a>(expr: &'a Expr, discrete: bool, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    match expr.node() {
        Node::Number(value) => out.push_str(&number(*value)),
        Node::Column { name, lag } => out.push_str(&column(name, *lag, discrete)),
        Node::Time { lag } => out.push_str(&name::symbol("t", discrete.then_some(*lag))),
        Node::Unary(Unary::Neg, x) => {
            out.push('-');
            jobs.push(Job::Expr(x, Binding::Product));
        }
        Node::Unary(Unary::Abs, x) => {
            out.push_str("\\left|");
            jobs.extend([Job::Text("\\right|"), Job::Expr(x, Binding::Sum)]);
        }
        Node::Unary(Unary::Sqrt, x) => {
            out.push_str("\\sqrt{");
            jobs.extend([Job::Text("}"), Job::Expr(x, Binding::Sum)]);
        }
        Node::Unary(function, x) => {
            out.push_str(function_name(*function));
            jobs.extend([Job::Text("\\right)"), Job::Expr(x, Binding::Sum), Job::Text("\\left(")]);
        }
        Node::Power(base, k) => write_power(base, *k, jobs, out),
        Node::Binary(function, a, b) => write_binary(*function, a, b, jobs, out),
    }
}

/// The exponent of a function with a name stands behind the name.
fn write_power<'a>(base: &'a Expr, k: i32, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    let named = |function: &Unary| !matches!(function, Unary::Neg | Unary::Abs | Unary::Sqrt);
    match base.node() {
        Node::Unary(function, x) if k > 0 && named(function) => {
            let _ = write!(out, "{}^{{{k}}}", function_name(*function));
            jobs.extend([Job::Text("\\right)"), Job::Expr(x, Binding::Sum), Job::Text("\\left(")]);
        }
        _ => jobs.extend([Job::Owned(format!("^{{{k}}}")), Job::Expr(base, Binding::Atom)]),
    }
}

fn write_binary<'a>(function: Binary, a: &'a Expr, b: &'a Expr, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    match function {
        Binary::Add | Binary::Sub => {
            let sign = if function == Binary::Add { " + " } else { " - " };
            jobs.extend([Job::Expr(b, Binding::Product), Job::Text(sign), Job::Expr(a, Binding::Sum)]);
        }
        Binary::Mul => {
            // Two numbers side by side would read as one.
            let dot = starts_with_digit(b);
            let sign = if dot { " \\cdot " } else { " \\, " };
            jobs.extend([Job::Expr(b, Binding::Product), Job::Text(sign), Job::Expr(a, Binding::Product)]);
        }
        Binary::Div => {
            out.push_str("\\frac{");
            jobs.extend([Job::Text("}"), Job::Expr(b, Binding::Sum), Job::Text("}{"), Job::Expr(a, Binding::Sum)]);
        }
        Binary::Pow => {
            jobs.extend([Job::Text("}"), Job::Expr(b, Binding::Sum), Job::Text("^{"), Job::Expr(a, Binding::Atom)])
        }
        Binary::Atan2 | Binary::Min | Binary::Max => {
            out.push_str(match function {
                Binary::Min => "\\min",
                Binary::Max => "\\max",
                _ => "\\operatorname{atan2}",
            });
            jobs.extend([
                Job::Text("\\right)"),
                Job::Expr(b, Binding::Sum),
                Job::Text(", "),
                Job::Expr(a, Binding::Sum),
                Job::Text("\\left("),
            ]);
        }
    }
}

/// Whether the first thing written of a factor is a digit.
fn starts_with_digit(expr: &Expr) -> bool {
    let mut expr = expr;
    loop {
        match expr.node() {
            // A negative number stands in parentheses.
            Node::Number(value) => return value.is_finite() && *value >= 0.0,
            Node::Binary(Binary::Mul | Binary::Pow, a, _) | Node::Power(a, _) => expr = a,
            _ => return false,
        }
    }
}

fn function_name(function: Unary) -> &'static str {
    match function {
        Unary::Neg => "-",
        Unary::Sin => "\\sin",
        Unary::Cos => "\\cos",
        Unary::Tan => "\\tan",
        Unary::Asin => "\\arcsin",
        Unary::Acos => "\\arccos",
        Unary::Atan => "\\arctan",
        Unary::Sinh => "\\sinh",
        Unary::Cosh => "\\cosh",
        Unary::Tanh => "\\tanh",
        Unary::Exp => "\\exp",
        Unary::Log => "\\ln",
        Unary::Sqrt => "\\sqrt",
        Unary::Abs => "\\operatorname{abs}",
        Unary::Sign => "\\operatorname{sgn}",
        Unary::Step => "\\operatorname{step}",
        Unary::Wrap => "\\operatorname{wrap}",
    }
}

/// A column, or the filter that it is the output of.
fn column(name: &str, lag: i32, discrete: bool) -> String {
    match Filter::of(name) {
        Some(filter) => {
            let (kind, shifted) = (filter.kind.name().replace('_', "\\_"), filter.input.shifted(lag));
            format!("\\operatorname{{{kind}}}\\left({}, {}\\right)", shifted.to_latex(), filter.constant.to_latex())
        }
        None => name::symbol(name, discrete.then_some(lag)),
    }
}

/// The fewest digits that read back exactly; very large and very small ones with a power of ten.
fn number(value: f64) -> String {
    if value.is_nan() {
        return "\\mathrm{NaN}".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { "\\infty".to_owned() } else { "-\\infty".to_owned() };
    }
    let text = format!("{value:?}");
    match text.split_once('e') {
        Some((digits, exponent)) => format!("{} \\cdot 10^{{{exponent}}}", digits.strip_suffix(".0").unwrap_or(digits)),
        None => text.strip_suffix(".0").unwrap_or(&text).to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use crate::{Expr, Scope};

    #[test]
    fn expressions_read_as_in_a_book() {
        for (text, wanted) in [
            ("x", "x"),
            ("vx_1", "\\mathrm{vx}_{1}"),
            ("m1", "m_{1}"),
            ("alpha", "\\alpha"),
            ("omega_motor", "\\omega_{\\mathrm{motor}}"),
            ("q.x", "q_{x}"),
            ("u[2]", "u_{2}"),
            ("/odom.twist", "\\mathrm{/odom}_{\\mathrm{twist}}"),
            ("`a&b%c`", "\\mathrm{a\\&b\\%c}"),
            ("x^2*y", "x^{2} \\, y"),
            ("2*x", "2 \\, x"),
            ("2*3^x", "2 \\cdot 3^{x}"),
            ("-x + y - (z - 1)", "-x + y - \\left(z - 1\\right)"),
            ("x*(y + 1)", "x \\, \\left(y + 1\\right)"),
            ("x*-2", "x \\, \\left(-2\\right)"),
            ("(x + 1)/(2*y)", "\\frac{x + 1}{2 \\, y}"),
            ("(x/y)^2", "\\left(\\frac{x}{y}\\right)^{2}"),
            ("(x^2)^y", "\\left(x^{2}\\right)^{y}"),
            ("sin(x)^2", "\\sin^{2}\\left(x\\right)"),
            ("sin(x)^-1", "\\left(\\sin\\left(x\\right)\\right)^{-1}"),
            ("sqrt(abs(x - y))", "\\sqrt{\\left|x - y\\right|}"),
            ("abs(x)^3", "\\left|x\\right|^{3}"),
            ("sign(x)*tanh(y)", "\\operatorname{sgn}\\left(x\\right) \\, \\tanh\\left(y\\right)"),
            ("max(x, 0)", "\\max\\left(x, 0\\right)"),
            ("1e-9*x", "1 \\cdot 10^{-9} \\, x"),
            ("lag(x, 1) + x", "x_{k-1} + x_{k}"),
            ("lead(m1, 2)", "m_{1,k+2}"),
            ("lag1(m1, tau)^2", "\\operatorname{lag1}\\left(m_{1}, \\tau\\right)^{2}"),
            ("time()", "t"),
        ] {
            let expr = Expr::parse(text, &Scope::open()).unwrap();
            assert_eq!(expr.to_latex(), wanted, "{text}");
        }
    }
}
