//! Printing code: the common part of the languages, and the syntax of each.

use fleetfoot_library::{Binary, Unary};

use crate::code::{Argument, Condition, Index, Place, Real, Statement, TABLE, Variable};

/// Syntax of a language.
pub(crate) trait Syntax {
    /// A real number.
    fn number(&self, value: f64) -> String;
    /// A function of one argument other than the sign.
    fn unary(&self, function: Unary, x: &str) -> String;
    /// A function of two arguments that has no operator.
    fn binary(&self, function: Binary, a: &str, b: &str) -> String;
    /// The name of a table.
    fn table(&self, table: &str) -> String;
    /// An element of a table of indices.
    fn index_table(&self, table: &str, index: &str) -> String;
    fn condition(&self, condition: &Condition) -> String;
    /// One statement without blocks.
    fn simple(&self, statement: &Statement) -> Vec<String>;
    fn open_for(&self, index: &str, from: &str, to: &str) -> String;
    fn open_if(&self, condition: &str) -> String;
    fn open_else(&self) -> &'static str;
    /// End of a block, if the language has one.
    fn close(&self) -> Option<&'static str>;
    /// Returns true if a line may go on in the next one.
    fn breakable(&self, line: &str) -> bool;
}

/// Precedence of an expression.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    Sign,
    Atom,
}

/// A real expression with as few parentheses as its operators need.
pub(crate) fn real(syntax: &dyn Syntax, value: &Real) -> String {
    bound(syntax, value).0
}

fn bound(syntax: &dyn Syntax, value: &Real) -> (String, Binding) {
    let within = |value: &Real, least: Binding| {
        let (text, binding) = bound(syntax, value);
        if binding < least { format!("({text})") } else { text }
    };
    match value {
        Real::Number(value) if value.is_sign_negative() && !value.is_nan() => (syntax.number(*value), Binding::Sign),
        Real::Number(value) => (syntax.number(*value), Binding::Atom),
        Real::Local(name) => (name.clone(), Binding::Atom),
        Real::At(name, at) => (format!("{}[{}]", array(syntax, name), index(syntax, at)), Binding::Atom),
        Real::Unary(Unary::Neg, x) => (format!("-{}", within(x, Binding::Atom)), Binding::Sign),
        Real::Unary(function, x) => (syntax.unary(*function, &real(syntax, x)), Binding::Atom),
        Real::Binary(function, a, b) => {
            let (operator, left, right, precedence) = match function {
                Binary::Add => ("+", Binding::Sum, Binding::Product, Binding::Sum),
                Binary::Sub => ("-", Binding::Sum, Binding::Product, Binding::Sum),
                Binary::Mul => ("*", Binding::Product, Binding::Atom, Binding::Product),
                Binary::Div => ("/", Binding::Product, Binding::Atom, Binding::Product),
                Binary::Pow | Binary::Atan2 | Binary::Min | Binary::Max => {
                    return (syntax.binary(*function, &real(syntax, a), &real(syntax, b)), Binding::Atom);
                }
            };
            // A sign behind an operator stands in parentheses: `a - (-b)`.
            let right = if matches!(function, Binary::Add | Binary::Sub) && sign(b) { Binding::Atom } else { right };
            (format!("{} {operator} {}", within(a, left), within(b, right)), precedence)
        }
        Real::Sum(terms) => (sum(syntax, terms), if terms.len() > 1 { Binding::Sum } else { Binding::Product }),
    }
}

/// The name of an array: a table, a parameter or a local.
fn array(syntax: &dyn Syntax, name: &str) -> String {
    name.strip_prefix(TABLE).map_or_else(|| name.to_owned(), |table| syntax.table(table))
}

/// Returns true if the text begins with a sign.
fn sign(value: &Real) -> bool {
    match value {
        Real::Number(value) => value.is_sign_negative(),
        Real::Unary(Unary::Neg, _) => true,
        Real::Binary(Binary::Mul | Binary::Div, a, _) => sign(a),
        _ => false,
    }
}

/// `a + b - c`: a product with a negative number is subtracted, which rounds the same.
fn sum(syntax: &dyn Syntax, terms: &[Real]) -> String {
    let mut text = String::new();
    for term in terms {
        let (negative, term) = match term {
            Real::Number(value) if *value < 0.0 => (true, Real::Number(-value)),
            Real::Binary(Binary::Mul, a, b) => match **a {
                Real::Number(value) if value < 0.0 => (true, Real::Number(-value).times((**b).clone())),
                _ => (false, term.clone()),
            },
            _ => (false, term.clone()),
        };
        let (body, binding) = bound(syntax, &term);
        let body = if binding < Binding::Product { format!("({body})") } else { body };
        text += match (text.is_empty(), negative) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        text += &body;
    }
    text
}

