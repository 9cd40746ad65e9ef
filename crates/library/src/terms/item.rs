//! Items of a library: sums and products of libraries and expressions.
//!
//! ```text
//! sum     = product { ("+" | "-") product }      differences of expressions only
//! product = factor { ("*" | "/") factor }        quotients by expressions only
//! factor  = "-" factor | "(" sum ")" | library | expression
//! library = ("poly" | "interactions" | "fourier" | "past" | "lags") "(" number { "," option } [ "," of ] ")"
//!         | (function | "identity") [ "(" of ")" ]
//! of      = sum | "[" sum { "," sum } "]"
//! option  = "bias" "=" ("true" | "false") | "every" "=" number
//! ```

use super::{
    Vocabulary,
    candidates::{Candidates, Workshop},
};
use crate::{
    Binary, Expr, ParseError, ParseErrorKind, Unary,
    limits::{MAX_DEPTH, MAX_SIZE, MAX_TEXT},
    parse::{Parser, Power, function_names, identifier_length, named_unary},
};

/// Libraries that are called with a number.
const NUMBERED: [&str; 5] = ["poly", "interactions", "fourier", "past", "lags"];
/// The largest degree.
const MAX_DEGREE: u32 = 255;
/// The largest number of frequencies, and of rows back.
const MAX_COUNT: u32 = 1_000_000;

const NOT_JOINED: &str = "`+`, `*` or the end: libraries have no differences, powers or quotients by them; an expression with these \
                          beside a library stands in parentheses";

/// Reads one item of a library.
pub(super) fn parse_item(
    text: &str,
    vocabulary: &Vocabulary,
    workshop: &mut Workshop,
) -> Result<Candidates, ParseError> {
    let parser = Parser::new(text, vocabulary.scope);
    if text.len() > MAX_TEXT {
        return Err(parser.error(0, ParseErrorKind::TooLarge));
    }
    let mut items = Items { parser, variables: vocabulary.variables, workshop };
    let value = items.sum().map_err(|error| error.with_names(&library_names()))?;
    if items.parser.peek().is_some() {
        return Err(items.parser.expected("an operator or the end"));
    }
    items.candidates(value, 0)
}

/// Value of a part of an item.
enum Value {
    Expression(Expr),
    Library(Candidates),
}

struct Items<'a, 'w> {
    parser: Parser<'a>,
    variables: &'a [Expr],
    workshop: &'w mut Workshop,
}

impl Items<'_, '_> {
    /// Products joined by signs: one expression if there is no library among them, else all their functions.
    fn sum(&mut self) -> Result<Value, ParseError> {
        let depth = self.parser.depth;
        if depth >= MAX_DEPTH {
            return Err(self.parser.error(self.parser.at, ParseErrorKind::TooDeep));
        }
        self.parser.depth += 1;
        let start = self.parser.start();
        let mut terms = vec![(Binary::Add, start, self.product()?)];
        while let Some((sign, length, _)) = self.parser.operator(Power::Any) {
            let at = self.parser.at;
            if !matches!(sign, Binary::Add | Binary::Sub) {
                return Err(self.parser.expected(NOT_JOINED));
            }
            self.parser.at += length;
            terms.push((sign, at, self.product()?));
        }
        self.parser.depth = depth;
        if terms.iter().any(|(.., value)| matches!(value, Value::Library(_))) {
            return self.union(terms);
        }
        let mut sum: Option<Expr> = None;
        for (sign, at, value) in terms {
            if let Value::Expression(term) = value {
                sum = Some(match sum {
                    None => term,
                    Some(sum) => self.joined(sign, sum, term, at)?,
                });
            }
        }
        sum.map_or_else(|| unreachable!("a sum has a first term"), |sum| Ok(Value::Expression(sum)))
    }

    fn union(&mut self, terms: Vec<(Binary, usize, Value)>) -> Result<Value, ParseError> {
        let mut all = Candidates::default();
        for (sign, at, value) in terms {
            if sign == Binary::Sub {
                self.parser.at = at;
                return Err(self.parser.expected(NOT_JOINED));
            }
            all.append(self.candidates(value, at)?);
        }
        Ok(Value::Library(all))
    }

    /// Factors, multiplied and divided from the left.
    fn product(&mut self) -> Result<Value, ParseError> {
        let mut product = self.factor(Power::Product)?;
        while let Some((operator, length, _)) = self.parser.operator(Power::Sum) {
            let at = self.parser.at;
            if operator == Binary::Pow {
                return Err(self.parser.expected(NOT_JOINED));
            }
            self.parser.at += length;
            let start = self.parser.start();
            product = match (product, self.factor(Power::Product)?) {
                (Value::Expression(a), Value::Expression(b)) => Value::Expression(self.joined(operator, a, b, at)?),
                (_, Value::Library(_)) if operator == Binary::Div => {
                    self.parser.at = at;
                    return Err(self.parser.expected(NOT_JOINED));
                }
                (a, b) => {
                    let (a, b) = (self.candidates(a, at)?, self.candidates(b, start)?);
                    let exponent = if operator == Binary::Div { -1 } else { 1 };
                    let product = self.workshop.product(&a, &b, exponent);
                    Value::Library(product.map_err(|kind| self.parser.error(at, kind))?)
                }
            };
        }
        Ok(product)
    }

