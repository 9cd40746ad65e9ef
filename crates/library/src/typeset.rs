//! Expressions as mathematics is set: one walk over the tree for all notations.

mod symbol;

pub(crate) use symbol::{Subscript, Symbol, greek_name, is_greek};

use crate::{Binary, Expr, Filter, Node, Unary};

/// A way to write mathematics: LaTeX, MathML.
pub(crate) trait Notation {
    /// Everything that does not depend on what is written.
    const FORMS: Forms;
    /// A number that is finite: its digits, and the exponent of ten where it has one.
    fn number(digits: &str, exponent: Option<i32>) -> String;
    /// NaN, and the infinities.
    fn not_finite(value: f64) -> String;
    /// A number as the digits and the exponent that are written.
    fn rounded(value: f64) -> f64;
    /// The name of a column.
    fn symbol(symbol: &Symbol<'_>) -> String;
    /// The name of a function, with the exponent that stands behind it.
    fn function(function: Unary, exponent: Option<i32>) -> String;
    /// The name of anything else that has arguments.
    fn named(name: &str) -> String;
}

/// Text before, between and behind arguments.
pub(crate) struct Forms {
    /// Around operands that bind too loosely, and around arguments.
    pub(crate) parentheses: [&'static str; 2],
    pub(crate) absolute: [&'static str; 2],
    pub(crate) root: [&'static str; 2],
    pub(crate) fraction: [&'static str; 3],
    pub(crate) power: [&'static str; 3],
    pub(crate) comma: &'static str,
    pub(crate) plus: &'static str,
    pub(crate) minus: &'static str,
    pub(crate) negative: &'static str,
    /// Between factors, and between factors the second of which begins with a digit.
    pub(crate) product: [&'static str; 2],
    pub(crate) minimum: &'static str,
    pub(crate) maximum: &'static str,
}

/// Binding strength of a form. An operand in a place that binds more tightly needs parentheses.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    /// Fractions and functions: factors of a product, but no bases of powers.
    Factor,
    Atom,
}

/// Pending item to write; the stack holds the last one first.
enum Job<'a> {
    Expr(&'a Expr, Binding),
    Text(&'static str),
    Owned(String),
}

/// An expression in a notation. Where a lag occurs, every column has its row.
pub(crate) fn typeset<N: Notation>(expr: &Expr) -> String {
    let discrete = expr.fold(|expr, below: &[bool]| match expr.node() {
        Node::Column { lag, .. } | Node::Time { lag } => *lag != 0,
        _ => below.contains(&true),
    });
    let mut out = String::new();
    let mut jobs = vec![Job::Expr(expr, Binding::Sum)];
    while let Some(job) = jobs.pop() {
        match job {
            Job::Text(text) => out.push_str(text),
            Job::Owned(text) => out.push_str(&text),
            Job::Expr(expr, least) if binding::<N>(expr) < least => {
                out.push_str(N::FORMS.parentheses[0]);
                jobs.extend([Job::Text(N::FORMS.parentheses[1]), Job::Expr(expr, Binding::Sum)]);
            }
            Job::Expr(expr, _) => write_node::<N>(expr, discrete, &mut jobs, &mut out),
        }
    }
    out
}

fn binding<N: Notation>(expr: &Expr) -> Binding {
    match expr.node() {
        Node::Number(value) if *value < 0.0 => Binding::Sum,
        Node::Number(value) if !value.is_finite() || decimal(N::rounded(*value)).1.is_some() => Binding::Product,
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
fn write_node<'a, N: Notation>(expr: &'a Expr, discrete: bool, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    match expr.node() {
        Node::Number(value) => out.push_str(&number::<N>(*value)),
        Node::Column { name, lag } => out.push_str(&column::<N>(name, *lag, discrete)),
        Node::Time { lag } => out.push_str(&N::symbol(&Symbol::new("t", discrete.then_some(*lag)))),
        Node::Unary(Unary::Neg, x) => {
            out.push_str(N::FORMS.negative);
            jobs.push(Job::Expr(x, Binding::Product));
        }
        Node::Unary(Unary::Abs, x) => enclosed(N::FORMS.absolute, x, jobs, out),
        Node::Unary(Unary::Sqrt, x) => enclosed(N::FORMS.root, x, jobs, out),
        Node::Unary(function, x) => {
            out.push_str(&N::function(*function, None));
            enclosed(N::FORMS.parentheses, x, jobs, out);
        }
        Node::Power(base, k) => write_power::<N>(base, *k, jobs, out),
        Node::Binary(function, a, b) => write_binary::<N>(*function, a, b, jobs, out),
    }
}

fn enclosed<'a>([open, close]: [&'static str; 2], x: &'a Expr, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    out.push_str(open);
    jobs.extend([Job::Text(close), Job::Expr(x, Binding::Sum)]);
}

/// The exponent of a function with a name stands behind the name.
fn write_power<'a, N: Notation>(base: &'a Expr, k: i32, jobs: &mut Vec<Job<'a>>, out: &mut String) {
    let named = |function: &Unary| !matches!(function, Unary::Neg | Unary::Abs | Unary::Sqrt);
    let [open, between, close] = N::FORMS.power;
    match base.node() {
        Node::Unary(function, x) if k > 0 && named(function) => {
            out.push_str(&N::function(*function, Some(k)));
            enclosed(N::FORMS.parentheses, x, jobs, out);
        }
        _ => {
            out.push_str(open);
            let exponent = number::<N>(f64::from(k));
            jobs.extend([Job::Text(close), Job::Owned(exponent), Job::Text(between), Job::Expr(base, Binding::Atom)]);
        }
    }
}

fn write_binary<'a, N: Notation>(
    function: Binary,
    a: &'a Expr,
    b: &'a Expr,
    jobs: &mut Vec<Job<'a>>,
    out: &mut String,
) {
    let forms = N::FORMS;
    match function {
        Binary::Add | Binary::Sub => {
            let sign = if function == Binary::Add { forms.plus } else { forms.minus };
            jobs.extend([Job::Expr(b, Binding::Product), Job::Text(sign), Job::Expr(a, Binding::Sum)]);
        }
        Binary::Mul => {
            // Two numbers side by side would read as one.
            let sign = forms.product[usize::from(starts_with_digit(b))];
            jobs.extend([Job::Expr(b, Binding::Product), Job::Text(sign), Job::Expr(a, Binding::Product)]);
        }
        Binary::Div => pair(forms.fraction, (a, Binding::Sum), b, jobs, out),
        Binary::Pow => pair(forms.power, (a, Binding::Atom), b, jobs, out),
        Binary::Atan2 | Binary::Min | Binary::Max => {
            match function {
                Binary::Min => out.push_str(forms.minimum),
                Binary::Max => out.push_str(forms.maximum),
                _ => out.push_str(&N::named("atan2")),
            }
            let [open, close] = forms.parentheses;
            pair([open, forms.comma, close], (a, Binding::Sum), b, jobs, out);
        }
    }
}

fn pair<'a>(
    [open, between, close]: [&'static str; 3],
    (a, binding): (&'a Expr, Binding),
    b: &'a Expr,
    jobs: &mut Vec<Job<'a>>,
    out: &mut String,
) {
    out.push_str(open);
    jobs.extend([Job::Text(close), Job::Expr(b, Binding::Sum), Job::Text(between), Job::Expr(a, binding)]);
}

/// Returns true if the first character written of a factor is a digit.
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

/// A column, or the filter that it is the output of.
fn column<N: Notation>(name: &str, lag: i32, discrete: bool) -> String {
    let Some(filter) = Filter::of(name) else {
        return N::symbol(&Symbol::new(name, discrete.then_some(lag)));
    };
    let [open, close] = N::FORMS.parentheses;
    let (input, constant) = (typeset::<N>(&filter.input.shifted(lag)), typeset::<N>(&filter.constant));
    format!("{}{open}{input}{}{constant}{close}", N::named(filter.kind.name()), N::FORMS.comma)
}

fn number<N: Notation>(value: f64) -> String {
    if !value.is_finite() {
        return N::not_finite(value);
    }
    let (digits, exponent) = decimal(N::rounded(value));
    N::number(&digits, exponent)
}

/// The fewest digits that read back exactly; very large and very small numbers have an exponent of ten.
fn decimal(value: f64) -> (String, Option<i32>) {
    let text = format!("{value:?}");
    let (digits, exponent) = match text.split_once('e') {
        Some((digits, exponent)) => (digits, exponent.parse().ok()),
        None => (text.as_str(), None),
    };
    (digits.strip_suffix(".0").unwrap_or(digits).to_owned(), exponent)
}