/// An index expression.
pub(crate) fn index(syntax: &dyn Syntax, value: &Index) -> String {
    let mut parts: Vec<String> = value
        .terms
        .iter()
        .map(|(factor, variable)| {
            let name = match variable {
                Variable::Local(name) => name.clone(),
                Variable::Table(name, at) => {
                    syntax.index_table(name.strip_prefix(TABLE).unwrap_or(name), &index(syntax, at))
                }
            };
            if *factor == 1 { name } else { format!("{factor} * {name}") }
        })
        .collect();
    if value.constant > 0 || parts.is_empty() {
        parts.push(value.constant.to_string());
    }
    parts.join(" + ")
}

/// Statements, each line behind `depth` indents of four spaces.
pub(crate) fn block(syntax: &dyn Syntax, statements: &[Statement], depth: usize, out: &mut String) {
    let mut line = |depth: usize, text: &str| {
        wrapped(&" ".repeat(4 * depth), text, syntax.breakable(text), out);
    };
    for statement in statements {
        match statement {
            Statement::For { index: name, from, to, body, .. } => {
                line(depth, &syntax.open_for(name, &index(syntax, from), &index(syntax, to)));
                block_of(syntax, body, depth + 1, &mut line);
                if let Some(end) = syntax.close() {
                    line(depth, end);
                }
            }
            Statement::If(condition, then, otherwise) => {
                line(depth, &syntax.open_if(&syntax.condition(condition)));
                block_of(syntax, then, depth + 1, &mut line);
                if !otherwise.is_empty() {
                    line(depth, syntax.open_else());
                    block_of(syntax, otherwise, depth + 1, &mut line);
                }
                if let Some(end) = syntax.close() {
                    line(depth, end);
                }
            }
            other => {
                for text in syntax.simple(other) {
                    line(depth, &text);
                }
            }
        }
    }
}

fn block_of(syntax: &dyn Syntax, statements: &[Statement], depth: usize, line: &mut dyn FnMut(usize, &str)) {
    let mut text = String::new();
    block(syntax, statements, 0, &mut text);
    for inner in text.lines() {
        line(depth, inner);
    }
}

/// Longest line, if blanks allow.
const WIDTH: usize = 118;

/// A line, broken in front of operators where it is long.
fn wrapped(indent: &str, text: &str, breakable: bool, out: &mut String) {
    out.push_str(indent);
    let mut length = indent.len();
    let inner = format!("{indent}    {}", " ".repeat(text.len() - text.trim_start().len()));
    let mut words = text.split_inclusive(' ').peekable();
    while let Some(word) = words.next() {
        let operator = matches!(word.trim(), "+" | "-");
        if breakable && operator && length > WIDTH / 2 && length + next_term(&mut words.clone()) > WIDTH {
            while out.ends_with(' ') {
                out.pop();
            }
            out.push('\n');
            out.push_str(&inner);
            length = inner.len();
        }
        out.push_str(word);
        length += word.len();
    }
    out.push('\n');
}

/// Length up to the operator after the next one.
fn next_term<'a>(words: &mut impl Iterator<Item = &'a str>) -> usize {
    words.take_while(|word| !matches!(word.trim(), "+" | "-")).map(str::len).sum::<usize>() + 2
}

/// The name under which a place is assigned.
pub(crate) fn place(syntax: &dyn Syntax, place: &Place) -> String {
    match place {
        Place::Local(name) => name.clone(),
        Place::At(name, at) => format!("{name}[{}]", index(syntax, at)),
    }
}

/// Arguments of a call; `borrow` writes an array.
pub(crate) fn arguments(syntax: &dyn Syntax, arguments: &[Argument], borrow: &dyn Fn(&str, bool) -> String) -> String {
    let texts: Vec<String> = arguments
        .iter()
        .map(|argument| match argument {
            Argument::In(name) => borrow(name, false),
            Argument::Out(name) => borrow(name, true),
            Argument::Value(value) => real(syntax, value),
        })
        .collect();
    texts.join(", ")
}