    /// A library, or an expression up to the next operator that `outer` leaves to the caller.
    fn factor(&mut self, outer: Power) -> Result<Value, ParseError> {
        let start = self.parser.start();
        let value = match self.parser.peek() {
            Some('(') => {
                self.parser.at += 1;
                let inner = self.sum()?;
                self.parser.expect(")", "an operator or `)`")?;
                inner
            }
            Some(sign @ ('-' | '+')) => return self.signed(sign, outer),
            Some(c) if c.is_alphabetic() => {
                let name = self.parser.name("a library, a number, a column, a function or `(`")?;
                let called = self.parser.peek() == Some('(');
                match named_unary(&name) {
                    _ if NUMBERED.contains(&name.as_str()) && called => self.numbered(&name)?,
                    Some(function) => self.unary(function, called)?,
                    None if name == "identity" => {
                        let of = if called { self.of_parentheses()? } else { self.default_variables(false, start)? };
                        Value::Library(of)
                    }
                    None => {
                        self.parser.at = start;
                        return self.parser.expression(outer).map(Value::Expression);
                    }
                }
            }
            _ => return self.parser.expression(outer).map(Value::Expression),
        };
        match value {
            Value::Expression(expr) => self.parser.operators(expr, outer).map(Value::Expression),
            library => Ok(library),
        }
    }

    fn signed(&mut self, sign: char, outer: Power) -> Result<Value, ParseError> {
        let start = self.parser.at;
        self.parser.at += 1;
        if self.parser.depth >= MAX_DEPTH {
            return Err(self.parser.error(start, ParseErrorKind::TooDeep));
        }
        self.parser.depth += 1;
        let value = self.factor(Power::Sign)?;
        self.parser.depth -= 1;
        match value {
            Value::Expression(x) => {
                let signed = if sign == '-' { -x } else { x };
                self.parser.operators(signed, outer).map(Value::Expression)
            }
            Value::Library(_) => {
                self.parser.at = start;
                Err(self.parser.expected("a library without a sign, as its coefficients have theirs"))
            }
        }
    }

    /// `sin`, of every variable; `sin([x, y])` and `sin(library)`; `sin(x)`, an expression.
    fn unary(&mut self, function: Unary, called: bool) -> Result<Value, ParseError> {
        let start = self.parser.at;
        let of = if called {
            self.parser.at += 1;
            if self.parser.peek() != Some('[') {
                return match self.sum()? {
                    Value::Expression(x) if self.parser.peek() == Some(')') => {
                        self.parser.at += 1;
                        Ok(Value::Expression(Expr::unary(function, x)))
                    }
                    Value::Expression(_) => {
                        // The expression's parser says what is wrong.
                        self.parser.at = start + 1;
                        self.parser.call(function.name(), start - function.name().len()).map(Value::Expression)
                    }
                    Value::Library(of) => {
                        self.parser.expect(")", "`+`, `*` or `)`")?;
                        self.mapped(function, &of, start)
                    }
                };
            }
            self.parser.at = start;
            self.of_parentheses()?
        } else {
            let trigonometric = matches!(function, Unary::Sin | Unary::Cos | Unary::Tan);
            self.default_variables(trigonometric, start)?
        };
        self.mapped(function, &of, start)
    }

    fn mapped(&mut self, function: Unary, of: &Candidates, at: usize) -> Result<Value, ParseError> {
        let mapped = self.workshop.map(|x| Expr::unary(function, x.clone()), of);
        mapped.map(Value::Library).map_err(|kind| self.parser.error(at, kind))
    }

    /// A library that is called with a number; its name is read.
    fn numbered(&mut self, name: &str) -> Result<Value, ParseError> {
        let start = self.parser.start();
        self.parser.at += 1;
        let number = match name {
            "poly" | "interactions" => self.whole(0, MAX_DEGREE, "a degree, a whole number from 0 to 255")?,
            "fourier" => self.whole(1, MAX_COUNT, "a number of frequencies, a whole number from 1")?,
            _ => self.whole(1, MAX_COUNT, "a number of rows, a whole number from 1 to a million")?,
        };
        let (mut bias, mut every, mut of) = (true, 1, None);
        loop {
            match self.parser.peek() {
                Some(')') => break,
                Some(',') => self.parser.at += 1,
                _ => return Err(self.parser.expected("`,` or `)`")),
            }
            match self.option(name)? {
                Some("bias") => bias = self.truth()?,
                Some(_) => every = self.whole(1, MAX_COUNT, "a number of rows, a whole number from 1 to a million")?,
                None if of.is_some() => {
                    return Err(self.parser.expected("`)`: several variables stand in brackets, [x, y]"));
                }
                None => of = Some(self.of()?),
            }
        }
        self.parser.at += 1;
        let of = match of {
            Some(of) => of,
            None => self.default_variables(name == "fourier", start)?,
        };
        let library = match name {
            "poly" => self.workshop.monomials(&of, number, u32::MAX, bias),
            "interactions" => self.workshop.monomials(&of, number, 1, bias),
            "fourier" => self.workshop.fourier(&of, number),
            "past" => self.workshop.lagged(&of, lags(0, number - 1, every)),
            _ => self.workshop.lagged(&of, lags(every, number, every)),
        };
        library.map(Value::Library).map_err(|kind| self.parser.error(start, kind))
    }

