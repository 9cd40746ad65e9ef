//! Printing: text that reads back to an equal expression.

use std::fmt::{self, Display, Formatter};

use crate::{Binary, Expr, Node, Unary, parse::is_bare_name};

/// Binding strength of a printed form, with the parser's order. An operand in a place that binds more tightly needs
/// parentheses.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    Sign,
    Power,
    Atom,
}

/// Pending item to print; the stack holds the last one first.
enum Job<'a> {
    Expr(&'a Expr, Binding),
    Text(&'static str),
    Divide,
    Exponent(i32),
}

impl Display for Expr {
    /// In the grammar of [`Expr::parse`], with as few parentheses as the operators need. A lagged column is `lag(x, 2)` or
    /// `lead(x, 2)`, and names that are not plain stand in backticks. Numbers have the fewest digits that read back exactly.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut jobs = vec![Job::Expr(self, Binding::Sum)];
        // A topic field takes a slash that touches it as its own.
        let mut after_topic = false;
        while let Some(job) = jobs.pop() {
            match job {
                Job::Text(text) => f.write_str(text)?,
                Job::Divide => f.write_str(if after_topic { " / " } else { "/" })?,
                Job::Exponent(exponent) => write!(f, "^{exponent}")?,
                Job::Expr(expr, least) if binding(expr) < least => {
                    f.write_str("(")?;
                    jobs.push(Job::Text(")"));
                    jobs.push(Job::Expr(expr, Binding::Sum));
                }
                Job::Expr(expr, _) => {
                    after_topic = print_node(expr.node(), &mut jobs, f)?;
                    continue;
                }
            }
            after_topic = false;
        }
        Ok(())
    }
}

/// Prints up to the first argument and queues the rest; whether a bare topic field was the last thing printed.
fn print_node<'a>(node: &'a Node, jobs: &mut Vec<Job<'a>>, f: &mut Formatter<'_>) -> Result<bool, fmt::Error> {
    match node {
        Node::Number(value) => print_number(*value, f)?,
        Node::Column { name, lag } => {
            print_lagged(*lag, f, |f| print_name(name, f))?;
            return Ok(*lag == 0 && name.starts_with('/') && is_bare_name(name));
        }
        Node::Time { lag } => print_lagged(*lag, f, |f| f.write_str("time()"))?,
        Node::Unary(Unary::Neg, x) => {
            f.write_str("-")?;
            jobs.push(Job::Expr(x, Binding::Sign));
        }
        Node::Unary(function, x) => {
            write!(f, "{}(", function.name())?;
            jobs.extend([Job::Text(")"), Job::Expr(x, Binding::Sum)]);
        }
        Node::Power(x, k) => {
            jobs.extend([Job::Exponent(*k), Job::Expr(x, Binding::Atom)]);
        }
        Node::Binary(function, a, b) => {
            let (operator, left, right) = match function {
                Binary::Add => (Job::Text(" + "), Binding::Sum, Binding::Product),
                Binary::Sub => (Job::Text(" - "), Binding::Sum, Binding::Product),
                Binary::Mul => (Job::Text("*"), Binding::Product, Binding::Sign),
                Binary::Div => (Job::Divide, Binding::Product, Binding::Sign),
                Binary::Pow => (Job::Text("^"), Binding::Atom, Binding::Sign),
                Binary::Atan2 | Binary::Min | Binary::Max => {
                    write!(f, "{}(", function.name())?;
                    jobs.push(Job::Text(")"));
                    (Job::Text(", "), Binding::Sum, Binding::Sum)
                }
            };
            jobs.extend([Job::Expr(b, right), operator, Job::Expr(a, left)]);
        }
    }
    Ok(false)
}

fn binding(expr: &Expr) -> Binding {
    match expr.node() {
        Node::Number(value) if value.is_sign_negative() => Binding::Sign,
        Node::Number(_) | Node::Column { .. } | Node::Time { .. } => Binding::Atom,
        Node::Unary(Unary::Neg, _) => Binding::Sign,
        Node::Unary(..) => Binding::Atom,
        Node::Power(..) => Binding::Power,
        Node::Binary(function, ..) => match function {
            Binary::Add | Binary::Sub => Binding::Sum,
            Binary::Mul | Binary::Div => Binding::Product,
            Binary::Pow => Binding::Power,
            Binary::Atan2 | Binary::Min | Binary::Max => Binding::Atom,
        },
    }
}

/// The fewest digits that read back exactly, with an exponent where that is shorter.
fn print_number(value: f64, f: &mut Formatter<'_>) -> fmt::Result {
    if value.is_nan() {
        return f.write_str("nan");
    }
    let text = format!("{value:?}");
    f.write_str(text.strip_suffix(".0").unwrap_or(&text))
}

fn print_lagged(lag: i32, f: &mut Formatter<'_>, leaf: impl FnOnce(&mut Formatter<'_>) -> fmt::Result) -> fmt::Result {
    if lag != 0 {
        f.write_str(if lag > 0 { "lag(" } else { "lead(" })?;
    }
    leaf(f)?;
    if lag != 0 { write!(f, ", {})", lag.unsigned_abs()) } else { Ok(()) }
}

fn print_name(name: &str, f: &mut Formatter<'_>) -> fmt::Result {
    // In a library's item the bare name of a function is a library.
    let plain = is_bare_name(name) && name != "identity" && Unary::ALL.iter().all(|function| function.name() != name);
    if plain { f.write_str(name) } else { write!(f, "`{}`", name.replace('`', "``")) }
}
