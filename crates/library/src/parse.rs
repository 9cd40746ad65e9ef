//! Parsing: expressions from text.

mod aliases;
mod call;
mod filter_name;
mod name;

pub(crate) use call::{function_names, named_unary};
pub(crate) use name::{identifier_length, is_bare_name};

use crate::{
    Binary, Expr, ParseError, ParseErrorKind, Scope,
    limits::{MAX_DEPTH, MAX_SIZE, MAX_TEXT},
};
use name::{constant, topic_length};

impl Expr {
    /// Reads an expression.
    ///
    /// ```text
    /// numbers      1, 2.5e-3, pi, inf, nan
    /// operators    + - * / ^ (or **), as in mathematics: -x^2 is -(x^2), 2^3^2 is 2^(3^2)
    /// functions    sin cos tan asin acos atan atan2(y, x) sinh cosh tanh exp log sqrt abs sign step min max pow
    ///              wrap(angle) to (-pi, pi]; sign(0) and step(0) are 0
    /// columns      vx, odom.x, u[2], x_1; any other name in backticks: `motor current (A)`, a backtick doubled
    /// topic fields /odom.twist.twist.linear.x, /joint_states.position[left_crank]
    /// rows         lag(x, 2) two rows earlier, lead(x, 1) one row later, of any expression; time() in seconds
    /// differences  forward(x), backward(x), central(x), central4(x), central6(x): over the actual time stamps
    /// filters      lag1(x, tau) first-order lag, delay(x, d) seconds earlier; tau and d of numbers and parameters, see FilterKind;
    ///              also lag1_slope, delay_slope (their derivatives with respect to tau and d) and present(x, d)
    /// rotations    yaw(q) pitch(q) roll(q): intrinsic Z-Y-X angles of a quaternion
    ///              rotate(q, v).x from the body's axes to the world's, rotate_inv(q, v).x back; also .y and .z
    /// ```
    ///
    /// A quaternion is the common beginning of four names (`q` for `q.x` or `q_x` or `qx`, and y, z, w) or
    /// `quat(x, y, z, w)`; it need not be normalised. A vector is the same with x, y, z, or `vec(a, b, c)`, or a rotated one.
    ///
    /// A slash where a value is expected begins a topic's field, which goes on over letters, digits and `_ . / [ ] : -`:
    /// write `/a.x - /b.y` and `/a.x / 2` with spaces. The words `pi`, `inf` and `nan` are numbers; columns of these
    /// names need backticks.
    ///
    /// # Errors
    /// A [`ParseError`] with the place, what was expected, and for a wrong name the nearest ones. Texts beyond a
    /// megabyte, 200 levels of nesting or a million nodes are refused.
    pub fn parse(text: &str, scope: &Scope) -> Result<Expr, ParseError> {
        let mut parser = Parser::new(text, scope);
        if text.len() > MAX_TEXT {
            return Err(parser.error(0, ParseErrorKind::TooLarge));
        }
        let expr = parser.expression(Power::Any)?;
        if parser.peek().is_some() {
            return Err(parser.expected("an operator or the end"));
        }
        Ok(expr)
    }
}

/// Binding strength up to which operators to the right of a value are left to the caller.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub(crate) enum Power {
    Any,
    Sum,
    Product,
    Sign,
}

/// A text, and how far it is read.
pub(crate) struct Parser<'a> {
    pub(crate) text: &'a str,
    scope: &'a Scope,
    pub(crate) at: usize,
    pub(crate) depth: usize,
}

impl<'a> Parser<'a> {
    /// At the beginning of a text.
    pub(crate) fn new(text: &'a str, scope: &'a Scope) -> Self {
        Self { text, scope, at: 0, depth: 0 }
    }

    /// Operator precedence parsing: a value, then all operators that bind more tightly than `outer`.
    pub(crate) fn expression(&mut self, outer: Power) -> Result<Expr, ParseError> {
        self.nested(|parser| {
            let left = parser.operand()?;
            parser.operators(left, outer)
        })
    }

    /// All operators behind `left` that bind more tightly than `outer`, with their right sides.
    pub(crate) fn operators(&mut self, mut left: Expr, outer: Power) -> Result<Expr, ParseError> {
        while let Some((function, length, right)) = self.operator(outer) {
            let position = self.at;
            self.at += length;
            let argument = self.expression(right)?;
            left = Expr::binary(function, left, argument);
            if left.size() > MAX_SIZE {
                return Err(self.error(position, ParseErrorKind::TooLarge));
            }
        }
        Ok(left)
    }