    /// The name of an option that `library` takes, with its `=`, if one stands here.
    fn option(&mut self, library: &str) -> Result<Option<&'static str>, ParseError> {
        let start = self.parser.start();
        let (option, other) =
            if matches!(library, "poly" | "interactions") { ("bias", "every") } else { ("every", "bias") };
        let rest = &self.parser.text[start..];
        let length = identifier_length(rest);
        if length == 0 || !rest[length..].trim_start().starts_with('=') {
            return Ok(None);
        }
        if &rest[..length] != option || library == "fourier" {
            let expected = match (library, other) {
                ("fourier", _) => "variables: `fourier` takes no options",
                (_, "every") => "variables or `bias=false`",
                _ => "variables or `every=k`",
            };
            return Err(self.parser.expected(expected));
        }
        self.parser.at += length;
        self.parser.expect("=", "`=`")?;
        Ok(Some(option))
    }

    fn truth(&mut self) -> Result<bool, ParseError> {
        let start = self.parser.start();
        let rest = &self.parser.text[start..];
        let word = &rest[..identifier_length(rest)];
        let value = match word {
            "true" => true,
            "false" => false,
            _ => return Err(self.parser.expected("`true` or `false`")),
        };
        self.parser.at += word.len();
        Ok(value)
    }

    fn whole(&mut self, least: u32, most: u32, expected: &'static str) -> Result<u32, ParseError> {
        let start = self.parser.start();
        let rest = &self.parser.text[start..];
        let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        let value = rest[..digits].parse().ok().filter(|value| (least..=most).contains(value));
        let next = rest[digits..].trim_start().chars().next();
        match value {
            Some(value) if matches!(next, None | Some(',' | ')')) => {
                self.parser.at += digits;
                Ok(value)
            }
            _ => Err(self.parser.expected(expected)),
        }
    }

    /// `(of)`.
    fn of_parentheses(&mut self) -> Result<Candidates, ParseError> {
        self.parser.expect("(", "`(`")?;
        let of = self.of()?;
        self.parser.expect(")", "an operator or `)`")?;
        Ok(of)
    }

    /// Argument of a library: a list in brackets, or one library or expression.
    fn of(&mut self) -> Result<Candidates, ParseError> {
        let start = self.parser.start();
        if self.parser.peek() != Some('[') {
            let value = self.sum()?;
            return self.candidates(value, start);
        }
        self.parser.at += 1;
        let mut all = Candidates::default();
        loop {
            let start = self.parser.start();
            let value = self.sum()?;
            all.append(self.candidates(value, start)?);
            match self.parser.peek() {
                Some(',') => self.parser.at += 1,
                Some(']') => break,
                _ => return Err(self.parser.expected("an operator, `,` or `]`")),
            }
        }
        self.parser.at += 1;
        Ok(all)
    }

    /// The vocabulary's variables; with `angles`, in place of the cosine and the sine of an angle the angle.
    fn default_variables(&mut self, angles: bool, at: usize) -> Result<Candidates, ParseError> {
        if self.variables.is_empty() {
            return Err(self.parser.error(at, ParseErrorKind::NoVariables));
        }
        let mut all = Candidates::default();
        for variable in self.variables {
            let variable = match variable.node() {
                crate::Node::Unary(Unary::Sin | Unary::Cos, angle) if angles => angle,
                _ => variable,
            };
            all.append(self.workshop.single(variable).map_err(|kind| self.parser.error(at, kind))?);
        }
        Ok(all)
    }

    fn candidates(&mut self, value: Value, at: usize) -> Result<Candidates, ParseError> {
        match value {
            Value::Library(candidates) => Ok(candidates),
            Value::Expression(expr) => self.workshop.single(&expr).map_err(|kind| self.parser.error(at, kind)),
        }
    }

    fn joined(&self, operator: Binary, a: Expr, b: Expr, at: usize) -> Result<Expr, ParseError> {
        let joined = Expr::binary(operator, a, b);
        if joined.size() > MAX_SIZE { Err(self.parser.error(at, ParseErrorKind::TooLarge)) } else { Ok(joined) }
    }
}

/// `first, first + every, ...` up to `last`.
fn lags(first: u32, last: u32, every: u32) -> impl ExactSizeIterator<Item = i32> {
    let count = if first > last { 0 } else { (last - first) / every + 1 };
    (0..count).map(move |i| (first + i * every) as i32)
}

fn library_names() -> Vec<&'static str> {
    NUMBERED.into_iter().chain(["identity"]).chain(function_names()).collect()
}