    /// The next operator, if it binds more tightly than `outer`: its function, its length, and how its right side is read.
    pub(crate) fn operator(&mut self, outer: Power) -> Option<(Binary, usize, Power)> {
        self.skip_space();
        let rest = &self.text.as_bytes()[self.at..];
        let (function, length, precedence, right) = match rest {
            // Right to left: the exponent takes its own powers and signs.
            [b'*', b'*', ..] => return Some((Binary::Pow, 2, Power::Sign)),
            [b'^', ..] => return Some((Binary::Pow, 1, Power::Sign)),
            [b'+', ..] => (Binary::Add, 1, Power::Sum, Power::Sum),
            [b'-', ..] => (Binary::Sub, 1, Power::Sum, Power::Sum),
            [b'*', ..] => (Binary::Mul, 1, Power::Product, Power::Product),
            [b'/', ..] => (Binary::Div, 1, Power::Product, Power::Product),
            _ => return None,
        };
        (precedence > outer).then_some((function, length, right))
    }

    /// A value with its signs.
    fn operand(&mut self) -> Result<Expr, ParseError> {
        match self.peek() {
            Some('-') => {
                self.at += 1;
                Ok(-self.expression(Power::Sign)?)
            }
            Some('+') => {
                self.at += 1;
                self.expression(Power::Sign)
            }
            Some('(') => {
                self.at += 1;
                let inner = self.expression(Power::Any)?;
                self.expect(")", "an operator or `)`")?;
                Ok(inner)
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            _ => {
                let start = self.at;
                let name = self.name("a number, a column, a function or `(`")?;
                if self.text[start..].starts_with(['`', '/']) {
                    return self.scope.resolve(&name).map_err(|kind| self.error(start, kind));
                }
                if self.peek() == Some('(') {
                    self.at += 1;
                    return self.call(&name, start);
                }
                match constant(&name) {
                    Some(value) => Ok(Expr::number(value)),
                    None => self.scope.resolve(&name).map_err(|kind| self.error(start, kind)),
                }
            }
        }
    }

    /// Digits with a point and an exponent.
    fn number(&mut self) -> Result<Expr, ParseError> {
        let bytes = self.text.as_bytes();
        let digits = |mut at: usize| {
            while bytes.get(at).is_some_and(u8::is_ascii_digit) {
                at += 1;
            }
            at
        };
        let mut end = digits(self.at);
        if bytes.get(end) == Some(&b'.') {
            end = digits(end + 1);
        }
        if matches!(bytes.get(end), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            let exponent = digits(end + 1 + sign);
            if exponent > end + 1 + sign {
                end = exponent;
            }
        }
        match self.text[self.at..end].parse() {
            Ok(value) => {
                self.at = end;
                Ok(Expr::number(value))
            }
            Err(_) => Err(self.expected("a number")),
        }
    }

    /// A name: an identifier, a topic's field or anything in backticks.
    pub(crate) fn name(&mut self, expected: &'static str) -> Result<String, ParseError> {
        self.skip_space();
        let rest = &self.text[self.at..];
        if rest.starts_with('`') {
            return self.quoted();
        }
        let length = if rest.starts_with('/') { topic_length(rest) } else { identifier_length(rest) };
        if length == 0 {
            return Err(self.expected(expected));
        }
        self.at += length;
        Ok(rest[..length].to_owned())
    }

    fn quoted(&mut self) -> Result<String, ParseError> {
        let mut name = String::new();
        let mut characters = self.text[self.at..].char_indices().skip(1).peekable();
        while let Some((offset, c)) = characters.next() {
            match c {
                '`' if characters.next_if(|&(_, next)| next == '`').is_some() => name.push('`'),
                '`' => {
                    self.at += offset + 1;
                    return Ok(name);
                }
                _ => name.push(c),
            }
        }
        Err(self.expected("a closing backtick"))
    }

    fn nested<T>(&mut self, read: impl FnOnce(&mut Self) -> Result<T, ParseError>) -> Result<T, ParseError> {
        if self.depth >= MAX_DEPTH {
            return Err(self.error(self.at, ParseErrorKind::TooDeep));
        }
        self.depth += 1;
        let result = read(self)?;
        self.depth -= 1;
        Ok(result)
    }

    pub(crate) fn start(&mut self) -> usize {
        self.skip_space();
        self.at
    }

    fn skip_space(&mut self) {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
    }

    pub(crate) fn peek(&mut self) -> Option<char> {
        self.skip_space();
        self.text[self.at..].chars().next()
    }

    pub(crate) fn expect(&mut self, token: &str, expected: &'static str) -> Result<(), ParseError> {
        self.skip_space();
        if !self.text[self.at..].starts_with(token) {
            return Err(self.expected(expected));
        }
        self.at += token.len();
        Ok(())
    }

    pub(crate) fn expected(&self, expected: &'static str) -> ParseError {
        let character = match self.text[self.at..].chars().next() {
            Some(c) => format!("`{c}`"),
            None => "the end".to_owned(),
        };
        self.error(self.at, ParseErrorKind::Expected { expected, actual: character })
    }

    pub(crate) fn error(&self, position: usize, kind: ParseErrorKind) -> ParseError {
        ParseError::new(self.text, position, kind)
    }
}
